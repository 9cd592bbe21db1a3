"""Occlusion tests: leaves against packets of points in float32; the float64 definition decides doubtful cases."""

import numpy as np

from zbuf_occlude.base.jit.compiler import always_inline, device_function, inline_ir
from zbuf_occlude.base.jit.simd import (
    absolute,
    dot3,
    equal_wide,
    first_lane,
    greater,
    load,
    load3,
    load3_wide,
    load_scalar,
    load_scalar3,
    load_unchecked,
    load_wide,
    minimum,
    muladd,
    not_less,
    splat,
)
from zbuf_occlude.base.jit.vec3 import minus
from zbuf_occlude.engines.exact.bvh import corners_of
from zbuf_occlude.engines.exact.layout import (
    CHUNK,
    CONTACT,
    EDGES,
    F32_MAX,
    HALF,
    LEAF,
    NORMAL,
    PACKET,
    PLANE_ERROR,
    SETUP_ROWS,
    UPPER,
    ZERO,
)
from zbuf_occlude.engines.exact.single_rays import corners_of_pair, set_limit, traverse_bvh, triple
from zbuf_occlude.geometry.predicates import blocks

SAFETY_FACTOR = np.float32(1.001)
"""Safety factor on every error bound; covers rounding in the bound itself."""
UNDECIDED = np.uint8(2)
"""Answer code: undecided because near the eye; retest in float64."""


@always_inline
def classify(bvh, points, space, slot, leaf, rect):
    """Test the 16 faces of a leaf against the bounds of a packet's points.

    Returns
    -------
    maybe : int
        Mask of the faces that may hide some of the points.
    covers : bool
        True if one face certainly hides all points. A face does not hide its own points even if they lie behind it.
    """
    row, packet = slot * SETUP_ROWS * LEAF, rect.first // PACKET
    cx, hx = splat(HALF * (rect.left + rect.right)), splat(HALF * (rect.right - rect.left))
    cy, hy = splat(HALF * (rect.bottom + rect.top)), splat(HALF * (rect.top - rect.bottom))
    best, worst = splat(F32_MAX), splat(F32_MAX)
    for edge in range(3):
        a, b, c = load3(space.setups, row + (EDGES + 3 * edge) * LEAF, LEAF)
        middle = muladd(a, cx, muladd(b, cy, c))
        half = muladd(absolute(a), hx, absolute(b) * hy)
        best, worst = minimum(best, middle + half), minimum(worst, middle - half)
    doubtful, used = space.doubtful[slot], bvh.used[leaf]
    normal = load3(space.setups, row + NORMAL * LEAF, LEAF)
    offset = load(space.setups, row + (NORMAL + 3) * LEAF)
    contact = load(space.setups, row + CONTACT * LEAF)
    middle, half = -offset, splat(PLANE_ERROR * rect.magnitude)
    for axis in range(3):
        lower, upper = points.boxes[axis, packet], points.boxes[UPPER + axis, packet]
        middle = muladd(normal[axis], splat(HALF * (lower + upper)), middle)
        half = muladd(absolute(normal[axis]), splat(HALF * (upper - lower)), half)
    behind = not_less(half - middle, contact * splat(rect.inverse_distance_min))
    maybe = not_less(best, splat(-rect.error_scale * SAFETY_FACTOR)) & (behind | doubtful) & used
    covering = maybe & ~doubtful & greater(worst, splat(rect.error_scale * SAFETY_FACTOR))
    if covering:
        covering &= greater(-middle - half, contact * splat(rect.inverse_distance_max))
        while covering:
            lane = first_lane(covering)
            if not equal_wide(points.own, rect.first, np.int32(LEAF * leaf + lane)):
                return maybe, True
            covering &= covering - 1
    return maybe, False


@always_inline
def hide_by_faces(bvh, points, view, space, at, faces, within, rect):
    """Test the points `within` of a packet against masked faces, face by face; return the mask of hidden points.

    `at` is the leaf and the slot that holds its set-up. No branch depends on the outcome of a test: it would be
    unpredictable, and would cost more than the tests.
    """
    leaf, slot = at
    base, width = slot * SETUP_ROWS * LEAF, points.coordinates.shape[1]
    x, y = load_wide(space.image, 0), load_wide(space.image, PACKET)
    point = load3_wide(points.coordinates, rect.first, width)
    edge_error, error = rect.error_scale * SAFETY_FACTOR, PLANE_ERROR * rect.magnitude
    most, least, doubtful = rect.inverse_distance_max, rect.inverse_distance_min, space.doubtful[slot]
    hidden, doubt, doubt_faces = 0, 0, 0
    while faces:
        lane = first_lane(faces)
        faces &= faces - 1
        row = base + lane
        p, q, r = _edge_of(space, row, 0), _edge_of(space, row, 1), _edge_of(space, row, 2)
        inside = _inside(x, y, p, q, r)
        normal = load_scalar3(space.setups, row + NORMAL * LEAF, LEAF)
        height = load_scalar(space.setups, row + (NORMAL + 3) * LEAF) - dot3(point, normal)
        contact = load_scalar(space.setups, row + CONTACT * LEAF)
        unknown = -((doubtful >> lane) & 1)
        possible = within & not_less(inside, -edge_error) & (not_less(height + error, contact * least) | unknown)
        possible &= ~equal_wide(points.own, rect.first, np.int32(leaf * LEAF + lane))
        sure = possible & greater(inside, edge_error) & greater(height - error, contact * most) & ~unknown
        hidden |= sure
        doubt |= possible & ~sure
        doubt_faces |= np.int64((possible & ~sure) != 0) << lane
    if doubt & ~hidden:
        hidden |= decide(bvh, points, view, leaf, doubt_faces, doubt & ~hidden, rect.first)
    return hidden


@always_inline
def hide_by_points(bvh, points, view, space, at, within, rect):
    """Test the points `within` of a packet against all faces of a leaf, point by point; return the hidden mask."""
    leaf, slot = at
    base, width = slot * SETUP_ROWS * LEAF, points.coordinates.shape[1]
    p, q, r = _edge(space, base, 0), _edge(space, base, 1), _edge(space, base, 2)
    normal = load3(space.setups, base + NORMAL * LEAF, LEAF)
    offset = load(space.setups, base + (NORMAL + 3) * LEAF)
    contact = load(space.setups, base + CONTACT * LEAF)
    edge_error, error = splat(rect.error_scale * SAFETY_FACTOR), splat(PLANE_ERROR * rect.magnitude)
    most, least = contact * splat(rect.inverse_distance_max), contact * splat(rect.inverse_distance_min)
    negative_edge_error, doubtful, used = (
        splat(-rect.error_scale * SAFETY_FACTOR),
        space.doubtful[slot],
        bvh.used[leaf],
    )
    hidden, doubt, doubt_faces = 0, 0, 0
    while within:
        lane = first_lane(within)
        within &= within - 1
        i = rect.first + lane
        x, y = load_scalar(space.image, lane), load_scalar(space.image, PACKET + lane)
        inside = _inside(x, y, p, q, r)
        height = offset - dot3(load_scalar3(points.coordinates, i, width), normal)
        possible = not_less(inside, negative_edge_error) & (not_less(height + error, least) | doubtful)
        possible &= used & ~_own_face(points.own[i] - LEAF * leaf)
        sure = possible & greater(inside, edge_error) & greater(height - error, most) & ~doubtful
        unsure = possible & ~sure
        hidden |= np.int64(sure != 0) << lane
        doubt |= np.int64(unsure != 0) << lane
        doubt_faces |= unsure
    if doubt & ~hidden:
        hidden |= decide(bvh, points, view, leaf, doubt_faces, doubt & ~hidden, rect.first)
    return hidden


@always_inline
def _edge(space, base, edge):
    return load3(space.setups, base + (EDGES + 3 * edge) * LEAF, LEAF)


@always_inline
def _edge_of(space, row, edge):
    return load_scalar3(space.setups, row + (EDGES + 3 * edge) * LEAF, LEAF)


@always_inline
def _inside(x, y, p, q, r):
    """Return the least of three edge functions, for many points in one face or one point in many faces."""
    inside = minimum(muladd(x, p[0], muladd(y, p[1], p[2])), muladd(x, q[0], muladd(y, q[1], q[2])))
    return minimum(inside, muladd(x, r[0], muladd(y, r[1], r[2])))


@always_inline
def _own_face(lane):
    """Return the mask of a lane; 0 if it is not one of the 16."""
    return np.int64(0 <= lane < LEAF) << (lane & (LEAF - 1))


@device_function
def decide(bvh, points, view, leaf, faces, doubt, first):
    """Return the mask of the doubtful points, counted from `first`, that one of the masked faces of a leaf blocks."""
    hidden = 0
    while doubt:
        i = first_lane(doubt)
        doubt &= doubt - 1
        hidden |= np.int64(_faces_block(bvh, points, view, first + i, leaf, faces)) << i
    return hidden


@device_function
def _faces_block(bvh, points, view, i, leaf, faces):
    """Return whether a masked face of a leaf, other than its own, blocks the line of sight of point i."""
    point = _world_point(points, i)
    while faces:
        lane = first_lane(faces)
        faces &= faces - 1
        if points.own[i] != leaf * LEAF + lane:
            a, b, c = corners_of(bvh, bvh.face_ids[leaf, lane])
            if blocks(view.world_eye, point, a, b, c, bvh.world_contact):
                return True
    return False


@device_function
def mark_near_points(points, view, chunks, answer):
    """Write `UNDECIDED` for the points of a range of chunks that are too near to the eye for any cube face."""
    for packet in range(chunks[0] * CHUNK, chunks[1] * CHUNK):
        radius = view.near * max(points.magnitudes[packet], view.magnitude) * 1.01
        apart = ZERO
        for axis in range(3):
            lower, upper = points.boxes[axis, packet], points.boxes[UPPER + axis, packet]
            apart = max(apart, lower - view.eye[axis], view.eye[axis] - upper)
        if apart > radius:
            continue
        for i in range(packet * PACKET, min((packet + 1) * PACKET, points.n_points)):
            if _is_near(points, view, i, radius):
                answer[points.order[i]] = UNDECIDED


@device_function
def _is_near(points, view, i, radius):
    """Return whether point i lies in the cube of half-width `radius` about the eye."""
    away = ZERO
    for axis in range(3):
        away = max(away, abs(points.coordinates[axis, i] - view.eye[axis]))
    return away <= radius


@inline_ir
def find_hidden(bvh, scratch, n):
    """Find a face, other than the point's own, that blocks each of n lines of sight; -1 in ``scratch.faces``: none."""
    for i in range(n):
        away = minus(triple(scratch.points, i), triple(scratch.origins, i))
        scratch.fractions[i], scratch.errors[i] = 1.0, 0.0
        if away == (0.0, 0.0, 0.0):  # the eye is at the point: nothing is between
            away, scratch.fractions[i] = (1.0, 0.0, 0.0), -1.0
        for axis in range(3):
            scratch.directions[3 * i + axis] = away[axis]
    traverse_bvh(bvh, scratch, n, _block)


@always_inline
def _block(bvh, scratch, first, n):
    """Record the face and stop the traversal where a face blocks the line of sight."""
    for j in range(n):
        i = load_unchecked(scratch.asking, first + j)
        a, b, c = corners_of_pair(scratch.pairs, j)
        if blocks(triple(scratch.origins, i), triple(scratch.points, i), a, b, c, bvh.world_contact):
            scratch.faces[i], scratch.fractions[i] = load_unchecked(scratch.asked, first + j), -1.0
            set_limit(scratch, i)


@device_function
def _world_point(points, i):
    k = points.order[i]
    return points.positions[k, 0], points.positions[k, 1], points.positions[k, 2]
