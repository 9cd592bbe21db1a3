"""Simulated against real numbers of points: models stretched to the labelled boxes of a drive, seen as its LiDARs saw.

    python benchmarks/against_real_scans.py ../shared/data/lidar/av2_objects.tsv [--every 2] [--out FILE.md]

The file has a line per labelled object and sweep: category, length, width, height, x, y, z, yaw in degrees (metres, the
car's frame), and the number of LiDAR points in the box. Sweeps follow each other; a new one begins where the categories
begin anew, which are in alphabetical order. The rig is that of Argoverse 2: two VLP-32C, one upright, one upside down.

For each vehicle and pedestrian between 10 and 60 m a built-in car, stretched to its box, or a figure of ellipsoids, as
tall as it, is looked at in three ways: alone; among the other labelled boxes of its sweep, filled likewise; and so with
dropout. The file lists a sample of the boxes; where one is missing between two sightings of its object, it is put back.
There is no ground: roads are not flat, and one that is hides what stands below it. Dropout's numbers are fitted on the
first half of the sweeps; all is reported of the second.
"""

import argparse
import itertools
import sys
import time
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import zbuf_occlude as zo
from zbuf_occlude.meshes import shapes
from zbuf_occlude.meshes.shapes import solids
from zbuf_occlude.scenes import Placed, Scene, moved
from zbuf_occlude.scenes.parts import box, pole
from zbuf_occlude.sensors import make
from zbuf_occlude.sensors.scan import default_caster

MOUNTS = ((1.35, 0.0, 1.64, False), (1.35, 0.0, 1.53, True))
"""x, y, z and whether upside down."""
CLASSES = {"REGULAR_VEHICLE": "vehicles", "PEDESTRIAN": "pedestrians"}
BINS = tuple((low, low + 10.0) for low in (10.0, 20.0, 30.0, 40.0, 50.0))
LEAST = 20
"""Objects of a class within 10 m of range, fewer of which say nothing."""
MOST_STEP = 2.5
"""Metres per sweep, in the car's frame, beyond which two boxes of the same sides are two objects."""
LONGEST_GAP = 15
"""Sweeps for which an object may be missing."""
GRID = {
    "drop": np.arange(0.0, 0.21, 0.05),
    "attenuation": (0.0, 0.004, 0.008, 0.016, 0.024, 0.03, 0.04, 0.05),
    "drop_limit": (0.3, 0.5, 0.65, 0.8, 1.0),
    "drop_zero": np.arange(0.0, 1.01, 0.1),
}
"""What dropout's numbers are chosen from."""


class Box(NamedTuple):
    """A labelled box and what was counted in it."""

    category: str
    sides: np.ndarray
    centre: np.ndarray
    yaw: float
    n_points: int | None
    """None where it was not counted: `completed`."""


class Counted(NamedTuple):
    """One object: what it is, where, its real number of points; cosine and range of each simulated return."""

    group: str
    sweep: int
    distance: float
    real: int
    alone: np.ndarray
    among: np.ndarray


def sweeps_of(path: Path) -> list[list[Box]]:
    """Read the file, sweep by sweep."""
    sweeps: list[list[Box]] = [[]]
    for line in path.read_text().splitlines()[1:]:
        category, *numbers = line.split("\t")
        length, width, height, x, y, z, yaw, n_points = map(float, numbers)
        if sweeps[-1] and category < sweeps[-1][-1].category:
            sweeps.append([])
        sides, centre = np.array([length, width, height]), np.array([x, y, z])
        sweeps[-1].append(Box(category, sides, centre, np.radians(yaw), int(n_points)))
    return sweeps


def completed(sweeps: list[list[Box]]) -> list[list[Box]]:
    """Add the boxes that the file leaves out, where they must have stood: between two sightings of the same object.

    The file is a sample: exactly 2,500 boxes of vehicles and of pedestrians each, so that an object that is there for
    150 sweeps is listed in about 100 of them. What is left out hides others all the same.
    """
    full = [list(boxes) for boxes in sweeps]
    last_seen: dict[tuple[str, bytes], list[tuple[int, Box]]] = {}
    for number, boxes in enumerate(sweeps):
        for seen in boxes:
            same = last_seen.setdefault((seen.category, seen.sides.tobytes()), [])
            # one of the same sides in the same sweep is another object: it is infinitely fast
            away = np.array([np.linalg.norm(seen.centre - box.centre) for _, box in same])
            steps = away / np.array([max(number - before, 1e-9) for before, _ in same])
            if len(steps) and steps.min() <= MOST_STEP:
                before, box = same.pop(int(steps.argmin()))
                if number - before <= LONGEST_GAP:
                    for missing in range(before + 1, number):
                        full[missing].append(between(box, seen, (missing - before) / (number - before)))
            same.append((number, seen))
    return full


def between(a: Box, b: Box, share: float) -> Box:
    """Where an object is on its way from one box to another."""
    turned = (b.yaw - a.yaw + np.pi) % (2.0 * np.pi) - np.pi
    return Box(a.category, a.sides, a.centre + share * (b.centre - a.centre), a.yaw + share * turned, None)


def figure() -> zo.Mesh:
    """A person of ellipsoids: legs, trunk, arms, head; box about [0, 1]^3 apart from proportions."""
    ball = solids.icosphere(2)
    parts = (
        *(((0.1 * step, side * 0.1, 0.45), (0.09, 0.09, 0.45)) for side, step in ((-1, 1), (1, -1))),
        *(((-0.12 * step, side * 0.22, 1.05), (0.06, 0.06, 0.33)) for side, step in ((-1, 1), (1, -1))),
        ((0.0, 0.0, 1.15), (0.14, 0.2, 0.38)),
        ((0.02, 0.0, 1.62), (0.1, 0.08, 0.13)),
    )
    return Scene.joined([Placed(ball, pose=moved(scale=radii, to=centre)) for centre, radii in parts]).mesh


FIGURE = figure()
CARS = [shapes.make("car", i) for i in range(12)]


def placed(given: Box, number: int) -> Placed:
    """A model stretched to a box and put there."""
    if given.category == "REGULAR_VEHICLE":
        # the same box in the next sweep gets the same car; built-in ones face -y
        mesh, turn = CARS[zlib.crc32(f"{given.sides.tolist()}".encode()) % len(CARS)], np.pi / 2
    elif given.category == "PEDESTRIAN":
        mesh, turn = FIGURE, 0.0
    elif given.category in ("BOLLARD", "CONSTRUCTION_CONE", "SIGN"):
        mesh, turn = pole(0.5, 1.0), 0.0
    else:
        mesh, turn = box(1.0, 1.0, 1.0), 0.0
    upright = moved(yaw=turn, to=(0, 0, 0))
    turned = mesh.rotated(upright[:3, :3])
    scale = given.sides / np.ptp(turned.bounds, axis=0)
    if given.category == "PEDESTRIAN":
        # boxes of people hold their stride and what they carry, and are 0.6 m wide at least: only the height is theirs
        scale[:] = scale[2]
    centred = turned.transformed(1.0, -turned.centre)
    pose = moved(scale=1.0, yaw=given.yaw, to=given.centre) @ np.diag([*scale, 1.0])
    return Placed(centred, f"{given.category} {number}", pose)


def pose_of(mount: tuple[float, float, float, bool]) -> np.ndarray:
    """Sensor to the car's frame; upside down is turned about x."""
    pose = np.diag([1.0, -1.0, -1.0, 1.0]) if mount[3] else np.eye(4)
    pose[:3, 3] = mount[:3]
    return pose


def count(path: Path, every: int, method: str) -> Iterator[Counted]:
    """Scan every object of some sweeps."""
    sensor = make("vlp-32c", drop=0.0, drop_zero=0.0, sigma=0.0, step=0.0)
    poses = [pose_of(mount) for mount in MOUNTS]
    for number, boxes in list(enumerate(completed(sweeps_of(path))))[::every]:
        models = [placed(given, i) for i, given in enumerate(boxes)]
        scene = Scene.joined(models)
        with zo.prepare(scene.mesh, method) as among:
            for i, given in enumerate(boxes):
                distance = float(np.hypot(*(given.centre[:2] - MOUNTS[0][:2])))
                if given.n_points is None or given.category not in CLASSES:
                    continue
                if not BINS[0][0] <= distance < BINS[-1][1]:
                    continue
                target = Scene.joined([models[i]])
                bounds = target.mesh.bounds
                with zo.prepare(target.mesh, method) as alone:
                    one = [zo.scan(target, sensor, pose, occluder=alone, towards=bounds) for pose in poses]
                many = [zo.scan(scene, sensor, pose, occluder=among, towards=bounds) for pose in poses]
                many = [scan.select(scan.instances == i) for scan in many]
                signals = [
                    np.concatenate([np.stack([np.cos(s.incidences), s.clean_ranges], 1) for s in scans])
                    for scans in (one, many)
                ]
                yield Counted(CLASSES[given.category], number, distance, given.n_points, *signals)


def kept(signals: np.ndarray, numbers: dict[str, float]) -> float:
    """Number of returns that dropout leaves, on average (`zbuf_occlude.sensors.imperfections.dropped`)."""
    signal = signals[:, 0] * np.exp(-numbers["attenuation"] * signals[:, 1])
    weak = numbers["drop_zero"] * np.maximum(0.0, 1.0 - signal / numbers["drop_limit"])
    return float(((1.0 - numbers["drop"]) * (1.0 - weak)).sum())


def misfit(objects: list[Counted], numbers: dict[str, float]) -> float:
    """How far the 90th percentile of real / simulated is from 1, of vehicles, every 10 m: the mean squared logarithm.

    Not the medians: things that nobody labelled hide objects too, which dropout must not stand in for. The least hidden
    are at the upper end. Not the people: their clothes return what the paint and the glass of a vehicle lose.
    """
    total = []
    for mine in binned([o for o in objects if o.group == "vehicles"]):
        real = np.array([o.real for o in mine], dtype=float)
        simulated = np.array([kept(o.among, numbers) for o in mine])
        ratios = real[simulated >= 1] / simulated[simulated >= 1]
        total.append(np.log(max(np.quantile(ratios, 0.9), 0.01)) ** 2)
    return float(np.mean(total))


def binned(objects: list[Counted]) -> Iterator[list[Counted]]:
    """Yield the objects of each class and 10 m, where there are some."""
    for group, (low, high) in itertools.product(CLASSES.values(), BINS):
        mine = [o for o in objects if o.group == group and low <= o.distance < high]
        if len(mine) >= LEAST:
            yield mine


def fit(objects: list[Counted]) -> dict[str, float]:
    """Choose dropout's numbers: of a grid the best."""
    some = objects[:: max(1, len(objects) // 800)]
    choices = [dict(zip(GRID, map(float, values), strict=True)) for values in itertools.product(*GRID.values())]
    # without weak signals lost, attenuation and limit mean nothing
    choices = [c for c in choices if c["drop_zero"] > 0 or (c["attenuation"] == 0.0 and c["drop_limit"] == 0.3)]
    return min(choices, key=lambda numbers: misfit(some, numbers))


def distance_between(a: np.ndarray, b: np.ndarray) -> float:
    """Kolmogorov's and Smirnov's: the largest difference of the two distribution functions."""
    values = np.sort(np.concatenate([a, b]))
    below = [np.searchsorted(np.sort(x), values, side="right") / len(x) for x in (a, b)]
    return float(np.abs(below[0] - below[1]).max())


def report(objects: list[Counted], numbers: dict[str, float]) -> list[str]:
    """Say it as a table, class by class and 10 m by 10 m."""
    rng = np.random.default_rng(0)
    ways: dict[str, Any] = {
        "alone": lambda o: len(o.alone),
        "others": lambda o: len(o.among),
        "others, dropout": lambda o: rng.binomial(len(o.among), kept(o.among, numbers) / max(len(o.among), 1)),
    }
    lines = [
        "| | metres | objects | way | real 50, 75, 90 % | simulated 50, 75, 90 % | ratio of medians | KS "
        "| real / simulated 50, 75, 90 % |",
        "| --- | --- | ---: | --- | --- | --- | ---: | ---: | --- |",
    ]
    for mine in binned(objects):
        group, low = mine[0].group, min(o.distance for o in mine) // 10 * 10
        real = np.array([o.real for o in mine], dtype=float)
        for name, way in ways.items():
            simulated = np.array([way(o) for o in mine], dtype=float)
            ratios = real[simulated > 0] / simulated[simulated > 0]
            quantiles = [np.quantile(values, (0.5, 0.75, 0.9)) for values in (real, simulated, ratios)]
            medians = quantiles[0][0] / quantiles[1][0] if quantiles[1][0] else np.inf
            shown = [", ".join(f"{q:.0f}" for q in each) for each in quantiles[:2]]
            shown.append(", ".join(f"{q:.2f}" for q in quantiles[2]))
            lines.append(
                f"| {group} | {low:.0f}-{low + 10:.0f} | {len(mine)} | {name} | {shown[0]} | {shown[1]} "
                f"| {medians:.2f} | {distance_between(real, simulated):.2f} | {shown[2]} |"
            )
    return lines


def hidden(objects: list[Counted], numbers: dict[str, float]) -> str:
    """Say how many seem to stand behind what nobody labelled."""
    said = []
    for group, (low, high) in itertools.product(CLASSES.values(), ((10.0, 40.0), (40.0, 60.0))):
        pairs = [(o.real, kept(o.among, numbers)) for o in objects if o.group == group and low <= o.distance < high]
        some = [real < simulated / 4 for real, simulated in pairs if simulated >= 8]
        said.append(f"{np.mean(some):.0%} of {len(some)} {group} at {low:.0f}-{high:.0f} m")
    return "Fewer than a quarter of their simulated returns (8 at least) have " + ", ".join(said) + "."


def main() -> None:
    """Scan, fit, report."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("objects", type=Path)
    parser.add_argument("--every", type=int, default=1, help="Only every n-th sweep.")
    parser.add_argument("--method", default=default_caster(), help="Who casts the rays.")
    parser.add_argument("--out", type=Path, help="Write the table here too.")
    given = parser.parse_args()
    began = time.perf_counter()
    objects = []
    for one in count(given.objects, given.every, given.method):
        objects.append(one)
        if len(objects) % 100 == 0:
            print(f"{len(objects)} objects, {time.perf_counter() - began:.0f} s", file=sys.stderr)
    half = np.median([o.sweep for o in objects])
    first, second = [o for o in objects if o.sweep < half], [o for o in objects if o.sweep >= half]
    numbers = fit(first)
    lines = [
        f"{len(objects)} objects of {len({o.sweep for o in objects})} sweeps, rays by {given.method}. "
        f"Fitted on the first {len(first)}: " + ", ".join(f"{name} {value:g}" for name, value in numbers.items()) + ".",
        f"Below: the other {len(second)}.",
        "",
        *report(second, numbers),
        "",
        hidden(second, numbers),
    ]
    print("\n".join(lines))
    if given.out is not None:
        given.out.write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
