"""Hidden-surface removal with an occupancy grid (paper 3.6, third suggestion)."""

import math
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from zbuf_occlude.base.arrays import BoolArray, FloatArray, IntArray
from zbuf_occlude.base.jit.threads import allocating_kernel, n_blocks, parallel_for, take_block

TOUCHING = 1
"""Default distance, in cells along the farthest axis, up to which cells are of one surface: they touch."""

RUN = 3
"""Default distance, in cells, up to which an unbroken run of occupied cells is of the same surface as its start."""

SNAP = 2.0**20
"""Parts of a cell to which positions are rounded, so that rounding errors of a scale do not decide ties."""

BLOCK = 256
"""Lines of sight per block of a thread."""


class OccupancyGrid:
    """Grid of n x n x n cubic cells about an object, and the cells that its points occupy.

    Parameters
    ----------
    bounds : (2, 3) float
        Lower and upper corner of the object's bounding box, world space. The grid is the cube about its centre with the
        box's longest side.
    n : int
        Cells along a side.
    positions : (s, 3) float
        Points of the object's surface; the cells that contain them are occupied.
    touching, run : int
        Extent of a cell's own surface, which does not occlude it: occupied cells up to `touching` cells away, and those
        up to `run` cells away that the line of sight reaches through occupied cells only.

    Notes
    -----
    **When does a cell occlude a cell?** The paper does not define it. Here it does if it is occupied, the line from the
    other cell's centre to the eye passes through it, and it is not of the other cell's own surface. The eye's cell
    occludes nothing.

    Without an own surface an object would hide its own front, since a surface's cells touch each other and a slanted
    line passes through several of them. With the defaults, a front seen at more than 40 degrees from its plane stays
    whole, and one seen at a grazing angle is partly lost. A larger own surface keeps more of the front and loses more
    of the occluders; docs/object_space.md lists measured choices.

    A line costs at most 3 n steps, and there are at most as many lines as occupied cells.

    References
    ----------
    Paper 3.6: "searching for the occluded cells instead of searching for the occluded points, and finally, all points
    belonging to an occluded cell are also considered occluded". The traversal is that of Amanatides and Woo (1987).
    """

    def __init__(
        self, bounds: FloatArray, n: int, positions: FloatArray, *, touching: int = TOUCHING, run: int = RUN
    ) -> None:
        self.n = n
        self._own = touching, max(touching, run)
        side = float(np.ptp(bounds, axis=0).max())
        self._cell = side / n if side > 0.0 else 1.0
        self._lowest = (bounds[0] + bounds[1]) / 2.0 - self._cell * n / 2.0
        self.occupied: BoolArray = np.zeros((n, n, n), dtype=bool)
        self.occupied[tuple(self.cells_of(positions).T)] = True

    def cells_of(self, positions: FloatArray) -> IntArray:
        """Return the cells of positions (world space, in the grid), (s, 3) int32."""
        return np.clip(np.floor(self._in_cells(positions)), 0, self.n - 1).astype(np.int32)

    def distinct_cells(self, positions: FloatArray) -> tuple[IntArray, NDArray[np.intp]]:
        """Return the distinct cells of positions (world space), (c, 3), and the index of each position's cell, (s,).

        O(s + n^3): the cells are marked, not sorted. Positions outside the grid count as in the nearest cell.
        """
        numbers = np.ravel_multi_index(tuple(self.cells_of(positions).T), self.occupied.shape)
        marked = np.zeros(self.occupied.size, dtype=bool)
        marked[numbers] = True
        distinct = np.flatnonzero(marked)
        ranks = np.empty(self.occupied.size, dtype=np.int32)
        ranks[distinct] = np.arange(len(distinct))
        cells = np.stack(np.unravel_index(distinct, self.occupied.shape), axis=1).astype(np.int32)
        return cells, ranks[numbers].astype(np.intp)

    def contains(self, positions: FloatArray) -> BoolArray:
        """Return whether positions (world space) lie in the grid, including its border, (s,) bool."""
        coordinates = self._in_cells(positions)
        return np.asarray(((coordinates >= 0.0) & (coordinates <= self.n)).all(axis=1))

    def occluded_cells(self, cells: IntArray, eye: FloatArray) -> BoolArray:
        """Return whether the line of sight from cells (c, 3) to an eye (world space) is blocked, (c,) bool."""
        return _are_blocked(self.occupied, cells + 0.5, self._in_cells(eye), *self._own)

    def occluded_positions(self, positions: FloatArray, eye: FloatArray) -> BoolArray:
        """Return whether the line of sight from positions outside the grid (world space) is blocked, (c,) bool."""
        return _are_blocked(self.occupied, self._in_cells(positions), self._in_cells(eye), *self._own)

    def _in_cells(self, positions: FloatArray) -> FloatArray:
        return np.asarray(np.round((positions - self._lowest) / self._cell * SNAP) / SNAP)


def _are_blocked(
    occupied: BoolArray, starts: NDArray[np.floating[Any]], eye: FloatArray, touching: int, run: int
) -> BoolArray:
    """Return whether each line from one of the starts, (c, 3), to an eye is blocked, (c,); all in cells."""
    blocked = np.zeros(len(starts), dtype=np.bool_)
    parallel_for(_fill_blocked, n_blocks(len(starts), BLOCK), occupied, starts, eye, touching, run, blocked)
    return blocked


@allocating_kernel
def _fill_blocked(tasks, occupied, starts, eye, touching, run, blocked):
    """Test blocks of lines."""
    first, last = take_block(tasks, len(starts), BLOCK)
    while first < last:
        for i in range(first, last):
            blocked[i] = _is_blocked(occupied, starts[i], eye, touching, run)
        first, last = take_block(tasks, len(starts), BLOCK)


@njit
def _part_within(start, eye, n):
    """Return the part of the line from `start` to `eye` within the grid, as fractions; empty if begin >= end."""
    begin, end = 0.0, 1.0
    for axis in range(3):
        d = eye[axis] - start[axis]
        if d == 0.0:
            if start[axis] < 0.0 or start[axis] > n:
                return 1.0, 0.0
        else:
            low, high = -start[axis] / d, (n - start[axis]) / d
            begin, end = max(begin, min(low, high)), min(end, max(low, high))
    return begin, end


@njit
def _is_blocked(occupied, start, eye, touching, run):
    """Return whether an occupied cell beyond the start's own surface is on the line from `start` to `eye`, in cells."""
    n = len(occupied)
    begin, end = _part_within(start, eye, n)
    if begin >= end:
        return False
    first = np.empty(3, dtype=np.int64)  # the start's cell, which may lie outside the grid
    last = np.empty(3, dtype=np.int64)  # the eye's cell
    cell = np.empty(3, dtype=np.int64)
    step = np.zeros(3, dtype=np.int64)
    next_t = np.full(3, np.inf)  # parameter of the line at the cell's next wall on each axis
    delta = np.full(3, np.inf)
    for axis in range(3):
        d = eye[axis] - start[axis]
        first[axis], last[axis] = math.floor(start[axis]), math.floor(eye[axis])
        cell[axis] = min(max(math.floor(start[axis] + begin * d), 0), n - 1)
        if d != 0.0:
            step[axis] = 1 if d > 0.0 else -1
            wall = cell[axis] + (1 if d > 0.0 else 0)
            next_t[axis] = (wall - start[axis]) / d
            delta[axis] = abs(1.0 / d)
    unbroken = True  # all cells so far, except the start's own, are occupied
    while True:
        if cell[0] == last[0] and cell[1] == last[1] and cell[2] == last[2]:
            return False
        apart = max(abs(cell[0] - first[0]), abs(cell[1] - first[1]), abs(cell[2] - first[2]))
        if occupied[cell[0], cell[1], cell[2]]:
            if apart > (run if unbroken else touching):
                return True
        elif apart > 0:
            unbroken = False
        axis = 0
        if next_t[1] < next_t[axis]:
            axis = 1
        if next_t[2] < next_t[axis]:
            axis = 2
        if next_t[axis] >= end:
            return False
        cell[axis] += step[axis]
        if cell[axis] < 0 or cell[axis] >= n:
            return False
        next_t[axis] += delta[axis]
