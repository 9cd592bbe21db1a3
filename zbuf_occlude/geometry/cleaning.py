"""Which faces of a mesh have no area, and which are there already: one compiled pass each, duplicates by hashing."""

import math

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.arrays import BoolArray, FloatArray, IntArray
from zbuf_occlude.jit.compiler import njit


def faulty_faces(vertices: FloatArray, faces: IntArray, no_area: float) -> tuple[BoolArray, BoolArray]:
    """Say which faces are degenerate and which are duplicates.

    Parameters
    ----------
    vertices : (v, 3) float64
    faces : (f, 3) int32
    no_area : float
        A face is degenerate when the length of its normal is at most this times its longest edge squared.

    Returns
    -------
    degenerate : (f,) bool
    duplicate : (f,) bool
        The corners of a face before it have the same three positions, in any order; 0.0 is -0.0.
    """
    positions = _first_equal_rows((vertices + 0.0).view(np.int64))  # -0.0 + 0.0 is 0.0
    corners, degenerate = np.empty((len(faces), 3), dtype=np.int64), np.empty(len(faces), dtype=np.bool_)
    _fill_sorted(positions, faces, corners)
    _fill_degenerate(vertices, faces, no_area, degenerate)
    return degenerate, _first_equal_rows(corners) != np.arange(len(faces))


def _first_equal_rows(rows: NDArray[np.int64]) -> NDArray[np.int64]:
    """For each row of (n, 3) int64 the first row that equals it, (n,) int64."""
    first, table = np.empty(len(rows), dtype=np.int64), np.full(1 << max(4, (2 * len(rows) - 1).bit_length()), -1)
    _fill_first_equal(rows, table, first)
    return first


@njit(cache=True, nogil=True)
def _fill_first_equal(rows, table, first):
    """Enter rows in a hash table with open addresses: a power of two, twice as many as rows; -1 where nothing is."""
    size = len(table)
    for i in range(len(rows)):
        mixed = np.uint64(0)
        for axis in range(3):  # the constants and shifts are those of SplitMix64
            mixed = (mixed ^ np.uint64(rows[i, axis])) * np.uint64(0xBF58476D1CE4E5B9)
            mixed ^= mixed >> np.uint64(31)
        mixed *= np.uint64(0x94D049BB133111EB)
        slot = np.int64((mixed ^ (mixed >> np.uint64(32))) & np.uint64(size - 1))
        while True:
            other = table[slot]
            if other < 0:
                table[slot] = other = i
            if rows[other, 0] == rows[i, 0] and rows[other, 1] == rows[i, 1] and rows[other, 2] == rows[i, 2]:
                first[i] = other
                break
            slot = (slot + 1) & (size - 1)


@njit(cache=True, nogil=True)
def _fill_sorted(positions, faces, rows):
    """The positions, given by number, of each face's corners in ascending order."""
    for i in range(len(faces)):
        a, b, c = positions[faces[i, 0]], positions[faces[i, 1]], positions[faces[i, 2]]
        low, high = min(a, b, c), max(a, b, c)
        rows[i, 0], rows[i, 1], rows[i, 2] = low, a + b + c - low - high, high


@njit(cache=True, nogil=True)
def _fill_degenerate(vertices, faces, no_area, found):
    """Whether the normal n = (b - a) x (c - a) of each face is as good as none."""
    for i in range(len(faces)):
        a, b, c = vertices[faces[i, 0]], vertices[faces[i, 1]], vertices[faces[i, 2]]
        ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
        vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
        wx, wy, wz = c[0] - b[0], c[1] - b[1], c[2] - b[2]
        nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        longest = max(ux * ux + uy * uy + uz * uz, vx * vx + vy * vy + vz * vz, wx * wx + wy * wy + wz * wz)
        found[i] = math.sqrt(nx * nx + ny * ny + nz * nz) <= no_area * longest
