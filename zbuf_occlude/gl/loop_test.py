"""The depth test of 16 points at a time, and the witness test of those it leaves in doubt, for the CPU.

Formula by formula what vote.comp, depth_test.comp and witness.comp say; there the reasons are. But witnesses are asked
in float64 (the eye is the float32 one), and points that rounding puts beside their cube face are visible.
"""

import numpy as np
from numba import njit

from zbuf_occlude.gl.point_data import EDGE_ON, MOST_HIDDEN
from zbuf_occlude.lanes import (
    ALL,
    N_LANES,
    absolute,
    divide,
    first_lane,
    gather,
    greater,
    load,
    maximum,
    minimum,
    muladd,
    not_less,
    select,
    splat,
    store,
    whole,
)
from zbuf_occlude.predicates import blocks, cross, dot, minus

ZERO, HALF, ONE = np.float32(0.0), np.float32(0.5), np.float32(1.0)

PLACE = 6
"""Of what is known of a point's place in the atlas: x and y, in pixels from the centre of the first; the depth of its
plane at the centre of the pixel there, rounded down, and what it gains to the right and upwards; the allowance."""

_PIXELS = np.stack([np.tile(np.arange(-1, 3), 4), np.repeat(np.arange(-1, 3), 4)]).astype(np.float32)
"""The 4 x 4 pixels around a point: columns, rows."""

# where a tile's numbers are, see tiles.TILE
_ACROSS, _GAIN, _UPWARD, _RANGE, _EYE, _CORNER, _SIDE = 16, 19, 20, 23, 24, 28, 30


# _nrt=False: the kernels allocate nothing, and counting references to their arrays would cost more than the arithmetic


@njit(_nrt=False, forceinline=True)
def _to_eye(base, tile, tiles, points):  # type: ignore[no-untyped-def]
    """Vectors from 16 points to a tile's eye."""
    n = points.coordinates.shape[1]
    return (
        splat(tiles[tile, _EYE]) - load(points.coordinates, base),
        splat(tiles[tile, _EYE + 1]) - load(points.coordinates, n + base),
        splat(tiles[tile, _EYE + 2]) - load(points.coordinates, 2 * n + base),
    )


@njit(_nrt=False, forceinline=True)
def on_side(side, base, tile, tiles, points):  # type: ignore[no-untyped-def]
    """Mask of the points that lie on one of the six faces of the cube about an eye."""
    d = _to_eye(base, tile, tiles, points)
    x, y, z = absolute(d[0]), absolute(d[1]), absolute(d[2])
    along_x = not_less(x, y) & not_less(x, z)
    along_y = ~along_x & not_less(y, z)
    zero = splat(ZERO)
    if side < 2:
        found, behind = along_x, greater(d[0], zero)
    elif side < 4:
        found, behind = along_y, greater(d[1], zero)
    else:
        found, behind = ~along_x & ~along_y, greater(d[2], zero)
    return ALL & found & (behind if side % 2 else ~behind)


@njit(_nrt=False, forceinline=True)
def vote(packet, tile, cube, depths, tiles, points, criteria, places):  # type: ignore[no-untyped-def]
    """Masks of the points of a packet that are seen, and of those about which the four pixels around do not agree.

    `places` receives where the latter lie in the atlas, see `PLACE`.
    """
    n, at = points.coordinates.shape[1], packet * N_LANES
    p = (load(points.coordinates, at), load(points.coordinates, n + at), load(points.coordinates, 2 * n + at))
    normal = (load(points.normals, at), load(points.normals, n + at), load(points.normals, 2 * n + at))
    d = _to_eye(at, tile, tiles, points)
    facing = muladd(d[0], normal[0], muladd(d[1], normal[1], d[2] * normal[2]))
    before = ALL
    if not cube:
        size = absolute(d[0]) + absolute(d[1]) + absolute(d[2])
        before &= ~(points.closed[packet] & greater(splat(np.float32(-EDGE_ON)) * size, facing))
    if not before:
        return 0, 0
    zero, one, half = splat(ZERO), splat(ONE), splat(HALF)
    w = _row(tiles, tile, 3, p)
    inverse = divide(one, w)
    x, y = _row(tiles, tile, 0, p) * inverse, _row(tiles, tile, 1, p) * inverse
    depth = _row(tiles, tile, 2, p) * inverse
    left, bottom, side = tiles[tile, _CORNER], tiles[tile, _CORNER + 1], tiles[tile, _SIDE] - ONE
    # a picture's border of two pixels is empty; nothing is before what lies outside
    pictured = greater(w, zero) & greater(x, splat(left + ONE)) & greater(splat(left + side), x)
    pictured &= greater(y, splat(bottom + ONE)) & greater(splat(bottom + side), y)
    unit = splat(tiles[tile, _GAIN]) * inverse * inverse
    most = splat(tiles[tile, _RANGE]) * unit
    sloping, per_facing = greater(absolute(facing), zero), divide(one, facing)
    gain_x = select(sloping, _clamped(_along(tiles, tile, _ACROSS, normal) * per_facing, most), zero)
    gain_y = select(sloping, _clamped(_along(tiles, tile, _UPWARD, normal) * per_facing, most), zero)
    allowance = splat(criteria.tolerance) * unit
    height, width = depths.shape
    if not criteria.witness:
        allowance = muladd(splat(criteria.slope_bias), maximum(absolute(gain_x), absolute(gain_y)), allowance)
        row, column = whole(_within(y, height)), whole(_within(x, width))
        hidden = greater(gather(depths, width, row, column), maximum(depth, zero) + allowance)
        return before & ~(hidden & pictured), 0
    row, column = whole(_within(y - half, height - 1)), whole(_within(x - half, width - 1))
    base = depth + muladd(gain_x, column + half - x, gain_y * (row + half - y))
    some, every = 0, ALL
    for j in range(2):
        for i in range(2):
            plane = maximum(muladd(splat(np.float32(i)), gain_x, muladd(splat(np.float32(j)), gain_y, base)), zero)
            nearest = gather(depths, width, row + splat(np.float32(j)), column + splat(np.float32(i)))
            hidden = greater(nearest, plane + allowance)
            some, every = some | hidden, every & hidden
    doubtful = before & some & ~every & pictured
    if doubtful:
        store(places, 0, x - half)
        store(places, 16, y - half)
        store(places, 32, base)
        store(places, 48, gain_x)
        store(places, 64, gain_y)
        store(places, 80, allowance)
    return before & ~(some & pictured), doubtful


@njit(_nrt=False, forceinline=True)
def _row(tiles, tile, r, p):  # type: ignore[no-untyped-def]
    """Row r of a tile's matrix times (p, 1)."""
    rest = muladd(p[2], splat(tiles[tile, 8 + r]), splat(tiles[tile, 12 + r]))
    return muladd(p[0], splat(tiles[tile, r]), muladd(p[1], splat(tiles[tile, 4 + r]), rest))


@njit(_nrt=False, forceinline=True)
def _along(tiles, tile, first, normal):  # type: ignore[no-untyped-def]
    """Three of a tile's numbers, from `first` on, times the normals."""
    rest = normal[2] * splat(tiles[tile, first + 2])
    return muladd(normal[0], splat(tiles[tile, first]), muladd(normal[1], splat(tiles[tile, first + 1]), rest))


@njit(_nrt=False, forceinline=True)
def _clamped(gain, most):  # type: ignore[no-untyped-def]
    return minimum(maximum(gain, splat(ZERO) - most), most)


@njit(_nrt=False, forceinline=True)
def _within(index, n):  # type: ignore[no-untyped-def]
    """The nearest number between the first and the last index of an array of n; 0 for NaN."""
    return minimum(maximum(index, splat(ZERO)), splat(np.float32(n - 1)))


@njit(_nrt=False, forceinline=True)
def settle(i, lane, tile, depths, seen, tiles, points, corners, criteria, places):  # type: ignore[no-untyped-def]
    """Whether point i is visible, about which the pixels around do not agree: witness.comp says how."""
    x, y = places[0, lane], places[1, lane]
    column, row = int(x), int(y)
    gain_x, gain_y = places[3, lane], places[4, lane]
    # votes of the 4 x 4 pixels around, from the lower left; those beside the atlas are those of its edge
    rows = _within(splat(np.float32(row)) + load(_PIXELS, 16), depths.shape[0])
    columns = _within(splat(np.float32(column)) + load(_PIXELS, 0), depths.shape[1])
    plane = muladd(splat(gain_x), load(_PIXELS, 0), muladd(splat(gain_y), load(_PIXELS, 16), splat(places[2, lane])))
    nearest = gather(depths, depths.shape[1], rows, columns)
    votes = greater(nearest, maximum(plane, splat(ZERO)) + splat(places[5, lane]))
    eye = (np.float64(tiles[tile, _EYE]), np.float64(tiles[tile, _EYE + 1]), np.float64(tiles[tile, _EYE + 2]))
    point = (points.positions[i, 0], points.positions[i, 1], points.positions[i, 2])
    own, last, left = points.own[i], -1, votes
    while left:
        pixel = first_lane(left)
        left &= left - 1
        face = seen[_at(row + pixel // 4 - 1, seen.shape[0]), _at(column + pixel % 4 - 1, seen.shape[1])]
        if face >= 0 and face != last and face != own and _blocks(eye, point, corners, face, criteria.contact):
            return False
        last = face
    high = (x - np.float32(column), y - np.float32(row))
    weighed = 0.0
    for j in range(2):
        for k in range(2):
            face = seen[_at(row + j, seen.shape[0]), _at(column + k, seen.shape[1])]
            if face >= 0 and (face == own if own >= 0 else _touches(point, corners, face, criteria.contact)):
                return True
            nearness = (high[0] if k else ONE - high[0]) * (high[1] if j else ONE - high[1])
            weighed += nearness * (votes >> (4 * (j + 1) + k + 1) & 1)
    return weighed <= MOST_HIDDEN


@njit(_nrt=False, forceinline=True)
def _at(i, n):  # type: ignore[no-untyped-def]
    """The nearest index that an array of n has."""
    return min(max(i, 0), n - 1)


@njit(_nrt=False)
def _blocks(eye, point, corners, face, contact):  # type: ignore[no-untyped-def]
    """Whether a face blocks the line of sight, by the definition."""
    f = corners[face]
    a, b, c = (f[0, 0], f[0, 1], f[0, 2]), (f[1, 0], f[1, 1], f[1, 2]), (f[2, 0], f[2, 1], f[2, 2])
    return blocks(eye, point, a, b, c, contact)


@njit(_nrt=False)
def _touches(point, corners, face, contact):  # type: ignore[no-untyped-def]
    """Whether a point lies in a face's plane, within the contact tolerance."""
    c = corners[face]
    a = (c[0, 0], c[0, 1], c[0, 2])
    n = cross(minus((c[1, 0], c[1, 1], c[1, 2]), a), minus((c[2, 0], c[2, 1], c[2, 2]), a))
    off = dot(minus(point, a), n)
    return off * off <= contact * contact * dot(n, n)
