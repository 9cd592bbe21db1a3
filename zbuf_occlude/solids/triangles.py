"""Pairs of triangles: the corners that they share, and vectors in tuples for compiled loops."""

import math

from numba import njit

from zbuf_occlude.predicates import cross, dot, minus


@njit
def corner(f, i):  # type: ignore[no-untyped-def]
    """Row i of a triangle or a frame, (..., 3) float64, as a tuple."""
    return (f[i, 0], f[i, 1], f[i, 2])


@njit
def unit(a):  # type: ignore[no-untyped-def]
    """The vector at length 1; a vector without length as it is."""
    length = math.sqrt(dot(a, a))
    return (a[0] / length, a[1] / length, a[2] / length) if length > 0.0 else a


@njit
def unit_normal(f):  # type: ignore[no-untyped-def]
    """Unit normal of a triangle."""
    a = corner(f, 0)
    return unit(cross(minus(corner(f, 1), a), minus(corner(f, 2), a)))


@njit
def inward(f, n, i):  # type: ignore[no-untyped-def]
    """Unit vector in the plane of f, whose unit normal is n, across the edge from corner i to the next, inwards."""
    return unit(cross(n, minus(corner(f, (i + 1) % 3), corner(f, i))))


@njit
def shared_corners(f, g):  # type: ignore[no-untyped-def]
    """Masks of the corners of f and of g that they have in common, to the last bit."""
    of_f, of_g = 0, 0
    for i in range(3):
        for j in range(3):
            if f[i, 0] == g[j, 0] and f[i, 1] == g[j, 1] and f[i, 2] == g[j, 2]:
                of_f |= 1 << i
                of_g |= 1 << j
    return of_f, of_g
