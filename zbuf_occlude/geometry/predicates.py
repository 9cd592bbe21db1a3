"""Definition of "blocked" and of "hit": does a face block a line of sight, and where does a ray meet it?

Answers, and the order of hits, are those of rational arithmetic on the given float64 numbers (`determinants`). Only
distances are rounded: to a relative 1e-8. `exact_hsr` (the paper's perpendicular planes) must not import this file: the
two formulations check each other.

A line passes through the closed triangle abc iff no two of the volumes that it spans with the edges bc, ca and ab have
opposite signs. Their sum is d . n, with the face's normal n and the line's direction d. All three are zero for a line
within the face's plane, which the face does not block (paper Eq. 6 has no solution).
"""

import math

from zbuf_occlude.base.jit.compiler import always_inline, device_function, external, njit
from zbuf_occlude.base.jit.vec3 import dot, minus
from zbuf_occlude.geometry.determinants import (
    CLEAR,
    SIGN,
    compare_quotients,
    determinant,
    filtered_determinant,
    low_part,
)

EXACTLY = (0.0, 0.0, 0.0)
"""Low part of a row that was not rounded."""
IN_DOUBT = 2
"""Answer of a filter that cannot decide."""
ROUNDING = 1e-15
"""Bound on the relative rounding error of a quotient and a sum."""


@always_inline
def passes(origin, direction, a, b, c):
    """Return the side from which a line passes through the closed triangle abc, 1 or -1; 0 if it misses; or `IN_DOUBT`.

    The volume of an edge pq, d . ((p - o) x (q - o)), equals d . ((p - o) x (q - p)), whose products are smaller from
    afar.
    """
    misses, is_sure, above = _sides(origin, direction, a, b, c)
    if misses:
        return 0
    if is_sure:
        return 1 if above else -1
    return IN_DOUBT


@always_inline
def _sides(origin, direction, a, b, c):
    """Return whether a line surely misses a triangle, whether no edge is in doubt, and whether an edge is on side 1."""
    u, u_error = filtered_determinant(direction, minus(b, origin), minus(c, b))
    v, v_error = filtered_determinant(direction, minus(c, origin), minus(a, c))
    w, w_error = filtered_determinant(direction, minus(a, origin), minus(b, a))
    above = (u > u_error) | (v > v_error) | (w > w_error)
    below = (u < -u_error) | (v < -v_error) | (w < -w_error)
    return above & below, (abs(u) > u_error) & (abs(v) > v_error) & (abs(w) > w_error), above


@njit()
def passes_exactly(origin, direction, direction_low, a, b, c):
    """Return the side from which a line passes through the closed triangle abc, 1 or -1; 0 if it misses."""
    o, d, e = origin, direction, direction_low
    return _passes_exactly(
        o[0], o[1], o[2], d[0], d[1], d[2], e[0], e[1], e[2], a[0], a[1], a[2], b[0], b[1], b[2], c[0], c[1], c[2]
    )


@external("int64(" + "float64," * 17 + "float64)")
def _passes_exactly(o0, o1, o2, d0, d1, d2, e0, e1, e2, a0, a1, a2, b0, b1, b2, c0, c1, c2):
    origin, direction, direction_low = (o0, o1, o2), (d0, d1, d2), (e0, e1, e2)
    a, b, c = (a0, a1, a2), (b0, b1, b2), (c0, c1, c2)
    u, v, w = _side(origin, direction, b, c), _side(origin, direction, c, a), _side(origin, direction, a, b)
    side = 0
    for sign in (u, v, w):  # signs that the filter decides first, since most triangles are missed
        if sign != IN_DOUBT:
            if side * sign < 0:
                return 0
            side = sign
    if u == IN_DOUBT:
        u = side_of_edge(origin, direction, direction_low, b, c)
        if side * u < 0:
            return 0
        side = side if u == 0 else u
    if v == IN_DOUBT:
        v = side_of_edge(origin, direction, direction_low, c, a)
        if side * v < 0:
            return 0
        side = side if v == 0 else v
    if w == IN_DOUBT:
        w = side_of_edge(origin, direction, direction_low, a, b)
        if side * w < 0:
            return 0
        side = side if w == 0 else w
    return side


@always_inline
def _side(origin, direction, p, q):
    volume, error = filtered_determinant(direction, minus(p, origin), minus(q, p))
    return 1 if volume > error else (-1 if volume < -error else IN_DOUBT)


@device_function
def side_of_edge(origin, direction, direction_low, p, q):
    """Return the side, 1, 0 or -1, on which a line passes the edge pq."""
    to_p, to_q, pq = minus(p, origin), minus(q, origin), minus(q, p)
    p_low = low_part(p, origin, to_p)
    if (direction == to_p and direction_low == p_low) or (
        direction == to_q and direction_low == low_part(q, origin, to_q)
    ):  # the line is aimed at a corner, without rounding
        return 0
    volume = determinant(SIGN, direction, direction_low, to_p, p_low, pq, low_part(q, p, pq))
    return 1 if volume > 0.0 else (-1 if volume < 0.0 else 0)


@always_inline
def side_of_ray(origin, direction, a, b, c):
    """Return the exact side from which a ray's line passes through the closed triangle abc, 1 or -1; 0 if it misses."""
    side = passes(origin, direction, a, b, c)
    if side == IN_DOUBT:
        side = passes_exactly(origin, direction, EXACTLY, a, b, c)
    return side


@device_function
def _height(point, a, b, c):
    """Return the determinant of a point's height over the face abc, with exact sign and a relative error below 1e-9."""
    p, ab, ac = minus(point, a), minus(b, a), minus(c, a)
    height, error = filtered_determinant(p, ab, ac)
    if not abs(height) > CLEAR * error:
        height = determinant(CLEAR, *_height_rows(point, a, b, c))
    return height


@always_inline
def _height_rows(point, a, b, c):
    p, ab, ac = minus(point, a), minus(b, a), minus(c, a)
    return p, low_part(point, a, p), ab, low_part(b, a, ab), ac, low_part(c, a, ac)


@always_inline
def _slope_rows(direction, a, b, c):
    ab, ac = minus(b, a), minus(c, a)
    return direction, EXACTLY, ab, low_part(b, a, ab), ac, low_part(c, a, ac)


@njit()
def blocks(eye, point, a, b, c, contact):
    """Return whether the closed triangle abc meets the open segment (eye, point) farther than `contact` from the point.

    Parameters
    ----------
    eye, point, a, b, c : tuples or arrays of 3 float64, world space
    contact : float
        Contact tolerance tau, in world units.

    Returns
    -------
    bool
        Exact, except that the meeting point's distance from the point is compared with `contact` to a relative 1e-8.

    Notes
    -----
    Eye and point must be strictly on opposite sides of the face's plane. The meeting point divides the segment in the
    ratio of their heights over it.
    """
    d = minus(point, eye)
    side = passes(point, d, a, b, c)
    if side == IN_DOUBT:
        side = passes_exactly(point, d, low_part(point, eye, d), a, b, c)
    if side == 0:
        return False
    near, far = _height(point, a, b, c), _height(eye, a, b, c)
    if not ((near > 0.0 > far) | (near < 0.0 < far)):
        return False
    return near / (near - far) * math.sqrt(dot(d, d)) > contact


@njit()
def ray_triangle_t(origin, direction, a, b, c):
    """Return the distance at which the open ray from an origin meets the closed triangle abc.

    Parameters
    ----------
    origin, direction, a, b, c : tuples or arrays of 3 float64, world space; the direction of any length but 0

    Returns
    -------
    fraction : float
        Distance to the meeting point as a multiple of `direction`, positive; infinity if the ray misses, exactly.
    error : float
        Bound on the error of `fraction`, at most 1e-8 of it. For faces smaller than 1e-100 it may not hold: products of
        three lengths underflow.

    Notes
    -----
    A ray within the face's plane misses the face, and so does a ray that starts on it.
    """
    direction = (direction[0], direction[1], direction[2])
    side = side_of_ray(origin, direction, a, b, c)
    if side == 0:
        return math.inf, 0.0
    fraction, error = ray_plane_t(origin, direction, a, b, c)
    return (fraction, error) if fraction > 0.0 else (math.inf, 0.0)


@njit(error_model="numpy", forceinline=True, no_cpython_wrapper=True)
def filtered_hit(origin, direction, a, b, c):
    """Return `ray_triangle_t` without branches; not a number where float64 cannot decide, any error for a miss."""
    misses, is_sure, _ = _sides(origin, direction, a, b, c)
    ab, ac = minus(b, a), minus(c, a)
    height, height_error = filtered_determinant(minus(a, origin), ab, ac)
    slope, slope_error = filtered_determinant(direction, ab, ac)
    is_sure &= (abs(height) > CLEAR * height_error) & (abs(slope) > CLEAR * slope_error)
    fraction = height / slope
    error = abs(fraction) * (height_error / abs(height) + slope_error / abs(slope) + ROUNDING)
    fraction = fraction if is_sure else math.nan
    return math.inf if misses | (fraction <= 0.0) else fraction, error


@device_function
def ray_plane_t(origin, direction, a, b, c):
    """Return the multiple of `direction`, with exact sign, at which a line meets the plane of a face it passes through.

    Returns
    -------
    fraction, error : float
        The error is at most 1e-8 of the fraction.
    """
    to_a, ab, ac = minus(a, origin), minus(b, a), minus(c, a)
    height, height_error = filtered_determinant(to_a, ab, ac)
    slope, slope_error = filtered_determinant(direction, ab, ac)
    if not abs(height) > CLEAR * height_error:
        height = -determinant(CLEAR, *_height_rows(origin, a, b, c))
        height_error = abs(height) / CLEAR
    if not abs(slope) > CLEAR * slope_error:
        slope = determinant(CLEAR, *_slope_rows(direction, a, b, c))
        slope_error = abs(slope) / CLEAR
    if height == 0.0:
        return 0.0, 0.0
    fraction = height / slope
    return fraction, abs(fraction) * (height_error / abs(height) + slope_error / abs(slope) + ROUNDING)


@device_function
def is_nearer(
    origin, direction, face, fraction, error, other_face, other_fraction, other_error, corners, other_corners
):
    """Return whether a ray meets a face before another face: nearer, or equally near and with the lower id.

    Parameters
    ----------
    origin, direction : tuples or arrays of 3 float64, world space
    face, other_face : int
    fraction, error, other_fraction, other_error : float
        As returned by `ray_triangle_t`; infinity if there is no other face.
    corners, other_corners : tuples of 3 corners

    Returns
    -------
    bool, exact
    """
    if fraction + error < other_fraction - other_error:
        return True
    if fraction - error > other_fraction + other_error or fraction == math.inf:
        return False
    order = compare_hits(origin, direction, corners, other_corners)
    return order < 0 or (order == 0 and face < other_face)


@njit()
def compare_hits(origin, direction, corners, other_corners):
    """Return exactly -1, 0 or 1 if a ray that meets two faces meets the first before, with or after the other."""
    o, v, (a, b, c), (d, e, f) = origin, direction, corners, other_corners
    return _compare_hits(
        o[0], o[1], o[2], v[0], v[1], v[2], a[0], a[1], a[2], b[0], b[1], b[2], c[0], c[1], c[2],
        d[0], d[1], d[2], e[0], e[1], e[2], f[0], f[1], f[2],
    )  # fmt: skip


@external("int64(" + "float64," * 23 + "float64)")
def _compare_hits(
    o0, o1, o2, v0, v1, v2, a0, a1, a2, b0, b1, b2, c0, c1, c2, d0, d1, d2, e0, e1, e2, f0, f1, f2
):  # fmt: skip
    origin, direction = (o0, o1, o2), (v0, v1, v2)
    corners = a, b, c = (a0, a1, a2), (b0, b1, b2), (c0, c1, c2)
    other_corners = d, e, f = (d0, d1, d2), (e0, e1, e2), (f0, f1, f2)
    if _meet_at_once(origin, direction, corners, other_corners):
        return 0
    # the height's rows are relative to the face, so both quotients are negated
    return -compare_quotients(
        _height_rows(origin, a, b, c),
        _slope_rows(direction, a, b, c),
        _height_rows(origin, d, e, f),
        _slope_rows(direction, d, e, f),
    )


@njit()
def _meet_at_once(origin, direction, corners, other_corners):
    """Return whether two faces that a ray meets are met in one point, as far as comparisons of corners can tell.

    They lie in one plane perpendicular to an axis, have the same corners, or share an edge or corner that is met.
    """
    a, b, c = corners
    d, e, f = other_corners
    for axis in range(3):
        if a[axis] == b[axis] == c[axis] == d[axis] == e[axis] == f[axis]:
            return True
    has_a, has_b, has_c = _is_among(a, other_corners), _is_among(b, other_corners), _is_among(c, other_corners)
    if has_a & has_b & has_c:
        return True
    if (
        (has_a & has_b and _meets_edge(origin, direction, a, b))
        or (has_b & has_c and _meets_edge(origin, direction, b, c))
        or (has_c & has_a and _meets_edge(origin, direction, c, a))
    ):
        return True
    return (
        (has_a and _meets_edge(origin, direction, a, b) and _meets_edge(origin, direction, a, c))
        or (has_b and _meets_edge(origin, direction, b, c) and _meets_edge(origin, direction, b, a))
        or (has_c and _meets_edge(origin, direction, c, a) and _meets_edge(origin, direction, c, b))
    )


@always_inline
def _is_among(corner, corners):
    return corner == corners[0] or corner == corners[1] or corner == corners[2]


@device_function
def _meets_edge(origin, direction, a, b):
    """Return whether a ray that meets a face meets the line through two of its corners."""
    return side_of_edge(origin, direction, EXACTLY, a, b) == 0


@njit()
def is_flat(a, b, c):
    """Return exactly whether three positions lie on one line."""
    ab, ac = minus(b, a), minus(c, a)
    ab_low, ac_low = low_part(b, a, ab), low_part(c, a, ac)
    for axis in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)):
        if determinant(SIGN, axis, EXACTLY, ab, ab_low, ac, ac_low) != 0.0:
            return False
    return True
