"""Captures of a target in a scene: one scan per view, cut down to the points that the configuration keeps."""

from collections.abc import Callable, Iterator
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from itertools import repeat
from typing import NamedTuple

import numpy as np

from zbuf_occlude.base.arrays import BoolArray, FloatArray
from zbuf_occlude.base.errors import MeshError
from zbuf_occlude.base.provenance import generator
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.meshes.sampling import SurfacePoints, sample_surface
from zbuf_occlude.sensors.casting import prepare_scene
from zbuf_occlude.sensors.noise import apply_noise, measured_ranges
from zbuf_occlude.sensors.poses import look_at, pose_of_camera
from zbuf_occlude.sensors.returns import Scan
from zbuf_occlude.sensors.scan_config import ScanConfig
from zbuf_occlude.sensors.scanning import noiseless_scan
from zbuf_occlude.sensors.scenes.contents import Pool, at_rest_of, placed_of
from zbuf_occlude.sensors.scenes.kinds import METHOD, N_POINTS, TOLERANCE, SceneRequest
from zbuf_occlude.sensors.scenes.scene import Placed, Scene, upright_pose
from zbuf_occlude.sensors.scenes.sizes import size_of
from zbuf_occlude.sensors.sensor import Sensor
from zbuf_occlude.views import Views
from zbuf_occlude.visibility.interface import VisibilityQuery

Seeds = Callable[[str, int], np.random.SeedSequence]
"""Returns the seed of a draw, for the name of the draw and the number of the view."""
ENLARGED = 1.1
"""Factor from the target's sides to those of a box that is kept."""
SCALED = (0.8, 1.2)
"""Range of the factors by which the sides of a box are drawn."""
LOWEST = 0.01
"""Minimum height of a camera above the ground, metres."""
_NOWHERE = np.empty((0, 3))


class Cut(NamedTuple):
    """Returns of a target that the sensor's limits of range remove from one scan."""

    n_returns: int = 0  # of the target, before the limits
    n_too_near: int = 0  # below `range_min`
    n_too_far: int = 0  # above `range_max`
    clear_range: float = 0.0  # smallest `--range` at which no return is too near, metres; 0 where none is


@dataclass(frozen=True, eq=False)
class Capture:
    """One scan of a target.

    Parameters
    ----------
    scan : Scan
        The returns that are kept. World space: metres, the centre of the target's box at the origin.
    returns : Scan
        All returns before the sensor's limits, losses and noise.
    scene : Scene
        The scene that the rays met; unless `keep` is "all", without the objects that no ray to the target can meet.
    occluder : VisibilityQuery
        The prepared scene, open until the next capture.
    pose : (4, 4) float
        Sensor to world.
    hidden : float
        Share of the target hidden by others.
    reached : bool
        True where `hidden` is within 2 percent of the range asked for, or none was asked for.
    cut : Cut
        Returns of the target outside the sensor's limits of range.
    """

    scan: Scan
    returns: Scan
    scene: Scene
    occluder: VisibilityQuery
    pose: FloatArray
    hidden: float = 0.0
    reached: bool = True
    cut: Cut = field(default_factory=Cut)


def in_metres(mesh: Mesh, label: str, config: ScanConfig) -> tuple[Mesh, float]:
    """Return a mesh in metres with the centre of its box at the origin, and its longest side, metres."""
    if mesh.longest_side == 0.0:
        raise MeshError(f"{mesh.name} cannot be scanned: all its vertices coincide.")
    size = size_of(label, config.size, mesh.longest_side)
    factor = size / mesh.longest_side
    colors = None if mesh.colors is None else mesh.colors.transparent(config.transparent)
    return Mesh((mesh.vertices - mesh.centre) * factor, mesh.faces, mesh.name, colors=colors), size


def sensor_views(views: Views, size: float, floor: float, config: ScanConfig, seeds: Seeds) -> Views:
    """Return the views of the sensor about the origin, metres; `size` is the target's longest side.

    Cameras of a file keep their poses. Above a ground or a table, at the height `floor`, a LiDAR takes only the
    azimuths from `views`, and other cameras that would be below it are raised. A range of distances that starts
    inside the target is cut to the part outside.
    """
    if views.rotations is not None:
        return views
    lengths = views.distance * size
    if config.range is not None:
        low, high = config.range
        low = max(low, min(size / 2, high))
        power = 2.0 if config.range_law == "area" else 1.0
        draws = [np.random.default_rng(seeds("range", i)).uniform(low**power, high**power) for i in range(len(views))]
        lengths = np.array(draws) ** (1.0 / power)
    azimuth, elevation, distance = views.azimuth, views.elevation, lengths
    if config.height is not None:
        up = floor + config.height - (0.0 if config.table is None else config.table["height"])
        elevation, distance = np.arctan2(up, lengths), np.hypot(up, lengths)
    elif config.kind.sensor_height is not None or config.table is not None:
        elevation = np.maximum(elevation, np.arcsin(np.clip((floor + LOWEST) / lengths, -1.0, 1.0)))
    if (lengths <= size / 2).any():
        is_of_file = isinstance(config.size, str)
        cure = ", or give the --unit of the files: without it they are taken to be in metres" if is_of_file else ""
        option = "--distance" if config.range is None else "--range"
        raise MeshError(
            f"the range must be more than half the object's {size:g} m; it is {lengths.min():g} m. "
            f"Raise {option}{cure}."
        )
    return Views(azimuth, elevation, distance, roll=views.roll if config.height is None else 0.0)


def n_raised(requested: Views, views: Views, config: ScanConfig) -> int:
    """Return how many cameras `sensor_views` raised above the ground, given its argument and its result."""
    if requested.rotations is not None or config.height is not None:
        return 0
    return int((views.elevation > requested.elevation).sum())


def captures(mesh: Mesh, config: ScanConfig, views: Views, floor: float, seeds: Seeds, pool: Pool) -> Iterator[Capture]:
    """Yield the capture of a target (as `in_metres` returns it) from each view (as `sensor_views` returns them).

    The occluder of a capture is open until the next capture is requested.
    """
    poses, target = _poses(views, config), Placed(mesh, "target")
    target_scene = Scene.joined([target])
    with prepare_scene(target_scene, config.method) as alone:

        def captured(scene: Scene, occluder: VisibilityQuery, view: int) -> Capture:
            sensor, pose = config.sensor.of_view(views, view), poses[view]
            returns = noiseless_scan(
                scene,
                sensor,
                pose[:3, :3],
                pose[:3, 3],
                occluder=occluder,
                towards=_region(mesh, config),
                target=alone if config.keep == "target" and occluder is not alone else None,
                motion=config.motion,
            )
            found = apply_noise(returns, sensor, generator(seeds("scan", view)))
            kept = _kept(found, mesh, config, np.random.default_rng(seeds("box", view)))
            return Capture(found.select(kept), returns, scene, occluder, pose, cut=_cut(returns, sensor, mesh, pose))

        if config.may_hide:
            points, visible_alone = _visible_alone(target_scene, alone, views, config, seeds)
        if config.share is None:  # the same scene for all views
            placed = _arrange(target, config, views, floor, seeds, pool, 0)
            scene = Scene.joined(placed, rng=np.random.default_rng(seeds("albedo", 0)))
            shares = [0.0] * len(poses)
            with nullcontext(alone) if len(placed) == 1 else prepare_scene(scene, config.method) as occluder:
                if config.may_hide:
                    visible = _visible(scene, occluder, points, views.eyes, config)
                    shares = [_hidden_share(mask[own]) for mask, own in zip(visible, visible_alone, strict=True)]
                for number, hidden in enumerate(shares):
                    yield replace(captured(scene, occluder, number), hidden=hidden)
            return
        for number, (eye, own) in enumerate(zip(views.eyes, visible_alone, strict=True)):
            own_points = points.select(own)
            placed = _arrange(target, config, views, floor, seeds, pool, number, own_points.positions)
            near = _near(placed, eye, _kept_radius(mesh, config), config)
            rng = np.random.default_rng(seeds("albedo", number))
            scene = Scene.joined(placed, None if config.keep == "all" else near, rng)
            with prepare_scene(scene, config.method) as occluder:
                hidden = _hidden_share(_visible(scene, occluder, own_points, eye[None], config))
                reached = config.share[0] - TOLERANCE <= hidden <= config.share[1] + TOLERANCE
                capture = captured(scene, occluder, number)
                yield replace(capture, hidden=hidden, reached=reached)


def captured_scenes(
    mesh: Mesh, config: ScanConfig, views: Views, floor: float, seeds: Seeds, pool: Pool
) -> Iterator[Scene]:
    """Yield the whole scene of each view, as `captures` draws it; one object where all views share a scene."""
    target = Placed(mesh, "target")
    if config.share is None:
        scene = Scene.joined(_arrange(target, config, views, floor, seeds, pool, 0))
        yield from repeat(scene, len(views))
        return
    target_scene = Scene.joined([target])
    with prepare_scene(target_scene, METHOD) as alone:
        points, visible_alone = _visible_alone(target_scene, alone, views, config, seeds)
    for number, own in enumerate(visible_alone):
        positions = points.positions[own]
        yield Scene.joined(_arrange(target, config, views, floor, seeds, pool, number, positions))


def _visible_alone(
    target_scene: Scene, alone: VisibilityQuery, views: Views, config: ScanConfig, seeds: Seeds
) -> tuple[SurfacePoints, BoolArray]:
    """Return points of a target, and the mask (k, n) of those that each eye would see if the target were alone."""
    points = sample_surface(target_scene.mesh, n_points=N_POINTS, seed=seeds("points", 0))
    return points, _visible(target_scene, alone, points, views.eyes, config)


def _arrange(
    target: Placed,
    config: ScanConfig,
    views: Views,
    floor: float,
    seeds: Seeds,
    pool: Pool,
    view: int,
    positions: FloatArray = _NOWHERE,
) -> list[Placed]:
    """Put objects around a target; `positions` are those that the view would see of the target alone."""
    request = SceneRequest(target, views.eyes[view], floor, positions, config.share, pool, config.table)
    rng = np.random.default_rng(seeds("scene", view))
    placed = config.kind.arrange(request, rng)
    fixed = placed_of(config.objects, floor, config.transparent)
    resting = at_rest_of(config.objects, request, fixed, rng, config.transparent)
    return [*placed, *fixed, *resting]


def _visible(
    scene: Scene, occluder: VisibilityQuery, points: SurfacePoints, eyes: FloatArray, config: ScanConfig
) -> BoolArray:
    """Return the mask (k, n) of a target's points that each eye sees in a scene, by `METHOD`.

    `occluder` is the scene prepared by the method of the scans. The target comes first in a scene: its faces have the
    same numbers there.
    """
    with nullcontext(occluder) if config.method == METHOD else prepare_scene(scene, METHOD) as query:
        return query.visible(points, eyes)


def _hidden_share(visible: BoolArray) -> float:
    """Return the share that others hide, given the mask of the points that are visible in the target alone."""
    return 1.0 - float(visible.mean()) if visible.size else 0.0


def _region(mesh: Mesh, config: ScanConfig) -> FloatArray | None:
    """Return the corners of a box that contains all points kept; None where all points are kept."""
    if config.keep == "all":
        return None
    return mesh.bounds if config.box is None else _kept_radius(mesh, config) * np.array([[-1.0], [1.0]]) * np.ones(3)


def _poses(views: Views, config: ScanConfig) -> list[FloatArray]:
    """Return the poses of the sensor: level for a LiDAR above a ground, else looking at the target, with the roll."""
    if config.is_level:
        return [look_at(eye, [0.0, 0.0, eye[2]]) for eye in views.eyes]
    return [pose_of_camera(matrix) for matrix in views.poses]


def _kept_radius(mesh: Mesh, config: ScanConfig) -> float:
    """Return the radius about the origin within which points are kept."""
    half = mesh.diagonal / 2
    if config.box is None:
        return half
    return half * ENLARGED * (SCALED[1] if config.box["scale"] else 1.0) + config.box["shift"] * mesh.diagonal


def _near(placed: list[Placed], eye: FloatArray, radius: float, config: ScanConfig) -> BoolArray:
    """Return the mask of the objects that a ray from `eye` may meet if it passes within `radius` of the origin."""
    near = np.ones(len(placed), dtype=bool)
    distance = float(np.linalg.norm(eye))
    sensor = config.sensor
    spread = sensor.rays().spread
    radius += spread  # all rays are taken to start at the eye; everything else is enlarged by their distance from it
    if distance <= radius or config.motion is not None or len(sensor.noise_model.baselines):
        return near
    half_angle = np.arcsin(radius / distance) + sensor.noise_model.divergence + 1e-6
    for number, each in enumerate(placed[1:], 1):
        to_it = each.centre - eye
        own_radius, away = each.radius + spread, float(np.linalg.norm(to_it))
        if away > own_radius:
            angle = np.arccos(np.clip(-to_it @ eye / (away * distance), -1.0, 1.0))
            near[number] = angle <= half_angle + np.arcsin(own_radius / away)
    return near


def _cut(returns: Scan, sensor: Sensor, mesh: Mesh, pose: FloatArray) -> Cut:
    """Return the count of a target's returns that the limits of range remove from all `returns`."""
    model = sensor.noise_model
    measured = measured_ranges(returns, model)[returns.instances == 0]
    n_near, n_far = int((measured < model.range_min).sum()), int((measured > model.range_max).sum())
    if not n_near:
        return Cut(len(measured), 0, n_far)
    axis, at = pose[:3, 0], pose[:3, 3]  # the sensor looks along it, so a larger `--range` moves the sensor back on it
    nearest = float(((mesh.vertices - at) @ axis).min())  # no range is less than the depth
    return Cut(len(measured), n_near, n_far, model.range_min - float(at @ axis) - nearest)


def _kept(found: Scan, mesh: Mesh, config: ScanConfig, rng: np.random.Generator) -> BoolArray:
    if config.keep == "all":
        return np.ones(len(found), dtype=bool)
    if config.box is None:
        return np.asarray(found.instances == 0)
    sides = np.ptp(mesh.bounds, axis=0)
    middle = rng.uniform(-1.0, 1.0, 3) * config.box["shift"] * sides
    angle = rng.uniform(-np.pi, np.pi) if config.box["rotate"] else 0.0
    factors = ENLARGED * (rng.uniform(*SCALED, 3) if config.box["scale"] else np.ones(3))
    local = (found.positions - middle) @ upright_pose(angle)[:3, :3]
    return np.asarray((np.abs(local) <= factors * sides / 2).all(axis=1))
