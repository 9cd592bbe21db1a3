"""From rays to a scan: first hits in the scene, echoes of each beam, and what the sensor gets wrong."""

import warnings
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zbuf_occlude.arrays import FloatArray, as_numbers, as_vectors
from zbuf_occlude.errors import ArgumentError
from zbuf_occlude.geometry.mesh import Mesh, MeshLike, as_mesh
from zbuf_occlude.scenes.scene import Scene
from zbuf_occlude.seeds import generator
from zbuf_occlude.sensors.files import make
from zbuf_occlude.sensors.imperfections import imperfect
from zbuf_occlude.sensors.model import Imperfections, Sensor
from zbuf_occlude.sensors.rays import Rays
from zbuf_occlude.sensors.record import Scan
from zbuf_occlude.views import from_angles
from zbuf_occlude.visibility import METHODS, find_method, prepare
from zbuf_occlude.visibility.interface import FirstHits, Occluder

CASTERS = ("exact", "embree", "oracle")
"""Who casts rays unless a method is named: the first of these that can here."""
_CROSS = np.array([[0.0, 0.0], [1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]])
_SPREAD = 0.5
"""How far along both axes a beam's four outer rays go, of its half angle: 0.7 of its radius."""


def default_caster() -> str:
    """Return the name of the method that casts rays here."""
    able = {row.name for row in METHODS if not row.no_first_hits and not row.missing()}
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
    seed: int | np.random.SeedSequence | np.random.Generator = 0,
    method: str | None = None,
    occluder: Occluder | None = None,
    towards: ArrayLike | None = None,
    target: Occluder | None = None,
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
    seed : int, SeedSequence or Generator
        The same seed gives the same scan, byte for byte.
    method : str, optional
        Who casts the rays; by default the first of `CASTERS` that can.
    occluder : Occluder, optional
        The scene's mesh made ready already.
    towards : (2, 3) float, optional
        Lower and upper corner of a box in the world: only beams that may meet it are cast; the rest are taken to
        return nothing.
    target : Occluder, optional
        A part of the scene made ready by itself: only beams are cast of which a ray would meet it, were it alone. So
        all its points are there, and few others.
    **options
        The method's own.

    Returns
    -------
    Scan
        Ordered as the sensor's rays are.

    Raises
    ------
    ArgumentError
        A pose that is no rigid motion, a pose and a range, or no scene or sensor.
    OptionError, UnavailableError
        As `zbuf_occlude.prepare`; a method that casts no rays.

    Warns
    -----
    UserWarning
        With `range`: the sensor stands inside the mesh's bounding box.

    Examples
    --------
    >>> found = zo.scan("car.obj", "hdl-64e", range=15, azimuth=30)
    >>> found.points.shape == found.normals.shape == (len(found), 3)
    True
    >>> found.save("scan.npz")
    """
    if isinstance(sensor, str | Path):
        sensor = make(sensor)
    if not isinstance(sensor, Sensor):
        raise ArgumentError(
            f"sensor must be a Sensor, a name or a file; got {type(sensor).__name__}. Make one: sensors.make(name)."
        )
    if not isinstance(scene, Scene):
        scene = Scene.of(_of_size(as_mesh(scene), size))
    elif size is not None:
        raise ArgumentError("size is for a mesh; a scene is in metres. Leave it out.")
    if range is not None:
        if pose is not None:
            raise ArgumentError("give pose or range, not both.")
        pose = _pose_at(scene.mesh, range, azimuth or 0.0, elevation or 0.0)
    elif azimuth is not None or elevation is not None:
        raise ArgumentError("azimuth and elevation must go with range, metres from the mesh's centre. Give it.")
    rotation, origin = _rigid(pose)
    rays = sensor.rays()
    if towards is not None:
        corners = as_vectors(towards, "towards")
        rays = rays.select(_may_meet(rays, rotation, origin, corners, sensor.imperfections.divergence))
    if target is not None:
        met = _beams(target, rays, rotation, origin, sensor.imperfections).face_ids >= 0
        rays = rays.select(met.any(axis=1))
    rng = generator(seed)
    if occluder is not None:
        returns = _returns(scene, occluder, rays, rotation, origin, sensor)
    else:
        name = method or default_caster()
        find_method(name).check_first_hits()
        with prepare(scene.mesh, name, **options) as opened:
            returns = _returns(scene, opened, rays, rotation, origin, sensor)
    return imperfect(returns, sensor, rng)


def _of_size(mesh: Mesh, size: float | None) -> Mesh:
    """Return the mesh scaled about its centre, its longest side `size`; as it is for None."""
    if size is None:
        return mesh
    if not (isinstance(size, int | float | np.number) and 0.0 < size < np.inf and mesh.longest_side > 0.0):
        raise ArgumentError(f"size must be metres above 0, of a mesh with an extent; got {size!r}.")
    factor = float(size) / mesh.longest_side
    return mesh.transformed(factor, mesh.centre * (1.0 - factor))


def _pose_at(mesh: Mesh, distance: float, azimuth: float, elevation: float) -> FloatArray:
    """Return the pose of a sensor that looks at a mesh's centre, from angles in degrees."""
    if not (isinstance(distance, int | float | np.number) and 0.0 < distance < np.inf):
        raise ArgumentError(f"range must be metres above 0; got {distance!r}.")
    view = from_angles(azimuth, elevation, distance).around(mesh.centre, 1.0)
    if mesh.in_box(view.eyes).any():
        warnings.warn(
            f"the sensor stands inside the mesh's bounding box. Raise range; it is {distance:g}.", stacklevel=3
        )
    return look_at(view.eyes[0], mesh.centre)


def look_at(position: ArrayLike, target: ArrayLike) -> FloatArray:
    """Return the pose (4, 4) of a sensor at a position that looks at a target, its z axis as far up as can be.

    Raises
    ------
    ArgumentError
        The position is the target.

    Examples
    --------
    >>> zo.sensors.look_at([10, 0, 2], [0, 0, 2])[:3, 0].tolist()
    [-1.0, 0.0, 0.0]
    """
    at, towards = as_vectors([np.asarray(position)], "position")[0], as_vectors([np.asarray(target)], "target")[0]
    forward = towards - at
    if not forward.any():
        raise ArgumentError(f"a sensor must not be at its target; both are {at.tolist()}. Move one.")
    forward = forward / np.linalg.norm(forward)
    up = np.array([0.0, 0.0, 1.0]) if abs(forward[2]) < 1.0 - 1e-9 else np.array([0.0, 1.0, 0.0])
    left = np.cross(up, forward)
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


def _rigid(pose: ArrayLike | None) -> tuple[FloatArray, FloatArray]:
    matrix = np.eye(4) if pose is None else as_numbers(pose, "pose", (4, 4), " It is sensor to world.")
    if not np.isfinite(matrix).all():
        raise ArgumentError("pose must be finite; it is not.")
    rotation = matrix[:3, :3]
    if not (np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-6) and np.linalg.det(rotation) > 0.0):
        raise ArgumentError(
            "pose must be a rigid motion, without scale or reflection. Scale the scene, not the sensor."
        )
    return rotation, matrix[:3, 3]


def _may_meet(
    rays: Rays, rotation: FloatArray, origin: FloatArray, corners: FloatArray, divergence: float
) -> NDArray[np.intp]:
    """Return the rays whose beams may meet a box; first those near the ball around it, which is asked faster."""
    to_middle, half = corners.mean(axis=0) - origin, np.ptp(corners, axis=0) / 2.0
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
    scene: Scene, occluder: Occluder, rays: Rays, rotation: FloatArray, origin: FloatArray, sensor: Sensor
) -> Scan:
    """The returns of all beams as they would be without noise."""
    directions = rays.directions @ rotation.T
    hits = _beams(occluder, rays, rotation, origin, sensor.imperfections)
    if hits.face_ids.shape[1] > 1:
        face_ids, ranges, n_returns = _echoes(hits, sensor.imperfections)
    else:
        face_ids, ranges = hits.face_ids[:, 0], hits.distances[:, 0]
        n_returns = np.ones(len(rays), dtype=np.int32)
    met = np.flatnonzero(face_ids >= 0)
    face_ids, ranges, directions = face_ids[met], ranges[met], directions[met]
    normals = _unit(scene.mesh.face_normals[face_ids])
    cosines = -np.einsum("ij,ij->i", normals, directions)
    normals *= np.where(cosines < 0.0, -1.0, 1.0)[:, None]
    cosines = np.minimum(np.abs(cosines), 1.0)
    instances = scene.instances[face_ids]
    return Scan(
        origin=origin,
        directions=directions,
        depths_per_range=rays.directions[met, 0],
        ranges=ranges,
        clean_ranges=ranges,
        face_ids=face_ids,
        normals=normals,
        incidences=np.arccos(cosines),
        intensities=scene.albedos[instances] * cosines / np.maximum(ranges, 1e-6) ** 2,
        rings=rays.rings[met],
        columns=rays.columns[met],
        instances=instances,
        n_returns=n_returns[met],
    )


class _Echoes(NamedTuple):
    face_ids: Any
    ranges: FloatArray
    n_returns: Any


def _echoes(hits: FirstHits, faults: Imperfections) -> _Echoes:
    """One return per beam of five rays: near surfaces run together, of what is apart one is kept."""
    order = np.argsort(hits.distances, axis=1, kind="stable")
    # (5, n): numpy is slow along short rows
    ranges = np.ascontiguousarray(np.take_along_axis(hits.distances, order, axis=1).T)
    faces = np.ascontiguousarray(np.take_along_axis(hits.face_ids, order, axis=1).T)
    met = faces >= 0
    with np.errstate(invalid="ignore"):
        apart = np.diff(ranges, axis=0) > faults.echo_separation
    echo = np.zeros(ranges.shape, dtype=np.int32)
    np.cumsum(apart & met[1:], axis=0, out=echo[1:])
    n_returns = np.where(met[0], 1 + np.where(met, echo, 0).max(axis=0), 0)
    energy = np.where(met, 1.0 / np.where(met, ranges, 1.0) ** 2, 0.0)
    if faults.returns == "first":
        chosen = np.zeros(ranges.shape[1], dtype=int)
    elif faults.returns == "last":
        chosen = np.maximum(n_returns - 1, 0)
    else:
        chosen = np.stack([(energy * (echo == number)).sum(axis=0) for number in range(len(_CROSS))]).argmax(axis=0)
    mine = met & (echo == chosen)
    weights = np.where(mine, energy, 0.0)
    total = weights.sum(axis=0)
    moments = (weights * np.where(met, ranges, 0.0)).sum(axis=0)
    mean = np.divide(moments, total, out=np.full(len(total), np.inf), where=total > 0)
    with np.errstate(invalid="ignore"):
        best = np.where(mine, np.abs(ranges - mean), np.inf).argmin(axis=0)
    face_ids = np.where(total > 0, faces[best, np.arange(len(best))], -1)
    return _Echoes(face_ids.astype(np.int32), mean, n_returns.astype(np.int32))


def _beams(
    occluder: Occluder, rays: Rays, rotation: FloatArray, origin: FloatArray, faults: Imperfections
) -> FirstHits:
    """First hits of each beam's rays, (n, 5), or (n, 1) without divergence."""
    by_ring = np.argsort(rays.rings, kind="stable")  # neighbours follow each other: up to twenty times as fast to cast
    directions = rays.directions[by_ring] @ rotation.T
    if faults.divergence == 0.0 or faults.noise == 0.0:
        beams = directions[:, None]
    else:
        least = np.eye(3)[np.abs(directions).argmin(axis=1)]
        across = _unit(np.cross(directions, least))
        upwards = np.cross(directions, across)
        spread = _SPREAD * faults.divergence / 2.0
        beams = np.empty((len(directions), len(_CROSS), 3))
        for number, (x, y) in enumerate(_CROSS):
            beams[:, number] = directions + spread * (x * across + y * upwards)
    face_ids, distances = occluder.first_hits(origin[None], beams.reshape(-1, 3))
    shape, back = beams.shape[:2], np.empty_like(by_ring)
    back[by_ring] = np.arange(len(by_ring))
    return FirstHits(face_ids.reshape(shape)[back], distances.reshape(shape)[back])


def _unit(vectors: FloatArray) -> FloatArray:
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), np.finfo(np.float64).tiny))
