"""Reader of the layouts of point cloud completion: their partial and complete clouds as records, z up again."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.base.arrays import FloatArray
from zbuf_occlude.base.atomic import reading
from zbuf_occlude.base.point_files import read_pcd_positions
from zbuf_occlude.datasets.formats import find_format
from zbuf_occlude.datasets.plan import Numbers, Plan
from zbuf_occlude.datasets.records import IDS, Records, pad_or_truncate
from zbuf_occlude.datasets.source import CloudReader


class CloudPlace(NamedTuple):
    """The place of a cloud: a file, and in HDF5 an array and its row."""

    path: Path
    array: str = "data"
    row: int | slice = slice(None)

    def read(self) -> NDArray[Any]:
        """Return the positions (n, 3)."""
        with reading(self.path):
            if self.path.suffix == ".pcd":
                return read_pcd_positions(self.path)
            if self.path.suffix == ".npy":
                return np.asarray(np.load(self.path))
            with h5py.File(self.path) as h5:
                return np.asarray(h5[self.array][self.row])


def read_files_of_pairs(out: Path, plan: Plan, files: Mapping[str, list[str]]) -> CloudReader:
    """Return the clouds of a layout with a file per cloud: of each object the complete one, then its partial ones."""
    fields = _fields_by_split(out, files)
    partials, wholes = list[CloudPlace](), list[CloudPlace]()
    for split, (*names, _) in files.items():
        n_views = len(fields[split]) // max(1, len(names) - len(fields[split]))
        for first in range(0, len(names), 1 + n_views):
            whole, *views = (CloudPlace(out / name) for name in names[first : first + 1 + n_views])
            partials += views
            wholes += [whole] * len(views)
    return _reader(plan, fields, partials, wholes)


def read_mvp(out: Path, plan: Plan, files: Mapping[str, list[str]]) -> CloudReader:
    """Return the clouds of MVP's layout, in which a complete cloud is a row for all views of an object."""
    fields, n_views = _fields_by_split(out, files), len(plan.views)
    rows = [(out / files[split][0], row) for split in files for row in range(len(fields[split]))]
    partials = [CloudPlace(path, "incomplete_pcds", row) for path, row in rows]
    wholes = [CloudPlace(path, "complete_pcds", row // n_views) for path, row in rows]
    return _reader(plan, fields, partials, wholes)


def _fields_by_split(out: Path, files: Mapping[str, list[str]]) -> dict[str, NDArray[Any]]:
    """Return what the records of each split hold besides points."""
    found = {}
    for split in files:
        path = out / f"clouds_{split}.npy"
        with reading(path):
            found[split] = np.asarray(np.load(path))
    return found


def _reader(
    plan: Plan, fields_of: Mapping[str, NDArray[Any]], partials: Sequence[CloudPlace], wholes: Sequence[CloudPlace]
) -> CloudReader:
    """Return the reader of partial clouds, and the complete one of each, numbered in the order of the fields."""
    fields, end, order = np.concatenate(list(fields_of.values())), 0, dict[str, Numbers]()
    for split, of_split in fields_of.items():
        order[split] = np.arange(end, end := end + len(of_split))
    to_frame = find_format(plan.format).to_frame(plan.config).astype(np.float64)
    longest, size = float(np.linalg.norm(to_frame[0])), plan.config.sample_size
    number_of = {ids: number for number, ids in enumerate(fields[list(IDS.names or ())].tolist())}

    def records_of(numbers: Numbers, clouds: Sequence[FloatArray], size: int | None) -> Records:
        data = ("data", object) if size is None else ("data", "<f4", (size, 3))
        records: Records = np.empty(len(numbers), [data, *fields.dtype.descr])
        for name in fields.dtype.names or ():
            records[name] = fields[name][numbers]
        records["factor"] /= longest
        if "normal" in (fields.dtype.names or ()):
            records["normal"] = records["normal"] @ (to_frame / longest)
        for row, cloud in enumerate(clouds):
            records["data"][row] = (cloud @ to_frame / longest**2).astype(np.float32)
        return records

    def take(numbers: Numbers) -> Records:
        return records_of(numbers, [partials[number].read() for number in numbers.tolist()], size)

    def complete(partial: Any, n_points: int) -> Any:
        number = number_of[tuple(int(partial[name]) for name in IDS.names or ())]
        cloud = pad_or_truncate(wholes[number].read(), n_points)
        return records_of(np.array([number]), [cloud], n_points)[0]

    return CloudReader(plan, order, take, complete=complete)
