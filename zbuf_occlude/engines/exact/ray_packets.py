"""First hits of packets of 32 rays of one origin, tested against listed leaves, nearest first.

A leaf is skipped if no ray passes through its rectangle in front of the ray's nearest hit so far. If few rays do, each
is tested against the 16 faces at once. If many do, the faces that miss the packet's rectangle are dropped, 16 at a
time, and each remaining face is tested against 16 rays at once. A face that a ray certainly meets nearer than its
nearest face so far replaces it. Where float32 cannot tell whether a face is met, or which of two is nearer, the float64
definition decides, ray by ray. The answers are therefore the oracle's, ties included.
"""

import math
from typing import NamedTuple

import numpy as np

from zbuf_occlude.base.arrays import FloatArray, IntArray
from zbuf_occlude.base.jit.compiler import always_inline, device_function, njit
from zbuf_occlude.base.jit.simd import (
    ALL,
    N_LANES,
    absolute,
    blend,
    count_lanes,
    divide,
    first_lane,
    greater,
    highest,
    load,
    load3,
    load_scalar,
    load_scalar3,
    lowest,
    maximum,
    minimum,
    muladd,
    not_less,
    splat,
    store,
    store_masked,
)
from zbuf_occlude.base.jit.vec3 import cross, dot, minus
from zbuf_occlude.engines.exact.bvh import corners_of
from zbuf_occlude.engines.exact.layout import (
    BOTTOM,
    EDGES,
    F32_MAX,
    LEAF,
    LEFT,
    MIN_W,
    ONE,
    PACKET,
    RIGHT,
    SETUP_ROWS,
    TOP,
    ZERO,
    Float32,
)
from zbuf_occlude.engines.exact.project import ImageRect
from zbuf_occlude.engines.exact.search import overlapping
from zbuf_occlude.engines.exact.triangle_setup import CERTAIN, DEPTH, faces_before, set_up_for_rays, slot_of
from zbuf_occlude.geometry.determinants import CLEAR, FILTER, TINY, filtered_determinant
from zbuf_occlude.geometry.predicates import is_nearer, ray_plane_t, ray_triangle_t

ROUNDED = np.float32(5e-7)
"""Error bound of a g computed from a float64 distance, per 1 + |g|."""
ROUNDED_UP = np.float32(1.000002)
MAX_SINGLE_RAYS = 6
"""Maximum rays tested one by one against the 16 faces of a leaf; more are tested together, face by face."""


class PacketRays(NamedTuple):
    """Rays of one origin, world space, and their answers: the hit is at height / slope directions from the origin."""

    origin: FloatArray  # (3,)
    directions: FloatArray  # (3 n,)
    face_ids: IntArray  # (n,)
    heights: FloatArray  # (n,)
    slopes: FloatArray  # (n,)
    chosen: IntArray  # (m,) indices of the packet's rays


class RayFrame(NamedTuple):
    """Frame of a view, for rays."""

    inside: bool  # True for a face of a cube about the origin
    axis: FloatArray  # (3,) axis w of the frame
    inverse_away: float  # 1 / distance of the origin from the scene's centre
    max_w: np.float32


class PacketState(NamedTuple):
    """Positions and nearest hits so far of the 32 rays of a packet."""

    coordinates: Float32  # (2, 32) x / w and y / w, padded by repeating the last ray
    lows: Float32  # (32,) lower bound of g (`triangle_setup`) of the nearest hit so far; `F32_MAX` for none
    highs: Float32  # (32,) upper bound of g
    limits: Float32  # (32,) largest w that the upper bound of g allows
    scratch: Float32  # (2, 16)
    face_ids: IntArray  # (32,) nearest face so far, -1 for none


@njit(_nrt=True)
def make_state():
    """Return an empty `PacketState`."""
    return PacketState(
        coordinates=np.empty((2, PACKET), dtype=np.float32),
        lows=np.empty(PACKET, dtype=np.float32),
        highs=np.empty(PACKET, dtype=np.float32),
        limits=np.empty(PACKET, dtype=np.float32),
        scratch=np.empty((2, LEAF), dtype=np.float32),
        face_ids=np.empty(PACKET, dtype=np.int32),
    )


@device_function
def rect_of_rays(coordinates, first, last, max_w):
    """Return the rectangle around the rays first to last - 1 of (2, n) coordinates; `first` is a multiple of 16."""
    x, y, room = load(coordinates, first), load(coordinates, coordinates.shape[1] + first), coordinates.shape[1]
    left, right, bottom, top = x, x, y, y
    for i in range(first + N_LANES, last, N_LANES):
        x, y = load(coordinates, i), load(coordinates, room + i)
        left, right, bottom, top = minimum(left, x), maximum(right, x), minimum(bottom, y), maximum(top, y)
    return ImageRect(lowest(left), highest(right), lowest(bottom), highest(top), max_w)


@device_function
def first_hits_of_packet(bvh, view, frame, rays, n_listed, space, state):
    """Find the first hits of the chosen rays, at most `PACKET`, among the leaves in ``space.listed``.

    The rays' coordinates are in `state`.
    """
    max_w = frame.max_w
    rect = rect_of_rays(state.coordinates, 0, PACKET, max_w)
    for at in range(0, PACKET, N_LANES):
        store(state.lows, at, splat(F32_MAX))
        store(state.highs, at, splat(F32_MAX))
        store(state.limits, at, splat(max_w))
        store_masked(state.face_ids, at, ALL, np.int32(-1))
    limit, active = F32_MAX, (1 << len(rays.chosen)) - 1
    for j in range(0, n_listed, LEAF):
        found = overlapping(space.listed.rectangles, j, space.listed.rectangles.shape[1], rect)
        if n_listed - j < LEAF:
            found &= (1 << (n_listed - j)) - 1
        while found:
            entry = j + first_lane(found)
            found &= found - 1
            within = active & _rays_before(space.listed.rectangles, entry, state)
            if within == 0:
                continue
            leaf = space.listed.leaves[entry]
            slot, changed = slot_of(bvh, leaf, view, space, set_up_for_rays), False
            if count_lanes(within) <= MAX_SINGLE_RAYS:
                while within:
                    lane = first_lane(within)
                    within &= within - 1
                    changed |= _test_ray(bvh, frame, rays, leaf, slot, lane, space, state)
            else:
                faces = faces_before(bvh, leaf, space, slot, rect, limit)
                while faces:
                    lane = first_lane(faces)
                    faces &= faces - 1
                    changed |= _test_face(bvh, frame, rays, within, leaf, slot, lane, space, state)
            if changed:
                limit, most = -F32_MAX, ZERO
                for at in range(0, PACKET, N_LANES):
                    highs = load(state.highs, at)
                    limits = _max_w(frame, highs)
                    store(state.limits, at, limits)
                    limit, most = max(limit, highest(highs)), max(most, highest(limits))
                rect = ImageRect(rect.left, rect.right, rect.bottom, rect.top, most)
    _finish(bvh, rays, state)


@always_inline
def _max_w(frame, g):
    """Return the largest w that each g allows, rounded up; the frame's largest w if g sets no limit."""
    zero, one, max_w = splat(ZERO), splat(ONE), splat(frame.max_w)
    # -1 / g, or 1 / (1 - g / D)
    divisor = -g if frame.inside else one - g * splat(np.float32(frame.inverse_away))
    ahead = greater(divisor, zero)
    w = divide(splat(ROUNDED_UP), blend(ahead, divisor, one))
    return blend(ahead, minimum(w, max_w), max_w)


@always_inline
def _rays_before(rectangles, entry, state):
    """Return the mask of the rays that pass through a listed rectangle in front of their nearest hit so far."""
    left, right = splat(rectangles[LEFT, entry]), splat(rectangles[RIGHT, entry])
    bottom, top = splat(rectangles[BOTTOM, entry]), splat(rectangles[TOP, entry])
    nearest, within = splat(rectangles[MIN_W, entry]), 0
    for at in range(0, PACKET, N_LANES):
        x, y = load(state.coordinates, at), load(state.coordinates, PACKET + at)
        mask = not_less(x, left) & not_less(right, x) & not_less(y, bottom) & not_less(top, y)
        within |= (mask & not_less(load(state.limits, at), nearest)) << at
    return within


@always_inline
def _test_ray(bvh, frame, rays, leaf, slot, lane, space, state):
    """Test a ray against the faces of a leaf; return whether its nearest hit has changed."""
    x, y = splat(state.coordinates[0, lane]), splat(state.coordinates[1, lane])
    base, inside = slot * SETUP_ROWS * LEAF, splat(F32_MAX)
    for edge in range(3):
        a, b, c = load3(space.setups, base + (EDGES + 3 * edge) * LEAF, LEAF)
        inside = minimum(inside, muladd(x, a, muladd(y, b, c)))
    maybe = bvh.used[leaf] & not_less(inside, splat(-CERTAIN))
    if maybe == 0:
        return False
    row = base + DEPTH * LEAF
    a, b, c = load3(space.setups, row, LEAF)
    g = muladd(x, a, muladd(y, b, c))
    error = muladd(absolute(g), load(space.setups, row + 4 * LEAF), load(space.setups, row + 3 * LEAF))
    low, high = g - error, g + error
    maybe &= not_less(splat(state.highs[lane]), low)
    sure = greater(inside, splat(CERTAIN)) & ~space.doubtful[slot]
    store(state.scratch, 0, low)
    store(state.scratch, LEAF, high)
    changed = False
    while maybe:
        face_lane = first_lane(maybe)
        maybe &= maybe - 1
        face = bvh.face_ids[leaf, face_lane]
        if (sure >> face_lane) & 1 and state.scratch[1, face_lane] < state.lows[lane]:
            state.lows[lane], state.highs[lane] = state.scratch[0, face_lane], state.scratch[1, face_lane]
            state.face_ids[lane] = face
            changed = True
        elif state.scratch[0, face_lane] <= state.highs[lane]:
            changed |= _decide(bvh, frame, rays, face, lane, state)
    return changed


@always_inline
def _test_face(bvh, frame, rays, within, leaf, slot, face_lane, space, state):
    """Test the rays `within` against a face of a leaf; return whether any ray's nearest hit has changed."""
    base = slot * SETUP_ROWS * LEAF + face_lane
    row = base + DEPTH * LEAF
    face, known = bvh.face_ids[leaf, face_lane], ((space.doubtful[slot] >> face_lane) & 1) - 1
    changed = False
    for at in range(0, PACKET, N_LANES):
        x, y, inside = load(state.coordinates, at), load(state.coordinates, PACKET + at), splat(F32_MAX)
        for edge in range(3):
            a, b, c = load_scalar3(space.setups, base + (EDGES + 3 * edge) * LEAF, LEAF)
            inside = minimum(inside, muladd(x, a, muladd(y, b, c)))
        maybe = (within >> at) & not_less(inside, splat(-CERTAIN))
        if maybe == 0:
            continue
        a, b, c = load_scalar3(space.setups, row, LEAF)
        g = muladd(x, a, muladd(y, b, c))
        error = muladd(
            absolute(g), load_scalar(space.setups, row + 4 * LEAF), load_scalar(space.setups, row + 3 * LEAF)
        )
        low, high, lows, highs = g - error, g + error, load(state.lows, at), load(state.highs, at)
        maybe &= not_less(highs, low)
        sure = maybe & known & greater(inside, splat(CERTAIN)) & greater(lows, high)
        if sure:
            store(state.lows, at, blend(sure, low, lows))
            store(state.highs, at, blend(sure, high, highs))
            store_masked(state.face_ids, at, sure, face)
        doubtful = maybe & ~sure
        changed |= sure != 0
        while doubtful:
            lane = first_lane(doubtful)
            doubtful &= doubtful - 1
            changed |= _decide(bvh, frame, rays, face, at + lane, state)
    return changed


@njit(error_model="numpy")
def _decide(bvh, frame, rays, candidate, lane, state):
    """Decide in float64 whether a ray meets a face before its nearest hit so far; if so record it and return True."""
    i = rays.chosen[lane]
    origin, direction = _triple(rays.origin, 0), _triple(rays.directions, 3 * i)
    corners, face = corners_of(bvh, candidate), np.int64(state.face_ids[lane])
    if candidate == face:
        return False
    found, error = ray_triangle_t(origin, direction, *corners)
    if found == math.inf:
        return False
    if face >= 0:
        other_corners = corners_of(bvh, face)
        other, other_error = ray_plane_t(origin, direction, *other_corners)
        if not is_nearer(
            *(origin, direction, np.int64(candidate), found, error, face, other, other_error), *(corners, other_corners)
        ):
            return False
    state.face_ids[lane] = candidate
    along = dot(frame.axis, direction) * bvh.scale
    w, w_error = found * along, error * abs(along)
    g, g_error = -1.0 / w, 1.01 * w_error / (w * w)  # the derivative of -1 / w, with room for the next order
    if not frame.inside:
        g, g_error = (1.0 + g) / frame.inverse_away, g_error / frame.inverse_away
    margin = ROUNDED * (ONE + np.float32(abs(g))) + np.float32(g_error)
    state.lows[lane], state.highs[lane] = np.float32(g) - margin, np.float32(g) + margin
    return True


@always_inline
def _triple(numbers, first):
    return numbers[first], numbers[first + 1], numbers[first + 2]


@device_function
def _finish(bvh, rays, state):
    """Write the answers: face ids, and distances as quotients."""
    directions, face_ids, heights, slopes = rays.directions, rays.face_ids, rays.heights, rays.slopes
    origin = _triple(rays.origin, 0)
    before, normal, height, least = -1, (0.0, 0.0, 0.0), 0.0, 0.0
    for lane in range(len(rays.chosen)):
        face = state.face_ids[lane]
        if face < 0:
            continue
        if face != before:
            before = face
            a, b, c = corners_of(bvh, face)
            height, normal, least = _plane(origin, a, b, c)
        i = rays.chosen[lane]
        direction = _triple(directions, 3 * i)
        face_ids[i], heights[i], slopes[i] = face, height, dot(direction, normal)
        if not abs(slopes[i]) > least * (abs(direction[0]) + abs(direction[1]) + abs(direction[2])):
            heights[i], slopes[i] = ray_triangle_t(origin, direction, *corners_of(bvh, face))[0], 1.0


@always_inline
def _plane(origin, a, b, c):
    """Return a face's height over a ray's origin, its normal scaled alike, and the least accurate slope per direction.

    Notes
    -----
    A component of the normal errs by 4 u times the two products that it is the difference of: `CLEAR` times less than
    the least accurate slope. If the height is inaccurate, the least accurate slope is infinite.
    """
    ab, ac = minus(b, a), minus(c, a)
    to_a, n = minus(a, origin), cross(ab, ac)
    height, error = filtered_determinant(to_a, ab, ac)
    size = max(abs(ab[0]), abs(ab[1]), abs(ab[2])) * max(abs(ac[0]), abs(ac[1]), abs(ac[2]))
    least = CLEAR * (2.0 * FILTER * size + TINY) if abs(height) > CLEAR * error else math.inf
    return height, n, least
