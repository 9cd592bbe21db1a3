"""Leaves of the BVH: at most 16 neighbouring faces each.

Runs of `RUN_FACES` faces along the Hilbert curve are halved by the surface area heuristic, at multiples of 16 faces, so
that leaves are full. Some leaves then join faces that are far apart. They are divided at their widest gap.

References
----------
Goldsmith, Salmon: Automatic creation of object hierarchies for ray tracing. IEEE CG&A 7 (1987),
doi:10.1109/MCG.1987.276983 (the surface area heuristic).
"""

from typing import NamedTuple

import numpy as np

from zbuf_occlude.base.arrays import FloatArray, IntArray
from zbuf_occlude.base.jit.compiler import always_inline, device_function
from zbuf_occlude.base.jit.pointer import pointer_to
from zbuf_occlude.base.jit.simd import (
    greater,
    load,
    load_scalar,
    load_unchecked,
    minimum,
    splat,
    store,
    store_unchecked,
)
from zbuf_occlude.base.jit.threads import n_blocks, next_task, parallel_for, parallel_kernel, take_block
from zbuf_occlude.base.jit.vec3 import cross, dot, minus
from zbuf_occlude.engines.exact.layout import (
    AREA_ERROR,
    FIRST_CORNER,
    FIRST_EDGE,
    LEAF,
    LEAST,
    MIN_ERROR,
    ROUNDOFF,
    SECOND_EDGE,
    TRIANGLE_ROWS,
    UPPER,
    VOLUME_ERROR,
    ZERO,
    Float32,
    Int64,
    aligned,
)
from zbuf_occlude.engines.exact.rows import (
    CENTRE,
    ROW,
    cheapest,
    half_area,
    joined_rows,
    partition,
    put_row,
    range_of_centres,
)
from zbuf_occlude.geometry.hilbert import BLOCK, CODE_BITS, THREAD, hilbert_codes, indices_of, new_cells, sort_keys
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.geometry.predicates import is_flat

WEAK_NORMAL = 1e-6
"""Shortest normal, as a share of the longest edge squared, of a face with a float32 plane; float64 decides others."""
LONG_FRACTION = 0.125
"""Length, as a share of the mesh's longest side, above which faces get leaves of their own."""
RUN_FACES = 512
"""Faces of a run, which one thread divides into leaves; a multiple of `LEAF`."""
PARTED_FACES = 8 * LEAF
"""Faces of a run for each leaf, besides two, that may be divided at a gap. Scattered faces have gaps everywhere, and
many small leaves make a search slower."""
RUN_LEAVES = RUN_FACES // LEAF + RUN_FACES // PARTED_FACES + 2
"""Maximum leaves of a run."""
THREAD_RUNS = 4
"""Minimum runs per extra thread; below this, waking it costs more."""
SORT_KEYS = 512
"""Number of sort keys along an axis of a run; faces of equal key keep the order of the curve."""
GAP_SHARE = np.float32(0.5)
"""Area of the boxes on both sides of a gap, as a share of the leaf's, below which the leaf is divided."""
CURVE_BITS = 3 * CODE_BITS
"""Bits of a Hilbert code."""
LONG_FACE, NO_FACE, KIND_BITS = 1, 2, 2
"""Kinds of faces in the highest bits of the sort key: long faces, and faces that block nothing; short faces are 0."""


class Leaves(NamedTuple):
    """Division of f faces into m leaves."""

    members: IntArray  # (f,) face ids, leaf by leaf, within a leaf in no particular order
    starts: Int64  # (m + 1,) first member of each leaf, and f
    rows: Float32  # (m,) rows (`rows.put_row`) around the faces of each leaf, scene space, rounded outwards
    left_out: IntArray  # face ids of faces that cannot block: their corners lie on one line


def divide_into_leaves(mesh: Mesh, scale: float) -> Leaves:
    """Divide the faces of a mesh into leaves; `scale` is scene units per world unit. O(f log f).

    Long faces would enlarge the boxes of short ones, so they get leaves of their own.
    """
    order, n_short, n_faces = _order_along_curve(mesh)
    order, left_out = order[:n_faces], order[n_faces:]
    n_runs = n_blocks(n_short, RUN_FACES) + n_blocks(n_faces - n_short, RUN_FACES)
    rows, sizes = aligned(n_runs * RUN_LEAVES * ROW), np.zeros(n_runs * RUN_LEAVES, dtype=np.int64)
    divided = mesh.vertices, mesh.faces, mesh.centre, scale, order, n_short, rows, sizes
    parallel_for(_divide_runs, n_blocks(n_runs, THREAD_RUNS), *divided, own=_new_scratch)
    there = np.flatnonzero(sizes)
    starts, chosen = np.zeros(len(there) + 1, dtype=np.int64), aligned(len(there) * ROW)
    np.cumsum(sizes[there], out=starts[1:])
    np.take(rows.reshape(-1, ROW), there, axis=0, out=chosen.reshape(-1, ROW))
    return Leaves(order, starts, chosen, left_out)


@always_inline
def _corner(vertices, faces, i):
    """Return corner i of the faces' corners in sequence: corner i % 3 of face i // 3."""
    at = 3 * np.int64(load_unchecked(faces, i))
    return load_unchecked(vertices, at), load_unchecked(vertices, at + 1), load_unchecked(vertices, at + 2)


# The order of the curve


def _order_along_curve(mesh: Mesh) -> tuple[IntArray, int, int]:
    """Return face ids along the curve (short, long, non-blocking), and the numbers of short and blocking faces."""
    n_faces = len(mesh.faces)
    index_bits = n_faces.bit_length()
    keys = np.empty(n_faces, dtype=np.uint64)
    measured = mesh.vertices, mesh.faces, mesh.bounds[0], mesh.longest_side, index_bits, keys
    parallel_for(_measure_faces, n_blocks(n_faces, THREAD), *measured, own=new_cells)
    keys = sort_keys(keys, index_bits, CURVE_BITS + KIND_BITS)
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


# Runs


class RunScratch(NamedTuple):
    """Working memory of a thread that divides runs into leaves."""

    boxes: Float32  # (RUN_FACES,) rows of the faces
    faces: IntArray  # (RUN_FACES,) ids of the run's faces
    orders: IntArray  # (3, RUN_FACES) the faces along each axis
    spare: IntArray  # (RUN_FACES,)
    keys: IntArray  # (RUN_FACES,) sort keys along an axis, or ranks in the order in which a segment is divided
    counts: IntArray  # (SORT_KEYS + 1,) faces of each key
    groups: Float32  # (3, RUN_FACES / 16) rows of 16 faces along each axis, and a spare one
    sizes: Int64  # (RUN_FACES / 16,) faces of each group
    areas: Float32  # (RUN_FACES / 16,) half the area of the box around each group and those after it
    segments: Int64  # (RUN_LEAVES, 3) stack of segments: first, end, and the axis whose groups are joined
    parts: Float32  # (3,) rows of a segment and of its two parts


def _new_scratch() -> RunScratch:
    n = RUN_FACES // LEAF
    return RunScratch(
        boxes=aligned(RUN_FACES * ROW),
        faces=np.empty(RUN_FACES, dtype=np.int32),
        orders=np.empty((3, RUN_FACES), dtype=np.int32),
        spare=np.empty(RUN_FACES, dtype=np.int32),
        keys=np.empty(RUN_FACES, dtype=np.int32),
        counts=np.empty(SORT_KEYS + 1, dtype=np.int32),
        groups=aligned((3 * n + 1) * ROW),
        sizes=np.empty(n, dtype=np.int64),
        areas=np.empty(n, dtype=np.float32),
        segments=np.empty((RUN_LEAVES, 3), dtype=np.int64),
        parts=aligned(3 * ROW),
    )


@parallel_kernel
def _divide_runs(tasks, vertices, faces, centre, scale, order, n_short, rows, sizes, scratch):
    """Divide runs of faces into leaves, short faces first: write their order, and rows and sizes of the leaves."""
    scratch_at = pointer_to(scratch)
    n_runs = (n_short + RUN_FACES - 1) // RUN_FACES
    while True:
        run = next_task(tasks)
        first, end = RUN_FACES * run, n_short
        if run >= n_runs:
            first, end = n_short + RUN_FACES * (run - n_runs), len(order)
        if first >= end:
            break
        members = order[first : min(first + RUN_FACES, end)]
        _read_boxes(vertices, faces, centre, scale, members, scratch_at)
        _divide_run(len(members), rows[run * RUN_LEAVES * ROW :], sizes[run * RUN_LEAVES :], scratch_at)
        for i in range(len(members)):
            members[i] = scratch.faces[scratch.orders[0, i]]


@device_function
def _read_boxes(vertices, faces, centre, scale, members, scratch):
    """Fill in the rows of the boxes of a run's faces, in scene space."""
    for i in range(len(members)):
        face = np.int64(load_unchecked(members, i))
        store_unchecked(scratch.faces, i, face)
        a, b = _corner(vertices, faces, 3 * face), _corner(vertices, faces, 3 * face + 1)
        c = _corner(vertices, faces, 3 * face + 2)
        for axis in range(3):
            lower = (min(a[axis], b[axis], c[axis]) - centre[axis]) * scale
            upper = (max(a[axis], b[axis], c[axis]) - centre[axis]) * scale
            put_row(scratch.boxes, i, axis, np.float32(lower), np.float32(upper))


@device_function
def _divide_run(n, rows, sizes, scratch):
    """Divide the n faces of a run into leaves: row 0 of the orders holds them leaf by leaf."""
    joined = load(scratch.boxes, 0)
    for i in range(1, n):
        joined = minimum(joined, load(scratch.boxes, ROW * i))
    store(scratch.groups, 0, joined)
    for axis in range(3):
        _sort_along(axis, n, scratch)
    for group in range(0, n, LEAF):
        scratch.sizes[group // LEAF] = min(LEAF, n - group)
    segments, n_segments, n_leaves, n_parted = scratch.segments, 1, 0, 0
    segments[0, 0], segments[0, 1], segments[0, 2] = 0, n, 0
    _join_groups(0, 0, n, scratch)
    while n_segments > 0:
        n_segments -= 1
        first, last, axis = segments[n_segments, 0], segments[n_segments, 1], segments[n_segments, 2]
        if last - first > LEAF:
            axis, middle = _halve(first, last, axis, scratch)
        elif n_parted < last // PARTED_FACES + 2:
            axis, middle = _part_at_gap(first, last, scratch)
            n_parted += middle < last
        else:
            middle = last
        if middle < last:
            _reorder(axis, first, middle, last, scratch)
            segments[n_segments, 0], segments[n_segments, 1], segments[n_segments, 2] = middle, last, axis
            segments[n_segments + 1, 0], segments[n_segments + 1, 1], segments[n_segments + 1, 2] = first, middle, axis
            n_segments += 2
        else:
            _put_leaf(first, last, rows, n_leaves, scratch)
            sizes[n_leaves] = last - first
            n_leaves += 1


@device_function
def _sort_along(axis, n, scratch):
    """Sort the n faces of a run by their centres along an axis; row 0 of groups is the box around all of them."""
    boxes, keys, counts = scratch.boxes, scratch.keys, scratch.counts
    low, width = range_of_centres(scratch.groups, 0, axis)
    wide = width > ROUNDOFF * ROUNDOFF  # else the scale might be infinite
    scale = np.float32(SORT_KEYS * 0.9999) / width if wide else ZERO
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
    """Return the axis along which halving a segment costs least, and the start of its second half.

    The groups along the axis `known` are joined already.
    """
    least, axis, half = np.inf, 0, 0
    n = (last - first + LEAF - 1) // LEAF
    for candidate in range(3):
        if candidate != known:
            _join_groups(candidate, first, last, scratch)
        row = (RUN_FACES * candidate + first) // LEAF
        cost, middle = cheapest(scratch.groups, row, scratch.sizes[first // LEAF :], n, scratch.areas)
        if half == 0 or cost < least:
            least, axis, half = cost, candidate, middle
    return axis, first + half * LEAF


@device_function
def _join_groups(axis, first, last, scratch):
    """Join the boxes of every 16 faces of a segment along an axis."""
    for group in range(first, last, LEAF):
        joined = joined_rows(scratch.boxes, scratch.orders[axis], group, min(group + LEAF, last))
        store(scratch.groups, (RUN_FACES * axis + group) // LEAF * ROW, joined)


@device_function
def _part_at_gap(first, last, scratch):
    """Return the axis of a leaf's widest gap, and the start of the part behind it; the leaf's end if it stays whole.

    Faces of equal sort key may hide a wider gap; areas decide whether the leaf is divided.
    """
    boxes, parts, orders = scratch.boxes, scratch.parts, scratch.orders
    axis, start, widest = 0, first, ZERO
    for candidate in range(3):
        order = orders[candidate, first:last]
        before = load_scalar(boxes, ROW * np.int64(load_unchecked(order, 0)) + CENTRE + candidate)
        for i in range(1, last - first):
            after = load_scalar(boxes, ROW * np.int64(load_unchecked(order, i)) + CENTRE + candidate)
            if after - before > widest:
                axis, start, widest = candidate, first + i, after - before
            before = after
    if start == first:  # all centres coincide
        return axis, last
    one = joined_rows(boxes, orders[axis], first, start)
    other = joined_rows(boxes, orders[axis], start, last)
    store(parts, 0, minimum(one, other))
    store(parts, ROW, one)
    store(parts, 2 * ROW, other)
    areas = scratch.areas
    for i in range(3):
        areas[i] = half_area(parts, i)
    return axis, start if areas[1] + areas[2] < GAP_SHARE * areas[0] else last


@device_function
def _reorder(axis, first, middle, last, scratch):
    """Move the faces of a segment's first part to the front of the order along each axis."""
    orders = scratch.orders
    for i in range(first, last):
        store_unchecked(scratch.keys, np.int64(load_unchecked(orders, RUN_FACES * axis + i)), i)
    for other in range(3):
        if other != axis:
            partition(orders[other, first:last], scratch.keys, middle, scratch.spare)


@device_function
def _put_leaf(first, last, rows, leaf, scratch):
    """Write the row of a leaf, rounded outwards."""
    store(scratch.parts, 0, joined_rows(scratch.boxes, scratch.orders[0], first, last))
    outwards = np.float32(2.0) * ROUNDOFF
    for axis in range(3):
        lower, upper = scratch.parts[axis], -scratch.parts[UPPER + axis]
        put_row(rows, leaf, axis, lower - outwards, upper + outwards)


# What a leaf holds


@device_function
def fill_leaf(bvh, leaves, leaf, scratch):
    """Fill in a hierarchy's arrays of one of its leaves."""
    first, last = leaves.starts[leaf], leaves.starts[leaf + 1]
    lanes, triangles = scratch.lanes, scratch.triangles
    x, y, z, scale = bvh.centre[0], bvh.centre[1], bvh.centre[2], bvh.scale
    for lane in range(LEAF):
        face = np.int64(load_unchecked(leaves.members, first + lane if first + lane < last else first))
        store_unchecked(bvh.face_ids, LEAF * leaf + lane, face)  # unused lanes repeat the first face
        for corner in range(3):
            p, at = _corner(bvh.vertices, bvh.faces, 3 * face + corner), 3 * LEAF * corner + lane
            store_unchecked(lanes, at, (p[0] - x) * scale)
            store_unchecked(lanes, at + LEAF, (p[1] - y) * scale)
            store_unchecked(lanes, at + 2 * LEAF, (p[2] - z) * scale)
    for i in range(first, last):
        store_unchecked(bvh.rows, np.int64(load_unchecked(leaves.members, i)), LEAF * leaf + i - first)
    for lane in range(last - first, LEAF):
        store_unchecked(bvh.face_ids, LEAF * leaf + lane, -1)
    _fill_triangles(lanes, triangles)
    for k in range(TRIANGLE_ROWS):
        store(bvh.triangles, LEAF * (TRIANGLE_ROWS * leaf + k), load(triangles, LEAF * k))
    for k in range(4):
        store(bvh.planes, LEAF * (4 * leaf + k), load(triangles, LEAF * (TRIANGLE_ROWS + k)))
    used = (np.int64(1) << (last - first)) - 1
    bvh.used[leaf], bvh.weak[leaf] = used, used & greater(load(triangles, LEAF * (TRIANGLE_ROWS + 4)), splat(ZERO))


class LeafScratch(NamedTuple):
    """Working memory of a thread that fills leaves."""

    lanes: FloatArray  # (9, 16) corners of a leaf's faces
    triangles: Float32  # (15, 16) the rows of `Bvh.triangles`, those of `Bvh.planes`, and 1 for a weak normal


def new_leaf_scratch() -> LeafScratch:
    """Allocate a thread's working memory for filling leaves."""
    return LeafScratch(lanes=np.empty(9 * LEAF), triangles=aligned((TRIANGLE_ROWS + 5) * LEAF))


@device_function
def _fill_triangles(lanes, triangles):
    """Write the triangles and planes of 16 faces, and 1 where the normal is too inaccurate to use."""
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
        u, v, w = minus(b, a), minus(c, a), minus(c, b)
        normal = cross(u, v)
        length = np.sqrt(dot(normal, normal))
        inverse = 1.0 / length if length > 0.0 else 0.0
        offset = 0.0
        for axis in range(3):
            store_unchecked(triangles, LEAF * (FIRST_CORNER + axis) + i, a[axis])
            store_unchecked(triangles, LEAF * (FIRST_EDGE + axis) + i, u[axis])
            store_unchecked(triangles, LEAF * (SECOND_EDGE + axis) + i, v[axis])
            store_unchecked(triangles, LEAF * (TRIANGLE_ROWS + axis) + i, normal[axis] * inverse)
            offset += normal[axis] * inverse * (a[axis] + b[axis] + c[axis])
        first, second = abs(u[0]) + abs(u[1]) + abs(u[2]), abs(v[0]) + abs(v[1]) + abs(v[2])
        least = -AREA_ERROR * (first + second) - VOLUME_ERROR * first * second - MIN_ERROR
        store_unchecked(triangles, LEAF * LEAST + i, least)
        store_unchecked(triangles, LEAF * (TRIANGLE_ROWS + 3) + i, offset / 3.0)
        weak = length <= WEAK_NORMAL * max(dot(u, u), dot(v, v), dot(w, w))
        store_unchecked(triangles, LEAF * (TRIANGLE_ROWS + 4) + i, weak)
