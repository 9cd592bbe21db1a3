"""Bookshelves: open, with doors, with books, ladders, cubes, stairs, racks and more. Front towards -y, metres."""

from itertools import pairwise

import numpy as np

from zbuf_occlude.base.arrays import FloatArray
from zbuf_occlude.meshes.shapes.curves import bent, circle, cosd, polygon, sind, smooth
from zbuf_occlude.meshes.shapes.draw import Draw
from zbuf_occlude.meshes.shapes.furniture import books, doors, drawers, four_legs
from zbuf_occlude.meshes.shapes.kit import (
    MeshPart,
    along,
    around,
    bar,
    boxes,
    cuboid,
    cylinder,
    ellipsoid,
    four,
    join,
    loft,
    pair,
    prism,
    quad_grid,
    repeated,
    revolve,
    rod,
    shell,
)

Corner = tuple[float, float, float]


def book_fill(draw: Draw) -> float:
    """Return a random fill level of a whole shelf: empty, half, full."""
    return draw.pick((0.0, draw.between(0.2, 0.6), draw.between(0.7, 1.0)))


def contents(draw: Draw, low: Corner, high: Corner, odds: float) -> list[MeshPart]:
    """Return the random contents of one compartment: books, a vase, a box."""
    if not draw.chance(odds):
        return []
    (x0, y0, z0), (x1, y1, z1) = low, high
    room = z1 - z0
    if draw.chance(0.75) or room < 0.15:
        return [books(draw, low, high, draw.between(0.3, 1.0))]
    x, size = draw.between(0.35, 0.65) * (x0 + x1), min(0.35 * room, 0.3 * (x1 - x0), 0.4 * (y1 - y0))
    x = min(max(x, x0 + 1.2 * size), x1 - 1.2 * size)
    if draw.chance(0.5):
        vase = smooth([(0.5, 0), (1.0, 0.7), (0.45, 1.5), (0.6, 1.9)], draw.round(8)) * size
        return [revolve(vase, draw.round(10)).at(x, (y0 + y1) / 2, z0)]
    return [cuboid((x - 1.2 * size, y0 + 0.03, z0), (x + 1.2 * size, y1 - 0.02, z0 + draw.between(0.5, 0.9) * room))]


def levels_between(draw: Draw, z0: float, z1: float, count: int) -> FloatArray:
    """Return heights of count + 1 boards from z0 to z1: even, or wider below."""
    grade = draw.pick((0.0, 0.0, draw.between(0.1, 0.6)))
    steps = 1.0 - grade * np.linspace(0.0, 1.0, count)
    return z0 + (z1 - z0) * np.concatenate([[0.0], np.cumsum(steps) / steps.sum()])


def case(
    draw: Draw,
    plan: tuple[float, float],
    span: tuple[float, float],
    thick: float,
    bays: int,
    rows: int,
    odds: float,
    back: float,
) -> MeshPart:
    """Return sides, boards, upright walls, perhaps a back, and the contents.

    `plan` is width and depth, `span` the heights of bottom and top. `odds` is the probability that a compartment is
    filled, `back` that of a back: thin plywood, or one sheet without thickness.
    """
    (w, d), (z0, z1) = plan, span
    x, y, t = w / 2, d / 2, thick
    levels, walls = levels_between(draw, z0, z1 - t, rows), np.linspace(-x, x - t, bays + 1)
    side, board = cuboid((0, -y, z0), (t, y, z1)), cuboid((-x, 0.004 - y, 0), (x, y, t))
    parts = [repeated(side, along("x", walls)), repeated(board, along("z", levels))]
    if draw.chance(back):
        if draw.chance(0.5):
            parts.append(cuboid((-x, y - 0.006, z0), (x, y, z1)))
        else:
            across, height = np.meshgrid((-x, x), (z0, z1), indexing="ij")
            parts.append(quad_grid(np.stack([across, np.full((2, 2), y), height], axis=2)))
    for bottom, top in zip(levels[:-1] + t, levels[1:], strict=True):
        for left, right in zip(walls[:-1] + t, walls[1:], strict=True):
            parts += contents(draw, (left, -y, bottom), (right, y, top), odds)
    return join(parts)


def display_pole(draw: Draw, r: float, h: float) -> MeshPart:
    """Return thin posts around a tower of radius r."""
    return around(rod((r * 0.7, 0, 0.04), (r * 0.7, 0, h), 0.01, 6), draw.pick((3, 4)), 45)


def tray(draw: Draw, r: float, z: float, room: float) -> MeshPart:
    """Return books standing across a tray of radius r at height z."""
    half = 0.5 * r
    return books(draw, (-half, -0.4 * r, z + 0.03), (half, 0.4 * r, z + 0.85 * room), draw.between(0.5, 1.0))


# ---- styles --------------------------------------------------------------------------------------------------------


def _plain(draw: Draw) -> MeshPart:
    """A case with shelves, narrow to wide."""
    w, d, h = draw.between(0.35, 1.5), draw.between(0.2, 0.45), draw.between(1.0, 2.4)
    t, foot, x, y = draw.between(0.014, 0.045), draw.pick((0.0, 0.06, draw.between(0.08, 0.2))), w / 2, d / 2
    body = case(draw, (w, d), (foot, h), t, draw.pick((1, 1, 2)), draw.whole(3, 7), book_fill(draw), 0.7)
    if not foot:
        return body
    if draw.chance(0.5):
        return body + cuboid((-x, 0.02 - y, 0), (x, y, foot))
    return body + four_legs(draw, draw.pick(("square", "tapered", "conical")), x - 0.03, y - 0.03, foot, 0.05)


def _classic(draw: Draw) -> MeshPart:
    """A case with a cornice, a plinth, pilasters and sometimes a pediment."""
    w, d, h = draw.between(0.7, 2.2), draw.between(0.26, 0.48), draw.between(1.5, 2.5)
    t, foot, x, y = draw.between(0.02, 0.045), draw.between(0.06, 0.2), w / 2, d / 2
    parts = [case(draw, (w, d), (foot, h), t, draw.whole(1, 4), draw.whole(3, 7), book_fill(draw), 0.9)]
    steps, out, rise = draw.whole(1, 4), draw.between(0.01, 0.035), draw.between(0.02, 0.05)
    for i in range(1, steps + 1):
        k = out * i
        parts.append(cuboid((-x - k, -y - k, h + rise * (i - 1)), (x + k, y, h + rise * i), edge=0.006))
    parts.append(cuboid((-x - 0.03, -y - 0.03, 0), (x + 0.03, y, foot), edge=0.01))
    if draw.chance(0.6):
        pilaster = cuboid((-0.04, -y - 0.02, foot), (0.04, 0.01 - y, h), edge=0.005)
        parts.append(repeated(pilaster, along("x", np.linspace(-x, x, draw.whole(2, 5)))))
    if draw.chance(0.35):
        tall, z = draw.between(0.1, 0.4), h + rise * steps
        round_top = draw.chance(0.5)
        angle = np.linspace(0, 180, draw.round(14))
        edge = np.array([(x, 0), (0, tall), (-x, 0)])
        if round_top:
            edge = np.column_stack([x * cosd(angle), tall * sind(angle)])
        rings = [np.column_stack([edge[:, 0], np.full(len(edge), k), z + edge[:, 1]]) for k in (-y, y)]
        parts.append(loft(np.stack(rings)))
    return join(parts)


def _doored(draw: Draw) -> MeshPart:
    """Cupboards or drawers below, shelves above, often less deep."""
    w, d, h, t = draw.between(0.6, 1.9), draw.between(0.32, 0.6), draw.between(1.4, 2.4), 0.025
    low, upper, bays, x, y = draw.between(0.4, 1.05), d * draw.between(0.5, 1.0), draw.whole(1, 3), w / 2, d / 2
    corner, end = (-x, -y, 0.06), (x, y, low)
    parts = [cuboid(corner, end), cuboid((0.03 - x, 0.04 - y, 0), (x - 0.03, y, 0.06))]
    shelves = case(draw, (w, upper), (low, h), t, bays, draw.whole(2, 5), book_fill(draw), 0.9)
    parts.append(shelves.at(y=(d - upper) / 2))
    if draw.chance(0.65):
        parts.append(doors(draw, corner, end, bays * 2))
    else:
        parts.append(drawers(draw, corner, end, draw.whole(2, 4), bays))
    if draw.chance(0.35):  # doors above too, as if of glass
        front = y - upper
        parts.append(doors(draw, (-x, front, low + t), (x, front + 0.1, h), bays * 2))
    return join(parts)


def _cubes(draw: Draw) -> MeshPart:
    """Square compartments, some closed, often wider than high."""
    cell, t, d = draw.between(0.26, 0.46), draw.between(0.014, 0.06), draw.between(0.25, 0.45)
    columns, rows = draw.whole(1, 5), draw.whole(2, 5)
    w, h = columns * cell + t, rows * cell * draw.between(0.8, 1.1) + t
    parts = [case(draw, (w, d), (0.0, h), t, columns, rows, draw.between(0.1, 0.8), 0.3)]
    dx, dz = (w - t) / columns, (h - t) / rows
    for i, j in np.argwhere(draw.rng.random((columns, rows)) < 0.15):
        x, z = -w / 2 + t + i * dx, t + j * dz
        parts.append(cuboid((x, 0.01 - d / 2, z), (x + dx - t, d / 2 - 0.05, z + dz - t)))
    return join(parts)


def _low(draw: Draw) -> MeshPart:
    """A wide low shelf, like a sideboard or a bench."""
    w, d, h, foot = draw.between(1.0, 2.5), draw.between(0.28, 0.48), draw.between(0.45, 1.1), draw.between(0.04, 0.25)
    bays, shape = draw.whole(2, 5), draw.pick(("square", "conical", "tapered", "round"))
    parts = [case(draw, (w, d), (foot, h), draw.between(0.02, 0.05), bays, draw.whole(1, 3), book_fill(draw), 0.7)]
    parts.append(four_legs(draw, shape, w / 2 - 0.08, d / 2 - 0.06, foot + 0.01, 0.05, draw.pick((0.0, 8.0))))
    if draw.chance(0.4):
        span, left = w / bays, draw.whole(0, bays - 1)
        x = -w / 2 + left * span
        corner, end = (x, 0.01 - d / 2, foot + 0.02), (x + span, d / 2, h - 0.02)
        parts += [cuboid(corner, end), doors(draw, corner, end, 1)]
    return join(parts)


def _ladder(draw: Draw) -> MeshPart:
    """A leaning or A-shaped shelf whose boards shrink upwards."""
    w, h, d, t = draw.between(0.4, 1.2), draw.between(1.2, 2.2), draw.between(0.32, 0.75), draw.between(0.02, 0.05)
    both, x, y = draw.chance(0.35), w / 2, d / 2
    head = 0.0 if both else y - draw.between(0.08, 0.2)
    parts = [pair(bar((x, -y, 0), (x, head, h), t, t * 1.4))]
    if both:
        parts.append(pair(bar((x, y, 0), (x, -head, h), t, t * 1.4)))
    elif draw.chance(0.5):
        parts.append(pair(bar((x, y - t, 0), (x, y - t, h), t, t)))
    rim = draw.chance(0.5)
    for z in np.linspace(draw.between(0.06, 0.25), draw.between(0.85, 0.96), draw.whole(3, 6)) * h:
        front = -y + (head + y) * z / h
        rear = -front if both else y
        parts.append(cuboid((-x, front, z), (x, rear, z + 0.02)))
        if rim:
            parts.append(cuboid((-x, rear - 0.015, z), (x, rear, z + 0.09)))
        parts += contents(draw, (t - x, front + 0.02, z + 0.02), (x - t, rear, z + 0.28), 0.4)
    return join(parts)


def _rack(draw: Draw) -> MeshPart:
    """Posts and boards: an étagère, a store rack with braces, a wire rack."""
    w, d, h, r = draw.between(0.4, 1.8), draw.between(0.26, 0.6), draw.between(1.0, 2.2), draw.between(0.008, 0.028)
    x, y, n, kind = w / 2 - r, d / 2 - r, draw.round(8), draw.pick(("round", "square", "wire"))
    post = cuboid((x - r, y - r, 0), (x + r, y + r, h)) if kind == "square" else rod((x, y, 0), (x, y, h), r, n)
    levels = np.linspace(draw.between(0.04, 0.3), h - 0.03, draw.whole(3, 6))
    if kind == "wire":
        spots = np.linspace(-x, x, draw.whole(14, 24))
        sides = pair(cuboid((-x, y - 0.004, -0.03), (x, y + 0.004, 0.006)), "y")
        ends = pair(cuboid((x - 0.004, -y, -0.03), (x + 0.004, y, 0.006)))
        shelf = join([repeated(cuboid((-0.003, -y, 0), (0.003, y, 0.006)), along("x", spots)), sides, ends])
    else:
        shelf = cuboid((-x, -y, 0), (x, y, draw.between(0.012, 0.04)))
    parts = [four(post), repeated(shelf, along("z", levels))]
    room = 0.9 * (levels[1] - levels[0])
    for z in levels:
        parts += contents(draw, (r - x, -y, z + 0.04), (x - r, y, z + min(0.32, room)), 0.45)
    if draw.chance(0.5):  # braces
        parts.append(pair(bar((x, -y, levels[0]), (x, y, levels[1]), r, r)))
        parts.append(pair(bar((-x, y, 0.1), (x, y, h - 0.1), r, r)))
    if kind == "round":
        parts.append(four(ellipsoid((x, y, h), (1.8 * r,) * 3, n)))
    return join(parts)


def _stairs(draw: Draw) -> MeshPart:
    """Columns of cubes that climb, from one side or to the middle."""
    cell, t, d = draw.between(0.25, 0.42), draw.between(0.016, 0.04), draw.between(0.24, 0.42)
    columns, tallest, odds = draw.whole(3, 5), draw.whole(3, 6), draw.between(0.0, 0.7)
    steps = np.linspace(1, tallest, columns)
    if draw.chance(0.35):
        steps = tallest - np.abs(steps - (tallest + 1) / 2) * 1.6
    heights = np.maximum(np.rint(steps), 1)[:: draw.pick((1, -1))]
    towers = [case(draw, (cell + t, d), (0.0, k * cell + t), t, 1, int(k), odds, 0.4) for k in heights]
    return join(tower.at((i - (columns - 1) / 2) * cell) for i, tower in enumerate(towers))


def _corner(draw: Draw) -> MeshPart:
    """A quarter-round or L-shaped shelf for a corner of the room."""
    h, t = draw.between(1.1, 2.2), draw.between(0.018, 0.035)
    if draw.chance(0.5):
        a, b, d, rows = draw.between(0.6, 1.5), draw.between(0.6, 1.5), draw.between(0.22, 0.38), draw.whole(3, 6)
        one, two = (case(draw, (w, d), (0.05, h), t, draw.whole(1, 2), rows, book_fill(draw), 0.9) for w in (a, b))
        return one.at(a / 2 - d / 2) + two.turned("z", 90).at(y=-b / 2 - d / 2)
    r, n = draw.between(0.3, 0.7), draw.round(10)
    angle = np.linspace(0, 90, n + 1)
    bow = draw.pick((1.0, 1.0, draw.between(0.5, 0.8)))  # round, or drawn in
    curve = np.column_stack([cosd(angle) ** (1 / bow), sind(angle) ** (1 / bow)]) * r
    levels = np.linspace(0.04, h - t, draw.whole(4, 6))
    parts = [repeated(prism(np.vstack([[0, 0], curve]), 0, t), along("z", levels))]
    parts += [cuboid((0, -0.015, 0), (r, 0, h)), cuboid((-0.015, 0, 0), (0, r, h))]
    for z, above in pairwise(levels):
        parts += contents(draw, (0.03, 0.02, z + t), (0.6 * r, 0.5 * r, above), 0.5)
    return join(parts).turned("z", 225)


def _tower(draw: Draw) -> MeshPart:
    """A free-standing shelf: a revolving case, trays on a pole, a drum of books."""
    h, rows = draw.between(0.8, 2.0), draw.whole(3, 6)
    if draw.chance(0.5):
        r, n, sides = draw.between(0.18, 0.42), draw.round(26), draw.pick((0, 4, 6))
        outline = (circle(n) if sides == 0 else polygon(sides, 45)) * r
        levels = np.linspace(draw.between(0.05, 0.2), h, rows)
        boards = repeated(prism(outline, 0, draw.between(0.015, 0.05)), along("z", levels))
        parts = [boards, cylinder(0.035, 0, h, draw.round(12))]
        parts.append(display_pole(draw, r, h) if draw.chance(0.7) else cylinder(0.7 * r, 0, 0.05, n))
        parts += [tray(draw, r, z, (h - levels[0]) / rows) for z in levels[:-1] if draw.chance(0.4)]
        return join(parts)
    w, t, d = draw.between(0.4, 0.75), 0.02, draw.between(0.18, 0.25)
    one = case(draw, (w, d), (0.1, h), t, draw.pick((1, 2)), rows, draw.between(0.4, 1.0), 1.0).at(y=(d - w) / 2)
    half = w / 2 - d
    core = cuboid((-half, -half, 0.1), (half, half, h)) if w > 2 * d + 0.05 else cylinder(0.05, 0.1, h, 8)
    lid = cuboid((-w / 2 - 0.03, -w / 2 - 0.03, h), (w / 2 + 0.03, w / 2 + 0.03, h + 0.03), edge=0.008)
    feet = around(bar((0, 0, 0.07), (w / 2, 0, 0.03), 0.06, 0.06), 4, 45)
    return join([one, one.turned("z", 180), core, lid, feet, cylinder(0.05, 0, 0.1, 12)])


def _zigzag(draw: Draw) -> MeshPart:
    """A modern shelf: slanted walls, zigzags, trees, honeycombs."""
    kind, t = draw.pick(("zigzag", "honeycomb", "tree", "slant")), draw.between(0.02, 0.045)
    d, h, w = draw.between(0.2, 0.4), draw.between(1.2, 2.2), draw.between(0.45, 1.3)
    if kind == "zigzag":
        levels, lean = np.linspace(0, h, draw.whole(3, 6) + 1), draw.between(0.2, 0.8) * w
        parts = [repeated(cuboid((-w / 2, -d / 2, 0), (w / 2, d / 2, t)), along("z", levels))]
        for i, (a, b) in enumerate(pairwise(levels)):
            s = 1 if i % 2 else -1
            x = s * (w / 2 - t)
            parts.append(bar((x, 0, a), (x - s * lean, 0, b), t, d))
            parts += contents(draw, (-0.3 * w, -d / 2, a + t), (0.2 * w, d / 2, b), 0.4)
        return join(parts)
    if kind == "honeycomb":
        r, columns, rows = draw.between(0.15, 0.27), draw.whole(2, 5), draw.whole(3, 5)
        ring = polygon(6, 30) * r
        outer = np.stack([np.column_stack([ring[:, 0], np.full(6, y), ring[:, 1]]) for y in (-d / 2, d / 2)])
        inner = outer * (draw.between(0.82, 0.94), 1.0, draw.between(0.82, 0.94))
        cell = quad_grid(np.stack([outer[0], outer[1], inner[1], inner[0]]), wrap_rows=True, wrap_columns=True)
        across, up = np.meshgrid(np.arange(columns), np.arange(rows), indexing="ij")
        spots = np.stack([(across + 0.5 * (up % 2)) * 3**0.5 * r, 0.0 * up, r + 1.5 * r * up], axis=2).reshape(-1, 3)
        return repeated(cell, spots[(spots[:, 2] < 2 * r) | (draw.rng.random(len(spots)) < 0.8)])
    if kind == "tree":
        parts = [cuboid((-0.06, -d / 2, 0), (0.06, d / 2, h)), cuboid((-0.35, -d / 2, 0), (0.35, d / 2, 0.04))]
        for i, z in enumerate(np.linspace(0.3, h - 0.15, draw.whole(4, 7))):
            s, reach, lift = 1 if i % 2 else -1, draw.between(0.25, 0.65), draw.between(0.02, 0.3)
            parts.append(bar((0, 0, z), (s * reach, 0, z + lift), d, t))
            at = np.array([0.3, 0.42, 0.54])[:, None] * (s * reach, 0, lift)
            parts.append(repeated(cuboid((-0.02, 0.02 - d / 2, z), (0.015, d / 2 - 0.04, z + 0.2)), at))
        return join(parts)
    body = case(draw, (w, d), (0.0, h), t, draw.whole(1, 3), draw.whole(3, 5), draw.between(0.2, 0.8), 0.5)
    points = body.points.copy()
    points[:, 0] *= 1 - draw.between(0.15, 0.65) * points[:, 2] / h
    points[:, 0] += draw.between(-0.35, 0.35) * points[:, 2]
    return body.warped(points)


def _hung(draw: Draw) -> MeshPart:
    """Boards or boxes with brackets, for a wall that is not modelled."""
    d, t = draw.between(0.18, 0.34), draw.between(0.018, 0.055)
    w, gap = draw.between(0.5, 1.7), draw.between(0.25, 0.48)
    boxed, rails, count, y = draw.chance(0.35), draw.chance(0.5), draw.whole(2, 6), d / 2
    parts = []
    for z in gap * np.arange(count):
        x, shift = w * draw.between(0.25, 0.5), 0.0 if rails else draw.between(-0.25, 0.25) * w
        if boxed:
            parts.append(case(draw, (2 * x, d), (z, z + gap * 0.85), t, draw.whole(1, 3), 1, 0.5, 0.5).at(shift))
            continue
        parts.append(cuboid((shift - x, -y, z), (shift + x, y, z + t), edge=draw.pick((0.0, 0.008))))
        parts.append(pair(bar((0.7 * x, y, z - 0.14), (0.7 * x, -y / 2, z), 0.015, 0.02)).at(shift))
        parts += contents(draw, (shift - x, -y, z + t), (shift + x, y, z + gap * 0.85), 0.7)
    if rails:
        parts.append(pair(cuboid((0.2 * w, y, -0.15), (0.2 * w + 0.03, y + 0.015, count * gap))))
    return join(parts)


def _curved(draw: Draw) -> MeshPart:
    """A shelf with an arch, bowed ends, one bent board or wavy sides."""
    w, d, h = draw.between(0.5, 1.4), draw.between(0.22, 0.42), draw.between(1.2, 2.2)
    t, rows, n = draw.between(0.018, 0.04), draw.whole(3, 6), draw.round(12)
    kind = draw.pick(("arch", "ends", "bent", "wave"))
    x, y, levels = w / 2, d / 2, np.linspace(0.0, h - t, rows + 1)
    if kind == "arch":
        angle = np.linspace(0, 180, n)
        rise = draw.between(0.15, 0.5) * w * sind(angle)
        arc = np.column_stack([(x - t / 2) * cosd(angle), 0 * angle, h - 0.02 + rise])
        net = np.stack([arc - (0, y, 0), arc - (0, -y, 0)])
        back = quad_grid(np.stack([net[1], net[1] * (1, 1, 0) + [0, 0, h - 0.02]]))
        body = case(draw, (w, d), (0.0, h), t, draw.whole(1, 2), rows, book_fill(draw), 0.8)
        return join([body, shell(net, t), back])
    if kind == "ends":
        half = draw.between(0.15, 0.4)
        curve = smooth([(0, y), (0.7 * half, 0.8 * y), (half, -0.2 * y), (0.6 * half, -0.84 * y), (0, -y)], n)
        ends = repeated(prism(np.vstack([curve, [0, 0]]), 0, t).at(x), along("z", levels))
        return case(draw, (w, d), (0.0, h), t, draw.whole(1, 2), rows, book_fill(draw), 0.8) + pair(ends)
    if kind == "bent":
        corners = [(x, 0, 0), (x, 0, t)]
        for i, z in enumerate(levels[1:]):
            s = -1 if i % 2 else 1
            corners += [(s * x, 0, z + t), (-s * x, 0, z + t)]
        parts = [shell(bent(corners, 0.06, 3)[:, None] + along("y", [-y, y]), t)]
        parts.append(pair(bar((0.94 * x, y - 0.02, 0), (0.94 * x, y - 0.02, h), 0.02, 0.02)))
        for z, above in pairwise(levels):
            parts += contents(draw, (-0.8 * x, -y, z + 2 * t), (0.7 * x, y, above), 0.4)
        return join(parts)
    z = np.linspace(0, h, draw.round(22))
    sway = draw.between(0.04, 0.2) * np.sin(z / h * 2 * np.pi * draw.pick((0.5, 1, 1.5)))
    side = np.stack([np.column_stack([x + sway, np.full(len(z), k), z]) for k in (-y, y)])
    at = np.column_stack([np.interp(levels, z, sway), 0 * levels, levels])
    low, high = at - (x, y, 0), at + np.array((x, y, t))
    return join([shell(side, t), shell(side - [w, 0, 0], t), boxes(low, high)])


STYLES = (
    _plain, _classic, _cubes, _doored, _ladder, _rack, _low, _stairs, _plain, _corner, _zigzag, _hung, _classic,
    _curved, _tower,
)  # fmt: skip
