"""Clouds of unequal size (`--sample-size all`): records whose fields per point are arrays of their own; their files.

In memory a field that has a row per point is of objects: ``records["data"][i]`` is (n_i, 3). In files the points of all
clouds stand one after the other, and ``offsets`` (n + 1,) says where each cloud's begin and end.
"""

import os
from itertools import pairwise
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zbuf_occlude.dataset.clouds import point_fields, record_type
from zbuf_occlude.dataset.plan import Recipe

OFFSETS = "offsets"
Records = NDArray[Any]


def facts_type(recipe: Recipe) -> np.dtype[Any]:
    """Return what of a record has one row per cloud."""
    whole, points = record_type(recipe), point_fields(recipe)
    return np.dtype([(name, whole[name]) for name in whole.names or () if name not in points])


def points_type(recipe: Recipe) -> np.dtype[Any]:
    """Return a row per point: all fields that have one."""
    return np.dtype([(name, kind, shape) for name, (kind, shape) in point_fields(recipe).items()])


def offsets_of(records: Records) -> NDArray[np.int64]:
    """Return where the points of each cloud begin, and behind the last where they end, (n + 1,)."""
    return np.cumsum([0, *map(len, records["data"])], dtype=np.int64)


def laid_out(records: Records, recipe: Recipe) -> dict[str, NDArray[Any]]:
    """Return the arrays that a file holds: a field each; of ragged clouds all points in a row, and `OFFSETS`."""
    fields = {name: records[name] for name in records.dtype.names or ()}
    if recipe.sample_size is not None:
        return {name: np.ascontiguousarray(values) for name, values in fields.items()}
    kinds = point_fields(recipe)
    for name, (kind, shape) in kinds.items():
        fields[name] = np.concatenate([np.empty((0, *shape), kind), *records[name]]).astype(kind, copy=False)
    return {**{name: np.ascontiguousarray(values) for name, values in fields.items()}, OFFSETS: offsets_of(records)}


def taken(arrays: Any, rows: ArrayLike, recipe: Recipe) -> Records:
    """Return the records of some rows of what `laid_out` returned.

    Parameters
    ----------
    arrays : mapping of name to what can be sliced
        NumPy's arrays or HDF5's.
    rows : (m,) int
    recipe : Recipe

    Raises
    ------
    ValueError
        Offsets that do not fit the points.
    """
    chosen, points = np.asarray(rows), point_fields(recipe)
    ascending, back = np.unique(chosen, return_inverse=True)  # as h5py wants them
    records: Records = np.empty(len(ascending), record_type(recipe))
    if recipe.sample_size is not None:
        for name in records.dtype.names or ():
            records[name] = arrays[name][ascending]
        return records[back]
    offsets = np.asarray(arrays[OFFSETS])
    if len(offsets) != len(arrays["label"]) + 1 or (np.diff(offsets) < 1).any() or offsets[-1] > len(arrays["data"]):
        raise ValueError("offsets do not fit the points")
    for name in records.dtype.names or ():
        if name not in points:
            records[name] = arrays[name][ascending]
            continue
        for row, number in enumerate(ascending):
            records[name][row] = np.asarray(arrays[name][offsets[number] : offsets[number + 1]], points[name][0])
    return records[back]


def filled(positions: NDArray[Any], n_points: int) -> NDArray[Any]:
    """Return the first so many of a cloud's points, whose order is random; of fewer all, and some again."""
    return np.asarray(positions[np.arange(n_points) % len(positions)])


def all_finite(positions: NDArray[Any]) -> bool:
    """Whether all positions are finite, of clouds of equal size or not."""
    return all(bool(np.isfinite(each).all()) for each in ([positions] if positions.dtype != object else positions))


def save(file: IO[bytes], records: Records, recipe: Recipe) -> None:
    """Write a shard of ragged records: NumPy's arrays of offsets, of facts and of points, one behind the other."""
    facts: Records = np.empty(len(records), facts_type(recipe))
    for name in facts.dtype.names or ():
        facts[name] = records[name]
    offsets = offsets_of(records)
    points: Records = np.empty(int(offsets[-1]), points_type(recipe))
    for name in points.dtype.names or ():
        for row, (begin, end) in enumerate(pairwise(offsets)):
            points[name][begin:end] = records[name][row]
    for array in (offsets, facts, points):
        np.save(file, array)


class MappedShard:
    """A shard that `save` wrote, mapped: memory is needed for what is taken only.

    Raises
    ------
    ValueError, OSError
        The file is damaged, or of another recipe.
    """

    def __init__(self, path: Path, recipe: Recipe) -> None:
        self._recipe = recipe
        self._offsets, self.facts, self._points = _mapped(path, 3)
        if self.facts.dtype != facts_type(recipe) or self._points.dtype != points_type(recipe):
            raise ValueError(f"fields {self.facts.dtype}")
        if len(self._offsets) != len(self.facts) + 1 or self._offsets[-1] != len(self._points):
            raise ValueError("offsets do not fit the points")

    def __len__(self) -> int:
        return len(self.facts)

    def __getitem__(self, rows: Any) -> Any:
        """Return a field of all clouds by its name, or the records of some rows."""
        if isinstance(rows, str):
            return self.facts[rows]
        chosen = np.asarray(rows)
        records: Records = np.empty(len(chosen), record_type(self._recipe))
        for name in self.facts.dtype.names or ():
            records[name] = self.facts[name][chosen]
        for row, number in enumerate(chosen):
            mine = self._points[self._offsets[number] : self._offsets[number + 1]]
            for name in self._points.dtype.names or ():
                records[name][row] = np.array(mine[name])
        return records


def _mapped(path: Path, n_arrays: int) -> list[NDArray[Any]]:
    """Map arrays that were saved one behind the other."""
    found: list[NDArray[Any]] = []
    with path.open("rb") as file:
        for _ in range(n_arrays):
            if np.lib.format.read_magic(file) != (1, 0):
                raise ValueError("another version of NumPy's format")
            shape, _, kind = np.lib.format.read_array_header_1_0(file)
            size = int(np.prod(shape)) * kind.itemsize
            empty = size == 0  # which cannot be mapped
            found.append(np.empty(shape, kind) if empty else np.memmap(path, kind, "r", file.tell(), shape))
            file.seek(size, os.SEEK_CUR)
    return found
