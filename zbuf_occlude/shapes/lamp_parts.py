"""What lamps are made of: shades, feet, stands, reflectors, lanterns. Standing parts on z = 0, metres."""

import numpy as np
from numpy.typing import ArrayLike

from zbuf_occlude.shapes.curves import circle, cosd, polygon, rectangle, sind, smooth
from zbuf_occlude.shapes.draw import Draw
from zbuf_occlude.shapes.kit import (
    MeshPart,
    around,
    cylinder,
    ellipsoid,
    join,
    prism,
    revolve,
    rod,
    tube,
)

SHADES = ("drum", "empire", "coolie", "bell", "pleated", "square", "sides", "dome")


def lampshade(draw: Draw, r: float, h: float, kinds: tuple[str, ...] = SHADES) -> MeshPart:
    """Return an open shade of lower radius r and height h with bulb and spider, its lower rim at z = 0.

    Cloth has no thickness; some shades are lined.
    """
    n, kind, k = draw.round(30), draw.pick(kinds), draw.between(0.85, 1.1)
    top = k * {"drum": 0.95, "empire": 0.6, "coolie": 0.22, "pleated": 0.65, "square": 0.7, "sides": 0.6}.get(kind, 0.4)
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
    """Return what a stand stands on: a plate, a dome, a block, steps, three claws."""
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
