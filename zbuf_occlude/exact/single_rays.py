"""Rays of many origins, one by one: each goes down the boxes, nearest first; float32 leaves out, float64 decides.

What float32 leaves out cannot be hit: every comparison gives way by more than the rounding of all that enters it. What
is left is asked of `predicates.meeting`, the definition itself, so face and distance are the oracle's, ties included.
All float32 happens in scene space from the place where a ray enters the scene's sphere, however far away it begins, so
that no coordinate exceeds about 1.
"""

import math
from typing import NamedTuple

import numpy as np

from zbuf_occlude.exact.bvh import corners_of
from zbuf_occlude.exact.layout import LEAF, UPPER, ZERO
from zbuf_occlude.geometry.predicates import meeting
from zbuf_occlude.jit.compiler import inlined, inner, merged
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
    muladd,
    not_less,
    select,
    splat,
    splat3,
    store,
)
from zbuf_occlude.jit.threads import shared, take
from zbuf_occlude.jit.vec3 import cross, dot, minus

SINGLE_RAYS = 512
"""Rays that a thread takes at a time."""
SPHERE = 1.01
"""Radius of a sphere that holds the scene, with room for rounding."""
FARTHEST = np.float32(4.0)
"""No ray is longer than this within the sphere."""
MARGIN = np.float32(2e-6)
"""Scene units by which boxes are larger than they are. Rounding the box, the ray's inverse and offset, and
what is computed of them, moves a wall by at most 6e-7."""
AREA_ERROR = np.float32(4e-6)
"""Of the signed area between a ray and an edge, per length of the edge: coordinates about the ray are wrong by at most
4.5e-7, their moment by 1.1e-6."""
MOMENT_ERROR = np.float32(1e-6)
"""Of the same, per distance of the ray from the face's first corner: edges are wrong by at most 2.1e-7."""
SLOPE_ERROR = np.float32(2e-6)
"""Of direction . normal, per size + size squared of the face: a normal errs by 4.2e-7 sizes + 6e-7 sizes squared."""
DISTANCE_ERROR = np.float32(16e-6)
"""Of distance x slope, likewise: twice that of the slope, and four times once more for the distance it is held to."""
SPREAD = np.float32(1.8)
"""A ray is farther from a face than the face is large where the sum of its moment's components is, this many times."""
LEAST_DIRECTION = 1e-9
"""Components of a unit direction smaller than this count as this: it moves no place within the scene by 1e-8."""


class Line(NamedTuple):
    """A ray, or the way from an eye to a point, in float64: world space."""

    origin: tuple[float, float, float]
    direction: tuple[float, float, float]
    point: tuple[float, float, float]
    own: np.int64  # the point's face, which does not hide it


class Ray(NamedTuple):
    """A ray in float32: ``start + t direction`` with t from 0 on, scene units."""

    start: tuple[np.float32, np.float32, np.float32]  # where it enters the scene's sphere, or where it begins
    direction: tuple[np.float32, np.float32, np.float32]  # of length 1
    inverse: tuple[np.float32, np.float32, np.float32]  # 1 / each component of the direction
    enters: tuple[np.float32, np.float32, np.float32]  # wall x inverse + this is the t of a box's nearer wall, widened
    leaves: tuple[np.float32, np.float32, np.float32]  # likewise that of the farther wall
    skipped: float  # scene units before `start`
    unit: float  # scene units per length of the caller's direction


@shared
def cast_singles(tasks, bvh_, origins, directions, face_ids, distances, memory):
    """Take blocks of rays and fill in the answers, ray by ray."""
    bvh, stack, block = reference(bvh_), reference(memory), take(tasks)
    while block * SINGLE_RAYS < len(face_ids):
        for i in range(block * SINGLE_RAYS, min((block + 1) * SINGLE_RAYS, len(face_ids))):
            o, d = origins[i if len(origins) > 1 else 0], directions[i]
            line = Line((o[0], o[1], o[2]), (d[0], d[1], d[2]), (o[0], o[1], o[2]), np.int64(-1))
            face, fraction = find_on_line(bvh, line, math.inf, _nearer_on_line, stack)
            face_ids[i], distances[i] = face, fraction * math.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
        block = take(tasks)


@inner
def _nearer_on_line(bvh, line, candidate, face, fraction):
    return nearer(bvh, line.origin, line.direction, candidate, face, fraction)


@inner
def nearer(bvh, origin, direction, candidate, face, fraction):
    """Return the nearer of a candidate and the nearest face so far, and how many directions away; the lower of ties."""
    a, b, c = corners_of(bvh, candidate)
    found = meeting(origin, direction, a, b, c)
    if found < fraction or (found == fraction and found < math.inf and candidate < face):
        return np.int64(candidate), found
    return face, fraction


@merged
def find_on_line(bvh, line, fraction, test, stack):
    """Walk along a line from its origin, nearest boxes first, as far as this fraction of its direction.

    ``test(bvh, line, candidate, face, fraction)`` is asked for each face that the line may meet, with the last answer,
    and answers with a face and how far to go from now on. Returned is its last answer, at first -1 and `fraction`.
    """
    face = np.int64(-1)
    ray, meets = _make_ray(bvh, line.origin, line.direction)
    if not meets:
        return face, fraction
    limit, n = _limit(ray, fraction), 1
    stack.nodes[0], stack.nearest[0] = 0, ZERO
    while n:
        n -= 1
        if stack.nearest[n] > limit:
            continue
        node = np.int64(stack.nodes[n])
        if node >= 0:
            n = _open_node(bvh, ray, node, limit, stack, n)
            continue
        mask = _candidates(bvh, ray, ~node, limit)
        while mask:
            lane = first_lane(mask)
            mask &= mask - 1
            face, fraction = test(bvh, line, bvh.face_ids[~node, lane], face, fraction)
            limit = _limit(ray, fraction)
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
    inverse = (_inverse(unit[0]), _inverse(unit[1]), _inverse(unit[2]))
    ray = Ray(
        start=(np.float32(start[0]), np.float32(start[1]), np.float32(start[2])),
        direction=(np.float32(unit[0]), np.float32(unit[1]), np.float32(unit[2])),
        inverse=(np.float32(inverse[0]), np.float32(inverse[1]), np.float32(inverse[2])),
        enters=_offsets(start, inverse, MARGIN),
        leaves=_offsets(start, inverse, -MARGIN),
        skipped=skipped,
        unit=largest * length * scale,
    )
    return ray, meets


@inner
def _inverse(component):
    return 1.0 / (component if abs(component) > LEAST_DIRECTION else LEAST_DIRECTION)


@inlined
def _offsets(start, inverse, margin):
    """What to add to a wall times `inverse` for where a ray meets it, a margin before or, if negative, behind it."""
    return (
        np.float32(-start[0] * inverse[0] - margin * abs(inverse[0])),
        np.float32(-start[1] * inverse[1] - margin * abs(inverse[1])),
        np.float32(-start[2] * inverse[2] - margin * abs(inverse[2])),
    )


@inner
def _limit(ray, fraction):
    """How far from its start a ray need be followed, scene units; rounded up."""
    distance = fraction * ray.unit - ray.skipped
    return FARTHEST if distance > FARTHEST else np.float32(distance * (1.0 + 1e-6)) + MARGIN


@inlined
def _open_node(bvh, ray, node, limit, stack, n):
    """Push the children of a node that the ray meets before `limit`, the nearest on top; return the stack's size."""
    index = 6 * LEAF * node
    enter, leave = splat(ZERO), splat(limit)
    for axis in range(3):
        inverse = ray.inverse[axis]
        near = axis if inverse > ZERO else UPPER + axis
        far = axis + UPPER + axis - near
        enter = maximum(enter, muladd(load(bvh.boxes, index + near * LEAF), inverse, splat(ray.enters[axis])))
        leave = minimum(leave, muladd(load(bvh.boxes, index + far * LEAF), inverse, splat(ray.leaves[axis])))
    store(stack.lanes, 0, enter)
    mask, bottom = not_less(leave, enter) & ((np.int64(1) << bvh.n_children[node]) - 1), n
    while mask:
        lane = first_lane(mask)
        mask &= mask - 1
        nearest, place = stack.lanes[lane], n
        while place > bottom and stack.nearest[place - 1] < nearest:
            stack.nodes[place], stack.nearest[place] = stack.nodes[place - 1], stack.nearest[place - 1]
            place -= 1
        stack.nodes[place], stack.nearest[place] = bvh.children[LEAF * node + lane], nearest
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
    distance = _size_of(moment)  # of the ray from the first corner, up to twice
    edge_error = splat(AREA_ERROR) * size + splat(MOMENT_ERROR) * distance
    spread = size + size * size
    slope_error, depth_error = splat(SLOPE_ERROR) * spread, splat(DISTANCE_ERROR) * spread
    inside = not_less(u, zero - edge_error) & not_less(v, zero - edge_error)
    inside &= not_less(slope - u - v, zero - (edge_error + edge_error + slope_error))
    before = not_less(depth, zero - depth_error) & not_less(splat(limit) * slope + depth_error, depth)
    edge_on = not_less(slope_error, slope) & not_less((size + splat(MARGIN)) * splat(SPREAD), distance)
    return bvh.used[leaf] & ((inside & before) | edge_on)


@inlined
def _size_of(a):
    """Sum of the components' sizes, at least the length."""
    return absolute(a[0]) + absolute(a[1]) + absolute(a[2])
