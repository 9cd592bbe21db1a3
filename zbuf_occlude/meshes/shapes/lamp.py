"""Lamps: floor, desk, table, pendant, chandelier, street and more. Standing lamps on z = 0, metres."""

import numpy as np
from numpy.typing import ArrayLike

from zbuf_occlude.meshes.shapes.curves import bent, circle, cosd, polygon, rectangle, sind, smooth
from zbuf_occlude.meshes.shapes.draw import Draw
from zbuf_occlude.meshes.shapes.kit import (
    MeshPart,
    Point,
    around,
    bar,
    cuboid,
    cylinder,
    ellipsoid,
    join,
    pair,
    prism,
    revolve,
    rod,
    shell,
    tube,
)

SHADES = ("drum", "empire", "cone", "bell", "pleated", "square", "sides", "dome")


def lampshade(draw: Draw, r: float, h: float, kinds: tuple[str, ...] = SHADES) -> MeshPart:
    """Return an open shade of lower radius r and height h with bulb and spider, its lower rim at z = 0.

    A shade has no thickness; some are lined.
    """
    n, kind, k = draw.round(30), draw.pick(kinds), draw.between(0.85, 1.1)
    top = k * {"drum": 0.95, "empire": 0.6, "cone": 0.22, "pleated": 0.65, "square": 0.7, "sides": 0.6}.get(kind, 0.4)
    if kind == "bell":
        skin = revolve(smooth([(r, 0), (0.78 * r, 0.3 * h), (0.62 * r, 0.65 * h), (0.45 * r, h)], draw.round(12)), n)
    elif kind == "dome":
        angle = np.linspace(0, 84, draw.round(10))
        skin = revolve(np.column_stack([r * cosd(angle), h * sind(angle)]), n)
    elif kind == "pleated":
        folds = 4 * draw.round(12)
        wavy = circle(folds) * (1 + 0.035 * np.cos(np.arange(folds) * np.pi))[:, None]
        skin = revolve([(r, 0), (top * r, h)], folds, wavy)
    elif kind in ("square", "sides"):
        corners = 4 if kind == "square" else draw.pick((6, 8))
        skin = revolve([(r, 0), (0.5 * (1 + top) * r, 0.5 * h), (top * r, h)], 0, polygon(corners, 45, 3))
    else:
        skin = revolve([(r, 0), (top * r, h)], n)
        if draw.chance(0.5):
            skin = skin + revolve([(0.985 * r, 0.002), (0.985 * top * r, h - 0.002)], n)
    wide = min(0.035, 0.3 * r)
    bulb = ellipsoid((0, 0, 0.5 * h), (wide, wide, min(0.055, 0.25 * h)), draw.round(10))
    if kind == "dome":
        return join([skin, bulb, rod((0, 0, 0.5 * h), (0, 0, h), 0.01, 6)])
    arm = rod((0, 0, 0.85 * h), (0.9 * r * (0.15 + 0.85 * top), 0, 0.85 * h), 0.003, 5)
    return join([skin, bulb, around(arm, 3)])


def foot(draw: Draw, r: float) -> MeshPart:
    """Return the foot of a stand: a plate, a dome, a block, steps, three claws."""
    n, kind = draw.round(26), draw.pick(("plate", "dome", "block", "stepped", "claws"))
    if kind == "plate":
        return cylinder(r, 0, draw.between(0.01, 0.04), n, 0.97 * r)
    if kind == "dome":
        return revolve(smooth([(r, 0), (r, 0.012), (0.6 * r, 0.25 * r), (0.1 * r, 0.4 * r)], draw.round(10)), n)
    if kind == "block":
        return prism(rectangle(1.8 * r, 1.8 * r, 0.1 * r), 0, draw.between(0.02, 0.07))
    if kind == "stepped":
        return join(cylinder(r * k, 0.025 * i, 0.025 * (i + 1), n) for i, k in enumerate((1.0, 0.75, 0.5)))
    knots = [(0.01, 0, 0.5 * r), (0.5 * r, 0, 0.4 * r), (0.9 * r, 0, 0.05 * r), (1.1 * r, 0, 0.04 * r)]
    path = smooth(knots, draw.round(8))
    return around(tube(path, 0.09 * r, draw.round(7)), draw.pick((3, 4)))


def lamp_stand(draw: Draw, z0: float, z1: float, r: float) -> MeshPart:
    """Return a post from z0 to z1: plain, tapering, with knobs, turned, twisted, bamboo."""
    n, h, kind = draw.round(12), z1 - z0, draw.pick(("plain", "taper", "knobs", "turned", "twist", "bamboo"))
    if kind == "plain":
        return cylinder(r, z0, z1, n)
    if kind == "taper":
        return cylinder(draw.between(1.5, 3.5) * r, z0, z1, n, 0.7 * r)
    if kind == "twist":
        t, turn = np.linspace(0, 1, draw.round(40)), 360 * draw.between(2, 7)
        path = np.column_stack([1.2 * r * cosd(turn * t), 1.2 * r * sind(turn * t), z0 + h * t])
        return tube(path, 0.8 * r, 6) + tube(path * (-1, -1, 1), 0.8 * r, 6)
    if kind == "bamboo":
        z = np.linspace(z0, z1, draw.whole(5, 9))[:, None] + [-0.01, 0, 0.01]
        return revolve(np.column_stack([r * np.tile([1.0, 1.35, 1.0], len(z)), z.ravel()]), n)
    spots = np.sort(draw.rng.uniform(0.05, 0.95, size=draw.whole(1, 4)))
    if kind == "knobs":
        size = draw.between(1.8, 3.5) * r
        knobs = [ellipsoid((0, 0, z0 + h * s), (size, size, 0.8 * size), n) for s in spots]
        return join([cylinder(r, z0, z1, n), *knobs])
    z = np.linspace(0, 1, draw.round(36))
    beads = np.exp(-(((z[:, None] - spots) / 0.05) ** 2)).sum(axis=1)
    profile = r * (1 + draw.between(0.5, 1.2) * beads + 0.8 * np.exp(-(((z - 0.15) / 0.15) ** 2)))
    return revolve(np.column_stack([profile, z0 + h * z]), n)


def spot(draw: Draw, r: float, tilt: float) -> MeshPart:
    """Return a reflector, its socket at the origin, its opening downwards, turned by `tilt` degrees about x."""
    n, h, kind = draw.round(22), r * draw.between(0.9, 1.9), draw.pick(("cone", "bell", "can", "bowl"))
    angle = np.linspace(85, 0, 8)
    profiles: dict[str, ArrayLike] = {
        "cone": [(0.25 * r, 0.25 * h), (0.3 * r, 0), (r, -h)],
        "can": [(0.5 * r, 0.1 * h), (0.75 * r, 0), (0.75 * r, -1.3 * h)],
        "bell": smooth([(0.2 * r, 0.25 * h), (0.35 * r, 0), (0.8 * r, -0.45 * h), (r, -h)], 9),
        "bowl": np.column_stack([r * cosd(angle), h * 0.6 * sind(angle) - 0.5 * h]),
    }
    bulb = ellipsoid((0, 0, -0.5 * h), (0.35 * r, 0.35 * r, 0.4 * r), draw.round(10))
    return join([revolve(profiles[kind], n), bulb, cylinder(0.22 * r, 0, 0.4 * h, 8)]).turned("x", tilt)


def lantern(draw: Draw, r: float, h: float, sides: int) -> MeshPart:
    """Return bars, panes without thickness, a roof, a candle."""
    ring, flare = polygon(sides, 180 / sides), draw.between(0.75, 1.35)
    panes = revolve([(0.97 * r, 0.02), (0.97 * flare * r, 0.75 * h)], 0, ring)
    bars = [rod((r * x, r * y, 0), (flare * r * x, flare * r * y, 0.75 * h), 0.05 * r, 6) for x, y in ring]
    roof = revolve([(flare * r * 1.2, 0.74 * h), (flare * r * 0.6, 0.9 * h), (0.1 * r, h)], 0, ring)
    candle = cylinder(0.2 * r, 0.03 * h, 0.4 * h, draw.round(10))
    flame = ellipsoid((0, 0, 0.45 * h), (0.1 * r, 0.1 * r, 0.07 * h), 8)
    return join([panes, *bars, roof, prism(ring * r * 1.1, 0, 0.03 * h), candle, flame])


# ---- styles --------------------------------------------------------------------------------------------------------


def _floor(draw: Draw) -> MeshPart:
    """A post with a shade at the height of a person."""
    h, r = draw.between(1.1, 1.9), draw.between(0.009, 0.035)
    wide, high = draw.between(0.13, 0.36), draw.between(0.15, 0.5)
    parts = [foot(draw, draw.between(0.1, 0.24)), lamp_stand(draw, 0.01, h - 0.4 * high, r)]
    parts.append(lampshade(draw, wide, high).at(z=h - high))
    if draw.chance(0.3):  # a tray
        z = draw.between(0.3, 0.6) * h
        parts.append(cylinder(draw.between(0.15, 0.28), z, z + 0.02, draw.round(24)))
    if draw.chance(0.3):
        parts.append(rod((0.06, -0.02, h - high - 0.25), (0.06, -0.02, h - 0.5 * high), 0.002, 5))
    return join(parts)


def _table(draw: Draw) -> MeshPart:
    """A table lamp: a vase, a ball or a bottle with a shade."""
    r, h, n = draw.between(0.05, 0.17), draw.between(0.16, 0.48), draw.round(26)
    kind = draw.pick(("vase", "bottle", "ball", "stack", "block", "ginger", "urn", "column"))
    bodies = {
        "vase": [(0.5, 0), (0.6, 0.05), (1.0, 0.55), (0.6, 0.85), (0.2, 0.95), (0.15, 1)],
        "bottle": [(0.85, 0), (0.9, 0.06), (0.9, 0.5), (0.75, 0.6), (0.2, 0.75), (0.18, 1)],
        "ginger": [(0.6, 0), (0.75, 0.1), (1.05, 0.6), (0.9, 0.82), (0.4, 0.9), (0.42, 1)],
        "urn": [(0.7, 0), (0.7, 0.05), (0.2, 0.12), (0.2, 0.2), (0.7, 0.4), (0.95, 0.7), (0.5, 0.9), (0.2, 1)],
    }
    if kind in bodies:
        base = revolve(np.vstack([[(0, 0)], smooth(bodies[kind], draw.round(24)) * (r, h)]), n)
        if kind == "urn" and draw.chance(0.5):
            knots = [(0.6 * r, 0, 0.5 * h), (1.4 * r, 0, 0.65 * h), (1.2 * r, 0, 0.9 * h), (0.5 * r, 0, 0.88 * h)]
            base = base + pair(tube(smooth(knots, 10), 0.008, 6))
    elif kind == "ball":
        high = r * draw.between(0.7, 1.2)
        base, h = ellipsoid((0, 0, high + 0.02), (r, r, high), n) + cylinder(0.6 * r, 0, 0.025, n), 2 * high + 0.03
    elif kind == "stack":
        sizes = draw.rng.uniform(0.5, 1.0, size=draw.whole(2, 5)) * r * 1.2
        tops = np.cumsum(sizes * 1.7)
        base = join(ellipsoid((0, 0, t - 0.85 * s), (s, s, 0.9 * s), n) for s, t in zip(sizes, tops, strict=True))
        h = float(tops[-1])
    elif kind == "block":
        base = cuboid((-r, -0.6 * r, 0), (r, 0.6 * r, h * 0.9), edge=draw.pick((0.0, 0.01, 0.03)), steps=2)
        base = base.turned("z", draw.pick((0.0, 45.0)))
    else:
        base = foot(draw, 1.1 * r) + lamp_stand(draw, 0.02, h, draw.between(0.01, 0.04))
    wide, high = draw.between(1.1, 2.8) * max(r, 0.08), draw.between(0.11, 0.36)
    top = lampshade(draw, wide, high).at(z=h - draw.between(-0.06, 0.05))
    return join([base, cylinder(0.012, 0.8 * h, h + 0.5 * high, 8), top])


def _joint(at: Point, r: float, n: int) -> MeshPart:
    return cylinder(r, -r, r, n).turned("y", 90).at(*at)


def _desk(draw: Draw) -> MeshPart:
    """Two arms with joints and springs, and a reflector."""
    a, b, n, t = draw.between(0.22, 0.5), draw.between(0.2, 0.5), draw.round(8), draw.between(0.006, 0.013)
    rise, drop = draw.between(35, 115), draw.between(-20, 60)
    start = np.array([0.0, 0.0, 0.04])
    elbow = start + a * np.array([0, cosd(rise), sind(rise)])
    end = elbow + b * np.array([0, -cosd(drop), sind(drop)])
    clamp = cuboid((-0.03, -0.05, -0.06), (0.03, 0.03, 0.03))
    parts = [foot(draw, draw.between(0.07, 0.14)) if draw.chance(0.75) else clamp]
    parts += [_joint(at, r, n) for at, r in ((start, 0.018), (elbow, 0.016), (end, 0.014))]
    gap = draw.pick((0.0, 0.012, 0.018))
    one = rod(start, elbow, 0.6 * t if gap else t, n) + rod(elbow, end, 0.6 * t if gap else t, n)
    parts.append(pair(one.at(gap)) if gap else one)
    if gap and draw.chance(0.7):  # a spring
        s = np.linspace(0.05, 0.45, 60)[:, None]
        coil = start + s * (elbow - start) + 0.009 * np.hstack([cosd(s * 9000), sind(s * 9000), 0 * s])
        parts.append(tube(coil, 0.002, 5))
    return join([*parts, spot(draw, draw.between(0.05, 0.12), draw.between(-50, 20)).at(*end)])


def _gooseneck(draw: Draw) -> MeshPart:
    """A lamp with a bent neck: banker's, pharmacy and reading lamps, for a table or the floor."""
    small = draw.chance(0.65)
    h, r = draw.between(0.25, 0.65) if small else draw.between(1.0, 1.6), draw.between(0.005, 0.014)
    reach, fall = draw.between(0.1, 0.4), draw.between(0.0, 0.18)
    knots = [(0, 0, 0), (0, draw.between(-0.05, 0.1), 0.45 * h), (0, 0.02, 0.85 * h), (0, -0.4 * reach, h)]
    curve = smooth([*knots, (0, -reach, h - fall)], draw.round(26))
    x, y, z = curve[-1]
    parts = [foot(draw, draw.between(0.07, 0.17)), tube(curve, r, draw.round(8))]
    if draw.chance(0.4):  # a banker's shade: half of a horizontal tube
        angle, w, k = np.linspace(-10, 190, draw.round(14)), draw.between(0.09, 0.2), draw.between(0.05, 0.08)
        net = np.empty((5, len(angle), 3))
        net[..., 0] = np.linspace(-w, w, 5)[:, None]
        net[..., 1], net[..., 2] = k * cosd(angle), 0.85 * k * sind(angle)
        bulb = cylinder(0.018, -0.7 * w, 0.7 * w, 8).turned("y", 90)
        return join([*parts, shell(net, 0.004).at(x, y, z - 0.03), bulb.at(x, y, z - 0.02)])
    return join([*parts, spot(draw, draw.between(0.04, 0.13), draw.between(-60, 10)).at(x, y, z)])


def _arc(draw: Draw) -> MeshPart:
    """A large arc from a heavy foot."""
    h, reach, end = draw.between(1.3, 2.1), draw.between(0.5, 1.5), draw.between(0.65, 0.92)
    knots = [(0, 0, 0), (0.03, 0, 0.45 * h), (0.25 * reach, 0, 0.9 * h), (0.62 * reach, 0, h), (reach, 0, end * h)]
    curve, wide = smooth(knots, draw.round(26)), draw.between(0.1, 0.28)
    head = lampshade(draw, wide, wide * draw.between(0.5, 1.4), ("dome", "dome", "drum", "empire", "cone"))
    block = cylinder(draw.between(0.12, 0.24), 0, draw.between(0.03, 0.14), draw.round(24))
    drop = float(np.ptp(head.points[:, 2]))
    lamp = join([block, tube(curve, draw.between(0.01, 0.02), draw.round(8)), head.at(reach, 0, end * h - drop)])
    return lamp.turned("z", draw.pick((0, 180)))


def _torchiere(draw: Draw) -> MeshPart:
    """A bowl that shines upwards, sometimes with a reading arm."""
    h, wide, n, deep = draw.between(1.3, 2.0), draw.between(0.11, 0.32), draw.round(26), draw.between(0.05, 0.28)
    angle = np.linspace(-80, -5, draw.round(9))
    bowl = revolve(np.column_stack([wide * cosd(angle), h + deep * (1 + sind(angle))]), n)
    parts = [foot(draw, draw.between(0.1, 0.22)), lamp_stand(draw, 0.01, h + 0.02, draw.between(0.01, 0.03)), bowl]
    if draw.chance(0.5):
        z, k = draw.between(0.6, 1.3), draw.between(0.6, 1.6)
        arm = smooth([(0, 0, z), (0.1 * k, -0.1 * k, z + 0.12), (0.22 * k, -0.22 * k, z + 0.1)], 10)
        parts += [tube(arm, 0.008, 6), spot(draw, draw.between(0.05, 0.1), -30).at(*arm[-1])]
    return join(parts)


def _tripod(draw: Draw) -> MeshPart:
    """Three legs, wood or pipe, under a shade or a studio light."""
    h, spread, t = draw.between(0.7, 1.45), draw.between(0.15, 0.45), draw.between(0.012, 0.03)
    wood, upper, lower = draw.chance(0.5), (0.03, 0, h), (spread, 0, 0)
    one = bar(upper, lower, t, t) if wood else rod(upper, lower, 0.6 * t, draw.round(10))
    parts = [around(one, draw.pick((3, 3, 4)), 90), cylinder(0.05, h - 0.03, h + 0.02, draw.round(14))]
    parts.append(cylinder(0.01, h, h + 0.15, 8))
    if draw.chance(0.3):
        z = draw.between(0.3, 0.6)
        parts.append(cylinder((1 - z) * spread, z * h, z * h + 0.015, draw.round(20)))
    if draw.chance(0.3):  # a studio light
        head = spot(draw, draw.between(0.12, 0.22), -draw.between(50, 100)).at(0, -0.05, h + 0.2)
        yoke = bent([(-0.15, 0, h + 0.2), (-0.15, 0, h + 0.05), (0.15, 0, h + 0.05), (0.15, 0, h + 0.2)], 0.04)
        return join([*parts, head, tube(yoke, 0.006, 6)])
    wide = draw.between(0.14, 0.34)
    kinds = ("drum", "drum", "empire", "bell", "square")
    return join([*parts, lampshade(draw, wide, wide * draw.between(0.6, 1.6), kinds).at(z=h + 0.03)])


def _pendant(draw: Draw) -> MeshPart:
    """A pendant lamp: a ceiling rose, a cord, and a shade, globe, saucer or cage."""
    wide, n = draw.between(0.1, 0.34), draw.round(26)
    drop, kind = wide * draw.between(0.8, 4.5), draw.pick(("shade", "dome", "globe", "cage", "saucer", "lantern"))
    parts = [cylinder(0.05, drop, drop + 0.025, draw.round(16)), rod((0, 0, 0), (0, 0, drop), 0.004, 6)]
    parts.append(cylinder(0.02, -0.06, 0.02, 10))
    if kind in ("shade", "dome"):
        high = wide * draw.between(0.5, 1.7)
        kinds = ("dome",) if kind == "dome" else ("drum", "empire", "cone", "bell", "pleated", "sides")
        parts.append(lampshade(draw, wide, high, kinds).at(z=-high))
    elif kind == "globe":
        parts.append(ellipsoid((0, 0, -wide), (wide, wide, wide * draw.between(0.5, 1.3)), n))
        if draw.chance(0.5):  # paper on rings
            for a in np.linspace(-70, 70, draw.whole(7, 12)):
                ring = np.column_stack([circle(24) * 1.01 * wide * cosd(a), np.full(24, wide * sind(a) - wide)])
                parts.append(tube(ring, 0.004, 5, closed=True))
    elif kind == "cage":
        tall = draw.between(1.1, 2.0) * wide
        knots = [(0.02, 0, 0), (wide, 0, -0.3 * tall), (0.7 * wide, 0, -0.85 * tall), (0.3 * wide, 0, -tall)]
        ring = np.column_stack([circle(20) * 0.97 * wide, np.full(20, -0.4 * tall)])
        parts += [around(tube(smooth(knots, 12), 0.005, 5), draw.whole(5, 12)), tube(ring, 0.005, 5, closed=True)]
        parts.append(ellipsoid((0, 0, -0.45 * tall), (0.3 * wide, 0.3 * wide, 0.28 * tall), n))
    elif kind == "saucer":
        k = draw.between(0.6, 1.5)
        rim = [(0.05, 0), (0.4 * wide, -0.1 * k), (1.6 * wide, -0.16 * k)]
        rim += [(1.5 * wide, -0.2 * k), (0.5 * wide, -0.24 * k), (0, -0.25 * k)]
        parts += [revolve(smooth(rim, 22), n), ellipsoid((0, 0, -0.24 * k), (0.4 * wide, 0.4 * wide, 0.1 * k), n)]
    else:
        high = wide * draw.between(1.2, 2.6)
        parts.append(lantern(draw, 0.7 * wide, high, draw.pick((4, 4, 6))).at(z=-high - 0.05))
    return join(parts)


def _chandelier(draw: Draw) -> MeshPart:
    """Arms with candles, shades or globes around a turned stem; on a chain or on a post."""
    count, reach = draw.whole(3, 9), draw.between(0.2, 0.6)
    knobs = [(0, -0.22), (0.03, -0.2), (0.015, -0.1), (0.06, -0.02), (0.02, 0.1), (0.05, 0.2), (0.012, 0.3)]
    stem = np.maximum(smooth(knobs, draw.round(24)), (0.0, -1.0)) * (draw.between(0.7, 1.6), 1)
    sag, end, n = draw.between(0.02, 0.25), draw.between(-0.1, 0.2), draw.round(12)
    knots = [(0.02, 0, 0), (0.4 * reach, 0, -sag), (0.85 * reach, 0, -0.3 * sag), (reach, 0, end)]
    arm = tube(smooth(knots, draw.round(12)), 0.008, draw.round(6))
    kind, k = draw.pick(("candle", "shade", "globe", "tulip")), draw.between(0.8, 1.6)
    if kind == "candle":
        flame = ellipsoid((0, 0, 0.11), (0.012, 0.012, 0.025), 8)
        light = join([cylinder(0.035, 0, 0.008, n), cylinder(0.011, 0, 0.09, 8), flame])
    elif kind == "shade":
        light = cylinder(0.011, 0, 0.06, 8) + revolve([(0.07, 0.03), (0.035, 0.13)], n)
    elif kind == "globe":
        light = ellipsoid((0, 0, 0.06), (0.06, 0.06, 0.06), n)
    else:
        light = revolve(smooth([(0.01, 0), (0.05, 0.03), (0.055, 0.07), (0.075, 0.1)], 8), n)
    light = light.scaled(k, k, k)
    parts = [revolve(stem, draw.round(14)), around(arm + light.at(reach, 0, end), count)]
    if draw.chance(0.35):
        upper = arm.scaled(0.6, 0.6, 0.6) + light.at(0.6 * reach, 0, 0.6 * end)
        parts.append(around(upper, max(3, count // 2), 180 / count).at(z=0.2))
    if draw.chance(0.3):
        h = draw.between(0.5, 1.5)
        post = lamp_stand(draw, 0.01, h - 0.1, 0.012)
        return join([*(part.at(z=h) for part in parts), post, foot(draw, draw.between(0.12, 0.2))])
    drop, links = draw.between(0.35, 0.9), 2 * draw.whole(4, 7)
    ring = np.column_stack([0.012 * circle(8)[:, 0], np.zeros(8), 0.02 * circle(8)[:, 1]])
    link = tube(ring, 0.003, 4, closed=True)
    chain = [link.turned("z", 90 * (i % 2)).at(z=0.3 + (drop - 0.3) * (i + 0.5) / links) for i in range(links)]
    return join([*parts, *chain, cylinder(0.06, drop, drop + 0.02, draw.round(14))])


def _glowing(draw: Draw) -> MeshPart:
    """A lamp that glows as a whole: mushroom, globe, paper column, lava, egg, lantern, panel."""
    n, kind = draw.round(28), draw.pick(("mushroom", "globe", "column", "lava", "egg", "lantern", "panel"))
    h, r = draw.between(0.2, 0.6), draw.between(0.08, 0.2)
    if kind == "mushroom":
        stem = smooth([(0.6 * r, 0), (0.35 * r, 0.4 * h), (0.4 * r, 0.75 * h)], 12)
        cap = [(0.4 * r, 0.62 * h), (1.4 * r, 0.58 * h), (1.35 * r, 0.75 * h), (0.8 * r, 0.95 * h), (0.0, h)]
        return revolve(np.vstack([[(0, 0)], stem]), n) + revolve(smooth(cap, draw.round(20)), n)
    if kind == "globe":
        ball = cylinder(0.6 * r, 0, 0.05, n, 0.5 * r) + ellipsoid((0, 0, r + 0.04), (r, r, r), n)
        if draw.chance(0.4):
            return ball + ellipsoid((0, 0, 2.5 * r), (0.7 * r,) * 3, n)
        return ball + cylinder(0.2 * r, 2 * r, 2.2 * r + 0.05, n)
    if kind == "column":
        tall, section, k = draw.between(0.5, 1.5), polygon(draw.pick((4, 6, 30)), 45), draw.between(0.7, 1.1)
        levels = np.linspace(0, 1, draw.whole(3, 7))
        ribs = [prism(section * r * 1.02 * (1 + (k - 1) * t), t * tall, t * tall + 0.012) for t in levels]
        return join([revolve([(r, 0.01), (r * k, tall)], 0, section), *ribs])
    if kind == "lava":
        steps = [(0, 0), (0.75, 0), (0.4, 0.25), (0.55, 0.3), (0.35, 0.85), (0.38, 0.86), (0.2, 1.05), (0, 1.05)]
        places, radii = draw.rng.uniform(0.4, 1.0, size=3), (0.25 * r, 0.25 * r, 0.06 * h)
        blobs = [ellipsoid((0, 0, z * h), radii, 10) for z in places]
        return join([revolve(np.array(steps) * (r, 1.3 * h), n), *blobs])
    if kind == "lantern":
        arc = smooth([(-0.8 * r, 0, 1.1 * h), (0, 0, 1.6 * h), (0.8 * r, 0, 1.1 * h)], 12)
        return lantern(draw, 0.9 * r, 1.3 * h, draw.pick((4, 6))) + tube(arc, 0.006, 6)
    if kind == "panel":
        w, tall = draw.between(0.1, 0.25), draw.between(0.3, 0.55)
        head = cuboid((-w, -0.015, -0.09), (w, 0.015, 0.09), edge=0.01).turned("x", draw.between(-70, -10))
        neck = tube(smooth([(0, 0, 0), (0, 0.06, 0.55 * tall), (0, -0.08, tall)], 14), 0.01, 8)
        return join([foot(draw, draw.between(0.08, 0.13)), neck, head.at(0, -0.1, tall)])
    knots = [(0.0, 0), (0.6 * r, 0.02), (r, draw.between(0.25, 0.55) * h), (0.75 * r, 0.75 * h), (0, h)]
    egg = np.maximum(smooth(knots, draw.round(24)), (0.0, -1.0))
    return revolve(egg, n) + cylinder(0.5 * r, -0.03, 0.03, n)


def _street(draw: Draw) -> MeshPart:
    """A street lamp: a mast with one or two arms, or a garden post with a lantern or globes."""
    h, kind, k = draw.between(2.0, 4.5), draw.pick(("arm", "lantern", "globes", "arm")), draw.between(0.7, 1.4)
    base = revolve(np.array([(0.16, 0), (0.16, 0.25), (0.09, 0.35), (0.08, 0.6)]) * k, draw.round(14))
    parts = [base, cylinder(0.07 * k, 0.3 * k, h, draw.round(12), 0.045 * k)]
    if kind == "arm":
        reach, rise = draw.between(0.4, 1.8), draw.between(0.1, 0.7)
        knots = [(0, 0, h - 0.1), (0.08, 0, h + 0.3 * rise), (0.4 * reach, 0, h + 0.85 * rise), (reach, 0, h + rise)]
        low, high = (reach - 0.1, -0.13, h + rise - 0.1), (reach + 0.5, 0.13, h + rise + 0.05)
        one = tube(smooth(knots, 14), 0.035, draw.round(8)) + cuboid(low, high, edge=0.06, steps=draw.whole(1, 3))
        return join([*parts, pair(one) if draw.chance(0.4) else one])
    if kind == "lantern":
        light = lantern(draw, draw.between(0.16, 0.36), draw.between(0.4, 0.9), draw.pick((4, 6)))
        return join([*parts, light.at(z=h)])
    r, x = draw.between(0.13, 0.28), draw.between(0.35, 0.6)
    curve = smooth([(0, 0, h - 0.5), (0.7 * x, 0, h - 0.55), (x, 0, h - 0.3)], 10)
    one = tube(curve, 0.025, 6) + ellipsoid((x, 0, h - 0.3 + r), (r, r, r), draw.round(16))
    return join([*parts, around(one, draw.whole(2, 5)), ellipsoid((0, 0, h + r), (r, r, r), draw.round(16))])


def _sconce(draw: Draw) -> MeshPart:
    """A wall lamp at y = 0: a plate, one or two arms, a shade; or several spots on a rail."""
    if draw.chance(0.5):
        wide, r = draw.between(0.4, 1.2), draw.between(0.045, 0.09)
        rail = cuboid((-wide / 2 - 0.06, -0.02, 0), (wide / 2 + 0.06, 0.02, 0.03), edge=0.005)
        parts = [rail]
        for x in np.linspace(-wide / 2, wide / 2, draw.whole(2, 5)):
            head = spot(draw, r, draw.between(-60, 30)).turned("z", draw.between(-40, 40))
            parts += [head.at(x, 0, -0.08), rod((x, 0, -0.06), (x, 0, 0.01), 0.008, 6)]
        return join(parts)
    plate = prism(rectangle(0.1, draw.between(0.08, 0.35), 0.04, draw.round(4)), 0, 0.02).turned("x", 90)
    out, up, wide = draw.between(0.08, 0.3), draw.between(-0.05, 0.16), draw.between(0.06, 0.16)
    knots = [(0, 0, 0), (0, -0.5 * out, -0.08), (0, -out, up - 0.08), (0, -out, up)]
    arm = tube(smooth(knots, draw.round(14)), 0.009, draw.round(8))
    cup = cylinder(0.03, up - 0.01, up, draw.round(12)).at(0, -out)
    light = join([arm, lampshade(draw, wide, wide * draw.between(0.8, 2.0)).at(0, -out, up), cup])
    return plate + (light if draw.chance(0.5) else light.turned("z", 32) + light.turned("z", -32))


STYLES = (
    _floor, _table, _desk, _pendant, _table, _gooseneck, _floor, _chandelier, _glowing, _table, _tripod, _arc,
    _torchiere, _pendant, _street, _sconce,
)  # fmt: skip
