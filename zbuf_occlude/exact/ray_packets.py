"""Thirty-two rays of one origin against the clusters listed before them, nearest first.

Clusters whose rectangles no ray goes through, or that lie behind what stops it, are left out. Where a few rays do, each
is asked about 16 faces side by side. Where many do, the faces that their own rectangle misses are left out 16 at a
time, and of each face left all rays are asked, 16 side by side. A face that a ray meets for certain nearer than its
nearest so far replaces that; where float32 cannot tell, whether it is met or which of two is nearer,
`predicates.meeting` does, ray by ray. So faces and distances are the oracle's, ties included.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.arrays import FloatArray, IntArray
from zbuf_occlude.exact.layout import (
    BOTTOM,
    CLUSTER,
    EDGES,
    ENDLESS,
    LEFT,
    NEAREST,
    ONE,
    RIGHT,
    SETUP_ROWS,
    TOP,
    ZERO,
)
from zbuf_occlude.exact.listing import overlapping
from zbuf_occlude.exact.ray_setup import DEPTH, WITHIN, faces_before, slot_of
from zbuf_occlude.exact.single_rays import nearer
from zbuf_occlude.jit.compiler import inlined, inner, njit
from zbuf_occlude.jit.simd import (
    ALL,
    N_LANES,
    absolute,
    count_lanes,
    divide,
    fill,
    first_lane,
    greater,
    highest,
    load,
    load3,
    lowest,
    maximum,
    minimum,
    muladd,
    not_less,
    number,
    numbers3,
    select,
    splat,
    store,
)
from zbuf_occlude.jit.vec3 import cross, dot, minus

ROUNDED = np.float32(5e-7)
"""Of a g taken from a distance in float64, per 1 + |g|."""


ROUNDED_UP = np.float32(1.000002)

PACKET_RAYS = 2 * N_LANES
"""Rays of a packet: two vectors, so that a look at a cluster, and each branch that nobody can predict, is for more."""

FEW_RAYS = 6
"""Up to this many rays are asked about the 16 faces of a cluster one after the other; of more, all about a face."""


class Window(NamedTuple):
    """Bounds of x / w and y / w of some rays, and of the w at which they may still meet something."""

    left: np.float32
    right: np.float32
    bottom: np.float32
    top: np.float32
    farthest: np.float32


class Rays(NamedTuple):
    """Rays of one origin.

    Parameters
    ----------
    origin : (3,) float64, world space
    directions : (3 n,) float64
    face_ids, heights, slopes : (n,) int32, float64, float64
        Their answers: a face is met height / slope directions away.
    chosen : (m,) int32
        Which of them are meant.
    """

    origin: FloatArray
    directions: FloatArray
    face_ids: IntArray
    heights: FloatArray
    slopes: FloatArray
    chosen: IntArray


class State(NamedTuple):
    """What is known of the rays of a packet, `PACKET_RAYS` of them.

    Parameters
    ----------
    coordinates : (2, 32) float32
        x / w and y / w; the last ray's again where there are fewer.
    lows, highs : (32,) float32
        Bounds of g (`rays.setup`) where the nearest face so far is met; `ENDLESS` for none.
    limits : (32,) float32
        The largest w that the upper bound stands for.
    scratch : (2, 16) float32
    face_ids : (32,) int32
        That face, -1 for none.
    fractions : (32,) float64
        How many directions away it is, of the rays of `decided`.
    decided : (1,) int64
        Mask of the rays of which more than the bounds is known.
    """

    coordinates: NDArray[np.float32]
    lows: NDArray[np.float32]
    highs: NDArray[np.float32]
    limits: NDArray[np.float32]
    scratch: NDArray[np.float32]
    face_ids: IntArray
    fractions: FloatArray
    decided: NDArray[np.int64]


@njit(_nrt=True)
def make_state():
    """Return an empty `State`."""
    return State(
        coordinates=np.empty((2, PACKET_RAYS), dtype=np.float32),
        lows=np.empty(PACKET_RAYS, dtype=np.float32),
        highs=np.empty(PACKET_RAYS, dtype=np.float32),
        limits=np.empty(PACKET_RAYS, dtype=np.float32),
        scratch=np.empty((2, CLUSTER), dtype=np.float32),
        face_ids=np.empty(PACKET_RAYS, dtype=np.int32),
        fractions=np.empty(PACKET_RAYS),
        decided=np.empty(1, dtype=np.int64),
    )


@inner
def window_of(coordinates, first, last, farthest):
    """Return the window of the rays from one to another, of (2, n) coordinates; `first` is a multiple of 16."""
    x, y, room = load(coordinates, first), load(coordinates, coordinates.shape[1] + first), coordinates.shape[1]
    left, right, bottom, top = x, x, y, y
    for i in range(first + N_LANES, last, N_LANES):
        x, y = load(coordinates, i), load(coordinates, room + i)
        left, right, bottom, top = minimum(left, x), maximum(right, x), minimum(bottom, y), maximum(top, y)
    return Window(lowest(left), highest(right), lowest(bottom), highest(top), farthest)


@inner
def first_hits_of_packet(scene, view, frame, rays, n_listed, space, state):
    """Find the faces that some rays meet first.

    Parameters
    ----------
    scene, view, frame
        The scene, a `View`, and the frame's `Frame`.
    rays : Rays
        At most `PACKET_RAYS` are chosen; their coordinates are in `state`.
    n_listed, space
        The clusters in ``space.listed``, the workspace.
    state : State
    """
    farthest = frame.farthest
    window = window_of(state.coordinates, 0, PACKET_RAYS, farthest)
    for at in range(0, PACKET_RAYS, N_LANES):
        store(state.lows, at, splat(ENDLESS))
        store(state.highs, at, splat(ENDLESS))
        store(state.limits, at, splat(farthest))
        fill(state.face_ids, at, ALL, np.int32(-1))
    state.decided[0] = 0
    limit, active = ENDLESS, (1 << len(rays.chosen)) - 1
    for j in range(0, n_listed, CLUSTER):
        found = overlapping(space.listed.rectangles, j, window)
        if n_listed - j < CLUSTER:
            found &= (1 << (n_listed - j)) - 1
        while found:
            entry = j + first_lane(found)
            found &= found - 1
            within = active & _rays_before(space.listed.rectangles, entry, state)
            if within == 0:
                continue
            cluster = space.listed.clusters[entry]
            slot, changed = slot_of(scene, cluster, view, space), False
            asked = cluster, slot
            if count_lanes(within) <= FEW_RAYS:
                while within:
                    lane = first_lane(within)
                    within &= within - 1
                    changed |= _ask_ray(scene, frame, rays, asked, lane, space, state)
            else:
                faces = faces_before(scene, cluster, space, slot, window, limit)
                while faces:
                    lane = first_lane(faces)
                    faces &= faces - 1
                    changed |= _ask_face(scene, frame, rays, within, asked, lane, space, state)
            if changed:
                limit, most = -ENDLESS, ZERO
                for at in range(0, PACKET_RAYS, N_LANES):
                    highs = load(state.highs, at)
                    limits = _farthest(frame, highs)
                    store(state.limits, at, limits)
                    limit, most = max(limit, highest(highs)), max(most, highest(limits))
                window = Window(window.left, window.right, window.bottom, window.top, most)
    _finish(scene, rays, state)


@inlined
def _farthest(frame, g):
    """Largest w that each g stands for, rounded up; the frame's where there is none."""
    zero, one, farthest = splat(ZERO), splat(ONE), splat(frame.farthest)
    # -1 / g, or 1 / (1 - g / D)
    divisor = zero - g if frame.inside else one - g * splat(np.float32(frame.inverse_away))
    ahead = greater(divisor, zero)
    w = divide(splat(ROUNDED_UP), select(ahead, divisor, one))
    return select(ahead, minimum(w, farthest), farthest)


@inlined
def _rays_before(rectangles, entry, state):
    """Mask of the rays that go through a listed rectangle and are not stopped before it."""
    left, right = splat(rectangles[LEFT, entry]), splat(rectangles[RIGHT, entry])
    bottom, top = splat(rectangles[BOTTOM, entry]), splat(rectangles[TOP, entry])
    nearest, within = splat(rectangles[NEAREST, entry]), 0
    for at in range(0, PACKET_RAYS, N_LANES):
        x, y = load(state.coordinates, at), load(state.coordinates, PACKET_RAYS + at)
        mask = not_less(x, left) & not_less(right, x) & not_less(y, bottom) & not_less(top, y)
        within |= (mask & not_less(load(state.limits, at), nearest)) << at
    return within


@inlined
def _ask_ray(scene, frame, rays, asked, lane, space, state):
    """Ask a ray about the faces of a (cluster, slot); return whether its nearest has changed."""
    cluster, slot = asked
    x, y = splat(state.coordinates[0, lane]), splat(state.coordinates[1, lane])
    base, inside = slot * SETUP_ROWS * CLUSTER, splat(ENDLESS)
    for edge in range(3):
        a, b, c = load3(space.setups, base + (EDGES + 3 * edge) * CLUSTER, CLUSTER)
        inside = minimum(inside, muladd(x, a, muladd(y, b, c)))
    maybe = scene.used[cluster] & not_less(inside, splat(-WITHIN))
    if maybe == 0:
        return False
    row = base + DEPTH * CLUSTER
    a, b, c = load3(space.setups, row, CLUSTER)
    g = muladd(x, a, muladd(y, b, c))
    error = muladd(absolute(g), load(space.setups, row + 4 * CLUSTER), load(space.setups, row + 3 * CLUSTER))
    low, high = g - error, g + error
    maybe &= not_less(splat(state.highs[lane]), low)
    sure = greater(inside, splat(WITHIN)) & ~space.doubtful[slot]
    store(state.scratch, 0, low)
    store(state.scratch, CLUSTER, high)
    changed = False
    while maybe:
        place = first_lane(maybe)
        maybe &= maybe - 1
        face = scene.face_ids[cluster, place]
        if (sure >> place) & 1 and state.scratch[1, place] < state.lows[lane]:
            state.lows[lane], state.highs[lane] = state.scratch[0, place], state.scratch[1, place]
            state.face_ids[lane] = face
            state.decided[0] &= ~(np.int64(1) << lane)
            changed = True
        elif state.scratch[0, place] <= state.highs[lane]:
            changed |= _decide(scene, frame, rays, face, lane, state)
    return changed


@inlined
def _ask_face(scene, frame, rays, within, asked, place, space, state):
    """Ask the rays within about a face of a (cluster, slot); return whether any ray's nearest has changed."""
    cluster, slot = asked
    base = slot * SETUP_ROWS * CLUSTER + place
    row = base + DEPTH * CLUSTER
    face, known = scene.face_ids[cluster, place], ((space.doubtful[slot] >> place) & 1) - 1
    changed = False
    for at in range(0, PACKET_RAYS, N_LANES):
        x, y, inside = load(state.coordinates, at), load(state.coordinates, PACKET_RAYS + at), splat(ENDLESS)
        for edge in range(3):
            a, b, c = numbers3(space.setups, base + (EDGES + 3 * edge) * CLUSTER, CLUSTER)
            inside = minimum(inside, muladd(x, a, muladd(y, b, c)))
        maybe = (within >> at) & not_less(inside, splat(-WITHIN))
        if maybe == 0:
            continue
        a, b, c = numbers3(space.setups, row, CLUSTER)
        g = muladd(x, a, muladd(y, b, c))
        error = muladd(absolute(g), number(space.setups, row + 4 * CLUSTER), number(space.setups, row + 3 * CLUSTER))
        low, high, lows, highs = g - error, g + error, load(state.lows, at), load(state.highs, at)
        maybe &= not_less(highs, low)
        sure = maybe & known & greater(inside, splat(WITHIN)) & greater(lows, high)
        if sure:
            store(state.lows, at, select(sure, low, lows))
            store(state.highs, at, select(sure, high, highs))
            fill(state.face_ids, at, sure, face)
            state.decided[0] &= ~(sure << at)
        doubtful = maybe & ~sure
        changed |= sure != 0
        while doubtful:
            lane = first_lane(doubtful)
            doubtful &= doubtful - 1
            changed |= _decide(scene, frame, rays, face, at + lane, state)
    return changed


@njit(error_model="numpy")
def _decide(scene, frame, rays, candidate, lane, state):
    """Decide in float64 whether a ray meets a face nearer than its nearest so far; return whether it does."""
    i = rays.chosen[lane]
    origin, direction = rays.origin, rays.directions[3 * i : 3 * i + 3]
    face, fraction = np.int64(state.face_ids[lane]), math.inf
    if (state.decided[0] >> lane) & 1:
        fraction = state.fractions[lane]
    elif face >= 0:
        normal, height = _plane(scene.world_corners[face], origin)
        fraction = height / dot(direction, normal)
    found, nearest = nearer(scene, origin, direction, candidate, face, fraction)
    if found < 0:
        return False
    state.face_ids[lane], state.fractions[lane] = found, nearest
    state.decided[0] |= np.int64(1) << lane
    w = nearest * dot(frame.axis, direction) * scene.scale
    g = -1.0 / w if frame.inside else (1.0 - 1.0 / w) / frame.inverse_away
    state.lows[lane] = np.float32(g) - ROUNDED * (ONE + np.float32(abs(g)))
    state.highs[lane] = np.float32(g) + ROUNDED * (ONE + np.float32(abs(g)))
    return found != face


@inlined
def _plane(corners, origin):
    """A face's normal n and its height h above a ray's origin: the face that the ray meets is h / d . n directions d
    away, as the last lines of `predicates.meeting` have it."""
    a = corners[0]
    n = cross(minus(corners[1], a), minus(corners[2], a))
    return n, dot(minus(a, origin), n)


@inner
def _finish(scene, rays, state):
    """Write the answers: faces, and distances as quotients."""
    directions, face_ids, heights, slopes = rays.directions, rays.face_ids, rays.heights, rays.slopes
    before, normal, height = -1, (0.0, 0.0, 0.0), 0.0
    for lane in range(len(rays.chosen)):
        face = state.face_ids[lane]
        if face < 0:
            continue
        if face != before:
            before = face
            normal, height = _plane(scene.world_corners[face], rays.origin)
        i = rays.chosen[lane]
        face_ids[i], heights[i] = face, height
        slopes[i] = dot((directions[3 * i], directions[3 * i + 1], directions[3 * i + 2]), normal)
        if (state.decided[0] >> lane) & 1:
            heights[i], slopes[i] = state.fractions[lane], 1.0
