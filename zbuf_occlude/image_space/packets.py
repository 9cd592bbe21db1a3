"""Points in packets of 16 that are near each other: sorted by own face, then in Morton order, once for all eyes."""

from typing import NamedTuple

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from zbuf_occlude.arrays import FloatArray, IntArray
from zbuf_occlude.image_space.backs import Solids, find_backed, pack_backs, planes_beside
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
    boxes, chunk_boxes : (6, n' / 16) and (6, n' / 256 and a multiple of 16) float32
        Lower and upper corners of the packets' and the chunks' boxes, scene space.
    reach, chunk_reach : (n' / 16,) and (n' / 256,) float32
        Largest distance from the scene's centre in each, at least 1.
    farthest : float32
        Largest of them.
    positions : (n, 3) float64
        World space, in the caller's order.
    own_planes : (4, n') float32
        Planes of the own faces, outward unit normal and offset, scene space; (4, 0) where no point is backed.
    planes_beside : (4, ...) float32
        The same of the faces beside them, for those packets that need them.
    backed : (n' / 16,) int64
        Masks of the points that their solid hides where these faces are turned away; see `backs`.
    beside : (n' / 16,) int64
        Where a packet's columns of `planes_beside` begin; -1 where it needs none.
    on_faces : bool
        Whether all points of faces of solids lie on these; False where solids are not known.
    identity : (n',) int32
        0, 1, 2, ...: for kernels that take points in yet another order.
    """

    n_points: int
    order: IntArray
    coordinates: Float32
    own: IntArray
    boxes: Float32
    chunk_boxes: Float32
    reach: Float32
    chunk_reach: Float32
    farthest: np.float32
    positions: FloatArray
    own_planes: Float32
    planes_beside: Float32
    backed: NDArray[np.int64]
    beside: NDArray[np.int64]
    on_faces: bool
    identity: IntArray


def make_packets(points: SurfacePoints, scene: Scene, rows: IntArray, solids: Solids | None) -> Packets:
    """Sort points; `rows` (f + 1,) leads from a face to 16 x cluster + lane, from -1 to -1.

    Without `solids` no point is backed.

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
    backs = _backs(points, scene, rows, order, solids)
    chunk_boxes = np.zeros((6, n_chunks + -n_chunks % PACKET), dtype=np.float32)
    chunk_boxes[:3, :n_chunks] = boxes[:3].reshape(3, n_chunks, CHUNK).min(axis=2)
    chunk_boxes[3:, :n_chunks] = boxes[3:].reshape(3, n_chunks, CHUNK).max(axis=2)
    chunk_reach = reach.reshape(n_chunks, CHUNK).max(axis=1)
    return Packets(
        n,
        order,
        coordinates,
        own,
        boxes,
        chunk_boxes,
        reach,
        chunk_reach,
        reach.max(),
        points.positions,
        *backs,
        np.arange(len(order), dtype=np.int32),
    )


def _backs(
    points: SurfacePoints, scene: Scene, rows: IntArray, order: IntArray, solids: Solids | None
) -> tuple[Float32, Float32, NDArray[np.int64], NDArray[np.int64], bool]:
    """`own_planes`, `planes_beside`, `backed`, `beside` and `on_faces` of the packets."""
    n_packets = len(order) // PACKET
    begins = np.full(n_packets, -1, dtype=np.int64)
    if solids is None:
        none = np.zeros((4, 0), dtype=np.float32)
        return none, none, np.zeros(n_packets, dtype=np.int64), begins, False
    beside, on_faces = find_backed(points.positions, points.face_ids, scene.centre, 2.0 / scene.scale, solids)
    own, backed, two = pack_backs(scene.planes, rows, solids.outward, points.face_ids, beside, order)
    needed = order.reshape(-1, PACKET)[two].reshape(-1)
    begins[two] = PACKET * np.arange(len(needed) // PACKET)
    return own, planes_beside(scene.planes, rows, solids.outward, beside, needed), backed, begins, bool(on_faces)


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
