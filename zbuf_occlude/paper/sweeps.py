"""A labelled sweep: the points of one turn of a LiDAR, and the boxes that people drew around the objects in it."""

from dataclasses import dataclass

import numpy as np

from zbuf_occlude.arrays import BoolArray, FloatArray


@dataclass(frozen=True, eq=False)
class Box:
    """A labelled box.

    Parameters
    ----------
    label : str
        As its layout writes it.
    centre : (3,) float
        In the points' frame, metres.
    rotation : (3, 3) float
        Box to the points' frame; the box's axes are length, width, height.
    size : (3,) float
        Length, width, height, metres.
    """

    label: str
    centre: FloatArray
    rotation: FloatArray
    size: FloatArray

    def holds(self, points: FloatArray) -> BoolArray:
        """Which points (n, 3) lie in the box, its sides included."""
        local = (points - self.centre) @ self.rotation
        return np.asarray((np.abs(local) <= self.size / 2.0).all(axis=1))


@dataclass(frozen=True, eq=False)
class Sweep:
    """Points and boxes of one moment.

    Parameters
    ----------
    name : str
    points : (n, 3) float64
        Metres, z up.
    boxes : list of Box
    """

    name: str
    points: FloatArray
    boxes: list[Box]
