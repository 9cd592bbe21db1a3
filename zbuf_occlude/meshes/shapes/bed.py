"""Beds: platform, panelled, four-poster, bunk, sleigh, divan and more. Head towards +y, metres."""

import numpy as np

from zbuf_occlude.meshes.shapes.curves import bent, cosd, rectangle, sind, smooth, superellipse
from zbuf_occlude.meshes.shapes.draw import Draw
from zbuf_occlude.meshes.shapes.furniture import drawers, four_legs, frame, leg
from zbuf_occlude.meshes.shapes.kit import (
    MeshPart,
    along,
    bar,
    cuboid,
    cylinder,
    ellipsoid,
    four,
    join,
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

HEADS = ("panel", "panel", "arched", "slats", "metal", "tufted", "framed")


# ---- bedding ------------------------------------------------------------------------------------------------------


def pillows(draw: Draw, w: float, d: float, z: float) -> MeshPart:
    """Return cushions at the head of a mattress w by d whose top is at z: one or two rows, flat or leaning."""
    count = 1 if w < 1.15 else draw.pick((2, 2, 3))
    deep, high, n, power = draw.between(0.3, 0.55), draw.between(0.1, 0.25), draw.round(11), draw.between(2.5, 6)
    lean, x = draw.pick((0.0, 0.0, draw.between(30, 70))), (np.arange(count) - (count - 1) / 2) * 0.96 * w / count
    parts = []
    for row in range(draw.pick((1, 1, 2))):
        tilt = lean * (1 - 0.5 * row)
        one = pillow((0.86 * w / count, deep, high), n, power).turned("x", tilt)
        y = d / 2 - deep * (0.6 if lean == 0 else 0.35) - row * deep * 0.55
        lift = high * (0.4 + 0.3 * row) + 0.5 * deep * sind(tilt)
        parts += [one.turned("z", draw.between(-6, 6)).at(a, y, z + lift) for a in x]
    return join(parts)


def blanket(draw: Draw, w: float, d: float, z: float, drop: float) -> MeshPart:
    """Return a cover on a mattress that hangs over its sides in folds: one open sheet just above the mattress."""
    fold, waves, reach, off = draw.between(0.0, 0.03), draw.between(4, 14), draw.between(0.45, 0.85), 0.012
    y = np.linspace(-d / 2 - off, -d / 2 + reach * d, draw.round(22))
    side = w / 2 + off
    across = np.concatenate([[-side] * 3, np.linspace(-0.46, 0.46, draw.round(8)) * w, [side] * 3])
    down = np.zeros(len(across))
    down[[0, -1]], down[[1, -2]] = drop, drop / 2
    x, v = np.meshgrid(across, y, indexing="ij")
    hang = np.broadcast_to(down[:, None], x.shape)
    ripple = np.abs(fold * np.sin(2 * np.pi * waves * (v / d + 0.5)) * hang / drop)
    net = np.stack([x + np.sign(x) * ripple, v, z + off - hang + 0.3 * fold * np.sin(3 * x + 5 * v)], axis=2)
    front = np.stack([net[3:-3, 0] - [0, 0, k] for k in (0.0, drop / 2, drop)])
    return quad_grid(net) + quad_grid(front)


def mattress(draw: Draw, w: float, d: float, z: float, high: float) -> MeshPart:
    """Return a mattress from z upwards with random pillows, cover or folded throw."""
    edge, steps = draw.between(0.02, 0.08), draw.whole(1, 4)
    parts = [cuboid((-w / 2, -d / 2, z), (w / 2, d / 2, z + high), edge, steps)]
    if draw.chance(0.85):
        parts.append(pillows(draw, w, d, z + high))
    if draw.chance(0.55):
        parts.append(blanket(draw, w, d, z + high, draw.between(0.4, 1.3) * high))
    elif draw.chance(0.4):
        y, x = -d / 2 + draw.between(0.1, 0.5), w / 2 + 0.02
        parts.append(cuboid((-x, y, z + 0.3 * high), (x, y + draw.between(0.25, 0.7), z + high + 0.02), edge=0.015))
    return join(parts)


# ---- boards at head and foot: in the xz plane, from the floor ----------------------------------------------------


def board(draw: Draw, kind: str, w: float, h: float) -> MeshPart:
    """Return a board of one of the kinds in `HEADS`, w wide and h high; its filling begins at a third of the height."""
    return _BOARDS[kind](draw, w, h, draw.between(0.2, 0.4) * h)


def _panel(draw: Draw, w: float, h: float, low: float) -> MeshPart:
    t, post = draw.between(0.03, 0.08) / 2, draw.between(0.04, 0.1)
    filling = cuboid((-w / 2, -t, draw.pick((0.0, low))), (w / 2, t, h), edge=draw.pick((0.0, 0.01)))
    return filling + pair(cuboid((w / 2 - post, -t, 0), (w / 2, t, h + draw.pick((-0.01, 0.05)))))


def _arched(draw: Draw, w: float, h: float, low: float) -> MeshPart:
    t, post, x = draw.between(0.03, 0.08), draw.between(0.04, 0.09), np.linspace(-w / 2, w / 2, draw.round(18))
    rise = draw.between(0.1, 0.4) * h * (cosd(180 * x / w) if draw.chance(0.6) else 1 - np.abs(2 * x / w) ** 3)
    net = np.zeros((2, len(x), 3))
    net[..., 0], net[0, :, 2], net[1, :, 2] = x, low, 0.85 * h + rise
    return shell(net, t) + pair(cuboid((w / 2 - post, -t, 0), (w / 2 + 0.2 * post, t, 0.9 * h), edge=0.01))


def _slats(draw: Draw, w: float, h: float, low: float) -> MeshPart:
    t, post, count = draw.between(0.03, 0.06) / 2, draw.between(0.04, 0.09), draw.whole(5, 14)
    half = draw.between(0.2, 0.75) * w / count / 2
    x = np.linspace(-w / 2 + post, w / 2 - post, count + 2)[1:-1]
    bars = repeated(cuboid((-half, -t / 2, low), (half, t / 2, h - 0.05)), along("x", x))
    rails = cuboid((-w / 2, -t, h - 0.1), (w / 2, t, h)) + cuboid((-w / 2, -t, low), (w / 2, t, low + 0.06))
    return rails + bars + pair(leg(draw, draw.pick(("square", "turned")), h + draw.between(0, 0.12), post).at(w / 2))


def _metal(draw: Draw, w: float, h: float, low: float) -> MeshPart:
    r, n, count = draw.between(0.012, 0.025), draw.round(8), draw.whole(4, 11)
    corners = [(-w / 2, 0, 0), (-w / 2, 0, h), (w / 2, 0, h), (w / 2, 0, 0)]
    hoop = bent(corners, draw.between(0.05, 0.49) * h, draw.round(6))
    top = h - 0.02 if draw.chance(0.5) else draw.between(0.6, 0.85) * h
    bars = [rod((x, 0, low), (x, 0, top), 0.5 * r, 6) for x in np.linspace(-w / 2, w / 2, count + 2)[1:-1]]
    rails = [rod((-w / 2, 0, z), (w / 2, 0, z), 0.8 * r, n) for z in (low, top)]
    balls = pair(ellipsoid((w / 2, 0, h), (2.2 * r,) * 3, draw.round(10)))
    return join([tube(hoop, r, n), balls, *bars, *rails])


def _tufted(draw: Draw, w: float, h: float, low: float) -> MeshPart:
    t, columns, rows = draw.between(0.03, 0.1), draw.whole(4, 8), draw.whole(2, 4)
    soft = cuboid((-w / 2, -t, low), (w / 2, t, h), edge=0.9 * t, steps=draw.whole(2, 4))
    i, j = np.meshgrid(np.arange(columns), np.arange(rows), indexing="ij")
    x, z = ((i + 0.5 + 0.25 * (j % 2)) / columns - 0.5) * w, low + (j + 0.5) / rows * (h - low)
    spots = np.stack([x, np.full(x.shape, -t), z], axis=2).reshape(-1, 3)
    buttons = repeated(ellipsoid((0, 0, 0), (0.022, 0.012, 0.022), 8), spots)
    return soft + buttons + pair(cuboid((w / 2 - 0.1, -0.02, 0), (w / 2 - 0.05, 0.02, low + 0.1)))


def _framed(draw: Draw, w: float, h: float, low: float) -> MeshPart:
    t, post, count = draw.between(0.03, 0.07), draw.between(0.04, 0.09), draw.whole(2, 4)
    one = frame(w / count * 0.96, h - low, 0.06, t).at(z=low)
    panels = repeated(one, along("x", (np.arange(count) - (count - 1) / 2) * w / count))
    crown = cuboid((-w / 2 - 0.04, -t, h), (w / 2 + 0.04, t, h + draw.between(0.03, 0.1)), edge=0.012)
    posts = pair(cuboid((w / 2 - post, -t / 2, 0), (w / 2, t / 2, h)))
    return join([panels, cuboid((-w / 2, 0, low), (w / 2, t / 4, h)), crown, posts])


_BOARDS = {
    "panel": _panel, "arched": _arched, "slats": _slats, "metal": _metal, "tufted": _tufted, "framed": _framed
}  # fmt: skip


# ---- below the mattress ------------------------------------------------------------------------------------------


def size(draw: Draw) -> tuple[float, float]:
    """Return width and length of a mattress for one or two."""
    return draw.pick((0.85, 1.0, 1.2, 1.4, 1.6, 1.85)) * draw.between(0.95, 1.05), draw.between(1.8, 2.2)


def base(draw: Draw, w: float, d: float, z: float, high: float) -> MeshPart:
    """Return side rails from z - high to z on legs, a plinth or a closed box with drawers."""
    kind, t, x, y = draw.pick(("legs", "legs", "box", "drawers", "plinth")), 0.03, w / 2, d / 2
    rails = pair(cuboid((x - t, -y, z - high), (x + 0.01, y, z + 0.03)))
    rails = rails + pair(cuboid((-x, y - t, z - high), (x, y, z + 0.03)), "y")
    if kind == "legs":
        slats = repeated(cuboid((-x, 0, z - 0.02), (x, 0.6 * d / 12, z)), along("y", np.linspace(-y, y, 13)[:-1]))
        shape = draw.pick(("square", "tapered", "round", "conical", "turned"))
        legs = four_legs(draw, shape, x - 0.05, y - 0.05, z - high + 0.02, draw.between(0.05, 0.09))
        return join([rails, slats, legs])
    if kind == "plinth":
        inset = draw.between(0.05, 0.2)
        return rails + cuboid((inset - x, inset - y, 0), (x - inset, y - inset, z))
    body = cuboid((-x, -y, 0), (x, y, z))
    if kind == "box":
        return body
    side = drawers(draw, (-y, -x, 0.03), (y, 0, z), 1, draw.whole(2, 4))
    return body + side.turned("z", 90 * draw.pick((1, -1)))


# ---- styles --------------------------------------------------------------------------------------------------------


def _panelled(draw: Draw) -> MeshPart:
    w, d = size(draw)
    z, h, kind = draw.between(0.18, 0.5), draw.between(0.65, 1.5), draw.pick(HEADS)
    parts = [base(draw, w, d, z, draw.between(0.06, 0.24))]
    parts.append(mattress(draw, w - 0.06, d - 0.06, z - 0.02, draw.between(0.12, 0.34)))
    parts.append(board(draw, kind, w + draw.between(0.0, 0.12), h).at(y=d / 2 + 0.03))
    if draw.chance(0.6):
        parts.append(board(draw, draw.pick((kind, "panel")), w + 0.05, draw.between(0.35, 0.9)).at(y=-d / 2 - 0.03))
    return join(parts)


def _platform(draw: Draw) -> MeshPart:
    """A low flat bed; the deck may extend on all sides, the head may be a wide wall."""
    w, d = size(draw)
    z, out, x, y = draw.between(0.1, 0.35), draw.between(0.02, 0.35), w / 2, d / 2
    deck = cuboid((-x - out, -y - out, z - 0.08), (x + out, y + 0.02, z), edge=draw.pick((0.0, 0.02)))
    parts = [deck, mattress(draw, w, d, z, draw.between(0.12, 0.32))]
    foot = draw.pick(("plinth", "legs", "blocks"))
    if foot == "plinth":
        parts.append(cuboid((0.1 - x, 0.1 - y, 0), (x - 0.1, y - 0.1, z)))
    elif foot == "legs":
        parts.append(four_legs(draw, draw.pick(("square", "conical", "round")), x - 0.05, y - 0.05, z - 0.06, 0.06))
    else:
        parts.append(pair(cuboid((-x, y - 0.5, 0), (x, y - 0.3, z - 0.05)), "y"))
    if draw.chance(0.7):
        wide = w + 2 * out + draw.pick((0.0, draw.between(0.4, 1.1)))
        head = board(draw, draw.pick(("panel", "tufted", "panel", "framed")), wide, draw.between(0.45, 1.2))
        parts.append(head.at(y=y + 0.06))
        if wide > w + 2 * out + 0.3 and draw.chance(0.6):  # shelves beside the bed
            parts.append(pair(cuboid((x + out + 0.02, y - 0.4, z), (wide / 2, y + 0.03, z + 0.2))))
    return join(parts)


def _four_poster(draw: Draw) -> MeshPart:
    """Posts with a canopy frame, a cloth over it, curtains at the corners."""
    w, d = size(draw)
    z, top, t, x, y = draw.between(0.25, 0.55), draw.between(1.4, 2.5), draw.between(0.04, 0.14), w / 2, d / 2
    post = leg(draw, draw.pick(("square", "turned", "tapered", "round")), top, t)
    parts = [base(draw, w, d, z, 0.15), mattress(draw, w - 0.06, d - 0.06, z, draw.between(0.14, 0.32))]
    parts.append(four(post.at(x, y)))
    parts.append(board(draw, draw.pick(HEADS), w, draw.between(0.8, 1.4)).at(y=y))
    canopy = draw.pick(("frame", "cloth", "domed", "posts", "curtains", "curtains"))
    if canopy == "posts":
        parts.append(four(ellipsoid((x, y, top + 0.04), (0.05, 0.05, 0.07), draw.round(10))))
        return join(parts)
    s = 0.7 * t
    parts.append(pair(bar((x, -y, top - s / 2), (x, y, top - s / 2), s, s)))
    parts.append(pair(bar((-x, y, top - s / 2), (x, y, top - s / 2), s, s), "y"))
    if canopy in ("cloth", "domed"):
        u, v = np.meshgrid(np.linspace(-1, 1, draw.round(11)), np.linspace(-1, 1, draw.round(11)), indexing="ij")
        lift = -0.06 if canopy == "cloth" else draw.between(0.15, 0.45)
        parts.append(quad_grid(np.stack([u * x, v * y, top + 0.005 + lift * (1 - u**2) * (1 - v**2)], axis=2)))
        edge = rectangle(w, d, 0.02, 3)
        ring = np.column_stack([edge, np.full(len(edge), top)])
        valance = np.stack([ring, ring * (1.02, 1.02, 1) - [0, 0, draw.between(0.08, 0.3)]])
        parts.append(quad_grid(valance, wrap_columns=True))
    if canopy == "curtains":
        length, waves, u = draw.between(0.2, 0.7), draw.whole(3, 6), np.linspace(0, 1, draw.round(28))
        gather = 1 - draw.between(0.0, 0.6) * np.exp(-(((np.linspace(0, 1, 7)[:, None] - 0.55) / 0.25) ** 2))
        net = np.empty((7, len(u), 3))
        net[..., 0] = x + 0.04 * np.sin(2 * np.pi * waves * u)
        net[..., 1], net[..., 2] = y - length * u * gather, np.linspace(top, 0.05, 7)[:, None]
        parts.append(four(quad_grid(net)))
    return join(parts)


def _bunk(draw: Draw) -> MeshPart:
    """A bunk bed with a ladder, or a loft bed over a desk."""
    w, d, loft = draw.between(0.8, 1.4), draw.between(1.8, 2.15), draw.chance(0.35)
    low, high, t = draw.between(0.2, 0.5), draw.between(1.1, 1.7), draw.between(0.035, 0.1)
    top, x, y = high + draw.between(0.3, 0.55), w / 2, d / 2
    if draw.chance(0.35):
        parts = [four(rod((x, y, 0), (x, y, top), 0.025, draw.round(8)))]
    else:
        parts = [four(cuboid((x - t, y - t, 0), (x, y, top)))]
    for z in (high,) if loft else (low, high):
        parts.append(pair(cuboid((x - 0.03, -y, z - 0.1), (x, y, z + 0.04))))
        parts.append(pair(cuboid((-x, y - 0.03, z - 0.1), (x, y, z + 0.04)), "y"))
        parts.append(mattress(draw, w - 0.08, d - 0.08, z, draw.between(0.1, 0.2)))
    for z in (high + 0.2, top - 0.04):  # guard rails, with a gap for the ladder
        parts.append(pair(cuboid((-x, y - 0.025, z), (x, y, z + 0.05)), "y"))
        parts += [cuboid((-x, -y, z), (0.025 - x, y, z + 0.05)), cuboid((x - 0.025, 0.5 - y, z), (x, y, z + 0.05))]
    if loft:
        parts.append(cuboid((0.04 - x, 0.5 - y, 0.7), (w * 0.2, y - 0.05, 0.73)))
        parts.append(cuboid((0.04 - x, 0.05 - y, 0), (0, 0.5 - y, 0.73)))
    else:
        spots = np.linspace(-x, x, draw.whole(3, 7) + 2)[1:-1]
        slats = repeated(cuboid((-0.02, y - 0.03, low), (0.02, y, low + 0.5)), along("x", spots))
        parts.append(pair(slats + cuboid((-x, y - 0.03, low + 0.45), (x, y, low + 0.5)), "y"))
    if draw.chance(0.25):  # stairs with drawers
        steps = draw.whole(4, 6)
        for i in range(steps):
            z = (steps - i) * high / (steps + 1)
            parts.append(cuboid((-x, -y - 0.28 * (i + 1), 0), (0.1 * x, -y - 0.28 * i, z)))
        return join(parts)
    foot, near, far, rise = x + 0.03, 0.08 - y, 0.42 - y, high + 0.15
    lean = draw.between(0.02, 0.45)
    parts += [bar((foot + lean, at, 0), (foot, at, rise), 0.05, 0.03) for at in (near, far)]
    for s in np.linspace(0, 1, draw.whole(4, 6) + 2)[1:-1]:
        across = foot + lean * (1 - s)
        parts.append(bar((across, near, s * rise), (across, far, s * rise), 0.04, 0.03))
    return join(parts)


def _sleigh(draw: Draw) -> MeshPart:
    """A bed whose head and foot roll outwards."""
    w, d = size(draw)
    z, h, n = draw.between(0.25, 0.48), draw.between(0.75, 1.4), draw.round(12)

    def scroll(height: float) -> MeshPart:
        r, out = draw.between(0.04, 0.14), draw.between(0.05, 0.3)
        line = smooth([(0, 0.1), (-0.02, 0.4 * height), (0.4 * out, 0.8 * height), (out + r, height)], n)
        net = np.empty((n, 3, 3))
        net[..., 0], net[..., 1:] = np.array([-0.5, 0, 0.5]) * (w + 0.08), line[:, None]
        roll = cylinder(r, -w / 2 - 0.05, w / 2 + 0.05, draw.round(14)).turned("y", 90)
        return shell(net, draw.between(0.03, 0.07)) + roll.at(0, out + r, height - 0.5 * r)

    parts = [scroll(h).at(y=d / 2), scroll(h * draw.between(0.45, 0.95)).mirrored("y").at(y=-d / 2)]
    parts.append(mattress(draw, w, d - 0.04, z, draw.between(0.14, 0.32)))
    parts.append(pair(cuboid((w / 2, -d / 2, z - draw.between(0.08, 0.25)), (w / 2 + 0.04, d / 2, z + 0.06))))
    kind = draw.pick(("turned", "square", "cabriole"))
    return join([*parts, four_legs(draw, kind, w / 2, d / 2 - 0.03, draw.between(0.1, 0.22), 0.08)])


def _divan(draw: Draw) -> MeshPart:
    """A box, a mattress and little else."""
    w, d = size(draw)
    foot, high, x, y = draw.between(0.03, 0.16), draw.between(0.14, 0.42), w / 2, d / 2
    parts = [cuboid((-x, -y, foot), (x, y, foot + high), edge=draw.between(0.01, 0.04), steps=2)]
    parts.append(mattress(draw, w, d, foot + high, draw.between(0.14, 0.42)))
    parts.append(four_legs(draw, draw.pick(("round", "conical")), x - 0.08, y - 0.1, foot + 0.01, 0.06))
    if draw.chance(0.6):
        parts.append(board(draw, draw.pick(("tufted", "panel", "arched")), w, draw.between(0.7, 1.4)).at(y=y + 0.05))
    if draw.chance(0.35):
        parts.append(drawers(draw, (-x, -y, foot), (x, 0, foot + high), 1, draw.pick((1, 2))))
    return join(parts)


def _daybed(draw: Draw) -> MeshPart:
    """A daybed with boards on three sides, cushions and bolsters."""
    w, d, z, h = draw.between(0.75, 1.15), draw.between(1.75, 2.2), draw.between(0.22, 0.45), draw.between(0.55, 1.05)
    kind = draw.pick(("slats", "panel", "metal", "arched", "framed"))
    ends = board(draw, kind, w, h)
    parts = [ends.at(y=d / 2), ends.at(y=-d / 2), base(draw, w, d, z, 0.12)]
    parts.append(mattress(draw, w - 0.05, d - 0.06, z, draw.between(0.12, 0.28)))
    if draw.chance(0.75):
        parts.append(board(draw, kind, d, h * draw.between(1.0, 1.3)).turned("z", 90).at(-w / 2))
        count, side = draw.whole(1, 4), draw.between(0.34, 0.5)
        cushion = pillow((side, side, 0.16), draw.round(11)).turned("x", 65).turned("z", 90)
        parts.append(
            repeated(cushion.at(0.18 - w / 2, 0, z + 0.38), along("y", (np.arange(count) - (count - 1) / 2) * 0.48))
        )
    if draw.chance(0.4):
        bolster = cylinder(0.1, -0.4 * w, 0.4 * w, draw.round(14)).turned("y", 90)
        parts.append(pair(bolster.at(0, d / 2 - 0.14, z + 0.3), "y"))
    return join(parts)


def _suite(draw: Draw) -> MeshPart:
    """A bed with bedside tables, lamps and a bench, as in some files of ModelNet."""
    w, d = size(draw)
    z, y = draw.between(0.2, 0.45), d / 2
    parts = [base(draw, w, d, z, 0.12), mattress(draw, w - 0.04, d - 0.04, z, draw.between(0.14, 0.34))]
    parts.append(board(draw, draw.pick(HEADS), w, draw.between(0.7, 1.4)).at(y=y + 0.03))
    a, b, c, gap = draw.between(0.34, 0.6), draw.between(0.32, 0.5), draw.between(0.35, 0.7), draw.between(0.02, 0.2)
    low, high = (-a / 2, -b / 2, draw.pick((0.0, 0.15))), (a / 2, b / 2, c)
    unit = [cuboid(low, high), drawers(draw, low, high, draw.whole(1, 3))]
    unit.append(four_legs(draw, "square", a / 2 - 0.03, b / 2 - 0.03, c, 0.04))
    if draw.chance(0.6):
        k = draw.between(0.8, 1.6)
        lamp = revolve([(0.07, 0), (0.02, 0.03), (0.015, 0.25)], draw.round(12))
        lamp = lamp + revolve([(0.15, 0.22), (0.09, 0.4)], draw.round(16))
        unit.append(lamp.scaled(k, k, k).at(z=c))
    spot = join(unit).at(w / 2 + a / 2 + gap, y - b / 2)
    parts.append(pair(spot) if draw.chance(0.7) else spot)
    if draw.chance(0.4):
        seat = cuboid((-0.4 * w, -0.18, 0.36), (0.4 * w, 0.18, 0.46), edge=0.03, steps=2)
        legs = four_legs(draw, "square", 0.37 * w, 0.14, 0.38, 0.05)
        parts.append((seat + legs).at(y=-y - draw.between(0.22, 0.5)))
    return join(parts)


def _round_bed(draw: Draw) -> MeshPart:
    """A round or oval bed with a curved wall behind it."""
    r, z, n = draw.between(0.85, 1.25), draw.between(0.15, 0.45), draw.round(36)
    high, deck = draw.between(0.1, 0.4), r * draw.between(1.0, 1.5)
    oval, power = draw.pick((1.0, draw.between(1.0, 1.35))), draw.pick((2.0, 2.0, 4.0))
    plan = superellipse(n, power)
    parts = [prism(plan * deck, draw.between(0.0, 0.1), z, edge=0.03)]
    parts.append(prism(plan * (r - 0.05), z, z + high, edge=0.05))
    half, h = draw.between(25, 140), draw.between(0.1, 1.1)
    angle, levels = 90 + np.linspace(-half, half, n), np.array([[0.0], [z], [z + h / 2], [z + h]])
    round_off = (np.abs(cosd(angle)) ** power + np.abs(sind(angle)) ** power) ** (1 / power)
    out = (deck + 0.04) * (1 + draw.between(0.0, 0.1) * levels / (z + h)) / round_off
    net = np.stack([out * cosd(angle), out * sind(angle), levels + 0 * angle], axis=2)
    parts += [shell(net, draw.between(0.04, 0.14)), pillows(draw, 1.3 * r, 1.5 * r, z + high)]
    return join(parts).scaled(y=oval)


def _crib(draw: Draw) -> MeshPart:
    """A crib with rails on all sides."""
    w, d, z, h = draw.between(0.55, 0.85), draw.between(1.05, 1.5), draw.between(0.2, 0.55), draw.between(0.75, 1.15)
    rails = [cuboid((-d / 2, -0.012, low), (d / 2, 0.012, low + 0.05)) for low in (z - 0.08, h - 0.04)]
    spots = np.linspace(-d / 2, d / 2, draw.whole(9, 18))[1:-1]
    rods = repeated(rod((0, 0, z - 0.05), (0, 0, h - 0.02), 0.009, 6), along("x", spots))
    head = board(draw, draw.pick(("slats", "panel", "arched")), w, h + draw.between(0.0, 0.2))
    side = join([*rails, rods]).turned("z", 90)
    parts = [pair(side.at(w / 2)), head.at(y=d / 2), head.at(y=-d / 2), mattress(draw, w - 0.04, d - 0.04, z, 0.1)]
    if draw.chance(0.3):  # a rocking crib
        y = np.linspace(-0.4, 0.4, draw.round(10))
        runner = tube(np.stack([y, 0 * y, 0.3 * y**2], axis=1), 0.025, 6)
        return join([part.at(z=0.04) for part in parts] + [pair(runner.at(y=d / 2), "y")])
    return join(parts)


def _hospital(draw: Draw) -> MeshPart:
    """A hospital bed with a raised back, rails at the sides, and wheels."""
    w, d, z, lift = draw.between(0.8, 1.05), draw.between(1.9, 2.2), draw.between(0.4, 0.75), draw.between(5, 60)
    x, y, hinge = w / 2, d / 2, draw.between(-0.1, 0.3)
    lying = cuboid((-x, -y, z), (x, hinge, z + 0.14), edge=0.03, steps=2)
    raised = cuboid((-x, 0, 0), (x, y - hinge, 0.14), edge=0.03, steps=2)
    raised = raised + pillow((0.6, 0.4, 0.15), draw.round(11)).at(0, 0.75 * (y - hinge), 0.2)
    hoop = bent([(-x, 0, 0.2), (-x, 0, z + 0.5), (x, 0, z + 0.5), (x, 0, 0.2)], 0.12)
    out, a, b = x + 0.03, draw.between(-0.5, -0.1), draw.between(0.3, 0.7)
    rail = tube(bent([(out, a, z), (out, a, z + 0.35), (out, b, z + 0.35), (out, b, z)], 0.1), 0.014, 8)
    wheel = cylinder(0.07, -0.02, 0.02, draw.round(14)).turned("y", 90).at(x - 0.05, y - 0.15, 0.07)
    leg_post = rod((x - 0.05, y - 0.15, 0.1), (x - 0.05, y - 0.15, z), 0.02, 8)
    parts = [lying, raised.turned("x", lift).at(0, hinge, z), pair(rail), four(wheel + leg_post)]
    parts += [tube(hoop, 0.02, 8).at(y=y + 0.05), tube(hoop, 0.02, 8).scaled(z=draw.between(0.65, 1.0)).at(y=-y)]
    return join([*parts, cuboid((0.05 - x, 0.05 - y, 0.25), (x - 0.05, y - 0.05, 0.33))])


STYLES = (
    _panelled, _platform, _four_poster, _bunk, _sleigh, _divan, _panelled, _suite, _daybed, _panelled, _platform, _crib,
    _four_poster, _round_bed, _hospital,
)  # fmt: skip
