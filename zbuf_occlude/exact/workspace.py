"""What one thread needs to search views, allocated once."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.arrays import IntArray
from zbuf_occlude.exact.bvh import Float32
from zbuf_occlude.exact.layout import CLUSTER, GROUP, PACKET, SETUP_ROWS
from zbuf_occlude.jit.compiler import inlined

SLOTS = 4096
"""Set-ups of clusters kept at a time, 900 bytes each; a power of two."""

DEPTHS = 64
"""Intervals of depth that clusters are sorted into."""


class ClusterList(NamedTuple):
    """Clusters that may hide something, nearest first; how many there are is said where the list is passed on."""

    clusters: IntArray  # (capacity,)
    rectangles: Float32  # (6, capacity) around them in the image


class Workspace(NamedTuple):
    """Up to 4 MB of set-ups, and about 5 bytes per face."""

    rectangles: Float32  # (6, total nodes) around the nodes in the image
    chunk_rectangles: Float32  # (6, GROUP) around the chunks of a group
    scratch: IntArray  # (2, clusters + 16)
    depth_starts: NDArray[np.int64]  # (DEPTHS + 1,)
    before: ClusterList  # the clusters before a few neighbouring chunks
    listed: ClusterList  # of these, the clusters before the current chunk
    setups: Float32  # (n_slots x SETUP_ROWS x 16,) see `setup`
    slot_rectangles: Float32  # (6, n_slots) around the faces set up there
    slot_tags: NDArray[np.int64]  # (n_slots,) of which cluster, in which view
    doubtful: NDArray[np.int64]  # (n_slots,) masks of the faces that float32 must not decide
    image: Float32  # (3, 32) x / w, y / w and w of the points in hand


def make_workspace(n_clusters: int, n_nodes: int) -> Workspace:
    """Allocate a thread's workspace for a scene of so many clusters and nodes. Numba understands it, too."""
    capacity = n_clusters + CLUSTER
    clusters, rectangles = np.empty((2, capacity), dtype=np.int32), np.empty((2, 6, capacity), dtype=np.float32)
    n_slots = 1
    while n_slots < min(n_clusters, SLOTS):
        n_slots *= 2
    return Workspace(
        rectangles=np.empty((6, n_nodes), dtype=np.float32),
        chunk_rectangles=np.empty((6, GROUP), dtype=np.float32),
        scratch=np.empty((2, capacity), dtype=np.int32),
        depth_starts=np.zeros(DEPTHS + 1, dtype=np.int64),
        before=ClusterList(clusters[0], rectangles[0]),
        listed=ClusterList(clusters[1], rectangles[1]),
        setups=np.empty(n_slots * SETUP_ROWS * CLUSTER, dtype=np.float32),
        slot_rectangles=np.empty((6, n_slots), dtype=np.float32),
        slot_tags=np.full(n_slots, -1, dtype=np.int64),
        doubtful=np.zeros(n_slots, dtype=np.int64),
        image=np.zeros((3, PACKET), dtype=np.float32),
    )


@inlined
def put(found, at, cluster, rectangles, column):
    """Write a cluster and its rectangle, a column of `rectangles`, to a place of a list."""
    found.clusters[at] = cluster
    for row in range(6):
        found.rectangles[row, at] = rectangles[row, column]
