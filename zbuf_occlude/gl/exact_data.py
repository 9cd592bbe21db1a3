"""What the irregular z-buffer needs of a mesh, of points and of eyes, as arrays for the GPU."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.arrays import FloatArray, IntArray
from zbuf_occlude.geometry.hilbert import hilbert_order
from zbuf_occlude.jit.threads import n_blocks, shared, take_block, together

WIDTH = 8
"""Children of an inner box."""

LEAF = 8
"""Faces of a cluster."""

BLOCK = 256
"""Packets that a thread fills at a time."""

NONE = np.uint32(0xFFFFFFFF)

EXACT_POINT = np.dtype([("position", "<f8", 3), ("order", "<u4"), ("unused", "<u4")])
EYE = np.dtype([("position", "<f8", 3), ("unused", "<f8"), ("scaled", "<f4", 4)])


@dataclass(frozen=True)
class Unit:
    """The mesh's own space: centred, and scaled by a power of two so that the diagonal is in [1/2, 1).

    A power of two makes the scaling exact, so masks do not change when everything is scaled by one.
    """

    centre: FloatArray
    scale: float

    @classmethod
    def of(cls, centre: FloatArray, diagonal: float) -> "Unit":
        """Return the unit of a mesh by its box."""
        # 2^1023 is the largest there is
        return cls(centre, float(np.ldexp(1.0, min(-int(np.frexp(diagonal)[1]), 1023))) if diagonal > 0.0 else 1.0)

    def to(self, positions: FloatArray) -> FloatArray:
        """World to unit space, (..., 3) float64."""
        return (positions - self.centre) * self.scale


@dataclass(frozen=True)
class FaceArrays:
    """Faces in Hilbert order, and a tree of boxes over clusters of `LEAF` of them, `WIDTH` boxes to a box.

    Attributes
    ----------
    face_ids : (f,) int
        The mesh's face at each place.
    faces : (f, 16) float32
        Corner a, edges ab and ac, normal, edge bc, one unused; unit space. Edges and normals are rounded from
        float64 differences, so small faces keep their precision.
    corners : (f, 9) float64
        World space, as the mesh has them.
    boxes : (boxes, 8) float32
        Centre and half size, each padded to 4; the root first.
    level_start, level_size : (levels,) int
        Child j of box i of level l is box i WIDTH + j of level l + 1; the last level's are the clusters.
    """

    face_ids: NDArray[np.int64]
    faces: NDArray[np.float32]
    corners: FloatArray
    boxes: NDArray[np.float32]
    level_start: list[int]
    level_size: list[int]


def arrange_faces(corners: FloatArray, unit: Unit) -> FaceArrays:
    """Arrange faces given by their corners (f, 3, 3), world space."""
    order = hilbert_order(corners.mean(axis=1))
    corners = corners[order]
    local = unit.to(corners)
    a, b, c = local[:, 0], local[:, 1], local[:, 2]
    faces = np.zeros((len(corners), 16), dtype=np.float32)
    faces[:, 0:3], faces[:, 3:6], faces[:, 6:9] = a, b - a, c - a
    faces[:, 9:12], faces[:, 12:15] = np.cross(b - a, c - a), c - b
    low, high = local.min(axis=1), local.max(axis=1)
    levels: list[tuple[FloatArray, FloatArray]] = []
    step = LEAF
    while True:
        starts = np.arange(0, len(low), step)
        low, high = np.minimum.reduceat(low, starts), np.maximum.reduceat(high, starts)
        levels.insert(0, (low, high))
        step = WIDTH
        if len(levels) > 1 and len(low) == 1:
            break
    sizes = [len(low) for low, _ in levels]
    boxes = np.zeros((sum(sizes), 8), dtype=np.float32)
    boxes[:, 0:3] = np.concatenate([(low + high) / 2.0 for low, high in levels])
    boxes[:, 4:7] = np.concatenate([(high - low) / 2.0 for low, high in levels])
    return FaceArrays(order, faces, corners.reshape(-1, 9), boxes, [0, *np.cumsum(sizes[:-1]).tolist()], sizes)


@dataclass(frozen=True)
class PointArrays:
    """Points in packets of neighbours.

    Attributes
    ----------
    points : (packets * size, 4) uint32
        Bits of the float32 offset from the packet's centre, and the own face's place (`NONE`: free).
    exact_points : (packets * size,) EXACT_POINT
        World positions in float64, and the question's point at each place; `NONE` pads the last packet.
    packets : (packets, 8) float32
        Centre and radius, half size; unit space.
    """

    n_packets: int
    points: NDArray[np.uint32]
    exact_points: NDArray[Any]
    packets: NDArray[np.float32]


def arrange_points(positions: FloatArray, own_places: IntArray, size: int, unit: Unit) -> PointArrays:
    """Arrange n points into packets of `size`; own_places (n,): the own face's place among FaceArrays, -1 for none."""
    n = len(positions)
    n_packets = -(-n // size)
    order = np.empty(n_packets * size, dtype=np.int64)
    order[:n] = hilbert_order(positions)
    order[n:] = order[n - 1]
    exact_points = np.empty(len(order), dtype=EXACT_POINT)
    points = np.empty((len(order), 4), dtype=np.uint32)
    packets = np.zeros((n_packets, 8), dtype=np.float32)
    offsets, world = points.view(np.float32), exact_points.view(np.float64).reshape(-1, 4)
    together(
        _pack,
        n_blocks(n_packets, BLOCK),
        positions,
        order,
        size,
        unit.centre,
        unit.scale,
        offsets,
        world,
        packets,
    )
    points[:, 3] = own_places[order].astype(np.uint32)
    exact_points["order"] = order
    exact_points["order"][n:] = NONE
    return PointArrays(n_packets, points, exact_points, packets)


@shared
def _pack(tasks, positions, order, size, unit_centre, scale, offsets, world, packets):
    """Fill in the geometry of packets: offsets and world get a column more than three, which is left alone."""
    begin, end = take_block(tasks, len(packets), BLOCK)
    while begin < end:
        for packet in range(begin, end):
            first = packet * size
            largest = 0.0
            for axis in range(3):
                low, high = np.inf, -np.inf
                for i in range(first, first + size):
                    world[i, axis] = positions[order[i], axis]
                    local = (world[i, axis] - unit_centre[axis]) * scale
                    low, high = min(low, local), max(high, local)
                packets[packet, axis] = (low + high) / 2.0
                # a hair more than it is, for the rounding to float32
                centre = np.float64(packets[packet, axis])
                packets[packet, 4 + axis] = max(high - centre, centre - low) * (1.0 + 1e-6)
            for i in range(first, first + size):
                squared = 0.0
                for axis in range(3):
                    offset = (world[i, axis] - unit_centre[axis]) * scale - np.float64(packets[packet, axis])
                    offsets[i, axis] = offset
                    squared += offset * offset
                largest = max(largest, squared)
            packets[packet, 3] = np.sqrt(largest) * (1.0 + 1e-6)
        begin, end = take_block(tasks, len(packets), BLOCK)


def arrange_eyes(eyes: FloatArray, unit: Unit) -> NDArray[Any]:
    """Eyes (k, 3), world space, as EYE records: as they are, and in unit space times a power of two g; g last."""
    local = unit.to(eyes)
    exponent = -np.frexp(1.0 + 2.0 * np.abs(local).max(axis=1))[1]
    records = np.zeros(len(eyes), dtype=EYE)
    records["position"] = eyes
    records["scaled"][:, :3] = np.ldexp(local, exponent[:, None])
    # float32 has no smaller ones, and beyond 2^100 the mesh's size is below an eye's rounding
    records["scaled"][:, 3] = np.ldexp(1.0, np.maximum(exponent, -100))
    return records
