"""Road users other than cars, as large as a given box: people, bicycles and motorcycles with riders, trucks, buses.

    shapes.road_user("truck", (12.3, 2.6, 2.9))        length, width, height in metres
    shapes.ROAD_USERS                                  the table of them

A truck that is twice as long has a longer box, not a longer cab.
"""

from collections.abc import Callable, Sequence
from types import MappingProxyType

import numpy as np

from zbuf_occlude.base.arrays import FloatArray
from zbuf_occlude.base.errors import OptionError, check_choice
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.meshes.shapes.curves import circle
from zbuf_occlude.meshes.shapes.kit import MeshPart, boxes, cuboid, cylinder, ellipsoid, join, pair, repeated, rod, tube

USUAL_SIDES = MappingProxyType(
    {
        **{"pedestrian": (0.8, 0.6, 1.75), "bicycle": (1.8, 0.6, 1.75), "motorcycle": (2.1, 0.8, 1.6)},
        **{"truck": (8.0, 2.5, 3.2), "bus": (12.0, 2.55, 3.1)},
        **{"tractor": (6.0, 2.5, 3.2), "trailer": (12.0, 2.5, 4.0)},
    }
)
"""Default length, width and height, metres; assumed."""
RIDDEN_FROM = 1.3
"""Minimum height of a bicycle or motorcycle with a rider, metres."""
SEGMENTS = 12


def road_user(label: str, sides: Sequence[float] | FloatArray | None = None) -> Mesh:
    """Return a road user as large as its box.

    Parameters
    ----------
    label : str
        One of `ROAD_USERS`. A ``bicycle`` or ``motorcycle`` of 1.3 m height or more has a rider.
    sides : (3,) float, optional
        Length, width and height of the box, metres. Default: `USUAL_SIDES`. Only the height of a ``pedestrian`` counts:
        boxes of people include their stride and what they carry.

    Returns
    -------
    Mesh
        Metres, z up, front towards -y as in all built-in cars, the centre of its base at the origin.

    Raises
    ------
    OptionError
        An unknown road user, or sides that are not positive.

    Examples
    --------
    >>> from zbuf_occlude.meshes import shapes
    >>> shapes.road_user("truck", (8.0, 2.5, 3.2)).longest_side
    8.0
    """
    check_choice("label", label, ROAD_USERS)
    sides = USUAL_SIDES[label] if sides is None else sides
    if len(sides) != 3 or not all(0.0 < side < np.inf for side in sides):
        raise OptionError(f"sides must be length, width and height, positive; got {list(sides)}.")
    length, width, height = (float(side) for side in sides)
    part = ROAD_USERS[label](length, width, height)
    low, high = part.points.min(axis=0), part.points.max(axis=0)
    part = part.at(*-((low + high) / 2.0 * [1.0, 1.0, 0.0] + low * [0.0, 0.0, 1.0]))
    scale = np.array([width, length, height]) / (high - low)
    part = part.scaled(*(scale if label != "pedestrian" else scale[2:].repeat(3)))
    return Mesh(part.points, part.faces, name=label).cleaned()


def _person(length: float, width: float, height: float) -> MeshPart:
    """Return legs and arms in mid-stride, trunk, head."""
    limbs = [
        (centre, radii)
        for side, step in ((-1, 1), (1, -1))
        for centre, radii in (
            ((0.1 * side, -0.1 * step, 0.45), (0.09, 0.09, 0.45)),
            ((0.22 * side, 0.12 * step, 1.05), (0.06, 0.06, 0.33)),
        )
    ]
    trunk_and_head = [((0, 0, 1.15), (0.2, 0.14, 0.38)), ((0, -0.02, 1.62), (0.08, 0.1, 0.13))]
    return join(ellipsoid(centre, radii, 2 * SEGMENTS) for centre, radii in (*limbs, *trunk_and_head))


def _wheel(radius: float, thickness: float) -> MeshPart:
    """Return a tyre about the x axis."""
    ring = circle(2 * SEGMENTS) * (radius - thickness)
    return tube(np.insert(ring, 0, 0.0, axis=1), thickness, 6, closed=True)


def _rider(seat: float) -> MeshPart:
    """Return a seated figure at a height, with hands 0.45 m in front and feet 0.6 m below."""
    trunk = ellipsoid((0, 0, 0), (0.19, 0.13, 0.36), 2 * SEGMENTS).turned("x", 30).at(0, 0.02, seat + 0.27)
    head = ellipsoid((0, -0.25, seat + 0.68), (0.09, 0.11, 0.14), 2 * SEGMENTS)
    legs = [
        part
        for side, foot in ((-1, 0.3), (1, 0.5))
        for part in (
            rod((0.1 * side, 0.12, seat), (0.12 * side, -0.26, seat - foot + 0.2), 0.08, SEGMENTS, 0.06),
            rod((0.12 * side, -0.26, seat - foot + 0.2), (0.12 * side, -0.05, seat - foot - 0.2), 0.06, SEGMENTS, 0.05),
        )
    ]
    arm = rod((0.19, -0.13, seat + 0.48), (0.26, -0.46, seat + 0.1), 0.05, SEGMENTS, 0.04)
    return join([trunk, head, *legs, pair(arm)])


def _bicycle(length: float, width: float, height: float) -> MeshPart:
    hub, saddle, bar, crank = (0.0, 0.53, 0.34), (0.0, 0.22, 0.93), (0.0, -0.42, 1.0), (0.0, 0.1, 0.28)
    fork, tubes = (0.0, -0.53, 0.34), ((0, 2), (0, 3), (1, 3), (1, 2), (2, 3), (2, 4))
    joints = (hub, saddle, bar, crank, fork)
    parts = [rod(joints[a], joints[b], 0.02, 6) for a, b in tubes]
    parts += [rod((-0.28, -0.44, 1.02), (0.28, -0.44, 1.02), 0.02, 6), _wheel(0.34, 0.025).at(*hub)]
    parts += [_wheel(0.34, 0.025).at(*fork), ellipsoid(saddle, (0.07, 0.14, 0.04), SEGMENTS)]
    return join([*parts, _rider(0.97)] if height >= RIDDEN_FROM else parts)


def _motorcycle(length: float, width: float, height: float) -> MeshPart:
    tyres = join(_wheel(0.32, 0.07).scaled(x=1.3).at(0, y, 0.32) for y in (-0.7, 0.7))
    body = ellipsoid((0, 0, 0.58), (0.17, 0.5, 0.24), 2 * SEGMENTS)
    saddle = ellipsoid((0, 0.35, 0.78), (0.14, 0.4, 0.08), SEGMENTS)
    front = rod((0, -0.7, 0.32), (0, -0.42, 1.0), 0.06, 6) + rod((-0.36, -0.42, 1.05), (0.36, -0.42, 1.05), 0.03, 6)
    parts = [tyres, body, saddle, front, cuboid((-0.16, -0.62, 0.8), (0.16, -0.46, 1.12), edge=0.05)]
    return join([*parts, _rider(0.85)] if height >= RIDDEN_FROM else parts)


def _axles(places: Sequence[float], width: float, radius: float) -> MeshPart:
    """Return a pair of wheels at each of some positions along y."""
    wheel = cylinder(radius, -0.15, 0.15, 2 * SEGMENTS).turned("y", 90).at(width / 2 - 0.17, 0, radius)
    return repeated(pair(wheel), [(0.0, y, 0.0) for y in places])


def _tractor(length: float, width: float, height: float) -> MeshPart:
    """Return a cab of its own length, a low frame behind it, wheels."""
    cab, x, front, r = min(2.1, 0.4 * length), width / 2, -length / 2, min(0.5, 0.16 * height)
    hull = cuboid((-0.96 * x, front, 0.7 * r), (0.96 * x, front + cab, max(0.8 * height, min(height, 2.7))), 0.15, 2)
    frame = boxes((-0.4 * x, front + cab, 1.2 * r), (0.4 * x, length / 2, 2.0 * r))
    return join([hull, frame, _axles([front + 0.6 * cab, length / 2 - 1.4 * r], width, r)])


def _trailer(length: float, width: float, height: float) -> MeshPart:
    """Return a box on a frame, wheels below its rear, an underrun bar."""
    x, rear, r = width / 2, length / 2, min(0.5, 0.16 * height)
    low = [(-x, -rear, 2.1 * r), (-0.95 * x, rear - 0.1, 0.8 * r)]
    high = [(x, rear, height), (0.95 * x, rear, 1.4 * r)]
    return boxes(low, high) + _axles([rear - 0.18 * length, rear - 0.18 * length - 2.1 * r], width, r)


def _truck(length: float, width: float, height: float) -> MeshPart:
    """Return a tractor, a box behind its cab, skirts and an underrun bar."""
    cab, x, rear, r = min(2.1, 0.4 * length) - length / 2, width / 2, length / 2, min(0.5, 0.16 * height)
    low = [(-x, cab + 0.15, 2.1 * r), (-0.9 * x, cab, r), (-0.95 * x, rear - 0.15, 0.8 * r)]
    high = [(x, rear, height), (0.9 * x, rear - 0.1, 2.1 * r), (0.95 * x, rear - 0.02, 2.1 * r)]
    return _tractor(length, width, height) + boxes(low, high)


def _bus(length: float, width: float, height: float) -> MeshPart:
    x, r = width / 2, min(0.5, 0.16 * height)
    hull = cuboid((-x, -length / 2, 0.6 * r), (x, length / 2, height), edge=0.12, steps=2)
    return hull + _axles([-0.28 * length, 0.25 * length], width, r)


ROAD_USERS: MappingProxyType[str, Callable[[float, float, float], MeshPart]] = MappingProxyType(
    {
        **{"pedestrian": _person, "bicycle": _bicycle, "motorcycle": _motorcycle, "bus": _bus},
        **{"truck": _truck, "tractor": _tractor, "trailer": _trailer},
    }
)
"""Functions that model each road user from length, width and height, metres; the result is then scaled to them."""
