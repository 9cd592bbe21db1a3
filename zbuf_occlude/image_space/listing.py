"""Lists of clusters: which may hide something of a chunk, nearest first."""

import numpy as np
from numba import njit

from zbuf_occlude.image_space.projection import ZERO
from zbuf_occlude.lanes import first_lane, load, not_less, splat

BUCKETS = 32
"""Intervals of depth that lists are sorted into."""


@njit(_nrt=False, forceinline=True)
def overlapping(rectangles, i, whole):  # type: ignore[no-untyped-def]
    """Mask of the 16 rectangles from column i on that overlap a packet's and do not lie wholly behind it.

    Parameters
    ----------
    rectangles : (6, ...) float32
    i : int
    whole : tuple
        Lowest x, highest x, lowest y, highest y, highest w of the packet, and more.
    """
    total = rectangles.shape[1]
    return (
        not_less(splat(whole[1]), load(rectangles, i))
        & not_less(load(rectangles, total + i), splat(whole[0]))
        & not_less(splat(whole[3]), load(rectangles, 2 * total + i))
        & not_less(load(rectangles, 3 * total + i), splat(whole[2]))
        & not_less(splat(whole[4]), load(rectangles, 4 * total + i))
    )


@njit(_nrt=False, forceinline=True)
def list_clusters(scene, whole, space):  # type: ignore[no-untyped-def]
    """List the clusters that may hide something of the chunks in a rectangle, nearest first; return how many.

    Fills `space.before` and `space.before_rectangles`; descends from the top level of nodes.
    """
    current, below = space.list_a, space.list_b
    top = len(scene.level_counts) - 1
    n = 0
    for i in range(0, scene.level_counts[top], 16):
        found = overlapping(space.rectangles, scene.level_starts[top] + i, whole)
        while found:
            current[n] = i + first_lane(found)
            found &= found - 1
            n += 1
    for level in range(top - 1, -1, -1):
        m = 0
        for j in range(n):
            i = 16 * current[j]
            found = overlapping(space.rectangles, scene.level_starts[level] + i, whole)
            while found:
                below[m] = i + first_lane(found)
                found &= found - 1
                m += 1
        current, below, n = below, current, m
    nearest = whole[4]
    for j in range(n):
        nearest = min(nearest, space.rectangles[4, current[j]])
    nearest = max(nearest, ZERO)
    scale = np.float32(BUCKETS - 1) / max(whole[4] - nearest, np.float32(1e-30))
    starts = space.buckets
    starts[:] = 0
    for j in range(n):
        bucket = np.int64(max(space.rectangles[4, current[j]] - nearest, ZERO) * scale)
        below[j] = bucket
        starts[bucket + 1] += 1
    for i in range(BUCKETS):
        starts[i + 1] += starts[i]
    for j in range(n):
        to = starts[below[j]]
        starts[below[j]] = to + 1
        cluster = current[j]
        space.before[to] = cluster
        for row in range(5):
            space.before_rectangles[row, to] = space.rectangles[row, cluster]
    return n
