"""Whose a folder is: empty, another's, or a dataset of ours; the one place that takes folders and removes datasets.

Only what a plan of ours lists by name is ever removed. Whatever else is in a folder is somebody's, and a refusal.
"""

import os
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

from zbuf_occlude.dataset import atomic
from zbuf_occlude.dataset.folder import (
    CONTACT_SHEET,
    GALLERY,
    MANIFEST,
    MESH_KEYS,
    ORIGINAL,
    PLAN,
    SHAPE_NAMES,
    list_of,
    read_plan,
)
from zbuf_occlude.dataset.formats import find_format
from zbuf_occlude.dataset.parts import mark_path, n_parts, shared_names
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.dataset.shard import data_path, sidecar_path
from zbuf_occlude.dataset.shared import unfinished
from zbuf_occlude.errors import DatasetError
from zbuf_occlude.meshes.collection import SPLITS

LONGEST = 255
"""Bytes that file systems allow in a name."""


class State(Enum):
    """What a folder is."""

    EMPTY = "empty, or not there"
    FOREIGN = "another's"
    UNFINISHED = "a dataset of ours, not finished"
    FINISHED = "a dataset of ours"


@dataclass(frozen=True)
class Found:
    """What a folder is, the plan of a dataset of ours, and why it is none."""

    state: State
    plan: Plan | None = None
    reason: str = ""


def look(out: Path) -> Found:
    """Find out what a folder is; nothing is changed."""
    if not out.is_dir() or not set(out.iterdir()) - set(atomic.leftovers([out])):
        return Found(State.EMPTY)
    if not (out / PLAN).exists():
        return Found(State.FOREIGN, reason=f"{out} must be empty or hold a dataset; it has other files.")
    try:
        plan = read_plan(out)
    except DatasetError as error:
        return Found(State.FOREIGN, reason=str(error))
    return Found(State.FINISHED if (out / MANIFEST).exists() else State.UNFINISHED, plan)


def claim(plan: Plan, out: Path) -> None:
    """Make the folder this plan's, or find that it is already; nothing in it is removed.

    Raises
    ------
    DatasetError
        It is another's, or another plan's, if only just begun.
    """
    if look_for(plan, out) is State.EMPTY:
        out.mkdir(parents=True, exist_ok=True)
        try:
            document = {"fingerprint": plan.fingerprint, **plan.document}
            atomic.write_json(out / PLAN, document, exclusive=True)
        except FileExistsError:  # somebody was faster
            _check_same(plan, read_plan(out), out)


def look_for(plan: Plan, out: Path) -> State:
    """Find out what a folder is, which a plan's dataset is to be in; nothing is changed.

    Raises
    ------
    DatasetError
        It is another's, or another plan's.
    """
    found = look(out)
    if found.state is State.FOREIGN:
        raise DatasetError(f"{found.reason} Choose another folder.")
    if found.plan is not None:
        _check_same(plan, found.plan, out)
    return found.state


def _check_same(plan: Plan, theirs: Plan, out: Path) -> None:
    if theirs.fingerprint != plan.fingerprint:
        differences = plan.differences(theirs.document) or ["the views are others"]
        more = f", and {len(differences) - 3} more" if len(differences) > 3 else ""
        raise DatasetError(
            f"{out} must be empty or hold this same plan ({plan.fingerprint}); it holds plan {theirs.fingerprint}, "
            f"in which {'; '.join(differences[:3])}{more}. Choose another folder, or generate with --overwrite."
        )


def remove(out: Path) -> None:
    """Remove a dataset of ours from its folder, with the complete clouds beside it.

    Raises
    ------
    DatasetError
        As `removable`; nothing was removed.
    """
    for folder, plan in removable(out):
        (folder / MANIFEST).unlink(missing_ok=True)  # first: what is left of the dataset is no finished one
        _remove_files(folder, sorted(own_names(plan) - {PLAN}))
        (folder / PLAN).unlink()  # last: until then the folder is known for ours
    with suppress(OSError):
        (out / ORIGINAL).rmdir()


def removable(out: Path) -> list[tuple[Path, Plan]]:
    """Return the folders and plans of a dataset of ours and of the complete clouds beside it; nothing is changed.

    Raises
    ------
    DatasetError
        The folder is another's, or something in it is.
    """
    datasets = [(each, found.plan) for each in (out / ORIGINAL, out) if (found := look(each)).plan is not None]
    if (found := look(out)).state is State.FOREIGN:
        raise DatasetError(f"{found.reason} Choose another folder.")
    for folder, plan in datasets:
        if others := strangers(folder, plan):
            more = f" and {len(others) - 1} more" if len(others) > 1 else ""
            raise DatasetError(
                f"{folder} must hold nothing but its dataset to be overwritten; it has other files: {others[0]}{more}. "
                "Nothing was removed. Move them away, or choose another folder."
            )
    return datasets


def remove_shards(plan: Plan, out: Path) -> None:
    """Remove what a finished dataset no longer needs: its shards, and what killed processes left."""
    names = [sidecar_path(out, shard).relative_to(out) for shard in range(len(plan.shards))]
    names += [mark_path(out, part).relative_to(out) for part in range(n_parts(plan))]
    names += [path for i in range(len(plan.shards)) if (path := data_path(plan, out, i).relative_to(out)).parent.name]
    _remove_files(out, list(map(str, names)))
    for path in atomic.leftovers(out / folder for folder in _folders(own_names(plan))):
        path.unlink(missing_ok=True)


def own_names(plan: Plan) -> set[str]:
    """Return every name that a plan's dataset may have in its folder, finished or not.

    Raises
    ------
    DatasetError
        One is too long for a file.
    """
    names = {PLAN, MANIFEST, CONTACT_SHEET, GALLERY, SHAPE_NAMES, MESH_KEYS, *map(list_of, SPLITS)}
    names |= set(find_format(plan.format).load().names(plan))
    here = Path()
    for shard in range(len(plan.shards)):
        names |= {sidecar_path(here, shard).as_posix(), data_path(plan, here, shard).as_posix()}
    names |= {mark_path(here, part).as_posix() for part in range(n_parts(plan))}
    names |= {unfinished(here, name).as_posix() for name in shared_names(plan)}
    for name in names:
        longest = max(map(len, os.fsencode(name).split(b"/")))
        if longest > LONGEST:
            raise DatasetError(
                f"names of files must be of at most {LONGEST} bytes; in {plan.format} one would be of {longest}, "
                f"{name[:100]!r}... Rename that mesh or its folder, or take another --format."
            )
    return names


def strangers(out: Path, plan: Plan) -> list[str]:
    """Return what is in a dataset's folder and not the dataset's, from the folder on."""
    return sorted(_strangers(out, own_names(plan)))


def _strangers(out: Path, names: set[str]) -> Iterator[str]:
    folders = _folders(names)
    for path, subfolders, files in os.walk(out):
        here = os.path.relpath(path, out)
        prefix = "" if here == "." else f"{here}/"
        for name in list(subfolders):
            ours = f"{prefix}{name}" in folders and not os.path.islink(os.path.join(path, name))
            if not ours:
                subfolders.remove(name)
                if prefix or name != ORIGINAL or look(out / ORIGINAL).plan is None:
                    yield f"{prefix}{name}/"
        for name in files:
            if f"{prefix}{name}" not in names and not atomic.is_temporary(name):
                yield prefix + name


def _folders(names: set[str]) -> set[str]:
    """The folders that files of these names lie in, and the folders of those; "" is the dataset's own."""
    found, left = {""}, {name.rpartition("/")[0] for name in names}
    while left:
        found |= left
        left = {name.rpartition("/")[0] for name in left} - found
    return found


def _remove_files(out: Path, names: list[str]) -> None:
    for name in names:
        (out / name).unlink(missing_ok=True)
    folders = _folders(set(names))
    for path in atomic.leftovers(out / folder for folder in folders):
        path.unlink(missing_ok=True)
    for folder in sorted(folders - {""}, key=len, reverse=True):
        with suppress(OSError):  # it is not there, or has something else in it
            (out / folder).rmdir()
