"""How far points of a closed surface keep from its other faces: by margins along edges, and by measuring."""

import math

import numpy as np
from numba import njit, prange

from zbuf_occlude.arrays import FloatArray, IntArray
from zbuf_occlude.predicates import dot, minus
from zbuf_occlude.solids.triangles import corner, inward, unit_normal
from zbuf_occlude.threads import threaded


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
) -> FloatArray:
    """Margins along the edges of faces: a point of a face beyond all three is clear of what is near the face.

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
    (f, 3) float64
        For the edges from corner 0 to 1, 1 to 2, 2 to 0, in diagonals: a point of the face farther than this from all
        three lines keeps at least `reach` from every other face of its closed surface. Infinite where some face
        neither keeps `reach` from the plane nor lies beyond an edge, as in wedges sharper than 90 degrees.
    """
    margins = np.full((len(corners), 3), reach)
    for i in prange(len(corners)):
        for j in others[starts[i] : starts[i + 1]]:
            low, high = _range(corner(frames[i], 0), corner(corners[i], 0), corners[j])
            if low >= reach or high <= -reach:
                continue
            edge, least = 0, math.inf
            for k in range(3):
                _, over = _range(corner(frames[i], k + 1), corner(corners[i], k), corners[j])
                if over < least:
                    edge, least = k, over
            # all of the other face lies beyond a line so far within the edge
            margins[i, edge] = max(margins[i, edge], reach + max(least, 0.0) if least <= reach else math.inf)
    return margins


@njit
def _range(axis, origin, g):  # type: ignore[no-untyped-def]
    """Lowest and highest corner of a triangle along an axis, from an origin."""
    a, b, c = (
        dot(axis, minus(corner(g, 0), origin)),
        dot(axis, minus(corner(g, 1), origin)),
        dot(axis, minus(corner(g, 2), origin)),
    )
    return min(a, b, c), max(a, b, c)


@njit
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


@njit
def face_beside(point, own, corners, starts, others, reach):  # type: ignore[no-untyped-def]
    """Which of the faces near its own a point, a tuple, comes as near as `reach` to; arrays as in `NearFaces`.

    Returns
    -------
    int
        `own` where none is so near, -1 where several are.
    """
    found = own
    for other in others[starts[own] : starts[own + 1]]:
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
