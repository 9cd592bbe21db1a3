"""The bounding volume hierarchy: leaves of 16 faces that are near each other, and a tree of up to 16 children a node.

Scene space is world space moved and scaled so that the mesh fits into the unit sphere.
"""

from typing import NamedTuple

import numpy as np

from zbuf_occlude.arrays import FloatArray, IntArray
from zbuf_occlude.exact.layout import F32_MAX, LEAF, ROUNDOFF, UPPER, ZERO, Float32, Int64, aligned
from zbuf_occlude.geometry.hilbert import BLOCK, CODE_BITS, THREAD, indices_of, new_cells, place_along_curve
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.geometry.predicates import is_flat
from zbuf_occlude.jit.compiler import always_inline, device_function, njit
from zbuf_occlude.jit.pointer import reference
from zbuf_occlude.jit.simd import (
    greater,
    load,
    load_scalar,
    load_scalar3,
    load_unchecked,
    minimum,
    splat,
    store,
    store_unchecked,
)
from zbuf_occlude.jit.threads import n_blocks, next_task, parallel_for, parallel_kernel, take_block
from zbuf_occlude.jit.vec3 import cross, dot, minus

WEAK_NORMAL = 1e-6
"""A face whose normal is shorter than this times its longest edge squared has no float32 plane: float64 decides it."""
LONG = 0.125
"""Faces longer than this fraction of the mesh's longest side are grouped among themselves."""
RUN_FACES = 512
"""Faces that are halved together, a multiple of `LEAF`."""
THREAD_RUNS = 4
"""Runs that are worth another thread: fewer are done before it wakes."""
ROW, CENTRE = 16, 6
"""Numbers of a row (`_put_row`), and where those of the centre begin."""
PLACES = 512
"""Places along an axis that the faces of a run are sorted by; those at one place stay in the order of the curve."""
BINS = 16
"""Leaves are divided at one of this many places."""
PLACE_BITS = 3 * CODE_BITS
"""Bits of a face's place along the curve."""
LONG_FACE, NO_FACE = 1, 2
"""Kinds of faces, by which they are sorted first: long ones, and those that block nothing; short ones are 0."""


class Bvh(NamedTuple):
    """A prepared mesh. A face's *row* is 16 x its leaf + its place in there."""

    centre: FloatArray  # (3,) world space
    scale: float  # scene units per world unit
    contact: float  # the contact tolerance, scene units
    face_ids: IntArray  # (m leaves, 16) faces of each leaf, -1 where there is none
    rows: IntArray  # (f + 1,) row of each face, -1 for those that cannot block; the last one, -1, is that of no face
    corners: Float32  # (m, 3 corners, 3 axes, 16 faces) scene space
    planes: Float32  # (m, 4, 16) unit normal and offset of each face: n . p = offset on it
    used: Int64  # (m,) masks of the faces that there are in each leaf
    weak: Int64  # (m,) masks of the faces without a float32 plane (`WEAK_NORMAL`)
    boxes: Float32  # (6 n, 16) of the children of n nodes, those of node i from row 6 i on; node 0 is the root
    children: IntArray  # (16 n,) their nodes, or ~leaf
    n_children: IntArray  # (n,) how many each node has, the first of its 16
    depth: int  # nodes on the longest way from the root to a leaf
    vertices: FloatArray  # (v, 3) world space
    faces: IntArray  # (f, 3)
    world_contact: float


def build_bvh(mesh: Mesh, contact: float) -> Bvh:
    """Prepare a mesh; `contact` is the contact tolerance in world units. O(f log f), about 70 bytes per face.

    Notes
    -----
    Faces whose corners lie on one line are left out: by definition (`geometry.predicates.blocks`) they block nothing.
    Long faces would enlarge the boxes of short ones, so they get leaves of their own. Runs of `RUN_FACES` faces along
    the Hilbert curve are halved by the surface area heuristic, down to leaves. (Runs of 16 faces of the curve itself
    have larger boxes: points meet 20 % more of them.) Leaves are divided likewise, into the children of nodes.

    References
    ----------
    Goldsmith, Salmon: Automatic creation of object hierarchies for ray tracing. IEEE CG&A 7 (1987),
    doi:10.1109/MCG.1987.276983 (the surface area heuristic).
    Wald: On fast construction of SAH-based bounding volume hierarchies. IEEE RT 2007, doi:10.1109/RT.2007.4342588.
    """
    scale = 2.0 / mesh.diagonal if mesh.diagonal > 0.0 else 1.0
    order, n_short, n_faces = _order_along_curve(mesh)
    order, left_out = order[:n_faces], order[n_faces:]
    n_leaves = n_blocks(n_short, LEAF)
    n_leaves += n_blocks(len(order) - n_short, LEAF)
    n_runs = n_blocks(n_short, RUN_FACES) + n_blocks(len(order) - n_short, RUN_FACES)
    leaf_boxes = aligned(n_leaves * ROW)
    bvh = Bvh(
        centre=np.array(mesh.centre),
        scale=scale,
        contact=contact * scale,
        face_ids=np.empty((n_leaves, LEAF), dtype=np.int32),
        rows=np.empty(len(mesh.faces) + 1, dtype=np.int32),
        corners=aligned(n_leaves, 3, 3, LEAF),
        planes=np.empty((n_leaves, 4, LEAF), dtype=np.float32),
        used=np.empty(n_leaves, dtype=np.int64),
        weak=np.empty(n_leaves, dtype=np.int64),
        boxes=np.empty((0, LEAF), dtype=np.float32),
        children=np.empty(0, dtype=np.int32),
        n_children=np.empty(0, dtype=np.int32),
        depth=0,
        vertices=mesh.vertices,
        faces=mesh.faces,
        world_contact=contact,
    )
    bvh.rows[left_out] = bvh.rows[-1] = -1
    parallel_for(_fill_runs, n_blocks(n_runs, THREAD_RUNS), bvh, order, n_short, leaf_boxes, own=_new_scratch)
    boxes, children, n_children, depth = _grow(leaf_boxes)
    return bvh._replace(boxes=boxes, children=children, n_children=n_children, depth=depth)


@always_inline
def corners_of(bvh, face):
    """Corners of a face, world space."""
    a, b, c = bvh.faces[face, 0], bvh.faces[face, 1], bvh.faces[face, 2]
    return _vertex(bvh, a), _vertex(bvh, b), _vertex(bvh, c)


@always_inline
def _vertex(bvh, i):
    return bvh.vertices[i, 0], bvh.vertices[i, 1], bvh.vertices[i, 2]


@always_inline
def _corner(vertices, faces, i):
    """Corner i of all faces' one after the other."""
    at = 3 * np.int64(load_unchecked(faces, i))
    return load_unchecked(vertices, at), load_unchecked(vertices, at + 1), load_unchecked(vertices, at + 2)


def _order_along_curve(mesh: Mesh) -> tuple[IntArray, int, int]:
    """Return the faces along the curve: short, long, those that block nothing; how many are short, and can block."""
    n_faces = len(mesh.faces)
    index_bits = n_faces.bit_length()
    keys = np.empty(n_faces, dtype=np.uint64)
    measured = mesh.vertices, mesh.faces, mesh.bounds[0], mesh.longest_side, index_bits, keys
    parallel_for(_measure_faces, n_blocks(n_faces, THREAD), *measured, own=new_cells)
    keys.sort()
    kinds = np.array([LONG_FACE, NO_FACE], dtype=np.uint64) << np.uint64(index_bits + PLACE_BITS)
    n_short, n = np.searchsorted(keys, kinds)
    return indices_of(keys, index_bits), int(n_short), int(n)


@parallel_kernel
def _measure_faces(tasks, vertices, faces, low, side, index_bits, keys, cells):
    """Give each face the key that sorts it: what kind it is, its centre's place along the curve, its number."""
    scale = (2.0**CODE_BITS - 1.0) / side if side > 0.0 else 0.0
    first, last = take_block(tasks, len(faces), BLOCK)
    while first < last:
        for face in range(first, last):
            a = _corner(vertices, faces, 3 * face)
            b, c = _corner(vertices, faces, 3 * face + 1), _corner(vertices, faces, 3 * face + 2)
            extent = 0.0
            for axis in range(3):
                lower, upper = min(a[axis], b[axis], c[axis]), max(a[axis], b[axis], c[axis])
                extent = max(extent, upper - lower)
                cells[axis, face - first] = np.int64((0.5 * (lower + upper) - low[axis]) * scale)
            normal = cross(minus(b, a), minus(c, a))
            blocks = (normal[0] != 0.0) | (normal[1] != 0.0) | (normal[2] != 0.0) or not is_flat(a, b, c)
            keys[face] = np.int64(extent > LONG * side) if blocks else NO_FACE
        place_along_curve(cells, last - first, CODE_BITS)
        for face in range(first, last):
            key = np.int64(keys[face]) << PLACE_BITS | np.int64(cells[0, face - first])
            keys[face] = key << index_bits | face
        first, last = take_block(tasks, len(faces), BLOCK)


# Rows: a box in a vector of 16, so that boxes are joined by one minimum


@always_inline
def _put_row(rows, i, axis, lower, upper):
    """Write what row i has of an axis: the lower bound, the upper one negated; likewise their sum, twice the centre.

    The last four numbers of a row mean nothing.
    """
    at = ROW * i + axis
    rows[at], rows[at + UPPER] = lower, -upper
    rows[at + CENTRE], rows[at + CENTRE + UPPER] = lower + upper, -lower - upper


@device_function
def _half_area(rows, i):
    """Half the area of the box of a row."""
    lower, upper = load_scalar3(rows, ROW * i, 1), load_scalar3(rows, ROW * i + UPPER, 1)
    x, y, z = lower[0] + upper[0], lower[1] + upper[1], lower[2] + upper[2]  # each is minus a side
    return x * y + y * z + z * x


@device_function
def _cheapest(rows, row, sizes, n, areas):
    """Least cost of halving n rows, from one on, of such sizes, and after how many; the last row is scratch."""
    last = len(rows) // ROW - 1
    joined, behind = load(rows, ROW * (row + n - 1)), 0
    for i in range(n - 1, 0, -1):
        joined = minimum(joined, load(rows, ROW * (row + i)))
        store(rows, ROW * last, joined)
        store_unchecked(areas, i, _half_area(rows, last))
        behind += load_unchecked(sizes, i)
    joined, before = load(rows, ROW * row), 0
    least, middle = np.float32(np.inf), 1
    for i in range(1, n):
        joined = minimum(joined, load(rows, ROW * (row + i - 1)))
        store(rows, ROW * last, joined)
        before += load_unchecked(sizes, i - 1)
        cost = _half_area(rows, last) * np.float32(before) + load_unchecked(areas, i) * np.float32(behind)
        behind -= load_unchecked(sizes, i)
        if cost < least:
            least, middle = cost, i
    return least, middle


# Leaves


class Scratch(NamedTuple):
    """What a thread needs to halve a run."""

    corners: FloatArray  # (RUN_FACES, 3 corners, 3 axes) of its faces, scene space
    boxes: Float32  # rows (`_put_row`) of its faces
    orders: IntArray  # (3, RUN_FACES) its faces along each axis; at last the first row has those of each leaf
    spare: IntArray  # (RUN_FACES,)
    places: IntArray  # (RUN_FACES,) of its faces along an axis, or in the order that a segment is halved in
    counts: IntArray  # (PLACES + 1,) of faces at each place, or in each leaf
    leaves: IntArray  # (RUN_FACES,) of the faces, from the run's first on
    groups: Float32  # (3, RUN_FACES / 16) rows of 16 faces along each axis, and one more
    sizes: Int64  # (RUN_FACES / 16,) how many faces the groups have
    areas: Float32  # (RUN_FACES / 16,) of the groups from each on
    segments: Int64  # (RUN_FACES / 16 + 1, 3) those to be halved: first and last, and an axis with groups
    lanes: FloatArray  # (9, 16) the corners of a leaf's faces
    planes: Float32  # (14, 16) the same rounded, four numbers of the plane, and 1 for the weak


def _new_scratch() -> Scratch:
    n = RUN_FACES // LEAF
    return Scratch(
        corners=np.empty((RUN_FACES, 3, 3)),
        boxes=aligned(RUN_FACES * ROW),
        orders=np.empty((3, RUN_FACES), dtype=np.int32),
        spare=np.empty(RUN_FACES, dtype=np.int32),
        places=np.empty(RUN_FACES, dtype=np.int32),
        counts=np.empty(PLACES + 1, dtype=np.int32),
        leaves=np.empty(RUN_FACES, dtype=np.int32),
        groups=aligned((3 * n + 1) * ROW),
        sizes=np.empty(n, dtype=np.int64),
        areas=np.empty(n, dtype=np.float32),
        segments=np.empty((n + 1, 3), dtype=np.int64),
        lanes=np.empty(9 * LEAF),
        planes=aligned(14 * LEAF),
    )


@parallel_kernel
def _fill_runs(tasks, bvh, order, n_short, leaf_boxes, scratch):
    """Make leaves of runs of faces, the short ones first, and fill in what a BVH has of them."""
    bvh_at, scratch_at = reference(bvh), reference(scratch)
    n_runs, n_leaves = (n_short + RUN_FACES - 1) // RUN_FACES, (n_short + LEAF - 1) // LEAF
    while True:
        run = next_task(tasks)
        begin, end, leaf = 0, n_short, 0
        if run >= n_runs:
            run, begin, end, leaf = run - n_runs, n_short, len(order), n_leaves
        first = begin + RUN_FACES * run
        if first >= end:
            break
        faces, leaf = order[first : min(first + RUN_FACES, end)], leaf + RUN_FACES // LEAF * run
        _read_corners(bvh_at, faces, scratch_at)
        _halve_run(len(faces), scratch_at)
        _share_out(bvh_at, faces, leaf, scratch_at)
        for i in range((len(faces) + LEAF - 1) // LEAF):
            _fill_leaf(bvh_at, LEAF * i, min(LEAF, len(faces) - LEAF * i), leaf + i, leaf_boxes, scratch_at)


@device_function
def _read_corners(bvh, faces, scratch):
    """Fill in the corners of a run's faces, in scene space, and the rows of their boxes."""
    corners, x, y, z, scale = scratch.corners, bvh.centre[0], bvh.centre[1], bvh.centre[2], bvh.scale
    for i in range(len(faces)):  # apart from what follows, so that the processor waits for many vertices at a time
        for corner in range(3):
            p, at = (
                _corner(bvh.vertices, bvh.faces, 3 * np.int64(load_unchecked(faces, i)) + corner),
                9 * i + 3 * corner,
            )
            store_unchecked(corners, at, (p[0] - x) * scale)
            store_unchecked(corners, at + 1, (p[1] - y) * scale)
            store_unchecked(corners, at + 2, (p[2] - z) * scale)
    for i in range(len(faces)):
        for axis in range(3):
            at = 9 * i + axis
            a, b, c = load_unchecked(corners, at), load_unchecked(corners, at + 3), load_unchecked(corners, at + 6)
            _put_row(scratch.boxes, i, axis, np.float32(min(a, b, c)), np.float32(max(a, b, c)))


@device_function
def _halve_run(n, scratch):
    """Halve segments of the n faces of a run until they are leaves; ``scratch.leaves`` has the leaf of each face."""
    joined = load(scratch.boxes, 0)
    for i in range(1, n):
        joined = minimum(joined, load(scratch.boxes, ROW * i))
    store(scratch.groups, 0, joined)
    for axis in range(3):
        _sort_along(axis, n, scratch)
    for group in range(0, n, LEAF):
        scratch.sizes[group // LEAF] = min(LEAF, n - group)
    _join_groups(0, 0, n, scratch)
    segments, n_segments = scratch.segments, 1
    segments[0, 0], segments[0, 1], segments[0, 2] = 0, n, 0
    while n_segments > 0:
        n_segments -= 1
        first, last, axis = segments[n_segments, 0], segments[n_segments, 1], segments[n_segments, 2]
        if last - first <= LEAF:
            for i in range(first, last):
                scratch.leaves[scratch.orders[axis, i]] = first // LEAF
            continue
        middle, axis = _halve(first, last, axis, scratch)
        segments[n_segments, 0], segments[n_segments, 1], segments[n_segments, 2] = first, middle, axis
        segments[n_segments + 1, 0], segments[n_segments + 1, 1], segments[n_segments + 1, 2] = middle, last, axis
        n_segments += 2


@device_function
def _sort_along(axis, n, scratch):
    """Sort the n faces of a run by their centres along an axis, to `PLACES` steps; row 0 of groups joins all boxes."""
    boxes, places, counts = scratch.boxes, scratch.places, scratch.counts
    low, high = load_scalar(scratch.groups, CENTRE + axis), -load_scalar(scratch.groups, CENTRE + UPPER + axis)
    wide = high - low > ROUNDOFF * ROUNDOFF  # else the scale might be infinite
    scale = np.float32(PLACES * 0.9999) / (high - low) if wide else ZERO
    counts[:] = 0
    for i in range(n):
        place = np.int64((load_scalar(boxes, ROW * i + CENTRE + axis) - low) * scale)
        store_unchecked(places, i, place)
        store_unchecked(counts, place + 1, load_unchecked(counts, place + 1) + 1)
    for i in range(PLACES):
        counts[i + 1] += counts[i]
    for i in range(n):
        place = np.int64(load_unchecked(places, i))
        at = np.int64(load_unchecked(counts, place))
        store_unchecked(scratch.orders, RUN_FACES * axis + at, i)
        store_unchecked(counts, place, at + 1)


@device_function
def _halve(first, last, known, scratch):
    """Divide a segment at its cheapest: return where its second half begins, and along which axis.

    The axis given has the rows of its groups. Along the others the first half's faces are put first, unless both
    halves are leaves.
    """
    orders, least, axis, half = scratch.orders, np.inf, 0, 0
    n = (last - first + LEAF - 1) // LEAF
    for candidate in range(3):
        if candidate != known:
            _join_groups(candidate, first, last, scratch)
        row = (RUN_FACES * candidate + first) // LEAF
        cost, middle = _cheapest(scratch.groups, row, scratch.sizes[first // LEAF :], n, scratch.areas)
        if half == 0 or cost < least:
            least, axis, half = cost, candidate, middle
    half *= LEAF
    if max(half, last - first - half) > LEAF:
        for i in range(first, last):
            store_unchecked(scratch.places, np.int64(load_unchecked(orders, RUN_FACES * axis + i)), i)
        for other in range(3):
            if other != axis:
                _partition(orders[other, first:last], scratch.places, first + half, scratch.spare)
    return first + half, axis


@device_function
def _join_groups(axis, first, last, scratch):
    """Join the boxes of each 16 faces of a segment along an axis."""
    boxes, orders, base = scratch.boxes, scratch.orders, RUN_FACES * axis
    for group in range(base + first, base + last, LEAF):
        joined = load(boxes, ROW * np.int64(load_unchecked(orders, group)))
        for i in range(group + 1, min(group + LEAF, base + last)):
            joined = minimum(joined, load(boxes, ROW * np.int64(load_unchecked(orders, i))))
        store(scratch.groups, group // LEAF * ROW, joined)


@device_function
def _partition(order, places, end, spare):
    """Put what has a place before an end first, else keep the order; return how many these are."""
    n = 0
    for i in range(len(order)):  # without branches, which are hard to predict
        which = load_unchecked(order, i)
        store_unchecked(order, n, which)
        store_unchecked(spare, i - n, which)
        n += int(load_unchecked(places, np.int64(which)) < end)
    for i in range(n, len(order)):
        order[i] = spare[i - n]
    return n


@device_function
def _share_out(bvh, faces, leaf, scratch):
    """Give each leaf its faces in the order of the curve: points sorted by face then follow it too."""
    members, counts = scratch.orders, scratch.counts
    counts[: RUN_FACES // LEAF] = 0
    for i in range(len(faces)):
        mine = np.int64(load_unchecked(scratch.leaves, i))
        at = LEAF * mine + np.int64(load_unchecked(counts, mine))
        store_unchecked(counts, mine, load_unchecked(counts, mine) + 1)
        store_unchecked(members, at, i)
        store_unchecked(bvh.face_ids, LEAF * leaf + at, faces[i])
        store_unchecked(bvh.rows, np.int64(faces[i]), LEAF * leaf + at)
    for i in range(len(faces), (len(faces) + LEAF - 1) // LEAF * LEAF):
        store_unchecked(bvh.face_ids, LEAF * leaf + i, -1)


@device_function
def _fill_leaf(bvh, first, n, leaf, leaf_boxes, scratch):
    """Fill in what a BVH has of a leaf with n of a run's faces, from one on, and its box, rounded outwards."""
    members, lanes = scratch.orders, scratch.lanes
    joined = load(scratch.boxes, ROW * np.int64(load_unchecked(members, first)))
    for lane in range(LEAF):
        i = np.int64(load_unchecked(members, first + (lane if lane < n else 0)))  # what is not used has anything finite
        joined = minimum(joined, load(scratch.boxes, ROW * i))
        for k in range(9):
            store_unchecked(lanes, LEAF * k + lane, load_unchecked(scratch.corners, 9 * i + k))
    store(leaf_boxes, ROW * leaf, joined)
    outwards = np.float32(2.0) * ROUNDOFF
    for axis in range(3):
        lower, upper = leaf_boxes[ROW * leaf + axis], -leaf_boxes[ROW * leaf + UPPER + axis]
        _put_row(leaf_boxes, leaf, axis, lower - outwards, upper + outwards)
    _fill_planes(lanes, scratch.planes)
    for k in range(9):
        store(bvh.corners, LEAF * (9 * leaf + k), load(scratch.planes, LEAF * k))
    for k in range(4):
        store(bvh.planes, LEAF * (4 * leaf + k), load(scratch.planes, LEAF * (9 + k)))
    used = (np.int64(1) << n) - 1
    bvh.used[leaf], bvh.weak[leaf] = used, used & greater(load(scratch.planes, LEAF * 13), splat(ZERO))


@device_function
def _fill_planes(lanes, planes):
    """Of the corners of 16 faces: rounded, unit normals and offsets, and whether float64 cannot vouch for a normal."""
    for i in range(LEAF):  # a loop without branches, which the compiler turns into vectors
        a = load_unchecked(lanes, i), load_unchecked(lanes, LEAF + i), load_unchecked(lanes, 2 * LEAF + i)
        b = (
            load_unchecked(lanes, 3 * LEAF + i),
            load_unchecked(lanes, 4 * LEAF + i),
            load_unchecked(lanes, 5 * LEAF + i),
        )
        c = (
            load_unchecked(lanes, 6 * LEAF + i),
            load_unchecked(lanes, 7 * LEAF + i),
            load_unchecked(lanes, 8 * LEAF + i),
        )
        u, v, w = minus(b, a), minus(c, b), minus(a, c)
        normal = cross(u, minus(c, a))
        length = np.sqrt(dot(normal, normal))
        inverse = 1.0 / length if length > 0.0 else 0.0
        offset = 0.0
        for axis in range(3):
            store_unchecked(planes, LEAF * axis + i, a[axis])
            store_unchecked(planes, LEAF * (3 + axis) + i, b[axis])
            store_unchecked(planes, LEAF * (6 + axis) + i, c[axis])
            store_unchecked(planes, LEAF * (9 + axis) + i, normal[axis] * inverse)
            offset += normal[axis] * inverse * (a[axis] + b[axis] + c[axis])
        store_unchecked(planes, LEAF * 12 + i, offset / 3.0)
        store_unchecked(planes, LEAF * 13 + i, length <= WEAK_NORMAL * max(dot(u, u), dot(v, v), dot(w, w)))


# Nodes


def _grow(leaf_boxes: Float32) -> tuple[Float32, IntArray, IntArray, int]:
    """Return the fields of a `Bvh` that are about nodes, of the rows of its leaves."""
    n_leaves = len(leaf_boxes) // ROW
    room = max(n_leaves, 1)  # more nodes than leaves there cannot be
    boxes, children = np.zeros((room * 6, LEAF), dtype=np.float32), np.empty(room * LEAF, dtype=np.int32)
    n_children, leaves = np.empty(room, dtype=np.int32), np.arange(n_leaves, dtype=np.int32)
    spans, parts = np.empty((room, 3), dtype=np.int64), np.empty((LEAF, 2), dtype=np.int64)
    extents, bins = aligned(LEAF * ROW), aligned((2 * BINS + 1) * ROW)
    sizes, areas = np.empty(BINS, dtype=np.int64), np.empty(BINS, dtype=np.float32)
    (places, spare), numbers = np.empty((2, n_leaves), dtype=np.int32), np.arange(BINS, dtype=np.int32)
    scratch = parts, extents, bins, sizes, areas, places, spare, numbers
    n = _grow_nodes(leaf_boxes, leaves, spans, scratch, boxes, children, n_children)
    used = aligned(n * 6, LEAF)
    used[:] = boxes[: n * 6]
    return used, children[: n * LEAF].copy(), n_children[:n].copy(), int(spans[n - 1, 2])


@njit(nogil=True, cache=True)
def _grow_nodes(leaf_boxes, leaves, spans, scratch, boxes, children, n_children):
    """Divide leaves into nodes' children, node after node; return how many nodes.

    A node of at most 16 leaves has these as children. Else what has the largest box of its leaves is divided until
    there are 16 parts, or none has more than 16 leaves.
    """
    parts, extents = scratch[0], scratch[1]
    n_nodes, node = 1, 0
    spans[0, 0], spans[0, 1], spans[0, 2] = 0, len(leaves), 1
    while node < n_nodes:
        first, last, n = spans[node, 0], spans[node, 1], 0
        if last - first <= LEAF:
            for i in range(first, last):
                _put_part(leaf_boxes, leaves, i, i + 1, n, extents)
                parts[n, 0], parts[n, 1] = i, i + 1
                n += 1
        else:
            _put_part(leaf_boxes, leaves, first, last, n, extents)
            parts[n, 0], parts[n, 1] = first, last
            n += 1
            while n < LEAF:
                largest = _largest_part(parts, extents, n)
                if largest < 0:
                    break
                _divide(leaf_boxes, leaves, largest, n, scratch)
                n += 1
        n_children[node] = n
        for i in range(n):
            for axis in range(3):
                boxes[6 * node + axis, i] = extents[ROW * i + axis]
                boxes[6 * node + UPPER + axis, i] = -extents[ROW * i + UPPER + axis]
            if parts[i, 1] - parts[i, 0] == 1:
                children[LEAF * node + i] = ~leaves[parts[i, 0]]
            else:
                children[LEAF * node + i] = n_nodes
                spans[n_nodes, 0], spans[n_nodes, 1], spans[n_nodes, 2] = parts[i, 0], parts[i, 1], spans[node, 2] + 1
                n_nodes += 1
        node += 1
    return n_nodes


@device_function
def _put_part(rows, members, first, last, part, extents):
    """Note the box of a part: that which joins some of the members' rows."""
    joined = load(rows, ROW * np.int64(load_unchecked(members, first)))
    for i in range(first + 1, last):
        joined = minimum(joined, load(rows, ROW * np.int64(load_unchecked(members, i))))
    store(extents, ROW * part, joined)


@device_function
def _largest_part(parts, extents, n):
    """Of n parts with more than 16 leaves, the one with the largest box; -1 for none."""
    largest, most = -1, np.float32(-1.0)
    for i in range(n):
        area = _half_area(extents, i)
        if parts[i, 1] - parts[i, 0] > LEAF and area > most:
            largest, most = i, area
    return largest


@device_function
def _divide(leaf_boxes, leaves, part, other, scratch):
    """Divide a part where its widest axis is cheapest, in two that are not empty; the second becomes part `other`."""
    parts, extents, bins, sizes, areas, places, spare, numbers = scratch
    first, last = parts[part, 0], parts[part, 1]
    axis, width = 0, ZERO
    for each in range(3):
        at = ROW * part + CENTRE + each
        if -extents[at] - extents[at + UPPER] > width:
            axis, width = each, -extents[at] - extents[at + UPPER]
    low, scale = extents[ROW * part + CENTRE + axis], np.float32(BINS * 0.9999) / width if width > ZERO else ZERO
    sizes[:] = 0
    for i in range(2 * BINS):
        store(bins, ROW * i, splat(F32_MAX))
    for i in range(first, last):
        leaf = np.int64(load_unchecked(leaves, i))
        at = ROW * leaf
        place = np.int64((load_scalar(leaf_boxes, at + CENTRE + axis) - low) * scale)
        store_unchecked(places, leaf, place)
        sizes[place] += 1
        place += BINS * (i & 1)  # in turns, since neighbours often are at one place
        store(bins, ROW * place, minimum(load(bins, ROW * place), load(leaf_boxes, at)))
    for i in range(BINS):
        store(bins, ROW * i, minimum(load(bins, ROW * i), load(bins, ROW * (BINS + i))))
    n = _cheapest(bins, 0, sizes, BINS, areas)[1]
    middle = first + _partition(leaves[first:last], places, n, spare)
    if first < middle < last:
        _put_part(bins, numbers, 0, n, part, extents)
        _put_part(bins, numbers, n, BINS, other, extents)
    else:
        middle = (first + last) // 2
        _put_part(leaf_boxes, leaves, first, middle, part, extents)
        _put_part(leaf_boxes, leaves, middle, last, other, extents)
    parts[part, 1] = parts[other, 0] = middle
    parts[other, 1] = last
