"""Orders in which things that are near each other in space are near each other in memory: Morton codes."""

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.arrays import FloatArray

BITS = 16
"""Bits of a Morton code per axis: cells of 1/65536 of the box; what shares a cell keeps its order."""


def morton_codes(positions: FloatArray, lower: FloatArray, side: float) -> NDArray[np.uint64]:
    """Interleave the bits of the three coordinates.

    Parameters
    ----------
    positions : (n, 3) float64
    lower : (3,) float64
        Lower corner of the cube of that `side` which is divided into cells; positions outside are clamped into it.
    side : float

    Returns
    -------
    (n,) uint64 of 3 x `BITS` bits. Sorting by them puts positions in Z-order.
    """
    cells = 2.0**BITS
    scale = cells / side if side > 0 else 0.0
    index = np.clip((positions - lower) * scale, 0.0, cells - 1.0).astype(np.uint64)
    codes = np.zeros(len(positions), dtype=np.uint64)
    for axis in range(3):
        codes |= _spread(index[:, axis]) << np.uint64(axis)
    return codes


def _spread(bits: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Put two zeros between the bits of 21-bit numbers."""
    for shift, mask in (
        (32, 0x001F00000000FFFF),
        (16, 0x001F0000FF0000FF),
        (8, 0x100F00F00F00F00F),
        (4, 0x10C30C30C30C30C3),
        (2, 0x1249249249249249),
    ):
        bits = (bits | (bits << np.uint64(shift))) & np.uint64(mask)
    return bits
