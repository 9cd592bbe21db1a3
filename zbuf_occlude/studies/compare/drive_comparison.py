"""Real drives against simulated ones: returns of the LiDAR in each labelled box, and of models of the same size."""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.base.arrays import BoolArray, FloatArray
from zbuf_occlude.base.errors import DatasetError, OptionError
from zbuf_occlude.datasets.real.sweeps import Loader, Sweep, find_sweeps
from zbuf_occlude.meshes.shapes import traffic
from zbuf_occlude.sensors.casting import prepare_scene
from zbuf_occlude.sensors.catalog import SENSORS, make
from zbuf_occlude.sensors.noise import detection_probability
from zbuf_occlude.sensors.returns import Scan
from zbuf_occlude.sensors.scanning import scan
from zbuf_occlude.sensors.scenes.scene import Scene, draw_albedos
from zbuf_occlude.sensors.sensor import Sensor
from zbuf_occlude.studies.compare.drive_models import MODELS, UprightBox, filled, kind_of, upright

Counts = NDArray[np.int64]

GROUPS = {
    **{"car": "cars", **dict.fromkeys(("truck", "tractor", "trailer", "bus"), "trucks and buses")},
    **{"bicycle": "cyclists", "motorcycle": "cyclists", "pedestrian": "pedestrians"},
}
"""Group of each kind of model whose returns are compared."""
RANGES = (5.0, 80.0)
"""Metres between which objects are compared."""
MAX_SIGHTINGS = 2000
"""Sightings; of longer logs every n-th sweep is taken."""
DRAWS = 200
"""Number of draws of albedos, glass and returns."""
BEFORE = 0.5
"""Metres. A real return so much nearer than a simulated one is of something in front; labels are not as exact."""
SLACK = 0.05
"""Metres. Where returns are counted here, real or simulated, a box is so much wider to each side and higher: labels are
rounded, and ranges have noise (sigma 0.02 m of the HDL-64E). It begins so much above its foot: there the ground is."""
CLOUDS = 4
"""Sweeps from which the sensor is found."""
SHARPNESS = 0.1
"""Degrees that returns lie off a laser's elevation: cars pitch while the sensor turns."""
MIN_POINTS = 1000
"""Points beyond 4 m of which a sensor is told from others."""
LIDAR_OF = {"Argoverse 2": "vlp-32c"}
"""Sensor of the layouts whose clouds are of several LiDARs."""


class Sighting(NamedTuple):
    """One object in one sweep: its real number of returns, and the simulated returns of each model.

    A simulated return (n, 3) has a cosine of incidence, a range, and 1 where it is at a window.
    """

    group: str
    label: str
    identity: int
    distance: float
    real: int
    returns: list[FloatArray]

    @property
    def n_without_dropout(self) -> float:
        """Mean number of simulated returns of the models."""
        return float(np.mean([len(each) for each in self.returns]))


class DriveComparison(NamedTuple):
    """The sightings of a drive, its layout and sensor, and the sweeps that were taken, found and skipped."""

    layout: str
    sensor: Sensor
    how: str
    """Source of the sensor: told, named by the layout, or found from the points."""
    sightings: list[Sighting]
    n_taken: int
    n_sweeps: int
    skipped: list[str]
    """Reasons why sweeps could not be read."""


def compare_drive(
    log: Path,
    sensor: str | None = None,
    *,
    parity: int | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> DriveComparison:
    """Compare the returns in the labelled boxes of a drive with those of built-in road users as large.

    Parameters
    ----------
    log : Path
        What `find_sweeps` reads.
    sensor : str, optional
        What `zbuf_occlude.sensors.make` takes. By default the spinning LiDAR of the table whose lasers' elevations
        explain the points best, with as many firings a turn as their azimuths show.
    parity : {0, 1}, optional
        Only sweeps of even or odd numbers, by their names where these are numbers.
    progress : callable
        Called with the sweeps scanned and those to scan.

    Raises
    ------
    DatasetError
        No labelled sweeps; no sweep that can be read; a sensor that cannot be told.
    OptionError
        An unknown sensor, or one that does not spin.
    """
    layout, loaders = find_sweeps(log)
    known = None if sensor is None else make(sensor)
    if known is not None and known.kind != "spinning":
        raise OptionError(f"the sensor of a drive must be a spinning LiDAR; {known.name} is {known.kind}.")
    skipped, places, clouds = list[str](), list[tuple[Loader, int]](), list[FloatArray]()
    every = -(-len(loaders) // CLOUDS)
    for number, loader in enumerate(loaders):
        try:
            sweep = _read(loader)
            boxes = _boxes_of(sweep)
        except DatasetError as error:
            skipped.append(str(error))
            continue
        if known is None and layout.name not in LIDAR_OF and number % every == 0:
            clouds.append(sweep.points)
        name = int(sweep.name) if sweep.name.isdigit() else number
        if parity is None or name % 2 == parity:
            places.append((loader, sum(_is_compared(box, sweep) for box in boxes)))
    if not places and skipped:
        raise DatasetError(f"no sweep of {log} can be read. {skipped[0]}")
    if known is not None:
        model, how = known, "told"
    elif layout.name in LIDAR_OF:
        model, how = make(LIDAR_OF[layout.name]), f"named by {layout.name}"
    else:
        model, how = _sensor_of(clouds, log)
    taken = [loader for loader, _ in places][:: -(-sum(n for _, n in places) // MAX_SIGHTINGS) or 1]
    noiseless = model.with_numbers(detection_range=0.0, sigma=0.0, step=0.0)
    sightings = list[Sighting]()
    for done, loader in enumerate(taken):
        sightings += sightings_in(_read(loader), noiseless)
        progress(done + 1, len(taken))
    return DriveComparison(layout.name, model, how, sightings, len(taken), len(places), skipped)


def found_sensor(points: FloatArray) -> tuple[Sensor, str]:
    """Return the spinning sensor whose lasers explain the elevations of a turn's points (n, 3) best, and how well.

    Raises
    ------
    DatasetError
        Too few points, or no turn.
    """
    far = points[np.hypot(*points[:, :2].T) > 4.0]
    if len(far) < MIN_POINTS:
        raise DatasetError(f"a sensor is found from {MIN_POINTS} points; there are {len(far)}. Give --sensor NAME.")
    some, scores = far[:: -(-len(far) // 20_000)], {}
    for name in (name for name, sensor in SENSORS.items() if sensor.kind == "spinning"):
        near = [np.exp(-0.5 * (above / SHARPNESS) ** 2) for above in SENSORS[name].angles_above_lasers(some)]
        scores[name] = float(np.log(np.mean(near, axis=0) / SHARPNESS + 1e-3).mean())
    first, second = sorted(scores, key=lambda name: -scores[name])[:2]
    rings = np.argmin([np.abs(above) for above in SENSORS[first].angles_above_lasers(far)], axis=0)
    azimuths = np.degrees(np.arctan2(far[:, 1], far[:, 0]))
    steps = np.concatenate([np.diff(np.sort(azimuths[rings == ring])) for ring in np.unique(rings)])
    steps = steps[steps > 0.02]  # nearer ones are of the same firing, at two ranges
    if not len(steps):
        raise DatasetError("a sensor is found from a turn; these points are of none. Give --sensor NAME.")
    columns = round(360.0 / steps[steps < 1.5 * np.median(steps)].mean())
    words = f"by elevations, e^{scores[first] - scores[second]:.1f} times as likely per point as {second}"
    return make(first, columns=columns), words


def sightings_in(sweep: Sweep, sensor: Sensor) -> list[Sighting]:
    """Scan every object of a sweep that is compared; `sensor` is without noise and dropout."""
    boxes = _boxes_of(sweep)
    targets = [number for number, box in enumerate(boxes) if _is_compared(box, sweep)]
    if not targets:
        return []
    rays = RealRays(sweep.points, sensor)
    returns = [_returns_in(sweep, rays, boxes, targets, model, sensor) for model in range(MODELS)]
    found = []
    for number, of_models in zip(targets, zip(*returns, strict=True), strict=True):
        box = boxes[number]
        real = int(box.is_inside(sweep.points, SLACK).sum()) if box.n_points is None else box.n_points
        group = GROUPS[kind_of(box.label)]
        found.append(Sighting(group, box.label, box.identity, _distance(box, sweep), real, list(of_models)))
    return found


class RealRays:
    """The points of a turn (n, 3), sensor frame, as the rays of a sensor: in rings, by azimuth."""

    def __init__(self, points: FloatArray, sensor: Sensor) -> None:
        self._points, self._step = points, 2.0 * np.pi / sensor.pattern["columns"]
        rings = np.argmin([np.abs(above) for above in sensor.angles_above_lasers(points)], axis=0)
        azimuths, ranges = np.arctan2(points[:, 1], points[:, 0]), np.linalg.norm(points, axis=1)
        rows = np.stack([azimuths, ranges, np.arange(len(points))], axis=1)
        of_rings = (rows[rings == ring] for ring in range(int(rings.max(initial=-1)) + 1))
        self._rings = [each[np.argsort(each[:, 0])] for each in of_rings]

    def end_before(self, found: Scan, box: UprightBox) -> BoolArray:
        """Return where (n,) the real ray beside a simulated return ended `BEFORE` it, outside the box.

        It met something without a label there.
        """
        hidden, azimuths = np.zeros(len(found), dtype=bool), np.arctan2(found.points[:, 1], found.points[:, 0])
        for ring, rows in enumerate(self._rings):
            mine = np.flatnonzero(found.rings == ring)
            if not len(mine) or not len(rows):
                continue
            after = np.searchsorted(rows[:, 0], azimuths[mine])
            beside = np.stack([np.maximum(after - 1, 0), np.minimum(after, len(rows) - 1)])
            off = np.abs(rows[beside, 0] - azimuths[mine])
            nearest = rows[np.take_along_axis(beside, off.argmin(axis=0)[None], axis=0)[0]]
            outside = ~box.is_inside(self._points[nearest[:, 2].astype(int)], BEFORE)
            is_nearer = nearest[:, 1] < found.clean_ranges[mine] - BEFORE
            hidden[mine] = (off.min(axis=0) < self._step) & is_nearer & outside
        return hidden


def drawn_returns(sightings: list[Sighting], reach: float, darkest: float = traffic.GLASS[0]) -> Counts:
    """Return the numbers of returns (DRAWS, n) that dropout leaves, with albedos and glass drawn for each object.

    `reach` is the `detection_range`; 0: every pulse returns. `darkest` is the smallest factor of windows on the albedo.
    """
    brightest = traffic.GLASS[1]
    found = np.zeros((DRAWS, len(sightings)), dtype=np.int64)
    rng = np.random.default_rng(0)
    for number, one in enumerate(sightings):
        own = np.random.default_rng(one.identity)
        albedos, glass = draw_albedos(own, DRAWS)[:, None], darkest * (brightest / darkest) ** own.random((DRAWS, 1))
        for model, returns in enumerate(one.returns):
            cosines, ranges, is_glass = returns.T
            if len(ranges):
                mine = slice(model, None, MODELS)
                behind = albedos[mine] * np.where(is_glass, glass[mine], 1.0)
                shares = detection_probability(behind, cosines, ranges, reach or np.inf).mean(axis=1)
                found[mine, number] = rng.binomial(len(ranges), shares)
    return found


def _sensor_of(clouds: list[FloatArray], log: Path) -> tuple[Sensor, str]:
    found, faults = list[tuple[Sensor, str]](), list[str]()
    for cloud in clouds:
        try:
            found.append(found_sensor(cloud))
        except DatasetError as error:
            faults.append(str(error))
    if not found:
        raise DatasetError(f"{log}: {faults[0]}")
    names = sorted({sensor.name for sensor, _ in found})
    if len(names) > 1:
        raise DatasetError(f"{log} must be of one sensor; it has {', '.join(names)}. Give --sensor NAME.")
    columns = round(np.median([sensor.pattern["columns"] for sensor, _ in found]))
    return make(names[0], columns=columns), found[0][1]


def _read(loader: Loader) -> Sweep:
    """Return a sweep without points that are not finite or at the origin: they are no returns."""
    sweep = loader()
    return sweep._replace(points=sweep.points[np.isfinite(sweep.points).all(axis=1) & sweep.points.any(axis=1)])


def _boxes_of(sweep: Sweep) -> list[UprightBox]:
    """Return the boxes of a sweep but those that a LiDAR stands in or on: the car that carries it."""
    boxes = [upright(box, sweep.name, number) for number, box in enumerate(sweep.boxes)]
    return [
        box
        for box in boxes
        if min(np.hypot(*(box.centre - mount[:3, 3])[:2]) for mount in sweep.mounts) > box.sides[:2].max() / 2
    ]


def _distance(box: UprightBox, sweep: Sweep) -> float:
    return float(np.hypot(*(box.centre - sweep.mounts[0][:3, 3])[:2]))


def _is_compared(box: UprightBox, sweep: Sweep) -> bool:
    is_counted = box.n_points is not None or len(sweep.points) > 0
    return is_counted and kind_of(box.label) in GROUPS and RANGES[0] <= _distance(box, sweep) < RANGES[1]


def _returns_in(
    sweep: Sweep, rays: RealRays, boxes: list[UprightBox], targets: list[int], model: int, sensor: Sensor
) -> list[FloatArray]:
    """Return the simulated returns (n, 3) in each target's box, with all boxes filled by their models of a number."""
    models, found = [filled(box, model) for box in boxes], []
    scene = Scene.joined(models)
    is_glass = np.zeros(len(scene.mesh.faces)) if scene.scattering is None else scene.scattering < 1.0
    with prepare_scene(scene, "exact") as occluder:
        for number in targets:
            box = boxes[number]
            corners = np.stack([models[number].vertices.min(axis=0), models[number].vertices.max(axis=0)])
            scans = [scan(scene, sensor, mount, occluder=occluder, towards=corners) for mount in sweep.mounts]
            # as real ones are counted: here, or by the makers, strictly within; boxes overlap
            if box.n_points is None:
                scans = [each.select(box.is_inside(each.points, SLACK)) for each in scans]
                scans = [each.select(~rays.end_before(each, box)) for each in scans]
            else:
                scans = [each.select((each.instances == number) | box.is_inside(each.points)) for each in scans]
            rows = [np.stack([np.cos(s.incidences), s.clean_ranges, is_glass[s.face_ids]], axis=1) for s in scans]
            found.append(np.concatenate(rows))
    return found
