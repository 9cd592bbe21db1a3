"""The kinds of scenes: objects drawn from a seed around a target, which hide a stated share of it."""

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from zbuf_occlude.base.arrays import FloatArray
from zbuf_occlude.base.errors import MeshError
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.meshes.sampling import SurfacePoints
from zbuf_occlude.sensors.scenes.scene import Placed, Scene, moved, upright_pose
from zbuf_occlude.sensors.scenes.table import footprint, put_at_rest
from zbuf_occlude.visibility import prepare
from zbuf_occlude.visibility.interface import VisibilityQuery

GROUND_HALF = 150.0
"""Distance from the target to each edge of the ground, metres."""
STREET_OBJECTS = 20
STREET_POLES = 5
STREET_DRAWN = STREET_OBJECTS + STREET_POLES
ROOM_OBJECTS = 6
TABLE_OBJECTS = 5
TABLE_THICKNESS, TABLE_LEG = 0.03, 0.05
"""Thickness of a table's top and side of its legs, metres."""
TOLERANCE = 0.02
"""Tolerance of the hidden share about the range asked for."""
TRIES = 4
"""Objects of the pool tried to hide a target, before a plain box is taken."""
N_POINTS = 60_000
"""Points on the whole target. An eye sees a sixth to a third of them: a share's standard deviation is at most 0.5 %."""
N_TRIED = 3_000
"""Points among them that are tested while an object is moved into position."""
METHOD = "exact"
"""Visibility method of the hidden shares."""
HALVINGS = 10
CLOSE = 0.004
"""Tolerance of the hidden share at which the bisection stops."""
_CORNERS = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (0.0, 1.0)])
_SIDES = ((0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5))


@dataclass(frozen=True, eq=False)
class SceneRequest:
    """The input of a scene's layout.

    Parameters
    ----------
    target : Placed
        Object 0 of the scene; the centre of its box is the world's origin.
    eye : (3,) float
        Position of the sensor.
    floor : float
        Height z of the ground.
    positions : (n, 3) float
        Points of the target that the eye would see if the target were alone.
    share : (float, float) or None
        Bounds of the share of these points that others hide.
    pool : callable
        Returns an object for a number in [0, 1): a mesh that stands on z = 0, in metres, and its class.
    table : mapping or None
        Size, height and albedo of the table that the target is on (`table.checked_table`); None: it is on the ground.
    """

    target: Placed
    eye: FloatArray
    floor: float
    positions: FloatArray
    share: Sequence[float] | None
    pool: Callable[[float], tuple[Mesh, str]]
    table: Mapping[str, Any] | None = None


def none(request: SceneRequest, rng: np.random.Generator) -> list[Placed]:
    """Return the target alone, or on its table."""
    return [request.target, *_table(request)]


def ground(request: SceneRequest, rng: np.random.Generator) -> list[Placed]:
    """Return the target on a plane, or on its table there."""
    return [request.target, _ground(request), *_table(request)]


def tabletop(request: SceneRequest, rng: np.random.Generator) -> list[Placed]:
    """Return the target on a table, among objects at rest; those that find no place are left out."""
    assert request.table is not None
    placed, occupied = ground(request, rng), [footprint(request.target.vertices)]
    for _ in range(TABLE_OBJECTS):
        mesh, label = request.pool(rng.random())
        with suppress(MeshError):
            placed.append(put_at_rest(mesh, label, request.table["size"], request.floor, occupied, rng))
    return placed


def street(request: SceneRequest, rng: np.random.Generator) -> list[Placed]:
    """Return the target among objects, poles and a wall, some of them in front of it to hide a share of it."""
    before = _hidden_by(request, rng, box_mesh(5.2, 2.0, 2.3), "van")
    placed = [request.target, _ground(request), *before]
    along, across = _frame(request)
    size = 2 * _radius(request.target.vertices)
    occupied = [(np.zeros(2), size / 2)]

    def draw_position(radius: float) -> FloatArray | None:
        """Return a position beside or behind the target; None for one between target and eye."""
        side, back = rng.uniform(-18.0, 18.0), rng.uniform(-2.0, 22.0)
        clear = back >= 0.5 * abs(side) + size / 2 + radius or abs(side) >= size + 2 * radius + 1.0
        return back * along[:2] + side * across[:2] if clear else None

    for number in range(STREET_DRAWN):
        is_pole = number >= STREET_OBJECTS
        mesh, label = (pole_mesh(0.1, 5.0), "pole") if is_pole else request.pool(rng.random())
        found = _at_free_position(mesh, label, draw_position, occupied, 0.3, request, rng)
        placed += [replace(each, is_background=is_pole) for each in found]
    away = rng.uniform(24.0, 30.0) * along[:2]
    wall = upright_pose(float(np.arctan2(across[1], across[0])), [*away, request.floor])
    placed.append(Placed(box_mesh(80.0, 0.3, 4.0), "wall", wall, is_background=True))
    return placed


def room(request: SceneRequest, rng: np.random.Generator) -> list[Placed]:
    """Return the target in a furnished room: floor, ceiling, and four walls about target and sensor."""
    before = _hidden_by(request, rng, box_mesh(1.2, 0.1, 1.8), "screen")
    along, across = _frame(request)
    distance, size = float(np.linalg.norm(request.eye[:2])), _radius(request.target.vertices)
    behind, aside = size + rng.uniform(0.4, 2.0), size + rng.uniform(1.2, 3.0)
    middle = (behind - distance - 1.0) / 2.0 * along[:2]
    height = max(2.6, float(request.eye[2]) - request.floor + 0.5, float(np.ptp(request.target.vertices[:, 2])) + 0.3)
    pose = upright_pose(float(np.arctan2(along[1], along[0])), [*middle, request.floor])
    walls = box_mesh(distance + 1.0 + behind, 2.0 * aside, height)
    placed = [request.target, Placed(walls, "room", pose, is_background=True), *before]
    occupied = [(np.zeros(2), size)]

    def draw_position(radius: float) -> FloatArray | None:
        side = rng.uniform(radius - aside, aside - radius)
        back = rng.uniform(-size, max(behind - radius, -size + 0.01))
        return back * along[:2] + side * across[:2] if back > 0 or abs(side) > size + radius else None

    for _ in range(ROOM_OBJECTS):
        mesh, label = request.pool(rng.random())
        if _radius(mesh.bounds) <= aside - 0.2 and np.ptp(mesh.bounds, axis=0)[2] <= height:
            placed += _at_free_position(mesh, label, draw_position, occupied, 0.0, request, rng)
    return placed


@dataclass(frozen=True)
class Kind:
    """One row of the table of scenes.

    Parameters
    ----------
    name, summary : str
    arrange : callable
        Returns the objects for a request and a generator, the target first.
    sensor_height : float or None
        Height of a LiDAR above the ground, metres; None: there is no ground.
    share : (float, float) or None
        Default bounds of the target's hidden share; None: nothing hides the target.
    most : int
        Maximum number of objects.
    """

    name: str
    summary: str
    arrange: Callable[[SceneRequest, np.random.Generator], list[Placed]]
    sensor_height: float | None = None
    share: tuple[float, float] | None = None
    most: int = 1


KINDS: tuple[Kind, ...] = (
    Kind("none", "the target alone", none),
    Kind("ground", "the target on a plane", ground, 1.73, most=2),
    Kind("street", "ground, road users, poles, a wall", street, 1.73, (0.0, 0.7), 4 + STREET_DRAWN),
    Kind("room", "floor, walls, ceiling, furniture", room, 1.3, (0.0, 0.5), 3 + ROOM_OBJECTS),
    Kind("table", "a table on the ground, objects at rest on it", tabletop, 1.73, most=2 + TABLE_OBJECTS),
)
"""The kinds of scenes. The LiDAR's height is that of the HDL-64E on KITTI's car; in a room it is assumed."""


def _hidden_by(request: SceneRequest, rng: np.random.Generator, last: Mesh, label: str) -> list[Placed]:
    """Return objects in front of the target that hide a share of it, drawn from the bounds asked for."""
    low, high = request.share or (0.0, 0.0)
    wanted = float(rng.uniform(low, high))
    if high == 0.0 or not len(request.positions):
        return []
    distance = float(np.linalg.norm(request.eye[:2]))
    size = _radius(request.target.vertices)
    if distance <= size:  # no room between a target and a camera above it
        return []
    best: tuple[float, list[Placed]] = (1.0, [])
    for number in range(TRIES + 1):
        mesh, name = (last, label) if number == TRIES else request.pool(rng.random())
        radius = _radius(mesh.bounds)
        nearest, farthest = 0.15 * distance + radius, distance - size - radius
        if number == TRIES:  # a box across the line of sight, half way: it always fits
            share = 1.0 - max(0.5 * (distance - size), 0.2 * distance) / distance
            yaw = float(np.arctan2(request.eye[1], request.eye[0])) + np.pi / 2
            candidate = Placed(mesh, name, upright_pose(yaw, [*(share * request.eye[:2]), request.floor]))
        elif nearest < farthest:
            share = 1.0 - rng.uniform(nearest, farthest) / distance
            candidate = _standing(mesh, name, share * request.eye[:2], request.floor, rng)
        else:
            continue
        one, hidden = placed_to_hide(candidate, request.positions, request.eye, wanted)
        if abs(hidden - wanted) < best[0]:
            best = abs(hidden - wanted), [one]
        if best[0] <= TOLERANCE / 2:
            break
    return best[1]


def _standing(
    mesh: Mesh, label: str, position: FloatArray | Sequence[float], floor: float, rng: np.random.Generator
) -> Placed:
    return Placed(mesh, label, upright_pose(float(rng.uniform(0, 2 * np.pi)), [*position, floor]))


def _at_free_position(
    mesh: Mesh,
    label: str,
    draw_position: Callable[[float], FloatArray | None],
    occupied: list[tuple[FloatArray, float]],
    gap: float,
    request: SceneRequest,
    rng: np.random.Generator,
) -> list[Placed]:
    """Return a mesh at the first of ten drawn positions that is free, and add it to `occupied`; else nothing.

    A position is free where the circle about the mesh keeps `gap` from all circles (centre, radius) that are occupied.
    """
    radius = _radius(mesh.bounds)
    for _ in range(10):
        position = draw_position(radius)
        if position is not None and all(
            math.hypot(position[0] - x, position[1] - y) > radius + other + gap for (x, y), other in occupied
        ):
            occupied.append((position, radius))
            return [_standing(mesh, label, position, request.floor, rng)]
    return []


def _radius(positions: FloatArray) -> float:
    """Return the radius of a circle on the ground about the bounding box of some positions (n, 3)."""
    return float(np.linalg.norm(np.ptp(positions, axis=0)[:2])) / 2


def _ground(request: SceneRequest) -> Placed:
    below = request.floor - (0.0 if request.table is None else request.table["height"])
    return Placed(plate_mesh(GROUND_HALF), "ground", moved(to=(0.0, 0.0, below)), is_background=True)


def _table(request: SceneRequest) -> list[Placed]:
    """Return the table that the target is on; nothing where there is none."""
    if request.table is None:
        return []
    (length, width), height = request.table["size"], request.table["height"]
    mesh = table_mesh(length, width, height)
    pose = moved(to=(0.0, 0.0, request.floor - height))
    return [Placed(mesh, "table", pose, request.table.get("albedo"), is_background=True)]


def _frame(request: SceneRequest) -> tuple[FloatArray, FloatArray]:
    """Return unit vectors on the ground: from the sensor towards the target, and perpendicular to it, to the left."""
    away = -request.eye * [1.0, 1.0, 0.0]
    length = float(np.linalg.norm(away))
    along = away / length if length > 0 else np.array([1.0, 0.0, 0.0])
    return along, np.array([-along[1], along[0], 0.0])


@lru_cache(maxsize=32)
def prepared(mesh: Mesh) -> VisibilityQuery:
    """Return a prepared mesh, cached for all scenes that contain it; `METHOD` needs no closing."""
    return prepare(mesh, METHOD)


def placed_to_hide(candidate: Placed, positions: FloatArray, eye: FloatArray, share: float) -> tuple[Placed, float]:
    """Move an object across the line of sight until it hides a share of some positions.

    Parameters
    ----------
    candidate : Placed
        The object between eye and target, where it hides most.
    positions : (n, 3) float
        Visible points of the target.
    eye : (3,) float
    share : float
        Share to hide, in [0, 1].

    Returns
    -------
    placed : Placed
    hidden : float
        Share that the object hides there, of `N_TRIED` positions; the greatest one where `share` cannot be reached.
    """
    sight = positions.mean(axis=0) - eye
    across = np.array([-sight[1], sight[0], 0.0]) / max(float(np.hypot(sight[0], sight[1])), 1e-9)
    tried = positions[:: max(1, len(positions) // N_TRIED)]
    occluder, to_mesh = prepared(candidate.mesh), np.linalg.inv(candidate.pose)  # lines stay lines
    foot = candidate.pose[:3, 3]
    points, from_eye, step = (vectors @ to_mesh[:3, :3].T for vectors in (tried - foot, eye - foot, across))

    def hidden_at(shift: float) -> float:
        shifted = SurfacePoints.free(points - shift * step)
        return 1.0 - float(occluder.visible(shifted, (from_eye - shift * step)[None]).mean())

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
    """Return a horizontal square at z = 0 that extends `half` to each side."""
    corners = half * np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    return Mesh(corners, np.array([[0, 1, 2], [0, 2, 3]]), "plate")


@lru_cache(16)
def box_mesh(length: float, width: float, height: float) -> Mesh:
    """Return a box that stands on z = 0, its length along x."""
    faces = [face for a, b, c, d in _SIDES for face in ([a, b, c], [a, c, d])]
    return Mesh(_CORNERS * [length, width, height], np.array(faces), "box")


@lru_cache(16)
def table_mesh(length: float, width: float, height: float) -> Mesh:
    """Return a table that stands on z = 0: a top, `height` above it, and four legs."""
    thickness = min(TABLE_THICKNESS, height / 2.0)
    leg = min(TABLE_LEG, length / 4.0, width / 4.0)
    parts = [Placed(box_mesh(length, width, thickness), pose=moved(to=(0.0, 0.0, height - thickness)))]
    x, y = (length - leg) / 2.0, (width - leg) / 2.0
    for at in ((x, y), (-x, y), (-x, -y), (x, -y)):
        parts.append(Placed(box_mesh(leg, leg, height - thickness), pose=moved(to=(*at, 0.0))))
    whole = Scene.joined(parts).mesh
    return Mesh(whole.vertices, whole.faces, "table")


@lru_cache(16)
def pole_mesh(radius: float, height: float, n_sides: int = 12) -> Mesh:
    """Return an upright prism that stands on z = 0, open at both ends."""
    angles = np.arange(n_sides) * (2 * np.pi / n_sides)
    ring: FloatArray = np.stack([radius * np.cos(angles), radius * np.sin(angles), np.zeros(n_sides)], axis=1)
    i = np.arange(n_sides)
    j = (i + 1) % n_sides
    faces = np.concatenate([np.stack([i, j, j + n_sides], 1), np.stack([i, j + n_sides, i + n_sides], 1)])
    return Mesh(np.concatenate([ring, ring + np.array([0.0, 0.0, height])]), faces, "pole")
