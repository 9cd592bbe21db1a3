"""Parts that several pieces of furniture share: legs, rails, cushions, drawers, books."""

import numpy as np

from zbuf_occlude.meshes.shapes.curves import bent, sind, smooth
from zbuf_occlude.meshes.shapes.draw import Draw
from zbuf_occlude.meshes.shapes.kit import (
    MeshPart,
    Point,
    bar,
    boxes,
    cuboid,
    ellipsoid,
    four,
    join,
    pair,
    revolve,
    rod,
    tube,
)


def leg(draw: Draw, kind: str, height: float, thick: float) -> MeshPart:
    """Return one upright leg about the z axis, from the floor to `height`."""
    t = thick / 2.0
    if kind == "square":
        return cuboid((-t, -t, 0), (t, t, height), edge=t * draw.pick((0.0, 0.0, 0.25)))
    if kind == "tapered":
        return bar((0, 0, height), (0, 0, 0), thick, thick, end=draw.between(0.4, 0.7))
    if kind == "round":
        return revolve([(0, 0), (t, 0), (t, height), (0, height)], draw.round(12))
    if kind == "conical":
        low = t * draw.between(0.3, 0.6)
        return revolve([(0, 0), (low, 0), (t, height), (0, height)], draw.round(12))
    if kind == "turned":
        beads = [(0, 0), (0.55, 0), (0.8, 0.04), (0.5, 0.1), (0.62, 0.3), (0.95, 0.55), (1.0, 0.68), (0.6, 0.72),
                 (1.0, 0.76), (1.0, 0.8), (1.0, 1.0), (0, 1.0)]  # fmt: skip
        return revolve(np.array(beads) * (t, height), draw.round(12))
    if kind == "cabriole":
        bow = thick * draw.between(0.5, 1.1)
        points = [(0, 0, height), (-bow, 0, 0.75 * height), (0.2 * bow, 0, 0.3 * height), (-bow, 0, 0)]
        path = smooth(points, draw.round(9))
        radius = t * np.interp(path[:, 2], [0, 0.06 * height, 0.75 * height, height], [0.9, 0.45, 1.1, 0.9])
        return tube(path, radius, draw.round(8)).turned("z", 45)
    reach = thick * draw.between(1.5, 2.5)
    wire = bent([(-reach, 0, height), (0, 0, 0), (reach, 0, height)], 0.06 * height, 3)
    return tube(wire, t * 0.35, draw.round(6)).turned("z", 45)


def splayed(part: MeshPart, height: float, x: float, y: float) -> MeshPart:
    """Return a leg leaned outwards by the angles x and y in degrees; its top at `height` does not move."""
    points = part.points.copy()
    points[:, :2] += (height - points[:, 2:]) * sind([x, y])
    return part.warped(points)


def four_legs(draw: Draw, kind: str, x: float, y: float, height: float, thick: float, splay: float = 0.0) -> MeshPart:
    """Return four legs whose tops stand at (+-x, +-y)."""
    one = splayed(leg(draw, kind, height, thick), height, splay, splay)
    return four(one.at(x, y))


def stretchers(draw: Draw, x: float, y: float, z: float, thick: float, plan: str) -> MeshPart:
    """Return the rails between four legs at height z: "box", "H", "X" or "sides"."""
    t = thick
    side = bar((x, -y, z), (x, y, z), t, t)
    if plan == "sides":
        return pair(side)
    if plan == "box":
        return pair(side) + pair(bar((-x, y, z), (x, y, z), t, t), "y")
    if plan == "H":
        return pair(side) + bar((-x, 0, z), (x, 0, z), t, t)
    return bar((-x, -y, z), (x, y, z), t, t) + bar((x, -y, z), (-x, y, z), t, t)


def frame(width: float, height: float, bar_width: float, depth: float) -> MeshPart:
    """Return a rectangular frame in the xz plane, its lower edge at z = 0, centred in x and y."""
    w, b, d = width / 2.0, bar_width, depth / 2.0
    low = [(-w, -d, 0), (w - b, -d, 0), (-w, -d, 0), (-w, -d, height - b)]
    high = [(-w + b, d, height), (w, d, height), (w, d, b), (w, d, height)]
    return boxes(low, high)


def knob(draw: Draw, at: Point, size: float) -> MeshPart:
    """Return a small handle on a front that looks towards -y: a ball or a bar."""
    x, y, z = at
    if draw.chance(0.5):
        return ellipsoid((x, y - size * 0.6, z), (size, size, size), draw.round(8))
    grip = rod((x - 2.5 * size, y - size, z), (x + 2.5 * size, y - size, z), 0.3 * size, 6)
    return grip + boxes(
        [(x - 2 * size, y - size, z - 0.2 * size), (x + 1.6 * size, y - size, z - 0.2 * size)],
        [(x - 1.6 * size, y, z + 0.2 * size), (x + 2 * size, y, z + 0.2 * size)],
    )


def drawers(draw: Draw, low: Point, high: Point, rows: int, columns: int = 1) -> MeshPart:
    """Return drawer fronts with knobs, slightly in front of the face y = low[1] of a case."""
    (x0, y, z0), (x1, _, z1) = low, high
    dx, dz = (x1 - x0) / columns, (z1 - z0) / rows
    gap, proud = 0.04 * min(dx, dz), 0.03 * min(dx, dz) + 0.004
    parts = []
    for i in range(columns):
        for j in range(rows):
            x, z = x0 + i * dx, z0 + j * dz
            parts.append(cuboid((x + gap, y - proud, z + gap), (x + dx - gap, y + proud, z + dz - gap), edge=proud / 2))
            parts.append(knob(draw, (x + dx / 2, y - proud, z + dz * 0.55), 0.05 * min(dx, dz) + 0.006))
    return join(parts)


def doors(draw: Draw, low: Point, high: Point, count: int) -> MeshPart:
    """Return framed doors with knobs on the face y = low[1] of a case."""
    (x0, y, z0), (x1, _, z1) = low, high
    dx = (x1 - x0) / count
    gap, rail = 0.015 * dx, 0.16 * min(dx, z1 - z0)
    parts = []
    for i in range(count):
        left, right = x0 + i * dx + gap, x0 + (i + 1) * dx - gap
        width, height = right - left, z1 - z0 - 2 * gap
        middle = (left + right) / 2
        parts.append(frame(width, height, rail, 0.02).at(middle, y - 0.01, z0 + gap))
        parts.append(cuboid((left, y - 0.008, z0 + gap), (right, y, z1 - gap)))
        side = right - rail / 2 if i % 2 == 0 and count > 1 else left + rail / 2
        parts.append(knob(draw, (side, y - 0.02, (z0 + z1) / 2), 0.012 + 0.02 * rail))
    return join(parts)


def books(draw: Draw, low: Point, high: Point, fill: float) -> MeshPart:
    """Return a row of upright books between two corners of a shelf, spines towards -y; the last may lean or lie."""
    (x0, y0, z0), (x1, y1, z1) = low, high
    room, depth = z1 - z0, y1 - y0
    mean = draw.between(0.025, 0.05)
    widths = mean * draw.rng.uniform(0.5, 1.7, size=max(1, int((x1 - x0) * fill / mean)))
    edges = x0 + np.concatenate([[0.0], np.cumsum(widths)])
    edges = edges[edges <= x0 + (x1 - x0) * fill]
    count = len(edges) - 1
    parts = []
    if count > 0:
        heights = room * draw.rng.uniform(0.6, 0.95, size=count)
        depths = depth * draw.rng.uniform(0.55, 0.9, size=count)
        lows = np.stack([edges[:-1], y0 + 0.06 * depth + 0.1 * (depth - depths), np.full(count, z0)], axis=1)
        highs = np.stack([edges[1:] - 0.001, lows[:, 1] + depths, z0 + heights], axis=1)
        parts.append(boxes(lows, highs))
    free = x1 - (edges[-1] if len(edges) else x0)
    if free > 0.6 * room and draw.chance(0.5):
        tall = 0.8 * room
        book = cuboid((0, y0 + 0.1 * depth, 0), (0.04, y0 + 0.8 * depth, tall))
        parts.append(book.turned("y", -draw.between(12, 30)).at(edges[-1] + 0.42 * tall, 0, z0))
    elif free > 0.2 and draw.chance(0.5):
        layers = draw.whole(1, 4)
        top = z0 + 0.035 * np.arange(layers)
        shift = draw.rng.uniform(0, 0.02, size=layers)
        lows = np.stack([x1 - 0.18 + shift - 0.02, np.full(layers, y0 + 0.1 * depth), top], axis=1)
        parts.append(boxes(lows, lows + np.array((0.16, 0.7 * depth, 0.033))))
    return join(parts) if parts else cuboid((x0, y0, z0), (x0 + 0.03, y1 - 0.1 * depth, z0 + 0.8 * room))
