"""Final files, part by part, of the clouds that shards keep; then the shards give those up.

A part is a file's clouds, of all shards of a group; of formats that want whole objects, all clouds of a few shards.
Parts of a group are written from the last to the first. A shard keeps its clouds in the order of the parts, so what is
no longer needed of it is always its end, and is cut off as soon as the part's files and its mark are on the disk.
"""

import logging
import os
from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.dataset.clouds import record_type
from zbuf_occlude.dataset.folder import SHARDS, sha256_of
from zbuf_occlude.dataset.formats import find_format
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.dataset.records import Run, in_places, read_run
from zbuf_occlude.dataset.sealed import read_sealed, write_sealed
from zbuf_occlude.dataset.shard import Sidecar, data_path, look_at, read_shard
from zbuf_occlude.dataset.shared import where
from zbuf_occlude.dataset.source import Content
from zbuf_occlude.errors import DatasetError
from zbuf_occlude.meshes.collection import SPLITS

_LOG = logging.getLogger(__name__)


@dataclass(frozen=True)
class Mark:
    """What is known of a part that is written.

    Parameters
    ----------
    fingerprint : str
        Of its plan.
    files : mapping of split to list of file names
    n_clouds : mapping of split to int
        In these files.
    sha256 : mapping of file name to checksum
        None of files that have other parts' clouds too.
    sizes : mapping of file name to bytes
    copied_from : str
        Fingerprint of the dataset that `convert` took the clouds from; "" of clouds that shards were made of.
    """

    fingerprint: str
    files: Mapping[str, list[str]]
    n_clouds: Mapping[str, int]
    sha256: Mapping[str, str]
    sizes: Mapping[str, int]
    copied_from: str = ""


def n_parts(plan: Plan) -> int:
    """Return how many parts there are to write: 0 where shards are the files."""
    row = find_format(plan.format)
    if row.all_points:
        return 0
    return -(-len(plan.shards) // plan.shards_per_part) if row.whole_objects else len(plan.parts)


def shards_in(plan: Plan, part: int) -> range:
    """Return the shards that clouds of a part may be in."""
    if not find_format(plan.format).whole_objects:
        return plan.shards_of[plan.parts[part].group]
    return range(part * plan.shards_per_part, min((part + 1) * plan.shards_per_part, len(plan.shards)))


def parts_of(plan: Plan, shard: int) -> range:
    """Return the parts that clouds of a shard may be in."""
    row = find_format(plan.format)
    if row.all_points:
        return range(0)
    if not row.whole_objects:
        return plan.parts_of(plan.group_of(shard))
    return range(part := shard // plan.shards_per_part, part + 1)


class Step(NamedTuple):
    """Shards, and the parts that may be written when these are done."""

    shards: range
    parts: range


def steps(plan: Plan) -> list[Step]:
    """Return in what steps a dataset's shards become its files."""
    row = find_format(plan.format)
    if row.one_file or row.all_points:
        return [Step(range(len(plan.shards)), range(n_parts(plan)))]
    if row.whole_objects:
        return [Step(shards_in(plan, part), range(part, part + 1)) for part in range(n_parts(plan))]
    return [Step(shards, plan.parts_of(group)) for group, shards in enumerate(plan.shards_of)]


def shared_names(plan: Plan) -> Iterator[str]:
    """Yield the names of the files that hold a split whole."""
    row = find_format(plan.format)
    return row.load().names(plan) if row.one_file else iter(())


def mark_path(out: Path, part: int) -> Path:
    """Where the mark of a part is; without it the part is not written."""
    return out / SHARDS / f"part-{part:06d}.json"


def look_at_part(plan: Plan, out: Path, part: int) -> tuple[Mark | None, str]:
    """Return the mark of a part that is written; of any other None and, where there are pieces of it, what is wrong.

    Raises
    ------
    DatasetError
        It belongs to another plan.
    """
    mark, fault = _read_mark(plan, out, part)
    if mark is None:
        return None, fault
    for name, size in mark.sizes.items():
        path = _path(plan, out, name)
        if not path.is_file() or path.stat().st_size != size:
            return None, f"its {name} is {'damaged' if path.is_file() else 'missing'}"
    return mark, ""


def find_written(plan: Plan, out: Path, copied_from: str = "") -> set[int]:
    """Return the parts that are written; of those that are damaged, take away what would stand in the way.

    Parameters
    ----------
    plan : Plan
    out : Path
    copied_from : str
        As of `Mark`, of the parts that are still to be written.

    Raises
    ------
    DatasetError
        One belongs to another plan, or its clouds were not taken from there.
    """
    written = set()
    for part in range(n_parts(plan)):
        mark, fault = look_at_part(plan, out, part)
        if mark is not None:
            if mark.copied_from != copied_from:
                other = f"`convert` from the dataset {mark.copied_from}" if mark.copied_from else "`generate`"
                raise DatasetError(
                    f"{out} must be empty or begun by this same command; {other} has begun the same plan there. "
                    "Choose another folder, or finish it by that command."
                )
            written.add(part)
        elif fault:
            _LOG.warning("part %d is written again: %s", part, fault)
            _discard(plan, out, part)
    return written


def _discard(plan: Plan, out: Path, part: int) -> None:
    """Remove a part's mark, and what has not the size of a split's whole file; another run may be faster."""
    mark, _ = _read_mark(plan, out, part)
    if mark is not None and find_format(plan.format).one_file:
        for name, size in mark.sizes.items():
            if (path := where(out, name)).is_file() and path.stat().st_size != size:
                path.unlink(missing_ok=True)
    mark_path(out, part).unlink(missing_ok=True)


def runs_left(plan: Plan, written: Collection[int]) -> list[int | None]:
    """Return how many runs of each shard are still needed, given the parts written; None: all of it."""
    row = find_format(plan.format)
    if row.all_points or row.whole_objects:
        n = plan.shards_per_part
        return [0 if row.whole_objects and shard // n in written else None for shard in range(len(plan.shards))]
    return [
        n_runs
        for group, shards in enumerate(plan.shards_of)
        for n_runs in [_n_runs(plan.parts_of(group), written)] * len(shards)
    ]


def _n_runs(parts: range, written: Collection[int]) -> int:
    return max((part + 1 - parts.start for part in parts if part not in written), default=0)


class Shard(NamedTuple):
    """The data of a finished shard, and the runs that they were made of."""

    path: Path
    runs: list[Run]


def shards_of(plan: Plan, out: Path, part: int) -> list[Shard]:
    """Return the finished shards that a part is made of, whatever is left of them.

    Raises
    ------
    DatasetError
        One is not finished.
    """
    return [Shard(data_path(plan, out, i), _sidecar(plan, out, i).runs) for i in shards_in(plan, part)]


def _sidecar(plan: Plan, out: Path, shard: int) -> Sidecar:
    sidecar, fault = look_at(plan, out, shard, n_runs=0)
    if sidecar is None:
        raise DatasetError(f"{out}: shard {shard} must be done; it is not{fault and f': {fault}'}.")
    return sidecar


@dataclass(frozen=True)
class Places:
    """Where the clouds of each part begin in files that hold a split whole, and how many there are.

    Parameters
    ----------
    first : list of mapping of split to int
        Clouds of the split in all parts before each.
    total : mapping of split to int
    """

    first: list[Mapping[str, int]]
    total: Mapping[str, int]


def places_of(plan: Plan, out: Path) -> Places:
    """Count the clouds of all finished shards, for files that hold a split whole.

    Raises
    ------
    DatasetError
        One is not finished.
    """
    sidecars = [_sidecar(plan, out, shard) for shard in range(len(plan.shards))]
    if find_format(plan.format).whole_objects:
        kept = [Counter(clouds_kept(plan, sidecar)) for sidecar in sidecars]
        parts = [shards_in(plan, part) for part in range(n_parts(plan))]
        counts: list[Mapping[str, int]] = [sum((kept[i] for i in some), Counter()) for some in parts]
    else:
        itemsize = record_type(plan.recipe).itemsize
        counts = []
        for shards in plan.shards_of:
            runs = np.array([[n_bytes for n_bytes, _ in sidecars[shard].runs] for shard in shards])
            n_clouds = runs.sum(axis=0) // itemsize
            counts += [{plan.parts[len(counts) + i].split: int(n)} for i, n in enumerate(n_clouds)]
    return placed(counts)


def placed(counts: list[Mapping[str, int]]) -> Places:
    """Return where the clouds of each part begin, given how many of each split it has."""
    first, total = list[Mapping[str, int]](), Counter[str]()
    for of_part in counts:
        first.append(dict(total))
        total.update(of_part)
    return Places(first, total)


def clouds_kept(plan: Plan, sidecar: Sidecar) -> dict[str, int]:
    """Return how many clouds of a shard go into files, by split."""
    row = find_format(plan.format)
    if not row.whole_objects:
        return dict(sidecar.n_clouds)
    return {split: n * row.n_kept(split, plan.clouds_per_mesh) for split, n in sidecar.n_whole.items()}


def write_part(plan: Plan, out: Path, part: int, shards: list[Shard], places: Places | None = None) -> None:
    """Write a part, then its mark, and cut off of its shards what is no longer needed.

    Raises
    ------
    DatasetError
        A shard is missing or damaged.
    """
    try:
        contents = _contents(plan, part, shards)
    except DatasetError:
        if look_at_part(plan, out, part)[0] is None:
            raise
        return  # another run of the same command has written it, and cut the shards
    write_contents(plan, out, part, contents, places)
    trim(plan, out, part, shards)


def write_contents(
    plan: Plan, out: Path, part: int, contents: list[Content], places: Places | None, copied_from: str = ""
) -> None:
    """Write a part of these clouds, then its mark."""
    row, files, n_clouds = find_format(plan.format), dict[str, list[str]](), dict[str, int]()
    for content in contents:
        records, split = row.kept(content.records, content.split, plan.clouds_per_mesh), content.split
        if len(records):
            content = replace(content, records=records)
            if places is not None:
                content = replace(content, first=places.first[part].get(split, 0), total=places.total[split])
            files[split] = row.load().write_part(content, out)
            n_clouds[split] = len(records)
    names = {name for of_split in files.values() for name in of_split}
    digests = {} if row.one_file else {name: sha256_of(out / name) for name in sorted(names)}
    sizes = {name: _path(plan, out, name).stat().st_size for name in sorted(names)}
    _write_mark(out, part, Mark(plan.fingerprint, files, n_clouds, digests, sizes, copied_from))


def trim(plan: Plan, out: Path, part: int, shards: list[Shard]) -> None:
    """Cut off the shards of a part what files hold that are written."""
    n_runs = 0
    if not find_format(plan.format).whole_objects:
        parts = plan.parts_of(plan.parts[part].group)
        n_runs = _n_runs(parts, [each for each in parts if mark_path(out, each).exists()])
    for path, runs in shards:
        n_bytes = sum(size for size, _ in runs[:n_runs])
        try:
            if not n_bytes:
                path.unlink()
            elif path.stat().st_size > n_bytes:
                os.truncate(path, n_bytes)
        except FileNotFoundError:
            continue  # cut off whole before, here or by another worker


def _read_mark(plan: Plan, out: Path, part: int) -> tuple[Mark | None, str]:
    return read_sealed(mark_path(out, part), plan, lambda document: Mark(**document))


def _write_mark(out: Path, part: int, mark: Mark) -> None:
    write_sealed(mark_path(out, part), mark.__dict__, synced=True)  # then shards are cut


def _path(plan: Plan, out: Path, name: str) -> Path:
    return where(out, name) if find_format(plan.format).one_file else out / name


def _contents(plan: Plan, part: int, shards: list[Shard]) -> list[Content]:
    """Return what a part is written of: of each split that it has clouds of."""
    if not find_format(plan.format).whole_objects:
        _, split, number = plan.parts[part]
        return [Content(plan, split, number, _records_of(plan, part, shards))]
    made = [read_shard(plan, *shard) for shard in shards]
    records = np.concatenate([each.records for each in made])
    records = records[np.argsort(records["mesh_id"], kind="stable")]  # shards of two groups may meet in a part
    by_mesh = {mesh_id: each.complete for each in made for mesh_id in np.unique(each.records["mesh_id"]).tolist()}

    def complete(mesh_id: int, n_points: int) -> Any:
        found = by_mesh[mesh_id]
        assert found is not None  # only formats of pairs ask, whose shards have it
        return found(mesh_id, n_points)

    split_of = plan.split_of[records["mesh_id"]]
    splits = np.unique(split_of).tolist()
    return [Content(plan, SPLITS[split], part, records[split_of == split], complete) for split in splits]


def _records_of(plan: Plan, part: int, shards: list[Shard]) -> NDArray[Any]:
    run = part - plan.parts_of(plan.parts[part].group).start
    return in_places(
        plan,
        (read_run(path, plan, sum(size for size, _ in runs[:run]), runs[run]) for path, runs in shards if runs[run][0]),
    )
