"""Clusters: up to 16 faces that are near each other."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.arrays import FloatArray, IntArray
from zbuf_occlude.exact.layout import CLUSTER, UPPER
from zbuf_occlude.geometry.hilbert import BLOCK, CODE_BITS, new_cells, place_along_curve, sorted_keys
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.jit.compiler import inner
from zbuf_occlude.jit.pool import n_blocks, shared, take_block, together

LONG = 0.125
"""Faces longer than this fraction of the mesh's longest side are grouped among themselves."""

RUN_FACES = 512
"""Faces that are halved together, a multiple of `CLUSTER`."""

NEVER = np.uint64(2**64 - 1)
"""Key of a face that blocks nothing."""


class Scratch(NamedTuple):
    """What halving needs for n faces."""

    boxes: FloatArray  # (runs, 32, 6) of groups of 16 faces along an axis
    areas: FloatArray  # (runs, 32) of the groups from each on
    first_half: NDArray[np.int64]  # (n,) 1 for the faces of a segment's first half
    order: IntArray  # (n,)
    segments: NDArray[np.int64]  # (runs, 33, 2) those to be halved


def make_clusters(mesh: Mesh) -> IntArray:
    """Group the faces of a mesh, long ones apart.

    Returns
    -------
    (m, 16) int32
        Faces of each cluster; -1 where there is none. Faces whose normal is exactly zero are left out: by definition
        (`zbuf_occlude.geometry.predicates.blocks`) they block nothing.

    Notes
    -----
    A long face among short ones would blow up the box of its cluster; in a cluster of its kind it does no harm.

    Runs of `RUN_FACES` faces along the Hilbert curve are halved where the boxes of the halves, weighed by their
    numbers of faces, have the least area, down to clusters. Runs of 16 faces of the curve itself, the simpler way, have
    larger boxes: points then meet a fifth more of them.

    O(f log f) time, about 250 bytes per face.

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
    n_blocking = int(np.searchsorted(keys, NEVER))
    short, long = order[:n_short], order[n_short:n_blocking]
    n_clusters = -(-len(short) // CLUSTER) - (-len(long) // CLUSTER)
    face_ids = np.full((n_clusters, CLUSTER), -1, dtype=np.int32)
    flat, n_long_rows = face_ids.reshape(-1), -(-len(long) // CLUSTER) * CLUSTER
    flat[: len(long)], flat[n_long_rows : n_long_rows + len(short)] = long, short
    for faces in (flat[: len(long)], flat[n_long_rows : n_long_rows + len(short)]):
        halve_runs(boxes, faces)
    return face_ids


def halve_runs(boxes: FloatArray, faces: IntArray) -> None:
    """Order faces, those of each run apart, by clusters, only the last of which may be smaller than the others.

    The faces of a cluster stay as they were given, along the curve: points sorted by face then follow it too.
    """
    n, n_runs = len(faces), n_blocks(len(faces), RUN_FACES)
    near = boxes.take(faces, axis=0)  # side by side in memory
    keys = np.full((3, n_runs, RUN_FACES), NEVER)
    together(_place_along, n_runs, near, keys.reshape(3, -1))
    keys.sort()
    orders = keys.reshape(3, -1).astype(np.uint32).astype(np.int32)
    scratch = Scratch(
        boxes=np.empty((n_runs, RUN_FACES // CLUSTER, 6)),
        areas=np.empty((n_runs, RUN_FACES // CLUSTER)),
        first_half=np.empty(n, dtype=np.int64),
        order=np.empty(n, dtype=np.int32),
        segments=np.empty((n_runs, RUN_FACES // CLUSTER + 1, 2), dtype=np.int64),
    )
    together(_halve_runs, n_runs, near, orders, scratch)
    places, full = orders[0, :n], n // CLUSTER * CLUSTER
    places[:full].reshape(-1, CLUSTER).sort()
    places[full:].sort()
    faces[:] = faces.take(places)


@shared
def _measure_faces(tasks, corners, low, side, index_bits, boxes, keys, cells):
    """Box each face, and give it the key that sorts it: long or not, its centre's place along the curve, its number."""
    scale = (2.0**CODE_BITS - 1.0) / side if side > 0.0 else 0.0
    first, last = take_block(tasks, len(corners), BLOCK)
    while first < last:
        for face in range(first, last):
            a, b, c = corners[face]
            extent = 0.0
            for axis in range(3):
                lower, upper = min(a[axis], b[axis], c[axis]), max(a[axis], b[axis], c[axis])
                boxes[face, axis], boxes[face, UPPER + axis] = lower, upper
                extent = max(extent, upper - lower)
                cells[axis, face - first] = np.int64((0.5 * (lower + upper) - low[axis]) * scale)
            keys[face] = np.uint64(extent > LONG * side) << np.uint64(63)
            if not _blocks_anything(a, b, c):
                keys[face] = NEVER
        place_along_curve(cells, last - first)
        for face in range(first, last):
            keys[face] |= (np.uint64(cells[0, face - first]) << np.uint64(index_bits)) | np.uint64(face)
        first, last = take_block(tasks, len(corners), BLOCK)


@inner
def _blocks_anything(a, b, c):
    """Whether the normal, as the definition computes it, is not exactly zero."""
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    return uy * vz - uz * vy != 0.0 or uz * vx - ux * vz != 0.0 or ux * vy - uy * vx != 0.0


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
    """Halve segments of each run until they are clusters; `orders` has each segment's faces along each axis."""
    begin, end = take_block(tasks, len(boxes), RUN_FACES)
    while begin < end:
        segments, n_segments = scratch.segments[begin // RUN_FACES], 1
        segments[0, 0], segments[0, 1] = begin, end
        while n_segments > 0:
            n_segments -= 1
            first, last = segments[n_segments, 0], segments[n_segments, 1]
            if last - first <= CLUSTER:
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
            _part(orders[other, first:last], scratch.first_half, scratch.order[first:last])
    return half


@inner
def _cheapest_half(boxes, order, groups, areas):
    """Least cost of halving faces in an order after a multiple of 16, and after how many; the last two are scratch."""
    n, n_groups = len(order), (len(order) + CLUSTER - 1) // CLUSTER
    for group in range(n_groups):
        low, high = (np.inf, np.inf, np.inf), (-np.inf, -np.inf, -np.inf)
        for i in range(group * CLUSTER, min((group + 1) * CLUSTER, n)):
            low, high = _widened(low, high, boxes, order[i])
        groups[group, 0], groups[group, 1], groups[group, 2] = low
        groups[group, 3], groups[group, 4], groups[group, 5] = high
    low, high = (np.inf, np.inf, np.inf), (-np.inf, -np.inf, -np.inf)
    for group in range(n_groups - 1, 0, -1):
        low, high = _widened(low, high, groups, group)
        areas[group] = _half_area(low, high)
    low, high = (np.inf, np.inf, np.inf), (-np.inf, -np.inf, -np.inf)
    least, half = np.inf, 0
    for group in range(n_groups - 1):
        low, high = _widened(low, high, groups, group)
        size = (group + 1) * CLUSTER
        cost = _half_area(low, high) * size + areas[group + 1] * (n - size)
        if half == 0 or cost < least:
            least, half = cost, size
    return least, half


@inner
def _widened(low, high, boxes, i):
    """Lower and upper corner of a box and another."""
    return (
        (min(low[0], boxes[i, 0]), min(low[1], boxes[i, 1]), min(low[2], boxes[i, 2])),
        (max(high[0], boxes[i, 3]), max(high[1], boxes[i, 4]), max(high[2], boxes[i, 5])),
    )


@inner
def _half_area(low, high):
    """Half the area of a box."""
    x, y, z = high[0] - low[0], high[1] - low[1], high[2] - low[2]
    return x * y + y * z + z * x


@inner
def _part(order, first_half, scratch):
    """Put the faces of the first half first, else as they are."""
    n = 0
    for i in range(len(order)):  # without branches, which nobody could predict
        face = order[i]
        order[n] = scratch[i - n] = face
        n += first_half[face]
    for i in range(n, len(order)):
        order[i] = scratch[i - n]
