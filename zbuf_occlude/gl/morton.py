"""Morton order: positions along a curve through space that keeps neighbours together."""

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.arrays import FloatArray

_BITS = 21
_SPREAD = (
    (32, 0x1F00000000FFFF),
    (16, 0x1F0000FF0000FF),
    (8, 0x100F00F00F00F00F),
    (4, 0x10C30C30C30C30C3),
    (2, 0x1249249249249249),
)
"""Shifts and masks that put two zeros between the 21 bits of a number."""


def morton_order(positions: FloatArray) -> NDArray[np.int64]:
    """Return the indices that put positions (n, 3) into Morton order, 21 bits an axis of their bounding cube."""
    low = positions.min(axis=0)
    side = float((positions.max(axis=0) - low).max())
    cells = (positions - low) * ((2.0**_BITS - 1.0) / side) if side > 0.0 else np.zeros_like(positions)
    code = np.zeros(len(positions), dtype=np.uint64)
    for axis in range(3):
        bits = cells[:, axis].astype(np.uint64)
        for shift, mask in _SPREAD:
            bits = (bits | (bits << np.uint64(shift))) & np.uint64(mask)
        code |= bits << np.uint64(axis)
    return np.argsort(code)
