"""Which closed surfaces cross or touch themselves, so that what is wound as their inside may lie outside."""

import numpy as np
from numba import njit, prange

from zbuf_occlude.arrays import BoolArray, FloatArray, IntArray
from zbuf_occlude.predicates import cross, dot, minus
from zbuf_occlude.solids.closed import ClosedSurfaces
from zbuf_occlude.solids.near import NearFaces
from zbuf_occlude.solids.triangles import corner, inward, shared_corners, unit, unit_normal
from zbuf_occlude.threads import threaded

APART = 1e-12
"""Triangles nearer to each other than so many diagonals of the mesh touch."""


def crossing_surfaces(closed: ClosedSurfaces, near: NearFaces) -> BoolArray:
    """Find the closed surfaces of which two faces meet elsewhere than in an edge or a corner that they share.

    Returns
    -------
    (s,) bool, by the number of the surface
        False only where all faces certainly keep apart. Such a surface bounds a solid: whoever looks at the inner side
        of one of its faces from outside looks through another one.

    References
    ----------
    Gottschalk, Lin, Manocha: OBBTree. SIGGRAPH 1996, doi:10.1145/237170.237244 (separating axes).
    """
    crossing = ~near.complete
    crossing[closed.surfaces[_meetings(near.corners, near.starts, near.others)]] = True
    return crossing


@threaded
def _meetings(corners: FloatArray, starts: IntArray, others: IntArray) -> BoolArray:
    """Which faces may meet one of their neighbours."""
    found = np.zeros(len(corners), dtype=np.bool_)
    for i in prange(len(corners)):
        for j in others[starts[i] : starts[i + 1]]:
            if j > i and may_meet(corners[i], corners[j]):
                found[i] = True
                break
    return found


@njit
def may_meet(f: FloatArray, g: FloatArray) -> bool:
    """Whether triangles, (3, 3) float64 in units of a diagonal, may meet elsewhere than in what they share."""
    of_f, of_g = shared_corners(f, g)
    if of_f == 0:
        return not separated(f, g, APART)
    if of_f in (1, 2, 4) and of_g in (1, 2, 4):
        return not _apart_at_corner(f, g, of_f >> 1, of_g >> 1)
    if of_f in (3, 5, 6) and of_g in (3, 5, 6):
        return not _apart_at_edge(f, g, (7 - of_f) >> 1, (7 - of_g) >> 1)
    return True  # duplicates, or corners that rounding has made one


@njit
def _separates(axis, f, g, gap):  # type: ignore[no-untyped-def]
    """Whether along an axis, a unit vector, there is more than a gap between two triangles."""
    a0, a1, a2 = dot(axis, corner(f, 0)), dot(axis, corner(f, 1)), dot(axis, corner(f, 2))
    b0, b1, b2 = dot(axis, corner(g, 0)), dot(axis, corner(g, 1)), dot(axis, corner(g, 2))
    return min(a0, a1, a2) > max(b0, b1, b2) + gap or min(b0, b1, b2) > max(a0, a1, a2) + gap


@njit
def separated(f, g, gap):  # type: ignore[no-untyped-def]
    """Whether there is more than a gap between two triangles along an axis that can separate them.

    These are the normals, those across edges, and those across pairs of edges. Triangles farther apart than the gap
    may lie nearer than it along all of them.
    """
    n, m = unit_normal(f), unit_normal(g)
    if _separates(n, f, g, gap) or _separates(m, f, g, gap):
        return True
    for i in range(3):
        if _separates(inward(f, n, i), f, g, gap) or _separates(inward(g, m, i), f, g, gap):
            return True
    for i in range(3):
        e = minus(corner(f, (i + 1) % 3), corner(f, i))
        for j in range(3):
            if _separates(unit(cross(e, minus(corner(g, (j + 1) % 3), corner(g, j)))), f, g, gap):
                return True
    return False


@njit
def _apart_at_edge(f, g, i, j):  # type: ignore[no-untyped-def]
    """Whether two triangles with a common edge, across from corner i of f and j of g, do not lie on each other."""
    n, across = unit_normal(f), (i + 1) % 3
    b = minus(corner(g, j), corner(f, across))
    return abs(dot(n, b)) > APART or dot(inward(f, n, across), b) < -APART


@njit
def _apart_at_corner(f, g, i, j):  # type: ignore[no-untyped-def]
    """Whether two triangles that share a corner, of f the i-th and of g the j-th, meet nowhere else."""
    v = corner(f, i)
    p, q = minus(corner(f, (i + 1) % 3), v), minus(corner(f, (i + 2) % 3), v)
    r, s = minus(corner(g, (j + 1) % 3), v), minus(corner(g, (j + 2) % 3), v)
    n, m = unit_normal(f), unit_normal(g)
    hr, hs = dot(n, r), dot(n, s)
    if min(hr, hs) > APART or max(hr, hs) < -APART:
        return True
    hp, hq = dot(m, p), dot(m, q)
    if min(hp, hq) > APART or max(hp, hq) < -APART:
        return True
    if _parts(inward(f, n, i), inward(f, n, (i + 2) % 3), p, q, r, s):
        return True
    if _parts(inward(g, m, j), inward(g, m, (j + 2) % 3), r, s, p, q):
        return True
    if max(abs(hr), abs(hs), abs(hp), abs(hq)) <= APART:
        # in one plane: neither angle may hold a side of the other
        return not (_holds(n, p, q, r) or _holds(n, p, q, s) or _holds(m, r, s, p) or _holds(m, r, s, q))
    # each meets the line in which the planes cut in a ray from the corner, or in the corner alone
    line = unit(cross(n, m))
    x = dot(line, p) * abs(hq) + dot(line, q) * abs(hp)
    y = dot(line, r) * abs(hs) + dot(line, s) * abs(hr)
    nothing = APART * APART
    return (x > nothing and y < -nothing) or (x < -nothing and y > nothing)


@njit
def _parts(k, other, p, q, r, s):  # type: ignore[no-untyped-def]
    """Whether a plane between those across k and other, or close to one, has p and q before it, r and s behind."""
    for share in (0.5, 0.01, 0.99):
        a = (
            k[0] + share * (other[0] - k[0]),
            k[1] + share * (other[1] - k[1]),
            k[2] + share * (other[2] - k[2]),
        )
        if min(dot(a, p), dot(a, q)) > APART and max(dot(a, r), dot(a, s)) < -APART:
            return True
    return False


@njit
def _holds(n, p, q, r):  # type: ignore[no-untyped-def]
    """Whether the angle from p to q about the unit normal n, less than 180 degrees, may hold r; all in one plane."""
    r = unit(r)
    return dot(n, cross(unit(p), r)) >= -APART and dot(n, cross(r, unit(q))) >= -APART
