"""Rays of one origin as an eye sees them: each has a place in the image of one frame, and a block is sorted by it."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.arrays import IntArray
from zbuf_occlude.exact.bvh import Float32
from zbuf_occlude.exact.layout import CHUNK_POINTS, GROUP
from zbuf_occlude.exact.ray_packets import PACKET_RAYS
from zbuf_occlude.jit.compiler import inlined, inner, njit

BLOCK_RAYS = GROUP * CHUNK_POINTS
"""Rays that a thread takes at a time: a list of clusters is made for them, from which each `CHUNK_POINTS` choose."""

MOST_BITS = 6
"""Of a cell's column and of its row, at most."""

N_FRAMES = 6
LEAST_WIDTH = np.float32(1e-30)


class Places(NamedTuple):
    """The rays of a block, frame by frame, each along a Morton curve of cells; what misses the scene is left out.

    Parameters
    ----------
    coordinates : (2, m) float32
        x / w and y / w. Each frame begins at a multiple of `PACKET_RAYS`, and repeats its last ray up to the next.
    order : (m,) int32
        Which ray of the block that is.
    starts, ends : (6,) int64
        Where each frame begins and ends.
    unsorted : (2 x BLOCK_RAYS,) float32
        x / w and y / w of each ray in turn, as the block has them.
    cells : (BLOCK_RAYS,) int32
    counts : (6 x 2^(2 x MOST_BITS),) int32
    """

    coordinates: Float32
    order: IntArray
    starts: NDArray[np.int64]
    ends: NDArray[np.int64]
    unsorted: Float32
    cells: IntArray
    counts: IntArray


@njit(_nrt=True)
def make_places():
    """Allocate a thread's `Places`."""
    room = BLOCK_RAYS + N_FRAMES * PACKET_RAYS
    return Places(
        coordinates=np.empty((2, room), dtype=np.float32),
        order=np.empty(room, dtype=np.int32),
        starts=np.zeros(N_FRAMES, dtype=np.int64),
        ends=np.zeros(N_FRAMES, dtype=np.int64),
        unsorted=np.empty(2 * BLOCK_RAYS, dtype=np.float32),
        cells=np.empty(BLOCK_RAYS, dtype=np.int32),
        counts=np.empty(N_FRAMES << (2 * MOST_BITS), dtype=np.int32),
    )


@inner
def find_places(axes, window, bits, directions, places):
    """Fill in the places of a block's rays, and their cells.

    Parameters
    ----------
    axes : (f, 3, 3) float64
        Rows x, y, w of each frame: one from outside, six of a cube (`view.Views`).
    window : Window
        What holds the scene in an only frame; the rest of the image shows nothing.
    bits : int
        Of a cell's column and of its row.
    directions : (3 m,) float64
    places : Places
    """
    n = len(directions) // 3
    if len(axes) == 1:
        _place_from_outside(axes[0], directions, places.unsorted[: 2 * n])
        _number_cells(window, bits, places.unsorted[: 2 * n], places.cells[:n])
    else:
        _place_on_cube(directions, bits, places.unsorted[: 2 * n], places.cells[:n])


@inner
def sort_places(n, n_frames, bits, places):
    """Sort the n rays of a block by their cells."""
    cells, counts, size = places.cells[:n], places.counts, 1 << (2 * bits)
    nowhere, present, total = n_frames * size, 0, 0
    for i in range(n):
        present |= 1 << (cells[i] >> (2 * bits))
    for frame in range(n_frames):
        if present >> frame & 1:
            counts[frame * size : (frame + 1) * size] = 0
    for i in range(n):
        if cells[i] < nowhere:
            counts[cells[i]] += 1
    for frame in range(n_frames):
        places.starts[frame] = total
        if present >> frame & 1:
            total = _accumulate(counts[frame * size : (frame + 1) * size], total)
        places.ends[frame] = total
        total = (total + PACKET_RAYS - 1) // PACKET_RAYS * PACKET_RAYS
    x, y = places.coordinates[0], places.coordinates[1]
    _scatter(cells, nowhere, places.unsorted, counts, x, y, places.order)
    for frame in range(n_frames):
        last = places.ends[frame] - 1
        for at in range(last + 1, last + 1 + -(last + 1) % PACKET_RAYS):
            x[at], y[at] = x[last], y[last]


@njit(cache=True, _nrt=True)
def order_of_cells(cells, bits):
    """Return the order of the cells of any number of rays, (n,) uint32; those of one cell stay as they come."""
    starts, order = np.zeros((N_FRAMES << (2 * bits)) + 1, dtype=np.int64), np.empty(len(cells), dtype=np.uint32)
    for cell in cells:
        starts[cell] += 1
    _accumulate(starts, 0)
    for i in range(len(cells)):
        order[starts[cells[i]]] = i
        starts[cells[i]] += 1
    return order


@inner
def _accumulate(counts, total):
    """Turn counts of cells into where each begins; return where the last one ends."""
    for cell in range(len(counts)):
        count = counts[cell]
        counts[cell] = total
        total += count
    return total


@inner
def _scatter(cells, nowhere, unsorted, starts, x, y, order):
    """Write the places and numbers of rays where they go."""
    for i in range(len(cells)):
        if cells[i] >= nowhere:
            continue
        at = starts[cells[i]]
        starts[cells[i]] = at + 1
        x[at], y[at], order[at] = unsorted[2 * i], unsorted[2 * i + 1], i


# The loops below take several rays at a time: they have no branches, and arrays of one axis, whose strides are known.


@njit(error_model="numpy")
def _place_from_outside(axes, directions, coordinates):
    """Find places; infinity for a ray that goes away."""
    for i in range(len(coordinates) // 2):
        x, y, z = directions[3 * i], directions[3 * i + 1], directions[3 * i + 2]
        u = axes[0, 0] * x + axes[0, 1] * y + axes[0, 2] * z
        v = axes[1, 0] * x + axes[1, 1] * y + axes[1, 2] * z
        w = axes[2, 0] * x + axes[2, 1] * y + axes[2, 2] * z
        inverse = 1.0 / w
        coordinates[2 * i], coordinates[2 * i + 1] = (u * inverse if w > 0.0 else np.inf), v * inverse


@njit(error_model="numpy")
def _number_cells(window, bits, coordinates, cells):
    """Number the cells of an only frame, which cover a window; beyond it nothing is met."""
    nowhere, most = np.int32(1 << (2 * bits)), np.float32((1 << bits) - 1)
    across = most / max(window.right - window.left, LEAST_WIDTH)
    upwards = most / max(window.top - window.bottom, LEAST_WIDTH)
    for i in range(len(cells)):
        x, y = coordinates[2 * i], coordinates[2 * i + 1]
        within = (x >= window.left) & (x <= window.right) & (y >= window.bottom) & (y <= window.top)
        cell = _cell_at(np.int32((x - window.left) * across), np.int32((y - window.bottom) * upwards))
        cells[i] = cell if within else nowhere


@njit(error_model="numpy")
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
        cells[i] = frame * n_cells + _cell_at(np.int32(u * half + half), np.int32(v * half + half))


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
