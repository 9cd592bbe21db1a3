"""What one thread needs to search a frame, allocated once."""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from zbuf_occlude.arrays import IntArray
from zbuf_occlude.image_space.listing import BUCKETS
from zbuf_occlude.image_space.packets import CHUNK, PACKET
from zbuf_occlude.image_space.projection import ROWS
from zbuf_occlude.image_space.scene import Float32
from zbuf_occlude.image_space.slots import SLOTS

GROUP = 16
"""Chunks whose boxes are projected at once."""


class Workspace(NamedTuple):
    """Up to 4 MB of set-ups, about 5 bytes a face, and 8 a packet.

    A chunk here is 16 of the packets in `left`.
    """

    rectangles: Float32  # (6, total nodes)
    chunk_boxes: Float32  # (6, GROUP) around the chunks' packets, scene space
    chunk_own: IntArray  # (GROUP, 2) first and last own face of their points
    chunk_rectangles: Float32  # (6, GROUP)
    chunks: Float32  # (GROUP, 9) the chunks' numbers, see `projection.project_points`
    list_a: NDArray[np.int64]  # (clusters + 16,) scratch
    list_b: NDArray[np.int64]  # the same
    before: NDArray[np.int64]  # the clusters before the current chunks, nearest first
    before_rectangles: Float32  # (6, clusters + 16) theirs
    listed: NDArray[np.int64]  # of these, the clusters before the current chunk
    listed_rectangles: Float32  # theirs
    slots: Float32  # (n_slots x ROWS x 16,)
    slot_rectangles: Float32  # (n_slots, 5)
    tags: NDArray[np.int64]  # (n_slots,) which cluster, in which frame
    doubtful: NDArray[np.int64]  # (n_slots,)
    image: Float32  # (2, CHUNK x PACKET) x / w and y / w of the chunk's points
    packets: Float32  # (CHUNK, 9) see `projection.project_points`
    undecided: NDArray[np.int64]  # (CHUNK,)
    decided: NDArray[np.uint16]  # (packets,) masks of the points that need no search
    decided_words: NDArray[np.int64]  # (packets / 4,) the same ones
    hidden_words: NDArray[np.int64]  # (packets / 4,) of these, the hidden ones
    left: IntArray  # (packets,) packets with other points
    buckets: NDArray[np.int64]  # (BUCKETS + 1,)


@njit
def make_workspace(scene, n_packets):  # type: ignore[no-untyped-def]
    """Allocate a thread's workspace."""
    n_clusters = len(scene.used)
    decided = np.zeros(n_packets, dtype=np.uint16)
    n_slots = 1
    while n_slots < min(n_clusters, SLOTS):
        n_slots *= 2
    return Workspace(
        np.empty((6, scene.nodes.shape[1]), dtype=np.float32),
        np.zeros((6, GROUP), dtype=np.float32),
        np.zeros((GROUP, 2), dtype=np.int32),
        np.empty((6, GROUP), dtype=np.float32),
        np.zeros((GROUP, 9), dtype=np.float32),
        np.empty(n_clusters + 16, dtype=np.int64),
        np.empty(n_clusters + 16, dtype=np.int64),
        np.empty(n_clusters + 16, dtype=np.int64),
        np.empty((6, n_clusters + 16), dtype=np.float32),
        np.empty(n_clusters + 16, dtype=np.int64),
        np.empty((6, n_clusters + 16), dtype=np.float32),
        np.empty(n_slots * ROWS * 16, dtype=np.float32),
        np.empty((n_slots, 5), dtype=np.float32),
        np.full(n_slots, -1, dtype=np.int64),
        np.zeros(n_slots, dtype=np.int64),
        np.zeros((2, CHUNK * PACKET), dtype=np.float32),
        np.zeros((CHUNK, 9), dtype=np.float32),
        np.zeros(CHUNK, dtype=np.int64),
        decided,
        decided.view(np.int64),
        np.zeros(n_packets // 4, dtype=np.int64),
        np.zeros(n_packets, dtype=np.int32),
        np.zeros(BUCKETS + 1, dtype=np.int64),
    )
