"""Hilbert order: positions along a continuous space-filling curve, so that consecutive positions are compact."""

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.base.arrays import FloatArray, IntArray
from zbuf_occlude.base.jit.compiler import njit
from zbuf_occlude.base.jit.simd import load_unchecked, store_unchecked
from zbuf_occlude.base.jit.threads import n_blocks, parallel_for, parallel_kernel, take_block

Keys = NDArray[np.uint64]

CODE_BITS = 10
"""Maximum bits per axis of a Hilbert code: consecutive positions must be near, not in perfect order."""

POSITION_BITS = 7
"""Bits per axis of the codes of positions alone: faster than `CODE_BITS`, and the order is as good for searches."""

DIGIT_BITS = 11
"""Bits of a digit of the radix sort: its counts fit into the L1 cache."""

BLOCK = 1024
"""Positions per block of a thread: their cells stay in the L1 cache."""

THREAD = 8 * BLOCK
"""Minimum positions per extra thread; below this, waking it costs more."""


def hilbert_order(positions: FloatArray) -> IntArray:
    """Return the indices that put positions (n, 3) into Hilbert order; positions in one cell keep their order.

    The curve runs through 2^7 cells per axis of the positions' bounding cube. Packets of consecutive points, and boxes
    around consecutive faces, have 10 % less to test than in Morton order, which jumps.
    Skilling: Programming the Hilbert curve. AIP Conference Proceedings 707 (2004), doi:10.1063/1.1751381.
    """
    index_bits = len(positions).bit_length()
    low, high = _bounds_of(positions)
    side = max(high[0] - low[0], high[1] - low[1], high[2] - low[2])
    scale = (2.0**POSITION_BITS - 1.0) / side if side > 0.0 else 0.0
    keys = np.empty(len(positions), dtype=np.uint64)
    parallel_for(_keys, n_blocks(len(positions), THREAD), positions, low, scale, index_bits, keys, own=new_cells)
    return indices_of(sort_keys(keys, index_bits, 3 * POSITION_BITS), index_bits)


def sort_keys(keys: Keys, index_bits: int, code_bits: int) -> Keys:
    """Return keys (n,) sorted by their codes; keys of one code keep their order. O(n); the given array is overwritten.

    A key is a code of `code_bits`, and below it an index of `index_bits`. `numpy.sort` takes five times as long as this
    radix sort; with it, sorting took a quarter of the time of preparing a mesh.
    """
    spare, counts = np.empty_like(keys), np.empty(1 << DIGIT_BITS, dtype=np.int64)
    for first in range(index_bits, index_bits + code_bits, DIGIT_BITS):
        _sort_by_digit(keys, spare, counts, first)
        keys, spare = spare, keys
    return keys


@njit(nogil=True, cache=True)
def _sort_by_digit(keys, sorted_keys, counts, first):
    """Write keys in the order of a digit, their bits from `first` on; those of one digit keep their order."""
    shift, digit_mask = np.uint64(first), np.uint64((1 << DIGIT_BITS) - 1)
    counts[:] = 0
    for i in range(len(keys)):
        digit = np.int64((load_unchecked(keys, i) >> shift) & digit_mask)
        store_unchecked(counts, digit, load_unchecked(counts, digit) + 1)
    start = 0
    for value in range(len(counts)):
        count = counts[value]
        counts[value] = start
        start += count
    for i in range(len(keys)):
        key = load_unchecked(keys, i)
        digit = np.int64((key >> shift) & digit_mask)
        at = load_unchecked(counts, digit)
        store_unchecked(counts, digit, at + 1)
        store_unchecked(sorted_keys, at, key)


def indices_of(keys: Keys, index_bits: int) -> IntArray:
    """Return the indices in the low bits of keys, (n,) int32."""
    return (keys.astype(np.uint32) & np.uint32((1 << index_bits) - 1)).view(np.int32)


@njit(cache=True, error_model="numpy")
def _bounds_of(positions):
    """Return the lower and the upper corner of the positions' box; four times as fast as NumPy."""
    low, high = (positions[0, 0], positions[0, 1], positions[0, 2]), (positions[0, 0], positions[0, 1], positions[0, 2])
    for i in range(len(positions)):
        x, y, z = positions[i, 0], positions[i, 1], positions[i, 2]
        low = min(low[0], x), min(low[1], y), min(low[2], z)
        high = max(high[0], x), max(high[1], y), max(high[2], z)
    return low, high


def new_cells() -> IntArray:
    """Allocate a thread's array for the cells of a block, (3, `BLOCK`), for `hilbert_codes`."""
    return np.empty((3, BLOCK), dtype=np.int32)


@parallel_kernel
def _keys(tasks, positions, low, scale, index_bits, keys, cells):
    """Write the Hilbert code and index of each position."""
    first, last = take_block(tasks, len(positions), BLOCK)
    while first < last:
        for axis in range(3):
            for i in range(last - first):
                cells[axis, i] = np.int64((positions[first + i, axis] - low[axis]) * scale)
        hilbert_codes(cells, last - first, POSITION_BITS)
        for i in range(last - first):
            keys[first + i] = (np.uint64(cells[0, i]) << np.uint64(index_bits)) | np.uint64(first + i)
        first, last = take_block(tasks, len(positions), BLOCK)


@njit()
def hilbert_codes(cells, n, n_bits):
    """Write the Hilbert codes, 3 x `n_bits` bits, of the first n cells, (3, >= n) int32, to row 0.

    Cells count from 0 to 2^`n_bits` - 1 along each axis; `n_bits` is at most `CODE_BITS`. The loops run level by level
    over all cells and have no branches, so that the compiler vectorises them; cell by cell takes twelve times as long.
    """
    xs, ys, zs = cells[0, :n], cells[1, :n], cells[2, :n]
    # undo the curve's rotations, from the coarsest level to the finest: if an axis has the bit, mirror x below it,
    # else swap that axis with x below it (masks instead of branches)
    for level in range(n_bits - 1, 0, -1):
        below = (1 << level) - 1
        for i in range(len(xs)):
            x, y, z = xs[i], ys[i], zs[i]
            x ^= below & -(x >> level & 1)
            mirror = below & -(y >> level & 1)
            swap = (x ^ y) & (below ^ mirror)
            x ^= swap | mirror
            ys[i] = y ^ swap
            mirror = below & -(z >> level & 1)
            swap = (x ^ z) & (below ^ mirror)
            xs[i], zs[i] = x ^ (swap | mirror), z ^ swap
    for i in range(len(xs)):
        x = xs[i]
        y = ys[i] ^ x  # Gray code
        z = zs[i] ^ y
        above = z >> 1  # becomes, at each bit, the parity of the bits above it
        above ^= above >> 1
        above ^= above >> 2
        above ^= above >> 4
        above ^= above >> 8
        xs[i] = _spaced(x ^ above) << 2 | _spaced(y ^ above) << 1 | _spaced(z ^ above)


@njit()
def _spaced(bits):
    """Insert two zeros before each of 10 bits."""
    bits = (bits | bits << 16) & 0x030000FF
    bits = (bits | bits << 8) & 0x0300F00F
    bits = (bits | bits << 4) & 0x030C30C3
    return (bits | bits << 2) & 0x09249249
