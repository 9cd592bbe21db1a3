"""Simulated against real numbers of points: models stretched to the labelled boxes of a drive, seen as its LiDARs saw.

    python benchmarks/against_real_scans.py ../shared/data/lidar/av2_objects.tsv [--reach 130] [--out FILE.md]

The file has a line per labelled object and sweep: category, length, width, height, x, y, z, yaw in degrees (metres, the
car's frame), and the number of LiDAR points in the box. Sweeps follow each other; a new one begins where the categories
begin anew, which are in alphabetical order. The rig is that of Argoverse 2: two VLP-32C, one upright, one upside down.

For each vehicle and pedestrian between 10 and 60 m a built-in car, stretched to its box, or a figure of ellipsoids, as
tall as it, is looked at in three ways: alone; among the other labelled boxes of its sweep, filled likewise; and so with
dropout, which goes by albedo: each object has one, drawn, the same in all sweeps, and all of it is drawn `DRAWS` times.
The file lists a sample of the boxes; where one is missing between two sightings of its object, it is put back.
There is no ground: roads are not flat, and one that is hides what stands below it. `reach`, the one number of dropout,
is fitted on either half of the objects, and what is reported of an object is by the half that it is not in. With
--reach nothing is fitted.

With dropout real / simulated says twice what the sensor gives: of an object and one draw of its paint, which is not the
real one's, so that a model without fault has the ratio of two draws; and (in the column "highest tenth") of an object
and the 90th percentile of its own draws, of which a model without fault has 1 as 90th percentile, as had a model that
draws nothing. Sweeps follow each other in tenths of a second: what differs is objects, of which the table says how many
there are, and by drawing which anew (bootstrap) it says how far the ratio of medians can be trusted.
"""

import argparse
import itertools
import sys
import time
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

import zbuf_occlude as zo
from zbuf_occlude import shapes
from zbuf_occlude.scenes import Placed, Scene, moved
from zbuf_occlude.scenes.kinds import box_mesh, pole_mesh
from zbuf_occlude.scenes.scene import ALBEDOS, draw_albedos
from zbuf_occlude.sensors import make
from zbuf_occlude.sensors.scanning import default_caster, detection
from zbuf_occlude.shapes import solids

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
REACHES = np.arange(70.0, 231.0, 10.0)
"""What `reach` is chosen from, metres."""
DRAWS = 40
"""How often albedos and returns are drawn."""
SHADES = 48
"""Albedos for which the share of returns is computed; between them it is interpolated."""


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
    identity: int
    """`identity_of` its box."""
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


def identity_of(given: Box) -> int:
    """Return a number that tells objects apart: boxes of an object have the same sides in all sweeps."""
    return zlib.crc32(f"{given.sides.tolist()}".encode())


def placed(given: Box, number: int) -> Placed:
    """A model stretched to a box and put there."""
    if given.category == "REGULAR_VEHICLE":
        # the same box in the next sweep gets the same car; built-in ones face -y
        mesh, turn = CARS[identity_of(given) % len(CARS)], np.pi / 2
    elif given.category == "PEDESTRIAN":
        mesh, turn = FIGURE, 0.0
    elif given.category in ("BOLLARD", "CONSTRUCTION_CONE", "SIGN"):
        mesh, turn = pole_mesh(0.5, 1.0), 0.0
    else:
        mesh, turn = box_mesh(1.0, 1.0, 1.0), 0.0
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
    sensor = make("vlp-32c", reach=0.0, sigma=0.0, step=0.0)
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
                identity = identity_of(given)
                yield Counted(CLASSES[given.category], identity, number, distance, given.n_points, *signals)


def drawn(objects: list[Counted], reaches: np.ndarray | float) -> np.ndarray:
    """Return the numbers of returns (DRAWS, objects) that dropout leaves, with an albedo drawn for each object.

    `reaches` is one for all, or one each.
    """
    low, high = np.log(ALBEDOS)
    shades = np.linspace(low, high, SHADES)
    found = np.empty((DRAWS, len(objects)), dtype=np.int64)
    rng = np.random.default_rng(0)
    for number, (one, reach) in enumerate(zip(objects, np.broadcast_to(reaches, len(objects)), strict=True)):
        albedos = draw_albedos(np.random.default_rng(one.identity), DRAWS)
        cosines, ranges = one.among.T
        shares = detection(np.exp(shades)[:, None], cosines, ranges, reach).mean(axis=1) if len(ranges) else shades * 0
        found[:, number] = rng.binomial(len(ranges), np.interp(np.log(albedos), shades, shares))
    return found


def misfit(objects: list[Counted], reach: float) -> float:
    """How far the distributions of numbers of points are from the real ones: Kolmogorov-Smirnov, mean of all rows."""
    simulated = drawn(objects, reach)
    far = [
        distance_between(np.array([objects[i].real for i in mine], dtype=float), simulated[:, mine].ravel())
        for mine in binned(objects)
    ]
    return float(np.mean(far))


def cross_fitted(objects: list[Counted]) -> tuple[np.ndarray, str]:
    """Fit `reach` on either half of the objects; return for each what the other half gave, and say all of it."""
    half = np.array([o.identity % 2 for o in objects])
    misfits = [[misfit([o for o in objects if o.identity % 2 == each], r) for r in REACHES] for each in (0, 1)]
    fitted = REACHES[np.argmin(misfits, axis=1)]
    by_reach = ", ".join(f"{reach:g} {a:.3f} {b:.3f}" for reach, a, b in zip(REACHES, *misfits, strict=True))
    return fitted[1 - half], (
        f"Reach fitted on half of the objects, and reported of the other: {fitted[0]:g} and {fitted[1]:g} m. "
        f"Mean Kolmogorov-Smirnov of either half by reach: {by_reach}."
    )


def binned(objects: list[Counted]) -> Iterator[list[int]]:
    """Yield which objects are of each class and 10 m, where there are some."""
    for group, (low, high) in itertools.product(CLASSES.values(), BINS):
        mine = [i for i, o in enumerate(objects) if o.group == group and low <= o.distance < high]
        if len(mine) >= LEAST:
            yield mine


def distance_between(a: np.ndarray, b: np.ndarray) -> float:
    """Kolmogorov's and Smirnov's: the largest difference of the two distribution functions."""
    values = np.sort(np.concatenate([a, b]))
    below = [np.searchsorted(np.sort(x), values, side="right") / len(x) for x in (a, b)]
    return float(np.abs(below[0] - below[1]).max())


def trusted(real: np.ndarray, simulated: np.ndarray, identities: list[int]) -> str:
    """Say between what the ratio of medians lies when objects, not sightings, are drawn anew: 5 and 95 %."""
    rng = np.random.default_rng(0)
    names, which = np.unique(identities, return_inverse=True)
    of_each = [np.flatnonzero(which == i) for i in range(len(names))]
    ratios = []
    for _ in range(400):
        mine = np.concatenate([of_each[i] for i in rng.integers(len(names), size=len(names))])
        ratios.append(np.median(real[mine]) / max(np.median(simulated[:, mine]), 0.5))
    low, high = np.quantile(ratios, (0.05, 0.95))
    return f"{low:.2f}..{high:.2f}"


def report(objects: list[Counted], with_dropout: np.ndarray) -> list[str]:
    """Say it as a table, class by class and 10 m by 10 m."""
    ways = {
        "alone": np.array([[len(o.alone) for o in objects]]),
        "others": np.array([[len(o.among) for o in objects]]),
        "others, dropout": with_dropout,
    }
    lines = [
        "| | metres | sightings, objects | way | real 50, 75, 90 % | simulated 50, 75, 90 % | ratio of medians "
        "| with other objects | KS | real / simulated 50, 75, 90 % | of two draws 90 % | real / highest tenth 90 % |",
        "| --- | --- | ---: | --- | --- | --- | ---: | ---: | ---: | --- | ---: | ---: |",
    ]
    for mine in binned(objects):
        group, low = objects[mine[0]].group, min(objects[i].distance for i in mine) // 10 * 10
        real = np.array([objects[i].real for i in mine], dtype=float)
        identities = [objects[i].identity for i in mine]
        for name, of_all in ways.items():
            simulated = of_all[:, mine].astype(float)
            some = simulated > 0
            highest = np.quantile(simulated, 0.9, axis=0)
            quantiles = [np.quantile(values, (0.5, 0.75, 0.9)) for values in (real, simulated)]
            shown = [", ".join(f"{q:.0f}" for q in each) for each in quantiles]
            if not some.any():
                continue
            ratios = np.broadcast_to(real, simulated.shape)[some] / simulated[some]
            shown.append(", ".join(f"{q:.2f}" for q in np.quantile(ratios, (0.5, 0.75, 0.9))))
            two = np.quantile(np.roll(simulated, 1, axis=0)[some] / simulated[some], 0.9)
            lit = highest > 0
            upper = np.quantile(real[lit] / highest[lit], 0.9) if lit.any() else np.inf
            middle = quantiles[0][0] / quantiles[1][0] if quantiles[1][0] else np.inf
            lines.append(
                f"| {group} | {low:.0f}-{low + 10:.0f} | {len(mine)}, {len(set(identities))} | {name} | {shown[0]} "
                f"| {shown[1]} | {middle:.2f} | {trusted(real, simulated, identities)} "
                f"| {distance_between(real, simulated.ravel()):.2f} | {shown[2]} | {two:.2f} | {upper:.2f} |"
            )
    return lines


def hidden(objects: list[Counted], with_dropout: np.ndarray) -> str:
    """Say how many seem to stand behind what nobody labelled: fewer returns than one draw in twenty gives."""
    least = np.quantile(with_dropout, 0.05, axis=0)
    said = []
    for group, (low, high) in itertools.product(CLASSES.values(), ((10.0, 40.0), (40.0, 60.0))):
        pairs = [(o, few) for o, few in zip(objects, least, strict=True) if o.group == group and few >= 1]
        some = [o.real < few for o, few in pairs if low <= o.distance < high]
        if some:
            said.append(f"{np.mean(some):.0%} of {len(some)} {group} at {low:.0f}-{high:.0f} m")
    return "Fewer returns than a twentieth of the draws have " + ", ".join(said) + "."


def main() -> None:
    """Scan, fit, report."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("objects", type=Path)
    parser.add_argument("--every", type=int, default=1, help="Only every n-th sweep.")
    parser.add_argument("--method", default=default_caster(), help="Who casts the rays.")
    parser.add_argument("--reach", type=float, help="Fit nothing: report with this one, as another log should be.")
    parser.add_argument("--out", type=Path, help="Write the table here too.")
    given = parser.parse_args()
    began = time.perf_counter()
    objects = []
    for one in count(given.objects, given.every, given.method):
        objects.append(one)
        if len(objects) % 100 == 0:
            print(f"{len(objects)} objects, {time.perf_counter() - began:.0f} s", file=sys.stderr)
    if given.reach is None:
        reaches, fitted = cross_fitted(objects)
    else:
        reaches, fitted = np.full(len(objects), given.reach), f"Not fitted: reach {given.reach:g} m."
    simulated = drawn(objects, reaches)
    lines = [
        f"{len(objects)} sightings of {len({o.sweep for o in objects})} sweeps, rays by {given.method}. {fitted}",
        "",
        *report(objects, simulated),
        "",
        hidden(objects, simulated),
    ]
    print("\n".join(lines))
    if given.out is not None:
        given.out.write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
