"""A target seen by a sensor from its views, in a scene: one scan per view, of which the points asked for are kept."""

from collections.abc import Callable, Iterator
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from itertools import repeat
from typing import NamedTuple

import numpy as np

from zbuf_occlude.arrays import BoolArray, FloatArray
from zbuf_occlude.errors import MeshError
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.geometry.sampling import SurfacePoints, sample_surface
from zbuf_occlude.provenance import generator
from zbuf_occlude.scenes.contents import placed_of
from zbuf_occlude.scenes.kinds import METHOD, N_POINTS, WITHIN, SceneLayout, SceneRequest
from zbuf_occlude.scenes.scene import Placed, Scene, moved
from zbuf_occlude.scenes.sizes import size_of
from zbuf_occlude.sensors.casting import prepare_scene
from zbuf_occlude.sensors.scanning import Scan, apply_noise, faultless, look_at, measured_ranges, pose_of_camera
from zbuf_occlude.sensors.sensor import Sensor
from zbuf_occlude.sensors.setup import ScanConfig
from zbuf_occlude.views import Views
from zbuf_occlude.visibility.interface import VisibilityQuery

Pool = Callable[[float], tuple[Mesh, str]]
"""Returns an object of the surroundings by a number in [0, 1): a mesh standing on z = 0, in metres, and its class."""
Seeds = Callable[[str, int], np.random.SeedSequence]
"""Returns the seed of a draw, by what is drawn and the view's number."""
ENLARGED = 1.1
"""A box that is kept has sides this many times the target's."""
SCALED = (0.8, 1.2)
"""Between what factors a box is scaled."""
LOWEST = 0.01
"""Metres that a camera is above the ground, at least."""
_NOWHERE = np.empty((0, 3))


class Cut(NamedTuple):
    """What a sensor's limits of range cut off a target, of one scan."""

    n_returns: int = 0  # of the target, within the limits or not
    n_near: int = 0  # of them those nearer than the sensor measures
    n_far: int = 0
    clear_range: float = 0.0  # metres: from this `--range` on nothing of the target is too near; 0 where nothing is


@dataclass(frozen=True, eq=False)
class Capture:
    """One scan of a target.

    Parameters
    ----------
    scan : Scan
        What is kept of it; world space: metres, the middle of the target's box at the origin.
    returns : Scan
        All returns before the sensor's limits, losses and noise.
    scene : Scene
        What the rays met; of `keep` other than "all" only what may stand near them.
    occluder : VisibilityQuery
        The scene's, still open until the next capture.
    pose : (4, 4) float
        Sensor to world.
    wanted, hidden : float
        Share of the target that was to be hidden by others, and that is, by the mask.
    reached : bool
        Whether `hidden` is within 2 percent of the range asked for; True where none was.
    cut : Cut
        What the sensor's limits of range took from the target.
    """

    scan: Scan
    returns: Scan
    scene: Scene
    occluder: VisibilityQuery
    pose: FloatArray
    wanted: float = 0.0
    hidden: float = 0.0
    reached: bool = True
    cut: Cut = field(default_factory=Cut)


def in_metres(mesh: Mesh, label: str, setup: ScanConfig) -> tuple[Mesh, float]:
    """Return a mesh in metres with the middle of its box at the origin, and the metres of its longest side."""
    if mesh.longest_side == 0.0:
        raise MeshError(f"a mesh must have an extent to be scanned; all vertices of {mesh.name} coincide.")
    size = size_of(label, setup.size, mesh.longest_side)
    factor = size / mesh.longest_side
    colors = mesh.colors.transparent(setup.transparent) if mesh.colors is not None and setup.transparent else None
    return Mesh((mesh.vertices - mesh.centre) * factor, mesh.faces, mesh.name, colors=colors), size


def sensor_places(views: Views, size: float, floor: float, setup: ScanConfig, seeds: Seeds) -> Views:
    """Return where the sensor stands for each view, about the origin, metres; `size` is the target's.

    Cameras of a file stay where they are. Where there is a ground, at the height `floor`, only the views' azimuths
    count for LiDARs; other cameras that would stand below it are raised. Of a range that begins within the target, what
    lies outside it is taken.
    """
    if views.rotations is not None:
        return views
    lengths = views.distance * size
    if setup.range is not None:
        low, high = setup.range
        low = max(low, min(size / 2, high))
        lengths = np.array([np.random.default_rng(seeds("range", i)).uniform(low, high) for i in range(len(views))])
    azimuth, elevation, distance = views.azimuth, views.elevation, lengths
    if setup.height is not None:
        up = floor + setup.height
        elevation, distance = np.arctan2(up, lengths), np.hypot(up, lengths)
    elif setup.kind.sensor_height is not None:
        elevation = np.maximum(elevation, np.arcsin(np.clip((floor + LOWEST) / lengths, -1.0, 1.0)))
    if (lengths <= size / 2).any():
        is_of_file = isinstance(setup.size, str)
        cure = ", or give the --unit of the files: without it they are taken to be in metres" if is_of_file else ""
        option = "--distance" if setup.range is None else "--range"
        raise MeshError(
            f"the range must be more than half the object's {size:g} m; it is {lengths.min():g} m. "
            f"Raise {option}{cure}."
        )
    return Views(azimuth, elevation, distance, roll=views.roll if setup.height is None else 0.0)


def n_raised(views: Views, places: Views, setup: ScanConfig) -> int:
    """Count the cameras of some views that `sensor_places` has raised above the ground."""
    if views.rotations is not None or setup.height is not None:
        return 0
    return int((places.elevation > views.elevation).sum())


def captures(mesh: Mesh, setup: ScanConfig, places: Views, floor: float, seeds: Seeds, pool: Pool) -> Iterator[Capture]:
    """Scan a target, as `in_metres` returns it, from each of `places`, as `sensor_places` returns them.

    The occluder of a capture is open until the next one is asked for.
    """
    poses, target = _poses(places, setup), Placed(mesh, "target")
    itself = Scene.joined([target])
    with prepare_scene(itself, setup.method) as alone:

        def captured(scene: Scene, occluder: VisibilityQuery, view: int) -> Capture:
            sensor, pose = setup.sensor_of(places, view), poses[view]
            returns = faultless(
                scene,
                sensor,
                pose[:3, :3],
                pose[:3, 3],
                occluder=occluder,
                towards=_region(mesh, setup),
                target=alone if setup.keep == "target" and occluder is not alone else None,
                motion=setup.motion_model,
            )
            found = apply_noise(returns, sensor, generator(seeds("scan", view)))
            kept = _kept(found, mesh, setup, np.random.default_rng(seeds("box", view)))
            return Capture(found.select(kept), returns, scene, occluder, pose, cut=_cut(returns, sensor, mesh, pose))

        if setup.share is not None or setup.objects:  # others may hide some of the target
            points, showing = _showing(itself, alone, places, setup, seeds)
        if setup.share is None:  # the same scene for all views
            placed = _arranged(target, setup, places, floor, seeds, pool, 0).placed
            scene = Scene.joined(placed, rng=np.random.default_rng(seeds("albedo", 0)))
            shares = [0.0] * len(poses)
            with nullcontext(alone) if len(placed) == 1 else prepare_scene(scene, setup.method) as occluder:
                if setup.objects:
                    left = _visible(scene, occluder, points, places.eyes, setup)
                    shares = [_hidden(seen[shown]) for seen, shown in zip(left, showing, strict=True)]
                for number, hidden in enumerate(shares):
                    yield replace(captured(scene, occluder, number), hidden=hidden)
            return
        for number, (eye, shown) in enumerate(zip(places.eyes, showing, strict=True)):
            seen = points.select(shown)
            arranged = _arranged(target, setup, places, floor, seeds, pool, number, seen.positions)
            near = _near(arranged.placed, eye, _reach(mesh, setup), setup)
            paint = np.random.default_rng(seeds("albedo", number))
            scene = Scene.joined(arranged.placed, None if setup.keep == "all" else near, paint)
            with prepare_scene(scene, setup.method) as occluder:
                hidden = _hidden(_visible(scene, occluder, seen, eye[None], setup))
                reached = setup.share[0] - WITHIN <= hidden <= setup.share[1] + WITHIN
                capture = captured(scene, occluder, number)
                yield replace(capture, wanted=arranged.wanted, hidden=hidden, reached=reached)


def captured_scenes(
    mesh: Mesh, setup: ScanConfig, places: Views, floor: float, seeds: Seeds, pool: Pool
) -> Iterator[Scene]:
    """Yield the whole scene of each view, as `captures` draws it; the same object where all views have the same."""
    target = Placed(mesh, "target")
    if setup.share is None:
        scene = Scene.joined(_arranged(target, setup, places, floor, seeds, pool, 0).placed)
        yield from repeat(scene, len(places))
        return
    itself = Scene.joined([target])
    with prepare_scene(itself, METHOD) as alone:
        points, showing = _showing(itself, alone, places, setup, seeds)
    for number, shown in enumerate(showing):
        seen = points.positions[shown]
        yield Scene.joined(_arranged(target, setup, places, floor, seeds, pool, number, seen).placed)


def _showing(
    itself: Scene, alone: VisibilityQuery, places: Views, setup: ScanConfig, seeds: Seeds
) -> tuple[SurfacePoints, BoolArray]:
    """Return points of a target, and which of them each place sees (k, n), were it alone."""
    points = sample_surface(itself.mesh, n_points=N_POINTS, seed=seeds("points", 0))
    return points, _visible(itself, alone, points, places.eyes, setup)


def _arranged(
    target: Placed,
    setup: ScanConfig,
    places: Views,
    floor: float,
    seeds: Seeds,
    pool: Pool,
    view: int,
    seen: FloatArray = _NOWHERE,
) -> SceneLayout:
    """Put objects around a target for a view that would see these positions of it alone."""
    asked = SceneRequest(target, places.eyes[view], floor, seen, setup.share, pool)
    found = setup.kind.arrange(asked, np.random.default_rng(seeds("scene", view)))
    of_file = placed_of([dict(each) for each in setup.objects], floor, setup.transparent)
    return found._replace(placed=found.placed + of_file)


def _visible(
    scene: Scene, occluder: VisibilityQuery, points: SurfacePoints, eyes: FloatArray, setup: ScanConfig
) -> BoolArray:
    """Which points of a scene's target each eye sees, by `METHOD`; `occluder` is by the method of the scans.

    The target is the first of a scene: its faces have the same numbers there.
    """
    with nullcontext(occluder) if setup.method == METHOD else prepare_scene(scene, METHOD) as judge:
        return judge.visible(points, eyes)


def _hidden(left: BoolArray) -> float:
    """Return the share that others hide of the points that the target alone shows; `left` are those still visible."""
    return 1.0 - float(left.mean()) if left.size else 0.0


def _region(mesh: Mesh, setup: ScanConfig) -> FloatArray | None:
    """The corners of a box that all points kept lie in; None where there is none."""
    if setup.keep == "all":
        return None
    return mesh.bounds if setup.box is None else _reach(mesh, setup) * np.array([[-1.0], [1.0]]) * np.ones(3)


def _poses(places: Views, setup: ScanConfig) -> list[FloatArray]:
    """A LiDAR on the ground stands level and looks towards the target; every other sensor looks at it, rolled."""
    if setup.is_level:
        return [look_at(eye, [0.0, 0.0, eye[2]]) for eye in places.eyes]
    return [pose_of_camera(matrix) for matrix in places.poses]


def _reach(mesh: Mesh, setup: ScanConfig) -> float:
    """How far from the origin anything is kept."""
    half = mesh.diagonal / 2
    if setup.box is None:
        return half
    return half * ENLARGED * (SCALED[1] if setup.box["scale"] else 1.0) + setup.box["shift"] * mesh.diagonal


def _near(placed: list[Placed], eye: FloatArray, reach: float, setup: ScanConfig) -> BoolArray:
    """Which objects a ray may meet that passes within `reach` of the origin; the others change no answer of those."""
    near = np.ones(len(placed), dtype=bool)
    distance = float(np.linalg.norm(eye))
    sensor = setup.sensor_model
    spread = sensor.rays().spread
    reach += spread  # rays are taken to begin at the eye, and all else to be larger by as far as they do not
    if distance <= reach or setup.motion is not None or len(sensor.imperfections.second_eyes):
        return near
    half_angle = np.arcsin(reach / distance) + sensor.imperfections.divergence + 1e-6
    for number, each in enumerate(placed[1:], 1):
        to_it = each.centre - eye
        radius, away = each.radius + spread, float(np.linalg.norm(to_it))
        if away > radius:
            angle = np.arccos(np.clip(-to_it @ eye / (away * distance), -1.0, 1.0))
            near[number] = angle <= half_angle + np.arcsin(radius / away)
    return near


def _cut(returns: Scan, sensor: Sensor, mesh: Mesh, pose: FloatArray) -> Cut:
    """Measure what the limits of range cut off a target, of all `returns` before them."""
    faults = sensor.imperfections
    measured = measured_ranges(returns, faults)[returns.instances == 0]
    n_near, n_far = int((measured < faults.range_min).sum()), int((measured > faults.range_max).sum())
    if not n_near:
        return Cut(len(measured), 0, n_far)
    axis, at = pose[:3, 0], pose[:3, 3]  # the range is along the axis, on the ground or towards the target's middle
    nearest = float(((mesh.vertices - at) @ axis).min())  # no range is less than the depth
    return Cut(len(measured), n_near, n_far, faults.range_min - float(at @ axis) - nearest)


def _kept(found: Scan, mesh: Mesh, setup: ScanConfig, rng: np.random.Generator) -> BoolArray:
    if setup.keep == "all":
        return np.ones(len(found), dtype=bool)
    if setup.box is None:
        return np.asarray(found.instances == 0)
    sides = np.ptp(mesh.bounds, axis=0)
    middle = rng.uniform(-1.0, 1.0, 3) * setup.box["shift"] * sides
    angle = rng.uniform(-np.pi, np.pi) if setup.box["rotate"] else 0.0
    factors = ENLARGED * (rng.uniform(*SCALED, 3) if setup.box["scale"] else np.ones(3))
    local = (found.positions - middle) @ moved(yaw=angle)[:3, :3]
    return np.asarray((np.abs(local) <= factors * sides / 2).all(axis=1))
