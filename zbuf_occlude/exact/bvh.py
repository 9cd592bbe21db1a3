"""The bounding volume hierarchy: leaves of 16 faces that are near each other, and boxes around them in levels of 16.

Scene space is world space moved and scaled so that the mesh fits into the unit sphere.
"""

from typing import NamedTuple

import numpy as np

from zbuf_occlude.arrays import FloatArray, IntArray
from zbuf_occlude.exact.layout import LEAF, ROUNDOFF, UPPER, Float32, Int64
from zbuf_occlude.geometry.hilbert import BLOCK, CODE_BITS, new_cells, place_along_curve, sorted_keys
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.jit.compiler import inner, njit
from zbuf_occlude.jit.pointer import reference
from zbuf_occlude.jit.threads import n_blocks, shared, take, take_block, together
from zbuf_occlude.jit.vec3 import cross, dot, minus

TOP_NODES = 128
"""Levels of nodes are added until the top one has at most this many."""
WEAK_NORMAL = 1e-6
"""A face whose normal is shorter than this times its longest edge squared has no float32 plane: float64 decides it."""
LONG = 0.125
"""Faces longer than this fraction of the mesh's longest side are grouped among themselves."""
RUN_FACES = 512
"""Faces that are halved together, a multiple of `LEAF`."""
NEVER = np.uint64(2**64 - 1)
"""Key of a face that blocks nothing."""


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
    nodes: Float32  # (6, total) boxes, level after level, each level padded to a multiple of 16. Level 0 is the leaves;
    # node i of a level is the parent of nodes 16 i to 16 i + 15 of the level below
    level_starts: Int64  # (n_levels,)
    level_counts: Int64  # (n_levels,)
    world_corners: FloatArray  # (f, 3, 3) world space
    world_contact: float
    world_boxes: FloatArray  # (m, 6) of the leaves, world space


def build_bvh(mesh: Mesh, contact: float) -> Bvh:
    """Prepare a mesh; `contact` is the contact tolerance in world units. About 500 bytes per face."""
    scale = 2.0 / mesh.diagonal if mesh.diagonal > 0.0 else 1.0
    face_ids = make_leaves(mesh)
    m = len(face_ids)
    counts = [m]
    while counts[-1] > TOP_NODES:
        counts.append(-(-counts[-1] // LEAF))
    starts = np.cumsum([0, *(-(-count // LEAF) * LEAF for count in counts)])
    bvh = Bvh(
        centre=np.array(mesh.centre),
        scale=scale,
        contact=contact * scale,
        face_ids=face_ids,
        rows=np.full(len(mesh.faces) + 1, -1, dtype=np.int32),
        corners=np.empty((m, 3, 3, LEAF), dtype=np.float32),
        planes=np.empty((m, 4, LEAF), dtype=np.float32),
        used=np.empty(m, dtype=np.int64),
        weak=np.empty(m, dtype=np.int64),
        nodes=np.zeros((6, starts[-1]), dtype=np.float32),
        level_starts=starts[:-1].astype(np.int64),
        level_counts=np.asarray(counts, dtype=np.int64),
        world_corners=mesh.corners,
        world_contact=contact,
        world_boxes=np.empty((m, 6)),
    )
    together(_fill_leaves, m, bvh)
    _stack_levels(bvh)
    return bvh


@shared
def _fill_leaves(tasks, bvh):
    """Fill in what a BVH has of each leaf, and the rows of its faces."""
    bvh_at = reference(bvh)
    leaf = take(tasks)
    while leaf < len(bvh.face_ids):
        _fill_leaf(bvh_at, leaf)
        leaf = take(tasks)


@inner
def _fill_leaf(bvh, leaf):
    used, weak = np.int64(0), np.int64(0)
    for axis in range(3):
        bvh.world_boxes[leaf, axis], bvh.world_boxes[leaf, UPPER + axis] = np.inf, -np.inf
    for lane in range(LEAF):
        face = bvh.face_ids[leaf, lane]
        if face >= 0:
            used |= np.int64(1) << lane
            bvh.rows[face] = leaf * LEAF + lane
        else:
            face = bvh.face_ids[leaf, 0]  # anything finite
        a, b, c = bvh.world_corners[face, 0], bvh.world_corners[face, 1], bvh.world_corners[face, 2]
        weak |= np.int64(_fill_face(bvh, leaf, lane, a, b, c)) << lane
        for axis in range(3):
            lower, upper = bvh.world_boxes[leaf, axis], bvh.world_boxes[leaf, UPPER + axis]
            bvh.world_boxes[leaf, axis] = min(lower, a[axis], b[axis], c[axis])
            bvh.world_boxes[leaf, UPPER + axis] = max(upper, a[axis], b[axis], c[axis])
    bvh.used[leaf], bvh.weak[leaf] = used, weak & used


@inner
def _fill_face(bvh, leaf, lane, a, b, c):
    """Fill in a face's corners, unit normal and offset; return whether float64 cannot vouch for the normal."""
    a, b, c = _to_scene(bvh, a), _to_scene(bvh, b), _to_scene(bvh, c)
    u, v, w = minus(b, a), minus(c, b), minus(a, c)
    normal = cross(u, minus(c, a))
    length = np.sqrt(dot(normal, normal))
    inverse = 1.0 / length if length > 0.0 else 0.0
    offset = 0.0
    for axis in range(3):
        bvh.corners[leaf, 0, axis, lane] = a[axis]
        bvh.corners[leaf, 1, axis, lane] = b[axis]
        bvh.corners[leaf, 2, axis, lane] = c[axis]
        bvh.planes[leaf, axis, lane] = normal[axis] * inverse
        offset += normal[axis] * inverse * (a[axis] + b[axis] + c[axis])
    bvh.planes[leaf, 3, lane] = offset / 3.0
    return length <= WEAK_NORMAL * max(dot(u, u), dot(v, v), dot(w, w))


@inner
def _to_scene(bvh, p):
    return (
        (p[0] - bvh.centre[0]) * bvh.scale,
        (p[1] - bvh.centre[1]) * bvh.scale,
        (p[2] - bvh.centre[2]) * bvh.scale,
    )


@njit(nogil=True, cache=True)
def _stack_levels(bvh):
    """Fill in the boxes of all levels, rounded outwards; padding stays zero: it is projected, never reached."""
    outwards = np.float32(2.0) * ROUNDOFF
    for i in range(len(bvh.world_boxes)):
        for axis in range(3):
            lower = (bvh.world_boxes[i, axis] - bvh.centre[axis]) * bvh.scale
            upper = (bvh.world_boxes[i, UPPER + axis] - bvh.centre[axis]) * bvh.scale
            bvh.nodes[axis, i] = np.float32(lower) - outwards
            bvh.nodes[UPPER + axis, i] = np.float32(upper) + outwards
    for level in range(1, len(bvh.level_counts)):
        start, below = bvh.level_starts[level], bvh.level_starts[level - 1]
        for i in range(bvh.level_counts[level]):
            first = LEAF * i
            last = min(first + LEAF, bvh.level_counts[level - 1])
            for axis in range(3):
                lower, upper = bvh.nodes[axis, below + first], bvh.nodes[UPPER + axis, below + first]
                for child in range(below + first + 1, below + last):
                    lower = min(lower, bvh.nodes[axis, child])
                    upper = max(upper, bvh.nodes[UPPER + axis, child])
                bvh.nodes[axis, start + i], bvh.nodes[UPPER + axis, start + i] = lower, upper


class Scratch(NamedTuple):
    """What halving needs for n faces."""

    boxes: FloatArray  # (runs, 32, 6) of groups of 16 faces along an axis
    areas: FloatArray  # (runs, 32) of the groups from each on
    first_half: Int64  # (n,) 1 for the faces of a segment's first half
    order: IntArray  # (n,)
    segments: Int64  # (runs, 33, 2) those to be halved


def make_leaves(mesh: Mesh) -> IntArray:
    """Group the faces of a mesh.

    Returns
    -------
    (m, 16) int32
        Faces of each leaf; -1 where there is none. Faces whose normal is exactly zero are left out: by definition
        (`geometry.predicates.blocks`) they block nothing.

    Notes
    -----
    Long faces would enlarge the boxes of short ones, so they get leaves of their own. Runs of `RUN_FACES` faces along
    the Hilbert curve are halved by the surface area heuristic, down to leaves. (Runs of 16 faces of the curve itself
    have larger boxes: points meet 20 % more of them.) O(f log f) time, about 250 bytes per face.

    References
    ----------
    Goldsmith, Salmon: Automatic creation of object hierarchies for ray tracing. IEEE CG&A 7 (1987),
    doi:10.1109/MCG.1987.276983 (the surface area heuristic).
    """
    n_faces = len(mesh.faces)
    index_bits = n_faces.bit_length()
    boxes, keys = np.empty((n_faces, 6)), np.empty(n_faces, dtype=np.uint64)
    measured = mesh.corners, mesh.bounds[0], mesh.longest_side, index_bits, boxes, keys
    together(_measure_faces, n_blocks(n_faces, BLOCK), *measured, own=new_cells)
    keys = sorted_keys(keys, index_bits, 64 - index_bits)
    order = (keys & np.uint64((1 << index_bits) - 1)).astype(np.int32)
    n_short = int(np.searchsorted(keys, np.uint64(1 << 63)))
    short, long = order[:n_short], order[n_short : int(np.searchsorted(keys, NEVER))]
    n_long_rows = -(-len(long) // LEAF) * LEAF
    face_ids = np.full((-(-len(short) // LEAF) + n_long_rows // LEAF, LEAF), -1, dtype=np.int32)
    for faces, first in ((long, 0), (short, n_long_rows)):
        place = face_ids.reshape(-1)[first : first + len(faces)]
        place[:] = faces
        halve_runs(boxes, place)
    return face_ids


def halve_runs(boxes: FloatArray, faces: IntArray) -> None:
    """Order faces, those of each run apart, by leaves, only the last of which may be smaller than the others.

    The faces of a leaf stay as they were given, along the curve: points sorted by face then follow it too.
    """
    n, n_runs = len(faces), n_blocks(len(faces), RUN_FACES)
    near = boxes.take(faces, axis=0)  # side by side in memory
    keys = np.full((3, n_runs, RUN_FACES), NEVER)
    together(_place_along, n_runs, near, keys.reshape(3, -1))
    keys.sort()
    orders = keys.reshape(3, -1).astype(np.uint32).astype(np.int32)
    scratch = Scratch(
        boxes=np.empty((n_runs, RUN_FACES // LEAF, 6)),
        areas=np.empty((n_runs, RUN_FACES // LEAF)),
        first_half=np.empty(n, dtype=np.int64),
        order=np.empty(n, dtype=np.int32),
        segments=np.empty((n_runs, RUN_FACES // LEAF + 1, 2), dtype=np.int64),
    )
    together(_halve_runs, n_runs, near, orders, scratch)
    places, full = orders[0, :n], n // LEAF * LEAF
    places[:full].reshape(-1, LEAF).sort()
    places[full:].sort()
    faces[:] = faces.take(places)


@shared
def _measure_faces(tasks, corners, low, side, index_bits, boxes, keys, cells):
    """Box each face, and give it the key that sorts it: long or not, its centre's place along the curve, its number."""
    scale = (2.0**CODE_BITS - 1.0) / side if side > 0.0 else 0.0
    first, last = take_block(tasks, len(corners), BLOCK)
    while first < last:
        for face in range(first, last):
            a, b, c = corners[face, 0], corners[face, 1], corners[face, 2]
            extent = 0.0
            for axis in range(3):
                lower, upper = min(a[axis], b[axis], c[axis]), max(a[axis], b[axis], c[axis])
                boxes[face, axis], boxes[face, UPPER + axis] = lower, upper
                extent = max(extent, upper - lower)
                cells[axis, face - first] = np.int64((0.5 * (lower + upper) - low[axis]) * scale)
            normal = cross(minus(b, a), minus(c, a))
            blocks = (normal[0] != 0.0) | (normal[1] != 0.0) | (normal[2] != 0.0)
            keys[face] = np.uint64(extent > LONG * side) << np.uint64(63) if blocks else NEVER
        place_along_curve(cells, last - first)
        for face in range(first, last):
            keys[face] |= (np.uint64(cells[0, face - first]) << np.uint64(index_bits)) | np.uint64(face)
        first, last = take_block(tasks, len(corners), BLOCK)


@shared
def _place_along(tasks, boxes, keys):
    """Key each box by its centre's place along each axis, to 2^32 steps of its run, and by its number."""
    first, last = take_block(tasks, len(boxes), RUN_FACES)
    while first < last:
        for axis in range(3):
            low, high = np.inf, -np.inf
            for i in range(first, last):
                centre = 0.5 * boxes[i, axis] + 0.5 * boxes[i, UPPER + axis]
                low, high = min(low, centre), max(high, centre)
            scale = (2.0**32 - 1.0) / (high - low) if high > low else 0.0
            for i in range(first, last):
                place = (0.5 * boxes[i, axis] + 0.5 * boxes[i, UPPER + axis] - low) * scale
                keys[axis, i] = (np.uint64(place) << np.uint64(32)) | np.uint64(i)
        first, last = take_block(tasks, len(boxes), RUN_FACES)


@shared
def _halve_runs(tasks, boxes, orders, scratch):
    """Halve segments of each run until they are leaves; `orders` has each segment's faces along each axis."""
    begin, end = take_block(tasks, len(boxes), RUN_FACES)
    while begin < end:
        segments, n_segments = scratch.segments[begin // RUN_FACES], 1
        segments[0, 0], segments[0, 1] = begin, end
        while n_segments > 0:
            n_segments -= 1
            first, last = segments[n_segments, 0], segments[n_segments, 1]
            if last - first <= LEAF:
                continue
            middle = first + _halve(boxes, orders, first, last, begin // RUN_FACES, scratch)
            segments[n_segments, 0], segments[n_segments, 1] = first, middle
            segments[n_segments + 1, 0], segments[n_segments + 1, 1] = middle, last
            n_segments += 2
        begin, end = take_block(tasks, len(boxes), RUN_FACES)


@inner
def _halve(boxes, orders, first, last, run, scratch):
    """Put the faces of a segment's better half first along each axis; return how many they are."""
    least, axis, half = np.inf, 0, 0
    for candidate in range(3):
        cost, size = _cheapest_half(boxes, orders[candidate, first:last], scratch.boxes[run], scratch.areas[run])
        if half == 0 or cost < least:
            least, axis, half = cost, candidate, size
    for i in range(first, last):
        scratch.first_half[orders[axis, i]] = i < first + half
    for other in range(3):
        if other != axis:
            _partition(orders[other, first:last], scratch.first_half, scratch.order[first:last])
    return half


@inner
def _cheapest_half(boxes, order, groups, areas):
    """Least cost of halving faces in an order after a multiple of 16, and after how many; the last two are scratch."""
    n, n_groups = len(order), (len(order) + LEAF - 1) // LEAF
    for group in range(n_groups):
        low, high = (np.inf, np.inf, np.inf), (-np.inf, -np.inf, -np.inf)
        for i in range(group * LEAF, min((group + 1) * LEAF, n)):
            low, high = _joined(low, high, boxes, order[i])
        groups[group, 0], groups[group, 1], groups[group, 2] = low
        groups[group, 3], groups[group, 4], groups[group, 5] = high
    low, high = (np.inf, np.inf, np.inf), (-np.inf, -np.inf, -np.inf)
    for group in range(n_groups - 1, 0, -1):
        low, high = _joined(low, high, groups, group)
        areas[group] = _half_area(low, high)
    low, high = (np.inf, np.inf, np.inf), (-np.inf, -np.inf, -np.inf)
    least, half = np.inf, 0
    for group in range(n_groups - 1):
        low, high = _joined(low, high, groups, group)
        size = (group + 1) * LEAF
        cost = _half_area(low, high) * size + areas[group + 1] * (n - size)
        if half == 0 or cost < least:
            least, half = cost, size
    return least, half


@inner
def _joined(low, high, boxes, i):
    """Lower and upper corner of a box joined with box i."""
    return (
        (min(low[0], boxes[i, 0]), min(low[1], boxes[i, 1]), min(low[2], boxes[i, 2])),
        (max(high[0], boxes[i, 3]), max(high[1], boxes[i, 4]), max(high[2], boxes[i, 5])),
    )


@inner
def _half_area(low, high):
    x, y, z = high[0] - low[0], high[1] - low[1], high[2] - low[2]
    return x * y + y * z + z * x


@inner
def _partition(order, first_half, scratch):
    """Put the faces of the first half first, else keep their order."""
    n = 0
    for i in range(len(order)):  # without branches, which are hard to predict
        face = order[i]
        order[n] = scratch[i - n] = face
        n += first_half[face]
    for i in range(n, len(order)):
        order[i] = scratch[i - n]
