"""Which faces of a mesh have no area, and which are there already: one compiled pass each, duplicates by hashing."""

import math

import numpy as np

from zbuf_occlude.arrays import BoolArray, FloatArray, IntArray
from zbuf_occlude.kernels import njit


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
    return _degenerate(vertices, faces, no_area), _duplicates(positions, faces)


@njit(cache=True)
def _first_equal_rows(rows):
    """For each row of (n, 3) int64 the first row that equals it, (n,) int64; a hash table with open addresses."""
    size = 16
    while size < 2 * len(rows):
        size *= 2
    table = np.full(size, -1, np.int64)
    first = np.empty(len(rows), np.int64)
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
    return first


@njit(cache=True)
def _duplicates(positions, faces):
    """Whether each face has the positions, given by number, of one before it."""
    rows = np.empty((len(faces), 3), np.int64)
    for i in range(len(faces)):
        a, b, c = positions[faces[i, 0]], positions[faces[i, 1]], positions[faces[i, 2]]
        low, high = min(a, b, c), max(a, b, c)
        rows[i, 0], rows[i, 1], rows[i, 2] = low, a + b + c - low - high, high
    first = _first_equal_rows(rows)
    return first != np.arange(len(first))


@njit(cache=True)
def _degenerate(vertices, faces, no_area):
    """Whether the normal n = (b - a) x (c - a) of each face is as good as none."""
    found = np.empty(len(faces), np.bool_)
    for i in range(len(faces)):
        a, b, c = vertices[faces[i, 0]], vertices[faces[i, 1]], vertices[faces[i, 2]]
        ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
        vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
        wx, wy, wz = c[0] - b[0], c[1] - b[1], c[2] - b[2]
        nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        longest = max(ux * ux + uy * uy + uz * uz, vx * vx + vy * vy + vz * vz, wx * wx + wy * wy + wz * wz)
        found[i] = math.sqrt(nx * nx + ny * ny + nz * nz) <= no_area * longest
    return found
