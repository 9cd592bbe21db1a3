"""Points sorted along a Hilbert curve, in packets of 32 and chunks of 8 packets."""

from typing import NamedTuple

import numpy as np

from zbuf_occlude.base.arrays import FloatArray, IntArray
from zbuf_occlude.base.jit.compiler import device_function
from zbuf_occlude.base.jit.pointer import pointer_to
from zbuf_occlude.base.jit.simd import highest, load3_wide, load_unchecked, lowest, store_unchecked
from zbuf_occlude.base.jit.threads import n_blocks, next_task, parallel_for, parallel_kernel
from zbuf_occlude.engines.exact.bvh import Bvh
from zbuf_occlude.engines.exact.layout import CHUNK, CHUNK_POINTS, F32_MAX, GROUP, ONE, PACKET, UPPER, Float32
from zbuf_occlude.geometry.hilbert import hilbert_order
from zbuf_occlude.meshes.sampling import SurfacePoints

THREAD_CHUNKS = 32
"""Minimum chunks per extra thread; below this, waking it costs more."""


class Packets(NamedTuple):
    """Set of n points along the curve, padded to n' (whole chunks) by repeating the last one; scene space."""

    n_points: int
    order: IntArray  # (n',) index of each point among the caller's
    coordinates: Float32  # (3, n')
    own: IntArray  # (n',) row of the own face; -1 for none
    boxes: Float32  # (6, n' / 32) boxes of the packets
    magnitudes: Float32  # (n' / 32,) largest distance from the scene's centre in each packet, at least 1
    chunk_boxes: Float32  # (6, c) boxes of the chunks, padded to a multiple of 16 chunks
    chunk_magnitudes: Float32  # (n' / 256,)
    max_magnitude: np.float32
    positions: FloatArray  # (n, 3) world space, in the caller's order


def make_packets(bvh: Bvh, points: SurfacePoints) -> Packets:
    """Sort points and divide them into packets and chunks; O(n log n), about 60 bytes per point."""
    order = hilbert_order(points.positions)
    n_chunks = -(-len(order) // CHUNK_POINTS)
    order = np.concatenate([order, np.full(n_chunks * CHUNK_POINTS - len(order), order[-1])])
    packets = Packets(
        n_points=len(points),
        order=order,
        coordinates=np.empty((3, len(order)), dtype=np.float32),
        own=np.empty(len(order), dtype=np.int32),
        boxes=np.empty((6, n_chunks * CHUNK), dtype=np.float32),
        magnitudes=np.empty(n_chunks * CHUNK, dtype=np.float32),
        chunk_boxes=np.zeros((6, -(-n_chunks // GROUP) * GROUP), dtype=np.float32),
        chunk_magnitudes=np.empty(n_chunks, dtype=np.float32),
        max_magnitude=ONE,
        positions=points.positions,
    )
    parallel_for(_fill_chunks, n_blocks(n_chunks, THREAD_CHUNKS), bvh, points.face_ids, packets)
    return packets._replace(max_magnitude=packets.chunk_magnitudes.max())


@parallel_kernel
def _fill_chunks(tasks, bvh, face_ids, packets):
    """Fill in coordinates, own rows, boxes and magnitudes."""
    bvh_at, packets_at = pointer_to(bvh), pointer_to(packets)
    chunk = next_task(tasks)
    while chunk < len(packets.chunk_magnitudes):
        magnitude = ONE
        for axis in range(3):
            packets.chunk_boxes[axis, chunk], packets.chunk_boxes[UPPER + axis, chunk] = F32_MAX, -F32_MAX
        for packet in range(chunk * CHUNK, (chunk + 1) * CHUNK):
            _fill_packet(bvh_at, face_ids, packets_at, packet)
            magnitude = max(magnitude, packets.magnitudes[packet])
            for axis in range(3):
                lower, upper = packets.boxes[axis, packet], packets.boxes[UPPER + axis, packet]
                packets.chunk_boxes[axis, chunk] = min(packets.chunk_boxes[axis, chunk], lower)
                packets.chunk_boxes[UPPER + axis, chunk] = max(packets.chunk_boxes[UPPER + axis, chunk], upper)
        packets.chunk_magnitudes[chunk] = magnitude
        chunk = next_task(tasks)


@device_function
def _fill_packet(bvh, face_ids, packets, packet):
    """Fill in coordinates, own rows, box and magnitude of a packet."""
    first, total, max_square = packet * PACKET, packets.coordinates.shape[1], 0.0
    order, coordinates, positions = packets.order, packets.coordinates, packets.positions
    for i in range(first, first + PACKET):  # a loop of its own, so that many points are fetched at a time
        face = np.int64(load_unchecked(face_ids, np.int64(load_unchecked(order, i))))
        store_unchecked(packets.own, i, load_unchecked(bvh.rows, face if face >= 0 else len(bvh.rows) - 1))
    centre, scale = bvh.centre, bvh.scale
    for i in range(first, first + PACKET):
        at = 3 * np.int64(load_unchecked(order, i))
        x = (load_unchecked(positions, at) - centre[0]) * scale
        y = (load_unchecked(positions, at + 1) - centre[1]) * scale
        z = (load_unchecked(positions, at + 2) - centre[2]) * scale
        store_unchecked(coordinates, i, np.float32(x))
        store_unchecked(coordinates, i + total, np.float32(y))
        store_unchecked(coordinates, i + 2 * total, np.float32(z))
        max_square = max(max_square, x * x + y * y + z * z)
    point = load3_wide(coordinates, first, total)
    for axis in range(3):
        packets.boxes[axis, packet], packets.boxes[UPPER + axis, packet] = lowest(point[axis]), highest(point[axis])
    packets.magnitudes[packet] = max(ONE, np.float32(np.sqrt(max_square) * (1.0 + 1e-6)))
