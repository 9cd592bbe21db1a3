"""Comparison of real scans of an object with the scans that a sensor model predicts from its mesh.

Each scan has four measures: real points hidden by the mesh (visibility); vertices that were scanned and vertices that
the sensor should have returned (coverage); distances of real points from the mesh along their rays (noise); numbers of
points by range and incidence (density). A measure without data is NaN: null in JSON, a dash in the report.
"""

import json
import os
import warnings
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zbuf_occlude.base import atomic
from zbuf_occlude.base.arrays import BoolArray, FloatArray, as_flag, as_number, as_vectors, unit_vectors
from zbuf_occlude.base.documents import as_path
from zbuf_occlude.base.errors import ArgumentError, escape_control
from zbuf_occlude.base.extras import importing
from zbuf_occlude.drawing.pages import NONE, Picture, Section, Table, as_png, verbatim, write_pages
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.meshes.conversion import MeshLike, as_mesh
from zbuf_occlude.meshes.load import load_mesh
from zbuf_occlude.sensors.bop import MILLIMETRES
from zbuf_occlude.sensors.catalog import make
from zbuf_occlude.sensors.scanning import scan
from zbuf_occlude.sensors.scenes.scene import Scene
from zbuf_occlude.sensors.sensor import Sensor
from zbuf_occlude.studies.compare.bop_folder import camera_of, model_number
from zbuf_occlude.studies.compare.scan_files import read_poses, read_scan_file, rigid
from zbuf_occlude.visibility import prepare
from zbuf_occlude.visibility.interface import VisibilityQuery

DEPTH_UNIT = 0.001
"""Default metres of one step of a depth image."""
INCIDENCES = (0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 90.0)
"""Edges of the bins of incidence, degrees."""
N_RANGES = 5
"""Number of bins of range, each with the same number of real points."""
SIGMA_PER_MAD = 1.4826
"""Ratio of standard deviation to median absolute deviation of a normal distribution."""
BOTH, NOT_SCANNED, NOT_SEEN, NEITHER = 0, 1, 2, 3
CASES = ("predicted and scanned", "predicted only", "scanned only", "neither")
COLORS = ("#d0d0d0", "#d55e00", "#0072b2", "")
"""Colours of the cases that are drawn; distinguishable by the colour-blind."""


@dataclass(frozen=True, eq=False)
class ScanComparison:
    """Measures of one real scan against the sensor's prediction; lengths in the mesh's unit, NaN without data.

    Parameters
    ----------
    name : str
    n_real, n_simulated : int
        Numbers of points.
    false_hidden : float
        Fraction of the real points that are more than `slack` behind the mesh.
    cases : (v,) uint8
        Case of each vertex used by a face: 0 predicted and scanned, 1 predicted only, 2 scanned only, 3 neither.
    tolerance : float
        Distance to a real point within which a vertex counts as scanned.
    slack : float
    residual, sigma, sensor_sigma : float
        Median of real minus mesh range along the ray; its spread (1.4826 median absolute deviations); median of the
        standard deviation in the sensor's model.
    by_incidence : tuple of dict
        Vertices by case, spread of residuals, real and simulated points, for each bin of `INCIDENCES`.
    by_range : tuple of dict
        Real and simulated points, for each of five bins of range.
    pose : (4, 4) float
        Scan to mesh, refined where `refine` was set.
    places : (v, 2) float
        Coordinates of these vertices in the sensor's image: degrees, or the mesh's unit for a linear sensor.
    """

    name: str
    n_real: int
    n_simulated: int
    false_hidden: float
    cases: NDArray[np.uint8]
    tolerance: float
    slack: float
    residual: float
    sigma: float
    sensor_sigma: float
    by_incidence: tuple[dict[str, Any], ...]
    by_range: tuple[dict[str, Any], ...]
    pose: FloatArray
    places: FloatArray

    def __repr__(self) -> str:
        return (
            f"ScanComparison({self.name!r}: {format_number(self.agreement, '.1%')} of vertices agree, "
            f"{format_number(self.false_hidden, '.2%')} of {self.n_real} real points hidden)"
        )

    @property
    def agreement(self) -> float:
        """Fraction of the vertices predicted or scanned that are both."""
        return self.share(BOTH)

    def share(self, case: int) -> float:
        """Return the number of vertices of a case, divided by that of the vertices predicted or scanned."""
        return _ratio((self.cases == case).sum(), (self.cases != NEITHER).sum())

    def to_dict(self) -> dict[str, Any]:
        """All measures as plain data, without the vertices."""
        return {
            "name": self.name,
            "points": {"real": self.n_real, "simulated": self.n_simulated},
            "false_hidden": self.false_hidden,
            "vertices": {name: int((self.cases == case).sum()) for case, name in enumerate(CASES)},
            "agreement": _or_none(self.agreement),
            "tolerance": self.tolerance,
            "slack": self.slack,
            "residual": {
                "median": _or_none(self.residual),
                "sigma": _or_none(self.sigma),
                "sensor": _or_none(self.sensor_sigma),
            },
            "by_incidence": [{**span, "sigma": _or_none(span["sigma"])} for span in self.by_incidence],
            "by_range": list(self.by_range),
            "pose": self.pose.tolist(),
        }


def compare_scans(
    mesh: MeshLike,
    scans: Sequence[str | Path | ArrayLike] | str | Path,
    sensor: Sensor | str | Path,
    *,
    poses: str | Path | Sequence[ArrayLike] | None = None,
    sensor_pose: ArrayLike | None = None,
    tolerance: float | None = None,
    slack: float | None = None,
    depth_unit: float | None = None,
    refine: bool = False,
    method: str = "exact",
    seed: int = 0,
) -> list[ScanComparison]:
    """Compare real scans of an object with the scans that a sensor predicts from its mesh.

    Parameters
    ----------
    mesh : mesh, or its path
        The scanned object, in the unit of the scans. The axes of a file are kept. A model of BOP (``obj_000001.ply``
        beside ``models_info.json``) is converted from millimetres to metres.
    scans : sequence of paths, or of (n, 3) float; or a path
        See `scan_files.read_scan_file`.
    sensor : Sensor, name or file
        A sensor as for `zbuf_occlude.sensors.make`. Depth images of BOP (``depth/000000.png`` below
        ``scene_camera.json``) use K and size of their own camera.
    poses : path, or sequence of (4, 4) float, optional
        Pose of each scan, its frame to the mesh's; see `scan_files.read_poses`. Default: the identity.
    sensor_pose : (4, 4) float, optional
        Sensor frame to scan frame, as `zbuf_occlude.sensors.look_at` returns it. Default: the identity.
    tolerance : float, optional
        Distance to a real point within which a vertex counts as scanned. Default: twice the median spacing of points.
    slack : float, optional
        Distance behind the mesh beyond which a real point counts as hidden. Default: four times that spacing.
    depth_unit : float, optional
        Metres of one step of depth images. Default: a millimetre, or for BOP the value in scene_camera.json.
    refine : bool
        Fit each pose to the mesh first (Open3D's ICP, point to plane, within `slack`).
    method : str
        Ray caster.
    seed : int
        Seed of the simulated scans.

    Returns
    -------
    list of ScanComparison

    Raises
    ------
    ArgumentError, OptionError
        Arrays of the wrong shape, or an unknown sensor.
    DatasetError
        A scan or poses that cannot be read.
    UnavailableError
        Open3D (extra ``open3d``) is missing; it finds nearest neighbours.

    Examples
    --------
    >>> wall = ([[0, -1, -1], [0, 1, -1], [0, 1, 1], [0, -1, 1]], [[0, 1, 2], [0, 2, 3]])
    >>> camera = zo.sensors.make("pinhole:width=40,height=40,fov=40")
    >>> seen = zo.scan(wall, camera, range=2)
    >>> mounted = zo.sensors.look_at([2, 0, 0], [0, 0, 0])
    >>> (found,) = zo.compare_scans(wall, [seen.points], camera, sensor_pose=mounted)
    >>> found.false_hidden
    0.0
    """
    model = None
    if isinstance(mesh, str | os.PathLike):
        model = model_number(as_path(mesh, "mesh"))
        mesh = load_mesh(mesh, up="z")  # keep the file's axes: poses refer to them
        if model is not None:
            mesh = mesh.transformed(1.0 / MILLIMETRES)
    mesh, sensor = as_mesh(mesh), make(sensor)
    refine = as_flag(refine, "refine")
    for name, value in (("tolerance", tolerance), ("slack", slack), ("depth_unit", depth_unit)):
        if value is not None:
            as_number(value, name, "a length above 0", lambda length: length > 0.0)
    if isinstance(scans, str | bytes) or not isinstance(scans, Sequence | np.ndarray):
        scans = [as_path(scans, "scans", "Pass paths, or a list of arrays (n, 3).")]
    if not len(scans):
        raise ArgumentError("scans must be one or more; there is none.")
    paths = [Path(each) if isinstance(each, str | os.PathLike) else None for each in scans]
    names = [f"scan {number}" if path is None else path.name for number, path in enumerate(paths)]
    read = [_read_scan(each, path, sensor, depth_unit) for path, each in zip(paths, scans, strict=True)]
    if poses is not None and not isinstance(poses, Iterable):
        poses = as_path(poses, "poses", "Pass a path, or matrices (4, 4).")
    if isinstance(poses, str | os.PathLike):
        poses = read_poses(Path(poses), [path or Path(name) for path, name in zip(paths, names, strict=True)], model)
    matrices = [np.eye(4)] * len(read) if poses is None else [rigid(pose, "a pose") for pose in poses]
    if len(matrices) != len(read):
        raise ArgumentError(f"poses must be one per scan ({len(read)}); got {len(matrices)}.")
    sensor_to_scan = np.eye(4) if sensor_pose is None else rigid(sensor_pose, "sensor_pose")
    with prepare(mesh, method) as occluder:
        comparison = _Comparison(mesh, occluder, sensor_to_scan, tolerance, slack, refine, seed)
        return [
            comparison.run(name, cloud, pose, camera)
            for name, (cloud, camera), pose in zip(names, read, matrices, strict=True)
        ]


def _read_scan(each: Any, path: Path | None, sensor: Sensor, depth_unit: float | None) -> tuple[FloatArray, Sensor]:
    """Return the points of a scan, an array or a file, and its sensor: for a depth image of BOP with its camera."""
    if path is None:
        return as_vectors(each, "a scan"), sensor
    camera = camera_of(path) if path.suffix.lower() == ".png" else None
    if camera is not None:
        sensor = camera.sensor(sensor)
    unit = depth_unit or (camera.depth_unit if camera else DEPTH_UNIT)
    return as_vectors(read_scan_file(path, sensor, unit), f"the points of {escape_control(path.name)}"), sensor


@dataclass(eq=False)
class _Comparison:
    """Mesh, ray caster and options that all scans share."""

    mesh: Mesh
    occluder: VisibilityQuery
    sensor_to_scan: FloatArray
    tolerance: float | None
    slack: float | None
    refine: bool
    seed: int

    def __post_init__(self) -> None:
        mesh, used = self.mesh, np.unique(self.mesh.faces)
        normals = np.zeros_like(mesh.vertices)
        for corner in range(3):
            np.add.at(normals, mesh.faces[:, corner], mesh.face_normals)
        self.vertices, self.outward = mesh.vertices[used], outward(mesh)
        self.normals = unit_vectors(normals[used] * (self.outward or 1.0))

    def run(self, name: str, cloud: FloatArray, pose: FloatArray, sensor: Sensor) -> ScanComparison:
        """Compare one scan."""
        cloud = cloud[(cloud != self.sensor_to_scan[:3, 3]).any(axis=1)]  # a point at the sensor has no direction
        if not len(cloud):
            raise ArgumentError(f"a scan must have points; {escape_control(name)} has none.")
        spacing = float(np.median(_distances(cloud, cloud, 2)[:, 1]))
        if not (spacing > 0.0 or (self.tolerance and self.slack)):
            raise ArgumentError(
                f"All points of {escape_control(name)} coincide; a scan must have points apart from each other. "
                "Give tolerance and slack."
            )
        tolerance = self.tolerance or 2.0 * spacing
        slack = self.slack or 4.0 * spacing
        if self.slack is None and slack > self.mesh.longest_side:
            fault = f"the points are {spacing:.3g} apart, over a quarter of the size of the mesh"
            raise ArgumentError(_too_far(name, fault, cloud, self.mesh))
        if self.refine:
            pose = self._refine(cloud, pose, slack)
        points = cloud @ pose[:3, :3].T + pose[:3, 3]
        sensor_to_mesh = pose @ self.sensor_to_scan
        starts, towards, ranges = _rays(points, sensor_to_mesh, sensor)
        hits = self.occluder.first_hits(starts, towards)
        residuals = ranges - hits.distances
        hidden = residuals > slack
        near = np.abs(residuals) <= slack
        cosines = self._incidence_cosines(hits.face_ids[near], towards[near])
        incidences = np.degrees(np.arccos(np.clip(cosines, 0.0, 1.0)))
        seen, vertex_incidences = self._predict(sensor_to_mesh, sensor)
        scanned = _distances(self.vertices, points, 1)[:, 0] <= tolerance
        if not (near.any() or scanned.any()):
            raise ArgumentError(_too_far(name, f"no point is within {slack:.3g}", points, self.mesh))
        cases = np.select([seen & scanned, seen, scanned], [BOTH, NOT_SCANNED, NOT_SEEN], NEITHER).astype(np.uint8)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the sensor may be inside the bounding box
            simulated = scan(Scene.from_mesh(self.mesh), sensor, sensor_to_mesh, seed=self.seed, occluder=self.occluder)
        middle, sigma = _spread(residuals[near])
        sensor_sigma = sensor.noise_model.range_sigma(ranges[near], np.radians(incidences))
        return ScanComparison(
            name=name,
            n_real=len(points),
            n_simulated=len(simulated),
            false_hidden=float(hidden.mean()),
            cases=cases,
            tolerance=tolerance,
            slack=slack,
            residual=middle,
            sigma=sigma,
            sensor_sigma=_median(sensor_sigma),
            by_incidence=tuple(
                {
                    "from": low,
                    "to": high,
                    **_count_cases(cases, vertex_incidences, low, high),
                    "sigma": _spread(residuals[near][_within(incidences, low, high)])[1],
                    **_count_points(incidences, np.degrees(simulated.incidences), low, high),
                }
                for low, high in pairwise(INCIDENCES)
            ),
            by_range=tuple(_by_range(ranges, simulated.ranges)),
            pose=pose,
            places=self._sensor_coordinates(sensor_to_mesh, sensor),
        )

    def _incidence_cosines(self, face_ids: NDArray[np.int32], directions: FloatArray) -> FloatArray:
        normals = self.mesh.face_normals[face_ids]
        lengths = np.maximum(np.linalg.norm(normals, axis=1), np.finfo(np.float64).tiny)
        return np.asarray(np.abs(np.einsum("ij,ij->i", normals, directions)) / lengths)

    def _predict(self, sensor_to_mesh: FloatArray, sensor: Sensor) -> tuple[BoolArray, FloatArray]:
        """Return which vertices the sensor should return, and the incidences of all, degrees."""
        model, rotation = sensor.noise_model, sensor_to_mesh[:3, :3]
        starts, towards, ranges = _rays(self.vertices, sensor_to_mesh, sensor)
        local = (self.vertices - sensor_to_mesh[:3, 3]) @ rotation
        side = -np.einsum("ij,ij->i", self.normals, towards)
        cosines = side if self.outward else np.abs(side)
        seen = sensor.covers(local) & (cosines > np.cos(np.radians(model.incidence_max)))
        measured = ranges * (towards @ rotation[:, 0]) if model.axial else ranges
        seen &= (measured >= model.range_min) & (measured <= model.range_max)
        seen &= self._unoccluded(starts, seen)
        second = np.zeros_like(seen)
        for baseline in model.baselines:
            eyes = starts + rotation @ baseline
            away = eyes - self.vertices
            slope = np.einsum("ij,ij->i", self.normals, away) / np.linalg.norm(away, axis=1) * np.sign(side)
            lit = seen & (slope > np.cos(np.radians(model.baseline_incidence_max)))
            if sensor.kind == "pinhole":
                lit &= sensor.covers(-away @ rotation)
            second |= lit & self._unoccluded(eyes, lit)
        if len(model.baselines):
            seen = second
        return seen, np.degrees(np.arccos(np.clip(cosines, 0.0, 1.0)))

    def _unoccluded(self, eyes: FloatArray, asked: BoolArray) -> BoolArray:
        """Return which of the vertices in the mask `asked` nothing occludes, each from its own eye."""
        some, found = np.flatnonzero(asked), np.zeros(len(asked), dtype=bool)
        if len(some):
            towards = self.vertices[some] - eyes[some]
            away = np.linalg.norm(towards, axis=1)
            distances = self.occluder.first_hits(eyes[some], towards / away[:, None]).distances
            found[some] = distances >= away - SELF_HIT_SLACK * self.mesh.diagonal
        return found

    def _sensor_coordinates(self, sensor_to_mesh: FloatArray, sensor: Sensor) -> FloatArray:
        local = (self.vertices - sensor_to_mesh[:3, 3]) @ sensor_to_mesh[:3, :3]
        if sensor.kind == "linear":
            return np.stack([-local[:, 1], local[:, 2]], axis=1)
        flat = np.hypot(local[:, 0], local[:, 1])
        return np.degrees([-np.arctan2(local[:, 1], local[:, 0]), np.arctan2(local[:, 2], flat)]).T

    def _refine(self, cloud: FloatArray, pose: FloatArray, slack: float) -> FloatArray:
        with importing("open3d", "refining poses"):
            import open3d as o3d
        source = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(cloud))
        target = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(self.vertices))
        target.normals = o3d.utility.Vector3dVector(self.normals)
        way = o3d.pipelines.registration.TransformationEstimationPointToPlane()
        found = o3d.pipelines.registration.registration_icp(source, target, slack, pose, way)
        return rigid(found.transformation, "a refined pose")


SELF_HIT_SLACK = 4e-4
"""Distance before a vertex within which faces do not occlude it (its own do), in diagonals of the mesh."""


def outward(mesh: Mesh) -> float:
    """Return 1.0 where normals point out of the body, -1.0 where they point into it, 0.0 without a consistent winding.

    A scan shows no inner sides, although they are visible through holes of the mesh.
    """
    edges = mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2).astype(np.int64)
    there, back = edges @ [len(mesh.vertices), 1], edges @ [1, len(mesh.vertices)]
    if np.isin(there, back).mean() < CONSISTENT_WINDING or len(np.unique(there)) < CONSISTENT_WINDING * len(there):
        return 0.0
    a, b, c = np.moveaxis(mesh.corners - mesh.centre, 1, 0)
    return float(np.sign(np.einsum("ij,ij->", a, np.cross(b, c))))


CONSISTENT_WINDING = 0.9
"""Minimum fraction of edges with two faces of opposite direction in a consistently wound mesh."""


def _rays(points: FloatArray, sensor_to_mesh: FloatArray, sensor: Sensor) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the origins (n, 3), unit directions (n, 3) and lengths (n,) of the rays to some points."""
    local = (points - sensor_to_mesh[:3, 3]) @ sensor_to_mesh[:3, :3]
    starts = sensor_to_mesh[:3, 3] + sensor.ray_starts(local) @ sensor_to_mesh[:3, :3].T
    ranges = np.linalg.norm(points - starts, axis=1)
    return starts, (points - starts) / np.maximum(ranges, np.finfo(np.float64).tiny)[:, None], ranges


def _distances(positions: FloatArray, points: FloatArray, n: int) -> FloatArray:
    """Return the distances (m, n) from positions (m, 3) to their n nearest points."""
    with importing("open3d", "comparing scans"):
        import open3d as o3d
    tensor: Any = o3d.core.Tensor
    index = o3d.core.nns.NearestNeighborSearch(tensor(np.ascontiguousarray(points)))
    index.knn_index()
    _, squares = index.knn_search(tensor(np.ascontiguousarray(positions)), min(n, len(points)))
    found = np.sqrt(squares.numpy())
    return np.pad(found, ((0, 0), (0, n - found.shape[1])), mode="edge")


def _within(values: FloatArray, low: float, high: float) -> BoolArray:
    return np.asarray((values >= low) & (values < high))


def _count_cases(cases: NDArray[np.uint8], incidences: FloatArray, low: float, high: float) -> dict[str, int]:
    mine = cases[_within(incidences, low, high)]
    return {name: int((mine == case).sum()) for case, name in enumerate(CASES[:NEITHER])}


def _count_points(real: FloatArray, simulated: FloatArray, low: float, high: float) -> dict[str, int]:
    return {"real": int(_within(real, low, high).sum()), "simulated": int(_within(simulated, low, high).sum())}


def _by_range(real: FloatArray, simulated: FloatArray) -> list[dict[str, Any]]:
    edges = np.quantile(real, np.linspace(0.0, 1.0, N_RANGES + 1))
    edges[-1] = np.nextafter(edges[-1], np.inf)
    return [
        {"from": float(low), "to": float(high), **_count_points(real, simulated, low, high)}
        for low, high in pairwise(edges)
    ]


def _too_far(name: str, fault: str, points: FloatArray, mesh: Mesh) -> str:
    """Return the error text for a scan that is far from the mesh, with both sizes and a likely cause."""
    size, scanned = mesh.longest_side, float(np.ptp(points, axis=0).max())
    factor = 10.0 ** np.round(np.log10(size / scanned)) if size > 0.0 < scanned else 1.0
    why = "Give its pose and the pose of the sensor, or a larger slack."
    if factor != 1.0:
        times = f"{factor:,.0f} times as large" if factor > 1.0 else f"{1.0 / factor:,.0f} times smaller"
        why = f"The mesh is about {times}: the units may differ. Scale it by {1.0 / factor:g}, or give poses."
    return (
        f"a scan must be near the mesh; in {escape_control(name)} {fault}. The longest side of the scan is "
        f"{scanned:.4g}, of the mesh {size:.4g}. {why}"
    )


def _median(values: FloatArray) -> float:
    return float(np.median(values)) if len(values) else np.nan


def _spread(values: FloatArray) -> tuple[float, float]:
    """Return the median, and the standard deviation estimated from the median absolute deviation."""
    middle = _median(values)
    return middle, SIGMA_PER_MAD * _median(np.abs(values - middle))


def _ratio(part: Any, whole: Any) -> float:
    return float(part / whole) if whole else np.nan


def _or_none(value: float) -> float | None:
    """Return a number for JSON, None in place of NaN."""
    return None if np.isnan(value) else value


def format_number(value: float, form: str) -> str:
    """Format a number; NaN as a dash."""
    return NONE if np.isnan(value) else f"{value:{form}}"


def write_scan_report(folder: Path, found: Sequence[ScanComparison], sensor: Sensor) -> list[Path]:
    """Write ``scans.html``, ``scans.md``, ``scans.json`` and a picture of each scan; return their paths."""
    folder.mkdir(parents=True, exist_ok=True)
    data = folder / "scans.json"
    document = {"sensor": sensor.to_dict(), "scans": [each.to_dict() for each in found]}
    text = json.dumps(document, indent=1) + "\n"
    atomic.write(data, lambda file: file.write(text.encode()))
    agreements = np.array([each.agreement for each in found])
    known = agreements[~np.isnan(agreements)]
    mean, hidden = (float(np.mean(each)) if len(each) else np.nan for each in (known, [e.false_hidden for e in found]))
    pictures = [Picture(f"scan_{i}", as_png(draw_cases(each)), verbatim(each.name)) for i, each in enumerate(found)]
    sections: list[Section] = [_table_of_scans(found), *pictures, _table_by_incidence(found), _table_by_range(found)]
    answers = [
        f"Mean agreement with **{verbatim(sensor.name)}** ({len(known)} of {len(found)} scans): "
        f"{format_number(mean, '.1%')} of the "
        "vertices predicted or scanned are both.",
        f"The mesh hides {hidden:.2%} of the real points.",
    ]
    facts = [
        "A vertex counts as scanned where a real point is within the tolerance. A real point counts as hidden where "
        "the mesh is more than the slack before it. Lengths are in the mesh's unit."
    ]
    title = "Real scans against simulated ones"
    return [data, *write_pages(folder, "scans", title, answers=answers, facts=facts, sections=sections)]


def _table_of_scans(found: Sequence[ScanComparison]) -> Table:
    columns: dict[str, Callable[[ScanComparison], str]] = {
        "scan": lambda each: verbatim(each.name),
        "points": lambda each: f"{each.n_real:,}",
        "simulated": lambda each: f"{each.n_simulated:,}",
        "agreement": lambda each: format_number(each.agreement, ".1%"),
        "predicted only": lambda each: format_number(each.share(NOT_SCANNED), ".1%"),
        "scanned only": lambda each: format_number(each.share(NOT_SEEN), ".1%"),
        "hidden": lambda each: format_number(each.false_hidden, ".2%"),
        "residual": lambda each: format_number(each.residual, ".2g"),
        "spread": lambda each: format_number(each.sigma, ".2g"),
    }
    one = found[0]
    note = (
        f"Tolerance {one.tolerance:.3g} and slack {one.slack:.3g} in the first scan. Agreement, predicted only, "
        "scanned only: fractions of the vertices predicted or scanned. Hidden: fraction of the real points. Residual: "
        "median of real minus mesh range along the ray. Spread: its standard deviation; the sensor's model has "
        f"{format_number(one.sensor_sigma, '.2g')} in the first scan."
    )
    return Table("Scans", list(columns), [[cell(each) for cell in columns.values()] for each in found], note)


def _table_by_incidence(found: Sequence[ScanComparison]) -> Table:
    rows = []
    for number, first in enumerate(found[0].by_incidence):
        spans = [each.by_incidence[number] for each in found]
        counts = [sum(span[name] for span in spans) for name in CASES[:NEITHER]]
        shares = (format_number(_ratio(count, sum(counts)), ".1%") for count in counts)
        sigma = _median(np.array([span["sigma"] for span in spans if not np.isnan(span["sigma"])]))
        rows.append(
            (f"{first['from']:g} to {first['to']:g}", *shares, format_number(sigma, ".2g"), *_density_cells(spans))
        )
    header = ("degrees", *CASES[:NEITHER], "spread", *DENSITY_COLUMNS)
    return Table(
        "By incidence", header, rows, "Fractions of the vertices predicted or scanned; points within the slack."
    )


def _table_by_range(found: Sequence[ScanComparison]) -> Table:
    rows = []
    for number in range(N_RANGES):
        spans = [each.by_range[number] for each in found]
        low, high = min(span["from"] for span in spans), max(span["to"] for span in spans)
        rows.append((f"{number + 1} of {N_RANGES}", f"{low:.4g} to {high:.4g}", *_density_cells(spans)))
    note = "Real points of each scan by range, nearest first, in parts of equal numbers of points."
    return Table("By range", ("part", "ranges", *DENSITY_COLUMNS), rows, note, texts=(0, 1))


DENSITY_COLUMNS = ("points", "simulated", "real / simulated")


def _density_cells(spans: Sequence[dict[str, Any]]) -> tuple[str, str, str]:
    real, simulated = (sum(span[name] for span in spans) for name in ("real", "simulated"))
    return f"{real:,}", f"{simulated:,}", format_number(_ratio(real, simulated), ".2f")


def draw_cases(found: ScanComparison) -> Any:
    """Plot the vertices of the mesh in the sensor's image, coloured by case."""
    with importing("matplotlib", "pictures"):
        from zbuf_occlude.drawing.pictures import canvas
    picture, (axes,) = canvas(8, 6.5)
    size = float(np.clip(60_000 / max((found.cases != NEITHER).sum(), 1), 1.0, 14.0))
    for case in (BOTH, NOT_SCANNED, NOT_SEEN):
        label = f"{CASES[case]}: {format_number(found.share(case), '.1%')}"
        across, up = found.places[found.cases == case].T
        axes.scatter(across, up, s=size, c=COLORS[case], label=label, lw=0)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_axis_off()
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, 0.0), ncols=3, markerscale=3, frameon=False, fontsize=9)
    return picture
