"""What a sensor measured: a cloud whose points know their ray, range, incidence and object."""

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from zbuf_occlude.arrays import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Scan:
    """One scan: n returns of a sensor.

    Parameters
    ----------
    origin : (3,) float
        The sensor, world space, metres.
    directions : (n, 3) float
        Unit, world space.
    depths_per_range : (n,) float
        Depth along the sensor's x axis over range: the cosine between them.
    ranges : (n,) float
        Eye distances as measured; ``origin + ranges * directions`` are the points.
    clean_ranges : (n,) float
        As they are, before noise and quantisation.
    face_ids : (n,) int
        Into the scene's faces; with several surfaces in a beam, of the one that counts most.
    normals : (n, 3) float
        Unit, turned towards the sensor.
    incidences : (n,) float
        Between the ray and the normal, radians.
    intensities : (n,) float
        Albedo times the cosine of the incidence over the range squared (the clean one, metres).
    rings, columns, instances, n_returns : (n,) int
        Laser, firing, object, and how many returns the beam has in all, before any is lost.
    """

    origin: FloatArray
    directions: FloatArray
    depths_per_range: FloatArray
    ranges: FloatArray
    clean_ranges: FloatArray
    face_ids: IntArray
    normals: FloatArray
    incidences: FloatArray
    intensities: FloatArray
    rings: IntArray
    columns: IntArray
    instances: IntArray
    n_returns: IntArray

    def __len__(self) -> int:
        return len(self.ranges)

    def __repr__(self) -> str:
        return f"Scan({len(self)})"

    @property
    def positions(self) -> FloatArray:
        """The points, world space, (n, 3)."""
        return np.asarray(self.origin + self.ranges[:, None] * self.directions)

    def select(self, which: ArrayLike) -> "Scan":
        """Return the returns that a boolean mask or an index array picks, in its order."""
        chosen = np.asarray(which)
        return Scan(self.origin, *(getattr(self, each.name)[chosen] for each in fields(self)[1:]))

    def measuring(self, **measured: Any) -> "Scan":
        """Return the scan with other measurements, the rest as it is."""
        return replace(self, **measured)
