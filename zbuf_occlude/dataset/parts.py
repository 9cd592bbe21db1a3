"""Final files, part by part: each of the clouds that its group's shards keep for it; then the shards give those up.

The parts of a group are written from the last to the first. A shard keeps its clouds in the order of the parts, so what
is no longer needed of it is always its end, and is cut off as soon as the part's file and its mark are on the disk.
"""

import os
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from numpy.typing import NDArray

from zbuf_occlude.dataset.folder import SHARDS, checksums, sha256_of
from zbuf_occlude.dataset.formats import find_format
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.dataset.records import Run, in_places, read_run
from zbuf_occlude.dataset.sealed import read_sealed, write_sealed
from zbuf_occlude.dataset.shard import data_path, look_at, source_of_shards
from zbuf_occlude.errors import DatasetError


@dataclass(frozen=True)
class Mark:
    """What is known of a part that is written; of a layout that is written whole, of all.

    Parameters
    ----------
    fingerprint : str
        Of its plan.
    files : mapping of split to list of file names
    n_clouds : mapping of split to int
    sha256 : mapping of file name to checksum
    sizes : mapping of file name to bytes
    """

    fingerprint: str
    files: Mapping[str, list[str]]
    n_clouds: Mapping[str, int]
    sha256: Mapping[str, str]
    sizes: Mapping[str, int]


def n_parts(plan: Plan) -> int:
    """Return how many parts there are to write: 1 of a layout that is written whole, 0 where shards are the files."""
    row = find_format(plan.format)
    return 0 if row.all_points else len(plan.parts) if row.in_parts else 1


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
    mark, fault = read_sealed(mark_path(out, part), plan, lambda document: Mark(**document))
    if mark is None:
        return None, fault
    for name, size in mark.sizes.items():
        path = out / name
        if not path.is_file() or path.stat().st_size != size:
            return None, f"its {name} is {'damaged' if path.is_file() else 'missing'}"
    return mark, ""


def runs_left(plan: Plan, group: int, written: Collection[int]) -> int | None:
    """Return how many runs of each of a group's shards are still needed, given the parts written; None: all of it."""
    if not find_format(plan.format).in_parts:
        return 0 if n_parts(plan) and 0 in written else None
    parts = plan.parts_of(group)
    return max((part + 1 - parts.start for part in parts if part not in written), default=0)


class Shard(NamedTuple):
    """The data of a finished shard, and the runs that they were made of."""

    path: Path
    runs: list[Run]


def shards_of(plan: Plan, out: Path, group: int) -> list[Shard]:
    """Return the finished shards of a group, whatever is left of them.

    Raises
    ------
    DatasetError
        One is not finished.
    """
    found = []
    for shard in plan.shards_of[group]:
        sidecar, fault = look_at(plan, out, shard, n_runs=0)
        if sidecar is None:
            raise DatasetError(f"{out}: shard {shard} must be done; it is not{fault and f': {fault}'}.")
        found.append(Shard(data_path(plan, out, shard), sidecar.runs))
    return found


def write_whole(plan: Plan, out: Path) -> None:
    """Write all files of a layout that is not written in parts, then the mark, from all shards."""
    row = find_format(plan.format)
    files = row.write(source_of_shards(plan, [data_path(plan, out, i) for i in range(len(plan.shards))]), out)
    n_clouds = row.load().read(out, plan, files).n_clouds
    names = {name for of_split in files.values() for name in of_split}
    _write_mark(out, 0, Mark(plan.fingerprint, files, n_clouds, checksums(out, files), _sizes(out, names)))


def write_part(plan: Plan, out: Path, part: int, shards: list[Shard]) -> None:
    """Write a part, then its mark, and cut off of its group's shards what is no longer needed.

    Raises
    ------
    DatasetError
        A shard is missing or damaged.
    """
    group, split, number = plan.parts[part]
    try:
        records = _records_of(plan, part, shards)
    except DatasetError:
        if look_at_part(plan, out, part)[0] is None:
            raise
        return  # another run of the same command has written it, and cut the shards
    written = find_format(plan.format).load().write_part(records, out, plan, split, number) if len(records) else []
    digests = {name: sha256_of(out / name) for name in written}
    mark = Mark(plan.fingerprint, {split: written}, {split: len(records)}, digests, _sizes(out, written))
    _write_mark(out, part, mark)
    trim(plan, out, group, shards)


def trim(plan: Plan, out: Path, group: int, shards: list[Shard]) -> None:
    """Cut off the shards of a group what files hold that are written."""
    n_runs = runs_left(plan, group, [part for part in plan.parts_of(group) if mark_path(out, part).exists()])
    assert n_runs is not None  # written in parts
    for path, runs in shards:
        n_bytes = sum(size for size, _ in runs[:n_runs])
        try:
            if not n_bytes:
                path.unlink()
            elif path.stat().st_size > n_bytes:
                os.truncate(path, n_bytes)
        except FileNotFoundError:
            continue  # cut off whole before, here or by another worker


def _write_mark(out: Path, part: int, mark: Mark) -> None:
    write_sealed(mark_path(out, part), mark.__dict__)


def _sizes(out: Path, names: Collection[str]) -> dict[str, int]:
    return {name: (out / name).stat().st_size for name in sorted(names)}


def _records_of(plan: Plan, part: int, shards: list[Shard]) -> NDArray[Any]:
    run = part - plan.parts_of(plan.parts[part].group).start
    return in_places(
        plan,
        (read_run(path, plan, sum(size for size, _ in runs[:run]), runs[run]) for path, runs in shards if runs[run][0]),
    )
