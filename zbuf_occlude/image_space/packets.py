"""Points in packets of 16 that are near each other: sorted by own face, then in Morton order, once for all eyes."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.arrays import FloatArray, IntArray
from zbuf_occlude.image_space.ordering import BITS, morton_codes
from zbuf_occlude.image_space.scene import Float32, Scene
from zbuf_occlude.sampling import SurfacePoints

PACKET = 16
CHUNK = 16
"""Packets of a chunk."""


class Packets(NamedTuple):
    """n points in the order in which the kernels take them, filled up to whole chunks by repeating the last one.

    Parameters
    ----------
    n_points : int
    order : (n,) int64
        Where each was among the caller's points.
    coordinates : (3, n') float32, scene space
    own : (n',) int32
        16 x cluster + lane of the own face; -1 for none.
    boxes, chunk_boxes : (n' / 16, 6) and (n' / 256, 6) float32
        Centre and half-sides of the packets' and the chunks' boxes, scene space.
    reach : (n' / 16,) float32
        Upper bound of |coordinate| in the packet, at least 1.
    positions : (n, 3) float64
        World space, in the caller's order.
    """

    n_points: int
    order: NDArray[np.int64]
    coordinates: Float32
    own: IntArray
    boxes: Float32
    chunk_boxes: Float32
    reach: Float32
    positions: FloatArray


def make_packets(points: SurfacePoints, scene: Scene, rows: IntArray) -> Packets:
    """Sort points; `rows` (f + 1,) leads from a face to 16 x cluster + lane, from -1 to -1.

    Notes
    -----
    O(n log n) time, 44 bytes a point.
    """
    n = len(points)
    local = (points.positions - scene.centre) * scene.scale
    own = rows[points.face_ids]
    codes = morton_codes(local, np.full(3, -1.0), 2.0)
    row_bits = int(len(scene.face_ids) * PACKET + 1).bit_length()
    keys = (np.asarray(own + 1, dtype=np.uint64) << np.uint64(64 - row_bits)) | (
        codes >> np.uint64(max(0, 3 * BITS + row_bits - 64))
    )
    order = np.argsort(keys, kind="stable")
    padded = np.pad(order, (0, -n % (PACKET * CHUNK)), mode="edge")
    coordinates = np.ascontiguousarray(local[padded].T, dtype=np.float32)
    boxes = _boxes(coordinates, PACKET)
    return Packets(
        n,
        order,
        coordinates,
        own[padded],
        boxes,
        _boxes(coordinates, PACKET * CHUNK),
        np.maximum(1.0, np.abs(boxes[:, :3]) + boxes[:, 3:]).max(axis=1).astype(np.float32),
        points.positions,
    )


def _boxes(coordinates: Float32, size: int) -> Float32:
    """Boxes of runs of `size` points; half-sides are rounded up by more than float32 can err."""
    runs = coordinates.reshape(3, -1, size)
    lower, upper = runs.min(axis=2), runs.max(axis=2)
    centre, half = (lower + upper) / np.float32(2.0), (upper - lower) / np.float32(2.0)
    half += np.float32(2e-7) * (np.abs(lower) + np.abs(upper))
    return np.ascontiguousarray(np.concatenate([centre, half]).T, dtype=np.float32)
