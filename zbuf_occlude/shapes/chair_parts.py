"""What chairs are made of: backs, seats, arms, bases. Front towards -y, metres."""

import numpy as np

from zbuf_occlude.arrays import FloatArray
from zbuf_occlude.shapes.curves import bent, circle, cosd, rectangle, sind, smooth, superellipse
from zbuf_occlude.shapes.draw import Draw
from zbuf_occlude.shapes.furniture import four_legs, stretchers
from zbuf_occlude.shapes.kit import (
    MeshPart,
    along,
    around,
    bar,
    cuboid,
    cylinder,
    ellipsoid,
    join,
    loft,
    pair,
    pillow,
    prism,
    repeated,
    revolve,
    rod,
    shell,
    tube,
)

BACKS = ("panel", "slats", "ladder", "splat", "cross", "frame", "oval", "cushion")


# ---- backs: built upright in the xz plane with the seat at z = 0, then leaned and moved --------------------------


def curved(part: MeshPart, width: float, depth: float) -> MeshPart:
    """Bend a back in plan so that its sides come forward by `depth`."""
    points = part.points.copy()
    points[:, 1] -= depth * (2 * points[:, 0] / width) ** 2
    return part.warped(points)


def rail(width: float, z: float, height: float, thick: float, n: int, arch: float = 0.0) -> MeshPart:
    """Return a horizontal board with stations enough to be bent, arched upwards in its middle."""
    x = np.linspace(-width / 2, width / 2, n)
    rise = arch * (1 - (2 * x / width) ** 2)
    net = np.zeros((2, n, 3))
    net[..., 0] = x
    net[0, :, 2], net[1, :, 2] = z + 0.3 * rise, z + height + rise
    return shell(net, thick)


def placed(back: MeshPart, depth: float, z: float, lean: float) -> MeshPart:
    """Lean a back by degrees and stand it on the rear edge of a seat at height z."""
    return back.turned("x", -lean).at(0, depth / 2 - 0.015, z)


def back(draw: Draw, kind: str, w: float, h: float) -> MeshPart:
    """Return a back of one of the kinds in `BACKS`, w wide and h high."""
    n, thick, post = draw.round(10), draw.between(0.012, 0.03), draw.between(0.025, 0.045)
    curve = draw.pick((0.0, draw.between(0.02, 0.09)))
    arch = draw.pick((0.0, 0.0, draw.between(0.02, 0.08)))
    if kind == "panel":
        low = draw.between(0.0, 0.35) * h
        stays = pair(cuboid((w * 0.3, -0.012, -0.02), (w * 0.36, 0.012, low + 0.05)))
        return curved(rail(w, low, h - low, thick, n, arch) + stays, w, curve)
    if kind in ("slats", "splat", "cross"):
        top, low = draw.between(0.05, 0.12), draw.between(0.0, 0.3) * h
        parts = [_posts(draw, w, h - top / 2, post), rail(w + post, h - top, top, thick * 1.2, n, arch)]
        filling = {"slats": _slats, "splat": _splat, "cross": _cross}[kind](draw, w, low, h - top)
        return curved(join([*parts, rail(w, low, 0.04, thick, n), filling]), w, curve)
    if kind == "ladder":
        count = draw.whole(2, 5)
        high = draw.between(0.3, 0.8) * h / (count + 0.5)
        slats = [rail(w, z, high, thick, n, arch) for z in np.linspace(draw.between(0.1, 0.35) * h, h - high, count)]
        return curved(join([_posts(draw, w, h, post), *slats]), w, curve)
    if kind == "frame":
        outline = rectangle(w, h, draw.between(0.03, 0.3), draw.round(5))
        path = np.stack([outline[:, 0], np.zeros(len(outline)), outline[:, 1] + h / 2], axis=1)
        inner = np.stack([path * (0.97, 1, 1), path * (0.9, 1, 0.05) + [0, 0, 0.475 * h]])
        filling = loft(inner, caps="last") if draw.chance(0.5) else rail(w, 0.25 * h, 0.65 * h, thick, n)
        return curved(tube(path, draw.between(0.01, 0.02), draw.round(8), closed=True) + filling, w, curve)
    if kind == "oval":
        a, tall = np.linspace(0, 360, draw.round(24), endpoint=False), draw.between(0.28, 0.42)
        path = np.stack([w / 2 * cosd(a), 0 * a, (1 - tall) * h + tall * h * sind(a)], axis=1)
        pad = ellipsoid((0, 0, (1 - tall) * h), (0.44 * w, 0.04, 0.9 * tall * h), draw.round(18))
        ring = tube(path, draw.between(0.015, 0.025), draw.round(8), closed=True)
        return ring + pad + pair(bar((0.25 * w, 0, -0.03), (0.3 * w, 0, (1 - 1.7 * tall) * h), 0.03, 0.03))
    high = h * draw.between(0.6, 0.9)
    pad = pillow((w, high, draw.between(0.08, 0.18)), draw.round(11), power=draw.between(3, 8))
    return pad.turned("x", 90).at(z=h - high / 2) + pair(cuboid((0.28 * w, 0, -0.05), (0.34 * w, 0.015, 0.6 * h)))


def _posts(draw: Draw, width: float, height: float, thick: float) -> MeshPart:
    if draw.chance(0.4):
        return pair(rod((width / 2, 0, -0.02), (width / 2, 0, height), thick / 2, draw.round(10)))
    return pair(bar((width / 2, 0, -0.02), (width / 2, 0, height), thick, thick, end=draw.between(0.6, 1.0)))


def _slats(draw: Draw, w: float, low: float, high: float) -> MeshPart:
    count = draw.whole(3, 9)
    half = draw.between(0.2, 0.75) * w / count / 2
    spots = np.linspace(-w / 2, w / 2, count + 2)[1:-1]
    return repeated(cuboid((-half, -0.006, low), (half, 0.006, high)), along("x", spots))


def _splat(draw: Draw, w: float, low: float, high: float) -> MeshPart:
    half = w * np.array([0.13, 0.1, 0.09, 0.15, 0.2, 0.19, 0.12, 0.12, 0.22]) * draw.between(0.7, 1.4)
    net = np.zeros((9, 3, 3))
    net[..., 0], net[..., 2] = half[:, None] * [-1, 0, 1], np.linspace(low, high + 0.01, 9)[:, None]
    return shell(net, draw.between(0.012, 0.03))


def _cross(draw: Draw, w: float, low: float, high: float) -> MeshPart:
    parts = [pair(bar((-w / 2, 0, low), (w / 2, 0, high), 0.03, 0.02))]
    if draw.chance(0.5):
        xz = 0.13 * w * circle(14)
        path = np.stack([xz[:, 0], np.zeros(14), xz[:, 1] + (low + high) / 2], axis=1)
        parts.append(tube(path, 0.012, 6, closed=True))
    return join(parts)


# ---- seats and arms ----------------------------------------------------------------------------------------------


def seat(draw: Draw, w: float, d: float, z: float) -> MeshPart:
    """Return a seat whose upper side is at height z."""
    kind = draw.pick(("board", "board", "cushion", "trapezoid", "slats", "soft", "round"))
    thick = draw.between(0.02, 0.05)
    if kind == "board":
        return cuboid((-w / 2, -d / 2, z - thick), (w / 2, d / 2, z), edge=draw.pick((0.0, 0.008)))
    if kind == "cushion":
        pad = pillow((w * 0.96, d * 0.96, draw.between(0.06, 0.14)), draw.round(11), power=6)
        return cuboid((-w / 2, -d / 2, z - 0.06), (w / 2, d / 2, z - 0.03)) + pad.at(z=z - 0.02)
    if kind == "slats":
        count = draw.whole(4, 9)
        slat = cuboid((-w / 2, 0, z - 0.02), (w / 2, 0.75 * d / count, z))
        runners = pair(cuboid((0.38 * w, -d / 2, z - 0.05), (0.44 * w, d / 2, z - 0.02)))
        return repeated(slat, along("y", np.linspace(-d / 2, d / 2, count + 1)[:-1])) + runners
    if kind == "soft":
        return cuboid((-w / 2, -d / 2, z - 2 * thick), (w / 2, d / 2, z), edge=thick * 0.9, steps=draw.whole(2, 4))
    outline = superellipse(draw.round(28), 2.2 if kind == "round" else 7.0) * (w / 2, d / 2)
    outline[:, 0] *= 1.0 - draw.between(0.05, 0.25) * (outline[:, 1] / d + 0.5)
    return prism(outline, z - thick, z, edge=thick * 0.3)


def arms(draw: Draw, w: float, d: float, z: float) -> MeshPart:
    """Return two armrests beside a seat at height z."""
    top, x = z + draw.between(0.16, 0.28), w / 2 + 0.01
    kind = draw.pick(("rest", "rest", "loop", "curve"))
    if kind == "rest":
        wide = draw.between(0.02, 0.05)
        rest = cuboid((x - wide, -0.45 * d, top), (x + wide, d / 2, top + 0.03), edge=draw.pick((0.0, 0.012)), steps=2)
        return pair(rest + bar((x, -0.35 * d, z - 0.05), (x, -0.35 * d, top), 0.03, 0.03))
    if kind == "loop":
        a, b = 0.4 * d, 0.45 * d
        path = bent([(x, -a, z - 0.04), (x, -b, top), (x, b, top), (x, a, z - 0.04)], 0.07)
        return pair(tube(path, draw.between(0.01, 0.02), draw.round(8)))
    knots = [(x, 0.5 * d, top + 0.05), (x + 0.04, 0, top), (x, -0.45 * d, top - 0.02), (x - 0.01, -0.4 * d, z)]
    return pair(tube(smooth(knots, draw.round(12)), draw.between(0.014, 0.022), draw.round(8)))


# ---- bases -------------------------------------------------------------------------------------------------------


def legs(draw: Draw, w: float, d: float, z: float) -> MeshPart:
    """Return four legs under a seat w by d at height z, perhaps with stretchers and an apron."""
    kind = draw.pick(("square", "tapered", "round", "conical", "turned", "cabriole"))
    thick, splay = draw.between(0.025, 0.06), draw.pick((0.0, 0.0, draw.between(4, 13)))
    x, y = w / 2 - thick * 0.6, d / 2 - thick * 0.6
    parts = [four_legs(draw, kind, x, y, z, thick, splay)]
    if draw.chance(0.5):
        level = draw.between(0.2, 0.5)
        spread = (1 - level) * z * sind(splay)
        parts.append(stretchers(draw, x + spread, y + spread, z * level, 0.022, draw.pick(("box", "H", "sides", "X"))))
    if draw.chance(0.5):
        parts.append(pair(cuboid((-x, y - 0.01, z - 0.07), (x, y + 0.01, z)), "y"))
    return join(parts)


def star(draw: Draw, z: float, reach: float) -> MeshPart:
    """Return a swivel base: a gas spring and a star of feet, with castors or without."""
    count, rise, castors = draw.pick((4, 5, 5, 5)), draw.between(0.05, 0.12), draw.chance(0.7)
    low = 0.065 if castors else 0.027
    arm = bar((0, 0, rise + 0.04), (reach, 0, low), draw.between(0.04, 0.07), 0.04, end=0.6)
    if castors:
        wheel = cylinder(0.028, -0.01, 0.01, draw.round(12)).turned("x", 90).at(reach, 0, 0.028)
        arm = join([arm, wheel.at(y=0.013), wheel.at(y=-0.013), rod((reach, 0, 0.03), (reach, 0, 0.06), 0.008, 6)])
    column = revolve([(0.035, rise - 0.02), (0.035, z * 0.5), (0.022, z * 0.5), (0.022, z)], draw.round(14))
    return around(arm, count, draw.between(0, 72)) + column + cylinder(0.09, z - 0.04, z, draw.round(12), 0.13)


def chair_pedestal(draw: Draw, z: float, reach: float) -> MeshPart:
    """Return one foot in the middle: a disc with a column, or a trumpet."""
    n = draw.round(24)
    if draw.chance(0.5):
        disc = cylinder(reach, 0, 0.02, n, reach * 0.93)
        return disc + cylinder(draw.between(0.02, 0.06), 0.01, z, draw.round(14))
    profile = smooth([(reach, 0), (reach * 0.95, 0.012), (0.07, 0.08), (0.035, z * 0.5), (0.06, z)], draw.round(14))
    return revolve(profile, n)


def wires(z: float) -> MeshPart:
    """Return a base of crossing wires under a shell at height z."""
    top, foot = 0.12, 0.22
    ends: list[tuple[FloatArray, FloatArray]] = [
        (np.array([top, a * top, z]), np.array([foot, b * foot, rise])) for a, b, rise in
        ((-1, -1, 0), (-1, 1, 0.2), (1, -1, 0.2), (1, 1, 0))
    ]  # fmt: skip
    ends.append((np.array([top, top, z]), np.array([-foot, foot, 0.12])))
    return pair(join(rod(a, b, 0.006, 6) for a, b in ends))
