"""THE definition of "blocked" and of "hit": does a face block a line of sight, and where does a ray meet it?

Signed volumes, in float64. `exact_hsr` (the paper's perpendicular planes) must not import this file:
the two formulations check each other.
"""

import math

from numba import njit

from zbuf_occlude.vectors import cross, dot, minus


@njit
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
    a_, b_, c_ = minus(a, point), minus(b, point), minus(c, point)
    u = dot(d, cross(b_, c_))
    v = dot(d, cross(c_, a_))
    w = dot(d, cross(a_, b_))
    if not ((u >= 0.0 and v >= 0.0 and w >= 0.0) or (u <= 0.0 and v <= 0.0 and w <= 0.0)):
        return False
    n = cross(minus(b, a), minus(c, a))
    slope = dot(d, n)
    if slope == 0.0 or u + v + w == 0.0:
        return False
    height = dot(minus(point, a), n)
    if slope < 0.0:
        height, slope = -height, -slope
    return height * math.sqrt(dot(d, d)) > contact * slope and height < slope


@njit
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
    a_, b_, c_ = minus(a, origin), minus(b, origin), minus(c, origin)
    u = dot(direction, cross(b_, c_))
    v = dot(direction, cross(c_, a_))
    w = dot(direction, cross(a_, b_))
    if not ((u >= 0.0 and v >= 0.0 and w >= 0.0) or (u <= 0.0 and v <= 0.0 and w <= 0.0)):
        return math.inf
    n = cross(minus(b, a), minus(c, a))
    slope = dot(direction, n)
    if slope == 0.0 or u + v + w == 0.0:
        return math.inf
    fraction = dot(a_, n) / slope
    return fraction if fraction > 0.0 else math.inf
