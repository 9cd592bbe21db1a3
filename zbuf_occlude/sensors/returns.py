"""A scan: the returns of a sensor as a point cloud, and the table of its columns."""

import os
from dataclasses import dataclass, fields
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zbuf_occlude.base.arrays import FloatArray, IntArray, as_selection
from zbuf_occlude.base.point_files import columns_of
from zbuf_occlude.geometry.cloud import Cloud
from zbuf_occlude.geometry.colors import Bytes


class ScanColumn(NamedTuple):
    """A value that a scan has for each point, besides the position."""

    name: str  # in files and in the records of datasets
    attribute: str  # of `Scan`
    dtype: str  # in the file of a single scan
    record_dtype: str  # in the records of datasets
    shape: tuple[int, ...] = ()  # of a point's value


NORMAL, CLEAN_RANGE = "normal", "clean_range"
SCAN_COLUMNS = (
    ScanColumn("range", "ranges", "<f8", "<f4"),
    ScanColumn("incidence", "incidences", "<f4", "<f4"),
    ScanColumn("intensity", "intensities", "<f4", "<f4"),
    ScanColumn("ring", "rings", "<i4", "<i4"),
    ScanColumn("column", "columns", "<i4", "<i4"),
    ScanColumn("instance", "instances", "<i4", "<i4"),
    ScanColumn("n_returns", "n_returns", "<i4", "<i4"),
    ScanColumn(NORMAL, "normals", "<f4", "<f4", (3,)),
    ScanColumn(CLEAN_RANGE, "clean_ranges", "<f8", "<f4"),
    ScanColumn("time", "times", "<f8", "<f4"),
    ScanColumn("return_number", "return_numbers", "<i4", "<i4"),
    ScanColumn("share", "shares", "<f4", "<f4"),
)
"""The columns of scans: metres, radians, seconds."""


@dataclass(frozen=True, eq=False)
class Scan(Cloud):
    """One scan: n returns of a sensor. A point cloud that can be saved and shown.

    Parameters
    ----------
    origin : (3,) float
        Position of the sensor, world space, metres.
    directions : (n, 3) float
        Unit vectors along the rays, world space.
    offsets : (n, 3) float
        Vectors from `origin` to the starts of the rays, world space.
    times : (n,) float
        Time of each ray, seconds from the start of the revolution or image.
    depths_per_range : (n,) float
        Depth along the sensor's x axis over range: the cosine of the angle between axis and ray.
    ranges : (n,) float
        Measured distances; ``starts + ranges * directions`` are the points.
    clean_ranges : (n,) float
        True distances, before noise and quantisation.
    face_ids : (n,) int
        Faces of the scene. For a return of several surfaces, the face nearest to the mean range.
    normals : (n, 3) float
        Unit normals, turned towards the sensor.
    incidences : (n,) float
        Angles between ray and normal, radians.
    intensities : (n,) float
        Albedo times the cosine of the incidence over the squared clean range (metres), less the light that transparent
        faces in front take. The albedo is the luminance of the base colour where the mesh has colours
        (``load_mesh(path, colors=True)``), else the object's.
    rings, columns, instances : (n,) int
        Laser, firing and object.
    n_returns : (n,) int
        Number of returns of the beam, before any is lost.
    return_numbers : (n,) int
        Number of the return in its beam, from 1, the nearest first.
    shares : (n,) float
        Share of the beam's light that met the surface.
    """

    origin: FloatArray
    directions: FloatArray
    offsets: FloatArray
    times: FloatArray
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
    return_numbers: IntArray
    shares: FloatArray

    def __len__(self) -> int:
        return len(self.ranges)

    def __repr__(self) -> str:
        span = f", ranges {self.ranges.min():.4g} to {self.ranges.max():.4g}" if len(self) else ""
        return f"Scan({len(self)} points{span})"

    @property
    def points(self) -> FloatArray:  # type: ignore[override]  # computed, and never assigned
        """The points, world space, (n, 3)."""
        return self.starts + self.ranges[:, None] * self.directions

    @property
    def starts(self) -> FloatArray:
        """Start of each ray, world space, (n, 3)."""
        return np.asarray(self.origin + self.offsets)

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
        """Return all arrays by name, as a .npz file has them."""
        return {"points": self.points, **{each.name: getattr(self, each.name) for each in fields(self)}}

    def table(self, *, keep_clean: bool = False) -> NDArray[Any]:
        """Return a structured array with a row per point: x, y, z, nx, ny, nz, and the other `SCAN_COLUMNS`.

        Parameters
        ----------
        keep_clean : bool
            Add ``clean_range``, the range without noise.
        """
        left_out = (NORMAL,) if keep_clean else (NORMAL, CLEAN_RANGE)
        columns = [each for each in SCAN_COLUMNS if each.name not in left_out]
        vectors = columns_of(self.points, self.normals)
        table = np.empty(len(self), dtype=[*vectors.dtype.descr, *((each.name, each.dtype) for each in columns)])
        for name in vectors.dtype.names or ():
            table[name] = vectors[name]
        for each in columns:
            table[each.name] = getattr(self, each.attribute)
        return table

    def save(self, path: str | os.PathLike[str], *, keep_clean: bool = False) -> None:
        """Write the scan to a file as `Cloud.save` does; parameters as of `table`."""
        self._write(path, self.table(keep_clean=keep_clean))

    def select(self, which: ArrayLike) -> "Scan":
        """Return the returns that a boolean mask or an index array selects, in its order."""
        chosen = as_selection(which, len(self), "returns")
        return Scan(self.origin, *(getattr(self, each.name)[chosen] for each in fields(self)[1:]))
