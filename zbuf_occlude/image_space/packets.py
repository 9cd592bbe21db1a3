"""Points in packets of 16, sorted by own face, with what is known of them once for all eyes."""

from typing import NamedTuple

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from zbuf_occlude.arrays import FloatArray, IntArray
from zbuf_occlude.image_space.backs import Solids, back_of
from zbuf_occlude.image_space.scene import Float32, Scene
from zbuf_occlude.image_space.sorting import sort_points
from zbuf_occlude.sampling import SurfacePoints
from zbuf_occlude.threads import threaded

PACKET = 16
CHUNK = 16
"""Packets of a chunk."""

WORD = 64
"""Points whose bits share an integer."""


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
    row_starts : (16 m + 1,) int32
        The points of a face are those from one number here to the next.
    taken : (...) int32
        The rows of the faces that have points.
    backed, twofold : (n' / 64,) int64
        Bits of the points that their solid hides where their faces are turned away, see `backs`; and of those among
        them for which a face beside their own must be turned away, too.
    beside_rows : (n',) int32
        That face, where there is one.
    buried : (n' / 64,) int64
        Bits of the points inside a solid, that no eye outside sees.
    some_known : bool
        Whether any points are backed or buried.
    identity : (n',) int32
        0, 1, 2, ...: for kernels that take points in yet another order.
    on_faces : bool
        Whether all points of faces that are clear, or have barriers, or are of solids, lie on these; False where solids
        are not known.
    """

    n_points: int
    order: IntArray
    coordinates: Float32
    own: IntArray
    boxes: Float32
    reach: Float32
    farthest: np.float32
    positions: FloatArray
    row_starts: IntArray
    taken: IntArray
    backed: NDArray[np.int64]
    twofold: NDArray[np.int64]
    beside_rows: IntArray
    buried: NDArray[np.int64]
    some_known: bool
    identity: IntArray
    on_faces: bool


def make_packets(points: SurfacePoints, scene: Scene, rows: IntArray, solids: Solids, records: FloatArray) -> Packets:
    """Sort points; `rows` (f + 1,) leads from a face to 16 x cluster + lane, from -1 to -1.

    `records` are those of the surface's rows, none where solids are not known: then no point is backed or buried.

    Notes
    -----
    O(n) time, about 60 bytes a point.
    """
    n, n_rows = len(points), scene.face_ids.size
    order, row_starts = sort_points(points.positions, points.face_ids, rows, n_rows, scene.centre, scene.scale)
    order = np.pad(order, (0, -n % (PACKET * CHUNK)), mode="edge")
    gathered = _gather(points.positions, points.face_ids, rows, order, scene.centre, scene.scale, solids, records)
    coordinates, own, boxes, reach, backed, twofold, beside_rows, buried, n_off = gathered
    return Packets(
        n,
        order,
        coordinates,
        own,
        boxes,
        reach,
        reach.max(),
        points.positions,
        row_starts,
        np.flatnonzero(np.diff(row_starts)).astype(np.int32),
        backed,
        twofold,
        beside_rows,
        buried,
        bool(backed.any() or buried.any()),
        np.arange(len(order), dtype=np.int32),
        len(records) > 0 and n_off == 0,
    )


@threaded
def _gather(
    positions: FloatArray,
    face_ids: IntArray,
    rows: IntArray,
    order: IntArray,
    centre: FloatArray,
    scale: float,
    solids: Solids,
    records: FloatArray,
) -> tuple[Float32, IntArray, Float32, Float32, NDArray[np.int64], NDArray[np.int64], IntArray, NDArray[np.int64], int]:
    """Coordinates, own rows, boxes and reaches of the packets, and what solids say of their points."""
    n, n_off = len(order), 0
    coordinates = np.empty((3, n), dtype=np.float32)
    own, beside_rows = np.empty(n, dtype=np.int32), np.empty(n, dtype=np.int32)
    boxes = np.empty((6, n // PACKET), dtype=np.float32)
    reach = np.ones(n // PACKET, dtype=np.float32)
    backed, twofold = np.zeros(n // WORD, dtype=np.int64), np.zeros(n // WORD, dtype=np.int64)
    buried = np.zeros(n // WORD, dtype=np.int64)
    for word in prange(n // WORD):
        for packet in range(word * (WORD // PACKET), (word + 1) * (WORD // PACKET)):
            n_off += _gather_packet(
                packet,
                positions,
                face_ids,
                rows,
                order,
                centre,
                scale,
                solids,
                records,
                coordinates,
                own,
                boxes,
                reach,
                backed,
                twofold,
                beside_rows,
                buried,
            )
    return coordinates, own, boxes, reach, backed, twofold, beside_rows, buried, n_off


@njit(_nrt=False)
def _gather_packet(  # type: ignore[no-untyped-def]
    packet,
    positions,
    face_ids,
    rows,
    order,
    centre,
    scale,
    solids,
    records,
    coordinates,
    own,
    boxes,
    reach,
    backed,
    twofold,
    beside_rows,
    buried,
):
    """Fill in what there is of a packet; return how many of its points do not lie on their faces."""
    n_off, farthest = 0, 0.0
    for axis in range(3):
        boxes[axis, packet], boxes[3 + axis, packet] = np.inf, -np.inf
    for i in range(packet * PACKET, (packet + 1) * PACKET):
        k = order[i]
        face = face_ids[k]
        own[i] = rows[face]
        local = (
            (positions[k, 0] - centre[0]) * scale,
            (positions[k, 1] - centre[1]) * scale,
            (positions[k, 2] - centre[2]) * scale,
        )
        farthest = max(farthest, local[0] * local[0] + local[1] * local[1] + local[2] * local[2])
        for axis in range(3):
            value = np.float32(local[axis])
            coordinates[axis, i] = value
            boxes[axis, packet] = min(boxes[axis, packet], value)
            boxes[3 + axis, packet] = max(boxes[3 + axis, packet], value)
        if len(records) and own[i] >= 0:
            beside, off, inside = back_of(local, face, records[own[i]], solids)
            n_off += off
            buried[i // WORD] |= np.int64(inside) << (i % WORD)
            if beside >= 0:
                backed[i // WORD] |= 1 << (i % WORD)
                twofold[i // WORD] |= np.int64(beside != face) << (i % WORD)
                beside_rows[i] = rows[beside]
    reach[packet] = max(reach[packet], np.float32(np.sqrt(farthest) * (1.0 + 1e-6)))
    return n_off
