"""Chairs: dining, office, lounge, cantilever, shell, Windsor, stools and more. Front towards -y, metres."""

import numpy as np

from zbuf_occlude.base.arrays import FloatArray
from zbuf_occlude.meshes.shapes.curves import bent, circle, cosd, rectangle, sind, smooth, superellipse
from zbuf_occlude.meshes.shapes.draw import Draw
from zbuf_occlude.meshes.shapes.furniture import four_legs, leg, splayed, stretchers
from zbuf_occlude.meshes.shapes.kit import (
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
    quad_grid,
    repeated,
    revolve,
    rod,
    shell,
    tube,
)

BACKS = ("panel", "slats", "ladder", "splat", "cross", "frame", "oval", "cushion")


# ---- backs: upright in the xz plane with the seat at z = 0, later leaned and moved --------------------------------


def curved(part: MeshPart, width: float, depth: float) -> MeshPart:
    """Return a back bent in plan: its sides come forward by `depth`."""
    points = part.points.copy()
    points[:, 1] -= depth * (2 * points[:, 0] / width) ** 2
    return part.warped(points)


def rail(width: float, z: float, height: float, thick: float, n: int, arch: float = 0.0) -> MeshPart:
    """Return a horizontal board that is arched upwards in its middle, with enough segments to be bent."""
    x = np.linspace(-width / 2, width / 2, n)
    rise = arch * (1 - (2 * x / width) ** 2)
    net = np.zeros((2, n, 3))
    net[..., 0] = x
    net[0, :, 2], net[1, :, 2] = z + 0.3 * rise, z + height + rise
    return shell(net, thick)


def placed(back: MeshPart, depth: float, z: float, lean: float) -> MeshPart:
    """Return a back leaned by degrees, on the rear edge of a seat at height z."""
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
    """Return a swivel base: a gas spring and a star of feet, with or without castors."""
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


# ---- styles --------------------------------------------------------------------------------------------------------


def _dining(draw: Draw, kinds: tuple[str, ...] = BACKS) -> MeshPart:
    w, d, z = draw.between(0.36, 0.58), draw.between(0.36, 0.52), draw.between(0.4, 0.52)
    behind = back(draw, draw.pick(kinds), w * draw.between(0.85, 1.0), draw.between(0.28, 0.78))
    parts = [seat(draw, w, d, z), placed(behind, d, z - 0.02, draw.between(1, 16)), legs(draw, w, d, z - 0.02)]
    if draw.chance(0.35):
        parts.append(arms(draw, w, d, z))
    return join(parts)


def _slatted(draw: Draw) -> MeshPart:
    return _dining(draw, ("slats", "ladder", "cross"))


def _office(draw: Draw) -> MeshPart:
    """An office chair on a swivel base, with its back on a spine."""
    w, d, z, h = draw.between(0.4, 0.6), draw.between(0.4, 0.56), draw.between(0.4, 0.6), draw.between(0.25, 0.85)
    thick, soft = draw.between(0.05, 0.12), draw.whole(2, 4)
    kind = draw.pick(("soft", "soft", "frame", "oval", "panel"))
    if kind == "soft":
        wide = draw.between(0.36, 0.48) * w
        behind = cuboid((-wide, -0.035, 0), (wide, 0.035, h), edge=0.03, steps=soft)
        if draw.chance(0.5):
            rest = cuboid((-0.14, -0.03, h + 0.04), (0.14, 0.03, h + 0.18), edge=0.028, steps=2)
            behind = behind + rest + pair(rod((0.05, 0, h - 0.05), (0.05, 0, h + 0.1), 0.008, 6))
    else:
        behind = curved(back(draw, kind, w * draw.between(0.75, 1.0), h), w, 0.05)
    gap, rear = draw.between(0.02, 0.22), d / 2 + 0.07
    spine = bent([(0, 0, z - 0.06), (0, rear, z - 0.06), (0, rear + 0.03, z + gap + 0.15)], 0.08)
    cushion = cuboid((-w / 2, -d / 2, z - thick), (w / 2, d / 2, z), edge=0.45 * thick, steps=soft)
    parts = [cushion, tube(spine, 0.018, 8)]
    parts.append(placed(behind, d + 0.06, z + gap, draw.between(2, 18)))
    under = z - 0.08
    has_star = draw.chance(0.85)
    parts.append(star(draw, under, draw.between(0.22, 0.38)) if has_star else chair_pedestal(draw, under, 0.26))
    if draw.chance(0.35):
        parts.append(arms(draw, w + 0.06, d, z))
    elif draw.chance(0.55):
        x, top = w / 2 + 0.04, z + draw.between(0.14, 0.26)
        rest = cuboid((x - 0.035, -0.14, top), (x + 0.035, 0.12, top + 0.03), edge=0.012, steps=2)
        foot = bar((x - 0.1, 0, z - 0.06), (x, 0, z - 0.04), 0.05, 0.02)
        parts.append(pair(rest + foot + bar((x, 0, z - 0.05), (x, 0, top), 0.02, 0.05)))
    return join(parts)


def _armchair(draw: Draw) -> MeshPart:
    """An upholstered chair on a plinth or short legs, sometimes with wings."""
    w, d, z = draw.between(0.55, 0.95), draw.between(0.55, 0.9), draw.between(0.34, 0.48)
    arm, h, foot = draw.between(0.07, 0.2), draw.between(0.3, 0.85), draw.between(0.02, 0.2)
    s, lift, soft = draw.whole(2, 4), draw.between(0.1, 0.28), draw.between(0.02, 0.06)
    x, y = w / 2, d / 2
    parts = [cuboid((-x, -y, foot), (x, y, z - 0.12), edge=0.02, steps=s)]
    parts.append(cuboid((arm - x, -y - 0.03, z - 0.14), (x - arm, y - 0.15, z), edge=soft, steps=s))
    behind = cuboid((0.6 * arm - x, -0.09, 0), (x - 0.6 * arm, 0.09, h), edge=soft, steps=s)
    parts.append(behind.turned("x", -draw.between(2, 18)).at(0, y - 0.08, z - 0.08))
    if draw.chance(0.4):  # rolled arms
        roll = cylinder(arm * 0.62, -y, y - 0.08, draw.round(16)).turned("x", 90).at(z=z + lift)
        wall = cuboid((-0.4 * arm, 0.02 - y, foot), (0.4 * arm, y, z + lift))
        parts.append(pair((wall + roll).at(x - arm / 2)))
    else:
        parts.append(pair(cuboid((x - arm, -y, foot), (x, y, z + lift), edge=min(soft, arm / 3), steps=s)))
    if h > 0.55 and draw.chance(0.7):
        low, high = (x - arm, y - 0.3, z + lift - 0.05), (x - 0.45 * arm, y + 0.02, z + h - 0.1)
        parts.append(pair(cuboid(low, high, edge=0.03, steps=s)))
    if draw.chance(0.35):
        parts.append(pillow((0.36, 0.36, 0.14), draw.round(11)).turned("x", 70).at(0, y - 0.28, z + 0.16))
    if foot > 0.04:
        kind = draw.pick(("tapered", "conical", "turned", "square"))
        parts.append(four_legs(draw, kind, w * 0.42, d * 0.42, foot + 0.02, 0.05))
    return join(parts)


def _tub(draw: Draw) -> MeshPart:
    """A tub chair: one wall around a round seat."""
    r, z, h, n = draw.between(0.28, 0.45), draw.between(0.34, 0.46), draw.between(0.15, 0.55), draw.round(24)
    gap, drop, power = draw.between(35, 85), draw.between(0.0, 0.6), draw.between(2.0, 5.0)
    angle, t = np.linspace(-90 + gap, 270 - gap, n), np.linspace(0, 1, 5)[:, None]
    top = z + h * (1 - drop * np.abs(angle - 90) / (180 - gap))
    low = draw.pick((0.06, z - 0.14))
    reach = r * (1 + draw.between(0.0, 0.35) * t)
    reach = reach / (np.abs(cosd(angle)) ** power + np.abs(sind(angle)) ** power) ** (1 / power)
    net = np.stack([reach * cosd(angle), reach * sind(angle), low + t * (top - low)], axis=2)
    outline, under = superellipse(n, power), z - 0.1
    parts = [shell(net, draw.between(0.03, 0.14)), prism(outline * r * 0.97, z - 0.14, z, edge=0.03)]
    if low < 0.1:
        parts.append(prism(outline * r * 0.9, draw.pick((0.0, 0.04)), under))
        if draw.chance(0.6):
            parts.append(four_legs(draw, "tapered", r * 0.6, r * 0.6, 0.08, 0.05))
    elif draw.chance(0.6):
        parts.append(legs(draw, 1.5 * r, 1.5 * r, under))
    else:
        parts.append(star(draw, under, r * 0.9) if draw.chance(0.5) else chair_pedestal(draw, under, r * 0.75))
    return join(parts)


def _cantilever(draw: Draw) -> MeshPart:
    """A cantilever chair: one bent pipe for legs and back, without rear legs."""
    w, d, z, h = draw.between(0.38, 0.6), draw.between(0.4, 0.56), draw.between(0.38, 0.5), draw.between(0.25, 0.6)
    r, n, x, y, lean = draw.between(0.009, 0.02), draw.round(8), w / 2, d / 2, draw.between(0.0, 0.2)
    kind, bow = draw.pick(("back", "arms", "sled")), draw.between(0.04, 0.14)
    side = [(x, y + lean, z + h), (x, y - 0.02, z), (x, -y, z), (x, 0.02 - y, r), (x, y, r)]
    parts = [rod((-x, y, r), (x, y, r), r, n)]
    if kind != "back":
        high = z + (draw.between(0.15, 0.25) if kind == "arms" else 0.0)
        side = [(x, y, high), (x, -y, high), (x, -y, r), (x, y, r)]
        parts.append(pair(bar((x, y, z - 0.05), (x, y + lean, z + h), 0.02, 0.02)))
    if kind == "sled":
        side.append((x, y, z))
    parts.append(pair(tube(bent(side, bow, draw.round(5)), r, n)))
    behind = back(draw, draw.pick(("panel", "panel", "cushion", "ladder")), w, h * draw.between(0.7, 1.0))
    parts.append(behind.turned("x", -float(np.degrees(np.arctan2(lean, h)))).at(0, y, z))
    parts.append(cuboid((-x, -y, z - 0.01), (x, y - 0.02, z + draw.between(0.015, 0.09)), edge=0.006, steps=2))
    return join(parts)


def _moulded(draw: Draw) -> MeshPart:
    """Seat and back in one shell, on any base."""
    w, d, z, h = draw.between(0.4, 0.66), draw.between(0.38, 0.54), draw.between(0.34, 0.48), draw.between(0.2, 0.7)
    n, lean = draw.round(13), draw.between(0.02, 0.22)
    knots = [(-d / 2 - 0.02, z - 0.03), (-d * 0.35, z), (d * 0.15, z - 0.03), (d * 0.45, z + 0.1)]
    spine = smooth([*knots, (d / 2 + 0.6 * lean, z + h * 0.7), (d / 2 + lean, z + h)], draw.round(20))
    bucket, pinch = draw.pick((0.03, 0.08, 0.15, 0.22, 0.3)), draw.between(0.0, 0.4)
    t, u = np.linspace(0, 1, len(spine)), np.linspace(-1, 1, n)
    half = w / 2 * (1 - pinch * np.exp(-(((t - 0.55) / 0.12) ** 2))) * (1 - 0.3 * np.clip((t - 0.8) / 0.2, 0, 1) ** 2)
    rim = bucket * np.abs(u) ** 2.4 * (np.sin(np.pi * np.clip(t * 1.05, 0, 1)) ** 0.7)[:, None]
    # the rim rises from the seat and comes forward from the back, along the normal of the shell
    slope = np.gradient(spine, axis=0)
    slope /= np.linalg.norm(slope, axis=1, keepdims=True)
    net = np.empty((len(spine), n, 3))
    net[..., 0] = half[:, None] * u
    net[..., 1] = spine[:, :1] - rim * slope[:, 1:]
    net[..., 2] = spine[:, 1:] + rim * slope[:, :1]
    skin = quad_grid(net) if draw.chance(0.3) else shell(net, draw.between(0.006, 0.02))
    base, under = draw.pick(("legs", "wires", "star", "pedestal", "sled", "legs")), z - 0.02
    if base == "legs":
        one = leg(draw, draw.pick(("conical", "round", "tapered")), under, 0.035)
        front, rear = splayed(one, under, 10, -10).at(0.15, -0.15), splayed(one, under, 10, 10).at(0.15, 0.13)
        return skin + pair(front + rear)
    if base == "wires":
        return skin + wires(under)
    if base == "star":
        return skin + star(draw, under, draw.between(0.22, 0.34))
    if base == "pedestal":
        return skin + chair_pedestal(draw, under, draw.between(0.18, 0.3))
    path = bent([(0.12, -0.1, under), (0.2, -0.22, 0.01), (0.2, 0.22, 0.01), (0.12, 0.1, under)], 0.06)
    return skin + pair(tube(path, 0.009, draw.round(8)))


def _windsor(draw: Draw) -> MeshPart:
    """A Windsor chair: spindles under a bow, turned and splayed legs."""
    w, d, z, h = draw.between(0.4, 0.58), draw.between(0.38, 0.5), draw.between(0.4, 0.5), draw.between(0.3, 0.75)
    round_top, splay = draw.between(0.5, 1.0), draw.between(5, 15)
    angle = np.linspace(0, 180, draw.round(17))
    bow = np.stack([0.46 * w * cosd(angle), -0.04 * np.abs(cosd(angle)), h * sind(angle) ** round_top], axis=1)
    x = np.linspace(-0.36, 0.36, draw.whole(4, 9)) * w
    tops = h * np.sin(np.arccos(np.clip(x / (0.46 * w), -1, 1))) ** round_top
    spindles = [rod((0.8 * a, 0, 0), (a, 0, b), 0.006, 6, 0.005) for a, b in zip(x, tops, strict=True)]
    behind = join([tube(bow, 0.013, draw.round(8)), *spindles])
    outline = superellipse(draw.round(26), 2.6) * (w / 2, d / 2)
    parts = [prism(outline, z - 0.04, z, edge=0.012), placed(behind, d - 0.06, z - 0.01, draw.between(5, 20))]
    a, b, level = w * 0.32, d * 0.3, draw.between(0.3, 0.5)
    spread = (1 - level) * z * sind(splay)
    parts.append(four_legs(draw, draw.pick(("turned", "conical", "round")), a, b, z - 0.02, 0.045, splay))
    parts.append(stretchers(draw, a + spread, b + spread, z * level, 0.02, draw.pick(("H", "box"))))
    if draw.chance(0.4):
        ends = [(w * 0.54, -d * 0.3, z + 0.2), (w * 0.5, d * 0.25, z + 0.22)]
        mirrored = [(-p, q, s) for p, q, s in reversed(ends)]
        rest = smooth([*ends, (0, d * 0.56, z + 0.23), *mirrored], draw.round(18))
        parts.append(tube(rest, 0.016, 8, flat=0.7))
        parts.append(pair(rod((w * 0.45, -d * 0.25, z), (w * 0.53, -d * 0.27, z + 0.2), 0.01, 6)))
    return join(parts)


def _stool(draw: Draw) -> MeshPart:
    """A low or high stool, with a short back or none."""
    z, r, n = draw.pick((draw.between(0.38, 0.5), draw.between(0.6, 0.85))), draw.between(0.14, 0.24), draw.round(22)
    outline = rectangle(1.9 * r, 1.7 * r, 0.04) if draw.chance(0.4) else circle(n) * r
    parts = [prism(outline, z - draw.between(0.025, 0.1), z, edge=0.01)]
    base = draw.pick(("legs", "legs", "pedestal", "star"))
    if base == "legs":
        splay, x, level = draw.between(0, 12), r * 0.62, draw.between(0.2, 0.45)
        spread = x + (1 - level) * z * sind(splay)
        kind = draw.pick(("square", "round", "conical", "tapered"))
        parts.append(four_legs(draw, kind, x, x, z - 0.02, 0.035, splay))
        parts.append(stretchers(draw, spread, spread, level * z, 0.02, draw.pick(("box", "H", "sides"))))
    else:
        foot = chair_pedestal(draw, z - 0.02, r * 1.15) if base == "pedestal" else star(draw, z - 0.02, r * 1.4)
        parts.append(foot)
        if z > 0.58:
            path = np.column_stack([circle(n) * r * 0.85, np.full(n, 0.3 * z)])
            parts += [tube(path, 0.01, 6, closed=True), rod((-r * 0.85, 0, 0.3 * z), (r * 0.85, 0, 0.3 * z), 0.009, 6)]
    if draw.chance(0.6):
        behind = back(draw, draw.pick(("panel", "ladder", "frame")), 1.8 * r, draw.between(0.1, 0.36))
        parts.append(placed(behind, 1.8 * r, z - 0.02, draw.between(1, 14)))
    return join(parts)


def _rocking(draw: Draw) -> MeshPart:
    w, d, z = draw.between(0.42, 0.6), draw.between(0.42, 0.56), draw.between(0.38, 0.48)
    behind = back(draw, draw.pick(("slats", "ladder", "panel", "oval")), w * 0.94, draw.between(0.45, 0.85))
    y = np.linspace(-draw.between(0.4, 0.55), draw.between(0.45, 0.65), draw.round(12))
    path = np.stack([np.full(len(y), w / 2 - 0.02), y, draw.between(0.2, 0.45) * y**2 + 0.02], axis=1)
    rocker = tube(path, 0.02, draw.round(8), flat=0.6)
    feet = four_legs(draw, draw.pick(("turned", "round", "square")), w / 2 - 0.02, d / 2 - 0.03, z - 0.05, 0.04)
    parts = [seat(draw, w, d, z), placed(behind, d, z - 0.02, draw.between(10, 25)), pair(rocker), feet.at(z=0.03)]
    return join([*parts, arms(draw, w, d, z)]) if draw.chance(0.8) else join(parts)


def _folding(draw: Draw) -> MeshPart:
    """A folding chair with crossed legs; the long ones carry the back."""
    w, z, h, t = draw.between(0.36, 0.6), draw.between(0.36, 0.5), draw.between(0.22, 0.55), draw.between(0.018, 0.032)
    x, y, lean = w / 2, draw.between(0.16, 0.3), draw.between(0.02, 0.2)
    long = bar((x, -y, 0), (x, y + lean, z + h), t, t * 1.6)
    short = bar((x - 1.2 * t, y, 0), (x - 1.2 * t, -y, z), t, t * 1.6)
    parts = [pair(long + short), cuboid((-x, -y, 0.1), (x, 0.02 - y, 0.13))]
    parts.append(cuboid((-x, y - 0.04, 0.12), (x, y - 0.02, 0.15)))
    if draw.chance(0.5):  # canvas, sagging
        u, v = np.meshgrid(np.linspace(-1, 1, draw.round(9)), np.linspace(-1, 1, draw.round(9)), indexing="ij")
        sag = draw.between(0.02, 0.09) * (1 - u**2)
        parts.append(quad_grid(np.stack([x * u, (y + 0.02) * v, z - sag], axis=2)))
        parts.append(quad_grid(np.stack([x * u, y + 0.8 * lean + sag + 0.02 * v, z + h * (0.72 + 0.25 * v)], axis=2)))
    else:
        parts.append(seat(draw, w, 2 * y + 0.03, z + 0.02))
        angle = float(np.degrees(np.arctan2(2 * y + lean, z + h)))
        board = rail(w, 0, draw.between(0.08, 0.4) * h, 0.02, 9)
        parts.append(board.turned("x", -angle).at(0, y + 0.5 * lean, z + h * 0.55))
    if draw.chance(0.4):
        rest = cuboid((x - 0.03, -y - 0.02, z + 0.18), (x + 0.03, y + 0.04, z + 0.2))
        parts.append(pair(rest + bar((x, -y, z), (x, -y, z + 0.19), t, t)))
    return join(parts)


def _blocky(draw: Draw) -> MeshPart:
    """Boards and cubes: panel sides, thrones, bent plywood."""
    w, d, z, h = draw.between(0.42, 0.75), draw.between(0.42, 0.7), draw.between(0.32, 0.48), draw.between(0.25, 0.95)
    t, high, x, y = draw.between(0.02, 0.09), draw.pick((0.0, draw.between(0.12, 0.28))), w / 2, d / 2
    parts = [cuboid((-x, -y, z - t), (x, y, z)), pair(cuboid((x - t, -y, 0), (x, y, z + high)))]
    parts.append(cuboid((-x, 0, 0), (x, t, h + 0.02)).turned("x", -draw.between(0, 12)).at(0, y - t, z - t))
    if draw.chance(0.5):
        parts.append(cuboid((t - x, y - t, 0.02), (x - t, y, z)))
    if draw.chance(0.6):
        parts.append(pillow((w - 2 * t, d - t, draw.between(0.08, 0.2)), draw.round(11), power=7).at(z=z + 0.03))
    if h > 0.6:
        a, b = (x - t / 2, y, z), (x - t / 2, y + 0.04, z + h)
        parts.append(pair(bar(a, b, t, t) + ellipsoid((b[0], b[1], b[2] + t), (t, t, t), draw.round(10))))
    return join(parts)


STYLES = (
    _dining, _office, _armchair, _slatted, _moulded, _stool, _cantilever, _tub, _windsor, _dining, _office, _blocky,
    _folding, _rocking,
)  # fmt: skip
