"""Rays of one origin as an eye sees them: each has a place in the image of one frame; they are sorted by it."""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from zbuf_occlude.arrays import FloatArray, IntArray
from zbuf_occlude.image_space.layout import PACKET
from zbuf_occlude.image_space.scene.scene import Float32
from zbuf_occlude.lanes import inlined
from zbuf_occlude.threads import n_threads, shared, take, together

MOST_BITS = 6
"""Of a cell's column and of its row, at most."""

NEAR_RAYS = 2048
"""Rays that go through all loops together, while they are in the cache."""

LEAST_SIZE, MOST_SIZE = 1e-100, 1e100
"""Directions of other sizes go one by one: their products vanish or overflow; float64 is to say what comes of it."""


LEAST_WIDTH = np.float32(1e-30)


class Places(NamedTuple):
    """Rays in the order of their places.

    Parameters
    ----------
    coordinates : (2 n,) float32
        x / w and y / w of each ray in turn, in the caller's order.
    order : (m,) int32
        The rays frame by frame, each along a Morton curve of cells; then those that go one by one. What certainly
        misses the scene is left out.
    starts : (f + 2,) int64
        Where each frame begins, where those begin that go one by one, and the end.
    """

    coordinates: Float32
    order: IntArray
    starts: NDArray[np.int64]


def sort_by_place(
    axes: FloatArray, window: tuple[np.float32, ...], directions: FloatArray, face_ids: IntArray, distances: FloatArray
) -> Places:
    """Find the rays' places, and write "no face" as all their answers.

    Parameters
    ----------
    axes : (f, 3, 3) float64
        Rows x, y, w of each frame: one from outside, six of a cube (`view.Views`).
    window : (left, right, bottom, top), float32
        What holds the scene in an only frame; the rest of the image shows nothing.
    directions : (n, 3) float64
    face_ids, distances : (n,) int32, float64
        Receive -1 and infinity, here, where several threads share the work.
    """
    n, n_frames = len(directions), len(axes)
    bits = min(max((n // PACKET).bit_length() // 2, 1), MOST_BITS)
    n_parts = min(4 * n_threads(), -(-n // 4096))
    cells, coordinates = np.empty(n, dtype=np.int32), np.empty(2 * n, dtype=np.float32)
    counts = np.zeros((n_parts, (n_frames << (2 * bits)) + 2), dtype=np.int32)
    flat = directions.reshape(-1)
    together(_find_cells, n_parts, axes, window, flat, bits, cells, coordinates, counts, face_ids, distances)
    starts = np.empty(n_frames + 2, dtype=np.int64)
    _accumulate(counts, bits, starts)
    order = np.empty(starts[-1], dtype=np.int32)
    together(_scatter, n_parts, cells, counts, order)
    return Places(coordinates, order, starts)


@shared
def _find_cells(tasks, axes, window, directions, bits, cells, coordinates, counts, face_ids, distances):
    """Find the cell of each ray of a part, and count the part's rays of each cell."""
    n, n_parts, nowhere = len(cells), len(counts), np.int32(counts.shape[1] - 1)
    part = take(tasks)
    while part < n_parts:
        end = n * (part + 1) // n_parts
        for first in range(n * part // n_parts, end, NEAR_RAYS):
            last = min(first + NEAR_RAYS, end)
            face_ids[first:last], distances[first:last] = -1, np.inf
            three, two = directions[3 * first : 3 * last], coordinates[2 * first : 2 * last]
            if len(axes) == 1:
                _place_from_outside(axes[0], three, two)
                _number_cells(window, bits, two, cells[first:last])
            else:
                _place_on_cube(three, bits, two, cells[first:last])
            for i in range(first, last):
                if cells[i] != nowhere:
                    counts[part, cells[i]] += 1
        part = take(tasks)


# The loops below take several rays at a time: they have no branches, and arrays of one axis, whose strides are known.


@njit(_nrt=False, error_model="numpy")
def _place_from_outside(axes, directions, coordinates):
    """Find places; infinity for a ray that goes away, no number for one of an odd size."""
    for i in range(len(coordinates) // 2):
        x, y, z = directions[3 * i], directions[3 * i + 1], directions[3 * i + 2]
        size = _largest(abs(x), abs(y), abs(z))
        u = axes[0, 0] * x + axes[0, 1] * y + axes[0, 2] * z
        v = axes[1, 0] * x + axes[1, 1] * y + axes[1, 2] * z
        w = axes[2, 0] * x + axes[2, 1] * y + axes[2, 2] * z
        inverse = 1.0 / w
        u, v = (u * inverse if w > 0.0 else np.inf), v * inverse
        coordinates[2 * i] = u if (size > LEAST_SIZE) & (size < MOST_SIZE) else np.nan
        coordinates[2 * i + 1] = v


@njit(_nrt=False, error_model="numpy")
def _number_cells(window, bits, coordinates, cells):
    """Number the cells of an only frame, which cover a window; beyond it nothing is met."""
    nowhere, most = np.int32((1 << (2 * bits)) + 1), np.float32((1 << bits) - 1)
    left, right, bottom, top = window
    across, upwards = most / max(right - left, LEAST_WIDTH), most / max(top - bottom, LEAST_WIDTH)
    for i in range(len(cells)):
        x, y = coordinates[2 * i], coordinates[2 * i + 1]
        within = (x >= left) & (x <= right) & (y >= bottom) & (y <= top)
        cell = _cell_at(np.int32((x - left) * across), np.int32((y - bottom) * upwards))
        cells[i] = cell if within else nowhere - np.int32((x != x) | (y != y))


@njit(_nrt=False, error_model="numpy")
def _place_on_cube(directions, bits, coordinates, cells):
    n_cells, half = np.int32(1 << (2 * bits)), 0.5 * ((1 << bits) - 1)
    for i in range(len(cells)):
        x, y, z = directions[3 * i], directions[3 * i + 1], directions[3 * i + 2]
        size = _largest(abs(x), abs(y), abs(z))
        first, second = abs(x) == size, abs(y) == size
        w = x if first else (y if second else z)
        u = y if first else (z if second else x)
        v = z if first else (x if second else y)
        inverse, behind = 1.0 / size, w < 0.0
        u, v = (v if behind else u) * inverse, (u if behind else v) * inverse
        coordinates[2 * i], coordinates[2 * i + 1] = u, v
        frame = np.int32(0 if first else (2 if second else 4)) + np.int32(behind)
        cell = frame * n_cells + _cell_at(np.int32(u * half + half), np.int32(v * half + half))
        cells[i] = cell if (size > LEAST_SIZE) & (size < MOST_SIZE) else np.int32(6) * n_cells


@inlined
def _largest(a, b, c):
    larger = a if a > b else b
    return larger if larger > c else c


@inlined
def _cell_at(column, row):
    """Number of a cell along a Morton curve."""
    return _spread_bits(column) | (_spread_bits(row) << np.int32(1))


@inlined
def _spread_bits(i):
    """The `MOST_BITS` bits of a number with gaps between them."""
    i = (i | (i << np.int32(4))) & np.int32(0x30F)
    i = (i | (i << np.int32(2))) & np.int32(0x333)
    return (i | (i << np.int32(1))) & np.int32(0x555)


@njit(nogil=True, cache=True)
def _accumulate(counts, bits, starts):
    """Turn counts into where each part's rays of each cell go; those of the last cell go nowhere."""
    total, last = 0, counts.shape[1] - 1
    for cell in range(last):
        if cell & ((1 << (2 * bits)) - 1) == 0:
            starts[cell >> (2 * bits)] = total
        for part in range(len(counts)):
            count = counts[part, cell]
            counts[part, cell] = total
            total += count
    starts[-1] = total


@shared
def _scatter(tasks, cells, starts, order):
    """Write the number of each ray of a part where it goes."""
    n, n_parts, nowhere = len(cells), len(starts), starts.shape[1] - 1
    part = take(tasks)
    while part < n_parts:
        for i in range(n * part // n_parts, n * (part + 1) // n_parts):
            cell = cells[i]
            if cell != nowhere:
                order[starts[part, cell]] = i
                starts[part, cell] += 1
        part = take(tasks)
