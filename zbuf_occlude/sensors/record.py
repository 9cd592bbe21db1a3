"""What a sensor measured: a cloud whose points know their ray, range, incidence and object."""

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zbuf_occlude.arrays import FloatArray, IntArray
from zbuf_occlude.geometry.cloud import Cloud, columns_of
from zbuf_occlude.geometry.colors import Bytes

COLUMNS = (
    ("range", "ranges", "<f8"), ("incidence", "incidences", "<f4"), ("intensity", "intensities", "<f4"),
    ("ring", "rings", "<i4"), ("column", "columns", "<i4"), ("instance", "instances", "<i4"),
    ("n_returns", "n_returns", "<i4"),
)  # fmt: skip
"""Of a point besides x, y, z, nx, ny, nz: its name in files, in a `Scan`, and its type."""


@dataclass(frozen=True, eq=False)
class Scan(Cloud):
    """One scan: n returns of a sensor; a cloud that can be saved and shown.

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
        span = f", ranges {self.ranges.min():.4g} to {self.ranges.max():.4g}" if len(self) else ""
        return f"Scan({len(self)} points{span})"

    @property
    def points(self) -> FloatArray:  # type: ignore[override]  # computed, and never assigned
        """The points, world space, (n, 3)."""
        return np.asarray(self.origin + self.ranges[:, None] * self.directions)

    @property
    def positions(self) -> FloatArray:
        """The same as `points`."""
        return self.points

    @property
    def colors(self) -> Bytes | None:  # type: ignore[override]
        """None: a sensor measures no colours."""
        return None

    @property
    def eye(self) -> FloatArray:
        """The same as `origin`."""
        return self.origin

    def arrays(self) -> dict[str, Any]:
        """Return all that is known, by name: the arrays of a .npz file."""
        return {"points": self.points, **{each.name: getattr(self, each.name) for each in fields(self)}}

    def table(self, *, keep_clean: bool = False) -> NDArray[Any]:
        """Return a structured array with a row per point: position, normal, and `COLUMNS`.

        Parameters
        ----------
        keep_clean : bool
            Add ``clean_range``, without noise.
        """
        columns = [*COLUMNS, ("clean_range", "clean_ranges", "<f8")] if keep_clean else COLUMNS
        placed = columns_of(self.points, self.normals)
        table = np.empty(len(self), dtype=[*placed.dtype.descr, *((name, kind) for name, _, kind in columns)])
        for name in placed.dtype.names or ():
            table[name] = placed[name]
        for name, attribute, _ in columns:
            table[name] = getattr(self, attribute)
        return table

    def select(self, which: ArrayLike) -> "Scan":
        """Return the returns that a boolean mask or an index array picks, in its order."""
        chosen = np.asarray(which)
        return Scan(self.origin, *(getattr(self, each.name)[chosen] for each in fields(self)[1:]))

    def measuring(self, **measured: Any) -> "Scan":
        """Return the scan with other measurements, the rest as it is."""
        return replace(self, **measured)
