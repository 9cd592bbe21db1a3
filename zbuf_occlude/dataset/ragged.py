"""Clouds of unequal size (`--sample-size all`): records whose fields per point are arrays of their own; their files.

In memory a field that has a row per point is of objects: ``records["data"][i]`` is (n_i, 3). In files the points of all
clouds stand one after the other, and ``offsets`` (n + 1,) says where each cloud's begin and end.
"""

from itertools import pairwise
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
    """Return the arrays that a file holds: a field each; of ragged clouds all points in a row, and `OFFSETS`.

    Fields are where the records have them, not side by side in memory: so nothing is there twice.
    """
    fields = {name: records[name] for name in records.dtype.names or ()}
    if recipe.sample_size is not None:
        return fields
    kinds = point_fields(recipe)
    for name, (kind, shape) in kinds.items():
        fields[name] = np.concatenate([np.empty((0, *shape), kind), *records[name]]).astype(kind, copy=False)
    return {**fields, OFFSETS: offsets_of(records)}


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
        in_a_row = len(ascending) > 0 and ascending[-1] - ascending[0] + 1 == len(ascending)
        wanted = slice(ascending[0], ascending[-1] + 1) if in_a_row else ascending  # h5py reads a slice at once
        for name in records.dtype.names or ():
            records[name] = arrays[name][wanted]
        return records if np.array_equal(chosen, ascending) else records[back]
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
    """Return the first this many of a cloud's points, whose order is random; of fewer all, and some again."""
    return np.asarray(positions[np.arange(n_points) % len(positions)])


def all_finite(positions: NDArray[Any]) -> bool:
    """Whether all positions are finite, of clouds of equal size or not."""
    return all(bool(np.isfinite(each).all()) for each in ([positions] if positions.dtype != object else positions))


def save(file: IO[bytes], records: Records, recipe: Recipe) -> None:
    """Write some ragged records: NumPy's arrays of offsets, of facts and of points, one behind the other."""
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


def load(file: IO[bytes], recipe: Recipe) -> Records:
    """Read what `save` wrote.

    Raises
    ------
    ValueError
        It is of another recipe.
    """
    offsets, facts, points = (np.load(file) for _ in range(3))
    if facts.dtype != facts_type(recipe) or points.dtype != points_type(recipe):
        raise ValueError(f"fields {facts.dtype}")
    records: Records = np.empty(len(facts), record_type(recipe))
    for name in facts.dtype.names or ():
        records[name] = facts[name]
    for name in points.dtype.names or ():
        for row, (begin, end) in enumerate(pairwise(offsets)):
            records[name][row] = points[name][begin:end].copy()
    return records
