"""Rays of one origin as an eye sees them: each has a place in the image of one frame; they are sorted by it."""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from zbuf_occlude.arrays import FloatArray, IntArray
from zbuf_occlude.image_space.layout import PACKET
from zbuf_occlude.image_space.scene.scene import Float32
from zbuf_occlude.lanes import inner
from zbuf_occlude.threads import n_threads, shared, take, together

MOST_BITS = 6
"""Of a cell's column and of its row, at most."""

LEAST_SIZE, MOST_SIZE = 1e-100, 1e100
"""Directions of other sizes go one by one: their products vanish or overflow; float64 is to say what comes of it."""


LEAST_WIDTH = 1e-30

SPREAD = np.array(
    [sum((i >> bit & 1) << (2 * bit) for bit in range(MOST_BITS)) for i in range(1 << MOST_BITS)], np.int32
)
"""The bits of a number with gaps between them."""


class Places(NamedTuple):
    """Rays in the order of their places.

    Parameters
    ----------
    coordinates : (n, 2) float32
        x / w and y / w of each ray, in the caller's order.
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
    axes: FloatArray, window: tuple[float, ...], directions: FloatArray, face_ids: IntArray, distances: FloatArray
) -> Places:
    """Find the rays' places, and write "no face" as all their answers.

    Parameters
    ----------
    axes : (f, 3, 3) float64
        Rows x, y, w of each frame: one from outside, six of a cube (`view.Views`).
    window : (left, right, bottom, top)
        What holds the scene in an only frame; the rest of the image shows nothing.
    directions : (n, 3) float64
    face_ids, distances : (n,) int32, float64
        Receive -1 and infinity, here, where several threads share the work.
    """
    n, n_frames = len(directions), len(axes)
    bits = min(max((n // PACKET).bit_length() // 2, 1), MOST_BITS)
    n_parts = min(4 * n_threads(), -(-n // 4096))
    cells, coordinates = np.empty(n, dtype=np.int32), np.empty((n, 2), dtype=np.float32)
    counts = np.zeros((n_parts, (n_frames << (2 * bits)) + 2), dtype=np.int32)
    together(_find_cells, n_parts, axes, window, directions, bits, cells, coordinates, counts, face_ids, distances)
    starts = np.empty(n_frames + 2, dtype=np.int64)
    _accumulate(counts, bits, starts)
    order = np.empty(starts[-1], dtype=np.int32)
    together(_scatter, n_parts, cells, counts, order)
    return Places(coordinates, order, starts)


@shared
def _find_cells(tasks, axes, window, directions, bits, cells, coordinates, counts, face_ids, distances):
    """Find the cell of each ray of a part, and count the part's rays of each cell."""
    n, n_parts = len(directions), len(counts)
    part = take(tasks)
    while part < n_parts:
        first, last = n * part // n_parts, n * (part + 1) // n_parts
        face_ids[first:last], distances[first:last] = -1, np.inf
        if len(axes) == 1:
            _place_from_outside(axes[0], directions[first:last], coordinates[first:last])
            _number_cells(window, bits, coordinates[first:last], cells[first:last])
        else:
            _place_on_cube(directions[first:last], bits, coordinates[first:last], cells[first:last])
        for i in range(first, last):
            counts[part, cells[i]] += 1
        part = take(tasks)


@njit(_nrt=False, error_model="numpy")
def _place_from_outside(axes, directions, coordinates):
    """Find places; infinity for a ray that goes away, no number for one of an odd size."""
    for i in range(len(directions)):  # without branches, so that several rays are done at a time
        x, y, z = directions[i, 0], directions[i, 1], directions[i, 2]
        size = max(abs(x), abs(y), abs(z))
        u = axes[0, 0] * x + axes[0, 1] * y + axes[0, 2] * z
        v = axes[1, 0] * x + axes[1, 1] * y + axes[1, 2] * z
        w = axes[2, 0] * x + axes[2, 1] * y + axes[2, 2] * z
        inverse = 1.0 / w
        u, v = (u * inverse if w > 0.0 else np.inf), v * inverse
        coordinates[i, 0] = u if (size > LEAST_SIZE) & (size < MOST_SIZE) else np.nan
        coordinates[i, 1] = v


@inner
def _number_cells(window, bits, coordinates, cells):
    """Number the cells of an only frame, which cover a window; beyond it nothing is met."""
    nowhere, most = (1 << (2 * bits)) + 1, (1 << bits) - 1
    left, right, bottom, top = window
    across, upwards = most / max(right - left, LEAST_WIDTH), most / max(top - bottom, LEAST_WIDTH)
    for i in range(len(cells)):
        x, y = coordinates[i, 0], coordinates[i, 1]
        if (x >= left) & (x <= right) & (y >= bottom) & (y <= top):
            cells[i] = SPREAD[np.int32((x - left) * across)] | (SPREAD[np.int32((y - bottom) * upwards)] << 1)
        else:
            cells[i] = nowhere - (x != x or y != y)


@inner
def _place_on_cube(directions, bits, coordinates, cells):
    n_cells, half = 1 << (2 * bits), 0.5 * ((1 << bits) - 1)
    for i in range(len(directions)):
        d = directions[i]
        x, y, z = abs(d[0]), abs(d[1]), abs(d[2])
        size = max(x, y, z)
        axis = 0 if size == x else (1 if size == y else 2)
        inverse = 1.0 / size
        u, v = d[(axis + 1) % 3] * inverse, d[(axis + 2) % 3] * inverse
        behind = d[axis] < 0.0
        if behind:
            u, v = v, u
        coordinates[i, 0], coordinates[i, 1] = u, v
        if LEAST_SIZE < size < MOST_SIZE:
            cell = SPREAD[np.int32(u * half + half)] | (SPREAD[np.int32(v * half + half)] << 1)
            cells[i] = (2 * axis + behind) * n_cells + cell
        else:
            cells[i] = 6 * n_cells


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
