"""How real simulated scans are: real scans of an object, its mesh and poses, against what a sensor predicts.

For each scan four answers: how many real points the mesh hides (visibility), which vertices were scanned and which the
sensor should have returned (coverage), how far real points are from the mesh along their rays (noise), and how many
points there are by range and incidence (density). A figure without data is NaN: null in JSON, a dash in the report.
"""

import json
import os
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zbuf_occlude.arrays import BoolArray, FloatArray, as_flag, as_number, as_vectors
from zbuf_occlude.compare.bop_folder import camera_of, model_number
from zbuf_occlude.compare.scan_files import read_poses, read_scan_file, rigid
from zbuf_occlude.dataset import atomic
from zbuf_occlude.drawing.pages import Picture, Section, Table, as_png, verbatim, write_pages
from zbuf_occlude.errors import ArgumentError, escape_control
from zbuf_occlude.extras import importing
from zbuf_occlude.geometry.mesh import Mesh, MeshLike, as_mesh
from zbuf_occlude.meshes.load import load_mesh
from zbuf_occlude.scenes.scene import Scene
from zbuf_occlude.sensors.bop import MILLIMETRES
from zbuf_occlude.sensors.catalog import make
from zbuf_occlude.sensors.scanning import default_caster, scan
from zbuf_occlude.sensors.sensor import Sensor
from zbuf_occlude.visibility import find_method, prepare
from zbuf_occlude.visibility.interface import VisibilityQuery

DEPTH_UNIT = 0.001
"""Metres of one step of a depth image, of which nothing is said."""
INCIDENCES = (0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 90.0)
"""Degrees between which incidences are counted together."""
N_RANGES = 5
"""So many spans of range, with as many real points each."""
MADS = 1.4826
"""A normal distribution's standard deviation over its median absolute deviation."""
BOTH, NOT_SCANNED, NOT_SEEN, NEITHER = 0, 1, 2, 3
CASES = ("predicted and scanned", "predicted only", "scanned only", "neither")
NONE = "–"
"""Where a figure has no data."""
COLORS = ("#d0d0d0", "#d55e00", "#0072b2", "")
"""Of the cases that are drawn; told apart by the colour-blind."""


@dataclass(frozen=True, eq=False)
class ScanComparison:
    """One real scan against what a sensor predicts of it; lengths in the mesh's unit, NaN where nothing was counted.

    Parameters
    ----------
    name : str
    n_real, n_simulated : int
        Points.
    false_hidden : float
        Share of the real points before which, by more than `slack`, the mesh lies.
    cases : (v,) uint8
        Of each vertex that a face uses: 0 predicted and scanned, 1 predicted only, 2 scanned only, 3 neither.
    tolerance : float
        A vertex is scanned where a real point is this near.
    slack : float
    residual, sigma, sensor_sigma : float
        Median of real minus mesh along the ray; its spread (1.4826 median absolute deviations); what the sensor's
        model says in the median.
    by_incidence : tuple of dict
        For each span of `INCIDENCES`: vertices by case, spread of residuals, real and simulated points.
    by_range : tuple of dict
        For each of five spans of range: real and simulated points.
    pose : (4, 4) float
        Scan to mesh, refined where that was asked for.
    places : (v, 2) float
        Where the sensor has those vertices in its picture: degrees, or of a linear sensor the mesh's unit.
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
            f"ScanComparison({self.name!r}: {figure(self.agreement, '.1%')} of vertices agree, "
            f"{figure(self.false_hidden, '.2%')} of {self.n_real} real points hidden)"
        )

    @property
    def agreement(self) -> float:
        """The share of the vertices predicted or scanned that are both."""
        return self.share(BOTH)

    def share(self, case: int) -> float:
        """Return how many vertices are of a case, over those predicted or scanned."""
        return _ratio((self.cases == case).sum(), (self.cases != NEITHER).sum())

    def to_dict(self) -> dict[str, Any]:
        """Plain data of everything but the vertices."""
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
    method: str | None = None,
    seed: int = 0,
) -> list[ScanComparison]:
    """Compare real scans of an object with what a sensor predicts of its mesh.

    Parameters
    ----------
    mesh : mesh, or its path
        The scanned object, in the unit of the scans. A file's own axes are kept, whatever is up in it. A model of BOP
        (``obj_000001.ply`` beside ``models_info.json``) is turned from millimetres into metres.
    scans : sequence of paths, or of (n, 3) float; or a path
        See `scan_files.read_scan_file`.
    sensor : Sensor, name or file
        As `zbuf_occlude.sensors.make` takes it. Depth images of BOP (``depth/000000.png`` below ``scene_camera.json``)
        have their camera's K and size instead of the sensor's.
    poses : path, or sequence of (4, 4) float, optional
        Of each scan, its frame to the mesh's; see `scan_files.read_poses`. By default they share one.
    sensor_pose : (4, 4) float, optional
        Sensor frame to the scans'; `zbuf_occlude.sensors.look_at` makes one. By default the scans are in its frame.
    tolerance : float, optional
        A vertex is scanned where a real point is this near; twice the median spacing of the scan's points by default.
    slack : float, optional
        A real point is hidden where the mesh is this far before it; four times that spacing by default.
    depth_unit : float, optional
        Of depth images: metres of one step; by default a millimetre, or of BOP what scene_camera.json says.
    refine : bool
        Fit each pose to the mesh first (Open3D's ICP, point to plane, within `slack`).
    method : str, optional
        Who casts rays.
    seed : int
        Of the simulated scans.

    Returns
    -------
    list of ScanComparison

    Raises
    ------
    ArgumentError, OptionError
        Arrays of the wrong shape, no such sensor.
    DatasetError
        A scan or poses that cannot be read.
    UnavailableError
        Without Open3D (extra ``open3d``), which finds neighbours.

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
        model = model_number(Path(mesh))
        mesh = load_mesh(mesh, up="z")  # its own axes, which the poses lead to
        if model is not None:
            mesh = mesh.transformed(1.0 / MILLIMETRES)
    mesh, sensor = as_mesh(mesh), make(sensor)
    refine = as_flag(refine, "refine")
    if method is not None:
        find_method(method)  # for its error
    for name, value in (("tolerance", tolerance), ("slack", slack), ("depth_unit", depth_unit)):
        if value is not None:
            as_number(value, name, "a length above 0", lambda length: length > 0.0)
    scans = [scans] if isinstance(scans, str | Path) else scans
    if not len(scans):
        raise ArgumentError("scans must be one or more; there is none.")
    paths = [Path(each) if isinstance(each, str | Path) else None for each in scans]
    names = [f"scan {number}" if path is None else path.name for number, path in enumerate(paths)]
    clouds, sensors = list[FloatArray](), list[Sensor]()
    for path, each in zip(paths, scans, strict=True):
        camera = camera_of(path) if path is not None and path.suffix.lower() == ".png" else None
        sensors.append(sensor if camera is None else camera.sensor(sensor))
        if path is None:
            clouds.append(as_vectors(cast(Any, each), "a scan"))
        else:
            unit = depth_unit or (camera.depth_unit if camera else DEPTH_UNIT)
            clouds.append(
                as_vectors(read_scan_file(path, sensors[-1], unit), f"the points of {escape_control(path.name)}")
            )
    if isinstance(poses, str | Path):
        poses = read_poses(Path(poses), [path or Path(name) for path, name in zip(paths, names, strict=True)], model)
    matrices = [np.eye(4)] * len(clouds) if poses is None else [rigid(pose, "a pose") for pose in poses]
    if len(matrices) != len(clouds):
        raise ArgumentError(f"poses must be one per scan ({len(clouds)}); got {len(matrices)}.")
    mounted = np.eye(4) if sensor_pose is None else rigid(sensor_pose, "sensor_pose")
    with prepare(mesh, method or default_caster()) as occluder:
        question = _Question(mesh, occluder, mounted, tolerance, slack, refine, seed)
        return [question.ask(*each) for each in zip(names, clouds, matrices, sensors, strict=True)]


@dataclass(eq=False)
class _Question:
    """What is the same for all scans."""

    mesh: Mesh
    occluder: VisibilityQuery
    mounted: FloatArray
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
        normals = normals[used] * (self.outward or 1.0)
        self.normals = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), np.finfo(np.float64).tiny)

    def ask(self, name: str, cloud: FloatArray, pose: FloatArray, sensor: Sensor) -> ScanComparison:
        """Compare one scan."""
        cloud = cloud[(cloud != self.mounted[:3, 3]).any(axis=1)]  # what is in the sensor itself has no direction
        if not len(cloud):
            raise ArgumentError(f"a scan must have points; {escape_control(name)} has none.")
        spacing = float(np.median(_distances(cloud, cloud, 2)[:, 1]))
        if not (spacing > 0.0 or (self.tolerance and self.slack)):
            raise ArgumentError(
                f"a scan must have points apart from each other; {escape_control(name)} has not. "
                "Give tolerance and slack."
            )
        tolerance = self.tolerance or 2.0 * spacing
        slack = self.slack or 4.0 * spacing
        if self.slack is None and slack > self.mesh.longest_side:
            fault = f"the points are {spacing:.3g} apart, so that any mesh of this size were near"
            raise ArgumentError(_apart(name, fault, cloud, self.mesh))
        if self.refine:
            pose = self._refined(cloud, pose, slack)
        points = cloud @ pose[:3, :3].T + pose[:3, 3]
        stands = pose @ self.mounted
        starts, towards, ranges = _rays(points, stands, sensor)
        hits = self.occluder.first_hits(starts, towards)
        residuals = ranges - hits.distances
        hidden = residuals > slack
        near = np.abs(residuals) <= slack
        cosines = self._cosines(hits.face_ids[near], towards[near])
        incidences = np.degrees(np.arccos(np.clip(cosines, 0.0, 1.0)))
        seen, vertex_incidences = self._predicted(stands, sensor)
        scanned = _distances(self.vertices, points, 1)[:, 0] <= tolerance
        if not (near.any() or scanned.any()):
            raise ArgumentError(_apart(name, f"no point is within {slack:.3g}", points, self.mesh))
        cases = np.select([seen & scanned, seen, scanned], [BOTH, NOT_SCANNED, NOT_SEEN], NEITHER).astype(np.uint8)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # within the bounding box of a street, say
            made = scan(Scene.from_mesh(self.mesh), sensor, stands, seed=self.seed, occluder=self.occluder)
        middle, sigma = _spread(residuals[near])
        sensor_sigma = sensor.noise_model.range_sigma(ranges[near], np.radians(incidences))
        return ScanComparison(
            name=name,
            n_real=len(points),
            n_simulated=len(made),
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
                    **_counted(cases, vertex_incidences, low, high),
                    "sigma": _spread(residuals[near][_within(incidences, low, high)])[1],
                    **_numbers(incidences, np.degrees(made.incidences), low, high),
                }
                for low, high in pairwise(INCIDENCES)
            ),
            by_range=tuple(_by_range(ranges, made.ranges)),
            pose=pose,
            places=self._picture(stands, sensor),
        )

    def _cosines(self, face_ids: NDArray[np.int32], directions: FloatArray) -> FloatArray:
        normals = self.mesh.face_normals[face_ids]
        lengths = np.maximum(np.linalg.norm(normals, axis=1), np.finfo(np.float64).tiny)
        return np.asarray(np.abs(np.einsum("ij,ij->i", normals, directions)) / lengths)

    def _predicted(self, stands: FloatArray, sensor: Sensor) -> tuple[BoolArray, FloatArray]:
        """Which vertices the sensor should return, and their incidences, degrees."""
        faults, rotation = sensor.noise_model, stands[:3, :3]
        starts, towards, ranges = _rays(self.vertices, stands, sensor)
        local = (self.vertices - stands[:3, 3]) @ rotation
        side = -np.einsum("ij,ij->i", self.normals, towards)
        cosines = side if self.outward else np.abs(side)
        seen = sensor.covers(local) & (cosines > np.cos(np.radians(faults.incidence_max)))
        measured = ranges * (towards @ rotation[:, 0]) if faults.axial else ranges
        seen &= (measured >= faults.range_min) & (measured <= faults.range_max)
        seen &= self._reached(starts, seen)
        second = np.zeros_like(seen)
        for baseline in faults.baselines:
            eyes = starts + rotation @ baseline
            away = eyes - self.vertices
            slope = np.einsum("ij,ij->i", self.normals, away) / np.linalg.norm(away, axis=1) * np.sign(side)
            lit = seen & (slope > np.cos(np.radians(faults.baseline_incidence_max)))
            if sensor.kind == "pinhole":
                lit &= sensor.covers(-away @ rotation)
            second |= lit & self._reached(eyes, lit)
        if len(faults.baselines):
            seen = second
        return seen, np.degrees(np.arccos(np.clip(cosines, 0.0, 1.0)))

    def _reached(self, eyes: FloatArray, asked: BoolArray) -> BoolArray:
        """Which of the vertices asked about nothing stands before, from an eye each."""
        some, found = np.flatnonzero(asked), np.zeros(len(asked), dtype=bool)
        if len(some):
            towards = self.vertices[some] - eyes[some]
            away = np.linalg.norm(towards, axis=1)
            distances = self.occluder.first_hits(eyes[some], towards / away[:, None]).distances
            found[some] = distances >= away - VERTEX_SLACK * self.mesh.diagonal
        return found

    def _picture(self, stands: FloatArray, sensor: Sensor) -> FloatArray:
        local = (self.vertices - stands[:3, 3]) @ stands[:3, :3]
        if sensor.kind == "linear":
            return np.stack([-local[:, 1], local[:, 2]], axis=1)
        flat = np.hypot(local[:, 0], local[:, 1])
        return np.degrees([-np.arctan2(local[:, 1], local[:, 0]), np.arctan2(local[:, 2], flat)]).T

    def _refined(self, cloud: FloatArray, pose: FloatArray, slack: float) -> FloatArray:
        with importing("open3d", "refining poses"):
            import open3d as o3d
        source = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(cloud))
        target = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(self.vertices))
        target.normals = o3d.utility.Vector3dVector(self.normals)
        way = o3d.pipelines.registration.TransformationEstimationPointToPlane()
        found = o3d.pipelines.registration.registration_icp(source, target, slack, pose, way)
        return rigid(found.transformation, "a refined pose")


VERTEX_SLACK = 4e-4
"""Of the mesh's diagonal: so far before a vertex other faces may lie, as those about it do."""


def outward(mesh: Mesh) -> float:
    """Return 1.0 where faces are wound so that normals point out of the body, -1.0 where into it, 0.0 where neither.

    Through the holes of a mesh one sees its inside, which the object does not have.
    """
    edges = mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2).astype(np.int64)
    there, back = edges @ [len(mesh.vertices), 1], edges @ [1, len(mesh.vertices)]
    if np.isin(there, back).mean() < WOUND or len(np.unique(there)) < WOUND * len(there):
        return 0.0
    a, b, c = np.moveaxis(mesh.corners - mesh.centre, 1, 0)
    return float(np.sign(np.einsum("ij,ij->", a, np.cross(b, c))))


WOUND = 0.9
"""Of a mesh that is wound one way: least share of its edges that two faces have in opposite directions."""


def _rays(points: FloatArray, stands: FloatArray, sensor: Sensor) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return where the rays to some points begin (n, 3), their unit directions, and how long they are."""
    local = (points - stands[:3, 3]) @ stands[:3, :3]
    starts = stands[:3, 3] + sensor.ray_starts(local) @ stands[:3, :3].T
    ranges = np.linalg.norm(points - starts, axis=1)
    return starts, (points - starts) / np.maximum(ranges, np.finfo(np.float64).tiny)[:, None], ranges


def _distances(places: FloatArray, points: FloatArray, n: int) -> FloatArray:
    """Return the distances (m, n) from places (m, 3) to their n nearest points."""
    with importing("open3d", "comparing scans"):
        import open3d as o3d
    tensor: Any = o3d.core.Tensor
    index = o3d.core.nns.NearestNeighborSearch(tensor(np.ascontiguousarray(points)))
    index.knn_index()
    _, squares = index.knn_search(tensor(np.ascontiguousarray(places)), min(n, len(points)))
    found = np.sqrt(squares.numpy())
    return np.pad(found, ((0, 0), (0, n - found.shape[1])), mode="edge")


def _within(values: FloatArray, low: float, high: float) -> BoolArray:
    return np.asarray((values >= low) & (values < high))


def _counted(cases: NDArray[np.uint8], incidences: FloatArray, low: float, high: float) -> dict[str, int]:
    mine = cases[_within(incidences, low, high)]
    return {name: int((mine == case).sum()) for case, name in enumerate(CASES[:NEITHER])}


def _numbers(real: FloatArray, made: FloatArray, low: float, high: float) -> dict[str, int]:
    return {"real": int(_within(real, low, high).sum()), "simulated": int(_within(made, low, high).sum())}


def _by_range(real: FloatArray, made: FloatArray) -> list[dict[str, Any]]:
    edges = np.quantile(real, np.linspace(0.0, 1.0, N_RANGES + 1))
    edges[-1] = np.nextafter(edges[-1], np.inf)
    return [{"from": float(low), "to": float(high), **_numbers(real, made, low, high)} for low, high in pairwise(edges)]


def _apart(name: str, fault: str, points: FloatArray, mesh: Mesh) -> str:
    """Say that a scan is not of a mesh, how large both are, and what may be why."""
    size, scanned = mesh.longest_side, float(np.ptp(points, axis=0).max())
    factor = 10.0 ** np.round(np.log10(size / scanned)) if size > 0.0 < scanned else 1.0
    why = "Give its pose, and where the sensor is; or a larger slack."
    if factor != 1.0:
        times = f"{factor:,.0f} times as large" if factor > 1.0 else f"{1.0 / factor:,.0f} times smaller"
        why = f"The mesh is about {times}: are the units mixed? Scale it by {1.0 / factor:g}, or give poses."
    return (
        f"a scan must be near the mesh; of {escape_control(name)} {fault}. The longest side of the scan is "
        f"{scanned:.4g}, of the mesh {size:.4g}. {why}"
    )


def _median(values: FloatArray) -> float:
    return float(np.median(values)) if len(values) else np.nan


def _spread(values: FloatArray) -> tuple[float, float]:
    """Return the median, and the standard deviation of a normal distribution of the same spread."""
    middle = _median(values)
    return middle, MADS * _median(np.abs(values - middle))


def _ratio(part: Any, whole: Any) -> float:
    return float(part / whole) if whole else np.nan


def _or_none(value: float) -> float | None:
    """Return a figure as JSON has it, which knows no NaN."""
    return None if np.isnan(value) else value


def figure(value: float, form: str) -> str:
    """Write a figure; a dash where there is none."""
    return NONE if np.isnan(value) else f"{value:{form}}"


def write_scan_report(folder: Path, found: Sequence[ScanComparison], sensor: Sensor) -> list[Path]:
    """Write ``scans.html`` and ``.md``, a picture for each scan, and ``scans.json``; return their paths."""
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
        f"Of the vertices that **{verbatim(sensor.name)}** predicts or that were scanned {figure(mean, '.1%')} are "
        f"both, in the mean of {len(known)} scans.",
        f"The mesh hides {hidden:.2%} of the real points.",
    ]
    facts = [
        "A vertex is scanned where a real point is within the tolerance. A real point is hidden where the mesh lies "
        "more than the slack before it. Lengths are in the mesh's unit."
    ]
    title = "Real scans against simulated ones"
    return [data, *write_pages(folder, "scans", title, answers=answers, facts=facts, sections=sections)]


def _table_of_scans(found: Sequence[ScanComparison]) -> Table:
    columns: dict[str, Callable[[ScanComparison], str]] = {
        "scan": lambda each: verbatim(each.name),
        "points": lambda each: f"{each.n_real:,}",
        "simulated": lambda each: f"{each.n_simulated:,}",
        "agreement": lambda each: figure(each.agreement, ".1%"),
        "predicted only": lambda each: figure(each.share(NOT_SCANNED), ".1%"),
        "scanned only": lambda each: figure(each.share(NOT_SEEN), ".1%"),
        "hidden": lambda each: figure(each.false_hidden, ".2%"),
        "residual": lambda each: figure(each.residual, ".2g"),
        "spread": lambda each: figure(each.sigma, ".2g"),
    }
    one = found[0]
    note = (
        f"Tolerance {one.tolerance:.3g} and slack {one.slack:.3g} in the first scan. Agreement, predicted only and "
        "scanned only: of the vertices predicted or scanned. Hidden: of the real points. Residual: median of real "
        "minus mesh along the ray; its spread is a standard deviation, where the sensor's model has "
        f"{figure(one.sensor_sigma, '.2g')}."
    )
    return Table("Scans", list(columns), [[cell(each) for cell in columns.values()] for each in found], note)


def _table_by_incidence(found: Sequence[ScanComparison]) -> Table:
    rows = []
    for number, first in enumerate(found[0].by_incidence):
        spans = [each.by_incidence[number] for each in found]
        counts = [sum(span[name] for span in spans) for name in CASES[:NEITHER]]
        shares = (figure(_ratio(count, sum(counts)), ".1%") for count in counts)
        sigma = _median(np.array([span["sigma"] for span in spans if not np.isnan(span["sigma"])]))
        rows.append((f"{first['from']:g} to {first['to']:g}", *shares, figure(sigma, ".2g"), *_densities(spans)))
    header = ("degrees", *CASES[:NEITHER], "spread", *DENSITIES)
    return Table("By incidence", header, rows, "Vertices that were predicted or scanned; points within the slack.")


def _table_by_range(found: Sequence[ScanComparison]) -> Table:
    rows = []
    for number in range(N_RANGES):
        spans = [each.by_range[number] for each in found]
        low, high = min(span["from"] for span in spans), max(span["to"] for span in spans)
        rows.append((f"{number + 1} of {N_RANGES}", f"{low:.4g} to {high:.4g}", *_densities(spans)))
    note = "Each scan's real points by range, nearest first, in parts of as many points."
    return Table("By range", ("part", "ranges", *DENSITIES), rows, note, texts=(0, 1))


DENSITIES = ("points", "simulated", "real / simulated")


def _densities(spans: Sequence[dict[str, Any]]) -> tuple[str, str, str]:
    real, made = (sum(span[name] for span in spans) for name in ("real", "simulated"))
    return f"{real:,}", f"{made:,}", figure(_ratio(real, made), ".2f")


def draw_cases(found: ScanComparison) -> Any:
    """Return a figure of the mesh as the sensor sees it, its vertices coloured by case."""
    with importing("matplotlib", "pictures"):
        from zbuf_occlude.drawing.pictures import canvas
    picture, (axes,) = canvas(8, 6.5)
    size = float(np.clip(60_000 / max((found.cases != NEITHER).sum(), 1), 1.0, 14.0))
    for case in (BOTH, NOT_SCANNED, NOT_SEEN):
        label = f"{CASES[case]}: {figure(found.share(case), '.1%')}"
        across, up = found.places[found.cases == case].T
        axes.scatter(across, up, s=size, c=COLORS[case], label=label, lw=0)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_axis_off()
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, 0.0), ncols=3, markerscale=3, frameon=False, fontsize=9)
    return picture
