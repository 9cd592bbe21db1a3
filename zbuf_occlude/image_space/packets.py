"""Points in packets of 16 that are near each other: sorted by own face, then in Morton order, once for all eyes."""

from typing import NamedTuple

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from zbuf_occlude.arrays import FloatArray, IntArray
from zbuf_occlude.image_space.backs import Solids, find_backed, pack_backs
from zbuf_occlude.image_space.scene import Float32, Scene
from zbuf_occlude.sampling import SurfacePoints
from zbuf_occlude.threads import threaded

PACKET = 16
CHUNK = 16
"""Packets of a chunk."""

BITS = 9
"""Bits per axis of the Morton codes of points: cells of 1/512 of the scene; what shares a cell keeps its order."""

DIGIT = 11
"""Bits that one pass of the radix sort takes."""


class Packets(NamedTuple):
    """n points in the order in which the kernels take them, filled up to whole chunks by repeating the last one.

    Parameters
    ----------
    n_points : int
    order : (n',) int32
        Where each was among the caller's points.
    coordinates : (3, n') float32, scene space
    own : (n',) int32
        16 x cluster + lane of the own face; -1 for none.
    boxes : (6, n' / 16) float32
        Lower and upper corners of the packets' boxes, scene space.
    reach : (n' / 16,) float32
        Largest distance from the scene's centre in each, at least 1.
    farthest : float32
        Largest of them.
    positions : (n, 3) float64
        World space, in the caller's order.
    run_starts : (n' / 16 + 1,) int32
        A packet's points come in runs of the same own face: its runs are those from one number here to the next.
    run_rows, run_masks : (n_runs,) int32
        Own face, as in `own`, and mask of the points of each run.
    first_packets : (16 m,) int32
        The first packet that has a point of a face; -1 where none has.
    backed : (n' / 16,) int64
        Masks of the points that their solid hides where their faces are turned away; see `backs`.
    some_backed : bool
        Whether there are any.
    beside : (n' / 16,) int64
        Where in `beside_rows` a packet's points begin; -1 where their own faces are all that matters.
    beside_rows : (...) int32
        Faces beside the own ones that must be turned away, too, or the own ones once more.
    on_faces : bool
        Whether all points of faces that are clear, or have barriers, or are of solids, lie on these; False where solids
        are not known.
    identity : (n',) int32
        0, 1, 2, ...: for kernels that take points in yet another order.
    """

    n_points: int
    order: IntArray
    coordinates: Float32
    own: IntArray
    boxes: Float32
    reach: Float32
    farthest: np.float32
    positions: FloatArray
    run_starts: IntArray
    run_rows: IntArray
    run_masks: IntArray
    first_packets: IntArray
    backed: NDArray[np.int64]
    some_backed: bool
    beside: NDArray[np.int64]
    beside_rows: IntArray
    on_faces: bool
    identity: IntArray


def make_packets(
    points: SurfacePoints, scene: Scene, rows: IntArray, solids: Solids | None, records: FloatArray
) -> Packets:
    """Sort points; `rows` (f + 1,) leads from a face to 16 x cluster + lane, from -1 to -1.

    Without `solids` no point is backed; `records` are those of the surface's rows.

    Notes
    -----
    O(n) time, about 70 bytes a point, as much again while it sorts.
    """
    n = len(points)
    keys = _keys(points.positions, points.face_ids, rows, scene.centre, scene.scale)
    order = _radix_order(keys, 3 * BITS + int(PACKET * len(scene.face_ids) + 1).bit_length())
    n_chunks = -(-n // (PACKET * CHUNK))
    order = np.pad(order, (0, n_chunks * PACKET * CHUNK - n), mode="edge")
    coordinates, own, boxes, reach = _gather(points.positions, points.face_ids, rows, order, scene.centre, scene.scale)
    run_starts, run_rows, run_masks, first_packets = _runs(own, scene.face_ids.size)
    backed, some_backed, beside, beside_rows, on_faces = _backs(points, scene, rows, order, own, solids, records)
    return Packets(
        n,
        order,
        coordinates,
        own,
        boxes,
        reach,
        reach.max(),
        points.positions,
        run_starts,
        run_rows,
        run_masks,
        first_packets,
        backed,
        some_backed,
        beside,
        beside_rows,
        on_faces,
        np.arange(len(order), dtype=np.int32),
    )


def _backs(
    points: SurfacePoints,
    scene: Scene,
    rows: IntArray,
    order: IntArray,
    own: IntArray,
    solids: Solids | None,
    records: FloatArray,
) -> tuple[NDArray[np.int64], bool, NDArray[np.int64], IntArray, bool]:
    """`backed`, `some_backed`, `beside`, `beside_rows` and `on_faces` of the packets."""
    n_packets = len(order) // PACKET
    begins = np.full(n_packets, -1, dtype=np.int64)
    if solids is None:
        return np.zeros(n_packets, dtype=np.int64), False, begins, np.zeros(0, dtype=np.int32), False
    beside, on_faces = find_backed(
        points.positions, points.face_ids, order, own, scene.centre, 2.0 / scene.scale, solids, records
    )
    backed, two = pack_backs(points.face_ids, beside, order)
    needed = beside.reshape(-1, PACKET)[two].reshape(-1)
    begins[two] = PACKET * np.arange(len(needed) // PACKET)
    return backed, bool(backed.any()), begins, rows[needed], bool(on_faces)


@njit(cache=True)
def _runs(own: IntArray, n_rows: int) -> tuple[IntArray, IntArray, IntArray, IntArray]:
    """`run_starts`, `run_rows`, `run_masks` and `first_packets` of the packets; own faces ascend."""
    n_packets, n = len(own) // PACKET, 0
    starts = np.zeros(n_packets + 1, dtype=np.int32)
    for i in range(len(own)):
        n += i % PACKET == 0 or own[i] != own[i - 1]
        starts[i // PACKET + 1] = n
    rows, masks = np.empty(n, dtype=np.int32), np.zeros(n, dtype=np.int32)
    first_packets = np.full(n_rows, -1, dtype=np.int32)
    run = -1
    for i in range(len(own)):
        if i % PACKET == 0 or own[i] != own[i - 1]:
            run += 1
            rows[run] = own[i]
            if own[i] >= 0 and first_packets[own[i]] < 0:
                first_packets[own[i]] = i // PACKET
        masks[run] |= np.int32(1) << np.int32(i % PACKET)
    return starts, rows, masks, first_packets


@threaded
def _keys(
    positions: FloatArray,
    face_ids: IntArray,
    rows: IntArray,
    centre: FloatArray,
    scale: float,
) -> NDArray[np.uint64]:
    """Keys to sort by: own row, then the Morton code of the position in the cube about the scene."""
    keys = np.empty(len(positions), dtype=np.uint64)
    for i in prange(len(positions)):
        key = np.uint64(rows[face_ids[i]] + 1) << np.uint64(3 * BITS)
        for axis in range(3):
            cell = ((positions[i, axis] - centre[axis]) * scale + 1.0) * 2.0 ** (BITS - 1)
            bits = np.uint64(min(max(cell, 0.0), 2.0**BITS - 1.0))
            bits = (bits | (bits << np.uint64(16))) & np.uint64(0x030000FF)
            bits = (bits | (bits << np.uint64(8))) & np.uint64(0x0300F00F)
            bits = (bits | (bits << np.uint64(4))) & np.uint64(0x030C30C3)
            bits = (bits | (bits << np.uint64(2))) & np.uint64(0x09249249)
            key |= bits << np.uint64(axis)
        keys[i] = key
    return keys


@njit(cache=True)
def _radix_order(keys: NDArray[np.uint64], n_bits: int) -> IntArray:
    """Stable order of keys of so many bits, lowest digit first."""
    n = len(keys)
    order, other = np.arange(n).astype(np.int32), np.empty(n, dtype=np.int32)
    sorted_keys, other_keys = keys, np.empty_like(keys)
    mask = np.uint64((1 << DIGIT) - 1)
    for shift in range(0, n_bits, DIGIT):
        starts = np.zeros((1 << DIGIT) + 1, dtype=np.int64)
        for i in range(n):
            starts[np.int64((sorted_keys[i] >> np.uint64(shift)) & mask) + 1] += 1
        for i in range(1 << DIGIT):
            starts[i + 1] += starts[i]
        for i in range(n):
            digit = np.int64((sorted_keys[i] >> np.uint64(shift)) & mask)
            to = starts[digit]
            starts[digit] = to + 1
            other[to], other_keys[to] = order[i], sorted_keys[i]
        if shift == 0:
            sorted_keys, other_keys = other_keys, np.empty_like(keys)
        else:
            sorted_keys, other_keys = other_keys, sorted_keys
        order, other = other, order
    return order


@threaded
def _gather(
    positions: FloatArray, face_ids: IntArray, rows: IntArray, order: IntArray, centre: FloatArray, scale: float
) -> tuple[Float32, IntArray, Float32, Float32]:
    """Coordinates, own rows, boxes and reaches of the packets."""
    n = len(order)
    coordinates = np.empty((3, n), dtype=np.float32)
    own = np.empty(n, dtype=np.int32)
    boxes = np.empty((6, n // PACKET), dtype=np.float32)
    reach = np.ones(n // PACKET, dtype=np.float32)
    for packet in prange(n // PACKET):
        for i in range(packet * PACKET, (packet + 1) * PACKET):
            own[i] = rows[face_ids[order[i]]]
            squared = 0.0
            for axis in range(3):
                local = (positions[order[i], axis] - centre[axis]) * scale
                squared += local * local
                value = np.float32(local)
                coordinates[axis, i] = value
                if i == packet * PACKET:
                    boxes[axis, packet] = boxes[3 + axis, packet] = value
                boxes[axis, packet] = min(boxes[axis, packet], value)
                boxes[3 + axis, packet] = max(boxes[3 + axis, packet], value)
            reach[packet] = max(reach[packet], np.float32(np.sqrt(squared) * (1.0 + 1e-6)))
    return coordinates, own, boxes, reach
