"""Tables: dining, round, trestle, desks, coffee tables, counters and more. Long side along x, metres."""

import numpy as np

from zbuf_occlude.base.arrays import FloatArray
from zbuf_occlude.meshes.shapes.curves import bent, circle, polygon, rectangle, smooth, superellipse
from zbuf_occlude.meshes.shapes.draw import Draw
from zbuf_occlude.meshes.shapes.furniture import doors, drawers, four_legs, frame, leg, splayed, stretchers
from zbuf_occlude.meshes.shapes.kit import (
    MeshPart,
    along,
    around,
    bar,
    cuboid,
    cylinder,
    ellipsoid,
    join,
    pair,
    prism,
    quad_grid,
    repeated,
    revolve,
    rod,
    shell,
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
    """Return a table top of a kind, 2 to 6 cm thick, with its upper side at z.

    Kinds are those of `outline`, "planks" (with gaps) and "pane" (a sheet without thickness in a frame).
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
    """Return a top on four legs, with a random apron and stretchers."""
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


# ---- styles --------------------------------------------------------------------------------------------------------


def _dining(draw: Draw) -> MeshPart:
    w, d, z = draw.between(0.95, 2.9), draw.between(0.65, 1.25), draw.between(0.66, 0.82)
    return four_legged(
        draw, w, d, z, ("rectangle", "rectangle", "planks", "rounded", "barrel", "pane"), draw.between(0.04, 0.14)
    )


def _square(draw: Draw) -> MeshPart:
    w, z = draw.between(0.5, 1.2), draw.between(0.4, 0.95)
    return four_legged(
        draw, w, w * draw.between(0.8, 1.0), z, ("rectangle", "planks", "rounded", "barrel"), draw.between(0.03, 0.1)
    )


def _coffee(draw: Draw) -> MeshPart:
    """A low table, often with a shelf below."""
    w, d, z = draw.between(0.7, 1.7), draw.between(0.45, 1.0), draw.between(0.24, 0.5)
    thick, kind = draw.between(0.03, 0.12), draw.pick(("shelf", "glass", "slabs", "kidney"))
    x, y = w / 2 - thick * 0.7, d / 2 - thick * 0.7
    if kind == "kidney":
        one, wide = leg(draw, "conical", z - 0.02, 0.045), draw.between(0.25, 0.34) * w
        side = pair(splayed(one, z, 12, 8).at(wide, 0.22 * d))
        plate, front = top(draw, w, d, z, ("kidney", "ellipse", "barrel")), splayed(one, z, 0, -12)
        return join([plate, side, front.at(0, -0.08 * d)])
    if kind == "slabs":
        wall, level, at = draw.between(0.03, 0.2), draw.between(0.1, 0.6) * z, draw.between(0.24, 0.4) * w
        sides = pair(cuboid((at, -0.4 * d, 0), (at + wall, 0.4 * d, z - 0.02)))
        parts = [top(draw, w, d, z, ("rectangle", "rounded")), sides]
        return join([*parts, cuboid((-at - 0.01, -0.38 * d, level), (at + 0.01, 0.38 * d, level + 0.02))])
    kinds = ("pane", "rounded") if kind == "glass" else ("rectangle", "planks", "rounded")
    parts = [top(draw, w, d, z, kinds), four_legs(draw, draw.pick(LEGS), x, y, z - 0.02, thick)]
    if draw.chance(0.7):
        low = draw.between(0.15, 0.55) * z
        parts.append(cuboid((-x, -y, low), (x, y, low + 0.025)))
    if draw.chance(0.4):
        low = z - draw.between(0.1, 0.2)
        parts.append(cuboid((-x, -y, low), (x, y, z - 0.02)))
        parts.append(drawers(draw, (-x, -y, low), (x, y, z - 0.03), 1, draw.whole(1, 3)))
    return join(parts)


def _round(draw: Draw) -> MeshPart:
    """A table on one foot: café, bar and dining."""
    w, z, stretch = draw.between(0.45, 1.7), draw.between(0.45, 1.15), draw.pick((1.0, 1.0, draw.between(0.6, 0.85)))
    plate = top(draw, w, w * stretch, z, ("ellipse", "ellipse", "ellipse", "polygon", "barrel"))
    return plate + table_pedestal(draw, min(w, 1.2) * stretch, z - 0.02)


def _round_legs(draw: Draw) -> MeshPart:
    """A round top on three to six legs, with an apron, a ring or a lower top."""
    w, z, count = draw.between(0.35, 1.5), draw.between(0.35, 0.8), draw.whole(3, 6)
    splay, r, n = draw.pick((0.0, draw.between(4, 16))), draw.between(0.26, 0.42) * w, draw.round(30)
    one = leg(draw, draw.pick((*LEGS, "hairpin")), z - 0.02, draw.between(0.03, 0.08))
    parts = [top(draw, w, w, z, ("ellipse", "ellipse", "polygon", "barrel"))]
    parts.append(around(splayed(one, z, splay, 0).at(r), count, draw.between(0, 60)))
    choice, level = draw.pick(("apron", "shelf", "ring", "none")), draw.between(0.15, 0.5)
    if choice == "apron":
        parts.append(revolve([(r, z - draw.between(0.05, 0.15)), (r, z - 0.01)], n))
    elif choice == "shelf":
        parts.append(cylinder(r * 1.02, level * z, level * z + 0.02, n))
    elif choice == "ring":
        path = np.column_stack([circle(n) * r * (1 + 0.01 * splay), np.full(n, level * z)])
        parts.append(tube(path, 0.012, 6, closed=True))
    return join(parts)


def _trestle(draw: Draw) -> MeshPart:
    w, d, z, t = draw.between(1.1, 2.8), draw.between(0.6, 1.1), draw.between(0.62, 0.82), draw.between(0.035, 0.1)
    x, y, kind = draw.between(0.22, 0.42) * w, draw.between(0.3, 0.46) * d, draw.pick(("A", "X", "T", "U"))
    if kind == "A":
        lean = bar((0.1, 0.03, z - 0.04), (0.18, y, 0), t, t)
        rail = bar((0.13, -0.25 * d, 0.35 * z), (0.13, 0.25 * d, 0.35 * z), t * 0.5, t)
        side = (pair(pair(lean), "y") + pair(rail)).at(x)
    elif kind == "X":
        side = pair(bar((x, -y, 0), (x, y, z - 0.03), t, t), "y")
    elif kind == "T":
        post, foot = cuboid((x - t, -0.08, 0.04), (x + t, 0.08, z)), cuboid((x - t, -y, 0), (x + t, y, 0.08))
        side = join([post, foot, cuboid((x - t, -y, z - 0.1), (x + t, y, z - 0.03))])
    else:
        path = bent([(x, -y, z - 0.03), (x, -y, 0.02), (x, y, 0.02), (x, y, z - 0.03)], 0.05)
        side = tube(path, t * 0.5, 4)
    parts = [top(draw, w, d, z, ("rectangle", "planks", "rounded")), pair(side)]
    if kind in "XT" or draw.chance(0.3):
        middle = 0.5 * z if kind == "X" else draw.between(0.15, 0.45) * z
        parts.append(bar((-x, 0, middle), (x, 0, middle), t * 0.7, t))
    return join(parts)


def _desk(draw: Draw) -> MeshPart:
    """A desk with one or two cases of drawers below the top, sometimes with pigeon-holes above."""
    w, d, z, low = draw.between(1.0, 2.0), draw.between(0.5, 0.95), draw.between(0.68, 0.8), draw.pick((0.0, 0.08))
    case, x, y = draw.between(0.2, 0.36) * w, w / 2, d / 2
    x0 = x - case - 0.02
    corner, end = (x0, 0.03 - y, low), (x - 0.02, y - 0.03, z - 0.02)
    front = doors(draw, corner, end, 1) if draw.chance(0.25) else drawers(draw, corner, end, draw.whole(2, 5))
    unit = cuboid(corner, end) + front
    if low > 0:
        foot = pair(cuboid((case / 2 - 0.06, y - 0.08, 0), (case / 2 - 0.02, y - 0.04, low + 0.01)), "y")
        unit = unit + pair(foot).at(x0 + case / 2)
    parts = [top(draw, w, d, z, ("rectangle", "rectangle", "rounded")), unit]
    if draw.chance(0.5):
        parts.append(unit.at(-(2 * x0 + case)))
    else:
        one = leg(draw, draw.pick(("square", "tapered", "round")), z - 0.02, draw.between(0.03, 0.08))
        parts.append(pair(one.at(0.06 - x, y - 0.06), "y"))
        parts.append(cuboid((0.06 - x, 0.05 - y, z - 0.12), (x0, y - 0.05, z - 0.02)))
    if draw.chance(0.6):
        parts.append(cuboid((0.03 - x, y - 0.06, draw.between(0.05, 0.5)), (x - 0.03, y - 0.045, z - 0.02)))
    if draw.chance(0.35):
        h, deep = draw.between(0.2, 0.6), y - draw.between(0.18, 0.3)
        walls = np.linspace(-x, x - 0.02, draw.whole(2, 5) + 1)
        parts.append(repeated(cuboid((0, deep, z), (0.02, y, z + h)), along("x", walls)))
        parts += [cuboid((-x, deep, z + k * h), (x, y, z + k * h + 0.018)) for k in (0.5, 1.0)]
        parts.append(cuboid((-x, y - 0.01, z), (x, y, z + h)))
    return join(parts)


def _corner(draw: Draw) -> MeshPart:
    """An L-shaped table of two tops."""
    w, d, z, arm = draw.between(1.2, 2.1), draw.between(0.5, 0.85), draw.between(0.68, 0.8), draw.between(1.1, 2.0)
    t, x, y = draw.between(0.02, 0.06), w / 2, arm / 2
    tops = cuboid((-x, y - d, z - t), (x, y, z)) + cuboid((-x, -y, z - t), (d - x, y - d, z))
    kind = draw.pick(("panel", "legs", "case"))
    if kind == "legs":
        spots = [(-x, -y), (d - x - 0.12, -y), (-x, y - 0.12), (x - 0.12, y - 0.12), (x - 0.12, y - d)]
        one = leg(draw, draw.pick(("square", "round", "conical")), z - t, draw.between(0.04, 0.09)).at(0.06, 0.06)
        return tops + repeated(one, [(*spot, 0) for spot in spots])
    low = draw.between(0.05, 0.4)
    parts = [tops, cuboid((x - t, y - d + 0.02, 0), (x, y - 0.02, z - t))]
    parts.append(cuboid((0.02 - x, -y, 0), (d - x - 0.02, t - y, z - t)))
    parts += [cuboid((-x, -y, low), (0.02 - x, y, z - t)), cuboid((-x, y - 0.02, low), (x, y, z - t))]
    if kind == "case":
        unit = (x - draw.between(0.35, 0.55), y - d + 0.04, 0.02), (x - t, y - 0.04, z - t)
        parts += [cuboid(*unit), drawers(draw, *unit, draw.whole(2, 4))]
    return join(parts).mirrored("x") if draw.chance(0.5) else join(parts)


def _console(draw: Draw) -> MeshPart:
    """A narrow table for a wall."""
    w, d, z = draw.between(0.8, 2.0), draw.between(0.25, 0.5), draw.between(0.7, 1.1)
    x, y = w / 2 - 0.05, d / 2 - 0.03
    parts = [four_legged(draw, w, d, z, ("rectangle", "rounded", "barrel"), draw.between(0.03, 0.07))]
    if draw.chance(0.6):
        low, high = (-x, -y, z - draw.between(0.08, 0.3)), (x, y, z - 0.02)
        parts += [cuboid(low, high), drawers(draw, low, high, 1, draw.whole(1, 4))]
    if draw.chance(0.5):
        level = draw.between(0.08, 0.4)
        parts.append(cuboid((-x, -y, level), (x, y, level + 0.025)))
    return join(parts)


def _waterfall(draw: Draw) -> MeshPart:
    """A table of one bent sheet, or with legs of one bent pipe."""
    w, d, z = draw.between(0.5, 1.8), draw.between(0.4, 1.0), draw.between(0.3, 0.82)
    radius, t, x, lean = draw.between(0.02, 0.28), draw.between(0.01, 0.06), w / 2, draw.between(-0.12, 0.12) * w
    path = bent([(-x - lean, 0, 0), (-x, 0, z), (x, 0, z), (x + lean, 0, 0)], radius, draw.round(6))
    if draw.chance(0.6):
        net = path[:, None] + along("y", [-d / 2, 0, d / 2])
        sheet = shell(net, t)
        if draw.chance(0.5):
            k = draw.between(0.2, 0.6)
            reach = x + lean * (1 - k)
            return sheet + cuboid((-reach, 0.02 - d / 2, k * z), (reach, d / 2 - 0.02, k * z + t))
        return sheet
    pipes = pair(tube(path - [0, 0, t], t * 0.6, draw.round(8)).at(y=d * 0.36), "y")
    parts = [pipes, top(draw, w, d, z, ("rectangle", "rounded", "planks"))]
    if draw.chance(0.5):
        reach = x + lean * 0.8
        parts.append(pair(bar((reach, -d * 0.36, 0.12), (reach, d * 0.36, 0.12), 0.02, 0.02)))
    return join(parts)


def _crossed(draw: Draw) -> MeshPart:
    """A table with crossed legs: folding, picnic (with benches), campaign."""
    w, d, z, t = draw.between(0.6, 2.2), draw.between(0.45, 1.0), draw.between(0.4, 0.82), draw.between(0.018, 0.055)
    x, y = draw.between(0.34, 0.46) * w, draw.between(0.34, 0.46) * d
    parts = [top(draw, w, d, z, ("planks", "rectangle", "rounded"))]
    if w > 1.1 and draw.chance(0.6):  # picnic
        out, seat = d / 2 + draw.between(0.2, 0.45), draw.between(0.5, 0.65) * z
        beam = cuboid((x - t, -out - 0.12, seat - 0.1), (x + t, out + 0.12, seat - 0.03))
        side = pair(bar((x, 0.25 * d, z - 0.03), (x, out, 0), 2 * t, t), "y") + beam
        bench = repeated(cuboid((-w / 2, 0, seat - 0.03), (w / 2, 0.12, seat)), along("y", [out - 0.16, out - 0.03]))
        return join([*parts, pair(side), pair(bench, "y")])
    if draw.chance(0.5):  # scissors seen from the long side
        parts.append(pair(pair(bar((-x, y, 0), (x, y, z - 0.03), t, t)), "y"))
    else:
        parts.append(pair(bar((x, -y, 0), (x, y, z - 0.03), t, t) + bar((x + t, y, 0), (x + t, -y, z - 0.03), t, t)))
    parts.append(pair(rod((-x, y, 0.12), (x, y, 0.12), t * 0.4, draw.round(8)), "y"))
    return join(parts)


def _game(draw: Draw) -> MeshPart:
    """Billiards, ping-pong, a workbench with its vice."""
    w, d, z = draw.between(1.4, 2.9), draw.between(0.75, 1.55), draw.between(0.7, 0.95)
    kind, x, y = draw.pick(("billiards", "net", "bench")), w / 2, d / 2
    if kind == "net":
        h, out = draw.between(0.1, 0.24), y + 0.08
        net = np.array([[(0, -out, z), (0, out, z)], [(0, -out, z + h), (0, out, z + h)]], dtype=np.float64)
        posts = pair(rod((0, out, z - 0.05), (0, out, z + h), 0.01, 6), "y")
        parts = [top(draw, w, d, z, ("rectangle",)), quad_grid(net), posts]
        at, shape = draw.between(0.25, 0.44) * w, draw.pick(("square", "round", "tapered"))
        parts.append(four_legs(draw, shape, at, 0.4 * d, z, draw.between(0.04, 0.09)))
        return join([*parts, pair(stretchers(draw, 0.0, 0.4 * d, 0.15, 0.03, "sides").at(at))])
    if kind == "bench":
        a, b, t = 0.88 * x, 0.56 * y, draw.between(0.06, 0.13)
        parts = [top(draw, w, d * 0.7, z, ("planks", "rectangle")), four_legs(draw, "square", a, b, z - 0.02, t)]
        low = draw.between(0.1, 0.35)
        parts.append(cuboid((-a, -b, low), (a, b, low + 0.04)))
        parts.append(cuboid((0.6 * x, -0.84 * y, z - 0.16), (0.84 * x, -0.74 * y, z)))
        parts.append(rod((0.72 * x, -y, z - 0.08), (0.72 * x, -0.6 * y, z - 0.08), 0.015, draw.round(8)))
        if draw.chance(0.5):
            parts.append(cuboid((-0.96 * x, 0.66 * y, z), (0.96 * x, 0.7 * y, z + draw.between(0.2, 0.8))))
        return join(parts)
    rim, deep = draw.between(0.06, 0.18), draw.between(0.1, 0.3)
    parts = [pair(cuboid((-x, y - rim, z - 0.05), (x, y, z + 0.05), edge=0.02), "y")]
    parts.append(pair(cuboid((x - rim, -y, z - 0.05), (x, y, z + 0.05), edge=0.02)))
    parts.append(cuboid((0.03 - x, 0.03 - y, z - deep), (x - 0.03, y - 0.03, z)))
    shape = draw.pick(("turned", "square", "cabriole", "tapered"))
    parts.append(four_legs(draw, shape, 0.8 * x, 0.72 * y, z - deep + 0.05, draw.between(0.1, 0.24)))
    spots = draw.rng.uniform((-0.7 * x, -0.6 * y, z + 0.03), (0.7 * x, 0.6 * y, z + 0.03), size=(draw.whole(1, 7), 3))
    return join([*parts, repeated(ellipsoid((0, 0, 0), (0.03,) * 3, draw.round(9)), spots)])


def _side(draw: Draw) -> MeshPart:
    """A small table: bedside cabinet, nest of tables, C-shaped, tray."""
    w, d, z = draw.between(0.3, 0.65), draw.between(0.28, 0.55), draw.between(0.4, 0.75)
    kind, x, y = draw.pick(("case", "nest", "C", "tray")), w / 2, d / 2
    if kind == "nest":
        shape, parts = draw.pick(("square", "round", "tapered")), []
        t, gap = draw.between(0.02, 0.04), draw.between(0.05, 0.4)
        for i in range(draw.whole(2, 4)):
            a, b, c = x * (1.25 - 0.22 * i), y * (1 - 0.1 * i), z * (1 - 0.13 * i)
            one = cuboid((-a, -b, c - 0.02), (a, b, c)) + four_legs(draw, shape, a - t, b - t, c, t)
            parts.append(one.at(y=-gap * d * i))
        return join(parts)
    if kind == "C":
        path = bent([(-x, -y, z), (-x, y - 0.02, z), (-x, y - 0.02, 0.02), (-x, -y, 0.02)], 0.03)
        side = tube(path, 0.012, draw.round(8))
        back = cuboid((0.03 - x, y - 0.03, 0.01), (x - 0.03, y - 0.01, 0.03))
        return join([pair(side), top(draw, w, d, z + 0.02, ("rectangle", "rounded")), back])
    if kind == "tray":
        n, r = draw.round(5), draw.between(0.02, 0.14)
        rim = np.column_stack([rectangle(w, d, r, n), np.full(4 * (n + 1), z)])
        lip = quad_grid(np.stack([rim, rim * (1.04, 1.04, 1) + [0, 0, draw.between(0.03, 0.1)]]), wrap_columns=True)
        cross = pair(bar((0.8 * x, -0.8 * y, 0), (0.8 * x, 0.8 * y, z), 0.025, 0.02), "y")
        return join([prism(rectangle(w, d, r, n), z - 0.02, z), lip, pair(cross)])
    low = draw.between(0.05, 0.45) * z
    corner, end = (0.02 - x, 0.02 - y, low), (x - 0.02, y - 0.02, z - 0.02)
    legs = four_legs(draw, draw.pick(LEGS), x - 0.04, y - 0.04, low + 0.02, 0.04)
    plate, front = top(draw, w, d, z, ("rectangle",)), drawers(draw, corner, end, draw.whole(1, 3))
    return join([plate, cuboid(corner, end), front, legs])


STYLES = (
    _dining, _round, _coffee, _trestle, _desk, _round_legs, _square, _console, _waterfall, _crossed, _dining, _game,
    _corner, _side, _round,
)  # fmt: skip
