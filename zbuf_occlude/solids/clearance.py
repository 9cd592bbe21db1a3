"""How far points of a closed surface keep from its other faces: by margins along edges, and by measuring."""

import math

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from zbuf_occlude.arrays import FloatArray, IntArray
from zbuf_occlude.predicates import cross, dot, minus
from zbuf_occlude.solids.triangles import corner, inward, unit_normal
from zbuf_occlude.threads import threaded

FLAT = 1e-12
"""Heights of corners that lie in a plane, in diagonals, as float64 finds them."""

NEEDLE = 1e-8
"""Square of twice a triangle's area over the square of its longest edge squared, for what counts as a needle."""

UNBOUNDED, APART = 0, 4
"""The first and the last group of a face's others; see `edge_margins`."""


@threaded
def face_frames(corners: FloatArray) -> FloatArray:
    """Unit normals of faces, and in their planes the unit vectors inwards across the edges.

    Parameters
    ----------
    corners : (f, 3, 3) float64

    Returns
    -------
    (f, 4, 3) float64
        Edge i, from corner i to the next, has row i + 1.
    """
    frames = np.empty((len(corners), 4, 3))
    for i in prange(len(corners)):
        n = unit_normal(corners[i])
        for axis in range(3):
            frames[i, 0, axis] = n[axis]
        for edge in range(3):
            k = inward(corners[i], n, edge)
            for axis in range(3):
                frames[i, edge + 1, axis] = k[axis]
    return frames


@threaded
def edge_margins(
    corners: FloatArray, starts: IntArray, others: IntArray, frames: FloatArray, reach: float
) -> tuple[FloatArray, IntArray, NDArray[np.int64]]:
    """Margins along the edges of faces: a point of a face beyond all three is clear of most that is near the face.

    Parameters
    ----------
    corners, starts, others
        As in `NearFaces`, made with at least this `reach`.
    frames : (f, 4, 3) float64
        Of `face_frames`.
    reach : float
        Diagonals.

    Returns
    -------
    margins : (f, 3) float64
        For the edges from corner 0 to 1, 1 to 2, 2 to 0, in diagonals: a point of the face farther than this from all
        three lines keeps at least `reach` from every other face of its closed surface but the unbounded ones.
    others : (2 x pairs,) int32
        The same as before, in five groups for each face: the unbounded ones, that neither keep `reach` from its plane,
        nor lie beyond an edge, nor have all of it to one side of their plane; those that the margins along edges 0, 1
        and 2 keep it clear of; those that keep `reach` from its plane.
    ends : (f, 4) int64
        Where in `others` the first four groups end.
    """
    margins, ordered = np.full((len(corners), 3), reach), np.empty_like(others)
    ends, groups = np.zeros((len(corners), 4), dtype=np.int64), np.full(len(others), APART, dtype=np.int8)
    for i in prange(len(corners)):
        for k in range(starts[i], starts[i + 1]):
            j = others[k]
            low, high = _range(corner(frames[i], 0), corner(corners[i], 0), corners[j])
            if low >= reach or high <= -reach:
                continue
            edge, least = 0, math.inf
            for side in range(3):
                _, over = _range(corner(frames[i], side + 1), corner(corners[i], side), corners[j])
                if over < least:
                    edge, least = side, over
            # all of the other face lies beyond a line so far within the edge
            margin = reach + max(least, 0.0) if least <= reach else math.inf
            if margin > 2.0 * reach:
                wedge, over_edge = _wedge_margin(corners[i], frames[i], corners[j], frames[j], reach)
                if wedge < margin:
                    margin, edge = wedge, over_edge
            groups[k] = UNBOUNDED
            if margin < math.inf:
                margins[i, edge] = max(margins[i, edge], margin)
                groups[k] = edge + 1
        to = starts[i]
        for group in range(APART + 1):
            for k in range(starts[i], starts[i + 1]):
                if groups[k] == group:
                    ordered[to] = others[k]
                    to += 1
            if group < APART:
                ends[i, group] = to
    return margins, ordered, ends


@njit
def _wedge_margin(f, frame, g, g_frame, reach):  # type: ignore[no-untyped-def]
    """Margin along one edge of f beyond which its points are `reach` above the plane of g, and which edge.

    A point's height above that plane is that of f's corners, weighed by how near the point is to each; where none is
    below the plane, the height is at least one corner's times the point's share of that corner's own distance from the
    edge across.
    """
    n = corner(g_frame, 0)
    heights = (
        dot(n, minus(corner(f, 0), corner(g, 0))),
        dot(n, minus(corner(f, 1), corner(g, 0))),
        dot(n, minus(corner(f, 2), corner(g, 0))),
    )
    low, high = min(heights), max(heights)
    side = 1.0 if high > -low else -1.0
    if min(side * low, side * high) < -FLAT or _is_needle(g):
        return math.inf, 0
    margin, edge = math.inf, 0
    for i in range(3):
        height = side * dot(n, minus(corner(f, i), corner(g, 0)))
        across = (i + 1) % 3
        away = dot(corner(frame, across + 1), minus(corner(f, i), corner(f, across)))
        if height > 2.0 * reach and away * (reach + FLAT) < margin * height:
            margin, edge = away * (reach + FLAT) / height, across
    return margin, edge


@njit
def _is_needle(g):  # type: ignore[no-untyped-def]
    """Whether a triangle is so thin that float64 does not vouch for its normal."""
    a, b = minus(corner(g, 1), corner(g, 0)), minus(corner(g, 2), corner(g, 0))
    c = minus(b, a)
    n = cross(a, b)
    return dot(n, n) <= NEEDLE * max(dot(a, a), dot(b, b), dot(c, c)) ** 2


@njit
def _range(axis, origin, g):  # type: ignore[no-untyped-def]
    """Lowest and highest corner of a triangle along an axis, from an origin."""
    a, b, c = (
        dot(axis, minus(corner(g, 0), origin)),
        dot(axis, minus(corner(g, 1), origin)),
        dot(axis, minus(corner(g, 2), origin)),
    )
    return min(a, b, c), max(a, b, c)


@njit(_nrt=False)
def squared_distance(point, g):  # type: ignore[no-untyped-def]
    """Square of a point's distance from a triangle: from its plane where it lies over it, else from an edge."""
    n, over, least = unit_normal(g), True, math.inf
    for i in range(3):
        a = corner(g, i)
        p, e = minus(point, a), minus(corner(g, (i + 1) % 3), a)
        over &= dot(inward(g, n, i), p) >= 0.0
        along = min(max(dot(p, e) / dot(e, e), 0.0), 1.0)
        p = (p[0] - along * e[0], p[1] - along * e[1], p[2] - along * e[2])
        least = min(least, dot(p, p))
    height = dot(n, minus(point, corner(g, 0)))
    return height * height if over else least


@njit(_nrt=False)
def face_beside(point, own, found, corners, others, first, last, reach):  # type: ignore[no-untyped-def]
    """Which of the other faces first to last a point of a face, a tuple, comes as near as `reach` to.

    Returns
    -------
    int
        `found` where none is so near, which is `own` or one found before; -1 where there are several.
    """
    for k in range(first, last):
        other = others[k]
        g = corners[other]
        beyond = False
        for axis in range(3):
            beyond |= min(g[0, axis], g[1, axis], g[2, axis]) - point[axis] > reach
            beyond |= point[axis] - max(g[0, axis], g[1, axis], g[2, axis]) > reach
        if not beyond and squared_distance(point, g) <= reach * reach:
            if found != own:
                return -1
            found = other
    return found
