"""Polygons, as every reader of a mesh format returns them, and their triangulation, concave ones included."""

import math
from dataclasses import dataclass
from typing import Any

import mapbox_earcut
import numpy as np
from numpy.typing import ArrayLike, NDArray

from zbuf_occlude.base.arrays import LARGEST, FloatArray
from zbuf_occlude.base.errors import MeshError
from zbuf_occlude.base.jit.compiler import njit
from zbuf_occlude.base.jit.vec3 import cross, dot, minus

Ints = NDArray[np.int64]

_ROUNDING = 1e-12  # reversed area allowed in a fan's triangle, over the polygon's area: collinear corners
_TINY = float(np.finfo(np.float64).tiny)
_MAX_EARS = 50_000
"""Maximum corners of a polygon that is triangulated by ear clipping.

A polygon that crosses itself takes quadratic time, here 10 s, and compiled code cannot be interrupted."""
_EARS = -1  # hub of a polygon that needs ear clipping


@dataclass(frozen=True, eq=False)
class Polygons:
    """Vertices, and polygons as runs of vertex indices.

    Raises
    ------
    MeshError
        An index that is no whole number or out of range; a used vertex that is not finite or beyond `LARGEST`.
    """

    vertices: FloatArray  # (v, 3); vertices that no polygon uses may be NaN or infinite
    corners: NDArray[Any]  # (c,): vertex indices, polygon after polygon; floats if they come from a text
    counts: Ints  # (p,): corners of each polygon, in the order of the file; fewer than three make no face

    def __post_init__(self) -> None:
        vertices = np.ascontiguousarray(self.vertices, dtype=np.float64)
        given = np.asarray(self.corners)
        given = np.ascontiguousarray(given, dtype=np.float64 if given.dtype.kind == "f" else np.int64)
        counts = np.asarray(self.counts, dtype=np.int64)
        corners = np.empty(len(given), dtype=np.int64)
        out_of_range, unusable = _fill_whole_numbers(given, vertices, corners)
        if out_of_range >= 0:
            n = len(vertices)
            raise MeshError(
                f"face {_polygon_of(out_of_range, counts)} must refer to the {n} vertices by 0 to {n - 1}; "
                f"it refers to {given[out_of_range]:.15g}. Is the file damaged or cut short?"
            )
        if unusable >= 0:
            vertex = int(corners[unusable])
            raise MeshError(
                f"vertex {vertex} must be finite and below {LARGEST:g}, since face {_polygon_of(unusable, counts)} "
                f"uses it; it is {vertices[vertex].tolist()}. Repair the file."
            )
        vars(self).update(vertices=vertices, corners=corners, counts=counts)

    @classmethod
    def from_triangles(cls, vertices: FloatArray, triangles: ArrayLike) -> "Polygons":
        """Return triangles, vertex indices (f, 3), as polygons."""
        corners = np.asarray(triangles).reshape(-1)
        return cls(vertices, corners, np.full(len(corners) // 3, 3))

    def without_unusable_vertices(self) -> "Polygons":
        """Return the polygons without the vertices that are NaN, infinite or too large; no polygon uses them."""
        usable = (np.abs(self.vertices) <= LARGEST).all(axis=1)  # False for NaN
        if usable.all():
            return self
        renumbered = np.cumsum(usable) - 1
        return Polygons(self.vertices[usable], renumbered[self.corners], self.counts)

    def triangles(self) -> tuple[Ints, Ints]:
        """Return the triangles (f, 3) of all polygons, in their order, and the polygon of each triangle (f,).

        A polygon becomes a fan from its first or second corner if all triangles of the fan face the way the polygon
        does. This is exact for convex polygons and for quadrilaterals that do not cross themselves. Other polygons are
        projected on their plane (normal by Newell's sum) and triangulated by ear clipping. A polygon that is not flat
        has no unique triangulation, and one that crosses itself has none: they get some triangles of their corners.
        """
        if (self.counts == 3).all():
            return self.corners.reshape(-1, 3), np.arange(len(self.counts))
        starts = np.cumsum(self.counts) - self.counts
        hubs = np.zeros(len(self.counts), dtype=np.int64)
        _choose_hubs(self.vertices, self.corners, starts, self.counts, hubs)
        n_triangles = np.maximum(self.counts - 2, 0)
        concave = np.flatnonzero(hubs == _EARS)
        ears = self._ears(starts[concave], self.counts[concave])
        n_triangles[concave] = [len(each) for each in ears]
        ends = np.cumsum(n_triangles)
        triangles, polygon_ids = np.empty((ends[-1], 3), dtype=np.int64), np.empty(ends[-1], dtype=np.int64)
        _fill_fans(self.corners, starts, hubs, ends, triangles, polygon_ids)
        for polygon, each in zip(concave, ears, strict=True):
            triangles[ends[polygon] - len(each) : ends[polygon]] = self.corners[starts[polygon] + each]
        return triangles, polygon_ids

    def triangle_corners(self) -> Ints:
        """Return the triangles of `triangles` as indices of `corners`, (f, 3)."""
        own = np.arange(len(self.corners))
        return Polygons(self.vertices[self.corners], own, self.counts).triangles()[0]

    def _ears(self, starts: Ints, counts: Ints) -> list[Ints]:
        """Return the triangles (t, 3) of each polygon by ear clipping, as corner numbers of the polygon."""
        if len(counts) and counts.max() > _MAX_EARS:
            raise MeshError(
                f"a concave face must have at most {_MAX_EARS:,} corners; one has {counts.max():,}. Split it."
            )
        positions, axes = np.empty((int(counts.sum()), 3)), np.empty((len(counts), 2, 3))
        _fill_planes(self.vertices, self.corners, starts, counts, positions, axes)
        found = []
        for end, n, own in zip(np.cumsum(counts).tolist(), counts.tolist(), axes, strict=True):
            flat = positions[end - n : end] @ own.T
            ears = mapbox_earcut.triangulate_float64(flat, np.array([n], dtype=np.uint32)).astype(np.int64)
            ears = ears.reshape(-1, 3)
            found.append(ears if len(ears) == n - 2 else _with_gaps(ears, n))
        return found


def _with_gaps(ears: Ints, n: int) -> Ints:
    """Return the triangles with those at corners left out as collinear: outside a flat polygon they have an area."""
    is_kept = np.zeros(n, dtype=bool)
    is_kept[ears] = True
    kept, left_out = np.flatnonzero(is_kept), np.flatnonzero(~is_kept)
    if not len(kept):
        return np.stack([np.zeros(n - 2, dtype=np.int64), np.arange(1, n - 1), np.arange(2, n)], axis=1)
    # a triangle of each with the last kept corner before it and the corner after it
    gaps = np.stack([kept[np.searchsorted(kept, left_out) - 1], left_out, (left_out + 1) % n], axis=1)
    return np.concatenate([ears, gaps])


@njit(cache=True, nogil=True)
def _fill_whole_numbers(given, vertices, corners):
    """Write corners as integers; return the first invalid one, and the first with an unusable vertex; -1 for none."""
    for i in range(len(given)):
        if not 0 <= given[i] < len(vertices):  # True for NaN
            return i, -1
        corners[i] = given[i]
        if corners[i] != given[i]:
            return i, -1
    for i in range(len(given)):
        for axis in range(3):
            if not abs(vertices[corners[i], axis]) <= LARGEST:
                return -1, i
    return -1, -1


@njit(cache=True, nogil=True)
def _choose_hubs(vertices, corners, starts, counts, hubs):
    """Write the hub of each polygon's fan: its first corner (0) or second (1), or `_EARS` if neither is possible."""
    for polygon in range(len(counts)):
        start, n = starts[polygon], counts[polygon]
        for hub in range(2 if n > 3 else 0):
            first = vertices[corners[start + hub]]
            # sum of twice the area vectors of the fan's triangles: Newell's normal
            whole, size = (0.0, 0.0, 0.0), 0.0
            for i in range(1, n - 1):
                b, c = corners[start + (hub + i) % n], corners[start + (hub + i + 1) % n]
                part = cross(minus(vertices[b], first), minus(vertices[c], first))
                whole = (whole[0] + part[0], whole[1] + part[1], whole[2] + part[2])
                size += math.sqrt(dot(part, part))
            allowed = _ROUNDING * size * math.sqrt(dot(whole, whole))
            fits = True
            for i in range(1, n - 1):
                b, c = corners[start + (hub + i) % n], corners[start + (hub + i + 1) % n]
                fits &= dot(cross(minus(vertices[b], first), minus(vertices[c], first)), whole) >= -allowed
            hubs[polygon] = hub if fits else _EARS
            if fits:
                break


@njit(cache=True, nogil=True)
def _fill_fans(corners, starts, hubs, ends, triangles, polygon_ids):
    """Write the triangles (f, 3) of fans, but not of clipped ears, and the polygon of every triangle, (f,)."""
    begin = 0
    for polygon in range(len(ends)):
        n, start, hub = ends[polygon] - begin + 2, starts[polygon], hubs[polygon]
        polygon_ids[begin : ends[polygon]] = polygon
        for i in range(0 if hub == _EARS else n - 2):
            triangles[begin + i, 0] = corners[start + hub]
            triangles[begin + i, 1] = corners[start + (hub + i + 1) % n]
            triangles[begin + i, 2] = corners[start + (hub + i + 2) % n]
        begin = ends[polygon]


@njit(cache=True, nogil=True)
def _fill_planes(vertices, corners, starts, counts, positions, axes):
    """Write corners relative to the first of each polygon, (c, 3), and two axes of each polygon's plane, (p, 2, 3)."""
    end = 0
    for polygon in range(len(counts)):
        begin = end
        end += counts[polygon]
        for i in range(counts[polygon]):
            vertex, first = corners[starts[polygon] + i], corners[starts[polygon]]
            for axis in range(3):
                positions[begin + i, axis] = vertices[vertex, axis] - vertices[first, axis]
        normal = (0.0, 0.0, 0.0)  # Newell's sum
        for i in range(begin, end - 1):
            part = cross(positions[i], positions[i + 1])
            normal = (normal[0] + part[0], normal[1] + part[1], normal[2] + part[2])
        # start from the world axis of the normal's smallest component
        if abs(normal[0]) <= abs(normal[1]) and abs(normal[0]) <= abs(normal[2]):
            across = cross(normal, (1.0, 0.0, 0.0))
        elif abs(normal[1]) <= abs(normal[2]):
            across = cross(normal, (0.0, 1.0, 0.0))
        else:
            across = cross(normal, (0.0, 0.0, 1.0))
        upwards = cross(normal, across)
        width, height = max(math.sqrt(dot(across, across)), _TINY), max(math.sqrt(dot(upwards, upwards)), _TINY)
        for axis in range(3):
            axes[polygon, 0, axis], axes[polygon, 1, axis] = across[axis] / width, upwards[axis] / height


def _polygon_of(corner: int, counts: Ints) -> int:
    return int(np.searchsorted(np.cumsum(counts), corner, side="right"))
