"""The kinds of scenes: what is put around a target, drawn from a seed, so that a stated share of it is hidden."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from zbuf_occlude.arrays import FloatArray
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.scenes.hiding import placed_to_hide
from zbuf_occlude.scenes.parts import box, plate, pole
from zbuf_occlude.scenes.scene import Placed, moved

GROUND_HALF = 150.0
"""The ground ends this far from the target, metres."""
STREET_OBJECTS = 20
STREET_POLES = 5
ROOM_OBJECTS = 6
WITHIN = 0.02
"""A share is reached when it is within this of the range asked for."""
TRIES = 4
"""Objects tried to hide a target, before a plain box is."""


@dataclass(frozen=True, eq=False)
class Asked:
    """What a scene is made for.

    Parameters
    ----------
    target : Placed
        Number 0 of the scene; its box's centre is the world's origin.
    eye : (3,) float
        Of the sensor.
    floor : float
        The ground's z.
    positions : (n, 3) float
        Points of the target that the eye sees of it alone.
    share : (float, float) or None
        Of them to be hidden by others.
    pool : callable
        Returns an object to put there, by a number in [0, 1): a mesh that stands on z = 0, in metres, and its class.
    """

    target: Placed
    eye: FloatArray
    floor: float
    positions: FloatArray
    share: tuple[float, float] | None
    pool: Callable[[float], tuple[Mesh, str]]


@dataclass(frozen=True, eq=False)
class Arranged:
    """A scene's objects, the target first, and the share of the target that was to be hidden (0 where none was)."""

    placed: list[Placed]
    wanted: float = 0.0
    in_front: list[int] = field(default_factory=list)


def none(asked: Asked, rng: np.random.Generator) -> Arranged:
    """Return the target alone."""
    return Arranged([asked.target])


def ground(asked: Asked, rng: np.random.Generator) -> Arranged:
    """Return the target on a plane."""
    return Arranged([asked.target, _ground(asked)])


def street(asked: Asked, rng: np.random.Generator) -> Arranged:
    """Return the target among objects, poles and a wall; some of them before it, so that a share of it is hidden."""
    placed = [asked.target, _ground(asked)]
    wanted, before = _hidden_by(asked, rng, box(5.2, 2.0, 2.3), "van")
    placed += before
    along, across = _frame(asked)
    size = float(np.linalg.norm(np.ptp(asked.target.vertices, axis=0)[:2]))
    taken = [(np.zeros(2), size / 2)]
    for number in range(STREET_OBJECTS + STREET_POLES):
        mesh, label = (pole(0.1, 5.0), "pole") if number >= STREET_OBJECTS else asked.pool(rng.random())
        radius = float(np.linalg.norm(np.ptp(mesh.bounds, axis=0)[:2])) / 2
        for _ in range(10):
            # beside and behind the target, never between it and the eye
            side, back = rng.uniform(-18.0, 18.0), rng.uniform(-2.0, 22.0)
            place = back * along[:2] + side * across[:2]
            if back < 0.5 * abs(side) + size / 2 + radius and abs(side) < size + 2 * radius + 1.0:
                continue
            if all(_apart(place, other) > radius + reach + 0.3 for other, reach in taken):
                placed.append(_standing(mesh, label, place, asked.floor, rng))
                taken.append((place, radius))
                break
    wall = moved(yaw=float(np.arctan2(across[1], across[0])), to=[*(rng.uniform(24.0, 30.0) * along[:2]), asked.floor])
    placed.append(Placed(box(80.0, 0.3, 4.0), "wall", wall))
    return Arranged(placed, wanted, list(range(2, 2 + len(before))))


def room(asked: Asked, rng: np.random.Generator) -> Arranged:
    """Return the target in a room with furniture: floor, four walls about target and sensor, ceiling."""
    wanted, before = _hidden_by(asked, rng, box(1.2, 0.1, 1.8), "screen")
    along, across = _frame(asked)
    half = np.ptp(asked.target.vertices, axis=0) / 2
    distance = float(np.linalg.norm(asked.eye[:2]))
    size = float(np.linalg.norm(half[:2]))
    behind, aside = size + rng.uniform(0.4, 2.0), size + rng.uniform(1.2, 3.0)
    length, width = distance + 1.0 + behind, 2.0 * aside
    middle = (behind - distance - 1.0) / 2.0 * along[:2]
    height = max(2.6, float(asked.eye[2]) - asked.floor + 0.5, 2 * float(half[2]) + 0.3)
    yaw = float(np.arctan2(along[1], along[0]))
    pose = moved(yaw=yaw, to=[*middle, asked.floor])
    placed = [asked.target, Placed(box(length, width, height), "room", pose), *before]
    taken = [(np.zeros(2), size)]
    for _ in range(ROOM_OBJECTS):
        mesh, label = asked.pool(rng.random())
        radius = float(np.linalg.norm(np.ptp(mesh.bounds, axis=0)[:2])) / 2
        if radius > aside - 0.2 or np.ptp(mesh.bounds, axis=0)[2] > height:
            continue
        for _ in range(10):
            side = rng.uniform(radius - aside, aside - radius)
            back = rng.uniform(-size, max(behind - radius, -size + 0.01))
            place = back * along[:2] + side * across[:2]
            clear = back > 0 or abs(side) > size + radius
            if clear and all(_apart(place, other) > radius + reach for other, reach in taken):
                placed.append(_standing(mesh, label, place, asked.floor, rng))
                taken.append((place, radius))
                break
    return Arranged(placed, wanted, list(range(2, 2 + len(before))))


@dataclass(frozen=True)
class Kind:
    """One row of the table of scenes.

    Parameters
    ----------
    name, summary : str
    arrange : callable
        Puts objects around a target.
    sensor_height : float or None
        Metres above the ground; None: the sensor stands where the view says, and there is no ground.
    share : (float, float) or None
        Hidden of the target unless asked otherwise; None: nothing is put before it.
    """

    name: str
    summary: str
    arrange: Callable[[Asked, np.random.Generator], Arranged]
    sensor_height: float | None = None
    share: tuple[float, float] | None = None


KINDS: tuple[Kind, ...] = (
    Kind("none", "the target alone", none),
    Kind("ground", "the target on a plane", ground, 1.73),
    Kind("street", "ground, objects of the collection, poles, a wall", street, 1.73, (0.0, 0.7)),
    Kind("room", "floor, walls, ceiling, furniture", room, 1.3, (0.0, 0.5)),
)
"""The sensor's heights: HDL-64E's on KITTI's car; assumed of a room."""


def _hidden_by(asked: Asked, rng: np.random.Generator, last: Mesh, label: str) -> tuple[float, list[Placed]]:
    """Objects before the target that hide a share drawn from the range asked for; and that share."""
    low, high = asked.share or (0.0, 0.0)
    wanted = float(rng.uniform(low, high))
    if high == 0.0 or not len(asked.positions):
        return 0.0, []
    distance = float(np.linalg.norm(asked.eye[:2]))
    size = float(np.linalg.norm(np.ptp(asked.target.vertices, axis=0)[:2])) / 2
    best: tuple[float, list[Placed]] = (1.0, [])
    for number in range(TRIES + 1):
        mesh, name = (last, label) if number == TRIES else asked.pool(rng.random())
        radius = float(np.linalg.norm(np.ptp(mesh.bounds, axis=0)[:2])) / 2
        nearest, farthest = 0.15 * distance + radius, distance - size - radius
        if number == TRIES:  # a box turned across the line of sight, half way: it must fit
            nearest = farthest = max(0.5 * (distance - size), 0.2 * distance)
        elif not nearest < farthest:
            continue
        share = 1.0 - rng.uniform(nearest, farthest) / distance if nearest < farthest else 1.0 - nearest / distance
        place = share * asked.eye[:2]
        if number == TRIES:
            yaw = float(np.arctan2(asked.eye[1], asked.eye[0])) + np.pi / 2
            candidate = Placed(mesh, name, moved(yaw=yaw, to=[*place, asked.floor]))
        else:
            candidate = _standing(mesh, name, place, asked.floor, rng)
        one, hidden = placed_to_hide(candidate, asked.positions, asked.eye, wanted)
        if abs(hidden - wanted) < best[0]:
            best = abs(hidden - wanted), [one]
        if best[0] <= WITHIN / 2:
            break
    return wanted, best[1]


def _standing(
    mesh: Mesh, label: str, place: FloatArray | Sequence[float], floor: float, rng: np.random.Generator
) -> Placed:
    return Placed(mesh, label, moved(yaw=float(rng.uniform(0, 2 * np.pi)), to=[*place, floor]))


def _apart(a: FloatArray, b: FloatArray) -> float:
    """Distance of two places on the ground; hundreds are asked for per scene."""
    return math.hypot(a[0] - b[0], a[1] - b[1])


def _ground(asked: Asked) -> Placed:
    return Placed(plate(GROUND_HALF), "ground", moved(to=(0.0, 0.0, asked.floor)))


def _frame(asked: Asked) -> tuple[FloatArray, FloatArray]:
    """Unit vectors on the ground: from the sensor past the target, and across that to the left."""
    away = -asked.eye * [1.0, 1.0, 0.0]
    length = float(np.linalg.norm(away))
    along = away / length if length > 0 else np.array([1.0, 0.0, 0.0])
    return along, np.array([-along[1], along[0], 0.0])
