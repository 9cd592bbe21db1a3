"""Sixteen rays from one place go down the scene's boxes as one beam; float32 where it is certain, float64 else.

A beam is the pyramid of four planes through the origin around the rays. Boxes and faces outside one of its planes are
left out, 16 at a time; of each face left, all rays are asked side by side. A face that a ray meets for certain nearer
than its nearest so far replaces that; where float32 cannot tell, whether it is met or which of two is nearer,
`predicates.meeting` does, ray by ray. So faces and distances are the oracle's, ties included.
"""

import numpy as np
from numba import njit

from zbuf_occlude.image_space.layout import CLUSTER, ENDLESS, PACKET, PLANE_ERROR, UPPER, ZERO
from zbuf_occlude.image_space.rays.beam import AXIS, N_PLANES
from zbuf_occlude.image_space.rays.single import EDGE_ERROR, MOMENT_ERROR, nearer, push_boxes, push_top
from zbuf_occlude.lanes import (
    absolute,
    cross3,
    divide,
    dot3,
    first_lane,
    greater,
    highest,
    load,
    load3,
    maximum,
    minimum,
    not_less,
    select,
    splat,
    splat3,
    store,
)
from zbuf_occlude.predicates import meeting

BEAM_ERROR = np.float32(2e-6)
"""Of a place's distance from a beam's plane, per reach: two roundings of the place, four of the plane, four of the sum,
each at most 1.2e-7 reaches."""

SLOPE_ERROR = np.float32(8e-7)
"""Of direction . unit normal."""

ROUNDED_UP, ROUNDED_DOWN = np.float32(1.0 + 5e-7), np.float32(1.0 - 5e-7)


@njit(_nrt=False)
def first_hits_of_packet(scene, beam, stack, state):
    """Fill in the faces that the rays of a beam meet first, and how many directions away.

    Parameters
    ----------
    scene : Scene
    beam, state : Beam, State
        As `make_beam` left them.
    stack : Stack
        Scratch.
    """
    n = push_top(scene, stack)
    limit = ENDLESS
    while n:
        n -= 1
        if stack.nearest[n] > limit:
            continue
        level, node = stack.levels[n], stack.nodes[n]
        if level < 0:
            if _ask_cluster(scene, beam, node, limit, state):
                limit = highest(load(state.highs, 0))
        else:
            n = _open_group(scene, beam, level, node, limit, stack, n, state.planes)
    for lane in range(PACKET):
        if state.face_ids[lane] >= 0 and state.fractions[lane] < 0.0:
            state.fractions[lane] = _fraction(scene, beam, state, lane)


@njit(_nrt=False)
def _open_group(scene, beam, level, first, limit, stack, n, planes):
    """Push the boxes of a group that the beam goes through before `limit`; return the stack's size."""
    place, stride = scene.level_starts[level] + first, scene.nodes.shape[1]
    error = BEAM_ERROR * beam.reach
    n_boxes = min(CLUSTER, scene.level_counts[level] - first)
    mask = (np.int64(1) << n_boxes) - 1
    for plane in range(N_PLANES):  # the corner farthest inwards
        height = splat(planes[plane, 3])
        for axis in range(3):
            row = axis + UPPER if planes[plane, axis] >= ZERO else axis
            height = height + load(scene.nodes, row * stride + place) * splat(planes[plane, axis])
        mask &= not_less(height, splat(-error))
    if mask == 0:
        return n
    height = splat(planes[AXIS, 3] - error)
    for axis in range(3):
        row = axis if planes[AXIS, axis] >= ZERO else axis + UPPER
        height = height + load(scene.nodes, row * stride + place) * splat(planes[AXIS, axis])
    mask &= not_less(splat(limit), height)
    store(stack.lanes, 0, height)
    return push_boxes(stack, n, mask, level, first)


@njit(_nrt=False)
def _ask_cluster(scene, beam, cluster, limit, state):
    """Ask the faces of a cluster that the beam meets before `limit`; return whether any ray's nearest has changed."""
    changed = False
    mask = _faces_in_beam(scene, beam, cluster, limit, state.planes)
    while mask:
        lane = first_lane(mask)
        mask &= mask - 1
        changed |= _ask_face(scene, beam, cluster, lane, state)
    return changed


@njit(_nrt=False)
def _faces_in_beam(scene, beam, cluster, limit, planes):
    """Mask of the faces of a cluster that reach into the beam before `limit`."""
    base, error = cluster * 9 * CLUSTER, BEAM_ERROR * beam.reach
    a = load3(scene.corners, base, CLUSTER)
    b = load3(scene.corners, base + 3 * CLUSTER, CLUSTER)
    c = load3(scene.corners, base + 6 * CLUSTER, CLUSTER)
    mask = scene.used[cluster]
    for plane in range(N_PLANES):
        normal = splat3((planes[plane, 0], planes[plane, 1], planes[plane, 2]))
        offset = splat(planes[plane, 3])
        height = maximum(dot3(a, normal, offset), maximum(dot3(b, normal, offset), dot3(c, normal, offset)))
        mask &= not_less(height, splat(-error))
    normal = splat3((planes[AXIS, 0], planes[AXIS, 1], planes[AXIS, 2]))
    offset = splat(planes[AXIS, 3])
    depth = minimum(dot3(a, normal, offset), minimum(dot3(b, normal, offset), dot3(c, normal, offset)))
    return mask & not_less(splat(limit), depth - splat(error))


@njit(_nrt=False)
def _ask_face(scene, beam, cluster, place, state):
    """Ask all rays of a beam about a face; return whether any ray's nearest has changed."""
    corners, origin = scene.corners[cluster], beam.origin
    ax, ay, az = corners[0, 0, place], corners[0, 1, place], corners[0, 2, place]
    bx, by, bz = corners[1, 0, place], corners[1, 1, place], corners[1, 2, place]
    cx, cy, cz = corners[2, 0, place], corners[2, 1, place], corners[2, 2, place]
    directions, zero = load3(state.directions, 0, PACKET), splat(ZERO)
    # the rays' moments about two corners, and from them signed areas with the three edges
    about_a = cross3(directions, splat3((ax - origin[0], ay - origin[1], az - origin[2])))
    about_b = cross3(directions, splat3((bx - origin[0], by - origin[1], bz - origin[2])))
    u = dot3(about_a, splat3((cx - ax, cy - ay, cz - az)), zero)
    v = dot3(about_a, splat3((ax - bx, ay - by, az - bz)), zero)
    w = dot3(about_b, splat3((bx - cx, by - cy, bz - cz)), zero)
    size = abs(cx - ax) + abs(cy - ay) + abs(cz - az) + abs(ax - bx) + abs(ay - by) + abs(az - bz)
    size = size + abs(bx - cx) + abs(by - cy) + abs(bz - cz)
    error = splat(EDGE_ERROR * beam.reach * size) + splat(MOMENT_ERROR) * (_extent(about_a) + _extent(about_b))
    least, most = minimum(u, minimum(v, w)), maximum(u, maximum(v, w))
    maybe = beam.rays & (not_less(least, zero - error) | not_less(error, most))
    if maybe == 0:
        return False
    sure = maybe & (greater(least, error) | greater(zero - error, most))
    planes = scene.planes[cluster]
    nx, ny, nz = planes[0, place], planes[1, place], planes[2, place]
    height = planes[3, place] - (nx * origin[0] + ny * origin[1] + nz * origin[2])
    slope = dot3(directions, splat3((nx, ny, nz)), zero)
    turned = greater(zero, slope)
    slope, height = absolute(slope), select(turned, splat(-height), splat(height))
    height_error, slope_error = splat(PLANE_ERROR * beam.reach), splat(SLOPE_ERROR)
    lows, highs = load(state.lows, 0), load(state.highs, 0)
    low = divide(height - height_error, slope + slope_error) * splat(ROUNDED_DOWN)
    high = divide(height + height_error, maximum(slope - slope_error, slope_error)) * splat(ROUNDED_UP)
    if (scene.weak[cluster] >> place) & 1:
        sure = np.int64(0)
    else:
        steep = greater(slope, slope_error + slope_error)
        sure &= steep & greater(height, height_error)
        maybe &= ~(steep & greater(zero - height_error, height))
        maybe &= ~(greater(height, height_error) & greater(low, highs))
    nearer_for_certain = sure & maybe & greater(lows, high)
    if nearer_for_certain:
        store(state.lows, 0, select(nearer_for_certain, low, lows))
        store(state.highs, 0, select(nearer_for_certain, high, highs))
    face = np.int64(scene.face_ids[cluster, place])
    doubtful, changed = maybe & ~nearer_for_certain, nearer_for_certain != 0
    while nearer_for_certain:
        lane = first_lane(nearer_for_certain)
        nearer_for_certain &= nearer_for_certain - 1
        state.face_ids[lane], state.fractions[lane] = face, -1.0
    while doubtful:
        lane = first_lane(doubtful)
        doubtful &= doubtful - 1
        changed |= _decide(scene, beam, face, lane, state)
    return changed


@njit(_nrt=False, forceinline=True)
def _extent(a):
    """Sum of the components' sizes, at least the length."""
    return absolute(a[0]) + absolute(a[1]) + absolute(a[2])


@njit(_nrt=False)
def _decide(scene, beam, candidate, lane, state):
    """Decide in float64 whether a ray meets a face nearer than its nearest so far; return whether it does."""
    face, fraction = state.face_ids[lane], state.fractions[lane]
    if face >= 0 and fraction < 0.0:
        fraction = _fraction(scene, beam, state, lane)
    found, nearest = nearer(scene, beam.world_origin, state.world_directions[lane], candidate, face, fraction)
    state.face_ids[lane], state.fractions[lane] = found, nearest
    if found < 0:
        return False
    distance = nearest * state.units[lane]
    state.lows[lane] = np.float32(distance) * ROUNDED_DOWN
    state.highs[lane] = np.float32(distance) * ROUNDED_UP
    return found != face


@njit(_nrt=False)
def _fraction(scene, beam, state, lane):
    """How many directions away a ray meets its nearest face, in float64."""
    corners = scene.world_corners[state.face_ids[lane]]
    return meeting(beam.world_origin, state.world_directions[lane], corners[0], corners[1], corners[2])
