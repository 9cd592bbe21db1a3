"""THE definition of "blocked" and of "hit": does a face block a line of sight, and where does a ray meet it?

Signed volumes, in float64. `exact_hsr` (the paper's perpendicular planes) must not import this file:
the two formulations check each other.
"""

import math

from zbuf_occlude.jit.compiler import njit
from zbuf_occlude.jit.vec3 import cross, dot, minus


@njit(inline="always")
def volumes(origin, direction, a, b, c):
    """Six times the signed volumes that a line spans with the edges bc, ca and ab, its origin taken as 0."""
    a_, b_, c_ = minus(a, origin), minus(b, origin), minus(c, origin)
    return dot(direction, cross(b_, c_)), dot(direction, cross(c_, a_)), dot(direction, cross(a_, b_))


@njit(inline="always")
def of_one_sign(u, v, w):
    """Whether none of three numbers has the other sign; without branches, so that several can be asked at a time."""
    return ((u >= 0.0) & (v >= 0.0) & (w >= 0.0)) | ((u <= 0.0) & (v <= 0.0) & (w <= 0.0))


@njit()
def blocks(eye, point, a, b, c, contact):
    """Whether the closed triangle abc meets the open segment (eye, point) farther than `contact` from the point.

    Parameters
    ----------
    eye, point, a, b, c : tuples or arrays of 3 float64, world space
    contact : float
        The contact tolerance tau, in world units.

    Returns
    -------
    bool

    Notes
    -----
    With the point as origin, ``u = d . (b x c)``, ``v = d . (c x a)``, ``w = d . (a x b)`` are six times the signed
    volumes that the line spans with the three edges. (With the eye as origin the products would cancel with the square
    of its distance, and eyes 10^4 sizes away would be judged wrongly.) The line passes through the closed triangle iff
    none of them has the other sign; their sum is ``d . n``. A line within the face's plane (sum zero) is not blocked:
    Eq. 6 has no solution.
    The meeting point is at ``height / slope`` of the way from the point to the eye, measured from the *point* so that
    the comparison with the contact tolerance does not cancel. The two are compared and not divided: divisions are not
    correctly rounded on every GPU, and blocks64.glsl says the same.
    """
    d = minus(point, eye)
    u, v, w = volumes(point, d, a, b, c)
    if not of_one_sign(u, v, w):
        return False
    n = cross(minus(b, a), minus(c, a))
    slope = dot(d, n)
    if slope == 0.0 or u + v + w == 0.0:
        return False
    height = dot(minus(point, a), n)
    if slope < 0.0:
        height, slope = -height, -slope
    return height * math.sqrt(dot(d, d)) > contact * slope and height < slope


@njit()
def meeting(origin, direction, a, b, c):
    """Where the closed triangle abc meets the open ray from an origin.

    Parameters
    ----------
    origin, direction, a, b, c : tuples or arrays of 3 float64, world space; the direction of any length but 0

    Returns
    -------
    float
        How many times `direction` away the meeting point is, positive; infinity for a ray that misses.

    Notes
    -----
    The same signed volumes as in `blocks`, with the ray's origin as theirs: edges shared by two faces do not leak.
    A ray within the face's plane misses it, and so does one that starts on it and does not come back.
    """
    u, v, w = volumes(origin, direction, a, b, c)
    if not of_one_sign(u, v, w):
        return math.inf
    n = cross(minus(b, a), minus(c, a))
    slope = dot(direction, n)
    if slope == 0.0 or u + v + w == 0.0:
        return math.inf
    fraction = dot(minus(a, origin), n) / slope
    return fraction if fraction > 0.0 else math.inf
