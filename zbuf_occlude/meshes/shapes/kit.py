"""A modelling kit: parts of points and triangles, assembled like CAD models on the web.

Parts interpenetrate, touch and stay open: watertight unions are not made.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from zbuf_occlude.base.arrays import BoolArray, FloatArray, IntArray
from zbuf_occlude.meshes.shapes.curves import circle, cosd, path_frames, sind

Point = Sequence[float] | FloatArray
AXES = {"x": 0, "y": 1, "z": 2}


@dataclass(frozen=True, eq=False)
class MeshPart:
    """Points (v, 3) and triangles (f, 3); every operation returns a new part.

    `glass` (f,) is True for the triangles of window panes; None: there are none.
    """

    points: FloatArray
    faces: IntArray
    glass: BoolArray | None = None

    def __add__(self, other: "MeshPart") -> "MeshPart":
        return join([self, other])

    def at(self, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> "MeshPart":
        """Return the part moved by (x, y, z)."""
        return self.warped(self.points + np.array((x, y, z)))

    def scaled(self, x: float = 1.0, y: float = 1.0, z: float = 1.0) -> "MeshPart":
        """Return the part scaled about the origin, axis by axis."""
        return self.warped(self.points * (x, y, z))

    def turned(self, axis: str, degrees: float) -> "MeshPart":
        """Return the part rotated about a coordinate axis through the origin, counter-clockwise seen from its tip."""
        i, j = (AXES[axis] + 1) % 3, (AXES[axis] + 2) % 3
        c, s = cosd(degrees), sind(degrees)
        points = self.points.copy()
        points[:, i] = c * self.points[:, i] - s * self.points[:, j]
        points[:, j] = s * self.points[:, i] + c * self.points[:, j]
        return self.warped(points)

    def mirrored(self, axis: str) -> "MeshPart":
        """Return the part reflected in the coordinate plane across an axis; its winding is reversed, as in much CAD."""
        points = self.points.copy()
        points[:, AXES[axis]] *= -1.0
        return self.warped(points)

    def warped(self, points: FloatArray) -> "MeshPart":
        """Return the part with other points (v, 3) and the same triangles."""
        return MeshPart(points, self.faces, self.glass)

    def glazed(self) -> "MeshPart":
        """Return the part made of glass."""
        return MeshPart(self.points, self.faces, np.ones(len(self.faces), dtype=bool))


def join(parts: Iterable[MeshPart]) -> MeshPart:
    """Return several parts as one; no points are merged."""
    kept = list(parts)
    starts = np.cumsum([0] + [len(part.points) for part in kept[:-1]])
    faces = [part.faces + start for part, start in zip(kept, starts, strict=True)]
    glass = [np.zeros(len(part.faces), dtype=bool) if part.glass is None else part.glass for part in kept]
    panes = None if all(part.glass is None for part in kept) else np.concatenate(glass)
    return MeshPart(np.concatenate([part.points for part in kept]), np.concatenate(faces).astype(np.int32), panes)


def pair(part: MeshPart, axis: str = "x") -> MeshPart:
    """Return the part and its mirror image."""
    return part + part.mirrored(axis)


def four(part: MeshPart) -> MeshPart:
    """Return the part and its mirror images in x, in y and in both: four legs from one."""
    return pair(pair(part, "x"), "y")


def around(part: MeshPart, count: int, start: float = 0.0) -> MeshPart:
    """Return `count` copies turned evenly about the z axis, the first by `start` degrees."""
    return join(part.turned("z", start + 360.0 * i / count) for i in range(count))


def repeated(part: MeshPart, offsets: ArrayLike) -> MeshPart:
    """Return one copy of the part at every offset, (k, 3)."""
    moved = np.asarray(offsets, dtype=np.float64)[:, None, :] + part.points
    starts = np.arange(len(moved))[:, None, None] * len(part.points)
    glass = None if part.glass is None else np.tile(part.glass, len(moved))
    return MeshPart(moved.reshape(-1, 3), (part.faces + starts).reshape(-1, 3).astype(np.int32), glass)


def along(axis: str, values: ArrayLike) -> FloatArray:
    """Return offsets along a coordinate axis, (k, 3), for `repeated`."""
    steps = np.asarray(values, dtype=np.float64)
    offsets = np.zeros((len(steps), 3))
    offsets[:, AXES[axis]] = steps
    return offsets


# ---- surfaces ----------------------------------------------------------------------------------------------------


def quad_grid(points: FloatArray, *, wrap_rows: bool = False, wrap_columns: bool = False) -> MeshPart:
    """Return a grid of points (m, n, 3) with two triangles per cell, without triangles that have two equal corners."""
    m, n = points.shape[:2]
    rows, columns = np.arange(m if wrap_rows else m - 1), np.arange(n if wrap_columns else n - 1)
    i, j = (a.ravel() for a in np.meshgrid(rows, columns, indexing="ij"))
    i_next, j_next = (i + 1) % m, (j + 1) % n
    a, b, c, d = i * n + j, i * n + j_next, i_next * n + j_next, i_next * n + j
    faces = np.stack([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)], axis=1).reshape(-1, 3)
    flat = points.reshape(-1, 3)
    corners = flat[faces]
    same = (corners == np.roll(corners, 1, axis=1)).all(axis=2).any(axis=1)
    return MeshPart(flat, faces[~same].astype(np.int32))


def fan(ring: FloatArray) -> MeshPart:
    """Return the fan of triangles from the mean of a ring of points (n, 3), star-shaped about it, to the ring."""
    n = len(ring)
    i = np.arange(n)
    return MeshPart(
        np.vstack([ring, ring.mean(axis=0)]), np.stack([i, (i + 1) % n, np.full(n, n)], axis=1).astype(np.int32)
    )


def loft(rings: FloatArray, *, caps: str = "both") -> MeshPart:
    """Return the surface through closed rings (m, n, 3); `caps` is "both", "first", "last" or "none"."""
    parts = [quad_grid(rings, wrap_columns=True)]
    if caps in ("both", "first"):
        parts.append(fan(rings[0]))
    if caps in ("both", "last"):
        parts.append(fan(rings[-1]))
    return join(parts)


def shell(points: FloatArray, thickness: float) -> MeshPart:
    """Return a grid of points (m, n, 3) with a thickness, half to either side, and a closed rim."""
    du, dv = np.gradient(points, axis=0), np.gradient(points, axis=1)
    normals = np.cross(du, dv)
    normals /= np.maximum(np.linalg.norm(normals, axis=2, keepdims=True), 1e-12)
    front, back = points + normals * (thickness / 2), points - normals * (thickness / 2)
    rim = [np.concatenate([s[0], s[1:, -1], s[-1, -2::-1], s[-2:0:-1, 0]]) for s in (front, back)]
    return join([quad_grid(front), quad_grid(back), quad_grid(np.stack(rim), wrap_columns=True)])


def revolve(profile: ArrayLike, segments: int, section: FloatArray | None = None) -> MeshPart:
    """Return the surface of revolution of a profile of (radius, z) rows about the z axis; ends of radius 0 are closed.

    `section` (n, 2) replaces the unit circle, for squares, ovals and ribs.
    """
    rz = np.asarray(profile, dtype=np.float64)
    ring = circle(segments) if section is None else section
    points = np.empty((len(rz), len(ring), 3))
    points[..., :2] = rz[:, None, :1] * ring
    points[..., 2] = rz[:, 1:]
    return quad_grid(points, wrap_columns=True)


def tube(path: FloatArray, radius: ArrayLike, segments: int, *, closed: bool = False, flat: float = 1.0) -> MeshPart:
    """Return a round tube along a path (m, 3); `radius` is a number or one per point, `flat` scales the second axis."""
    first, second = path_frames(path, closed=closed)
    r = np.broadcast_to(np.asarray(radius, dtype=np.float64), len(path))[:, None, None]
    ring = circle(segments)
    rings = path[:, None] + r * (ring[:, :1] * first[:, None] + flat * ring[:, 1:] * second[:, None])
    return quad_grid(rings, wrap_rows=True, wrap_columns=True) if closed else loft(rings)


def quartered(points: FloatArray, faces: IntArray) -> tuple[FloatArray, IntArray]:
    """Return points and triangles with every triangle divided into four at the midpoints of its edges."""
    edges = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2), axis=2).reshape(-1, 2)
    unique, which = np.unique(edges, axis=0, return_inverse=True)
    middles = which.reshape(-1, 3) + len(points)
    a, b, c = faces.T
    ab, bc, ca = middles.T
    corners = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    divided = np.concatenate([np.stack(corner, axis=1) for corner in corners])
    return np.concatenate([points, points[unique].mean(axis=1)]), divided.astype(np.int32)


# ---- solids ------------------------------------------------------------------------------------------------------

_BOX_FACES = np.array(
    [[0, 2, 3], [0, 3, 1], [4, 5, 7], [4, 7, 6], [0, 1, 5], [0, 5, 4],
     [2, 6, 7], [2, 7, 3], [0, 4, 6], [0, 6, 2], [1, 3, 7], [1, 7, 5]], dtype=np.int32
)  # fmt: skip
_BOX_CORNERS = np.array([[i & 1, i >> 1 & 1, i >> 2] for i in range(8)], dtype=np.float64)


def boxes(low: ArrayLike, high: ArrayLike) -> MeshPart:
    """Return boxes between the corners low and high, both (k, 3): 12 triangles each."""
    lo, hi = (np.atleast_2d(np.asarray(a, dtype=np.float64)) for a in np.broadcast_arrays(low, high))
    points = lo[:, None] + _BOX_CORNERS * (hi - lo)[:, None]
    starts = 8 * np.arange(len(lo))[:, None, None]
    return MeshPart(points.reshape(-1, 3), (_BOX_FACES + starts).reshape(-1, 3).astype(np.int32))


def cuboid(low: Point, high: Point, edge: float = 0.0, steps: int = 1) -> MeshPart:
    """Return one box; an `edge` above 0 is the width of its bevel (44 triangles), and more `steps` round the bevel."""
    if edge <= 0.0:
        return boxes(low, high)
    lo, hi = np.minimum(low, high), np.maximum(low, high)
    half = (hi - lo) / 2.0
    r = min(edge, 0.999 * half.min())
    quarter = 90.0 * np.arange(steps + 1) / steps
    longitude = (quarter + 90.0 * np.arange(4)[:, None]).ravel()
    latitude = np.concatenate([quarter - 90.0, quarter])
    which = np.repeat(np.arange(4), steps + 1)
    sx, sy = np.array([1, -1, -1, 1])[which], np.array([1, 1, -1, -1])[which]
    sz = np.repeat([-1, 1], steps + 1)
    c = np.where(np.isin(latitude, (-90.0, 90.0)), 0.0, cosd(latitude))[:, None]
    points = np.empty((len(latitude), len(longitude), 3))
    points[..., 0] = sx * (half[0] - r) + r * c * cosd(longitude)
    points[..., 1] = sy * (half[1] - r) + r * c * sind(longitude)
    points[..., 2] = (sz * (half[2] - r) + r * sind(latitude))[:, None]
    points += (lo + hi) / 2.0
    corners = points[[0, -1]][:, :: steps + 1]
    lids = MeshPart(corners.reshape(-1, 3), np.array([[0, 2, 1], [0, 3, 2], [4, 5, 6], [4, 6, 7]], dtype=np.int32))
    return quad_grid(points, wrap_columns=True) + lids


def prism(outline: FloatArray, z0: float, z1: float, edge: float = 0.0) -> MeshPart:
    """Return the prism of an outline (n, 2), star-shaped about its mean, from z0 to z1, perhaps with a bevel `edge`."""
    centre = outline.mean(axis=0)
    if edge <= 0.0:
        levels, scales = np.array([z0, z1]), np.ones(2)
    else:
        inner = 1.0 - edge / np.linalg.norm(outline - centre, axis=1).max()
        levels, scales = np.array([z0, z0 + edge, z1 - edge, z1]), np.array([inner, 1.0, 1.0, inner])
    rings = np.empty((len(levels), len(outline), 3))
    rings[..., :2] = centre + scales[:, None, None] * (outline - centre)
    rings[..., 2] = levels[:, None]
    return loft(rings)


def cylinder(radius: float, z0: float, z1: float, segments: int, top: float | None = None) -> MeshPart:
    """Return an upright closed cylinder, or a cone frustum when `top` gives another radius at z1."""
    upper = radius if top is None else top
    return revolve([(0.0, z0), (radius, z0), (upper, z1), (0.0, z1)], segments)


def ellipsoid(centre: Point, radii: Point, segments: int, low: float = -90.0) -> MeshPart:
    """Return an ellipsoid, or the part of it above a latitude in degrees."""
    latitude = np.linspace(low, 90.0, max(3, round(segments * (90.0 - low) / 360.0)) + 1)
    rz = np.stack([np.where(np.abs(latitude) == 90.0, 0.0, cosd(latitude)), sind(latitude)], axis=1)
    return revolve(rz, segments).scaled(*radii).at(*centre)


def pillow(size: Point, segments: int, power: float = 3.0) -> MeshPart:
    """Return a stuffed cushion of size (x, y, z) about the origin: two bulging sheets that meet at a thin seam."""
    u = np.linspace(-1.0, 1.0, segments)
    x, y = np.meshgrid(np.sin(u * np.pi / 2), np.sin(u * np.pi / 2), indexing="ij")
    z = np.sqrt(np.clip((1 - np.abs(x) ** power) * (1 - np.abs(y) ** power), 0.0, None))
    # corners are pulled in slightly, as by a seam
    draw_in = 1.0 - 0.06 * (x * y) ** 2
    sheet = np.stack([x * draw_in, y * draw_in, z], axis=2) * np.asarray(size) / 2.0
    return pair(quad_grid(sheet), "z")


# ---- bars between two points -------------------------------------------------------------------------------------


def rod(a: Point, b: Point, radius: float, segments: int, end: float | None = None) -> MeshPart:
    """Return a round closed bar from a to b, of radius `end` at b when given."""
    path = np.array([a, b], dtype=np.float64)
    return tube(path, np.array([radius, radius if end is None else end]), segments)


def bar(a: Point, b: Point, width: float, height: float, end: float = 1.0) -> MeshPart:
    """Return a rectangular bar from a to b, its height as vertical as possible; `end` scales its section at b."""
    ends = np.array([a, b], dtype=np.float64)
    along = ends[1] - ends[0]
    stands = np.hypot(along[0], along[1]) < 1e-9 * abs(along[2])
    side = np.cross(along, [0.0, 1.0, 0.0] if stands else [0.0, 0.0, 1.0])
    side /= np.linalg.norm(side)
    up = np.cross(side, along)
    up /= np.linalg.norm(up)
    half_side, half_up = side * width / 2.0, up * height / 2.0
    section = np.stack([half_side + half_up, half_up - half_side, -half_side - half_up, half_side - half_up])
    rings = ends[:, None] + section * np.array([1.0, end])[:, None, None]
    return loft(rings)
