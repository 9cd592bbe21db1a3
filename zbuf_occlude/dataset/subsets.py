"""Random subsets of the points that a view sees, and where they come to lie in their cloud, in compiled passes."""

import numpy as np

from zbuf_occlude.arrays import BoolArray, IntArray
from zbuf_occlude.jit.compiler import njit

ALL = -1
"""As a size: every visible point."""


def draw_visible(mask: BoolArray, size: int, seed: np.uint64, view: int) -> tuple[IntArray, int]:
    """Draw `size` of the points that a view sees, in random order; they repeat only where there are fewer.

    Parameters
    ----------
    mask : (n,) bool
        The points that it sees, at least one.
    size : int
        Or `ALL`.
    seed : uint64
    view : int
        Views of one seed have sequences of their own.

    Returns
    -------
    chosen : (size,) int32
        Indices.
    n_visible : int

    References
    ----------
    Fisher and Yates's shuffle, ended when there are enough; numbers by SplitMix64 (Steele, Lea, Flood: Fast splittable
    pseudorandom number generators, OOPSLA 2014, doi:10.1145/2660193.2660195), brought into a range without bias as
    in Lemire: Fast random integer generation in an interval, 2019, doi:10.1145/3230636.
    """
    chosen = np.empty(len(mask) if size == ALL else size, dtype=np.int32)
    n_visible = _draw(mask, size == ALL, seed, view, np.empty(len(mask) + 1, dtype=np.int32), chosen)
    return chosen[:n_visible] if size == ALL else chosen, n_visible


@njit(cache=True, nogil=True)
def _draw(mask, whole, seed, view, visible, chosen):
    """List what is visible, and shuffle the first places, as many as are chosen; return how many are visible.

    One place more of the list is written to than there are points.
    """
    n_visible = 0
    for i in range(len(mask)):
        visible[n_visible] = i
        n_visible += mask[i]
    state, size = _mixed(seed ^ _mixed(np.uint64(view) + np.uint64(1))), n_visible if whole else len(chosen)
    n_once = min(size, n_visible)
    for i in range(n_once):
        state, j = _below(state, n_visible - i)
        visible[i], visible[i + j] = visible[i + j], visible[i]
        chosen[i] = visible[i]
    for i in range(n_once, size):
        state, j = _below(state, n_visible)
        chosen[i] = visible[j]
    if n_once < size:  # else those that repeat would all come last
        for i in range(size):
            state, j = _below(state, size - i)
            chosen[i], chosen[i + j] = chosen[i + j], chosen[i]
    return n_visible


@njit(cache=True, nogil=True)
def place(positions, face_ids, chosen, frame, fitted, centre, factor, turned, data, faces):
    """Place the chosen points in a cloud: in a frame, centred, scaled.

    Parameters
    ----------
    positions : (n, 3) float64
        World space.
    face_ids : (n,) int32
    chosen : (m,) int32
    frame : (4, 4) float64
        From world space to the cloud's axes.
    fitted : bool
        Whether the cloud's own box says centre and factor: its longest side becomes 1.
    centre : (3,) float64
    factor : float
        What is subtracted, and multiplied with; where the box says it, the centre is filled and the factor not read.
    turned : (m, 3) float64
        Overwritten.
    data : (m, 3) float32
        Filled: ``(p - centre) * factor``.
    faces : (m,) int32
        Filled: the face that each point lies on.

    Returns
    -------
    factor : float
    """
    low_x = low_y = low_z = np.inf
    high_x = high_y = high_z = -np.inf
    for i in range(len(chosen)):
        p = positions[chosen[i]]
        x, y, z = _turned(frame[0], p), _turned(frame[1], p), _turned(frame[2], p)
        low_x, low_y, low_z = min(x, low_x), min(y, low_y), min(z, low_z)
        high_x, high_y, high_z = max(x, high_x), max(y, high_y), max(z, high_z)
        turned[i, 0], turned[i, 1], turned[i, 2] = x, y, z
        faces[i] = face_ids[chosen[i]]
    if fitted:
        centre[0], centre[1], centre[2] = (low_x + high_x) / 2.0, (low_y + high_y) / 2.0, (low_z + high_z) / 2.0
        longest = max(high_x - low_x, high_y - low_y, high_z - low_z)
        factor = 1.0 / longest if longest > 0.0 else 1.0
    for i in range(len(chosen)):
        for axis in range(3):
            data[i, axis] = (turned[i, axis] - centre[axis]) * factor
    return factor


@njit(inline="always")
def _turned(row, p):
    return row[0] * p[0] + row[1] * p[1] + row[2] * p[2] + row[3]


@njit(inline="always")
def _mixed(z):
    """SplitMix64's finish: a permutation of the numbers of 64 bits that leaves no trace of their order."""
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


@njit(inline="always")
def _below(state, n):
    """Return the next state, and a number from 0 to n - 1, all equally likely; n is less than 2^32."""
    n = np.uint64(n)
    low_bits = np.uint64(0xFFFFFFFF)
    state += np.uint64(0x9E3779B97F4A7C15)
    product = (_mixed(state) >> np.uint64(32)) * n
    if (product & low_bits) < n:
        least = (np.uint64(1 << 32) - n) % n
        while (product & low_bits) < least:
            state += np.uint64(0x9E3779B97F4A7C15)
            product = (_mixed(state) >> np.uint64(32)) * n
    return state, np.int64(product >> np.uint64(32))
