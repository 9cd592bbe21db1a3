"""Rays of many origins, one by one: each goes down the boxes, nearest first; float32 leaves out, float64 decides.

What float32 leaves out cannot be hit: every comparison gives way by more than the rounding of all that enters it. What
is left is asked of `predicates.meeting`, the definition itself, so face and distance are the oracle's, ties included.
All float32 happens in scene space from the place where a ray enters the scene's sphere, however far away it begins, so
that no coordinate exceeds about 1.
"""

import math
from typing import NamedTuple

import numpy as np

from zbuf_occlude.exact.layout import LEAF, UPPER, ZERO, Float32, Int64
from zbuf_occlude.exact.ray_packets import nearer
from zbuf_occlude.jit.compiler import inlined, inner
from zbuf_occlude.jit.pointer import reference
from zbuf_occlude.jit.simd import (
    absolute,
    dot3,
    first_lane,
    greater,
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
from zbuf_occlude.jit.threads import shared_with_memory, take
from zbuf_occlude.jit.vec3 import cross, dot, minus

SINGLE_RAYS = 512
"""Rays that a thread takes at a time."""
SPHERE = 1.01
"""Radius of a sphere that holds the scene, with room for rounding."""
FARTHEST = np.float32(4.0)
"""No ray is longer than this within the sphere."""
MARGIN = np.float32(2e-6)
"""Scene units by which boxes are larger than they are. Rounding the box, the ray's start, direction and inverse,
and two operations on them, move a wall by at most 6e-7."""
AREA_ERROR = np.float32(4e-6)
"""Of the signed area between a ray and an edge, per length of the edge: coordinates about the ray are wrong by at most
4.5e-7, their moment by 1.1e-6."""
MOMENT_ERROR = np.float32(1e-6)
"""Of the same, per distance of the ray from the face's first corner: edges are wrong by at most 2.1e-7."""
SLOPE_ERROR = np.float32(2e-6)
"""Of direction . normal, per size + size squared of the face: a normal errs by 4.2e-7 sizes + 6e-7 sizes squared."""
DISTANCE_ERROR = np.float32(16e-6)
"""Of distance x slope, likewise: twice that of the slope, and four times once more for the distance it is held to."""
LEAST_DIRECTION = 1e-9
"""Components of a unit direction smaller than this count as this: it moves no place within the scene by 1e-8."""


class Ray(NamedTuple):
    """A ray in float32: ``start + t direction`` with t from 0 on, scene units."""

    start: tuple[np.float32, np.float32, np.float32]  # where it enters the scene's sphere, or where it begins
    direction: tuple[np.float32, np.float32, np.float32]  # of length 1
    inverse: tuple[np.float32, np.float32, np.float32]  # 1 / each component of the direction
    skipped: float  # scene units before `start`
    unit: float  # scene units per length of the caller's direction


class Stack(NamedTuple):
    """Groups of 16 boxes that a ray still has to test, the nearest on top; a group of level -1 is a leaf."""

    levels: Int64
    nodes: Int64  # first node of the group, or the leaf
    nearest: Float32
    lanes: Float32  # (16,) scratch


@shared_with_memory
def cast_singles(tasks, bvh, origins, directions, face_ids, distances):
    """Take blocks of rays and fill in the answers, ray by ray; the last face met is the first tested."""
    room = LEAF * (len(bvh.level_counts) + 8)
    stack = Stack(
        levels=np.empty(room, dtype=np.int64),
        nodes=np.empty(room, dtype=np.int64),
        nearest=np.empty(room, dtype=np.float32),
        lanes=np.empty(LEAF, dtype=np.float32),
    )
    _cast_one_by_one(tasks, reference(bvh), origins, directions, (face_ids, distances), stack)


@inner
def _cast_one_by_one(tasks, bvh, origins, directions, hits, memory):
    stack = reference(memory)
    face_ids, distances = hits
    block = take(tasks)
    while block * SINGLE_RAYS < len(face_ids):
        guess = -1
        for i in range(block * SINGLE_RAYS, min((block + 1) * SINGLE_RAYS, len(face_ids))):
            d = directions[i]
            face, fraction = _first_hit(bvh, origins[i if len(origins) > 1 else 0], d, guess, stack)
            guess = face if face >= 0 else guess
            face_ids[i], distances[i] = face, fraction * math.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
        block = take(tasks)


@inner
def _first_hit(bvh, origin, direction, guess, stack):
    """First face on a ray, and how many directions away; `guess` is a face to begin with, or -1."""
    ray, meets = _make_ray(bvh, origin, direction)
    face, fraction = np.int64(-1), math.inf
    if not meets:
        return face, fraction
    if guess >= 0:
        face, fraction = nearer(bvh, origin, direction, guess, face, fraction)
    top = len(bvh.level_counts) - 1
    n = (bvh.level_counts[top] + LEAF - 1) // LEAF
    for group in range(n):
        stack.levels[group], stack.nodes[group], stack.nearest[group] = top, LEAF * group, ZERO
    while n:
        n -= 1
        limit = _limit(ray, fraction)
        if stack.nearest[n] > limit:
            continue
        level, node = stack.levels[n], stack.nodes[n]
        if level >= 0:
            n = _open_group(bvh, ray, level, node, limit, stack, n)
            continue
        mask = _candidates(bvh, ray, node, limit)
        while mask:
            lane = first_lane(mask)
            mask &= mask - 1
            face, fraction = nearer(bvh, origin, direction, bvh.face_ids[node, lane], face, fraction)
    return face, fraction


@inner
def _make_ray(bvh, origin, direction):
    """Return a ray in float32, and whether it meets the scene's sphere at all."""
    largest = max(abs(direction[0]), abs(direction[1]), abs(direction[2]))
    scaled = (direction[0] / largest, direction[1] / largest, direction[2] / largest)
    length = math.sqrt(dot(scaled, scaled))
    unit = (scaled[0] / length, scaled[1] / length, scaled[2] / length)
    away, scale = minus(origin, bvh.centre), bvh.scale
    local = (away[0] * scale, away[1] * scale, away[2] * scale)
    along = -dot(local, unit)
    closest = local
    if along > 0.0:
        closest = (local[0] + along * unit[0], local[1] + along * unit[1], local[2] + along * unit[2])
    rounding = 1e-15 * (abs(local[0]) + abs(local[1]) + abs(local[2]))
    meets = dot(closest, closest) <= (SPHERE + rounding) ** 2
    skipped = max(along - SPHERE, 0.0)
    start = (local[0] + skipped * unit[0], local[1] + skipped * unit[1], local[2] + skipped * unit[2])
    ray = Ray(
        start=(np.float32(start[0]), np.float32(start[1]), np.float32(start[2])),
        direction=(np.float32(unit[0]), np.float32(unit[1]), np.float32(unit[2])),
        inverse=(_inverse(unit[0]), _inverse(unit[1]), _inverse(unit[2])),
        skipped=skipped,
        unit=largest * length * scale,
    )
    return ray, meets


@inner
def _inverse(component):
    return np.float32(1.0 / (component if abs(component) > LEAST_DIRECTION else LEAST_DIRECTION))


@inner
def _limit(ray, fraction):
    """How far from its start a ray need be followed, scene units; rounded up."""
    distance = fraction * ray.unit - ray.skipped
    return FARTHEST if distance > FARTHEST else np.float32(distance * (1.0 + 1e-6)) + MARGIN


@inner
def _open_group(bvh, ray, level, first, limit, stack, n):
    """Push the boxes of a group that the ray meets before `limit`, the nearest on top; return the stack's size."""
    place, stride = bvh.level_starts[level] + first, bvh.nodes.shape[1]
    enter, leave = splat(ZERO), splat(limit)
    for axis in range(3):
        near_wall = load(bvh.nodes, axis * stride + place) - splat(ray.start[axis] + MARGIN)
        far_wall = load(bvh.nodes, (UPPER + axis) * stride + place) - splat(ray.start[axis] - MARGIN)
        near_wall, far_wall = near_wall * splat(ray.inverse[axis]), far_wall * splat(ray.inverse[axis])
        enter = maximum(enter, minimum(near_wall, far_wall))
        leave = minimum(leave, maximum(near_wall, far_wall))
    store(stack.lanes, 0, enter)
    n_boxes = min(LEAF, bvh.level_counts[level] - first)
    mask, bottom = not_less(leave, enter) & ((np.int64(1) << n_boxes) - 1), n
    while mask:
        lane = first_lane(mask)
        mask &= mask - 1
        nearest, place = stack.lanes[lane], n
        while place > bottom and stack.nearest[place - 1] < nearest:
            stack.levels[place], stack.nodes[place] = stack.levels[place - 1], stack.nodes[place - 1]
            stack.nearest[place] = stack.nearest[place - 1]
            place -= 1
        stack.levels[place], stack.nearest[place] = level - 1, nearest
        stack.nodes[place] = (first + lane) * (LEAF if level > 0 else 1)
        n += 1
    return n


@inner
def _candidates(bvh, ray, leaf, limit):
    """Mask of the faces of a leaf that the ray may meet before `limit`.

    References
    ----------
    Moeller, Trumbore: Fast, minimum storage ray/triangle intersection. Journal of Graphics Tools 2 (1997),
    doi:10.1080/10867651.1997.10487468; here with the ray's moment about the first corner, whose error does not grow
    with a face's distance.
    """
    base, zero = leaf * 9 * LEAF, splat(ZERO)
    direction = splat3(ray.direction)
    a = load3(bvh.corners, base, LEAF)
    first = minus(load3(bvh.corners, base + 3 * LEAF, LEAF), a)
    second = minus(load3(bvh.corners, base + 6 * LEAF, LEAF), a)
    start = minus(splat3(ray.start), a)
    moment, normal = cross(start, direction), cross(first, second)
    u, v = dot3(moment, second, zero), zero - dot3(moment, first, zero)
    slope, depth = zero - dot3(normal, direction, zero), dot3(normal, start, zero)
    turned = greater(zero, slope)
    u, v, depth = select(turned, zero - u, u), select(turned, zero - v, v), select(turned, zero - depth, depth)
    slope = absolute(slope)
    size = _size_of(first) + _size_of(second)
    edge_error = splat(AREA_ERROR) * size + splat(MOMENT_ERROR) * _size_of(moment)
    spread = size + size * size
    slope_error, depth_error = splat(SLOPE_ERROR) * spread, splat(DISTANCE_ERROR) * spread
    inside = not_less(u, zero - edge_error) & not_less(v, zero - edge_error)
    inside &= not_less(slope - u - v, zero - (edge_error + edge_error + slope_error))
    before = not_less(depth, zero - depth_error) & not_less(splat(limit) * slope + depth_error, depth)
    return bvh.used[leaf] & ((inside & before) | not_less(slope_error, slope))


@inlined
def _size_of(a):
    """Sum of the components' sizes, at least the length."""
    return absolute(a[0]) + absolute(a[1]) + absolute(a[2])
