"""What bottles are made of: closures, inner walls, labels, handles. Upright, decimetres."""

import numpy as np
from numpy.typing import ArrayLike

from zbuf_occlude.arrays import FloatArray
from zbuf_occlude.shapes.curves import bent, circle, cosd, sind, smooth
from zbuf_occlude.shapes.draw import Draw
from zbuf_occlude.shapes.kit import MeshPart, cylinder, ellipsoid, join, quad_grid, revolve, tube


def rounded(profile: ArrayLike, draw: Draw) -> FloatArray:
    """Return a profile of (radius, z) corners with its corners rounded a little, as glass is."""
    return bent(profile, draw.between(0.03, 0.12), max(2, draw.round(5) - 2))


def notched(count: int, depth: float) -> FloatArray:
    """Return a circle whose every other point stands out by `depth`: ribs, teeth, flutes."""
    return circle(count) * np.where(np.arange(count) % 2, 1.0, 1.0 + depth)[:, None]


def closure(draw: Draw, r: float, z: float, kind: str) -> MeshPart:
    """Return what closes a neck of radius r whose mouth is at height z."""
    n = draw.round(20)
    if kind == "cork":
        return cylinder(0.92 * r, z - 0.2, z + draw.between(0.05, 0.3), n, r * draw.between(0.92, 1.2))
    if kind == "crown":
        return revolve([(1.15 * r, z - 0.06), (1.02 * r, z + 0.06), (0, z + 0.08)], 42, notched(42, 0.1))
    if kind == "screw":
        half = draw.between(0.06, 0.22)
        ribs = notched(2 * draw.round(16), 0.05)
        return revolve([(1.15 * r, z - half), (1.15 * r, z + half), (0, z + half)], 0, ribs)
    if kind == "ball":
        s = draw.between(1.1, 2.2) * r
        return ellipsoid((0, 0, z + 0.9 * s), (s, s, s), n) + cylinder(0.9 * r, z - 0.15, z + 0.2, n)
    if kind == "cone":
        tip = z + draw.between(0.3, 0.85)
        return revolve([(1.1 * r, z - 0.05), (1.1 * r, z + 0.08), (0.25 * r, tip), (0.0, tip + 0.03)], n)
    if kind == "flip":
        lid = cylinder(1.25 * r, 0, 0.05, n).at(y=-1.25 * r).turned("x", -draw.between(0, 110))
        return cylinder(1.25 * r, z - 0.15, z + 0.15, n) + lid.at(0, 1.25 * r, z + 0.17)
    if kind == "foil":
        return revolve([(1.06 * r, z - 1.0), (1.08 * r, z - 0.1), (1.22 * r, z), (1.1 * r, z + 0.12), (0, z + 0.14)], n)
    return revolve([(1.15 * r, z - 0.12), (1.22 * r, z - 0.06), (1.15 * r, z), (0.8 * r, z)], n)


def glass(draw: Draw, profile: FloatArray, closures: tuple[str, ...], section: FloatArray | None = None) -> MeshPart:
    """Return a bottle from its profile: outer skin, sometimes inner skin and label, and one of the closures."""
    n = draw.round(28)
    parts = [revolve(profile, n, section)]
    kind = draw.pick(closures)
    if kind == "open" or draw.chance(0.15):
        wall = draw.between(0.02, 0.05)
        inner = np.maximum(profile - (wall, 0), (0.02, profile[:, 1].min() + 2 * wall))
        parts.append(revolve(inner, n, section))
    if kind != "open":
        parts.append(closure(draw, float(profile[-1, 0]), float(profile[-1, 1]), kind))
    if section is None and draw.chance(0.4):
        parts.append(label(draw, profile))
    return join(parts)


def label(draw: Draw, profile: FloatArray) -> MeshPart:
    """Return paper around part of the belly: a second sheet just off the glass."""
    height = np.ptp(profile[:, 1])
    low = profile[:, 1].min() + draw.between(0.12, 0.25) * height
    z = np.linspace(low, low + draw.between(0.1, 0.28) * height, 6)
    order = np.argsort(profile[:, 1], kind="stable")
    r = np.interp(z, profile[order, 1], profile[order, 0])[:, None] * 1.012 + 0.004
    angle = np.linspace(-90, draw.pick((90, 180, 270)), draw.round(24))
    return quad_grid(np.stack([r * cosd(angle), r * sind(angle), z[:, None] * np.ones(len(angle))], axis=2))


def handle(draw: Draw, low: tuple[float, float], high: tuple[float, float], out: float, thick: float) -> MeshPart:
    """Return an ear in the xz plane from the point (x, z) `low` to the point `high`, standing off by `out`."""
    (x0, z0), (x1, z1) = low, high
    x = max(x0, x1) + out
    knots = [(x0 - 0.03, 0, z0), (x, 0, 0.6 * z0 + 0.4 * z1), (x, 0, 0.15 * z0 + 0.85 * z1), (x1 - 0.03, 0, z1)]
    return tube(smooth(knots, draw.round(14)), thick, draw.round(8), flat=draw.pick((1.0, 0.6)))
