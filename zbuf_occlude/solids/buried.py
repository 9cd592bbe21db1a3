"""Buried faces: inside another solid of the mesh, where no eye outside sees anything of them.

Faces that keep clear of all others but those that they are joined to are inside a solid or outside, and what they are
joined to, edge by edge, is so, too. So one point of each such part of a surface is asked: a line from it to far away
passes the surface of a solid that it is inside of an odd number of times. On faces that others run through, a point is
buried where nothing in the face's plane (`barriers`) is between it and a buried corner.
"""

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from zbuf_occlude.arrays import BoolArray, FloatArray, IntArray
from zbuf_occlude.predicates import cross, dot, minus
from zbuf_occlude.solids.clear import Clearance
from zbuf_occlude.solids.closed import ClosedSurfaces, Signs
from zbuf_occlude.solids.triangles import corner
from zbuf_occlude.threads import threaded

WHOLE = 8
"""In place of a face's buried corners: the face is buried as a whole."""

MOST_ASKED = 400
"""Tests of a line against a face, in faces of the mesh; the smallest parts of surfaces are not asked beyond that."""

DOUBT = 1e-12
"""Volumes, in cubic diagonals, below which float64 does not vouch for their sign."""

DIRECTIONS = np.array([[0.57, 0.31, 0.76], [-0.43, 0.81, 0.40], [0.22, -0.36, 0.91], [-0.71, -0.52, 0.47]])
"""Of the lines; the next one where it passes an edge."""


def find_buried(corners: FloatArray, closed: ClosedSurfaces, clearance: Clearance) -> Signs:
    """Find the faces inside other solids, and the corners there of faces that others run through.

    Parameters
    ----------
    corners : (f, 3, 3) float64
        About the mesh's centre, in units of its diagonal.
    closed : ClosedSurfaces
        Those that bound solids.
    clearance : Clearance

    Returns
    -------
    (f,) int8
        `WHOLE`, or bits 0 to 2 for the corners of a face that has barriers.

    Notes
    -----
    At most `MOST_ASKED` times 10 nanoseconds a face, for each direction asked.
    """
    buried = np.zeros(len(corners), dtype=np.int8)
    in_order = np.argsort(np.where(closed.outward != 0, closed.surfaces, -1), kind="stable")
    in_order = in_order[np.count_nonzero(closed.outward == 0) :].astype(np.int64)
    solids, first = np.unique(closed.surfaces[in_order], return_index=True)
    if len(solids) == 0:
        return buried
    starts = np.append(first, len(in_order))
    lower = np.minimum.reduceat(corners[in_order].min(axis=1), first)
    upper = np.maximum.reduceat(corners[in_order].max(axis=1), first)
    parts, n_parts = _parts(clearance.clear, closed.twins)
    there = parts >= 0
    sizes = np.bincount(parts[there], minlength=n_parts)
    largest = np.argsort(-sizes, kind="stable")[: MOST_ASKED * len(corners) // (len(in_order) + len(solids))]
    seeds = np.zeros(n_parts, dtype=np.int64)
    seeds[parts[there]] = np.flatnonzero(there)
    inside = np.zeros(n_parts + 1, dtype=np.bool_)
    inside[largest] = _are_inside(
        corners[seeds[largest]].mean(axis=1), closed.surfaces[seeds[largest]], corners, in_order, solids, starts,
        lower, upper,
    )  # fmt: skip
    whole = inside[parts]  # the last, False, where a face is of no part
    vertices = np.zeros(int(closed.vertices.max()) + 1, dtype=np.bool_)
    vertices[closed.vertices[whole]] = True
    fenced = np.diff(clearance.barriers.starts) > 0
    bits = (vertices[closed.vertices] * np.array([1, 2, 4])).sum(axis=1)
    buried[fenced] = bits[fenced]
    buried[whole] = WHOLE
    return buried


@njit(cache=True)
def _parts(clear: BoolArray, twins: NDArray[np.int64]) -> tuple[NDArray[np.int64], int]:
    """Number the parts of surfaces that clear faces form, edge by edge; -1 for other faces."""
    parts, queue, n = np.full(len(clear), -1, dtype=np.int64), np.empty(len(clear), dtype=np.int64), 0
    for seed in range(len(clear)):
        if not clear[seed] or parts[seed] >= 0:
            continue
        parts[seed], queue[0] = n, seed
        done, length = 0, 1
        while done < length:
            face = queue[done]
            done += 1
            for half in range(3 * face, 3 * face + 3):
                beside = twins[half] // 3
                if twins[half] >= 0 and clear[beside] and parts[beside] < 0:
                    parts[beside], queue[length] = n, beside
                    length += 1
        n += 1
    return parts, n


@threaded
def _are_inside(
    points: FloatArray,
    own: IntArray,
    corners: FloatArray,
    in_order: IntArray,
    solids: IntArray,
    starts: IntArray,
    lower: FloatArray,
    upper: FloatArray,
) -> BoolArray:
    """Whether points are inside of a solid that is not their own."""
    inside = np.zeros(len(points), dtype=np.bool_)
    for i in prange(len(points)):
        point = (points[i, 0], points[i, 1], points[i, 2])
        for j in range(len(solids)):
            beside = solids[j] == own[i]
            for axis in range(3):
                beside |= not lower[j, axis] < point[axis] < upper[j, axis]
            if not beside and _is_inside(point, corners, in_order, starts[j], starts[j + 1]):
                inside[i] = True
                break
    return inside


@njit(_nrt=False)
def _is_inside(point, corners, in_order, first, last):  # type: ignore[no-untyped-def]
    """Whether a line to far away passes the faces first to last an odd number of times; False where that is unsure."""
    for i in range(len(DIRECTIONS)):
        passed, sure = 0, True
        for k in range(first, last):
            g = corners[in_order[k]]
            crosses, doubt = _passes(point, (DIRECTIONS[i, 0], DIRECTIONS[i, 1], DIRECTIONS[i, 2]), g)
            passed += crosses
            if doubt:
                sure = False
                break
        if sure:
            return passed % 2 == 1
    return False


@njit(_nrt=False, forceinline=True)
def _passes(point, direction, g):  # type: ignore[no-untyped-def]
    """Whether a ray passes a triangle, and whether that is in doubt."""
    a, b, c = minus(corner(g, 0), point), minus(corner(g, 1), point), minus(corner(g, 2), point)
    u, v, w = dot(direction, cross(b, c)), dot(direction, cross(c, a)), dot(direction, cross(a, b))
    low, high = min(u, v, w), max(u, v, w)
    if low < -DOUBT and high > DOUBT:
        return False, False
    volume = dot(a, cross(b, c))  # of the sign of u + v + w where the ray, not its opposite, passes
    if low > DOUBT:
        return volume > 0.0, abs(volume) < DOUBT
    if high < -DOUBT:
        return volume < 0.0, abs(volume) < DOUBT
    return False, True


@njit(_nrt=False)
def is_buried(point, normal, corners, buried, ends, radii, first, last):  # type: ignore[no-untyped-def]
    """Whether a point of a face has a way to one of its buried corners past its barriers first to last.

    Parameters
    ----------
    point, normal : tuples of 3 float64
        The point, and the face's unit normal.
    corners : (3, 3) float64
    buried : int
        Bits of the corners.
    ends, radii
        As in `Barriers`.
    first, last : int
        Which of them are the face's.
    """
    for i in range(3):
        if not (buried >> i) & 1:
            continue
        way, free = minus(corner(corners, i), point), True
        for k in range(first, last):
            a, b = corner(ends[k], 0), corner(ends[k], 1)
            along = minus(b, a)
            across = cross(normal, along)
            size = radii[k] * np.sqrt(dot(along, along))
            from_point, from_corner = dot(across, minus(point, a)), dot(across, minus(corner(corners, i), a))
            apart = min(from_point, from_corner) > size or max(from_point, from_corner) < -size
            across = cross(normal, way)
            size = radii[k] * np.sqrt(dot(way, way))
            from_a, from_b = dot(across, minus(a, point)), dot(across, minus(b, point))
            if not (apart or min(from_a, from_b) > size or max(from_a, from_b) < -size):
                free = False
                break
        if free:
            return True
    return False
