"""Rays of many origins, in turns: each goes down the boxes, nearest first; float32 leaves out, float64 decides.

The rays of a block take a step each, of one kind at a time: nodes, leaves, faces. While the memory that a step needs is
fetched, those of other rays are taken, and hardly any branch depends on what a test says.

What float32 leaves out cannot be hit: every comparison gives way by more than the rounding of all that enters it.
`predicates.ray_triangle_t` decides what is left, so face and distance are the oracle's, ties included.
All float32 happens in scene space from the place where a ray enters the scene's sphere, however far away it begins, so
that no coordinate exceeds about 1. The boxes widen with the rounding of that place; rays from beyond `FAR` test boxes
only.
"""

import math
from typing import NamedTuple

import numpy as np

from zbuf_occlude.arrays import FloatArray
from zbuf_occlude.exact.bvh import Bvh, corners_of
from zbuf_occlude.exact.layout import F32_MAX, LEAF, UPPER, ZERO, Float32, Int64
from zbuf_occlude.geometry.predicates import is_nearer, ray_triangle_t
from zbuf_occlude.jit.compiler import always_inline, device_function, inline_ir, njit
from zbuf_occlude.jit.pointer import reference
from zbuf_occlude.jit.simd import (
    absolute,
    count_lanes,
    dot3,
    first_lane,
    greater,
    load,
    load3,
    load_scalar,
    load_unchecked,
    maximum,
    minimum,
    muladd,
    not_less,
    select,
    splat,
    splat3,
    store,
    store_unchecked,
    tag_lanes,
)
from zbuf_occlude.jit.threads import parallel_kernel, take_block
from zbuf_occlude.jit.vec3 import cross, dot, minus

BLOCK_LINES = 256
"""Rays, or lines of sight, that a thread takes at a time: enough to wait for memory, few enough for a cache."""
START, DIRECTION, INVERSE, ENTERS, LEAVES, LIMIT = 0, 3, 6, 9, 12, 15
"""Rows of the float32 of rays: a ray is ``start + t direction``, of length 1, with t from 0 to `LIMIT`, scene units.
`START` is where it enters the scene's sphere, or where it begins; `INVERSE` is 1 / the direction. A wall x the inverse
+ `ENTERS` is the t of a box's nearer wall, widened; + `LEAVES` that of the farther one."""
EASY_CHILDREN = 4
"""Children that a ray meets, up to so many, are sorted without a branch."""
LEAST = np.float32(1e-30)
"""No box is nearer: with a lane's number in its last bits, too, this is a normal number."""
SPHERE = 1.01
"""Radius of a sphere that holds the scene, with room for rounding."""
FARTHEST = 4.0
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
FAR = 1e6
"""Scene units. The start of a ray that begins farther away is too inexact for a test of faces in float32."""
FAR_ERROR = 4e-15
"""Error of a ray's start and of its distances, as a share of its origin's distance."""
LEAST_DIRECTION = 1e-9
"""Components of a unit direction smaller than this count as this: it moves no place within the scene by 1e-8."""


class RayBlock(NamedTuple):
    """A block of n rays, or lines of sight from an eye to a point, and how far each has come."""

    origins: FloatArray  # (3 n,) world space
    directions: FloatArray  # (3 n,)
    points: FloatArray  # (3 n,) where lines of sight end
    fractions: FloatArray  # (n,) how many directions to go, or how many away the nearest face so far is
    errors: FloatArray  # (n,) error bounds of these
    skipped: FloatArray  # (n,) scene units before the start
    units: FloatArray  # (n,) scene units per direction
    own: Int64  # (n,) the points' faces, which do not hide them
    faces: Int64  # (n,) the nearest face so far, -1 for none
    current: Int64  # (n,) the node, or ~leaf, to be tested next
    tops: Int64  # (n,) where what is put on a line's stack goes
    at_node: Int64  # (n,) the lines that are at a node
    at_leaf: Int64  # (n,) and at a leaf
    met: Int64  # (n,) of these, those that may meet a face
    masks: Int64  # (n,) which
    asking: Int64  # (16 n,) each of them,
    asked: Int64  # (16 n,) each such face,
    corners: FloatArray  # (9 x 16 n,) and its corners, world space
    rays: Float32  # (16 n,) rows `START` to `LIMIT`
    nodes: Int64  # (n room,) stacks of nodes, or ~leaves, still to be tested, of one parent the nearest on top
    nearest: Float32  # (n room,) how far away they are, at least; at the bottom -`F32_MAX`
    lanes: Float32  # (17,) scratch; the last stays -`F32_MAX`


def make_lines(bvh: Bvh) -> RayBlock:
    """Allocate what a thread needs to walk along lines."""
    n, room = BLOCK_LINES, (LEAF - 1) * bvh.depth + 3
    more = n + 1  # what is not counted is written, too
    return RayBlock(
        origins=np.empty(3 * n),
        directions=np.empty(3 * n),
        points=np.empty(3 * n),
        fractions=np.empty(n),
        errors=np.empty(n),
        skipped=np.empty(n),
        units=np.empty(n),
        own=np.empty(n, dtype=np.int64),
        faces=np.empty(n, dtype=np.int64),
        current=np.empty(n, dtype=np.int64),
        tops=np.empty(n, dtype=np.int64),
        at_node=np.empty(more, dtype=np.int64),
        at_leaf=np.empty(more, dtype=np.int64),
        met=np.empty(more, dtype=np.int64),
        masks=np.empty(more, dtype=np.int64),
        asking=np.empty(LEAF * n, dtype=np.int64),
        asked=np.empty(LEAF * n, dtype=np.int64),
        corners=np.empty(9 * LEAF * n),
        rays=np.empty(16 * n, dtype=np.float32),
        nodes=np.empty(n * room, dtype=np.int64),
        nearest=np.full(n * room, -F32_MAX, dtype=np.float32),
        lanes=np.full(LEAF + 1, -F32_MAX, dtype=np.float32),
    )


@parallel_kernel
def cast_singles(tasks, bvh_, origins, directions, face_ids, distances, memory):
    """Take blocks of rays and fill in the answers."""
    bvh, lines = reference(bvh_), reference(memory)
    first, last = take_block(tasks, len(face_ids), BLOCK_LINES)
    while first < last:
        for i in range(last - first):
            o = first + i if len(origins) > 1 else 0
            for axis in range(3):
                lines.origins[3 * i + axis] = origins[o, axis]
                lines.directions[3 * i + axis] = directions[first + i, axis]
            lines.fractions[i], lines.errors[i], lines.own[i] = np.inf, 0.0, -1
        walk(bvh, lines, last - first, _keep_nearer)
        for i in range(last - first):
            d = triple(lines.directions, i)
            face_ids[first + i], distances[first + i] = lines.faces[i], lines.fractions[i] * math.sqrt(dot(d, d))
        first, last = take_block(tasks, len(face_ids), BLOCK_LINES)


@always_inline
def triple(numbers, i):
    """Numbers 3 i to 3 i + 2."""
    return load_unchecked(numbers, 3 * i), load_unchecked(numbers, 3 * i + 1), load_unchecked(numbers, 3 * i + 2)


@always_inline
def _keep_nearer(bvh, lines, i, candidate, a, b, c):
    origin, direction, face = triple(lines.origins, i), triple(lines.directions, i), lines.faces[i]
    found, error = ray_triangle_t(origin, direction, a, b, c)
    if is_nearer(
        *(origin, direction, candidate, found, error, face, lines.fractions[i], lines.errors[i]),
        *((a, b, c), corners_of(bvh, max(face, 0))),
    ):
        lines.faces[i], lines.fractions[i], lines.errors[i] = candidate, found, error


@inline_ir
def walk(bvh, lines, n, test):
    """Walk along n lines from their origins, nearest boxes first, as far as ``lines.fractions``.

    ``test(bvh, lines, i, candidate, a, b, c)`` is asked for each face abc that line i may meet, and writes to
    ``lines.faces``, which is -1 at first, and to ``lines.fractions`` how far to go from now on.
    """
    _set_up(bvh.centre, bvh.scale, lines.origins, lines.directions, n, lines.rays, lines.skipped, lines.units)
    n_nodes, n_leaves = _begin(lines, n), 0
    while n_nodes + n_leaves > 0:
        n_nodes, n_leaves = _open_nodes(bvh, lines, n_nodes, n_leaves)
        for j in range(_find_candidates(bvh, lines, n_leaves)):
            a, b, c = triple(lines.corners, 3 * j), triple(lines.corners, 3 * j + 1), triple(lines.corners, 3 * j + 2)
            test(bvh, lines, lines.asking[j], lines.asked[j], a, b, c)
        n_nodes, n_leaves = _leave(lines, n_nodes, n_leaves)


@njit(error_model="numpy")
def _set_up(centre, scale, origins, directions, n, rays, skipped, units):
    """Fill in the rows of n lines but `LIMIT`; a loop without branches, which takes several at a time.

    Lines that miss the scene's sphere skip infinitely much.
    """
    for i in range(n):
        x, y, z = directions[3 * i], directions[3 * i + 1], directions[3 * i + 2]
        shrink = 1.0 / max(max(abs(x), abs(y)), abs(z))
        x, y, z = x * shrink, y * shrink, z * shrink
        length = math.sqrt(x * x + y * y + z * z)
        inverse = 1.0 / length
        x, y, z = x * inverse, y * inverse, z * inverse
        u, v, w = origins[3 * i] - centre[0], origins[3 * i + 1] - centre[1], origins[3 * i + 2] - centre[2]
        u, v, w = u * scale, v * scale, w * scale
        along = -(u * x + v * y + w * z)
        ahead, before = max(along, 0.0), max(along - SPHERE, 0.0)
        p, q, r = u + ahead * x, v + ahead * y, w + ahead * z  # the closest to the scene's centre
        away = abs(u) + abs(v) + abs(w)
        radius = SPHERE + FAR_ERROR * away
        skipped[i] = before if p * p + q * q + r * r <= radius * radius else np.inf
        units[i] = scale * length / shrink
        _set_up_axis(rays, i, 0, u + before * x, x, away)
        _set_up_axis(rays, i, 1, v + before * y, y, away)
        _set_up_axis(rays, i, 2, w + before * z, z, away)


@always_inline
def _set_up_axis(rays, i, axis, start, direction, away):
    inverse = 1.0 / (direction if abs(direction) > LEAST_DIRECTION else LEAST_DIRECTION)
    margin = (MARGIN + FAR_ERROR * away) * abs(inverse)
    rays[(START + axis) * BLOCK_LINES + i] = start if away < FAR else np.nan  # NaN: every face of a leaf may be met
    rays[(DIRECTION + axis) * BLOCK_LINES + i] = direction
    rays[(INVERSE + axis) * BLOCK_LINES + i] = inverse
    rays[(ENTERS + axis) * BLOCK_LINES + i] = -start * inverse - margin
    rays[(LEAVES + axis) * BLOCK_LINES + i] = -start * inverse + margin


@device_function
def _begin(lines, n):
    """Let the lines that meet the scene's sphere begin at the root; return how many."""
    n_nodes, room = 0, len(lines.nodes) // BLOCK_LINES
    for i in range(n):
        lines.faces[i], lines.current[i], lines.tops[i], lines.at_node[n_nodes] = -1, 0, i * room + 1, i
        n_nodes += _set_limit(lines, i) > ZERO
    return n_nodes


@always_inline
def _set_limit(lines, i):
    """Note how far from its start a line need be followed, scene units, rounded up; NaN for one that misses."""
    more = 2.0 * FAR_ERROR * lines.skipped[i]
    distance = min(lines.fractions[i] * lines.units[i] - lines.skipped[i], FARTHEST)
    limit = np.float32(distance * (1.0 + 4e-6) + more) + MARGIN
    store_unchecked(lines.rays, LIMIT * BLOCK_LINES + i, limit)
    return limit


@always_inline
def _row(rays, i, row):
    return load_scalar(rays, row * BLOCK_LINES + i)


@always_inline
def _state(lines):
    """What steps are taken with: taken from `lines` once, as after each write it would be anew."""
    return lines.at_node, lines.at_leaf, lines.current, lines.tops, lines.nodes, lines.nearest


@device_function
def _open_nodes(bvh, lines, n_nodes, n_leaves):
    """Let the lines at a node go on to its children; return how many are at a node now, and at a leaf."""
    boxes, children, n_children, n_next = bvh.boxes, bvh.children, bvh.n_children, 0
    rays, lanes, state = lines.rays, lines.lanes, _state(lines)
    for j in range(n_nodes):
        i = load_unchecked(state[0], j)
        node, enter, leave = load_unchecked(state[2], i), splat(LEAST), splat(_row(rays, i, LIMIT))
        for axis in range(3):
            inverse = _row(rays, i, INVERSE + axis)
            near = axis + UPPER * np.int64(inverse < ZERO)
            near_wall, far_wall = 6 * node + near, 6 * node + 2 * axis + UPPER - near
            enter = maximum(enter, muladd(load(boxes, LEAF * near_wall), inverse, splat(_row(rays, i, ENTERS + axis))))
            leave = minimum(leave, muladd(load(boxes, LEAF * far_wall), inverse, splat(_row(rays, i, LEAVES + axis))))
        mask = not_less(leave, enter) & ((np.int64(1) << load_unchecked(n_children, node)) - 1)
        enter = select(mask, tag_lanes(enter), splat(-F32_MAX))
        store(lanes, 0, enter)
        top, rest = load_unchecked(state[3], i), mask
        for _ in range(EASY_CHILDREN):
            rest = _push(children, LEAF * node, enter, lanes, state, top, rest)
        while rest:
            rest = _push(children, LEAF * node, enter, lanes, state, top, rest)
        n_next, n_leaves = _go_on(i, top + count_lanes(mask), _row(rays, i, LIMIT), state, n_next, n_leaves)
    return n_next, n_leaves


@always_inline
def _push(children, first, enter, lanes, state, top, rest):
    """Put the first child of a mask below all that are nearer; return the others. None goes where it is not counted."""
    lane = first_lane(rest | (1 << LEAF))
    nearest = load_scalar(lanes, lane)
    place = top + count_lanes(greater(enter, splat(nearest)))
    store_unchecked(state[4], place, load_unchecked(children, first + (lane & (LEAF - 1))))
    store_unchecked(state[5], place, nearest)
    return rest & (rest - 1)


@always_inline
def _go_on(i, top, limit, state, n_nodes, n_leaves):
    """Let a line take what is on top of its stack; return how many are at a node now, and at a leaf."""
    at_node, at_leaf, current, tops, nodes, nearest = state
    while (
        load_unchecked(nearest, top - 1) > limit
    ):  # the bottom never is: eyes and rays are too near for a limit of -infinity
        top -= 1
    more = np.int64(load_unchecked(nearest, top - 1) > -F32_MAX)
    node = load_unchecked(nodes, top - more)
    store_unchecked(current, i, node)
    store_unchecked(tops, i, top - more)
    store_unchecked(at_node, n_nodes, i)
    store_unchecked(at_leaf, n_leaves, i)
    leaf = np.int64(node < 0)
    return n_nodes + (more & (1 - leaf)), n_leaves + (more & leaf)


@device_function
def _leave(lines, n_nodes, n_leaves):
    """Let the lines at a leaf go on; return how many are at a node now, and at a leaf."""
    state, n_next = _state(lines), 0
    for j in range(n_leaves):
        i = load_unchecked(state[1], j)
        n_nodes, n_next = _go_on(i, load_unchecked(state[3], i), _set_limit(lines, i), state, n_nodes, n_next)
    return n_nodes, n_next


@device_function
def _find_candidates(bvh, lines, n_leaves):
    """Find the faces that the lines at a leaf may meet, and their corners; return how many."""
    current, met, masks, n_met = lines.current, lines.met, lines.masks, 0
    rays, corners, used = lines.rays, bvh.corners, bvh.used
    for j in range(n_leaves):
        i = load_unchecked(lines.at_leaf, j)
        leaf = ~load_unchecked(current, i)
        mask = _candidates(corners, leaf, rays, i) & load_unchecked(used, leaf)
        store_unchecked(met, n_met, i)
        store_unchecked(masks, n_met, mask)
        n_met += mask != 0
    asking, asked, found, n_asked = lines.asking, lines.asked, lines.corners, 0
    for j in range(n_met):
        i, mask = load_unchecked(met, j), load_unchecked(masks, j)
        while mask:
            face = np.int64(load_unchecked(bvh.face_ids, LEAF * ~load_unchecked(current, i) + first_lane(mask)))
            store_unchecked(asking, n_asked, i)
            store_unchecked(asked, n_asked, face)
            mask &= mask - 1
            n_asked += face != load_unchecked(lines.own, i)
    faces, vertices = bvh.faces, bvh.vertices
    for j in range(n_asked):
        for corner in range(3):
            vertex = np.int64(load_unchecked(faces, 3 * load_unchecked(asked, j) + corner))
            for axis in range(3):
                store_unchecked(found, 9 * j + 3 * corner + axis, load_unchecked(vertices, 3 * vertex + axis))
    return n_asked


@always_inline
def _candidates(corners, leaf, rays, i):
    """Mask of the faces of a leaf that a line may meet before its limit.

    References
    ----------
    Moeller, Trumbore: Fast, minimum storage ray/triangle intersection. Journal of Graphics Tools 2 (1997),
    doi:10.1080/10867651.1997.10487468; here with the ray's moment about the first corner, whose error does not grow
    with a face's distance.
    """
    base, zero = leaf * 9 * LEAF, splat(ZERO)
    direction = _splat_rows(rays, i, DIRECTION)
    a = load3(corners, base, LEAF)
    first = minus(load3(corners, base + 3 * LEAF, LEAF), a)
    second = minus(load3(corners, base + 6 * LEAF, LEAF), a)
    start = minus(_splat_rows(rays, i, START), a)
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
    before = not_less(depth, zero - depth_error) & not_less(splat(_row(rays, i, LIMIT)) * slope + depth_error, depth)
    edge_on = not_less(slope_error, slope) & not_less((size + splat(MARGIN)) * splat(SPREAD), distance)
    return (inside & before) | edge_on


@always_inline
def _size_of(a):
    """Sum of the components' sizes, at least the length."""
    return absolute(a[0]) + absolute(a[1]) + absolute(a[2])


@always_inline
def _splat_rows(rays, i, row):
    return splat3((_row(rays, i, row), _row(rays, i, row + 1), _row(rays, i, row + 2)))
