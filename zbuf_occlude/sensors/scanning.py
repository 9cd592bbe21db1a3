"""From rays to a scan: first hits in the scene, echoes of each beam, and what the sensor gets wrong."""

import warnings
from collections.abc import Mapping
from contextlib import nullcontext
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zbuf_occlude.arrays import BoolArray, FloatArray, IntArray, as_number, as_numbers, as_vector, as_vectors
from zbuf_occlude.errors import ArgumentError, OptionError
from zbuf_occlude.geometry.camera import as_rigid
from zbuf_occlude.geometry.cloud import Cloud, columns_of
from zbuf_occlude.geometry.colors import Bytes, barycentric, luminance
from zbuf_occlude.geometry.mesh import Mesh, MeshLike, as_mesh
from zbuf_occlude.geometry.sampling import SurfacePoints
from zbuf_occlude.provenance import generator
from zbuf_occlude.scenes.scene import Scene
from zbuf_occlude.sensors.casting import DynamicScene, prepare_scene, turned_with
from zbuf_occlude.sensors.catalog import make
from zbuf_occlude.sensors.echoes import cast_beams, echoes_of, square_to, unit_vectors
from zbuf_occlude.sensors.motion import Motion
from zbuf_occlude.sensors.sensor import STEEPEST, NoiseModel, Rays, Sensor
from zbuf_occlude.views import from_angles
from zbuf_occlude.visibility import METHODS, check_keywords, find_method
from zbuf_occlude.visibility.interface import VisibilityQuery

CASTERS = ("exact", "embree", "oracle")
"""Who casts rays unless a method is named: the first of these that can here."""
EDGE = 0.05
"""Neighbouring pixels whose depths differ by more than this share lie on an edge."""
ROUGHNESS = 0.5
"""Radians that a surface's facets are tilted by (Oren and Nayar 1994): assumed, as of plaster, cloth or asphalt."""
ROUGH_BACK = (0.45 * ROUGHNESS**2 / (ROUGHNESS**2 + 0.09)) / (1.0 - 0.5 * ROUGHNESS**2 / (ROUGHNESS**2 + 0.33))
"""What such a surface sends back when grazed, over what it does at right angles: their B / A."""


COLUMNS = (
    ("range", "ranges", "<f8"), ("incidence", "incidences", "<f4"), ("intensity", "intensities", "<f4"),
    ("ring", "rings", "<i4"), ("column", "columns", "<i4"), ("instance", "instances", "<i4"),
    ("n_returns", "n_returns", "<i4"), ("return_number", "return_numbers", "<i4"), ("share", "shares", "<f4"),
    ("time", "times", "<f8"),
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
    offsets : (n, 3) float
        From `origin` to where each ray begins, world space: 0 but for a sensor that moves.
    times : (n,) float
        When each ray is cast, seconds from the beginning of the turn or picture.
    depths_per_range : (n,) float
        Depth along the sensor's x axis over range: the cosine between them.
    ranges : (n,) float
        Eye distances as measured; ``starts + ranges * directions`` are the points.
    clean_ranges : (n,) float
        As they are, before noise and quantisation.
    face_ids : (n,) int
        Into the scene's faces; with several surfaces in a beam, of the one that counts most.
    normals : (n, 3) float
        Unit, turned towards the sensor.
    incidences : (n,) float
        Between the ray and the normal, radians.
    intensities : (n,) float
        Albedo times the cosine of the incidence over the range squared (the clean one, metres), less what windows
        before it take. The albedo is the luminance of the base colour where the mesh has colours
        (``load_mesh(path, colors=True)``), else its object's.
    rings, columns, instances, n_returns : (n,) int
        Laser, firing, object, and how many returns the beam has in all, before any is lost.
    return_numbers : (n,) int
        Which of these it is, from 1, the nearest first.
    shares : (n,) float
        Of the beam's light that met what it is from.
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
        """Where each ray begins, world space, (n, 3)."""
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


def default_caster() -> str:
    """Return the name of the method that casts rays here."""
    able = {row.name for row in METHODS if not row.ray_casting_unsupported_reason and not row.missing()}
    return next(name for name in CASTERS if name in able)


def scan(
    scene: Scene | MeshLike,
    sensor: Sensor | str | Path,
    pose: ArrayLike | None = None,
    *,
    range: float | None = None,
    azimuth: float | None = None,
    elevation: float | None = None,
    size: float | None = None,
    up: str | None = None,
    unit: str | None = None,
    transparent: Mapping[str, float | None] | None = None,
    motion: Motion | None = None,
    seed: int | np.random.SeedSequence | np.random.Generator = 0,
    method: str | None = None,
    occluder: VisibilityQuery | None = None,
    towards: ArrayLike | None = None,
    target: VisibilityQuery | None = None,
    **options: Any,
) -> Scan:
    """Scan a scene.

    Parameters
    ----------
    scene : Scene or Mesh
        World space, metres. Or anything else that is a mesh (`as_mesh`): a path, a mesh of trimesh or Open3D,
        (vertices, faces).
    sensor : Sensor or str
        Of `zbuf_occlude.sensors.make`, or what that takes: a name such as ``hdl-64e``, or a file.
    pose : (4, 4) float, optional
        Sensor frame (x forward, y left, z up) to the world, a rigid motion; `look_at` makes one. By default the
        sensor is at the origin and looks along x.
    range : float, optional
        Instead of a pose: metres from the sensor to the centre of the mesh, at which it looks.
    azimuth, elevation : float, optional
        With `range`, where the sensor stands: degrees from +x towards +y, and above the xy plane. 0 by default.
    size : float, optional
        Metres that the mesh's longest side is made, about its centre. By default the mesh is in metres already.
    up : {"z", "y"}, optional
        Which way is up in the mesh. Here z is: one with y up is turned, (x, y, z) to (x, -z, y). By default "y" for
        glTF files, and "z" for all else.
    unit : {"mm", "cm", "m", "in"}, optional
        Instead of `size`: the unit that the mesh is in.
    transparent : mapping of str to float or None, optional
        Of a mesh: materials that let light pass by name, which may have ``*``, and its share; None: the share that the
        file says (alpha of glTF, d of MTL). Without it a mesh that has colours is as its file says, any other opaque.
    motion : Motion, optional
        How the sensor moves while it scans, from its pose on. Objects of the scene that move do so without it too: each
        ray meets them where they are by the time that it is cast.
    seed : int, SeedSequence or Generator
        The same seed gives the same scan, byte for byte.
    method : str, optional
        Who casts the rays; by default the first of `CASTERS` that can.
    occluder : VisibilityQuery, optional
        The scene made ready already (`casting.prepare_scene`): where nothing in it moves, its mesh.
    towards : (2, 3) float, optional
        Lower and upper corner of a box in the world: only beams that may meet it are cast; the rest are taken to
        return nothing. A sensor that moves casts all.
    target : VisibilityQuery, optional
        A part of the scene that stands still, made ready by itself: only beams are cast of which a ray would meet it,
        were it alone. So all its points are there, and few others.
    **options
        The method's own.

    Returns
    -------
    Scan
        Ordered as the sensor's rays are.

    Raises
    ------
    ArgumentError
        A pose that is no rigid motion, a pose and a range, no scene or sensor, or an occluder of another mesh.
    OptionError, UnavailableError
        As `zbuf_occlude.prepare`; a method that casts no rays; a motion of a sensor that casts all rays at once.

    Warns
    -----
    UserWarning
        With `range`: the sensor stands inside the mesh's bounding box. Without `occluder`: objects move, but all rays
        are cast at once; a trajectory lasts longer or shorter than the sweep that is made.

    Examples
    --------
    >>> found = zo.scan("car.obj", "hdl-64e", range=15, azimuth=30)
    >>> found.points.shape == found.normals.shape == (len(found), 3)
    True
    >>> found.save("scan.npz")
    """
    if options:
        check_keywords(scan, method or default_caster(), options)
    for part, given in (("occluder", occluder), ("target", target)):
        if given is not None and not isinstance(given, VisibilityQuery):
            raise ArgumentError(f"{part} must be an VisibilityQuery, made by prepare; got {type(given).__name__}.")
    sensor = make(sensor)
    if not isinstance(transparent, Mapping | None):
        raise ArgumentError(f"transparent must be a mapping of names to shares; got {type(transparent).__name__}.")
    if not isinstance(scene, Scene):
        if size is not None and unit is not None:
            raise ArgumentError(f"give size or unit, not both; got {size} and {unit!r}. A size needs no unit.")
        mesh = as_mesh(scene, up=up, unit=unit, colors=transparent is not None)
        scene = Scene.of(_of_size(mesh if transparent is None else mesh.transparent(transparent), size))
        if transparent and scene.transmittance is None:
            raise ArgumentError(no_windows("transparent", mesh))
    elif any(each is not None for each in (size, up, unit, transparent)):
        raise ArgumentError("size, up, unit and transparent are for a mesh; a scene has its own. Leave them out.")
    if range is not None:
        if pose is not None:
            raise ArgumentError("give pose or range, not both.")
        angles = (0.0 if angle is None else angle for angle in (azimuth, elevation))
        pose = _pose_at(scene.mesh, range, *angles, is_assumed=size is None and unit is None)
    elif azimuth is not None or elevation is not None:
        raise ArgumentError("azimuth and elevation must go with range, metres from the mesh's centre. Give it.")
    matrix = np.eye(4) if pose is None else as_rigid(pose, "pose")
    rotation, origin = matrix[:3, :3], matrix[:3, 3]
    asked: dict[str, Any] = {"motion": motion, "occluder": occluder, "towards": towards, "target": target, **options}
    rng = generator(seed)
    return apply_noise(faultless(scene, sensor, rotation, origin, method=method, **asked), sensor, rng)


def faultless(
    scene: Scene,
    sensor: Sensor,
    rotation: FloatArray,
    origin: FloatArray,
    *,
    motion: Motion | None = None,
    method: str | None = None,
    occluder: VisibilityQuery | None = None,
    towards: ArrayLike | None = None,
    target: VisibilityQuery | None = None,
    **options: Any,
) -> Scan:
    """Return all returns of a scan before limits, losses and noise (`apply_noise`); the rest is as of `scan`."""
    rays = at_rest = sensor.rays()
    if motion is not None and not isinstance(motion, Motion):
        raise ArgumentError(f"motion must be a sensors.Motion; got {type(motion).__name__}. Make one.")
    if len(sensor.imperfections.second_eyes) and (motion is not None or (scene.moving and rays.times is not None)):
        raise ArgumentError("a sensor with a second eye must stand still, as all it sees. Or set baseline=0.")
    if motion is not None or scene.moving:
        untimed = sensor.untimed
        if untimed and motion is not None:
            raise OptionError(untimed)
        if untimed and occluder is None:
            warnings.warn(f"objects that move stand still: {untimed}", stacklevel=3)
    if motion is not None:
        if occluder is None and (said := motion.unlike(at_rest)):
            warnings.warn(f"{said}.", stacklevel=3)
        rays = motion.applied(at_rest)
    if towards is not None and motion is None:
        corners = as_vectors(as_numbers(towards, "towards", (2, 3)), "towards")
        rays = at_rest = rays.select(_may_meet(rays, rotation, origin, corners, sensor.imperfections.divergence))
    if target is not None:
        alone = (cast_beams(target, rays, rotation, origin, sensor.imperfections).face_ids >= 0).any(axis=(1, 2))
        rays, at_rest = rays.select(alone), at_rest.select(alone)
    name = default_caster() if method is None else method
    find_method(name).check_first_hits()
    with prepare_scene(scene, name, **options) if occluder is None else nullcontext(occluder) as opened:
        if not (scene.is_opaque_and_static or isinstance(opened, DynamicScene)):
            raise ArgumentError("occluder of a scene that moves or has windows must be of prepare_scene. Leave it out.")
        opened.check_is_of(scene.mesh)
        returns, met = _returns(scene, opened, rays, rotation, origin, sensor)
    if motion is not None and not motion.deskew:
        returns = _as_at_rest(returns, at_rest.select(met), motion, rotation)
    return returns


def no_windows(option: str, mesh: Mesh) -> str:
    """Return the message that no material named is there, or lets light pass."""
    names = sorted({m.name for m in mesh.colors.materials if m.name} if mesh.colors is not None else ())
    return (
        f"{option} must name materials that let light pass, or a share for them; of {', '.join(names)[:200] or 'none'} "
        f"of {mesh.name} none does. Give NAME=SHARE."
    )


def _of_size(mesh: Mesh, size: float | None) -> Mesh:
    """Return the mesh scaled about its centre, its longest side `size`; as it is for None."""
    if size is None:
        return mesh
    metres = as_number(size, "size", "metres above 0", lambda number: number > 0.0)
    if not mesh.longest_side > 0.0:
        raise ArgumentError(f"a mesh that is given a size must have an extent; all vertices of {mesh.name} coincide.")
    factor = metres / mesh.longest_side
    return mesh.transformed(factor, mesh.centre * (1.0 - factor))


def _pose_at(mesh: Mesh, distance: float, azimuth: float, elevation: float, *, is_assumed: bool) -> FloatArray:
    """Return the pose of a sensor that looks at a mesh's centre, from angles in degrees.

    `is_assumed`: nobody said that the mesh is in metres.
    """
    distance = as_number(distance, "range", "metres above 0", lambda number: number > 0.0)
    view = from_angles(azimuth, elevation, distance).around(mesh.centre, 1.0)
    if mesh.in_box(view.eyes).any():
        how, cure = (", its numbers taken as metres", ", or give unit=") if is_assumed else ("", "")
        warnings.warn(
            f"the sensor stands inside the mesh's bounding box: range is {distance:g} m, the mesh's longest side "
            f"{mesh.longest_side:g} m{how}. Raise range{cure}.",
            stacklevel=3,
        )
    return look_at(view.eyes[0], mesh.centre)


def look_at(position: ArrayLike, target: ArrayLike, up: ArrayLike | None = None) -> FloatArray:
    """Return the pose (4, 4) of a sensor at a position that looks at a target, its z axis as far up as can be.

    `up` (3,) is +z by default; towards a target straight above or below, +y.

    Raises
    ------
    ArgumentError
        The position is the target, or `up` points along the view.

    Examples
    --------
    >>> zo.sensors.look_at([10, 0, 2], [0, 0, 2])[:3, 0].tolist()
    [-1.0, 0.0, 0.0]
    """
    at, towards = as_vector(position, "position"), as_vector(target, "target")
    forward = towards - at
    if not forward.any():
        raise ArgumentError(f"a sensor must not be at its target; both are {at.tolist()}. Move one.")
    forward = forward / np.linalg.norm(forward)
    usual = np.array([0.0, 0.0, 1.0]) if abs(forward[2]) < 1.0 - 1e-9 else np.array([0.0, 1.0, 0.0])
    left = np.cross(usual if up is None else as_vector(up, "up"), forward)
    if not np.linalg.norm(left) > 0.0:
        raise ArgumentError("up must not point along the view. Give another one.")
    left /= np.linalg.norm(left)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([forward, left, np.cross(forward, left)], axis=1)
    pose[:3, 3] = at
    return pose


def pose_of_camera(view_matrix: FloatArray) -> FloatArray:
    """Return the pose (4, 4) of a sensor that stands where a camera does, given by its view matrix, turned as it is."""
    rotation = view_matrix[:3, :3]
    pose = np.eye(4)
    pose[:3, :3] = np.stack([-rotation[2], -rotation[0], rotation[1]], axis=1)
    pose[:3, 3] = -rotation.T @ view_matrix[:3, 3]
    return pose


def _may_meet(
    rays: Rays, rotation: FloatArray, origin: FloatArray, corners: FloatArray, divergence: float
) -> NDArray[np.intp]:
    """Return the rays whose beams may meet a box; first those near the ball around it, which is asked faster.

    Rays are taken to begin at `origin`, and the box to be larger by as far as they do not.
    """
    to_middle, half = corners.mean(axis=0) - origin, np.ptp(corners, axis=0) / 2.0 + rays.spread
    distance, radius = float(np.linalg.norm(to_middle)), float(np.linalg.norm(half))
    if distance <= radius * 1.001:
        return np.arange(len(rays))
    angle = np.arcsin(radius / distance) + divergence + 1e-6
    near = rays.near(rotation.T @ to_middle / distance, angle)
    directions = rotation @ rays.directions[near].T  # (3, n): numpy is slow along short rows
    half = half + (divergence + 1e-6) * (distance + radius)  # so far may a beam's edge be from its middle
    with np.errstate(divide="ignore"):
        ends = (to_middle + np.stack([-half, half]))[:, :, None] / np.where(directions == 0.0, 1e-300, directions)
    entered, left = ends.min(axis=0).max(axis=0), ends.max(axis=0).min(axis=0)
    return np.asarray(near[(entered <= left) & (left >= 0.0)])


def _returns(
    scene: Scene, occluder: VisibilityQuery, rays: Rays, rotation: FloatArray, origin: FloatArray, sensor: Sensor
) -> tuple[Scan, NDArray[np.intp]]:
    """The returns of all beams as they would be without noise, and which rays they are of."""
    directions = rays.directions @ rotation.T
    hits = cast_beams(occluder, rays, rotation, origin, sensor.imperfections)
    found = echoes_of(hits, sensor.imperfections, scene.transmittance)
    offsets = _offsets(rays, rotation)
    if len(sensor.imperfections.second_eyes):
        starts = origin + offsets[found.rays]
        points = starts + found.ranges[:, None] * directions[found.rays]
        seen = _seen_twice(occluder, scene.mesh, points, found.face_ids, starts, rotation, sensor)
        if sensor.imperfections.window > 1 and sensor.imperfections.noise and sensor.kind == "pinhole":
            depths = found.ranges * rays.directions[found.rays, 0]
            seen &= _matched(rays.rings[found.rays], rays.columns[found.rays], depths, seen, sensor)
        found = found.select(seen)
    met, face_ids, ranges = found.rays, found.face_ids, found.ranges
    directions, instances = directions[met], scene.instances[face_ids]
    times = np.zeros(len(met)) if rays.times is None else rays.times[met]
    normals = turned_with(scene, instances, times, unit_vectors(scene.mesh.face_normals[face_ids]))
    cosines = -np.einsum("ij,ij->i", normals, directions)
    normals *= np.where(cosines < 0.0, -1.0, 1.0)[:, None]
    cosines = np.minimum(np.abs(cosines), 1.0)
    starts, squares = origin + offsets[met], np.maximum(ranges, 1e-6) ** 2
    made = Scan(
        origin=origin,
        directions=directions,
        offsets=offsets[met],
        times=times,
        depths_per_range=rays.directions[met, 0],
        ranges=ranges,
        clean_ranges=ranges,
        face_ids=face_ids,
        normals=normals,
        incidences=np.arccos(cosines),
        intensities=_albedos(scene, face_ids, starts + ranges[:, None] * directions) * found.lights * cosines / squares,
        rings=rays.rings[met],
        columns=rays.columns[met],
        instances=instances,
        n_returns=found.n_returns,
        return_numbers=found.numbers,
        shares=found.shares,
    )
    return made, met


def _albedos(scene: Scene, face_ids: IntArray, points: FloatArray) -> FloatArray:
    """Return the albedo where faces are met: the luminance of the mesh's colour if it has any, else the object's."""
    if scene.mesh.colors is None:
        return np.asarray(scene.albedos[scene.instances[face_ids]])
    return luminance(scene.mesh.colors.at(face_ids, barycentric(scene.mesh.corners[face_ids], points)))


def _as_at_rest(scan: Scan, rays: Rays, motion: Motion, rotation: FloatArray) -> Scan:
    """Return a scan as a sensor reports it that knows nothing of its motion: all `rays` are cast from its pose."""
    turned, _ = motion.poses(scan.times)
    local = np.einsum("nji,nj->ni", turned, scan.normals @ rotation)
    offsets, directions = _offsets(rays, rotation), rays.directions @ rotation.T
    return replace(scan, directions=directions, offsets=offsets, normals=local @ rotation.T)


def _offsets(rays: Rays, rotation: FloatArray) -> FloatArray:
    """Return from the sensor's origin to where each ray begins (n, 3), world space."""
    return np.zeros((len(rays), 3)) if rays.origins is None else np.asarray(rays.origins @ rotation.T)


def _seen_twice(
    occluder: VisibilityQuery,
    mesh: Mesh,
    points: FloatArray,
    face_ids: IntArray,
    starts: FloatArray,
    rotation: FloatArray,
    sensor: Sensor,
) -> BoolArray:
    """Which points (n,) that were met from `starts` a second eye of the sensor sees too, from the same side."""
    faults, seen = sensor.imperfections, np.zeros(len(points), dtype=bool)
    normals = unit_vectors(mesh.face_normals[face_ids])
    side = np.einsum("ij,ij->i", normals, starts - points)
    least = np.cos(np.radians(faults.baseline_incidence_max if faults.noise else 90.0))
    for baseline in faults.second_eyes:
        eyes = starts + rotation @ baseline
        towards = eyes - points
        height = np.einsum("ij,ij->i", normals, towards)
        cosine = np.abs(height) / np.maximum(np.linalg.norm(towards, axis=1), np.finfo(np.float64).tiny)
        lit = ~seen & (side * height > 0.0) & (cosine >= least)
        if sensor.kind == "pinhole":
            lit &= sensor.covers(-towards @ rotation)
        some = np.flatnonzero(lit)
        seen[some] = seen_from(occluder, SurfacePoints(points[some], face_ids[some], normals[some]), eyes[some])
    return seen


def _matched(rows: IntArray, columns: IntArray, depths: FloatArray, seen: BoolArray, sensor: Sensor) -> BoolArray:
    """Whether nothing in the window around a pixel is nearer by `EDGE`, or as near and seen by one eye alone, (n,).

    A pixel of several echoes is as near as the nearest.
    """
    half = int(sensor.imperfections.window) // 2
    shape = sensor.pattern["height"] + 2 * half, sensor.pattern["width"] + 2 * half
    at, own, nearest = (rows + half, columns + half), np.full(shape, np.inf), np.full(shape, np.inf)
    np.minimum.at(own, at, depths)
    np.minimum.at(nearest, at, depths * np.where(seen, 1.0, (1.0 - EDGE) / (1.0 + EDGE)))
    for axis in (0, 1):
        nearest = np.lib.stride_tricks.sliding_window_view(nearest, 2 * half + 1, axis=axis).min(axis=-1)
    return np.asarray(nearest[rows, columns] >= (1.0 - EDGE) * own[at])


EYES_AT_A_TIME = 16
"""Of a sensor whose eyes move: so many share a question, about the points of all of them."""


def seen_from(occluder: VisibilityQuery, points: SurfacePoints, eyes: FloatArray) -> BoolArray:
    """Return which of the points (n,) are visible, each from an eye of its own (n, 3); few eyes may differ."""
    unique, eye_of = np.unique(eyes, axis=0, return_inverse=True)
    order = np.argsort(eye_of.reshape(-1), kind="stable")
    eye_of, seen = eye_of.reshape(-1)[order], np.zeros(len(points), dtype=bool)
    for first in range(0, len(unique), EYES_AT_A_TIME):
        begin, end = np.searchsorted(eye_of, [first, first + EYES_AT_A_TIME])
        mine = order[begin:end]
        mask = occluder.visible(points.select(mine), unique[first : first + EYES_AT_A_TIME])
        seen[mine] = mask[eye_of[begin:end] - first, np.arange(len(mine))]
    return seen


def apply_noise(scan: Scan, sensor: Sensor, rng: np.random.Generator) -> Scan:
    """Apply everything that a sensor gets wrong along and across its rays; with noise=0 only the limits of range."""
    faults = sensor.imperfections
    scan = clip_range(scan, faults)
    if not faults.noise:
        return scan
    scan = without_edges(scan, faults, rng)
    scan = apply_dropout(scan, faults, rng)
    scan = apply_detection(scan, faults, rng)
    scan = noisy(scan, faults, rng)
    scan = blurred(scan, sensor, rng)
    return quantised(scan, faults)


def clip_range(scan: Scan, faults: NoiseModel) -> Scan:
    """Leave out what is nearer than `range_min`, farther than `range_max`, or steeper than `incidence_max`."""
    measured = measured_ranges(scan, faults)
    kept = (measured >= faults.range_min) & (measured <= faults.range_max)
    if faults.incidence_max < 90.0 and faults.noise:
        kept &= scan.incidences <= np.radians(faults.incidence_max)
    return scan if kept.all() else scan.select(kept)


def apply_dropout(scan: Scan, faults: NoiseModel, rng: np.random.Generator) -> Scan:
    """Lose returns at random: a share of all, and of weak ones the more the weaker the signal."""
    if not (faults.drop or faults.drop_zero):
        return scan
    lost = np.full(len(scan), faults.drop)
    if faults.drop_limit:
        signal = scan.intensities * scan.clean_ranges**2 * np.exp(-faults.attenuation * scan.clean_ranges)
        weak = faults.drop_zero * np.maximum(0.0, 1.0 - signal / faults.drop_limit)
        lost = 1.0 - (1.0 - lost) * (1.0 - weak)
    return scan.select(rng.random(len(scan)) >= lost)


def apply_detection(scan: Scan, faults: NoiseModel, rng: np.random.Generator) -> Scan:
    """Lose the returns that fade below what the sensor detects: dark, steep and far ones."""
    if not faults.reach:
        return scan
    cosines = np.cos(scan.incidences)
    # what a Lambertian surface sends back is the record's intensity; its albedo is that without the cosine
    albedos = scan.intensities * scan.clean_ranges**2 / np.maximum(cosines, 1e-9)
    return scan.select(rng.random(len(scan)) < detection(albedos, cosines, scan.clean_ranges, faults.reach))


def detection(albedos: ArrayLike, cosines: ArrayLike, ranges: ArrayLike, reach: float) -> FloatArray:
    """Return the probability that a return is detected: ``exp(-(range / reach)^2 / (albedo B(incidence)))``.

    The power received is on average ``P = albedo B / range^2``. It fades: of coherent light from a rough surface it is
    distributed exponentially (speckle). So it exceeds what can be detected, ``P0 = 1 / reach^2``, with probability
    ``exp(-P0 / P)``. ``B`` is what a rough surface sends back to the light (Oren and Nayar 1994), 1 at right angles;
    by Lambert's cosine alone the ground would end at 30 m. `ranges` and `reach` are metres.
    """
    cosines = np.asarray(cosines, dtype=np.float64)
    back = cosines + ROUGH_BACK * (1.0 - cosines**2)
    signals = np.maximum(np.asarray(albedos) * back, np.finfo(np.float64).tiny)
    with np.errstate(over="ignore"):  # what is black, or far beyond the reach, is never detected
        return np.asarray(np.exp(-((np.asarray(ranges) / reach) ** 2) / signals))


def noisy(scan: Scan, faults: NoiseModel, rng: np.random.Generator) -> Scan:
    """Add normal noise to the ranges; of an axial sensor to the depths."""
    sigma = faults.range_sigma(measured_ranges(scan, faults), scan.incidences)
    if not sigma.any():
        return scan
    if faults.axial:
        sigma = sigma / scan.depths_per_range
    return replace(scan, ranges=np.maximum(scan.ranges + sigma * rng.standard_normal(len(scan)), 1e-6))


def blurred(scan: Scan, sensor: Sensor, rng: np.random.Generator) -> Scan:
    """Turn rays across themselves by the lateral noise, which is in pixels."""
    offset, slope = (float(x) for x in np.broadcast_to(np.append(sensor.imperfections.lateral, 0.0)[:2], 2))
    if not (offset or slope) or not sensor.pixels:
        return scan
    angle = np.minimum(scan.incidences, STEEPEST)
    sigma = (offset + slope * angle / (np.pi / 2 - angle)) * sensor.imperfections.noise / sensor.pixels
    across, upwards = square_to(scan.directions)
    shift = rng.standard_normal((len(scan), 1)) * across + rng.standard_normal((len(scan), 1)) * upwards
    return replace(scan, directions=unit_vectors(scan.directions + sigma[:, None] * shift))


def quantised(scan: Scan, faults: NoiseModel) -> Scan:
    """Round ranges to multiples of `step`, inverse ones to multiples of `disparity_step`; depths of an axial sensor."""
    if not (faults.step or faults.disparity_step):
        return scan
    per_range = scan.depths_per_range if faults.axial else np.ones(len(scan))
    measured = scan.ranges * per_range
    if faults.disparity_step:
        disparities = np.maximum(np.round(1.0 / (measured * faults.disparity_step)), 1.0)
        measured = 1.0 / (disparities * faults.disparity_step)
    if faults.step:
        measured = np.round(measured / faults.step) * faults.step
    return replace(scan, ranges=np.maximum(measured / per_range, 1e-6))


def without_edges(scan: Scan, faults: NoiseModel, rng: np.random.Generator) -> Scan:
    """Lose a share of the pixels beside which the depth, of the nearest echo, jumps, or nothing returns."""
    if not faults.edge_loss or not len(scan):
        return scan
    first = scan.columns.min() - 1, scan.rings.min() - 1
    shape = int(scan.rings.max() - first[1] + 2), int(scan.columns.max() - first[0] + 2)
    image = np.full(shape, np.inf)
    rows, columns = scan.rings - first[1], scan.columns - first[0]
    depths = scan.clean_ranges * scan.depths_per_range
    np.minimum.at(image, (rows, columns), depths)
    depths = image[rows, columns]
    edge = np.zeros(len(scan), dtype=bool)
    for down, right in ((-1, 0), (1, 0), (0, -1), (0, 1)):
        edge |= np.abs(image[rows + down, columns + right] - depths) > EDGE * depths
    return scan.select(~edge | (rng.random(len(scan)) >= faults.edge_loss))


def measured_ranges(scan: Scan, faults: NoiseModel) -> FloatArray:
    """Return what the sensor measures (n,), without noise: ranges, or of an axial sensor depths."""
    return scan.clean_ranges * scan.depths_per_range if faults.axial else scan.clean_ranges
