"""Road users as a collection: cars, vans, trucks, buses, cyclists and pedestrians, metres, in several builds and poses.

    shapes.traffic.make("pedestrian", 7)        one member, a Mesh
    shapes.traffic.collection()                 six classes of 75, nothing built yet

Sizes are drawn from normal distributions, truncated at two standard deviations (`SIZES`, `STATURES`).
"""

import zlib
from collections.abc import Callable
from functools import partial
from types import MappingProxyType

import numpy as np

from zbuf_occlude.base.arrays import FloatArray, unit_vectors
from zbuf_occlude.base.errors import check_choice, check_int
from zbuf_occlude.base.provenance import MeshSource
from zbuf_occlude.geometry.colors import Material, SurfaceColors
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.meshes.collection import MeshCollection, MeshEntry
from zbuf_occlude.meshes.shapes import car
from zbuf_occlude.meshes.shapes.draw import Draw
from zbuf_occlude.meshes.shapes.families import MEMBERS, split_of
from zbuf_occlude.meshes.shapes.kit import MeshPart, boxes, cuboid, cylinder, join, pair, rod
from zbuf_occlude.meshes.shapes.people import cyclist, pedestrian
from zbuf_occlude.meshes.shapes.road_users import ROAD_USERS

VERSION = 2
"""Version of the shapes, raised with every change: an unfinished dataset of old shapes is then not resumed."""

SIZES = MappingProxyType(
    {
        "car": ((3.88, 1.63, 1.53), (0.12, 0.06, 0.07)),
        "van": ((5.07, 1.90, 2.21), (0.12, 0.06, 0.10)),
        "truck": ((10.14, 2.59, 3.25), (0.25, 0.03, 0.10)),
        "bus": ((11.19, 2.95, 3.47), (0.10, 0.03, 0.05)),
    }
)
"""Length, width and height of vehicles: the mean, metres, and the standard deviation as a fraction of the mean.

Means of car, van and truck are those of KITTI's training boxes, published by Frustum PointNets (Qi et al. 2018). Means
of the bus are those of nuScenes's boxes (v1.0-trainval), mirrors included. Deviations of the car are measured on 33
cars in nine of KITTI's sweeps; all others are assumed.
"""
STATURES = ((1.756, 0.069), (1.629, 0.064))
"""Stature of men and of women, mean and standard deviation, metres: ANSUR II (Gordon et al. 2014, NATICK/TR-15/007)."""
CHILDREN, CHILD = 0.1, (1.3, 0.12)
"""Share of pedestrians that are children, and their stature; assumed."""
GIRTH = (1.0, 0.1)
"""Mean and standard deviation of the factor `Body.girth`; assumed: about half the relative deviation of the weight in
ANSUR II (0.16), as the weight grows with the square of the girth."""


def normal(draw: Draw, mean: float, deviation: float) -> float:
    """Return a normal number within two standard deviations."""
    return mean + deviation * float(np.clip(draw.rng.normal(), -2.0, 2.0))


def stature_of(draw: Draw) -> float:
    """Return the stature of a man or a woman, each equally likely."""
    return normal(draw, *draw.pick(STATURES))


def fitted(part: MeshPart, sides: FloatArray) -> MeshPart:
    """Return a part scaled to a box (width, length, height), with the centre of its base at the origin."""
    low, high = part.points.min(axis=0), part.points.max(axis=0)
    foot = (low + high) / 2.0 * [1.0, 1.0, 0.0] + low * [0.0, 0.0, 1.0]
    return part.at(*-foot).scaled(*(sides / (high - low)))


def _sides(draw: Draw, label: str) -> tuple[float, float, float]:
    """Return a random length, width and height."""
    length, width, height = (normal(draw, mean, mean * share) for mean, share in zip(*SIZES[label], strict=True))
    return length, width, height


GLASS = (0.05, 1.0)
"""Range of the factor on the albedo by which windows scatter light back, its logarithm uniform over members: dark glass
mirrors light away and absorbs it, behind clear glass seats are seen. Fitted to the cars of four KITTI sweeps
(docs/real_drives.md)."""
BODY = Material((0.485, 0.485, 0.485), name="body")
"""Everything else: luminance 0.2, the typical albedo of objects in scans."""


def glass_of(draw: Draw) -> Material:
    """Return the material of a vehicle's windows."""
    low, high = GLASS
    return BODY._replace(name="glass", scattering=low * (high / low) ** draw.between(0.0, 1.0))


def _vehicle(draw: Draw, label: str) -> MeshPart:
    """Return a vehicle of a class in a random build, as large as a random box."""
    length, width, height = _sides(draw, label)
    part = draw.pick(_BUILDS[label])(draw, length, width, height)
    return fitted(part, np.array([width, length, height]))


def _articulated(draw: Draw, length: float, width: float, height: float) -> MeshPart:
    """Return a tractor and its trailer, or a box truck where there is no room for them."""
    if length < 10.0:
        return _box_truck(draw, length, width, height)
    tractor = _tractor(5.5, width, height)
    trailer = ROAD_USERS["trailer"](length - 3.2, width, height)
    return tractor.at(y=2.75 - length / 2) + trailer.at(y=length / 2 - (length - 3.2) / 2)


def _drawbar(draw: Draw, length: float, width: float, height: float) -> MeshPart:
    """Return a box truck that pulls a trailer by a drawbar, or a box truck alone where there is no room."""
    if length < 12.0:
        return _box_truck(draw, length, width, height)
    gap, own = draw.between(1.0, 1.6), draw.between(0.5, 0.58) * length
    long = length - own - gap
    x, y, rear, r = width / 2, own - length / 2, length / 2, min(0.5, 0.16 * height)
    axles = cylinder(r, -0.15, 0.15, draw.round(20)).turned("y", 90)
    parts = [
        _box_truck(draw, own, width, height).at(y=(own - length) / 2),
        boxes((-x, y + gap, 2.1 * r), (x, rear, draw.between(0.9, 1.0) * height)),
        rod((0, y - 0.3, 1.4 * r), (0, y + gap + 0.3, 1.4 * r), 0.06, 6),
    ]
    for along in (0.2, 0.8):
        parts.append(pair(axles.at(x - 0.17, y + gap + along * long, r)))
    return join(parts)


def _windows(width: float, front: float, cab: float, top: float) -> MeshPart:
    """Return the panes of a cab that is `width` wide and begins at y = `front`."""
    x = 0.48 * width
    screen = boxes((-0.88 * x, front - 0.01, 0.58 * top), (0.88 * x, front + 0.03, 0.9 * top))
    side = boxes((x - 0.02, front + 0.12, 0.6 * top), (x + 0.01, front + 0.55 * cab, 0.88 * top))
    return (screen + pair(side)).glazed()


def _tractor(length: float, width: float, height: float) -> MeshPart:
    """Return a tractor with windows."""
    top = max(0.8 * height, min(height, 2.7))
    return ROAD_USERS["tractor"](length, width, height) + _windows(width, -length / 2, min(2.1, 0.4 * length), top)


def _tanker(draw: Draw, length: float, width: float, height: float) -> MeshPart:
    """Return a tractor with a tank behind its cab."""
    cab, r = min(2.1, 0.4 * length) - length / 2, min(0.5, 0.16 * height)
    radius = (height - 2.1 * r) / 2
    tank = cylinder(radius, cab + 0.3, length / 2, draw.round(24)).turned("x", -90).scaled(x=0.5 * width / radius)
    return _tractor(length, width, height) + tank.at(z=2.1 * r + radius)


def _flatbed(draw: Draw, length: float, width: float, height: float) -> MeshPart:
    """Return a truck with an open bed, perhaps loaded."""
    cab, x, rear, r = min(2.1, 0.4 * length) - length / 2, width / 2, length / 2, min(0.5, 0.16 * height)
    board = 2.1 * r + draw.between(0.3, 0.6)
    low = [
        (-x, cab + 0.15, 2.0 * r),
        (-x, cab + 0.15, 2.0 * r),
        (x - 0.05, cab + 0.15, 2.0 * r),
        (-x, rear - 0.05, 2.0 * r),
    ]
    high = [(x, rear, 2.1 * r), (0.05 - x, rear, board), (x, rear, board), (x, rear, board)]
    parts = [_tractor(length, width, height), boxes(low, high)]
    parts.append(boxes((-x, cab + 0.15, 2.0 * r), (x, cab + 0.25, height)))  # the wall behind the cab
    for _ in range(draw.whole(0, 3)):
        y, half = draw.between(cab + 1.2, rear - 0.9), draw.between(0.3, 0.8)
        parts.append(cuboid((-0.7 * x, y - half, 2.1 * r), (0.7 * x, y + half, draw.between(1.1 * board, height))))
    return join(parts)


def _box_truck(draw: Draw, length: float, width: float, height: float) -> MeshPart:
    top = max(0.8 * height, min(height, 2.7))
    return ROAD_USERS["truck"](length, width, height) + _windows(width, -length / 2, min(2.1, 0.4 * length), top)


def _bus(draw: Draw, length: float, width: float, height: float) -> MeshPart:
    """Return a city bus or a coach with windows and mirrors, and one or two air conditioners on its roof."""
    body, x = ROAD_USERS["bus"](length, 0.86 * width, 0.93 * height), 0.43 * width
    mirror = cuboid((x, -length / 2 - 0.2, 0.6 * height), (width / 2, -length / 2 - 0.05, 0.75 * height), edge=0.03)
    parts = [
        body,
        pair(mirror + boxes((0.9 * x, -length / 2 - 0.15, 0.74 * height), (width / 2, -length / 2, 0.76 * height))),
    ]
    sill, head = draw.pick(((0.36, 0.72), (0.5, 0.8)))  # of a city bus, of a coach
    ends = np.linspace(0.04 - 0.5, 0.5 - 0.04, draw.whole(5, 9)) * length
    low = np.array([(x - 0.03, y + 0.06, sill * height) for y in ends[:-1]])
    panes = [pair(boxes(low, [(x + 0.01, y - 0.06, head * height) for y in ends[1:]]))]
    panes.append(boxes((-0.9 * x, -length / 2 - 0.01, 0.3 * height), (0.9 * x, 0.03 - length / 2, 0.8 * height)))
    if draw.chance(0.6):
        panes.append(boxes((-0.8 * x, length / 2 - 0.03, 0.55 * height), (0.8 * x, length / 2 + 0.01, 0.8 * height)))
    parts.append(join(panes).glazed())
    for _ in range(draw.whole(1, 2)):
        y, long = draw.between(-0.35, 0.2) * length, draw.between(1.2, 2.6)
        parts.append(cuboid((-0.6 * x, y, 0.92 * height), (0.6 * x, y + long, height), edge=0.05))
    return join(parts)


def _of_style(style: Callable[[Draw], MeshPart], draw: Draw, length: float, width: float, height: float) -> MeshPart:
    return style(draw)


def _panel_van(draw: Draw, length: float, width: float, height: float) -> MeshPart:
    """Return a van whose windscreen is its only window."""
    part = car.van(draw)
    a, b, c = part.points[part.faces].transpose(1, 0, 2)
    forward = np.abs(unit_vectors(np.cross(b - a, c - a))[:, 1]) > 0.3
    ahead = part.points[part.faces][:, :, 1].mean(axis=1) < 0.0
    return MeshPart(part.points, part.faces, np.asarray(part.glass) & forward & ahead)


_BUILDS: dict[str, tuple[Callable[..., MeshPart], ...]] = {
    "car": tuple(partial(_of_style, style) for style in car.EVERYDAY),
    "van": (partial(_of_style, car.van), _panel_van),
    "truck": (_box_truck, _box_truck, _articulated, _drawbar, _tanker, _flatbed),
    "bus": (_bus,),
}


def _pedestrian(draw: Draw) -> MeshPart:
    stature = normal(draw, *CHILD) if draw.chance(CHILDREN) else stature_of(draw)
    return pedestrian(draw, stature, normal(draw, *GIRTH))


def _cyclist(draw: Draw) -> MeshPart:
    return cyclist(draw, stature_of(draw), normal(draw, *GIRTH))


MAKERS: MappingProxyType[str, Callable[[Draw], MeshPart]] = MappingProxyType(
    {
        "bus": partial(_vehicle, label="bus"),
        "car": partial(_vehicle, label="car"),
        "cyclist": _cyclist,
        "pedestrian": _pedestrian,
        "truck": partial(_vehicle, label="truck"),
        "van": partial(_vehicle, label="van"),
    }
)
"""Function that models a member, by class."""
CLASSES = tuple(MAKERS)


def make(label: str, index: int, seed: int = 0) -> Mesh:
    """Return one road user.

    Parameters
    ----------
    label : str
        One of `CLASSES`.
    index : int
        Number of the member, from 0. The first `MEMBERS` are those of `collection`; there is no limit.
    seed : int
        Seed of the road users; another one gives others of the same kind.

    Returns
    -------
    Mesh
        Metres, z up, front towards -y, the lowest point at z = 0. Cleaned.

    Raises
    ------
    OptionError
        An unknown label, a negative index or seed.

    Examples
    --------
    >>> from zbuf_occlude.meshes import shapes
    >>> 1.0 < shapes.traffic.make("pedestrian", 0).longest_side < 2.0
    True
    """
    check_choice("label", label, CLASSES)
    check_int("index", index, 0)
    check_int("seed", seed, 0)
    number = zlib.crc32(f"road-users/{label}".encode())
    draw = Draw(np.random.default_rng(np.random.SeedSequence([seed, number, index])))
    part = MAKERS[label](draw)
    low, high = part.points.min(axis=0), part.points.max(axis=0)
    # single precision, as in files; it also makes the last bits equal on all processors
    points = (part.points - [*((low + high) / 2)[:2], low[2]]).astype(np.float32).astype(np.float64)
    colors = None if part.glass is None else SurfaceColors((BODY, glass_of(draw)), part.glass.astype(np.int32))
    name, origin = f"{label}_{index:04d}", _origin(label, index, seed)
    return Mesh(points, part.faces, name=name, origin=origin, colors=colors).cleaned()


def collection(*, n_members: int = MEMBERS, seed: int = 0) -> MeshCollection:
    """Return road users as a collection, `n_members` of each class, with the splits of the families.

    Raises
    ------
    OptionError
        `n_members` is less than 1, or the seed negative.
    """
    check_int("n_members", n_members, 1)
    check_int("seed", seed, 0)
    root = "road-users" if seed == 0 else f"road-users-{seed}"
    return MeshCollection(
        MeshEntry(
            f"{root}/{label}/{split_of(index)}/{label}_{index:04d}",
            label,
            split_of(index),
            partial(make, label, index, seed),
            unit="m",
            origin=_origin(label, index, seed),
        )
        for label in CLASSES
        for index in range(n_members)
    )


def _origin(label: str, index: int, seed: int) -> MeshSource:
    return MeshSource.of_recipe("road user", VERSION, label, int(index), int(seed))
