"""Simulated against real numbers of returns: models as large as the labelled boxes of a drive, seen by its LiDARs.

    python benchmarks/real_lidar.py LOG [--sensor NAME] [--sweeps even|odd] [--scores] [--out FILE.md]

--sensor: a name of the table of sensors, instead of finding it from the log. --out: write the tables there too.
--sweeps: only files of even or odd numbers. On KITTI's even ones the windows of built-in vehicles were fitted.
--scores: by how much other reaches and windows miss the cars, instead of the report.
LOG is a folder or table of Argoverse 2, KITTI, nuScenes or MMDetection3D (benchmarks/drive_logs.py). Nothing is fitted
and nothing chosen here: the sensor is found from the log, and its numbers are those of the table of sensors.

Labelled cars, trucks, buses, cyclists and pedestrians between 5 and 80 m are scanned among all other boxes of their
sweep. A box is filled with `MODELS` built-in road users in turn: vehicles stretched to it, people as high as it and
of its proportions. There is no ground: roads are not flat. Where there are points, rays that ended before the object
are left out: what nobody labelled hides, too. Dropout goes by albedo, which is not known, nor is a vehicle's glass:
each object has them drawn, and all of it is drawn `DRAWS` times.

The ratio of medians is that of the real numbers over the usual one of the draws; the quantiles are of all draws. KS is
the Kolmogorov-Smirnov distance of the distributions of real and simulated numbers, of rows with at least 20
sightings of 5 objects. "Within the draws" is the share of sightings whose real number lies from the 5th to the 95th
percentile of their own draws; a model without fault has 90 %. Sweeps follow each other in tenths of a second, so what
differs is objects. "With other objects" is the ratio of medians when they are drawn anew, from 5 to 95 %, "without
dropout" that to all that geometry lets return.
"""

import sys
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from common import run
from drive_logs import SLACK, Box, DriveSweep, Log, points_of, read_log, within

import zbuf_occlude as zo
from zbuf_occlude.base.errors import OccludeError
from zbuf_occlude.meshes import shapes
from zbuf_occlude.meshes.shapes import traffic
from zbuf_occlude.meshes.shapes.road_users import RIDDEN_FROM
from zbuf_occlude.sensors import Sensor
from zbuf_occlude.sensors.noise import detection_probability
from zbuf_occlude.sensors.returns import Scan
from zbuf_occlude.sensors.scenes import Placed, Scene, moved
from zbuf_occlude.sensors.scenes.kinds import box_mesh, pole_mesh
from zbuf_occlude.sensors.scenes.scene import draw_albedos

KINDS = (
    *(("signaler", "pedestrian"), ("sign", "pole"), ("rack", "box"), ("pedestrian", "pedestrian")),
    *(("person", "pedestrian"), ("wheeled_rider", "pedestrian")),
    *(("motorcycl", "motorcycle"), ("cycl", "bicycle"), ("bus", "bus"), ("tram", "bus"), ("railed", "bus")),
    *(("trailer", "trailer"), ("large_vehicle", "bus"), ("truck_cab", "tractor"), ("truck", "truck")),
    *(("construction_veh", "truck"), ("vehicle.construction", "truck")),
    *(("car", "car"), ("van", "car"), ("vehicle", "car"), ("cone", "pole"), ("bollard", "pole"), ("pole", "pole")),
)
"""What a category is filled with: the first of which the word is in its name; else a box."""
GROUPS = {
    **{"car": "cars", **dict.fromkeys(("truck", "tractor", "trailer", "bus"), "trucks and buses")},
    **{"bicycle": "cyclists", "motorcycle": "cyclists", "pedestrian": "pedestrians"},
}
FITTED_ON = ("cars", "pedestrians")
"""Of one log, from 10 to 60 m: on them the `detection_range` of the VLP-32C was fitted."""
BINS = ((5.0, 10.0), (10.0, 20.0), (20.0, 30.0), (30.0, 40.0), (40.0, 50.0), (50.0, 60.0), (60.0, 80.0))
LEAST, LEAST_OBJECTS = 20, 5
"""Sightings, and objects among them, of fewer of which a distribution says nothing."""
MOST = 2000
"""Sightings; of longer logs every n-th sweep is taken."""
PARITIES = {"all": None, "even": 0, "odd": 1}
"""Remainders of the numbers of sweeps, by name."""
MODELS = 5
"""Built-in road users that fill a box in turn: what a labelled object is like in its box is not known."""
LIKELY = 40
"""Members among which the `MODELS` of a person are found, by the proportions of the box."""
DRAWS = 200
"""How often albedos, glass and returns are drawn."""
SCORED = (10.0, 50.0)
"""Metres. KITTI's nearer cars are cut by the image's edge, and their boxes guessed there."""
REACHES, WINDOWS = (110.0, 120.0, 130.0, 140.0), (0.01, 0.02, 0.05, 0.1, 0.2, 1.0)
BEFORE = 0.5
"""Metres. A real return so much nearer than a simulated one is of something in front; labels are not as exact."""


class Counted(NamedTuple):
    """One sighting of an object: what, where, its real number of returns; of each model those simulated.

    A simulated return has a cosine, a range, and 1 where it is at a window.
    """

    group: str
    category: str
    identity: int
    distance: float
    real: int
    returns: list[np.ndarray]

    @property
    def n_without_dropout(self) -> float:
        """Simulated returns, of all models in the mean."""
        return float(np.mean([len(each) for each in self.returns]))


def kind_of(category: str) -> str:
    """Return what a category of boxes is filled with."""
    return next((kind for word, kind in KINDS if word in category.lower()), "box")


def filled(given: Box, number: int) -> Placed:
    """Return one of the `MODELS` as large as a box, put there."""
    kind, sides = kind_of(given.category), given.sides[[1, 0, 2]]
    foot = given.centre - [0.0, 0.0, sides[2] / 2]
    pose = moved(yaw=np.degrees(given.yaw) + 90.0, to=foot)  # built-in ones face -y
    member = "van" if "van" in given.category.lower() else kind
    if kind in ("pedestrian", "bicycle") and given.sides[2] >= RIDDEN_FROM:
        mesh = person("cyclist" if kind == "bicycle" else kind, tuple(sides), number)
    elif kind in ("car", "bus"):
        mesh = stretched(traffic.make(member, (given.identity + number) % 1000), sides)
    elif kind in shapes.ROAD_USERS:
        mesh = shapes.road_user(kind, given.sides)
    else:
        mesh = stretched(pole_mesh(0.5, 1.0) if kind == "pole" else box_mesh(1.0, 1.0, 1.0), sides)
    return Placed(mesh, given.category, pose)


def stretched(mesh: zo.Mesh, sides: np.ndarray) -> zo.Mesh:
    """Return a mesh as wide, long and high as `sides`, on z = 0."""
    mesh = mesh.transformed(1.0, -mesh.centre)
    scale = sides / np.ptp(mesh.bounds, axis=0)
    return replace(mesh, vertices=mesh.vertices * scale + [0.0, 0.0, sides[2] / 2])


@lru_cache(1)
def proportions(label: str) -> np.ndarray:
    """Return width and length over height of `LIKELY` members, (n, 2)."""
    sides = np.array([np.ptp(traffic.make(label, i).bounds, axis=0) for i in range(LIKELY)])
    return sides[:, :2] / sides[:, 2:]


@lru_cache(256)
def person(label: str, sides: tuple[float, float, float], number: int) -> zo.Mesh:
    """Return the member whose proportions are the `number`-th most like a box's, as high as the box."""
    away = np.linalg.norm(np.log(proportions(label) / (np.array(sides[:2]) / sides[2])), axis=1)
    mesh = traffic.make(label, int(np.argsort(away)[number]))
    return mesh.transformed(sides[2] / float(np.ptp(mesh.bounds, axis=0)[2]))


def wanted(given: Box, mount: np.ndarray) -> bool:
    """Whether the returns of a box are compared."""
    distance = np.hypot(*(given.centre - mount[:3, 3])[:2])
    return given.n_points is not None and kind_of(given.category) in GROUPS and BINS[0][0] <= distance < BINS[-1][1]


def without_own_car(sweep: DriveSweep) -> DriveSweep:
    """Leave out boxes that a LiDAR stands in or on: the car that carries it."""
    return sweep._replace(
        boxes=[
            box
            for box in sweep.boxes
            if min(np.hypot(*(box.centre - mount[:3, 3])[:2]) for mount in sweep.mounts) > box.sides[:2].max() / 2
        ]
    )


def sightings_in(sweep: DriveSweep, sensor: Sensor) -> list[Counted]:
    """Scan every object of a sweep."""
    targets = [number for number, box in enumerate(sweep.boxes) if wanted(box, sweep.mounts[0])]
    if not targets:
        return []
    returns = [returns_in(sweep, targets, model, sensor) for model in range(MODELS)]
    found = []
    for number, of_models in zip(targets, zip(*returns, strict=True), strict=True):
        box = sweep.boxes[number]
        distance = float(np.hypot(*(box.centre - sweep.mounts[0][:3, 3])[:2]))
        group = GROUPS[kind_of(box.category)]
        found.append(Counted(group, box.category, box.identity, distance, box.n_points or 0, list(of_models)))
    return found


def returns_in(sweep: DriveSweep, targets: list[int], model: int, sensor: Sensor) -> list[np.ndarray]:
    """Return the simulated returns (n, 3) in each target's box, with all boxes filled by their models of a number."""
    models, found = [filled(box, model) for box in sweep.boxes], []
    scene = Scene.joined(models)
    is_glass = np.zeros(len(scene.mesh.faces)) if scene.scattering is None else scene.scattering < 1.0
    with zo.prepare(scene.mesh, "exact") as occluder:
        for number in targets:
            box = sweep.boxes[number]
            corners = np.stack([models[number].vertices.min(axis=0), models[number].vertices.max(axis=0)])
            scans = [zo.scan(scene, sensor, mount, occluder=occluder, towards=corners) for mount in sweep.mounts]
            # as real ones are counted: here, or by the makers, strictly within; boxes overlap
            if sweep.cloud is not None:
                scans = [s.select(within(box, s.points, SLACK)) for s in scans]
                scans = [s.select(~hidden_by_others(s, box, sensor, sweep.cloud)) for s in scans]
            else:
                scans = [s.select((s.instances == number) | within(box, s.points)) for s in scans]
            rows = [np.stack([np.cos(s.incidences), s.clean_ranges, is_glass[s.face_ids]], axis=1) for s in scans]
            found.append(np.concatenate(rows))
    return found


@lru_cache(2)
def as_rays(cloud: Path, sensor: Sensor) -> list[np.ndarray]:
    """Return azimuth, range and number of the points of each laser, (n, 3), in the order of their azimuths."""
    points = points_of(cloud)
    rings = np.argmin([np.abs(above) for above in sensor.angles_above_lasers(points)], axis=0)
    rows = np.stack([np.arctan2(points[:, 1], points[:, 0]), np.linalg.norm(points, axis=1), np.arange(len(points))], 1)
    return [rows[rings == ring][np.argsort(rows[rings == ring, 0])] for ring in range(int(rings.max()) + 1)]


def hidden_by_others(scan: Scan, box: Box, sensor: Sensor, cloud: Path) -> np.ndarray:
    """Whether the real ray beside each simulated one (n,) ended `BEFORE` it, outside the box: what nobody labelled."""
    found = np.zeros(len(scan), dtype=bool)
    azimuths, step = np.arctan2(scan.points[:, 1], scan.points[:, 0]), 2.0 * np.pi / sensor.pattern["columns"]
    for ring, rows in enumerate(as_rays(cloud, sensor)):
        mine = np.flatnonzero(scan.rings == ring)
        if not len(mine) or not len(rows):
            continue
        after = np.searchsorted(rows[:, 0], azimuths[mine])
        beside = np.stack([np.maximum(after - 1, 0), np.minimum(after, len(rows) - 1)])
        off = np.abs(rows[beside, 0] - azimuths[mine])
        nearest = rows[np.take_along_axis(beside, off.argmin(axis=0)[None], axis=0)[0]]
        outside = ~within(box, points_of(cloud)[nearest[:, 2].astype(int)], BEFORE)
        found[mine] = (off.min(axis=0) < step) & (nearest[:, 1] < scan.clean_ranges[mine] - BEFORE) & outside
    return found


def drawn(sightings: list[Counted], reach: float, darkest: float = traffic.GLASS[0]) -> np.ndarray:
    """Return the numbers of returns (DRAWS, sightings) that dropout leaves, with albedos and glass drawn."""
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
                shares = detection_probability(behind, cosines, ranges, reach).mean(axis=1)
                found[mine, number] = rng.binomial(len(ranges), shares)
    return found


def score_of(sightings: list[Counted], simulated: np.ndarray) -> float:
    """Return the CRPS (Gneiting and Raftery 2007) of log(1 + returns): the mean of the mean of each 10 m."""
    real, made = np.log1p([one.real for one in sightings]), np.log1p(np.sort(simulated, axis=0))
    weights = (2.0 * np.arange(1, DRAWS + 1) - DRAWS - 1.0) / DRAWS**2
    each = np.abs(made - real).mean(axis=0) - weights @ made
    tens = np.array([one.distance // 10.0 for one in sightings])
    return float(np.mean([each[tens == ten].mean() for ten in np.unique(tens)]))


def scores(sightings: list[Counted]) -> list[str]:
    """Say the score of the cars at `SCORED` by reach and by the factor of the darkest windows."""
    cars = [one for one in sightings if one.group == "cars" and SCORED[0] <= one.distance < SCORED[1]]
    if not cars:
        return ["There are no cars to score."]
    rows = [[score_of(cars, drawn(cars, reach, darkest)) for darkest in WINDOWS] for reach in REACHES]
    head = "| reach, m | " + " | ".join(f"{darkest:g}" for darkest in WINDOWS) + " |"
    body = [
        f"| {reach:g} | " + " | ".join(f"{x:.3f}" for x in row) + " |" for reach, row in zip(REACHES, rows, strict=True)
    ]
    return [
        f"{len(cars)} cars; columns: factor of the darkest windows.",
        "",
        head,
        "| --- " * (len(WINDOWS) + 1) + "|",
        *body,
    ]


def distance_between(a: np.ndarray, b: np.ndarray) -> float:
    """Kolmogorov's and Smirnov's: the largest difference of the two distribution functions."""
    values = np.sort(np.concatenate([a, b]))
    below = [np.searchsorted(np.sort(x), values, side="right") / len(x) for x in (a, b)]
    return float(np.abs(below[0] - below[1]).max())


def median_of_draws(simulated: np.ndarray) -> float:
    """Return the usual median of the sightings in a draw (DRAWS, sightings): few and unlike ones have no middle."""
    return float(np.median(np.median(simulated, axis=1)))


def trusted(real: np.ndarray, simulated: np.ndarray, identities: list[int]) -> str:
    """Say between what the ratio of medians lies when objects, not sightings, are drawn anew: 5 and 95 %."""
    rng = np.random.default_rng(0)
    names, which = np.unique(identities, return_inverse=True)
    of_each = [np.flatnonzero(which == i) for i in range(len(names))]
    ratios = []
    for _ in range(400):
        mine = np.concatenate([of_each[i] for i in rng.integers(len(names), size=len(names))])
        ratios.append(np.median(real[mine]) / max(median_of_draws(simulated[:, mine]), 0.5))
    low, high = np.quantile(ratios, (0.05, 0.95))
    return f"{low:.2f}..{high:.2f}"


def report(sightings: list[Counted], simulated: np.ndarray) -> list[str]:
    """Say it as a table, class by class and range by range, and in a line."""
    lines = [
        "| | metres | sightings, objects | real 50, 75, 90 % | simulated 50, 75, 90 % | ratio of medians "
        "| with other objects | without dropout | KS | within the draws |",
        "| --- | --- | ---: | --- | --- | ---: | ---: | ---: | ---: | ---: |",
    ]
    reals = np.array([one.real for one in sightings])
    low, high = np.quantile(simulated, (0.05, 0.95), axis=0)
    within = (low <= reals) & (reals <= high)
    distances: dict[tuple[str, float], float] = {}
    for group in dict.fromkeys(GROUPS.values()):
        for nearest, farthest in BINS:
            mine = [i for i, o in enumerate(sightings) if o.group == group and nearest <= o.distance < farthest]
            if not mine:
                continue
            real, made, names = reals[mine], simulated[:, mine], [sightings[i].identity for i in mine]
            of_both = [np.quantile(values, (0.5, 0.75, 0.9)) for values in (real, made)]
            shown = " | ".join(", ".join(f"{q:.0f}" for q in each) for each in of_both)
            without = np.median([sightings[i].n_without_dropout for i in mine])
            ratio, whole = (f"{of_both[0][0] / n:.2f}" if n else "-" for n in (median_of_draws(made), without))
            trust, far = "-", "-"
            if len(mine) >= LEAST and len(set(names)) >= LEAST_OBJECTS:
                distances[group, nearest] = distance_between(real, made.ravel())
                trust, far = trusted(real, made, names), f"{distances[group, nearest]:.2f}"
            lines.append(
                f"| {group} | {nearest:.0f}-{farthest:.0f} | {len(mine)}, {len(set(names))} | {shown} | {ratio} "
                f"| {trust} | {whole} | {far} | {within[mine].mean():.0%} |"
            )
    usual = [far for (group, nearest), far in distances.items() if group in FITTED_ON and 10.0 <= nearest <= 50.0]
    means = " ".join(
        f"Mean KS of {what}: {np.mean(far):.3f}."
        for what, far in (
            (f"{len(distances)} rows", list(distances.values())),
            (f"the {len(usual)} of cars and pedestrians from 10 to 60 m", usual),
        )
        if far
    )
    share = f"Within the draws: {within.mean():.0%} of {len(sightings)} sightings."
    return [*lines, "", f"{means or 'No row has enough for a KS.'} {share}"]


def listed(sightings: list[Counted], simulated: np.ndarray) -> list[str]:
    """Say it of each sighting, of logs with few."""
    low, middle, high = np.quantile(simulated, (0.05, 0.5, 0.95), axis=0)
    return [
        "| | metres | real | simulated | 5 to 95 % | without dropout |",
        "| --- | ---: | ---: | ---: | ---: | ---: |",
        *(
            f"| {o.category} | {o.distance:.0f} | {o.real} | {m:.0f} | {a:.0f}..{b:.0f} | {o.n_without_dropout:.0f} |"
            for o, m, a, b in sorted(zip(sightings, middle, low, high, strict=True), key=lambda row: row[0].distance)
        ),
        "",
    ]


def measure(log: Log, parity: str = "all", *, scored: bool = False) -> list[str]:
    """Scan a log's sweeps and report."""
    numbers = [int(s.cloud.stem) if s.cloud and s.cloud.stem.isdigit() else i for i, s in enumerate(log.sweeps)]
    kept = [sweep for number, sweep in zip(numbers, log.sweeps, strict=True) if PARITIES[parity] in (None, number % 2)]
    sweeps = [without_own_car(sweep) for sweep in kept]
    n_wanted = sum(wanted(box, sweep.mounts[0]) for sweep in sweeps for box in sweep.boxes)
    taken = sweeps[:: -(-n_wanted // MOST) or 1]
    reach = log.sensor.noise_model.detection_range
    noiseless = log.sensor.with_numbers(detection_range=0.0, sigma=0.0, step=0.0)
    sightings = [one for sweep in taken for one in sightings_in(sweep, noiseless)]
    columns = log.sensor.pattern["columns"]
    head = (
        f"{log.form}, {len(sightings)} sightings in {len(taken)} of {len(sweeps)} sweeps. Sensor: {log.sensor.name} "
        f"({log.found}), {columns} firings a turn, reach {reach:g} m."
    )
    n_skipped = len(log.skipped)
    end = ["", f"Sweeps that could not be read and were skipped: {n_skipped}."] if n_skipped else []
    if not sightings:
        return [head, *end]
    if scored:
        return [head, "", *scores(sightings), *end]
    simulated = drawn(sightings, reach)
    few = listed(sightings, simulated) if len(sightings) <= 3 * LEAST else []
    return [head, "", *few, *report(sightings, simulated), *end]


def main(
    log: Path, *, sensor: str | None = None, sweeps: str = "all", scores: bool = False, out: Path | None = None
) -> None:
    try:
        drive = read_log(log, sensor)
        for reason in drive.skipped:
            print(f"skipped: {reason}", file=sys.stderr, flush=True)
        lines = measure(drive, sweeps, scored=scores)
    except OccludeError as error:
        raise SystemExit(f"error: {log}: {error}") from None
    print("\n".join(lines))
    if out is not None:
        out.write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    run(main, __doc__, sweeps=PARITIES)
