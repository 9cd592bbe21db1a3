"""The bounding volume hierarchy: leaves of 16 faces that are near each other, and a tree of up to 16 children a node.

Scene space is world space moved and scaled so that the mesh fits into the unit sphere.
"""

from typing import NamedTuple

import numpy as np

from zbuf_occlude.arrays import FloatArray, IntArray
from zbuf_occlude.exact.layout import ENDLESS, LEAF, ROUNDOFF, UPPER, ZERO, Float32, Int64, aligned
from zbuf_occlude.geometry.hilbert import BLOCK, CODE_BITS, new_cells, place_along_curve, sorted_keys
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.jit.compiler import inlined, inner, njit
from zbuf_occlude.jit.pointer import reference
from zbuf_occlude.jit.simd import load, minimum, splat, store
from zbuf_occlude.jit.threads import n_blocks, shared, take, take_block, together
from zbuf_occlude.jit.vec3 import cross, dot, minus

WEAK_NORMAL = 1e-6
"""A face whose normal is shorter than this times its longest edge squared has no float32 plane: float64 decides it."""
LONG = 0.125
"""Faces longer than this fraction of the mesh's longest side are grouped among themselves."""
RUN_FACES = 512
"""Faces that are halved together, a multiple of `LEAF`."""
ROW, CENTRE = 16, 6
"""Numbers of a row (`_put_row`), and where those of the centre begin."""
DIGIT = 256
"""Faces of a run are sorted by two digits of this base."""
BINS = 16
"""Leaves are divided at one of this many places."""
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
    boxes: Float32  # (6 n, 16) of the children of n nodes, those of node i from row 6 i on; node 0 is the root
    children: IntArray  # (16 n,) their nodes, or ~leaf
    n_children: IntArray  # (n,) how many each node has, the first of its 16
    depth: int  # nodes on the longest way from the root to a leaf
    vertices: FloatArray  # (v, 3) world space
    faces: IntArray  # (f, 3)
    world_contact: float


def build_bvh(mesh: Mesh, contact: float) -> Bvh:
    """Prepare a mesh; `contact` is the contact tolerance in world units. O(f log f), about 80 bytes per face.

    Notes
    -----
    Faces whose normal is exactly zero are left out: by definition (`geometry.predicates.blocks`) they block nothing.
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
    order, n_short = _order_along_curve(mesh)
    n_leaves = n_blocks(n_short, LEAF)
    runs = [_runs_of(0, n_short, 0), _runs_of(n_short, len(order), n_leaves)]
    n_leaves += n_blocks(len(order) - n_short, LEAF)
    leaf_boxes = np.zeros(n_leaves * ROW, dtype=np.float32)
    bvh = Bvh(
        centre=np.array(mesh.centre),
        scale=scale,
        contact=contact * scale,
        face_ids=np.full((n_leaves, LEAF), -1, dtype=np.int32),
        rows=np.full(len(mesh.faces) + 1, -1, dtype=np.int32),
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
    both = np.concatenate(runs)
    together(_fill_runs, len(both), bvh, order, both, leaf_boxes, own=_new_scratch)
    boxes, children, n_children, depth = _grow(leaf_boxes)
    return bvh._replace(boxes=boxes, children=children, n_children=n_children, depth=depth)


@inlined
def corners_of(bvh, face):
    """Corners of a face, world space."""
    a, b, c = bvh.faces[face, 0], bvh.faces[face, 1], bvh.faces[face, 2]
    return _vertex(bvh, a), _vertex(bvh, b), _vertex(bvh, c)


@inlined
def _vertex(bvh, i):
    return bvh.vertices[i, 0], bvh.vertices[i, 1], bvh.vertices[i, 2]


def _order_along_curve(mesh: Mesh) -> tuple[IntArray, int]:
    """Return the faces that can block along the Hilbert curve, the long ones last, and how many are short."""
    n_faces = len(mesh.faces)
    index_bits = n_faces.bit_length()
    keys = np.empty(n_faces, dtype=np.uint64)
    measured = mesh.vertices, mesh.faces, mesh.bounds[0], mesh.longest_side, index_bits, keys
    together(_measure_faces, n_blocks(n_faces, BLOCK), *measured, own=new_cells)
    keys = sorted_keys(keys, index_bits, 64 - index_bits)
    n_short, n = np.searchsorted(keys, np.array([1 << 63, NEVER], dtype=np.uint64))
    return (keys[:n] & np.uint64((1 << index_bits) - 1)).astype(np.int32), int(n_short)


@shared
def _measure_faces(tasks, vertices, faces, low, side, index_bits, keys, cells):
    """Give each face the key that sorts it: long or not, its centre's place along the curve, its number."""
    scale = (2.0**CODE_BITS - 1.0) / side if side > 0.0 else 0.0
    first, last = take_block(tasks, len(faces), BLOCK)
    while first < last:
        for face in range(first, last):
            a, b, c = vertices[faces[face, 0]], vertices[faces[face, 1]], vertices[faces[face, 2]]
            extent = 0.0
            for axis in range(3):
                lower, upper = min(a[axis], b[axis], c[axis]), max(a[axis], b[axis], c[axis])
                extent = max(extent, upper - lower)
                cells[axis, face - first] = np.int64((0.5 * (lower + upper) - low[axis]) * scale)
            normal = cross(minus(b, a), minus(c, a))
            blocks = (normal[0] != 0.0) | (normal[1] != 0.0) | (normal[2] != 0.0)
            keys[face] = np.uint64(extent > LONG * side) << np.uint64(63) if blocks else NEVER
        place_along_curve(cells, last - first, CODE_BITS)
        for face in range(first, last):
            keys[face] |= (np.uint64(cells[0, face - first]) << np.uint64(index_bits)) | np.uint64(face)
        first, last = take_block(tasks, len(faces), BLOCK)


# Rows: a box in a vector of 16, so that boxes are joined by one minimum


@inlined
def _put_row(rows, i, axis, lower, upper):
    """Write what row i has of an axis: the lower bound, the upper one negated; likewise their sum, twice the centre."""
    at = ROW * i + axis
    rows[at], rows[at + UPPER] = lower, -upper
    rows[at + CENTRE], rows[at + CENTRE + UPPER] = lower + upper, -lower - upper


@inner
def _half_area(rows, i):
    """Half the area of the box of a row."""
    at = ROW * i
    x, y, z = -rows[at] - rows[at + 3], -rows[at + 1] - rows[at + 4], -rows[at + 2] - rows[at + 5]
    return x * y + y * z + z * x


@inner
def _cheapest(rows, sizes, n, areas):
    """Least cost of halving n rows of such sizes, and the row that the second half begins with; row n is scratch."""
    joined, behind = load(rows, ROW * (n - 1)), 0
    for i in range(n - 1, 0, -1):
        joined = minimum(joined, load(rows, ROW * i))
        store(rows, ROW * n, joined)
        areas[i] = _half_area(rows, n)
        behind += sizes[i]
    joined, before = load(rows, 0), 0
    least, middle = np.float32(np.inf), 0
    for i in range(1, n):
        joined = minimum(joined, load(rows, ROW * (i - 1)))
        store(rows, ROW * n, joined)
        before += sizes[i - 1]
        cost = _half_area(rows, n) * np.float32(before) + areas[i] * np.float32(behind)
        behind -= sizes[i]
        if middle == 0 or cost < least:
            least, middle = cost, i
    return least, middle


# Leaves


class Scratch(NamedTuple):
    """What a thread needs to halve a run."""

    boxes: Float32  # rows (`_put_row`) of its faces
    orders: IntArray  # (3, RUN_FACES) its faces along each axis
    spare: IntArray  # (RUN_FACES,)
    places: Int64  # (RUN_FACES,) of the faces along an axis, in two digits
    counts: Int64  # (DIGIT + 1,)
    first_half: Int64  # (RUN_FACES,) 1 for the faces of a segment's first half
    groups: Float32  # rows of 16 faces along an axis, and one more
    sizes: Int64  # (RUN_FACES / 16,) how many they are
    areas: Float32  # (RUN_FACES / 16,) of the groups from each on
    segments: Int64  # (RUN_FACES / 16 + 1, 2) those to be halved


def _new_scratch() -> Scratch:
    n = RUN_FACES // LEAF
    return Scratch(
        boxes=np.empty(RUN_FACES * ROW, dtype=np.float32),
        orders=np.empty((3, RUN_FACES), dtype=np.int32),
        spare=np.empty(RUN_FACES, dtype=np.int32),
        places=np.empty(RUN_FACES, dtype=np.int64),
        counts=np.empty(DIGIT + 1, dtype=np.int64),
        first_half=np.empty(RUN_FACES, dtype=np.int64),
        groups=np.empty((n + 1) * ROW, dtype=np.float32),
        sizes=np.empty(n, dtype=np.int64),
        areas=np.empty(n, dtype=np.float32),
        segments=np.empty((n + 1, 2), dtype=np.int64),
    )


def _runs_of(first: int, last: int, leaf: int) -> Int64:
    """Return where runs of faces from one to another begin and end, and the first leaf of each, (n, 3)."""
    firsts = np.arange(first, last, RUN_FACES)
    return np.stack([firsts, np.minimum(firsts + RUN_FACES, last), leaf + (firsts - first) // LEAF], axis=1)


@shared
def _fill_runs(tasks, bvh, order, runs, leaf_boxes, scratch):
    """Make leaves of each run of faces, and fill in what a BVH has of them."""
    bvh_at, scratch_at = reference(bvh), reference(scratch)
    run = take(tasks)
    while run < len(runs):
        first, last, leaf = runs[run, 0], runs[run, 1], runs[run, 2]
        _halve_run(bvh_at, order[first:last], scratch_at)
        _share_out(bvh_at, order[first:last], leaf, scratch_at)
        for i in range((last - first + LEAF - 1) // LEAF):
            _fill_leaf(bvh_at, leaf + i, leaf_boxes)
        run = take(tasks)


@inner
def _halve_run(bvh, faces, scratch):
    """Halve segments of a run until they are leaves: row 0 of ``scratch.orders`` has one after the other."""
    for i in range(len(faces)):
        a, b, c = corners_of(bvh, faces[i])
        a, b, c = _to_scene(bvh, a), _to_scene(bvh, b), _to_scene(bvh, c)
        for axis in range(3):
            _put_row(scratch.boxes, i, axis, min(a[axis], b[axis], c[axis]), max(a[axis], b[axis], c[axis]))
    for axis in range(3):
        _sort_along(axis, len(faces), scratch)
    segments, n_segments = scratch.segments, 1
    segments[0, 0], segments[0, 1] = 0, len(faces)
    while n_segments > 0:
        n_segments -= 1
        first, last = segments[n_segments, 0], segments[n_segments, 1]
        if last - first <= LEAF:
            continue
        middle = first + _halve(first, last, scratch)
        segments[n_segments, 0], segments[n_segments, 1] = first, middle
        segments[n_segments + 1, 0], segments[n_segments + 1, 1] = middle, last
        n_segments += 2


@inner
def _sort_along(axis, n, scratch):
    """Sort the n faces of a run by their centres along an axis, to 2^16 steps of it."""
    boxes, places, counts, order, spare = scratch.boxes, scratch.places, scratch.counts, scratch.orders, scratch.spare
    low, high = ENDLESS, -ENDLESS
    for i in range(n):
        centre = boxes[ROW * i + CENTRE + axis]
        low, high = min(low, centre), max(high, centre)
    scale = np.float32(DIGIT * DIGIT - 1) / (high - low) if high > low else ZERO
    for i in range(n):
        places[i] = min(np.int64((boxes[ROW * i + CENTRE + axis] - low) * scale), DIGIT * DIGIT - 1)
    for digit in range(2):
        counts[:] = 0
        for i in range(n):
            counts[((places[i] >> (8 * digit)) & (DIGIT - 1)) + 1] += 1
        for i in range(DIGIT):
            counts[i + 1] += counts[i]
        target = order[axis] if digit else spare
        for i in range(n):
            face = spare[i] if digit else i
            value = (places[face] >> (8 * digit)) & (DIGIT - 1)
            target[counts[value]] = face
            counts[value] += 1


@inner
def _share_out(bvh, faces, leaf, scratch):
    """Write the faces of each leaf as they were given, along the curve: points sorted by face then follow it too."""
    leaves, counts = scratch.spare, scratch.counts
    counts[: RUN_FACES // LEAF] = 0
    for i in range(len(faces)):
        leaves[scratch.orders[0, i]] = i // LEAF
    for i in range(len(faces)):
        mine = leaves[i]
        bvh.face_ids[leaf + mine, counts[mine]] = faces[i]
        counts[mine] += 1


@inner
def _fill_leaf(bvh, leaf, leaf_boxes):
    """Fill in what a BVH has of a leaf, the rows of its faces, and its box, rounded outwards."""
    used, weak, outwards = np.int64(0), np.int64(0), np.float32(2.0) * ROUNDOFF
    low, high = (np.inf, np.inf, np.inf), (-np.inf, -np.inf, -np.inf)
    for lane in range(LEAF):
        face = bvh.face_ids[leaf, lane]
        if face >= 0:
            used |= np.int64(1) << lane
            bvh.rows[face] = leaf * LEAF + lane
        else:
            face = bvh.face_ids[leaf, 0]  # anything finite
        a, b, c = corners_of(bvh, face)
        a, b, c = _to_scene(bvh, a), _to_scene(bvh, b), _to_scene(bvh, c)
        weak |= np.int64(_fill_face(bvh, leaf, lane, a, b, c)) << lane
        low = min(low[0], a[0], b[0], c[0]), min(low[1], a[1], b[1], c[1]), min(low[2], a[2], b[2], c[2])
        high = max(high[0], a[0], b[0], c[0]), max(high[1], a[1], b[1], c[1]), max(high[2], a[2], b[2], c[2])
    for axis in range(3):
        _put_row(leaf_boxes, leaf, axis, np.float32(low[axis]) - outwards, np.float32(high[axis]) + outwards)
    bvh.used[leaf], bvh.weak[leaf] = used, weak & used


@inner
def _fill_face(bvh, leaf, lane, a, b, c):
    """Fill in a face's corners, unit normal and offset; return whether float64 cannot vouch for the normal."""
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


@inner
def _halve(first, last, scratch):
    """Put the faces of a segment's better half first along each axis; return how many they are."""
    orders, least, axis, half = scratch.orders, np.inf, 0, 0
    for candidate in range(3):
        order = orders[candidate, first:last]
        cost, size = _cheapest_half(scratch.boxes, order, scratch)
        if half == 0 or cost < least:
            least, axis, half = cost, candidate, size
    for i in range(first, last):
        scratch.first_half[orders[axis, i]] = i < first + half
    for other in range(3):
        if other != axis:
            _partition(orders[other, first:last], scratch.first_half, scratch.spare)
    return half


@inner
def _cheapest_half(boxes, order, scratch):
    """Least cost of halving faces in an order after a multiple of 16, and after how many."""
    n, n_groups = len(order), (len(order) + LEAF - 1) // LEAF
    for group in range(n_groups):
        first, last = group * LEAF, min((group + 1) * LEAF, n)
        joined = load(boxes, ROW * order[first])
        for i in range(first + 1, last):
            joined = minimum(joined, load(boxes, ROW * order[i]))
        store(scratch.groups, ROW * group, joined)
        scratch.sizes[group] = last - first
    cost, middle = _cheapest(scratch.groups, scratch.sizes, n_groups, scratch.areas)
    return cost, middle * LEAF


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


# Nodes


def _grow(leaf_boxes: Float32) -> tuple[Float32, IntArray, IntArray, int]:
    """Return the fields of a `Bvh` that are about nodes, of the rows of its leaves."""
    n_leaves = len(leaf_boxes) // ROW
    room = max(n_leaves, 1)  # more nodes than leaves there cannot be
    boxes, children = np.zeros((room * 6, LEAF), dtype=np.float32), np.empty(room * LEAF, dtype=np.int32)
    n_children, leaves = np.empty(room, dtype=np.int32), np.arange(n_leaves, dtype=np.int32)
    spans, parts = np.empty((room, 3), dtype=np.int64), np.empty((LEAF, 2), dtype=np.int64)
    extents, bins = np.empty(LEAF * ROW, dtype=np.float32), np.empty((BINS + 1) * ROW, dtype=np.float32)
    sizes, areas = np.empty(BINS, dtype=np.int64), np.empty(BINS, dtype=np.float32)
    scratch = parts, extents, bins, sizes, areas
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
                _put_part(leaf_boxes, leaves, i, i + 1, n, parts, extents)
                n += 1
        else:
            _put_part(leaf_boxes, leaves, first, last, n, parts, extents)
            n += 1
            while n < LEAF:
                largest = _largest_part(parts, extents, n)
                if largest < 0:
                    break
                first, last = parts[largest, 0], parts[largest, 1]
                middle = _divide(leaf_boxes, leaves, first, last, largest, scratch)
                _put_part(leaf_boxes, leaves, first, middle, largest, parts, extents)
                _put_part(leaf_boxes, leaves, middle, last, n, parts, extents)
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


@inner
def _put_part(leaf_boxes, leaves, first, last, i, parts, extents):
    """Note part i: which leaves, and the row that joins theirs."""
    joined = load(leaf_boxes, ROW * leaves[first])
    for j in range(first + 1, last):
        joined = minimum(joined, load(leaf_boxes, ROW * leaves[j]))
    store(extents, ROW * i, joined)
    parts[i, 0], parts[i, 1] = first, last


@inner
def _largest_part(parts, extents, n):
    """Of n parts with more than 16 leaves, the one with the largest box; -1 for none."""
    largest, most = -1, np.float32(-1.0)
    for i in range(n):
        area = _half_area(extents, i)
        if parts[i, 1] - parts[i, 0] > LEAF and area > most:
            largest, most = i, area
    return largest


@inner
def _divide(leaf_boxes, leaves, first, last, part, scratch):
    """Divide a part where its widest axis is cheapest; return where the second half begins. Halves are not empty."""
    extents, bins, sizes, areas = scratch[1], scratch[2], scratch[3], scratch[4]
    axis, width = 0, np.float32(-1.0)
    for each in range(3):
        at = ROW * part + CENTRE + each
        if -extents[at] - extents[at + UPPER] > width:
            axis, width = each, -extents[at] - extents[at + UPPER]
    if not width > ZERO:
        return (first + last) // 2
    low, scale = extents[ROW * part + CENTRE + axis], np.float32(BINS * 0.9999) / width
    for i in range(BINS):
        sizes[i] = 0
        store(bins, ROW * i, splat(ENDLESS))
    for i in range(first, last):
        at = ROW * leaves[i]
        place = np.int64((leaf_boxes[at + CENTRE + axis] - low) * scale)
        sizes[place] += 1
        store(bins, ROW * place, minimum(load(bins, ROW * place), load(leaf_boxes, at)))
    middle = _cheapest(bins, sizes, BINS, areas)[1]
    i, j = first, last - 1
    while i <= j:
        leaf = leaves[i]
        if np.int64((leaf_boxes[ROW * leaf + CENTRE + axis] - low) * scale) < middle:
            i += 1
        else:
            leaves[i], leaves[j] = leaves[j], leaf
            j -= 1
    return i if first < i < last else (first + last) // 2
