"""The points that are tested against the depth atlas, and by what they are judged."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.arrays import FloatArray, IntArray

GROUP = 8
"""Eyes whose answers share a byte on the GPU."""

MOST_HIDDEN = 0.3
"""Without a witness, a point is visible when no more than this of the weighed votes around it says hidden."""


class PointData(NamedTuple):
    """n points and the faces they lie on.

    Parameters
    ----------
    positions : (n, 3) float64
        Unit space.
    normals : (n, 3) float32
        Of their faces, unit length; 0 for none.
    own : (n,) int
        Index of the own face among those drawn, -1 for none.
    """

    positions: FloatArray
    normals: NDArray[np.float32]
    own: IntArray

    def part(self, some: slice) -> "PointData":
        """Some of them."""
        return PointData(self.positions[some], self.normals[some], self.own[some])


class Criteria(NamedTuple):
    """By what points are judged; lengths in unit space.

    Parameters
    ----------
    tolerance : float32
        Eye depth that a point may lie behind what is drawn.
    slope_bias : float32
        Pixels; see `zbuf_occlude.visibility.depth_buffer`.
    contact : float
        The contact tolerance.
    witness : bool
        Whether witnesses are looked for where the pixels around do not agree.
    """

    tolerance: np.float32
    slope_bias: np.float32
    contact: float
    witness: bool


class Batch(NamedTuple):
    """Eyes that are drawn and asked together: their numbers, and where their groups of answers lie."""

    first_eye: int
    n_eyes: int
    first_group: int

    @property
    def n_groups(self) -> int:
        """How many groups of `GROUP` eyes there are; the last may not be full."""
        return -(-self.n_eyes // GROUP)
