"""Hilbert order: positions along a curve through space that never jumps, so that what is consecutive is compact."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from zbuf_occlude.arrays import FloatArray
from zbuf_occlude.threads import n_blocks, shared, take_block, together

Keys = NDArray[np.uint64]

CODE_BITS = 10
"""Bits per axis of a place along the curve: what is consecutive has to be near, not in perfect order."""

BLOCK = 8192
"""Positions that a thread places at a time."""

DIGIT_BITS = 11
"""Keys are sorted by so many bits at a time: the counts of all digits stay in a cache."""


def hilbert_order(positions: FloatArray) -> NDArray[np.int64]:
    """Return the indices that put positions (n, 3) into Hilbert order; what shares a cell keeps its order.

    Notes
    -----
    The curve runs through 2^10 cells per axis of the positions' bounding cube. Packets of consecutive points, and boxes
    around consecutive faces, have a tenth less to test than in Morton order, which jumps.

    References
    ----------
    Skilling: Programming the Hilbert curve. AIP Conference Proceedings 707 (2004), doi:10.1063/1.1751381.
    """
    index_bits = len(positions).bit_length()
    low = [float(axis.min()) for axis in positions.T]  # axis by axis: 20 times as fast as positions.min(axis=0)
    side = max(float(axis.max()) - lowest for axis, lowest in zip(positions.T, low, strict=True))
    scale = (2.0**CODE_BITS - 1.0) / side if side > 0.0 else 0.0
    # with the index in the low bits, sorting the keys is all
    keys = np.empty(len(positions), dtype=np.uint64)
    together(_keys, n_blocks(len(positions), BLOCK), positions, tuple(low), scale, index_bits, keys)
    keys = sorted_keys(keys, index_bits, 3 * CODE_BITS)
    return (keys & np.uint64((1 << index_bits) - 1)).astype(np.int64)


def sorted_keys(keys: Keys, index_bits: int, n_bits: int) -> Keys:
    """Return keys (n,) sorted by `n_bits` bits, below which an index ascends already; the keys given are scratch.

    In a fourth of the time of NumPy's sort, which compares.
    """
    spare, counts = np.empty_like(keys), np.zeros((-(-n_bits // DIGIT_BITS), 1 << DIGIT_BITS), dtype=np.int64)
    return spare if _sort(keys, spare, counts, np.uint64(index_bits)) else keys


@njit(cache=True, nogil=True, _nrt=False)
def _sort(keys, spare, counts, first_bit):
    """Sort by digit after digit, the lowest first, from array to array; return whether it ended in `spare`."""
    n, in_spare, mask = len(keys), False, np.uint64((1 << DIGIT_BITS) - 1)
    for i in range(n):
        for digit in range(len(counts)):
            counts[digit, (keys[i] >> (first_bit + np.uint64(digit * DIGIT_BITS))) & mask] += 1
    for digit in range(len(counts)):
        shift, begin = first_bit + np.uint64(digit * DIGIT_BITS), 0
        if n == 0 or counts[digit, (keys[0] >> shift) & mask] == n:
            continue  # all have the same
        for value in range(len(counts[digit])):
            counts[digit, value], begin = begin, begin + counts[digit, value]
        for i in range(n):
            value = (keys[i] >> shift) & mask
            spare[counts[digit, value]] = keys[i]
            counts[digit, value] += 1
        keys, spare, in_spare = spare, keys, not in_spare
    return in_spare


@shared
def _keys(tasks, positions, low, scale, index_bits, keys):
    """Place along the curve, and index, of each position."""
    x, y, z = low
    first, last = take_block(tasks, len(positions), BLOCK)
    while first < last:
        for i in range(first, last):
            code = hilbert_code(
                np.int64((positions[i, 0] - x) * scale),
                np.int64((positions[i, 1] - y) * scale),
                np.int64((positions[i, 2] - z) * scale),
            )
            keys[i] = (np.uint64(code) << np.uint64(index_bits)) | np.uint64(i)
        first, last = take_block(tasks, len(positions), BLOCK)


@njit(_nrt=False)
def hilbert_code(x, y, z):
    """Place of a cell along the curve, 3 x `CODE_BITS` bits; x, y and z are at least 0 and below 2^`CODE_BITS`."""
    # undo the curve's turns, from the coarsest cell to the finest: where an axis has the bit, mirror x below it,
    # else swap that axis with x below it (masks instead of branches, which nobody could predict)
    for level in range(CODE_BITS - 1, 0, -1):
        below = (1 << level) - 1
        x ^= below & -(x >> level & 1)
        mirror = below & -(y >> level & 1)
        swap = (x ^ y) & (below ^ mirror)
        x ^= swap | mirror
        y ^= swap
        mirror = below & -(z >> level & 1)
        swap = (x ^ z) & (below ^ mirror)
        x ^= swap | mirror
        z ^= swap
    # Gray code
    y ^= x
    z ^= y
    above = z >> 1  # becomes, at each bit, the parity of those above it
    for step in (1, 2, 4, 8):
        above ^= above >> step
    return _spaced(x ^ above) << 2 | _spaced(y ^ above) << 1 | _spaced(z ^ above)


@njit(_nrt=False)
def _spaced(bits):
    """Put two zeros before each of 10 bits."""
    bits = (bits | bits << 16) & 0x030000FF
    bits = (bits | bits << 8) & 0x0300F00F
    bits = (bits | bits << 4) & 0x030C30C3
    return (bits | bits << 2) & 0x09249249
