"""One ray goes down the scene's boxes, nearest first; float32 leaves out, float64 decides.

What float32 leaves out cannot be hit: every comparison gives way by more than the rounding of all that enters it. What
is left is asked of `predicates.meeting`, the definition itself, so face and distance are the oracle's, ties included.

All float32 happens in scene space from the place where a ray enters the scene's sphere, however far away it begins, so
that no coordinate exceeds about 1.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.exact.layout import CLUSTER, UPPER, ZERO
from zbuf_occlude.geometry.predicates import meeting
from zbuf_occlude.jit.compiler import inlined, inner
from zbuf_occlude.jit.simd import (
    absolute,
    cross3,
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
from zbuf_occlude.jit.vec3 import dot

SPHERE = 1.01
"""Radius of a sphere that holds the scene, with room for rounding."""

FARTHEST = np.float32(4.0)
"""No ray is longer than this within the sphere."""

MARGIN = np.float32(2e-6)
"""Scene units by which boxes are larger than they are. Rounding the box, the ray's start, direction and inverse,
and two operations on them, move a wall by at most 6e-7."""

EDGE_ERROR = np.float32(4e-6)
"""Of the signed area between a ray and an edge, per length of the edge: coordinates about the ray are wrong by at most
4.5e-7, their moment by 1.1e-6."""

MOMENT_ERROR = np.float32(1e-6)
"""Of the same, per distance of the ray from the face's first corner: edges are wrong by at most 2.1e-7."""

SLOPE_ERROR = np.float32(2e-6)
"""Of direction . normal, per size + size squared of the face: a normal errs by 4.2e-7 sizes + 6e-7 sizes squared."""

DEPTH_ERROR = np.float32(16e-6)
"""Of distance x slope, likewise: twice that of the slope, and four times once more for the distance it is held to."""

LEAST_DIRECTION = 1e-9
"""Components of a unit direction smaller than this count as this: it moves no place within the scene by 1e-8."""


class Ray(NamedTuple):
    """A ray, for float32: ``start + t direction`` with t from 0 on, scene units.

    Parameters
    ----------
    start : tuple of 3 float32
        Where it enters the scene's sphere, or where it begins.
    direction, inverse : tuples of 3 float32
        Of length 1; and 1 / each component.
    skipped : float
        Scene units before `start`.
    unit : float
        Scene units per length of the caller's direction.
    """

    start: tuple[np.float32, np.float32, np.float32]
    direction: tuple[np.float32, np.float32, np.float32]
    inverse: tuple[np.float32, np.float32, np.float32]
    skipped: float
    unit: float


class Stack(NamedTuple):
    """Groups of 16 boxes that a ray still has to look into, the nearest on top; and 16 numbers to unpack lanes into."""

    levels: NDArray[np.int64]
    nodes: NDArray[np.int64]
    nearest: NDArray[np.float32]
    lanes: NDArray[np.float32]


@inner
def first_hit(scene, origin, direction, guess, stack):
    """Return the first face on a ray, and how many directions away.

    Parameters
    ----------
    scene : Scene
    origin, direction : (3,) float64, world space
    guess : int
        A face to begin with, or -1.
    stack : Stack
        Scratch.
    """
    ray, meets = _make_ray(scene, origin, direction)
    face, fraction = np.int64(-1), math.inf
    if not meets:
        return face, fraction
    if guess >= 0:
        face, fraction = nearer(scene, origin, direction, guess, face, fraction)
    n = push_top(scene, stack)
    while n:
        n -= 1
        limit = _limit(ray, fraction)
        if stack.nearest[n] > limit:
            continue
        level, node = stack.levels[n], stack.nodes[n]
        if level < 0:
            face, fraction = _ask_cluster(scene, origin, direction, ray, node, face, fraction)
        else:
            n = _open_group(scene, ray, level, node, limit, stack, n)
    return face, fraction


@inner
def _make_ray(scene, origin, direction):
    """Return a ray for float32, and whether it meets the scene's sphere at all."""
    largest = max(abs(direction[0]), abs(direction[1]), abs(direction[2]))
    scaled = (direction[0] / largest, direction[1] / largest, direction[2] / largest)
    length = math.sqrt(dot(scaled, scaled))
    unit = (scaled[0] / length, scaled[1] / length, scaled[2] / length)
    local = (
        (origin[0] - scene.centre[0]) * scene.scale,
        (origin[1] - scene.centre[1]) * scene.scale,
        (origin[2] - scene.centre[2]) * scene.scale,
    )
    along = -dot(local, unit)
    closest = local
    if along > 0.0:
        closest = (local[0] + along * unit[0], local[1] + along * unit[1], local[2] + along * unit[2])
    rounding = 1e-15 * (abs(local[0]) + abs(local[1]) + abs(local[2]))
    meets = dot(closest, closest) <= (SPHERE + rounding) ** 2
    skipped = max(along - SPHERE, 0.0)
    start = (local[0] + skipped * unit[0], local[1] + skipped * unit[1], local[2] + skipped * unit[2])
    return (
        Ray(
            (np.float32(start[0]), np.float32(start[1]), np.float32(start[2])),
            (np.float32(unit[0]), np.float32(unit[1]), np.float32(unit[2])),
            (_inverse(unit[0]), _inverse(unit[1]), _inverse(unit[2])),
            skipped,
            largest * length * scene.scale,
        ),
        meets,
    )


@inner
def _inverse(component):
    return np.float32(1.0 / (component if abs(component) > LEAST_DIRECTION else LEAST_DIRECTION))


@inner
def _limit(ray, fraction):
    """How far from its start a ray need be followed, scene units; rounded up."""
    distance = fraction * ray.unit - ray.skipped
    return FARTHEST if distance > FARTHEST else np.float32(distance * (1.0 + 1e-6)) + MARGIN


@inner
def push_top(scene, stack):
    """Begin with all groups of the top level of a scene on a `Stack`; return their number."""
    top = len(scene.level_counts) - 1
    n_groups = (scene.level_counts[top] + CLUSTER - 1) // CLUSTER
    for group in range(n_groups):
        stack.levels[group], stack.nodes[group], stack.nearest[group] = top, CLUSTER * group, ZERO
    return n_groups


@inner
def _open_group(scene, ray, level, first, limit, stack, n):
    """Push the boxes of a group that the ray goes through before `limit`; return the stack's size."""
    place, stride = scene.level_starts[level] + first, scene.nodes.shape[1]
    enter, leave = splat(ZERO), splat(limit)
    for axis in range(3):
        near_wall = load(scene.nodes, axis * stride + place) - splat(ray.start[axis] + MARGIN)
        far_wall = load(scene.nodes, (UPPER + axis) * stride + place) - splat(ray.start[axis] - MARGIN)
        near_wall, far_wall = near_wall * splat(ray.inverse[axis]), far_wall * splat(ray.inverse[axis])
        enter = maximum(enter, minimum(near_wall, far_wall))
        leave = minimum(leave, maximum(near_wall, far_wall))
    store(stack.lanes, 0, enter)
    mask = not_less(leave, enter)
    n_boxes = min(CLUSTER, scene.level_counts[level] - first)
    mask &= (np.int64(1) << n_boxes) - 1
    return push_boxes(stack, n, mask, level, first)


@inner
def push_boxes(stack, n, mask, level, first):
    """Push boxes of a group, the nearest on top; return the stack's size.

    Parameters
    ----------
    stack, n : Stack, int
        And how much of it is in use; its lanes hold how near the boxes are.
    mask : int
        Which boxes.
    level, first : int
        The group's level and first node. A box of level 0 is a cluster, pushed with level -1; another stands for the
        group of its children.
    """
    bottom = n
    while mask:
        lane = first_lane(mask)
        mask &= mask - 1
        nearest, place = stack.lanes[lane], n
        while place > bottom and stack.nearest[place - 1] < nearest:
            stack.levels[place], stack.nodes[place] = stack.levels[place - 1], stack.nodes[place - 1]
            stack.nearest[place] = stack.nearest[place - 1]
            place -= 1
        stack.levels[place], stack.nearest[place] = level - 1, nearest
        stack.nodes[place] = (first + lane) * (CLUSTER if level > 0 else 1)
        n += 1
    return n


@inner
def _ask_cluster(scene, origin, direction, ray, cluster, face, fraction):
    """Ask the faces of a cluster that float32 cannot leave out; return the nearest face so far and its fraction."""
    mask = _candidates(scene, ray, cluster, _limit(ray, fraction))
    while mask:
        lane = first_lane(mask)
        mask &= mask - 1
        face, fraction = nearer(scene, origin, direction, scene.face_ids[cluster, lane], face, fraction)
    return face, fraction


@inner
def nearer(scene, origin, direction, candidate, face, fraction):
    """Return the nearer of a face and the nearest so far, and its fraction; of equally near ones the lower.

    Parameters
    ----------
    scene : Scene
    origin, direction : (3,) float64, world space
    candidate, face : int
    fraction : float
        How many directions away `face` is.
    """
    corners = scene.world_corners[candidate]
    found = meeting(origin, direction, corners[0], corners[1], corners[2])
    if found < fraction or (found == fraction and found < math.inf and candidate < face):
        return np.int64(candidate), found
    return face, fraction


@inner
def _candidates(scene, ray, cluster, limit):
    """Mask of the faces of a cluster that the ray may meet before `limit`.

    References
    ----------
    Moeller, Trumbore: Fast, minimum storage ray/triangle intersection. Journal of Graphics Tools 2 (1997),
    doi:10.1080/10867651.1997.10487468; here with the ray's moment about the first corner, whose error does not grow
    with a face's distance.
    """
    base, zero = cluster * 9 * CLUSTER, splat(ZERO)
    direction = splat3(ray.direction)
    a = load3(scene.corners, base, CLUSTER)
    first = _minus3(load3(scene.corners, base + 3 * CLUSTER, CLUSTER), a)
    second = _minus3(load3(scene.corners, base + 6 * CLUSTER, CLUSTER), a)
    start = _minus3(splat3(ray.start), a)
    moment, normal = cross3(start, direction), cross3(first, second)
    u, v = dot3(moment, second, zero), zero - dot3(moment, first, zero)
    slope, depth = zero - dot3(normal, direction, zero), dot3(normal, start, zero)
    turned = greater(zero, slope)
    u, v, depth = select(turned, zero - u, u), select(turned, zero - v, v), select(turned, zero - depth, depth)
    slope = absolute(slope)
    size = _extent(first) + _extent(second)
    edge_error = splat(EDGE_ERROR) * size + splat(MOMENT_ERROR) * _extent(moment)
    spread = size + size * size
    slope_error, depth_error = splat(SLOPE_ERROR) * spread, splat(DEPTH_ERROR) * spread
    inside = not_less(u, zero - edge_error) & not_less(v, zero - edge_error)
    inside &= not_less(slope - u - v, zero - (edge_error + edge_error + slope_error))
    before = not_less(depth, zero - depth_error) & not_less(splat(limit) * slope + depth_error, depth)
    return scene.used[cluster] & ((inside & before) | not_less(slope_error, slope))


@inlined
def _minus3(a, b):
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@inlined
def _extent(a):
    """Sum of the components' sizes, at least the length."""
    return absolute(a[0]) + absolute(a[1]) + absolute(a[2])
