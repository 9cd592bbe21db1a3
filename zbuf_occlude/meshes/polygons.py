"""Polygons: what every reader of a mesh format returns, and how they become triangles, concave ones too."""

from dataclasses import dataclass
from typing import Any

import mapbox_earcut
import numpy as np
from numpy.typing import ArrayLike, NDArray

from zbuf_occlude.arrays import FloatArray
from zbuf_occlude.errors import MeshError

Ints = NDArray[np.int64]

LARGEST = 1e70
"""Coordinates beyond this would overflow where lengths are raised to the fourth power (areas squared)."""

_ROUNDING = 1e-12  # a fan's triangle may be turned over by so much of the polygon's area: collinear corners
_AT_ONCE = 1 << 22  # corners gathered at once, so that memory stays a small multiple of the file


@dataclass(frozen=True, eq=False)
class Polygons:
    """Vertices, and polygons as runs of indices of vertices, checked.

    Parameters
    ----------
    vertices : (v, 3) float
        NaN and infinity allowed where no polygon uses them.
    corners : (c,) int or float
        Indices of vertices, polygon after polygon, counted from 0; floats where a text held them.
    counts : (p,) int
        Corners of each polygon of the file, in its order; fewer than three make no face.

    Raises
    ------
    MeshError
        Indices that are not whole or out of range, or used vertices that are not finite or beyond `LARGEST`.
    """

    vertices: FloatArray
    corners: NDArray[Any]
    counts: Ints

    def __post_init__(self) -> None:
        vertices = np.ascontiguousarray(self.vertices, dtype=np.float64)
        corners = np.asarray(self.corners)
        counts = np.asarray(self.counts, dtype=np.int64)
        n = len(vertices)
        bad = ~((corners >= 0) & (corners < n))  # NaN is bad too
        if corners.dtype.kind == "f":
            bad |= corners != np.floor(corners)
        if bad.any():
            first = int(np.flatnonzero(bad)[0])
            raise MeshError(
                f"face {_polygon_of(first, counts)} must refer to the {n} vertices by 0 to {n - 1}; "
                f"it refers to {corners[first]:.15g}. Is the file damaged or cut short?"
            )
        corners = corners.astype(np.int64)
        unusable = ~_usable(vertices)[corners]
        if unusable.any():
            first = int(np.flatnonzero(unusable)[0])
            vertex = int(corners[first])
            raise MeshError(
                f"vertex {vertex} must be finite and below {LARGEST:g}, for face {_polygon_of(first, counts)} "
                f"uses it; it is {vertices[vertex].tolist()}. Repair the file."
            )
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "corners", corners)
        object.__setattr__(self, "counts", counts)

    @classmethod
    def from_triangles(cls, vertices: FloatArray, triangles: ArrayLike) -> "Polygons":
        """Take ``(f, 3)`` indices of vertices as polygons of three corners."""
        corners = np.asarray(triangles).reshape(-1)
        return cls(vertices, corners, np.full(len(corners) // 3, 3))

    def without_unusable_vertices(self) -> "Polygons":
        """Return the same without the vertices that are NaN, infinite or too large; no polygon uses one."""
        usable = _usable(self.vertices)
        if usable.all():
            return self
        renumbered = np.cumsum(usable) - 1
        return Polygons(self.vertices[usable], renumbered[self.corners], self.counts)

    def triangles(self) -> tuple[Ints, Ints]:
        """Cut every polygon into triangles.

        Returns
        -------
        triangles : (f, 3) int64
            Indices of vertices, in the order of the polygons.
        polygon_ids : (f,) int64
            The polygon that each triangle is a part of.

        Notes
        -----
        A polygon is fanned out from its first corner, or its second, where all the fan's triangles face the way
        the polygon does: exact for every convex polygon and every quadrilateral that does not cross itself. What is
        left is projected on its own plane (normal by Newell's sum) and cut by ears. A polygon that is not flat has
        no one right triangulation, one that crosses itself none at all; they get some triangles within their corners.
        """
        if (self.counts == 3).all():
            return self.corners.reshape(-1, 3), np.arange(len(self.counts))
        starts = np.cumsum(self.counts) - self.counts
        triangles, polygon_ids = [np.empty((0, 3), dtype=np.int64)], [np.empty(0, dtype=np.int64)]
        for n in np.unique(self.counts[self.counts >= 3]):
            same = np.flatnonzero(self.counts == n)
            for ids in np.array_split(same, 1 + len(same) * int(n) // _AT_ONCE):
                cut, owners = self._cut(self.corners[starts[ids, None] + np.arange(n)])
                triangles.append(cut)
                polygon_ids.append(ids[owners])
        owner = np.concatenate(polygon_ids)
        order = np.argsort(owner, kind="stable")
        return np.concatenate(triangles)[order], owner[order]

    def _cut(self, polygons: Ints) -> tuple[Ints, Ints]:
        """Cut polygons of the same number of corners, (p, n); return triangles and the row that each comes from."""
        rows = np.arange(len(polygons))
        if polygons.shape[1] == 3:
            return polygons, rows
        triangles, owners = [], []
        for shift in (0, 1):
            turned = np.roll(polygons[rows], -shift, axis=1)
            fits = self._fan_fits(turned)
            fan = _fan(turned[fits])
            triangles.append(fan.reshape(-1, 3))
            owners.append(np.repeat(rows[fits], fan.shape[1]))
            rows = rows[~fits]
        # what is left is rare: concave, seen from both its first corners; each has a shape of its own
        for row in rows:
            ears = self._ears(polygons[row])
            triangles.append(ears)
            owners.append(np.full(len(ears), row))
        return np.concatenate(triangles), np.concatenate(owners)

    def _fan_fits(self, polygons: Ints) -> NDArray[np.bool_]:
        spokes = self.vertices[polygons[:, 1:]] - self.vertices[polygons[:, :1]]
        parts = np.cross(spokes[:, :-1], spokes[:, 1:])  # twice the areas of the fan's triangles, (p, n - 2, 3)
        whole = parts.sum(axis=1)  # Newell's normal, twice the polygon's area long
        forward = np.einsum("pij,pj->pi", parts, whole)
        allowed = _ROUNDING * np.linalg.norm(parts, axis=2).sum(axis=1) * np.linalg.norm(whole, axis=1)
        return np.asarray((forward >= -allowed[:, None]).all(axis=1))

    def _ears(self, polygon: Ints) -> Ints:
        positions = self.vertices[polygon] - self.vertices[polygon[0]]
        normal = np.cross(positions[:-1], positions[1:]).sum(axis=0)
        # two axes of the plane: the least of the normal's components names the world axis to start from
        first = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
        axes = np.stack([first, np.cross(normal, first)])
        axes /= np.maximum(np.linalg.norm(axes, axis=1, keepdims=True), np.finfo(float).tiny)
        ends = np.array([len(polygon)], dtype=np.uint32)
        ears = mapbox_earcut.triangulate_float64(np.ascontiguousarray(positions @ axes.T), ends).reshape(-1, 3)
        used = np.zeros(len(polygon), dtype=bool)
        used[ears] = True
        if not used.any():
            return _fan(polygon[None])[0]
        # corners that looked collinear were left out; unless the polygon is flat, they stand out of what was cut:
        # close the gap from each to the last corner before it that was not left out
        left_out = np.flatnonzero(~used)
        kept = np.flatnonzero(used)
        gaps = np.stack([kept[np.searchsorted(kept, left_out) - 1], left_out, (left_out + 1) % len(polygon)], axis=1)
        return polygon[np.concatenate([ears.astype(np.int64), gaps])]


def _fan(polygons: Ints) -> Ints:
    """Triangles (p, n - 2, 3) around the first corner of each polygon (p, n)."""
    hub = np.broadcast_to(polygons[:, :1], polygons[:, 1:-1].shape)
    return np.stack([hub, polygons[:, 1:-1], polygons[:, 2:]], axis=2)


def _usable(vertices: FloatArray) -> NDArray[np.bool_]:
    return np.asarray((np.abs(vertices) <= LARGEST).all(axis=1))  # NaN is not


def _polygon_of(corner: int, counts: Ints) -> int:
    return int(np.searchsorted(np.cumsum(counts), corner, side="right"))
