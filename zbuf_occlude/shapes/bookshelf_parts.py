"""What bookshelves are made of: cases, their contents, poles. Front towards -y, metres."""

import numpy as np

from zbuf_occlude.arrays import FloatArray
from zbuf_occlude.shapes.curves import smooth
from zbuf_occlude.shapes.draw import Draw
from zbuf_occlude.shapes.furniture import books
from zbuf_occlude.shapes.kit import MeshPart, along, around, cuboid, join, quad_grid, repeated, revolve, rod

Corner = tuple[float, float, float]


def book_fill(draw: Draw) -> float:
    """Return how full a whole shelf is: empty, half, full."""
    return draw.pick((0.0, draw.between(0.2, 0.6), draw.between(0.7, 1.0)))


def contents(draw: Draw, low: Corner, high: Corner, odds: float) -> list[MeshPart]:
    """Return what stands in one compartment, with some odds: books, a vase, a box."""
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
    """Return sides, boards, upright walls, perhaps a back, and what stands in it.

    `plan` is width and depth, `span` the heights of bottom and top, `odds` those of a compartment being filled,
    `back` those of a back: thin plywood, or one sheet without thickness.
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
