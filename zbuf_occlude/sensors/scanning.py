"""Scans of scenes: the rays of a sensor, the surfaces that they meet, and the returns before and after noise."""

import warnings
from collections.abc import Mapping
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zbuf_occlude.base.arrays import FloatArray, IntArray, as_number, as_numbers, as_vectors, unit_vectors
from zbuf_occlude.base.errors import ArgumentError, OptionError
from zbuf_occlude.base.provenance import generator
from zbuf_occlude.geometry.camera import as_rigid
from zbuf_occlude.geometry.colors import barycentric, luminance
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.meshes.conversion import MeshLike, as_mesh
from zbuf_occlude.sensors.casting import DynamicScene, normals_at, prepare_scene
from zbuf_occlude.sensors.catalog import make
from zbuf_occlude.sensors.echoes import cast_beams, echoes_of
from zbuf_occlude.sensors.motion import Motion
from zbuf_occlude.sensors.noise import apply_noise
from zbuf_occlude.sensors.poses import look_at
from zbuf_occlude.sensors.rays import Rays
from zbuf_occlude.sensors.returns import Scan
from zbuf_occlude.sensors.scenes.scene import Scene
from zbuf_occlude.sensors.second_camera import select_triangulated
from zbuf_occlude.sensors.sensor import Sensor
from zbuf_occlude.views import from_angles
from zbuf_occlude.visibility import check_keywords, find_method, precompile
from zbuf_occlude.visibility.interface import VisibilityQuery


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
    method: str = "exact",
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
        A sensor, or what `zbuf_occlude.sensors.make` takes: a name such as ``hdl-64e``, or a file.
    pose : (4, 4) float, optional
        Rigid transform from the sensor's frame (x forward, y left, z up) to the world; see `look_at`. By default the
        sensor is at the origin and looks along x.
    range : float, optional
        Instead of a pose: metres from the sensor to the centre of the mesh, at which the sensor looks.
    azimuth, elevation : float, optional
        With `range`, the direction from the mesh to the sensor: degrees from +x towards +y, and above the xy plane.
        0 by default.
    size : float, optional
        Metres of the mesh's longest side; the mesh is scaled about its centre. By default it is in metres already.
    up : {"z", "y"}, optional
        Axis that points up in the mesh. A mesh with y up is turned: (x, y, z) to (x, -z, y). By default "y" for glTF
        files, and "z" for all others.
    unit : {"mm", "cm", "m", "in"}, optional
        Instead of `size`: unit of the mesh.
    transparent : mapping of str to float or None, optional
        Share of light that materials of a mesh let pass, by name, which may contain ``*``. None: the file's own share
        (alpha of glTF, d of MTL). By default a mesh with colours has its file's shares, and any other is opaque.
    motion : Motion, optional
        Motion of the sensor during the scan, from its pose on. Objects of the scene that move need no `motion`: each
        ray meets them where they are at its time.
    seed : int, SeedSequence or Generator
        The same seed gives the same scan, byte for byte.
    method : str
        Ray caster.
    occluder : VisibilityQuery, optional
        The prepared scene (`casting.prepare_scene`); for a scene in which nothing moves, its prepared mesh.
    towards : (2, 3) float, optional
        Lower and upper corner of a box, world space. Only beams that may meet the box are cast; the others give no
        return. A moving sensor casts all.
    target : VisibilityQuery, optional
        A prepared part of the scene that does not move. Only beams that would meet it alone are cast: all its points
        are found, and few others.
    **options
        Options of the method.

    Returns
    -------
    Scan
        In the order of the sensor's rays.

    Raises
    ------
    ArgumentError
        A pose that is no rigid transform; a pose and a range; no scene or sensor; an occluder of another mesh.
    OptionError, UnavailableError
        As `zbuf_occlude.prepare`; a method that casts no rays; a motion of a sensor that casts all rays at once.

    Warns
    -----
    UserWarning
        With `range`: the sensor stands inside the mesh's bounding box. Without `occluder`: objects move, but all rays
        are cast at once; a trajectory is longer or shorter than the sweep.

    Examples
    --------
    >>> found = zo.scan("car.obj", "hdl-64e", range=15, azimuth=30)
    >>> found.points.shape == found.normals.shape == (len(found), 3)
    True
    >>> found.save("scan.npz")
    """
    check_keywords(scan, method, options)
    for name, given in (("occluder", occluder), ("target", target)):
        if given is not None and not isinstance(given, VisibilityQuery):
            raise ArgumentError(f"{name} must be a VisibilityQuery, made by prepare; got {type(given).__name__}.")
    sensor = make(sensor)
    scene = _scene_of(scene, size=size, up=up, unit=unit, transparent=transparent)
    if occluder is None:
        precompile(method, question_of(sensor, motion))
    if range is not None:
        if pose is not None:
            raise ArgumentError("give pose or range, not both.")
        pose = _pose_at(scene.mesh, range, azimuth, elevation, is_assumed=size is None and unit is None)
    elif azimuth is not None or elevation is not None:
        raise ArgumentError("azimuth and elevation must go with range, metres from the mesh's centre. Give it.")
    matrix = np.eye(4) if pose is None else as_rigid(pose, "pose")
    query: dict[str, Any] = {"occluder": occluder, "towards": towards, "target": target, **options}
    rng = generator(seed)
    returns = noiseless_scan(scene, sensor, matrix[:3, :3], matrix[:3, 3], motion=motion, method=method, **query)
    return apply_noise(returns, sensor, rng)


def question_of(sensor: Sensor, motion: Motion | None) -> str:
    """Return what a sensor asks, as `zbuf_occlude.visibility.precompile` takes it: rays of one origin or of many."""
    return "rays" if motion is None and not sensor.ray_starts(np.ones((1, 3))).any() else "scattered rays"


def noiseless_scan(
    scene: Scene,
    sensor: Sensor,
    rotation: FloatArray,
    origin: FloatArray,
    *,
    motion: Motion | None = None,
    method: str = "exact",
    occluder: VisibilityQuery | None = None,
    towards: ArrayLike | None = None,
    target: VisibilityQuery | None = None,
    **options: Any,
) -> Scan:
    """Return all returns of a scan before limits, losses and noise (`apply_noise`); parameters as of `scan`."""
    rays = rays_at_rest = sensor.rays()
    _check_motion(scene, sensor, motion, warns=occluder is None)
    if motion is not None:
        rays = motion.applied(rays_at_rest)
    if towards is not None and motion is None:
        corners = as_vectors(as_numbers(towards, "towards", (2, 3)), "towards")
        rays = rays_at_rest = rays.select(
            _rays_near_box(rays, rotation, origin, corners, sensor.noise_model.divergence)
        )
    if target is not None:
        hits = (cast_beams(target, rays, rotation, origin, sensor.noise_model).face_ids >= 0).any(axis=(1, 2))
        rays, rays_at_rest = rays.select(hits), rays_at_rest.select(hits)
    find_method(method).check_first_hits()
    with prepare_scene(scene, method, **options) if occluder is None else nullcontext(occluder) as opened:
        if not (scene.is_opaque_and_static or isinstance(opened, DynamicScene)):
            raise ArgumentError(
                "occluder of a scene with moving or transparent objects must be made by prepare_scene. Leave it out."
            )
        opened.check_is_of(scene.mesh)
        returns, ray_ids = _returns(scene, opened, rays, rotation, origin, sensor)
    if motion is not None and not motion.deskew:
        returns = _as_if_at_rest(returns, rays_at_rest.select(ray_ids), motion, rotation)
    return returns


def _scene_of(
    scene: Scene | MeshLike,
    *,
    size: float | None,
    up: str | None,
    unit: str | None,
    transparent: Mapping[str, float | None] | None,
) -> Scene:
    """Return the scene of `scan`'s arguments: a scene as it is, a mesh alone."""
    if not isinstance(transparent, Mapping | None):
        raise ArgumentError(f"transparent must be a mapping of names to shares; got {type(transparent).__name__}.")
    if isinstance(scene, Scene):
        if any(each is not None for each in (size, up, unit, transparent)):
            raise ArgumentError("size, up, unit and transparent are for a mesh; a scene has its own. Leave them out.")
        return scene
    if size is not None and unit is not None:
        raise ArgumentError(f"give size or unit, not both; got {size} and {unit!r}. A size needs no unit.")
    mesh = as_mesh(scene, up=up, unit=unit, colors=transparent is not None, name="scene")
    found = Scene.from_mesh(_of_size(mesh if transparent is None else mesh.transparent(transparent), size))
    if transparent and found.transmittance is None:
        raise ArgumentError(no_transparent_material("transparent", mesh))
    return found


def _check_motion(scene: Scene, sensor: Sensor, motion: Motion | None, *, warns: bool) -> None:
    """Raise or warn where a sensor cannot move, or what it sees cannot."""
    rays = sensor.rays()
    if motion is not None and not isinstance(motion, Motion):
        raise ArgumentError(f"motion must be a sensors.Motion; got {type(motion).__name__}. Make one.")
    if len(sensor.noise_model.baselines) and (motion is not None or (scene.moving and rays.times is not None)):
        raise ArgumentError("a sensor with a second camera must not move, nor objects before it. Or set baseline=0.")
    if reason := sensor.no_motion_reason:
        if motion is not None:
            raise OptionError(reason)
        if scene.moving and warns:
            warnings.warn(f"objects that move stand still: {reason}", stacklevel=4)
    if motion is not None and warns and (reason := motion.duration_mismatch(rays)):
        warnings.warn(f"{reason}.", stacklevel=4)


def no_transparent_material(option: str, mesh: Mesh) -> str:
    """Return the message for names that match no material, or none that lets light pass."""
    names = sorted({m.name for m in mesh.colors.materials if m.name} if mesh.colors is not None else ())
    return (
        f"{option} must name materials that let light pass, or a share for them; of {', '.join(names)[:200] or 'none'} "
        f"of {mesh.name} none does. Give NAME=SHARE."
    )


def _of_size(mesh: Mesh, size: float | None) -> Mesh:
    """Return the mesh scaled about its centre to a longest side of `size`; unchanged for None."""
    if size is None:
        return mesh
    metres = as_number(size, "size", "metres above 0", lambda number: number > 0.0)
    if not mesh.longest_side > 0.0:
        raise ArgumentError(f"{mesh.name} cannot be given a size: all its vertices coincide.")
    factor = metres / mesh.longest_side
    return mesh.transformed(factor, mesh.centre * (1.0 - factor))


def _pose_at(
    mesh: Mesh, distance: float, azimuth: float | None, elevation: float | None, *, is_assumed: bool
) -> FloatArray:
    """Return the pose of a sensor that looks at a mesh's centre from angles in degrees, 0 by default.

    `is_assumed` is True where neither the mesh's size nor its unit was given.
    """
    distance = as_number(distance, "range", "metres above 0", lambda number: number > 0.0)
    azimuth, elevation = (0.0 if angle is None else angle for angle in (azimuth, elevation))
    view = from_angles(azimuth, elevation, distance).around(mesh.centre, 1.0)
    if mesh.in_box(view.eyes).any():
        how, cure = (", its numbers taken as metres", ", or give unit=") if is_assumed else ("", "")
        warnings.warn(
            f"the sensor stands inside the mesh's bounding box: range is {distance:g} m, the mesh's longest side "
            f"{mesh.longest_side:g} m{how}. Raise range{cure}.",
            stacklevel=3,
        )
    return look_at(view.eyes[0], mesh.centre)


def _rays_near_box(
    rays: Rays, rotation: FloatArray, origin: FloatArray, corners: FloatArray, divergence: float
) -> NDArray[np.intp]:
    """Return the indices of the rays whose beams may meet a box.

    A faster test against the box's bounding ball goes first. All rays are taken to start at `origin`; the box is
    enlarged by their greatest distance from it.
    """
    to_middle, half = corners.mean(axis=0) - origin, np.ptp(corners, axis=0) / 2.0 + rays.spread
    distance, radius = float(np.linalg.norm(to_middle)), float(np.linalg.norm(half))
    if distance <= radius * 1.001:
        return np.arange(len(rays))
    angle = np.arcsin(radius / distance) + divergence + 1e-6
    near = rays.near(rotation.T @ to_middle / distance, angle)
    directions = rotation @ rays.directions[near].T  # (3, n): NumPy is slow along short rows
    half = half + (divergence + 1e-6) * (distance + radius)  # greatest distance of a beam's edge from its axis
    with np.errstate(divide="ignore"):
        ends = (to_middle + np.stack([-half, half]))[:, :, None] / np.where(directions == 0.0, 1e-300, directions)
    entered, left = ends.min(axis=0).max(axis=0), ends.max(axis=0).min(axis=0)
    return np.asarray(near[(entered <= left) & (left >= 0.0)])


def _returns(
    scene: Scene, occluder: VisibilityQuery, rays: Rays, rotation: FloatArray, origin: FloatArray, sensor: Sensor
) -> tuple[Scan, NDArray[np.intp]]:
    """Return the noiseless returns of all beams, and the indices of their rays."""
    directions = rays.directions @ rotation.T
    hits = cast_beams(occluder, rays, rotation, origin, sensor.noise_model)
    found = echoes_of(hits, sensor.noise_model, scene.transmittance)
    offsets = _offsets(rays, rotation)
    if len(sensor.noise_model.baselines):
        starts = origin + offsets[found.rays]
        points = starts + found.ranges[:, None] * directions[found.rays]
        found = select_triangulated(found, occluder, scene.mesh, rays, points, starts, rotation, sensor)
    ray_ids, face_ids, ranges = found.rays, found.face_ids, found.ranges
    directions, instances = directions[ray_ids], scene.instances[face_ids]
    times = np.zeros(len(ray_ids)) if rays.times is None else rays.times[ray_ids]
    normals = normals_at(scene, instances, times, unit_vectors(scene.mesh.face_normals[face_ids]))
    cosines = -np.einsum("ij,ij->i", normals, directions)
    normals *= np.where(cosines < 0.0, -1.0, 1.0)[:, None]
    cosines = np.minimum(np.abs(cosines), 1.0)
    starts, squares = origin + offsets[ray_ids], np.maximum(ranges, 1e-6) ** 2
    returns = Scan(
        origin=origin,
        directions=directions,
        offsets=offsets[ray_ids],
        times=times,
        depths_per_range=rays.directions[ray_ids, 0],
        ranges=ranges,
        clean_ranges=ranges,
        face_ids=face_ids,
        normals=normals,
        incidences=np.arccos(cosines),
        intensities=_albedos(scene, face_ids, starts + ranges[:, None] * directions) * found.lights * cosines / squares,
        rings=rays.rings[ray_ids],
        columns=rays.columns[ray_ids],
        instances=instances,
        n_returns=found.n_returns,
        return_numbers=found.numbers,
        shares=found.shares,
    )
    return returns, ray_ids


def _albedos(scene: Scene, face_ids: IntArray, points: FloatArray) -> FloatArray:
    """Return the albedos at points of faces: the luminance of the mesh's colours if it has any, else the objects'."""
    if scene.mesh.colors is None:
        found = np.asarray(scene.albedos[scene.instances[face_ids]])
    else:
        found = luminance(scene.mesh.colors.at(face_ids, barycentric(scene.mesh.corners[face_ids], points)))
    return found if scene.scattering is None else found * scene.scattering[face_ids]


def _as_if_at_rest(scan: Scan, rays: Rays, motion: Motion, rotation: FloatArray) -> Scan:
    """Return a scan as a sensor that ignores its motion reports it: all `rays` start at the sensor's first pose."""
    rotations, _ = motion.poses(scan.times)
    local = np.einsum("nji,nj->ni", rotations, scan.normals @ rotation)
    offsets, directions = _offsets(rays, rotation), rays.directions @ rotation.T
    return replace(scan, directions=directions, offsets=offsets, normals=local @ rotation.T)


def _offsets(rays: Rays, rotation: FloatArray) -> FloatArray:
    """Return the vectors (n, 3) from the sensor's origin to the starts of the rays, world space."""
    return np.zeros((len(rays), 3)) if rays.origins is None else np.asarray(rays.origins @ rotation.T)
