"""BVH traversal of rays of many origins: float32 excludes boxes and faces, float64 decides the rest.

The rays of a block advance together, one kind of step at a time: nodes, leaves, faces. While the memory that a step
needs is fetched, steps of other rays proceed, and hardly any branch depends on the outcome of a test.

A face that float32 excludes cannot be hit: every comparison has a margin above the rounding of all its operands.
The definition in `predicates` decides the remaining faces, so face and distance are the oracle's, ties included.

All float32 arithmetic is in scene space, from a ray's start: the point `SPHERE_RADIUS` before its closest point to the
scene's centre, or its origin if that comes later. No coordinate of a start exceeds 1.43. The boxes are widened by its
rounding. Rays from beyond `MAX_FACE_TEST_DISTANCE` test boxes only.

Error analysis of the tests of faces: u is float32's unit roundoff, P a ray's start and D its direction, |P| < 1.43 and
|P x D| < 1.01, e and f are a face's edges from its first corner a, |a| <= 1. All, and P x D, are rounded once. (Edges
shorter than 1e-8 err by more, but a ray that hits such a face has a moment as short.)

* The moment M = P x D - a x D, with |M| < 2.02, errs by less than 8.5 u.
* The signed areas M . f and -M . e err by less than 17 u times the edge. The slope D . (f x e) errs by 9 u |e| |f|. The
  third area, the slope less the others, errs by 21 u (|e| + |f|) + 11 u |e| |f|.
* The depth (f x e) . (a - P) errs by 23 u |e| |f|. Limit x slope less the depth, with limits up to `MAX_RAY_LENGTH`,
  errs by 67 u |e| |f|.
* A slope of less than its error may have the wrong sign. Then a hit has no signed area above the slope's error, and no
  depth above 2.1 times the slope's error.

No value of a hit is thus less than -21 u (|e| + |f|) - 67 u |e| |f|. `AREA_ERROR` and `VOLUME_ERROR` have a margin.
"""

import math
from typing import NamedTuple

import numpy as np

from zbuf_occlude.base.arrays import FloatArray, have_safe_norms
from zbuf_occlude.base.jit.compiler import always_inline, device_function, inline_ir, njit
from zbuf_occlude.base.jit.pointer import pointer_to
from zbuf_occlude.base.jit.simd import (
    absolute,
    blend,
    count_lanes,
    cross3,
    cross3_add,
    dot3,
    first_lane,
    greater,
    last_lane,
    load,
    load3,
    load_scalar,
    load_unchecked,
    maximum,
    minimum,
    muladd,
    not_less,
    prefetch,
    splat,
    splat3,
    store,
    store_unchecked,
    tag_lanes,
)
from zbuf_occlude.base.jit.threads import parallel_kernel, take_block
from zbuf_occlude.base.jit.vec3 import minus
from zbuf_occlude.engines.exact.bvh import Bvh, corners_of
from zbuf_occlude.engines.exact.layout import (
    F32_MAX,
    FIRST_CORNER,
    FIRST_EDGE,
    LEAF,
    LEAST,
    SECOND_EDGE,
    TRIANGLE_ROWS,
    UPPER,
    ZERO,
    Float32,
    Int64,
)
from zbuf_occlude.geometry.predicates import filtered_hit, is_nearer, ray_triangle_t

TRAVERSAL_RAYS = 256
"""Rays, or lines of sight, per block: enough to hide memory latency, few enough for the cache."""
START, DIRECTION, MOMENT, INVERSE, ENTERS, LEAVES, LIMIT, RAY_ROWS = 0, 3, 6, 9, 12, 15, 18, 19
"""Rows of the float32 of rays: a ray is ``start + t direction``, of length 1, with t from 0 to `LIMIT`, scene units.
`MOMENT` is start x direction; `INVERSE` is 1 / direction.
A box's near wall x inverse + `ENTERS` is the t of the near wall, widened; far wall x inverse + `LEAVES` that of the far
one."""
NODE_RAYS = 16
"""Rays whose nodes are tested before their children are pushed: a read of part of a vector just stored would stall."""
ENTRIES = 2 * LEAF
"""Stride of the entry distances of rays; those after the 16 of a node stay -`F32_MAX`."""
AHEAD = 6
"""Rays between a ray and the one whose node or leaf is fetched meanwhile."""
PAIRS = 64
"""Pairs of a ray and a face that float64 tests at a time, a multiple of `F64_LANES`."""
F64_LANES = 8
"""Float64 numbers of the widest vector."""
CORNERS, PAIR_ORIGIN, PAIR_DIRECTION, FRACTION, ERROR, PAIR_ROWS = 0, 9, 12, 15, 16, 17
"""Rows of pairs: corners of the face, origin and direction of the ray, distance of the hit in directions, its error."""
UNROLLED_CHILDREN = 4
"""Children of a node that are pushed without a branch."""
MIN_ENTRY = np.float32(1e-30)
"""Least entry distance of a box: a normal number even with a lane's index in its last bits."""
SPHERE_RADIUS = 1.01
"""Radius of the scene's sphere, with a margin for rounding."""
MAX_RAY_LENGTH = 4.0
"""Upper bound of a ray's length within the sphere, scene units."""
MARGIN = np.float32(2e-6)
"""Margin around boxes, scene units. Rounding of the box, the ray's inverse and offset and their sums moves a wall by at
most 6e-7."""
MAX_OFFSET = 1e30
"""Largest size of `ENTERS`, `LEAVES` and limits: farther than any box, but small beside the walls of an empty box."""
MAX_FACE_TEST_DISTANCE = 1e6
"""Largest distance of an origin, scene units, at which a ray's start is accurate enough for float32 tests of faces."""
FAR_ERROR = 4e-15
"""Error bound of a ray's start and distances, relative to its origin's distance."""
MIN_DIRECTION = 1e-9
"""Least component of a unit direction; smaller ones are replaced by it, which moves no point in the scene by 1e-8."""


class TraversalScratch(NamedTuple):
    """Working memory of a block of n rays, or lines of sight from an eye to a point."""

    origins: FloatArray  # (3 n,) world space
    directions: FloatArray  # (3 n,)
    points: FloatArray  # (3 n,) ends of lines of sight
    fractions: FloatArray  # (n,) length still to be searched, or distance of the nearest hit so far, in directions
    errors: FloatArray  # (n,) error bounds of `fractions`
    skipped: FloatArray  # (n,) distance from the origin to the start, scene units; infinite if the ray misses all faces
    units: FloatArray  # (n,) scene units per direction
    own: Int64  # (n,) own face of the point, which does not hide it; -1 for none
    faces: Int64  # (n,) nearest face so far, -1 for none
    current: Int64  # (n,) node, or ~leaf, to be tested next
    tops: Int64  # (n,) top of each ray's stack
    at_node: Int64  # (n + 1,) rays whose next test is a node
    at_leaf: Int64  # (n + 1,) rays whose next test is a leaf
    met: Int64  # (n + 1,) rays at a leaf that may meet one of its faces
    masks: Int64  # (n + 1,) mask of these faces, or of the children that a ray at a node enters
    asking: Int64  # (16 n,) ray of each candidate pair
    asked: Int64  # (16 n,) face of each candidate pair
    pairs: FloatArray  # (17 x `PAIRS`,) rows `CORNERS` to `ERROR` of pairs of ray and face, world space
    rays: Float32  # (19 n,) rows `START` to `LIMIT`
    nodes: Int64  # (16 + n room,) stacks of nodes, or ~leaves; of one parent's children the nearest is on top
    nearest: Float32  # (16 + n room,) lower bounds of their distances; -`F32_MAX` at the bottom
    entries: Float32  # (32 x `NODE_RAYS`,) entry distances of the children of each ray's node


def make_traversal_scratch(bvh: Bvh) -> TraversalScratch:
    """Allocate a thread's working memory for traversal."""
    n, room = TRAVERSAL_RAYS, (LEAF - 1) * bvh.depth + 3
    more = n + 1  # one spare slot: entries past the count are stored unconditionally
    return TraversalScratch(
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
        pairs=np.zeros(PAIR_ROWS * PAIRS),
        rays=np.empty(RAY_ROWS * n, dtype=np.float32),
        nodes=np.empty(LEAF + n * room, dtype=np.int64),
        nearest=np.full(LEAF + n * room, -F32_MAX, dtype=np.float32),
        entries=np.full(ENTRIES * NODE_RAYS, -F32_MAX, dtype=np.float32),
    )


@parallel_kernel
def cast_singles(tasks, bvh_, origins, directions, patterns, face_ids, distances, unsafe, memory):
    """Find the first hits of blocks of rays; set ``unsafe[0]`` to 1 where a direction has no safe norm.

    `patterns` are the bit patterns of the directions, (3 n,).
    """
    bvh, scratch = pointer_to(bvh_), pointer_to(memory)
    first, last = take_block(tasks, len(face_ids), TRAVERSAL_RAYS)
    while first < last:
        if not have_safe_norms(patterns[3 * first : 3 * last]):
            unsafe[0] = 1
            return
        _take_rays(origins, directions, first, last, scratch)
        traverse_bvh(bvh, scratch, last - first, _keep_nearer)
        _give_hits(scratch.faces, scratch.fractions, scratch.directions, face_ids[first:last], distances[first:last])
        first, last = take_block(tasks, len(face_ids), TRAVERSAL_RAYS)


@device_function
def _take_rays(origins, directions, first, last, scratch):
    """Copy the rays of a block; without branches, so that the compiler vectorises the loops."""
    for i in range(3 * (last - first)):
        store_unchecked(scratch.directions, i, load_unchecked(directions, 3 * first + i))
    if len(origins) > 1:
        for i in range(3 * (last - first)):
            store_unchecked(scratch.origins, i, load_unchecked(origins, 3 * first + i))
    else:
        x, y, z = triple(origins, 0)
        for i in range(last - first):
            store_unchecked(scratch.origins, 3 * i, x)
            store_unchecked(scratch.origins, 3 * i + 1, y)
            store_unchecked(scratch.origins, 3 * i + 2, z)
    scratch.fractions[:], scratch.errors[:], scratch.own[:] = np.inf, 0.0, -1


@njit(error_model="numpy")
def _give_hits(faces, fractions, directions, face_ids, distances):
    """Write the hits of a block; without branches, so that the compiler vectorises the loop."""
    for i in range(len(face_ids)):
        x, y, z = triple(directions, i)
        store_unchecked(face_ids, i, load_unchecked(faces, i))
        store_unchecked(distances, i, load_unchecked(fractions, i) * math.sqrt(x * x + y * y + z * z))


@always_inline
def triple(numbers, i):
    """Return numbers 3 i to 3 i + 2."""
    return load_unchecked(numbers, 3 * i), load_unchecked(numbers, 3 * i + 1), load_unchecked(numbers, 3 * i + 2)


@always_inline
def _keep_nearer(bvh, scratch, first, n):
    """Meet the faces of n candidate pairs, from `first` on, and keep the nearest hit of each ray."""
    pairs = scratch.pairs
    _gather(scratch, scratch.origins, PAIR_ORIGIN, first, n)
    _gather(scratch, scratch.directions, PAIR_DIRECTION, first, n)
    _filter_hits(pairs, (n + F64_LANES - 1) & -F64_LANES)
    for j in range(n):
        i, candidate = load_unchecked(scratch.asking, first + j), load_unchecked(scratch.asked, first + j)
        found, error = load_unchecked(pairs, FRACTION * PAIRS + j), load_unchecked(pairs, ERROR * PAIRS + j)
        before, before_error = load_unchecked(scratch.fractions, i), load_unchecked(scratch.errors, i)
        nearer = found + error < before - before_error
        farther = (found - error > before + before_error) | (found == math.inf)
        if not (nearer | farther):  # both overlap, or the filter cannot tell
            found, error, nearer = _compare(bvh, scratch, i, j, candidate, found, error)
        store_unchecked(scratch.faces, i, candidate if nearer else load_unchecked(scratch.faces, i))
        store_unchecked(scratch.fractions, i, found if nearer else before)
        store_unchecked(scratch.errors, i, error if nearer else before_error)
        set_limit(scratch, i)


@device_function
def _compare(bvh, scratch, i, j, candidate, found, error):
    """Return the distance of the hit of pair j, of ray i, its error, and whether it is before the nearest so far."""
    origin, direction = triple(scratch.origins, i), triple(scratch.directions, i)
    corners = corners_of_pair(scratch.pairs, j)
    if math.isnan(found):
        found, error = ray_triangle_t(origin, direction, *corners)
    face, before = scratch.faces[i], (scratch.fractions[i], scratch.errors[i])
    other_corners = corners_of(bvh, max(face, 0))
    return found, error, is_nearer(origin, direction, candidate, found, error, face, *before, corners, other_corners)


@njit(error_model="numpy")
def _filter_hits(pairs, n):
    """Compute the hits of n pairs; without branches, so that the compiler vectorises the loop."""
    for j in range(n):
        origin, direction = _vector_of_pair(pairs, j, PAIR_ORIGIN), _vector_of_pair(pairs, j, PAIR_DIRECTION)
        fraction, error = filtered_hit(origin, direction, *corners_of_pair(pairs, j))
        store_unchecked(pairs, FRACTION * PAIRS + j, fraction)
        store_unchecked(pairs, ERROR * PAIRS + j, error)


@always_inline
def corners_of_pair(pairs, j):
    """Return the corners of the face of a pair."""
    first, second = _vector_of_pair(pairs, j, CORNERS), _vector_of_pair(pairs, j, CORNERS + 3)
    return first, second, _vector_of_pair(pairs, j, CORNERS + 6)


@always_inline
def _vector_of_pair(pairs, j, row):
    at = row * PAIRS + j
    return load_unchecked(pairs, at), load_unchecked(pairs, at + PAIRS), load_unchecked(pairs, at + 2 * PAIRS)


@always_inline
def _gather(scratch, vectors, row, first, n):
    """Copy a vector of the ray of each of n candidate pairs, from `first` on, to three rows."""
    for j in range(n):
        i = load_unchecked(scratch.asking, first + j)
        for axis in range(3):
            store_unchecked(scratch.pairs, (row + axis) * PAIRS + j, load_unchecked(vectors, 3 * i + axis))


@inline_ir
def traverse_bvh(bvh, scratch, n, test):
    """Traverse the hierarchy along n rays, nearest boxes first, up to ``scratch.fractions``.

    ``test(bvh, scratch, first, m)`` is called for m candidate pairs, from `first` on, whose corners are the first rows
    of ``scratch.pairs``. It writes hits to ``scratch.faces``, which is -1 at first, and the length that is still to be
    searched to ``scratch.fractions``, and calls `set_limit` after each change.
    """
    vectors = scratch.origins, scratch.directions
    _set_up(bvh.centre, bvh.scale, bvh.box, *vectors, n, scratch.rays, scratch.skipped, scratch.units)
    n_nodes, n_leaves = _begin(scratch, n), 0
    while n_nodes + n_leaves > 0:
        n_nodes, n_leaves = _push_children(bvh, scratch, n_nodes, n_leaves)
        n_asked = _find_candidates(bvh, scratch, n_leaves)
        for first in range(0, n_asked, PAIRS):
            m = min(n_asked - first, PAIRS)
            _gather_corners(bvh, scratch, first, m)
            test(bvh, scratch, first, m)
        n_nodes, n_leaves = _pop_after_leaves(scratch, n_nodes, n_leaves)


@njit(error_model="numpy")
def _set_up(centre, scale, box, origins, directions, n, rays, skipped, units):
    """Fill in the rows of n rays but `LIMIT`; without branches, so that the compiler vectorises the loop.

    ``skipped`` is infinite for rays that miss the scene's sphere, or the box of all faces.
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
        ahead, before = max(along, 0.0), max(along - SPHERE_RADIUS, 0.0)
        p, q, r = u + ahead * x, v + ahead * y, w + ahead * z  # the ray's closest point to the scene's centre
        away = abs(u) + abs(v) + abs(w)
        radius = SPHERE_RADIUS + FAR_ERROR * away
        units[i] = scale * length / shrink
        u, v, w = u + before * x, v + before * y, w + before * z
        known = 1.0 if away < MAX_FACE_TEST_DISTANCE else np.nan  # NaN: every face of a leaf may be met
        margin = MARGIN + FAR_ERROR * away
        enter, leave = _set_up_axis(box, rays, i, 0, u, x, margin, known)
        y_enter, y_leave = _set_up_axis(box, rays, i, 1, v, y, margin, known)
        z_enter, z_leave = _set_up_axis(box, rays, i, 2, w, z, margin, known)
        rays[MOMENT * TRAVERSAL_RAYS + i] = (v * z - w * y) * known
        rays[(MOMENT + 1) * TRAVERSAL_RAYS + i] = (w * x - u * z) * known
        rays[(MOMENT + 2) * TRAVERSAL_RAYS + i] = (u * y - v * x) * known
        enter, leave = max(max(enter, y_enter), max(z_enter, 0.0)), min(min(leave, y_leave), z_leave)
        meets = (p * p + q * q + r * r <= radius * radius) & (enter <= leave)
        skipped[i] = before if meets else np.inf


@always_inline
def _set_up_axis(box, rays, i, axis, start, direction, margin, known):
    """Fill in the rows of an axis; return where the ray enters and leaves the box of all faces along it."""
    inverse = 1.0 / (direction if abs(direction) > MIN_DIRECTION else MIN_DIRECTION)
    margin = margin * abs(inverse)
    rays[(START + axis) * TRAVERSAL_RAYS + i] = start * known
    rays[(DIRECTION + axis) * TRAVERSAL_RAYS + i] = direction
    rays[(INVERSE + axis) * TRAVERSAL_RAYS + i] = inverse
    rays[(ENTERS + axis) * TRAVERSAL_RAYS + i] = max(-start * inverse - margin, -MAX_OFFSET)
    rays[(LEAVES + axis) * TRAVERSAL_RAYS + i] = min(-start * inverse + margin, MAX_OFFSET)
    one, other = (box[axis] - start) * inverse, (box[UPPER + axis] - start) * inverse
    return min(one, other) - margin, max(one, other) + margin


@device_function
def _begin(scratch, n):
    """Put the rays that are not skipped at the root; return their number."""
    n_nodes, room, at_node = 0, len(scratch.nodes) // TRAVERSAL_RAYS, scratch.at_node
    for i in range(n):
        store_unchecked(at_node, n_nodes, i)
        n_nodes += load_unchecked(scratch.skipped, i) < np.inf
    scratch.faces[:n] = -1
    for j in range(n_nodes):
        i = load_unchecked(at_node, j)
        store_unchecked(scratch.current, i, 0)
        store_unchecked(scratch.tops, i, LEAF + i * room + 1)
        set_limit(scratch, i)
    return n_nodes


@always_inline
def set_limit(scratch, i):
    """Write the length of a ray still to be searched, scene units, rounded up; it is finite, and more than -2.

    The nearest hit may be farther by its error, which exceeds all margins where a far ray grazes a face.
    """
    more = min(2.0 * FAR_ERROR * scratch.skipped[i], MAX_OFFSET)
    fraction = scratch.fractions[i] + scratch.errors[i]
    distance = max(min(fraction * scratch.units[i] - scratch.skipped[i], MAX_RAY_LENGTH), -1.0)
    limit = np.float32(distance * (1.0 + 4e-6) + more) + MARGIN
    store_unchecked(scratch.rays, LIMIT * TRAVERSAL_RAYS + i, limit)


@always_inline
def _row(rays, i, row):
    return load_scalar(rays, row * TRAVERSAL_RAYS + i)


@always_inline
def _state(scratch):
    """Return the arrays of a step, read from `scratch` once: after each write they would be read again."""
    return scratch.at_node, scratch.at_leaf, scratch.current, scratch.tops, scratch.nodes, scratch.nearest


@device_function
def _push_children(bvh, scratch, n_nodes, n_leaves):
    """Push the children that each ray at a node enters, and pop the nearest; return the numbers at nodes and leaves."""
    children, rays, entries, masks, n_next = bvh.children, scratch.rays, scratch.entries, scratch.masks, 0
    state = at_node, _, current, tops, _, nearest = _state(scratch)
    for first in range(0, n_nodes, NODE_RAYS):
        last = min(first + NODE_RAYS, n_nodes)
        for j in range(first, last):
            ahead = load_unchecked(current, load_unchecked(at_node, min(j + AHEAD, n_nodes - 1)))
            for row in range(6):
                prefetch(bvh.boxes, LEAF * (6 * ahead + row))
            prefetch(children, LEAF * ahead)
            i = load_unchecked(at_node, j)
            mask, enter = _entered(bvh, rays, i, load_unchecked(current, i))
            store_unchecked(masks, j, mask)
            store(entries, ENTRIES * (j - first), enter)
        for j in range(first, last):
            i, mask, at = load_unchecked(at_node, j), load_unchecked(masks, j), ENTRIES * (j - first)
            first_child, top = LEAF * load_unchecked(current, i), load_unchecked(tops, i)
            enter, rest = load(entries, at), mask
            for _ in range(UNROLLED_CHILDREN):
                rest = _push_child(children, first_child, enter, entries, at, state, top, rest)
            while rest:
                rest = _push_child(children, first_child, enter, entries, at, state, top, rest)
            top += count_lanes(mask) - 1
            # ends at the bottom at the latest, since every limit is more than -2
            while load_unchecked(nearest, top) > _row(rays, i, LIMIT):
                top -= 1
            n_next, n_leaves = _take(i, top, state, n_next, n_leaves)
    return n_next, n_leaves


@always_inline
def _entered(bvh, rays, i, node):
    """Return the mask of the children of a node that a ray enters, and their distances, -`F32_MAX` for the others."""
    enter, leave = splat(MIN_ENTRY), splat(_row(rays, i, LIMIT))
    for axis in range(3):
        inverse = _row(rays, i, INVERSE + axis)
        near = axis + UPPER * np.int64(inverse < ZERO)
        near_wall, far_wall = 6 * node + near, 6 * node + 2 * axis + UPPER - near
        enter = maximum(enter, muladd(load(bvh.boxes, LEAF * near_wall), inverse, splat(_row(rays, i, ENTERS + axis))))
        leave = minimum(leave, muladd(load(bvh.boxes, LEAF * far_wall), inverse, splat(_row(rays, i, LEAVES + axis))))
    mask = not_less(leave, enter)
    return mask, blend(mask, tag_lanes(enter), splat(-F32_MAX))


@always_inline
def _push_child(children, first_child, enter, entries, at, state, top, rest):
    """Push the first child of a mask below all nearer ones; return the others. No entry goes past the count."""
    lane = first_lane(rest | (1 << LEAF))
    nearest = load_scalar(entries, at + lane)
    slot = top + count_lanes(greater(enter, splat(nearest)))
    store_unchecked(state[4], slot, load_unchecked(children, first_child + (lane & (LEAF - 1))))
    store_unchecked(state[5], slot, nearest)
    return rest & (rest - 1)


@always_inline
def _take(i, top, state, n_nodes, n_leaves):
    """Pop an entry of a ray's stack, unless it is the bottom; return the numbers of rays at nodes and at leaves."""
    at_node, at_leaf, current, tops, nodes, nearest = state
    more = np.int64(load_unchecked(nearest, top) > -F32_MAX)
    top += 1 - more
    node = load_unchecked(nodes, top)
    store_unchecked(current, i, node)
    store_unchecked(tops, i, top)
    store_unchecked(at_node, n_nodes, i)
    store_unchecked(at_leaf, n_leaves, i)
    leaf = np.int64(node < 0)
    return n_nodes + (more & (1 - leaf)), n_leaves + (more & leaf)


@device_function
def _pop_after_leaves(scratch, n_nodes, n_leaves):
    """Pop the next entry of each ray at a leaf; return the numbers of rays at nodes and at leaves."""
    n_next = 0
    state = _, at_leaf, _, tops, _, nearest = _state(scratch)
    for j in range(n_leaves):
        i = load_unchecked(at_leaf, j)
        limit, top = splat(_row(scratch.rays, i, LIMIT)), load_unchecked(tops, i) - LEAF
        within = not_less(limit, load(nearest, top))
        while within == 0:  # all 16 entries are too far
            top -= LEAF
            within = not_less(limit, load(nearest, top))
        n_nodes, n_next = _take(i, top + last_lane(within), state, n_nodes, n_next)
    return n_nodes, n_next


@device_function
def _find_candidates(bvh, scratch, n_leaves):
    """List candidate pairs of a ray at a leaf and a face; return their number."""
    current, met, masks, n_met = scratch.current, scratch.met, scratch.masks, 0
    rays, triangles, used = scratch.rays, bvh.triangles, bvh.used
    for j in range(n_leaves):
        ahead = ~load_unchecked(current, load_unchecked(scratch.at_leaf, min(j + AHEAD, n_leaves - 1)))
        for row in range(TRIANGLE_ROWS):
            prefetch(triangles, LEAF * (TRIANGLE_ROWS * ahead + row))
        prefetch(used, ahead)
        prefetch(bvh.face_ids, LEAF * ahead)
        i = load_unchecked(scratch.at_leaf, j)
        leaf = ~load_unchecked(current, i)
        mask = _candidates(triangles, leaf, rays, i) & load_unchecked(used, leaf)
        store_unchecked(met, n_met, i)
        store_unchecked(masks, n_met, mask)
        n_met += mask != 0
    asking, asked, n_asked = scratch.asking, scratch.asked, 0
    for j in range(n_met):
        i, mask = load_unchecked(met, j), load_unchecked(masks, j)
        while mask:
            face = np.int64(load_unchecked(bvh.face_ids, LEAF * ~load_unchecked(current, i) + first_lane(mask)))
            store_unchecked(asking, n_asked, i)
            store_unchecked(asked, n_asked, face)
            prefetch(bvh.faces, 3 * face)
            mask &= mask - 1
            n_asked += face != load_unchecked(scratch.own, i)
    return n_asked


@device_function
def _gather_corners(bvh, scratch, first, n):
    """Copy the corners of the face of each of n candidate pairs, from `first` on, to their rows."""
    faces, vertices, pairs = bvh.faces, bvh.vertices, scratch.pairs
    for j in range(n):
        for corner in range(3):
            vertex = np.int64(load_unchecked(faces, 3 * load_unchecked(scratch.asked, first + j) + corner))
            prefetch(vertices, 3 * vertex)
    for j in range(n):
        for corner in range(3):
            vertex = np.int64(load_unchecked(faces, 3 * load_unchecked(scratch.asked, first + j) + corner))
            for axis in range(3):
                row = CORNERS + 3 * corner + axis
                store_unchecked(pairs, row * PAIRS + j, load_unchecked(vertices, 3 * vertex + axis))


@always_inline
def _candidates(triangles, leaf, rays, i):
    """Return the mask of the faces of a leaf that a ray may meet before its limit.

    References
    ----------
    Moeller, Trumbore: Fast, minimum storage ray/triangle intersection. Journal of Graphics Tools 2 (1997),
    doi:10.1080/10867651.1997.10487468. Departure: the ray's moment about the first corner is derived from that about
    the scene's centre, and all tests have one error bound, `least`.
    """
    zero = splat(ZERO)
    direction, moment = _splat_rows(rays, i, DIRECTION), _splat_rows(rays, i, MOMENT)
    base = leaf * TRIANGLE_ROWS * LEAF
    corner = load3(triangles, base + FIRST_CORNER * LEAF, LEAF)
    first, second = load3(triangles, base + FIRST_EDGE * LEAF, LEAF), load3(triangles, base + SECOND_EDGE * LEAF, LEAF)
    least = load(triangles, base + LEAST * LEAF)
    to_corner = minus(corner, _splat_rows(rays, i, START))
    moment, normal = cross3_add(direction, corner, moment), cross3(second, first)
    slope, depth = dot3(normal, direction), dot3(normal, to_corner)
    u, v = dot3(moment, second), -dot3(moment, first)
    turned = greater(zero, slope)
    u, v, depth, slope = blend(turned, -u, u), blend(turned, -v, v), blend(turned, -depth, depth), absolute(slope)
    inside = not_less(u, least) & not_less(v, least) & not_less(slope - u - v, least)
    beyond = muladd(splat(_row(rays, i, LIMIT)), slope, -depth)
    return inside & not_less(depth, least) & not_less(beyond, least)


@always_inline
def _splat_rows(rays, i, row):
    return splat3((_row(rays, i, row), _row(rays, i, row + 1), _row(rays, i, row + 2)))
