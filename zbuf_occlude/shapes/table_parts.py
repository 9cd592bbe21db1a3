"""What tables are made of: tops, aprons, pedestals. Long side along x, metres."""

import numpy as np

from zbuf_occlude.arrays import FloatArray
from zbuf_occlude.shapes.curves import circle, polygon, rectangle, smooth, superellipse
from zbuf_occlude.shapes.draw import Draw
from zbuf_occlude.shapes.furniture import four_legs, frame, stretchers
from zbuf_occlude.shapes.kit import (
    MeshPart,
    along,
    around,
    bar,
    cuboid,
    cylinder,
    join,
    pair,
    prism,
    quad_grid,
    repeated,
    revolve,
    tube,
)

LEGS = ("square", "tapered", "round", "conical", "turned", "cabriole")


def outline(draw: Draw, kind: str, w: float, d: float) -> FloatArray:
    """Return the plan of a table top, w by d: rectangle, rounded, ellipse, barrel, polygon or kidney."""
    n = draw.round(32)
    if kind == "rounded":
        return rectangle(w, d, draw.between(0.1, 0.45) * d, draw.round(6))
    if kind == "ellipse":
        return circle(n) * (w / 2, d / 2)
    if kind == "barrel":
        return superellipse(n, draw.between(2.6, 5.0)) * (w / 2, d / 2)
    if kind == "polygon":
        sides = draw.pick((6, 8))
        return polygon(sides, 180 / sides) * (w / 2, d / 2)
    if kind == "kidney":
        xy = circle(n) * (w / 2, d / 2)
        dent = draw.between(0.2, 0.5) * d * np.exp(-((xy[:, 0] / (0.3 * w)) ** 2))
        xy[:, 1] -= dent * (xy[:, 1] < 0) - dent * 0.5
        return xy
    return rectangle(w, d)


def top(draw: Draw, w: float, d: float, z: float, kinds: tuple[str, ...]) -> MeshPart:
    """Return a table top of one of some kinds, 2 to 6 cm thick, whose upper side is at z.

    Besides those of `outline` there are "planks" with gaps and "pane": a sheet without thickness in a frame.
    """
    thick, kind, x, y = draw.between(0.018, 0.065), draw.pick(kinds), w / 2, d / 2
    if kind == "planks":
        count = draw.whole(3, 8)
        plank = cuboid((-x, 0, z - thick), (x, d / count - draw.between(0.004, 0.025), z))
        battens = pair(cuboid((0.3 * w, -0.48 * d, z - thick - 0.03), (0.36 * w, 0.48 * d, z - thick)))
        return repeated(plank, along("y", np.linspace(-y, y, count + 1)[:-1])) + battens
    if kind == "pane":
        rail = draw.between(0.04, 0.12) * d
        rails = frame(w, d, rail, thick).turned("x", 90).at(0, y, z - thick / 2)
        across, deep = np.meshgrid((rail - x, x - rail), (rail - y, y - rail), indexing="ij")
        return rails + quad_grid(np.stack([across, deep, np.full((2, 2), z - thick / 3)], axis=2))
    if kind == "rectangle":
        return cuboid((-x, -y, z - thick), (x, y, z), edge=draw.pick((0.0, 0.006, thick / 3)), steps=2)
    return prism(outline(draw, kind, w, d), z - thick, z, edge=draw.pick((0.0, 0.25 * thick)))


def four_legged(draw: Draw, w: float, d: float, z: float, tops: tuple[str, ...], thick: float) -> MeshPart:
    """Return a top on four legs, with an apron and stretchers as it comes."""
    inset, splay = draw.between(0.6, 3.0) * thick, draw.pick((0.0, 0.0, 0.0, draw.between(3, 14)))
    x, y, t = w / 2 - inset, d / 2 - inset, 0.012
    parts = [top(draw, w, d, z, tops), four_legs(draw, draw.pick(LEGS), x, y, z - 0.02, thick, splay)]
    if draw.chance(0.6):
        low = z - 0.02 - draw.between(0.04, 0.18)
        parts.append(pair(cuboid((-x, y - t, low), (x, y + t, z - 0.02)), "y"))
        parts.append(pair(cuboid((x - t, -y, low), (x + t, y, z - 0.02))))
    if draw.chance(0.3) and splay == 0.0:
        plan = draw.pick(("H", "box", "X"))
        parts.append(stretchers(draw, x, y, draw.between(0.08, 0.35) * z, thick * 0.6, plan))
    return join(parts)


def table_pedestal(draw: Draw, w: float, z: float) -> MeshPart:
    """Return one foot for a round top of width w at height z."""
    n, kind = draw.round(26), draw.pick(("trumpet", "column", "turned", "cross", "drum", "hourglass"))
    if kind == "trumpet":
        foot, waist = draw.between(0.2, 0.38) * w, draw.between(0.02, 0.1)
        knots = [(foot, 0), (foot * 0.9, 0.015), (0.4 * foot + waist, 0.08)]
        knots += [(waist, 0.45 * z), (waist * 2, 0.9 * z), (0.2 * w, z)]
        return revolve(smooth(knots, draw.round(18)), n)
    if kind == "column":
        plate = cylinder(draw.between(0.22, 0.38) * w, 0, draw.between(0.015, 0.06), n)
        return join([plate, cylinder(draw.between(0.02, 0.1), 0, z, draw.round(16)), cylinder(0.2 * w, z - 0.03, z, n)])
    if kind == "drum":
        r = draw.between(0.12, 0.34) * w
        return cylinder(r, 0, z, n, r * draw.between(0.5, 1.4))
    if kind == "hourglass":
        a, b, waist = draw.between(0.25, 0.4) * w, draw.between(0.25, 0.4) * w, draw.between(0.06, 0.18) * w
        return revolve(smooth([(a, 0), (waist, 0.5 * z), (b, z)], draw.round(16)), n)
    reach = draw.between(0.3, 0.42) * w
    if kind == "cross":
        feet = bar((0, 0, 0.06), (reach, 0, 0.03), 0.07, 0.07)
        arms = bar((0, 0, z - 0.03), (0.8 * reach, 0, z - 0.03), 0.06, 0.05)
        t = draw.between(0.03, 0.09)
        return cuboid((-t, -t, 0), (t, t, z)) + around(feet, 4) + around(arms, 4)
    beads = [(0.4, 0.12), (0.9, 0.16), (1.0, 0.28), (0.5, 0.36), (0.45, 0.6), (0.8, 0.68), (0.45, 0.74), (0.6, 1)]
    column = revolve(smooth(beads, draw.round(22)) * (draw.between(0.04, 0.13), z), draw.round(16))
    claw = [(0.03, 0, 0.24 * z), (0.45 * reach, 0, 0.2 * z), (0.85 * reach, 0, 0.03), (reach, 0, 0.02)]
    path = smooth(claw, draw.round(9))
    return column + around(tube(path, np.linspace(0.045, 0.025, len(path)), draw.round(8)), draw.pick((3, 4)))
