"""The order in which the search takes points: by own face, and along a Morton curve where a face has many."""

import numpy as np
from numba import njit

from zbuf_occlude.arrays import FloatArray, IntArray
from zbuf_occlude.image_space.scene.scene import Scene
from zbuf_occlude.threads import shared, take, together

MANY_POINTS = 64
"""With more points on a face than this they are sorted along a curve; fewer fill some packets that are no larger."""

CODE_BITS = 9
"""Bits per axis of the Morton codes: cells of 1/512 of the scene; what shares a cell keeps its order."""

BLOCK_ROWS = 1024
"""Rows whose points a thread sorts at a time."""


def sort_points(scene: Scene, positions: FloatArray, face_ids: IntArray) -> IntArray:
    """Return the order that sorts points by own row, then along a Morton curve through the scene; stable.

    Parameters
    ----------
    scene : Scene
    positions, face_ids : (n, 3) float64, world space, and (n,) int32

    Notes
    -----
    O(n + f) time. Those without a row, which lie on no face or on one that blocks nothing, come first.
    """
    order, starts = _sort_by_row(face_ids, scene.rows, scene.face_ids.size)
    together(_sort_rows, -(-len(starts) // BLOCK_ROWS), scene, positions, order, starts)
    return order


@njit(nogil=True, cache=True)
def _sort_by_row(face_ids, rows, n_rows):
    """Sort points by row; return the order, and where in it the points of row -1, 0, 1, ... begin."""
    starts = np.zeros(n_rows + 2, dtype=np.int32)
    for i in range(len(face_ids)):
        starts[rows[face_ids[i]] + 2] += 1
    starts[0] = 0
    for row in range(n_rows + 1):
        starts[row + 1] += starts[row]
    # starts[row + 1] is now where a row's points begin, and moves to where they end
    order = np.empty(len(face_ids), dtype=np.int32)
    for i in range(len(face_ids)):
        row = rows[face_ids[i]] + 1
        order[starts[row]] = i
        starts[row] += 1
    return order, starts


@shared
def _sort_rows(tasks, scene, positions, order, ends):
    """Sort the points of each row that has many along the curve."""
    block = take(tasks)
    while block * BLOCK_ROWS < len(ends):
        for row in range(block * BLOCK_ROWS, min((block + 1) * BLOCK_ROWS, len(ends) - 1)):
            first = ends[row - 1] if row else 0
            if ends[row] - first > MANY_POINTS:
                _sort_along_curve(scene, positions, order[first : ends[row]])
        block = take(tasks)


@njit
def _sort_along_curve(scene, positions, ids):
    """Sort points by Morton code, the lowest digits first."""
    n = len(ids)
    codes, other_codes = np.empty(n, dtype=np.uint32), np.empty(n, dtype=np.uint32)
    source, target = ids.copy(), np.empty(n, dtype=np.int32)
    for i in range(n):
        codes[i] = _morton_code(scene, positions[ids[i]])
    starts = np.empty((1 << CODE_BITS) + 1, dtype=np.int64)
    mask = np.uint32((1 << CODE_BITS) - 1)
    for digit in range(3):
        shift = np.uint32(digit * CODE_BITS)
        starts[:] = 0
        for i in range(n):
            starts[np.int64((codes[i] >> shift) & mask) + 1] += 1
        for i in range(1 << CODE_BITS):
            starts[i + 1] += starts[i]
        for i in range(n):
            place = np.int64((codes[i] >> shift) & mask)
            to = starts[place]
            starts[place] = to + 1
            target[to], other_codes[to] = source[i], codes[i]
        source, target = target, source
        codes, other_codes = other_codes, codes
    ids[:] = source


@njit(_nrt=False)
def _morton_code(scene, position):
    """Interleave the bits of a position's cell in the cube about the scene."""
    code = np.uint32(0)
    for axis in range(3):
        cell = ((position[axis] - scene.centre[axis]) * scene.scale + 1.0) * 2.0 ** (CODE_BITS - 1)
        bits = np.uint32(min(max(cell, 0.0), 2.0**CODE_BITS - 1.0))
        bits = (bits | (bits << np.uint32(16))) & np.uint32(0x030000FF)
        bits = (bits | (bits << np.uint32(8))) & np.uint32(0x0300F00F)
        bits = (bits | (bits << np.uint32(4))) & np.uint32(0x030C30C3)
        bits = (bits | (bits << np.uint32(2))) & np.uint32(0x09249249)
        code |= bits << np.uint32(axis)
    return code
