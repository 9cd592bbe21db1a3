"""The folder of a dataset: the names of its files, its plan and manifest, its lock, and its removal.

Only files that the dataset's own plan and manifest name are removed. Any other file stops a removal.
"""

import hashlib
import json
import os
import re
import stat
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

from zbuf_occlude.base import atomic
from zbuf_occlude.base.atomic import LOCK, reading
from zbuf_occlude.base.errors import DatasetError
from zbuf_occlude.datasets.cloud_folder import cloud_files
from zbuf_occlude.datasets.counts import FEW
from zbuf_occlude.datasets.formats import find_format
from zbuf_occlude.datasets.plan import Plan
from zbuf_occlude.meshes.collection import SPLITS

PLAN, MANIFEST = "plan.json", "manifest.json"
SHARDS = "shards"
"""Folder of the sidecars of shards, and of the files of shards that are exported."""
WORK = "work"
"""Folder of an unfinished export."""
EXPORT_NAMES = "export.json"
"""File in the folder `WORK` that lists the files of an unfinished or damaged dataset."""
CONTACT_SHEET, GALLERY = "contact_sheet.png", "gallery.html"
SHAPE_NAMES, MESH_KEYS = "shape_names.txt", "mesh_keys.txt"
ORIGINAL = "original"
"""Folder of the dataset of complete clouds that some presets make too."""

PLAN_REMEDY = "Copy it again from where it was made; or delete the folder yourself, and make the dataset again."
"""Remedy of a damaged plan. Only the plan says which files are the dataset's, so nothing is deleted."""

Kinds = dict[str, Any]
"""Schema of a JSON object: the kind of each value, by name. A kind is a type or types, the `Kinds` of an inner object,
an `Each`, or a list with a kind for each value."""


class Each(NamedTuple):
    """Kind of an object, or of a list, of any number of values of one kind."""

    of: type[dict[str, Any]] | type[list[Any]]
    kind: Any


SOURCE: Kinds = {"sha256": str, "files": Each(list, [str, int])}
"""Schema of a `MeshSource`."""
_SHARE = (int, float, type(None))  # None: nothing was checked
_OBJECT = (dict, type(None))
_OF_MANIFEST: Kinds = {
    "blank_views": Each(dict, {"n_views": int, "variation": int, "view": int, "reason": str}),
    "bytes": Each(dict, int),
    "classes": Each(list, str),
    "counts": {
        "clouds": int, "clouds_by_split": Each(dict, int), "meshes": int, "meshes_failed": int, "views": int,
        "variations": int, "views_that_see_nothing": int, "scans_of_too_few_points": int,
        "views_inside_the_bounding_box": int, "cameras_raised_above_the_ground": int,
        f"clouds_of_fewer_than_{FEW}_distinct_points": int, "meshes_without_colors": int,
        "meshes_with_far_faces": int, "meshes_without_windows": int,
    },
    "cut_by_range": _OBJECT,
    "error": {
        "false_visible": _SHARE, "false_hidden": _SHARE, "interval": (list, type(None)), "n_checked": int,
        "bad_views": _SHARE, "worst_view": _OBJECT,
    },
    "failures": Each(dict, str),
    "files": Each(dict, Each(list, str)),
    "fingerprint": str,
    "format": str,
    "left_out": Each(dict, str),
    "options": {"complete": bool, "method": str, "reason": str, "scan": _OBJECT},
    "origins": Each(dict, SOURCE),
    "renderer": str,
    "renderer_remark": str,
    "seed": int,
    "sha256": Each(dict, str),
}  # fmt: skip
"""Fields of a manifest that the commands read."""


def datasets_in(out: Path) -> list[Path]:
    """Return a dataset's folder and, where there is one, that of its complete clouds."""
    return [out, *([out / ORIGINAL] if (out / ORIGINAL / PLAN).exists() else [])]


def read_plan(out: Path) -> Plan:
    """Read back the plan of a dataset's folder; DatasetError where there is none, or it is damaged."""
    path = out / PLAN
    if not path.exists():
        if cloud_files(out):
            raise DatasetError(
                f"{out} must hold a dataset of `zbuf-occlude generate`; it is a folder of cloud files, such as `crop` "
                "makes. `view`, `train`, `evaluate` and `zo.torch.CloudDataset` read it."
            )
        raise DatasetError(f"{out} must hold a dataset; it has no {PLAN}. Was it made by `zbuf-occlude generate`?")
    with reading(path, PLAN_REMEDY):
        document = read_object(path, {"fingerprint": str})
        plan = Plan.from_dict(document)
        found = plan.fingerprint
    if found != document["fingerprint"]:
        raise DatasetError(
            f"{path} must have the fingerprint {document['fingerprint']}; it has {found}. It was changed. {PLAN_REMEDY}"
        )
    return plan


def read_command(out: Path) -> dict[str, Any]:
    """Return the options of the command line that made the plan in a folder; none where it was made in Python."""
    path = out / PLAN
    with reading(path, PLAN_REMEDY):
        command: dict[str, Any] = read_object(path, {}).get("command", {})
    return command


def read_manifest(out: Path) -> dict[str, Any] | None:
    """Return the manifest of a folder whose dataset is complete, None for one that is not; DatasetError if damaged."""
    path = out / MANIFEST
    if not path.exists():
        return None
    with reading(path):
        document = read_object(path, _OF_MANIFEST)
        if not document["files"] or not all(document["files"].values()):
            raise ValueError("it names no files")
        for names in document["files"].values():
            for name in sorted(set(names) - document["sha256"].keys()):
                raise KeyError(name)
    return document


def read_object(path: Path, kinds: Kinds) -> dict[str, Any]:
    """Read a JSON object and check it against its schema; errors are those that `atomic.reading` expects."""
    document: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    _check_kind(document, kinds, "it")
    return document


def _check_kind(value: Any, kind: Any, what: str) -> None:
    """Raise TypeError, ValueError or KeyError where a value, or one in it, is not what its schema says."""
    of_value: Any = {dict: dict, list: list, Each: getattr(kind, "of", None)}.get(type(kind), kind)
    if not isinstance(value, of_value):
        raise TypeError(f"{what} is no object" if of_value is dict else f"{what} is {json.dumps(value)[:40]}")
    if isinstance(kind, dict):
        for name, of in kind.items():
            _check_kind(value[name], of, name)
    elif isinstance(kind, Each):
        for each in value.values() if kind.of is dict else value:
            _check_kind(each, kind.kind, what)
    elif isinstance(kind, list):
        if len(value) != len(kind):
            raise ValueError(f"{what} has a row of {len(value)}")
        for each, of in zip(value, kind, strict=True):
            _check_kind(each, of, what)


def read_finished(out: Path) -> tuple[Plan, dict[str, Any]]:
    """Return the plan and the manifest of a complete dataset; DatasetError where there is none, or it is damaged."""
    plan, manifest = read_plan(out), read_manifest(out)
    if manifest is None:
        raise DatasetError(
            f"{out} must hold a complete dataset; it has no {MANIFEST}. Finish it: zbuf-occlude status {out}"
        )
    return plan, manifest


def list_of(split: str) -> str:
    """Return the name of the list of a split's files, which some formats have."""
    return f"{split}_files.txt"


def sha256_of(path: Path) -> str:
    """Return the SHA-256 of a file's content, in hexadecimal."""
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def has_size(path: Path, n_bytes: int) -> bool:
    """Return whether a file is there and has a size."""
    try:
        found = path.stat()
    except OSError:
        return False
    return stat.S_ISREG(found.st_mode) and found.st_size == n_bytes


def damaged(out: Path, manifest: Mapping[str, Any]) -> list[str]:
    """Return the files of a finished dataset that are missing or have another size than when they were written."""
    return [name for name, n_bytes in sorted(manifest["bytes"].items()) if not has_size(out / name, n_bytes)]


def checksums(out: Path, names: Iterable[str], known: Mapping[str, str] = MappingProxyType({})) -> dict[str, str]:
    """Return the SHA-256 of files of a dataset by name, and of its lists of labels, meshes and files.

    Files whose checksum is `known` are not read again.
    """
    beside = {name for name in (SHAPE_NAMES, MESH_KEYS, *map(list_of, SPLITS)) if (out / name).exists()}
    found = {}
    for name in sorted(beside.union(names)):
        with reading(out / name):
            found[name] = known[name] if name in known else sha256_of(out / name)
    return found


def sizes(out: Path, names: Iterable[str]) -> dict[str, int]:
    """Return the bytes of files of a dataset by name; DatasetError where one is missing."""
    found = {}
    for name in names:
        with reading(out / name):
            found[name] = (out / name).stat().st_size
    return found


def write_names(plan: Plan, out: Path) -> None:
    """Write the lists of the names of classes and of the keys of meshes."""
    atomic.write_lines(out / SHAPE_NAMES, plan.classes)
    atomic.write_lines(out / MESH_KEYS, [entry.key for entry in plan.meshes])


def plan_in(out: Path) -> Plan | None:
    """Return the plan of the dataset in a folder; None if the folder is missing or empty, else DatasetError."""
    if not out.is_dir() or not set(out.iterdir()) - set(atomic.leftovers([out])):
        return None
    if not (out / PLAN).exists():
        raise DatasetError(f"{out} must be empty or hold a dataset; it has other files. Choose another folder.")
    try:
        return read_plan(out)
    except DatasetError as error:
        raise DatasetError(f"{error} Choose another folder.") from None


def contains_plan(plan: Plan, out: Path) -> bool:
    """Return whether a folder holds this plan's dataset, finished or not; DatasetError if it holds anything else."""
    theirs = plan_in(out)
    if theirs is None or theirs.fingerprint == plan.fingerprint:
        return theirs is not None
    differences = [*plan.differences(theirs.to_dict())] or ["the views are others"]
    more = f", and {len(differences) - 3} more" if len(differences) > 3 else ""
    raise DatasetError(
        f"{out} must be empty or hold this same plan ({plan.fingerprint}); it holds plan {theirs.fingerprint}, "
        f"in which {'; '.join(differences[:3])}{more}. Choose another folder, or generate with --overwrite."
    )


def claim_folder(plan: Plan, out: Path, command: Mapping[str, Any] = MappingProxyType({})) -> None:
    """Write the plan into its folder, unless it is there already; nothing in the folder is removed.

    `command` are the options of the command line that made the plan, for the manifest.
    """
    if not contains_plan(plan, out):
        out.mkdir(parents=True, exist_ok=True)
        try:
            document = {"fingerprint": plan.fingerprint, "command": dict(command), **plan.to_dict()}
            atomic.write_json(out / PLAN, document, exclusive=True)
        except FileExistsError:  # another run was faster
            contains_plan(plan, out)


@contextmanager
def locked(out: Path, *, shared: bool = False, wait: bool = False) -> Iterator[None]:
    """Hold a folder for this run alone, or for the shares of a dataset; the lock ends with the process at the latest.

    Another run is waited for with `wait`. Without it, another run is a DatasetError.
    """
    out.mkdir(parents=True, exist_ok=True)
    try:
        fcntl = import_module("fcntl")
    except ImportError:  # only Unix has it
        yield
        return
    path, held = out / LOCK, False
    while not held:
        with open(path, "a+b") as file:
            try:
                fcntl.flock(file, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | (0 if wait else fcntl.LOCK_NB))
            except BlockingIOError:
                raise DatasetError(
                    f"{out} must be made by one run at a time; another is at work there. Wait until it ends, or give "
                    "each run its own --shard I/N."
                ) from None
            except OSError:  # a file system without locks
                yield
                return
            # the run that held the lock removes its file
            held = path.exists() and os.path.samestat(path.stat(), os.fstat(file.fileno()))
            if held:
                try:
                    yield
                finally:
                    if not shared:  # others may share it
                        path.unlink(missing_ok=True)


def remove(out: Path) -> None:
    """Remove a dataset and its complete clouds from their folder, unless other files are in it (`removable`).

    DatasetError where another run is at work on either of them.
    """
    with ExitStack() as held:
        for folder in dict.fromkeys([out, *(folder for folder, _ in removable(out))]):
            held.enter_context(locked(folder))
        for folder, plan in removable(out):
            unfinish(folder)  # first: what is left is no finished dataset
            own, _ = partition_files(folder, plan)
            names = f"{WORK}/{EXPORT_NAMES}"
            remove_files(folder, [name for name in own if name not in (PLAN, LOCK, names)])
            remove_files(folder, [names, f"{WORK}/"])  # they show which files are ours until all others are removed
            (folder / PLAN).unlink()  # last: it shows that the folder is ours
    with suppress(OSError):
        (out / ORIGINAL).rmdir()


def unfinish(out: Path) -> None:
    """Mark the dataset of a folder as unfinished; the names of its files stay known."""
    if (out / MANIFEST).exists():
        (out / WORK).mkdir(exist_ok=True)
        with suppress(FileNotFoundError):  # another share was faster
            os.replace(out / MANIFEST, out / WORK / EXPORT_NAMES)


def removable(out: Path) -> list[tuple[Path, Plan]]:
    """Return the folders and plans of a dataset of ours and of its complete clouds; nothing is changed.

    DatasetError where the folder, or something in it, is not ours.
    """
    plan, original = plan_in(out), _original(out)
    datasets = [(out / ORIGINAL, original)] if original else []
    datasets += [(out, plan)] if plan else []
    for folder, each in datasets:
        if others := partition_files(folder, each)[1]:
            more = f" and {len(others) - 1} more" if len(others) > 1 else ""
            raise DatasetError(
                f"{folder} must hold nothing but its dataset to be overwritten; it has other files: {others[0]}{more}. "
                "Nothing was removed. Move them away, or choose another folder."
            )
    return datasets


def _original(out: Path) -> Plan | None:
    """Return the plan of the complete clouds of a dataset; None where there are none of ours."""
    with suppress(DatasetError):
        return plan_in(out / ORIGINAL)
    return None


def leftover_work(out: Path, plan: Plan) -> list[str]:
    """Return unfinished work, the shards of an export, and temporary files of killed processes."""
    own, _ = partition_files(out, plan)
    folders = (WORK, SHARDS) if find_format(plan.format).exported_from else (WORK,)
    left = (each for each in own if each.split("/")[0] in folders or atomic.is_temporary(Path(each).name))
    return [name for name in left if name != LOCK]


def partition_files(out: Path, plan: Plan) -> tuple[list[str], list[str]]:
    """Return the files and folders that belong to a dataset, and the others; names of folders end in a slash."""
    names = {PLAN, MANIFEST, CONTACT_SHEET, GALLERY, SHAPE_NAMES, MESH_KEYS, *map(list_of, SPLITS)}
    row = find_format(plan.format)
    names |= {f"{SHARDS}/{name}" if row.exported_from else name for name in row.names(plan)} | set(recorded(out))
    folders = {"", SHARDS, WORK} | {str(parent) for name in names for parent in Path(name).parents} - {"."}
    own, others = list[str](), list[str]()
    for path, subfolders, files in os.walk(out):
        here = "" if (found := os.path.relpath(path, out)) == "." else f"{found}/"
        for name in list(subfolders):
            whole = f"{here}{name}"
            ours = whole in folders or whole.startswith(f"{WORK}/export")
            if os.path.islink(os.path.join(path, name)) or not ours:
                subfolders.remove(name)
                if here or name != ORIGINAL or _original(out) is None:
                    others.append(f"{whole}/")
            else:
                own.append(f"{whole}/")
        for name in files:
            whole = f"{here}{name}"
            is_own = whole in names or _OWN.match(whole) or atomic.is_temporary(name)
            (own if is_own else others).append(whole)
    return own, sorted(others)


_OWN = re.compile(rf"{SHARDS}/\d{{6}}\.json$|{WORK}/({EXPORT_NAMES}$|export/)")


def recorded(out: Path) -> Iterator[str]:
    """Yield the names of files that a manifest, or the list of an unfinished export, names."""
    for path in (out / MANIFEST, out / WORK / EXPORT_NAMES):
        with suppress(OSError, ValueError, LookupError, TypeError, AttributeError):  # damaged: what it names stays
            document = json.loads(path.read_bytes())
            names = document["sha256"] if "sha256" in document else document["names"]
            yield from (name for name in names if isinstance(name, str))


def remove_files(out: Path, names: Iterable[str]) -> None:
    """Remove files and folders; folders of these files that are empty then are removed too."""
    folders = set[Path]()
    for name in names:
        if name.endswith("/"):
            folders.add(out / name)
        else:
            (out / name).unlink(missing_ok=True)
            folders.update((out / name).parents)
    for folder in sorted(folders, key=lambda each: len(each.parts), reverse=True):
        if out in folder.parents:
            with suppress(OSError):  # something else is in it
                folder.rmdir()
