"""The kinds of scenes: what is put around a target, drawn from a seed, so that a stated share of it is hidden."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from zbuf_occlude.arrays import FloatArray
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.geometry.sampling import SurfacePoints
from zbuf_occlude.scenes.scene import Placed, moved
from zbuf_occlude.visibility import prepare
from zbuf_occlude.visibility.interface import VisibilityQuery

GROUND_HALF = 150.0
"""The ground ends this far from the target, metres."""
STREET_OBJECTS = 20
STREET_POLES = 5
STREET_DRAWN = STREET_OBJECTS + STREET_POLES
ROOM_OBJECTS = 6
WITHIN = 0.02
"""A share is reached when it is within this of the range asked for."""
TRIES = 4
"""Objects tried to hide a target, before a plain box is."""
N_POINTS = 60_000
"""On the whole target. Of them a sixth to a third shows, so a share's standard deviation is at most half a percent."""
N_TRIED = 3_000
"""Of them this many are asked about while a place is looked for."""
METHOD = "exact"
HALVINGS = 10
CLOSE = 0.004
"""A share this near to the one wanted will do."""
_CORNERS = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (0.0, 1.0)])
_SIDES = ((0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5))


@dataclass(frozen=True, eq=False)
class SceneRequest:
    """What a scene is made for.

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
    share: Sequence[float] | None
    pool: Callable[[float], tuple[Mesh, str]]


class SceneLayout(NamedTuple):
    """A scene's objects, the target first, and the share of the target that was to be hidden (0 where none was)."""

    placed: list[Placed]
    wanted: float = 0.0


def none(asked: SceneRequest, rng: np.random.Generator) -> SceneLayout:
    """Return the target alone."""
    return SceneLayout([asked.target])


def ground(asked: SceneRequest, rng: np.random.Generator) -> SceneLayout:
    """Return the target on a plane."""
    return SceneLayout([asked.target, _ground(asked)])


def street(asked: SceneRequest, rng: np.random.Generator) -> SceneLayout:
    """Return the target among objects, poles and a wall; some of them before it, so that a share of it is hidden."""
    wanted, before = _hidden_by(asked, rng, box_mesh(5.2, 2.0, 2.3), "van")
    placed = [asked.target, _ground(asked), *before]
    along, across = _frame(asked)
    size = 2 * _radius(asked.target.vertices)
    taken = [(np.zeros(2), size / 2)]

    def draw(radius: float) -> FloatArray | None:
        """Beside and behind the target, never between it and the eye."""
        side, back = rng.uniform(-18.0, 18.0), rng.uniform(-2.0, 22.0)
        clear = back >= 0.5 * abs(side) + size / 2 + radius or abs(side) >= size + 2 * radius + 1.0
        return back * along[:2] + side * across[:2] if clear else None

    for number in range(STREET_DRAWN):
        is_pole = number >= STREET_OBJECTS
        mesh, label = (pole_mesh(0.1, 5.0), "pole") if is_pole else asked.pool(rng.random())
        found = _at_a_free_place(mesh, label, draw, taken, 0.3, asked, rng)
        placed += [replace(each, is_background=is_pole) for each in found]
    wall = moved(yaw=float(np.arctan2(across[1], across[0])), to=[*(rng.uniform(24.0, 30.0) * along[:2]), asked.floor])
    placed.append(Placed(box_mesh(80.0, 0.3, 4.0), "wall", wall, is_background=True))
    return SceneLayout(placed, wanted)


def room(asked: SceneRequest, rng: np.random.Generator) -> SceneLayout:
    """Return the target in a room with furniture: floor, four walls about target and sensor, ceiling."""
    wanted, before = _hidden_by(asked, rng, box_mesh(1.2, 0.1, 1.8), "screen")
    along, across = _frame(asked)
    distance, size = float(np.linalg.norm(asked.eye[:2])), _radius(asked.target.vertices)
    behind, aside = size + rng.uniform(0.4, 2.0), size + rng.uniform(1.2, 3.0)
    middle = (behind - distance - 1.0) / 2.0 * along[:2]
    height = max(2.6, float(asked.eye[2]) - asked.floor + 0.5, float(np.ptp(asked.target.vertices[:, 2])) + 0.3)
    pose = moved(yaw=float(np.arctan2(along[1], along[0])), to=[*middle, asked.floor])
    walls = box_mesh(distance + 1.0 + behind, 2.0 * aside, height)
    placed = [asked.target, Placed(walls, "room", pose, is_background=True), *before]
    taken = [(np.zeros(2), size)]

    def draw(radius: float) -> FloatArray | None:
        side = rng.uniform(radius - aside, aside - radius)
        back = rng.uniform(-size, max(behind - radius, -size + 0.01))
        return back * along[:2] + side * across[:2] if back > 0 or abs(side) > size + radius else None

    for _ in range(ROOM_OBJECTS):
        mesh, label = asked.pool(rng.random())
        if _radius(mesh.bounds) <= aside - 0.2 and np.ptp(mesh.bounds, axis=0)[2] <= height:
            placed += _at_a_free_place(mesh, label, draw, taken, 0.0, asked, rng)
    return SceneLayout(placed, wanted)


@dataclass(frozen=True)
class Kind:
    """One row of the table of scenes.

    Parameters
    ----------
    name, summary : str
    arrange : callable
        Puts objects around a target.
    sensor_height : float or None
        Metres of a LiDAR above the ground; None: there is no ground.
    share : (float, float) or None
        Hidden of the target unless asked otherwise; None: nothing is put before it.
    most : int
        Objects of a scene, at most.
    """

    name: str
    summary: str
    arrange: Callable[[SceneRequest, np.random.Generator], SceneLayout]
    sensor_height: float | None = None
    share: tuple[float, float] | None = None
    most: int = 1


KINDS: tuple[Kind, ...] = (
    Kind("none", "the target alone", none),
    Kind("ground", "the target on a plane", ground, 1.73, most=2),
    Kind("street", "ground, road users, poles, a wall", street, 1.73, (0.0, 0.7), 4 + STREET_DRAWN),
    Kind("room", "floor, walls, ceiling, furniture", room, 1.3, (0.0, 0.5), 3 + ROOM_OBJECTS),
)
"""The LiDAR's heights: HDL-64E's on KITTI's car; assumed of a room."""


def _hidden_by(asked: SceneRequest, rng: np.random.Generator, last: Mesh, label: str) -> tuple[float, list[Placed]]:
    """Objects before the target that hide a share drawn from the range asked for; and that share."""
    low, high = asked.share or (0.0, 0.0)
    wanted = float(rng.uniform(low, high))
    if high == 0.0 or not len(asked.positions):
        return 0.0, []
    distance = float(np.linalg.norm(asked.eye[:2]))
    size = _radius(asked.target.vertices)
    if distance <= size:  # nothing can stand between a target and a camera above it
        return wanted, []
    best: tuple[float, list[Placed]] = (1.0, [])
    for number in range(TRIES + 1):
        mesh, name = (last, label) if number == TRIES else asked.pool(rng.random())
        radius = _radius(mesh.bounds)
        nearest, farthest = 0.15 * distance + radius, distance - size - radius
        if number == TRIES:  # a box turned across the line of sight, half way: it must fit
            share = 1.0 - max(0.5 * (distance - size), 0.2 * distance) / distance
            yaw = float(np.arctan2(asked.eye[1], asked.eye[0])) + np.pi / 2
            candidate = Placed(mesh, name, moved(yaw=yaw, to=[*(share * asked.eye[:2]), asked.floor]))
        elif nearest < farthest:
            share = 1.0 - rng.uniform(nearest, farthest) / distance
            candidate = _standing(mesh, name, share * asked.eye[:2], asked.floor, rng)
        else:
            continue
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


def _at_a_free_place(
    mesh: Mesh,
    label: str,
    draw: Callable[[float], FloatArray | None],
    taken: list[tuple[FloatArray, float]],
    gap: float,
    asked: SceneRequest,
    rng: np.random.Generator,
) -> list[Placed]:
    """Try ten drawn places for a mesh; return it at the first that keeps a gap to those taken, and take that."""
    radius = _radius(mesh.bounds)
    for _ in range(10):
        place = draw(radius)
        if place is not None and all(
            math.hypot(place[0] - other[0], place[1] - other[1]) > radius + reach + gap for other, reach in taken
        ):
            taken.append((place, radius))
            return [_standing(mesh, label, place, asked.floor, rng)]
    return []


def _radius(positions: FloatArray) -> float:
    """Of a circle on the ground about the middle of a box with these corners, or of these vertices."""
    return float(np.linalg.norm(np.ptp(positions, axis=0)[:2])) / 2


def _ground(asked: SceneRequest) -> Placed:
    return Placed(plate_mesh(GROUND_HALF), "ground", moved(to=(0.0, 0.0, asked.floor)), is_background=True)


def _frame(asked: SceneRequest) -> tuple[FloatArray, FloatArray]:
    """Unit vectors on the ground: from the sensor past the target, and across that to the left."""
    away = -asked.eye * [1.0, 1.0, 0.0]
    length = float(np.linalg.norm(away))
    along = away / length if length > 0 else np.array([1.0, 0.0, 0.0])
    return along, np.array([-along[1], along[0], 0.0])


@lru_cache(maxsize=32)
def ready(mesh: Mesh) -> VisibilityQuery:
    """Make a mesh ready, once for all scenes that it stands in; `METHOD` has nothing to close."""
    return prepare(mesh, METHOD)


def placed_to_hide(candidate: Placed, positions: FloatArray, eye: FloatArray, share: float) -> tuple[Placed, float]:
    """Move an object across the line of sight until it hides a share of some positions.

    Parameters
    ----------
    candidate : Placed
        Where it hides most: between eye and target.
    positions : (n, 3) float
        Of the target, those that the eye sees.
    eye : (3,) float
    share : float
        Wanted, in [0, 1].

    Returns
    -------
    placed : Placed
    hidden : float
        The share that it hides there, of a few; the greatest found where the one wanted cannot be reached.
    """
    sight = positions.mean(axis=0) - eye
    across = np.array([-sight[1], sight[0], 0.0]) / max(float(np.hypot(sight[0], sight[1])), 1e-9)
    tried = positions[:: max(1, len(positions) // N_TRIED)]
    occluder, to_mesh = ready(candidate.mesh), np.linalg.inv(candidate.pose)  # lines stay lines
    foot = candidate.pose[:3, 3]
    points, from_eye, step = (vectors @ to_mesh[:3, :3].T for vectors in (tried - foot, eye - foot, across))

    def hidden_at(shift: float) -> float:
        moved_on = SurfacePoints.free(points - shift * step)
        return 1.0 - float(occluder.visible(moved_on, (from_eye - shift * step)[None]).mean())

    most = hidden_at(0.0)
    near, far, best, found = 0.0, 0.0, 0.0, most
    if most > share + CLOSE:
        far = float(np.ptp(positions @ across) + np.ptp(candidate.vertices @ across)) + 0.1
        for _ in range(HALVINGS):
            middle = (near + far) / 2.0
            hidden = hidden_at(middle)
            if abs(hidden - share) < abs(found - share):
                best, found = middle, hidden
            if abs(hidden - share) <= CLOSE:
                break
            near, far = (middle, far) if hidden > share else (near, middle)
    return replace(candidate, pose=moved(to=best * across) @ candidate.pose), found


@lru_cache(4)
def plate_mesh(half: float) -> Mesh:
    """Return a horizontal square at z = 0, `half` to each side."""
    corners = half * np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    return Mesh(corners, np.array([[0, 1, 2], [0, 2, 3]]), "plate")


@lru_cache(16)
def box_mesh(length: float, width: float, height: float) -> Mesh:
    """Return a box that stands on z = 0, its length along x."""
    faces = [face for a, b, c, d in _SIDES for face in ([a, b, c], [a, c, d])]
    return Mesh(_CORNERS * [length, width, height], np.array(faces), "box")


@lru_cache(16)
def pole_mesh(radius: float, height: float, n_sides: int = 12) -> Mesh:
    """Return an upright prism that stands on z = 0, open below and above."""
    angles = np.arange(n_sides) * (2 * np.pi / n_sides)
    ring: FloatArray = np.stack([radius * np.cos(angles), radius * np.sin(angles), np.zeros(n_sides)], axis=1)
    i = np.arange(n_sides)
    j = (i + 1) % n_sides
    faces = np.concatenate([np.stack([i, j, j + n_sides], 1), np.stack([i, j + n_sides, i + n_sides], 1)])
    return Mesh(np.concatenate([ring, ring + np.array([0.0, 0.0, height])]), faces, "pole")
