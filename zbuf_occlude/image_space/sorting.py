"""The order in which kernels take points: by own face, and along a Morton curve where a face has many."""

import numpy as np
from numba import get_num_threads, njit, prange

from zbuf_occlude.arrays import FloatArray, IntArray
from zbuf_occlude.threads import threaded

MANY = 64
"""With more points on a face than this they are sorted along a curve; fewer fill some packets that are no larger."""

BITS = 9
"""Bits per axis of the Morton codes of points: cells of 1/512 of the scene; what shares a cell keeps its order."""

MOST_PARTS = 16
"""Parts into which the points are cut to be counted and moved side by side."""


def sort_points(
    positions: FloatArray, face_ids: IntArray, rows: IntArray, n_rows: int, centre: FloatArray, scale: float
) -> tuple[IntArray, IntArray]:
    """Sort points by own row, then along a Morton curve through the cube about the scene; stable.

    Parameters
    ----------
    positions, face_ids : (n, 3) float64, world space, and (n,) int32
    rows : (f + 1,) int32
        The row of each face, less than `n_rows`; -1 for none.
    n_rows : int
    centre, scale : (3,) float64 and float
        The scene's.

    Returns
    -------
    order : (n,) int32
    starts : (n_rows + 1,) int32
        Where in `order` each row's points begin; those without a row come before.

    Notes
    -----
    O(n + n_rows) time. The same order for any number of threads.
    """
    n_parts = 1 if len(positions) < n_rows else min(get_num_threads(), MOST_PARTS)
    return _sort(positions, face_ids, rows, n_rows, centre, scale, n_parts)


@threaded
def _sort(
    positions: FloatArray,
    face_ids: IntArray,
    rows: IntArray,
    n_rows: int,
    centre: FloatArray,
    scale: float,
    n_parts: int,
) -> tuple[IntArray, IntArray]:
    n = len(positions)
    counts = np.zeros((n_parts, n_rows + 1), dtype=np.int32)
    for part in prange(n_parts):
        for i in range(n * part // n_parts, n * (part + 1) // n_parts):
            counts[part, rows[face_ids[i]] + 1] += 1
    starts, total = np.empty(n_rows + 2, dtype=np.int32), 0
    for row in range(n_rows + 1):
        starts[row] = total
        for part in range(n_parts):
            count = counts[part, row]
            counts[part, row] = total
            total += count
    starts[n_rows + 1] = total
    order = np.empty(n, dtype=np.int32)
    for part in prange(n_parts):
        for i in range(n * part // n_parts, n * (part + 1) // n_parts):
            row = rows[face_ids[i]] + 1
            order[counts[part, row]] = i
            counts[part, row] += 1
    for row in prange(n_rows + 1):
        if starts[row + 1] - starts[row] > MANY:
            _sort_along_curve(positions, order, starts[row], starts[row + 1], centre, scale)
    return order, starts[1:]


@njit
def _sort_along_curve(positions, order, first, last, centre, scale):  # type: ignore[no-untyped-def]
    """Sort part of the order by Morton code, the lowest digits first."""
    n = last - first
    codes, other_codes = np.empty(n, dtype=np.uint32), np.empty(n, dtype=np.uint32)
    ids, other_ids = order[first:last].copy(), np.empty(n, dtype=np.int32)
    for i in range(n):
        codes[i] = _morton_code(positions, ids[i], centre, scale)
    starts = np.empty((1 << BITS) + 1, dtype=np.int64)
    mask = np.uint32((1 << BITS) - 1)
    for digit in range(3):
        shift = np.uint32(digit * BITS)
        starts[:] = 0
        for i in range(n):
            starts[np.int64((codes[i] >> shift) & mask) + 1] += 1
        for i in range(1 << BITS):
            starts[i + 1] += starts[i]
        for i in range(n):
            place = np.int64((codes[i] >> shift) & mask)
            to = starts[place]
            starts[place] = to + 1
            other_ids[to], other_codes[to] = ids[i], codes[i]
        ids, other_ids = other_ids, ids
        codes, other_codes = other_codes, codes
    order[first:last] = ids


@njit
def _morton_code(positions, i, centre, scale):  # type: ignore[no-untyped-def]
    code = np.uint32(0)
    for axis in range(3):
        cell = ((positions[i, axis] - centre[axis]) * scale + 1.0) * 2.0 ** (BITS - 1)
        bits = np.uint32(min(max(cell, 0.0), 2.0**BITS - 1.0))
        bits = (bits | (bits << np.uint32(16))) & np.uint32(0x030000FF)
        bits = (bits | (bits << np.uint32(8))) & np.uint32(0x0300F00F)
        bits = (bits | (bits << np.uint32(4))) & np.uint32(0x030C30C3)
        bits = (bits | (bits << np.uint32(2))) & np.uint32(0x09249249)
        code |= bits << np.uint32(axis)
    return code
