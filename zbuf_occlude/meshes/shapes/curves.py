"""Curves and outlines for the modelling kit, as rows of points."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from zbuf_occlude.base.arrays import FloatArray


def cosd(degrees: ArrayLike) -> Any:
    """Return the cosine of an angle in degrees."""
    return np.cos(np.radians(degrees))


def sind(degrees: ArrayLike) -> Any:
    """Return the sine of an angle in degrees."""
    return np.sin(np.radians(degrees))


def circle(count: int, start: float = 0.0) -> FloatArray:
    """Return points of the unit circle, (count, 2), the first at `start` degrees."""
    angle = start + 360.0 * np.arange(count) / count
    return np.stack([cosd(angle), sind(angle)], axis=1)


def superellipse(count: int, power: float, start: float = 0.0) -> FloatArray:
    """Return points of abs(x)^power + abs(y)^power = 1, (count, 2): 2 is a circle, 10 nearly a square."""
    xy = circle(count, start)
    return xy / (np.abs(xy) ** power).sum(axis=1, keepdims=True) ** (1.0 / power)


def polygon(sides: int, start: float = 0.0, per_side: int = 1) -> FloatArray:
    """Return points of a regular polygon with corners on the unit circle, (sides * per_side, 2)."""
    corners = circle(sides, start)
    t = np.arange(per_side)[:, None] / per_side
    following = np.roll(corners, -1, axis=0)
    return ((1 - t) * corners[:, None] + t * following[:, None]).reshape(-1, 2)


def rectangle(width: float, depth: float, radius: float = 0.0, steps: int = 4) -> FloatArray:
    """Return a rectangle about the origin with round corners, (4 * (steps + 1), 2), or (4, 2) without radius."""
    half = np.array([width, depth]) / 2.0
    signs = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
    if radius <= 0.0:
        return signs * half
    r = min(radius, 0.999 * half.min())
    angle = 90.0 * (np.arange(4)[:, None] + np.arange(steps + 1) / steps)
    rounding = np.stack([cosd(angle), sind(angle)], axis=2) * r
    return ((signs * (half - r))[:, None] + rounding).reshape(-1, 2)


def smooth(points: ArrayLike, count: int) -> FloatArray:
    """Return `count` points of the Catmull-Rom curve through control points (m, d), equally many on each span."""
    p = np.asarray(points, dtype=np.float64)
    padded = np.vstack([2 * p[0] - p[1], p, 2 * p[-1] - p[-2]])
    t = np.linspace(0.0, len(p) - 1.0, count)
    span = np.minimum(t.astype(int), len(p) - 2)
    t = (t - span)[:, None]
    a, b, c, d = (padded[span + k] for k in range(4))
    return 0.5 * (2 * b + (c - a) * t + (2 * a - 5 * b + 4 * c - d) * t**2 + (3 * b - a - 3 * c + d) * t**3)


def bent(points: ArrayLike, radius: float, steps: int = 4) -> FloatArray:
    """Return a polyline (m, d) with inner corners rounded like bent pipe, (2 + (m - 2) * (steps + 1), d)."""
    p = np.asarray(points, dtype=np.float64)
    before, corner, after = p[:-2], p[1:-1], p[2:]
    into, out = corner - before, after - corner
    length_in, length_out = (np.linalg.norm(a, axis=1, keepdims=True) for a in (into, out))
    reach = np.minimum(radius, 0.49 * np.minimum(length_in, length_out))
    start, end = corner - reach * into / length_in, corner + reach * out / length_out
    t = np.linspace(0.0, 1.0, steps + 1)[:, None]
    arcs = (1 - t) ** 2 * start[:, None] + 2 * t * (1 - t) * corner[:, None] + t**2 * end[:, None]
    return np.concatenate([p[:1], arcs.reshape(-1, p.shape[1]), p[-1:]])


def path_frames(path: FloatArray, *, closed: bool = False) -> tuple[FloatArray, FloatArray]:
    """Return two unit vectors across a path (m, 3) at each of its points, (m, 3) each, without twist.

    The first vector is transported from point to point, since no fixed reference direction suits every path.
    """
    ends = np.concatenate([path[-1:], path, path[:1]]) if closed else np.concatenate([path[:1], path, path[-1:]])
    steps = np.diff(ends, axis=0)
    lengths = np.linalg.norm(steps, axis=1, keepdims=True)
    units = np.divide(steps, lengths, out=np.zeros_like(steps), where=lengths > 0)
    along = units[:-1] + units[1:]
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-12)
    first = np.empty_like(path)
    # the first side of a bar along z is along x, that of a level bar is level
    carried = np.array([1.0, 0.0, 0.0]) if abs(along[0, 2]) > 0.9 else np.array([-along[0, 1], along[0, 0], 0.0])
    for i, tangent in enumerate(along):
        carried = carried - tangent * (carried @ tangent)
        carried = carried / max(float(np.sqrt(carried @ carried)), 1e-12)
        first[i] = carried
    return first, np.cross(along, first)
