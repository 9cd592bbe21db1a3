"""Bounding volume hierarchy: leaves of 16 neighbouring faces, nodes of up to 16 children.

Scene space is world space moved and scaled so that the mesh fits into the unit sphere.
"""

from typing import NamedTuple

import numpy as np

from zbuf_occlude.base.arrays import FloatArray, IntArray, set_readonly
from zbuf_occlude.base.jit.compiler import always_inline, device_function, njit
from zbuf_occlude.base.jit.pointer import pointer_to
from zbuf_occlude.base.jit.simd import (
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
from zbuf_occlude.base.jit.threads import n_blocks, next_task, parallel_for, parallel_kernel, take_block
from zbuf_occlude.base.jit.vec3 import cross, dot, minus
from zbuf_occlude.base.precompiler import Compilation
from zbuf_occlude.engines.exact.layout import F32_MAX, LEAF, ROUNDOFF, UPPER, ZERO, Float32, Int64, aligned
from zbuf_occlude.geometry.hilbert import BLOCK, CODE_BITS, THREAD, hilbert_codes, indices_of, new_cells
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.geometry.predicates import is_flat

WEAK_NORMAL = 1e-6
"""Shortest normal, as a share of the longest edge squared, of a face with a float32 plane; float64 decides others."""
LONG_FRACTION = 0.125
"""Length, as a share of the mesh's longest side, above which faces get leaves of their own."""
RUN_FACES = 512
"""Faces of a run, which one thread divides into leaves; a multiple of `LEAF`."""
THREAD_RUNS = 4
"""Minimum runs per extra thread; below this, waking it costs more."""
ROW, CENTRE = 16, 6
"""Length of a row (`_put_row`), and the index of its first number of the centre."""
SORT_KEYS = 512
"""Number of sort keys along an axis of a run; faces of equal key keep the order of the curve."""
SAH_BINS = 16
"""Number of bins of the surface area heuristic that divides leaves among nodes."""
CURVE_BITS = 3 * CODE_BITS
"""Bits of a Hilbert code."""
LONG_FACE, NO_FACE = 1, 2
"""Kinds of faces in the highest bits of the sort key: long faces, and faces that block nothing; short faces are 0."""


class Bvh(NamedTuple):
    """Prepared mesh. A face's *row* is 16 x its leaf + its lane in the leaf."""

    centre: FloatArray  # (3,) world space
    scale: float  # scene units per world unit
    contact: float  # the contact tolerance, scene units
    face_ids: IntArray  # (m leaves, 16) faces of each leaf, -1 where there is none
    rows: IntArray  # (f + 1,) row of each face, -1 for one that cannot block; the last entry, -1, stands for no face
    corners: Float32  # (m, 3 corners, 3 axes, 16 faces) scene space
    planes: Float32  # (m, 4, 16) unit normal and offset of each face: n . p = offset on it
    used: Int64  # (m,) mask of the lanes of each leaf that hold a face
    weak: Int64  # (m,) mask of the faces of each leaf without a float32 plane (`WEAK_NORMAL`)
    boxes: Float32  # (6 n, 16) boxes of the children of n nodes; node i starts at row 6 i, node 0 is the root
    children: IntArray  # (16 n,) node of each child, or ~leaf
    n_children: IntArray  # (n,) number of children of each node, which fill the first of its 16 lanes
    depth: int  # nodes on the longest path from the root to a leaf
    vertices: FloatArray  # (v, 3) world space
    faces: IntArray  # (f, 3)
    world_contact: float


def build_bvh(mesh: Mesh, contact: float) -> Bvh:
    """Build the hierarchy of a mesh; `contact` is the contact tolerance in world units.

    Notes
    -----
    O(f log f), about 70 bytes per face.

    Faces whose corners lie on one line are left out: by definition (`geometry.predicates.blocks`) they block nothing.
    Long faces would enlarge the boxes of short ones, so they get leaves of their own. Runs of `RUN_FACES` faces along
    the Hilbert curve are halved by the surface area heuristic, down to leaves. (Leaves of 16 consecutive faces of the
    curve have larger boxes: points meet 20 % more of them.) The same heuristic divides leaves among nodes.

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
    bvh = new_bvh(mesh.vertices, mesh.faces, mesh.centre, scale, contact, n_leaves)
    bvh.rows[left_out] = bvh.rows[-1] = -1
    parallel_for(_fill_runs, n_blocks(n_runs, THREAD_RUNS), bvh, order, n_short, leaf_boxes, own=_new_scratch)
    boxes, children, n_children, depth = _grow(leaf_boxes)
    return bvh._replace(boxes=boxes, children=children, n_children=n_children, depth=depth)


def new_bvh(
    vertices: FloatArray, faces: IntArray, centre: FloatArray, scale: float, contact: float, n_leaves: int
) -> Bvh:
    """Allocate the hierarchy of a mesh, without nodes."""
    return Bvh(
        centre=np.array(centre),
        scale=scale,
        contact=contact * scale,
        face_ids=np.empty((n_leaves, LEAF), dtype=np.int32),
        rows=np.empty(len(faces) + 1, dtype=np.int32),
        corners=aligned(n_leaves, 3, 3, LEAF),
        planes=np.empty((n_leaves, 4, LEAF), dtype=np.float32),
        used=np.empty(n_leaves, dtype=np.int64),
        weak=np.empty(n_leaves, dtype=np.int64),
        boxes=np.empty((0, LEAF), dtype=np.float32),
        children=np.empty(0, dtype=np.int32),
        n_children=np.empty(0, dtype=np.int32),
        depth=0,
        vertices=vertices,
        faces=faces,
        world_contact=contact,
    )


def empty_bvh() -> Bvh:
    """Return the hierarchy of a mesh without faces, whose arrays have the types of any other's."""
    no_vertices, no_faces = set_readonly(np.empty((0, 3))), set_readonly(np.empty((0, 3), dtype=np.int32))
    return new_bvh(no_vertices, no_faces, np.zeros(3), 1.0, 0.0, 0)


def compile_build() -> None:
    """Compile what builds a hierarchy, the last first: nodes of one leaf, and no runs."""
    _grow(aligned(ROW))
    nothing = np.empty(0, dtype=np.int32)
    parallel_for(_fill_runs, 0, empty_bvh(), nothing, 0, aligned(ROW), own=_new_scratch)


@always_inline
def corners_of(bvh, face):
    """Return the corners of a face, world space."""
    a, b, c = bvh.faces[face, 0], bvh.faces[face, 1], bvh.faces[face, 2]
    return _vertex(bvh, a), _vertex(bvh, b), _vertex(bvh, c)


@always_inline
def _vertex(bvh, i):
    return bvh.vertices[i, 0], bvh.vertices[i, 1], bvh.vertices[i, 2]


@always_inline
def _corner(vertices, faces, i):
    """Return corner i of the faces' corners in sequence: corner i % 3 of face i // 3."""
    at = 3 * np.int64(load_unchecked(faces, i))
    return load_unchecked(vertices, at), load_unchecked(vertices, at + 1), load_unchecked(vertices, at + 2)


def _order_along_curve(mesh: Mesh) -> tuple[IntArray, int, int]:
    """Return face ids along the curve (short, long, non-blocking), and the numbers of short and blocking faces."""
    n_faces = len(mesh.faces)
    index_bits = n_faces.bit_length()
    keys = np.empty(n_faces, dtype=np.uint64)
    measured = mesh.vertices, mesh.faces, mesh.bounds[0], mesh.longest_side, index_bits, keys
    parallel_for(_measure_faces, n_blocks(n_faces, THREAD), *measured, own=new_cells)
    keys.sort()
    kinds = np.array([LONG_FACE, NO_FACE], dtype=np.uint64) << np.uint64(index_bits + CURVE_BITS)
    n_short, n = np.searchsorted(keys, kinds)
    return indices_of(keys, index_bits), int(n_short), int(n)


@parallel_kernel
def _measure_faces(tasks, vertices, faces, low, side, index_bits, keys, cells):
    """Write the sort key of each face: its kind, the Hilbert code of its centre, its id."""
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
            keys[face] = np.int64(extent > LONG_FRACTION * side) if blocks else NO_FACE
        hilbert_codes(cells, last - first, CODE_BITS)
        for face in range(first, last):
            key = np.int64(keys[face]) << CURVE_BITS | np.int64(cells[0, face - first])
            keys[face] = key << index_bits | face
        first, last = take_block(tasks, len(faces), BLOCK)


# Rows: a box is a vector of 16 numbers, so that one minimum joins two boxes


@always_inline
def _put_row(rows, i, axis, lower, upper):
    """Write row i along an axis: the lower and the negated upper bound; then their sum, twice the centre, and minus it.

    The last four numbers of a row are unused.
    """
    at = ROW * i + axis
    rows[at], rows[at + UPPER] = lower, -upper
    rows[at + CENTRE], rows[at + CENTRE + UPPER] = lower + upper, -lower - upper


@device_function
def _half_area(rows, i):
    """Return half the area of the box of a row."""
    lower, upper = load_scalar3(rows, ROW * i, 1), load_scalar3(rows, ROW * i + UPPER, 1)
    x, y, z = lower[0] + upper[0], lower[1] + upper[1], lower[2] + upper[2]  # negated sides
    return x * y + y * z + z * x


@device_function
def _cheapest(rows, row, sizes, n, areas):
    """Return the least cost of dividing n rows in two, and the number of rows in the first part.

    The rows start at `row` and hold `sizes` leaves or faces each; the last of `rows` is scratch.
    """
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
    """Working memory of a thread that divides a run into leaves."""

    corners: FloatArray  # (RUN_FACES, 3 corners, 3 axes) corners of the faces, scene space
    boxes: Float32  # (RUN_FACES,) rows (`_put_row`) of the faces
    orders: IntArray  # (3, RUN_FACES) the faces along each axis; finally row 0 holds the faces leaf by leaf
    spare: IntArray  # (RUN_FACES,)
    keys: IntArray  # (RUN_FACES,) sort keys along an axis, or ranks in the order in which a segment is halved
    counts: IntArray  # (SORT_KEYS + 1,) faces of each key, or of each leaf
    leaves: IntArray  # (RUN_FACES,) leaf of each face, counted from the run's first leaf
    groups: Float32  # (3, RUN_FACES / 16) rows of 16 faces along each axis, and a spare one
    sizes: Int64  # (RUN_FACES / 16,) faces of each group
    areas: Float32  # (RUN_FACES / 16,) half the area of the box around each group and those after it
    segments: Int64  # (RUN_FACES / 16 + 1, 3) stack of segments: first, end, and the axis whose groups are joined
    lanes: FloatArray  # (9, 16) corners of a leaf's faces
    planes: Float32  # (14, 16) the corners rounded, normal and offset of the plane, and 1 for a weak normal


def _new_scratch() -> Scratch:
    n = RUN_FACES // LEAF
    return Scratch(
        corners=np.empty((RUN_FACES, 3, 3)),
        boxes=aligned(RUN_FACES * ROW),
        orders=np.empty((3, RUN_FACES), dtype=np.int32),
        spare=np.empty(RUN_FACES, dtype=np.int32),
        keys=np.empty(RUN_FACES, dtype=np.int32),
        counts=np.empty(SORT_KEYS + 1, dtype=np.int32),
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
    """Divide runs of faces into leaves, short faces first, and fill in the hierarchy's arrays of leaves."""
    bvh_at, scratch_at = pointer_to(bvh), pointer_to(scratch)
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
    for i in range(len(faces)):  # a loop of its own, so that many vertices are fetched at a time
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
    """Halve segments of the n faces of a run down to leaves; write the leaf of each face to ``scratch.leaves``."""
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
    """Sort the n faces of a run by their centres along an axis; row 0 of groups is the box around all of them."""
    boxes, keys, counts = scratch.boxes, scratch.keys, scratch.counts
    low, high = load_scalar(scratch.groups, CENTRE + axis), -load_scalar(scratch.groups, CENTRE + UPPER + axis)
    wide = high - low > ROUNDOFF * ROUNDOFF  # else the scale might be infinite
    scale = np.float32(SORT_KEYS * 0.9999) / (high - low) if wide else ZERO
    counts[:] = 0
    for i in range(n):
        key = np.int64((load_scalar(boxes, ROW * i + CENTRE + axis) - low) * scale)
        store_unchecked(keys, i, key)
        store_unchecked(counts, key + 1, load_unchecked(counts, key + 1) + 1)
    for i in range(SORT_KEYS):
        counts[i + 1] += counts[i]
    for i in range(n):
        key = np.int64(load_unchecked(keys, i))
        at = np.int64(load_unchecked(counts, key))
        store_unchecked(scratch.orders, RUN_FACES * axis + at, i)
        store_unchecked(counts, key, at + 1)


@device_function
def _halve(first, last, known, scratch):
    """Divide a segment where the cost is least; return the start of its second half, and the axis.

    The groups along the axis `known` are joined already. Along the other axes the faces of the first half are moved to
    the front, unless both halves are leaves.
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
            store_unchecked(scratch.keys, np.int64(load_unchecked(orders, RUN_FACES * axis + i)), i)
        for other in range(3):
            if other != axis:
                _partition(orders[other, first:last], scratch.keys, first + half, scratch.spare)
    return first + half, axis


@device_function
def _join_groups(axis, first, last, scratch):
    """Join the boxes of every 16 faces of a segment along an axis."""
    boxes, orders, base = scratch.boxes, scratch.orders, RUN_FACES * axis
    for group in range(base + first, base + last, LEAF):
        joined = load(boxes, ROW * np.int64(load_unchecked(orders, group)))
        for i in range(group + 1, min(group + LEAF, base + last)):
            joined = minimum(joined, load(boxes, ROW * np.int64(load_unchecked(orders, i))))
        store(scratch.groups, group // LEAF * ROW, joined)


@device_function
def _partition(order, keys, end, spare):
    """Move entries with a key below `end` to the front, else keep the order; return their number."""
    n = 0
    for i in range(len(order)):  # without branches, which would be hard to predict
        which = load_unchecked(order, i)
        store_unchecked(order, n, which)
        store_unchecked(spare, i - n, which)
        n += int(load_unchecked(keys, np.int64(which)) < end)
    for i in range(n, len(order)):
        order[i] = spare[i - n]
    return n


@device_function
def _share_out(bvh, faces, leaf, scratch):
    """Write the faces of each leaf in the order of the curve, so that points sorted by face follow the curve too."""
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
    """Fill in the hierarchy's arrays of a leaf of n faces of a run, and its box, rounded outwards."""
    members, lanes = scratch.orders, scratch.lanes
    joined = load(scratch.boxes, ROW * np.int64(load_unchecked(members, first)))
    for lane in range(LEAF):
        i = np.int64(load_unchecked(members, first + (lane if lane < n else 0)))  # unused lanes repeat the first face
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
    """Write the rounded corners of 16 faces, their planes, and 1 where the normal is too inaccurate to use."""
    for i in range(LEAF):  # without branches, so that the compiler vectorises it
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
    """Return boxes, children, n_children and depth of a `Bvh` from the rows of its leaves."""
    n_leaves = len(leaf_boxes) // ROW
    room = max(n_leaves, 1)  # there are at most as many nodes as leaves
    boxes, children = np.zeros((room * 6, LEAF), dtype=np.float32), np.empty(room * LEAF, dtype=np.int32)
    n_children, leaves = np.empty(room, dtype=np.int32), np.arange(n_leaves, dtype=np.int32)
    spans, parts = np.empty((room, 3), dtype=np.int64), np.empty((LEAF, 2), dtype=np.int64)
    extents, bins = aligned(LEAF * ROW), aligned((2 * SAH_BINS + 1) * ROW)
    sizes, areas = np.empty(SAH_BINS, dtype=np.int64), np.empty(SAH_BINS, dtype=np.float32)
    (keys, spare), numbers = np.empty((2, n_leaves), dtype=np.int32), np.arange(SAH_BINS, dtype=np.int32)
    scratch = parts, extents, bins, sizes, areas, keys, spare, numbers
    n = _grow_nodes(leaf_boxes, leaves, spans, scratch, boxes, children, n_children)
    used = aligned(n * 6, LEAF)
    used[:] = boxes[: n * 6]
    return used, children[: n * LEAF].copy(), n_children[:n].copy(), int(spans[n - 1, 2])


@njit(nogil=True, cache=True)
def _grow_nodes(leaf_boxes, leaves, spans, scratch, boxes, children, n_children):
    """Divide the leaves among nodes, node after node; return the number of nodes.

    The children of a node of at most 16 leaves are its leaves. Any other node's leaves are divided into parts: the part
    with the largest box is halved until there are 16 parts, or none has more than 16 leaves.
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
    """Write the box of a part: the join of the rows of members first to last - 1."""
    joined = load(rows, ROW * np.int64(load_unchecked(members, first)))
    for i in range(first + 1, last):
        joined = minimum(joined, load(rows, ROW * np.int64(load_unchecked(members, i))))
    store(extents, ROW * part, joined)


@device_function
def _largest_part(parts, extents, n):
    """Return the part with the largest box among those of more than 16 leaves; -1 for none."""
    largest, most = -1, np.float32(-1.0)
    for i in range(n):
        area = _half_area(extents, i)
        if parts[i, 1] - parts[i, 0] > LEAF and area > most:
            largest, most = i, area
    return largest


@device_function
def _divide(leaf_boxes, leaves, part, other, scratch):
    """Halve a part along its widest axis where the cost is least; neither half is empty, the second is part `other`."""
    parts, extents, bins, sizes, areas, keys, spare, numbers = scratch
    first, last = parts[part, 0], parts[part, 1]
    axis, width = 0, ZERO
    for each in range(3):
        at = ROW * part + CENTRE + each
        if -extents[at] - extents[at + UPPER] > width:
            axis, width = each, -extents[at] - extents[at + UPPER]
    low, scale = extents[ROW * part + CENTRE + axis], np.float32(SAH_BINS * 0.9999) / width if width > ZERO else ZERO
    sizes[:] = 0
    for i in range(2 * SAH_BINS):
        store(bins, ROW * i, splat(F32_MAX))
    for i in range(first, last):
        leaf = np.int64(load_unchecked(leaves, i))
        at = ROW * leaf
        key = np.int64((load_scalar(leaf_boxes, at + CENTRE + axis) - low) * scale)
        store_unchecked(keys, leaf, key)
        sizes[key] += 1
        key += SAH_BINS * (i & 1)  # two sets of bins in turn, since neighbours often share a bin
        store(bins, ROW * key, minimum(load(bins, ROW * key), load(leaf_boxes, at)))
    for i in range(SAH_BINS):
        store(bins, ROW * i, minimum(load(bins, ROW * i), load(bins, ROW * (SAH_BINS + i))))
    n = _cheapest(bins, 0, sizes, SAH_BINS, areas)[1]
    middle = first + _partition(leaves[first:last], keys, n, spare)
    if first < middle < last:
        _put_part(bins, numbers, 0, n, part, extents)
        _put_part(bins, numbers, n, SAH_BINS, other, extents)
    else:
        middle = (first + last) // 2
        _put_part(leaf_boxes, leaves, first, middle, part, extents)
        _put_part(leaf_boxes, leaves, middle, last, other, extents)
    parts[part, 1] = parts[other, 0] = middle
    parts[other, 1] = last


BUILDING = Compilation(_fill_runs, compile_build)
