"""What beds are made of: pillows, blankets, mattresses, boards, frames. Head towards +y, metres."""

import numpy as np

from zbuf_occlude.shapes.curves import bent, cosd, sind
from zbuf_occlude.shapes.draw import Draw
from zbuf_occlude.shapes.furniture import drawers, four_legs, frame, leg
from zbuf_occlude.shapes.kit import (
    MeshPart,
    along,
    cuboid,
    ellipsoid,
    join,
    pair,
    pillow,
    quad_grid,
    repeated,
    rod,
    shell,
    tube,
)

HEADS = ("panel", "panel", "arched", "slats", "metal", "tufted", "framed")


# ---- what lies on a bed ------------------------------------------------------------------------------------------


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
    """Return a cover that lies on a mattress and hangs over its sides in folds: one open sheet just above it."""
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
    """Return a mattress from z upwards with pillows, a cover or a folded throw, as it comes."""
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
