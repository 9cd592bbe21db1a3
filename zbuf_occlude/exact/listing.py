"""Lists of clusters: which may hide something of some points, nearest first."""

import numpy as np

from zbuf_occlude.exact.layout import BOTTOM, CLUSTER, LEFT, NEAREST, RIGHT, TOP, ZERO
from zbuf_occlude.exact.triangle_setup import slot_of
from zbuf_occlude.exact.workspace import DEPTHS, put
from zbuf_occlude.jit.compiler import inlined, inner
from zbuf_occlude.jit.simd import first_lane, load, not_less, splat


@inlined
def overlapping(rectangles, i, extent):
    """Mask of the 16 rectangles from column i on that overlap an extent and do not lie wholly behind it."""
    total = rectangles.shape[1]
    return (
        not_less(splat(extent.right), load(rectangles, LEFT * total + i))
        & not_less(load(rectangles, RIGHT * total + i), splat(extent.left))
        & not_less(splat(extent.top), load(rectangles, BOTTOM * total + i))
        & not_less(load(rectangles, TOP * total + i), splat(extent.bottom))
        & not_less(splat(extent.farthest), load(rectangles, NEAREST * total + i))
    )


@inner
def list_clusters(scene, extent, space):
    """Descend through the nodes to the clusters that may hide something of an extent; fill ``space.before``.

    Returns how many there are.
    """
    current, below = space.scratch[0], space.scratch[1]
    top = len(scene.level_counts) - 1
    n = np.int64(0)  # as a plain 0, a constant, it would have what it is given to compiled twice
    for i in range(0, scene.level_counts[top], CLUSTER):
        found = overlapping(space.rectangles, scene.level_starts[top] + i, extent)
        while found:
            current[n] = i + first_lane(found)
            found &= found - 1
            n += 1
    for level in range(top - 1, -1, -1):
        m = np.int64(0)
        for j in range(n):
            i = CLUSTER * current[j]
            found = overlapping(space.rectangles, scene.level_starts[level] + i, extent)
            while found:
                below[m] = i + first_lane(found)
                found &= found - 1
                m += 1
        current, below, n = below, current, m
    _sort_by_depth(current, below, n, extent.farthest, space)
    for j in range(n):
        put(space.before, j, below[j], space.rectangles, below[j])
    return n


@inner
def _sort_by_depth(clusters, nearest_first, n, farthest, space):
    """Sort n clusters by their lowest w, into `DEPTHS` intervals of it up to `farthest`."""
    w, starts = space.rectangles[NEAREST], space.depth_starts
    nearest = farthest
    for j in range(n):
        nearest = min(nearest, w[clusters[j]])
    nearest = max(nearest, ZERO)
    scale = np.float32(DEPTHS - 1) / max(farthest - nearest, np.float32(1e-30))
    starts[:] = 0
    for j in range(n):
        starts[np.int64(max(w[clusters[j]] - nearest, ZERO) * scale) + 1] += 1
    for i in range(DEPTHS):
        starts[i + 1] += starts[i]
    for j in range(n):
        depth = np.int64(max(w[clusters[j]] - nearest, ZERO) * scale)
        nearest_first[starts[depth]] = clusters[j]
        starts[depth] += 1


@inner
def tighten(scene, n, view, space):
    """Replace the rectangles of the n clusters in ``space.before`` by those of their projected faces."""
    for j in range(n):
        cluster = space.before.clusters[j]
        put(space.before, j, cluster, space.slot_rectangles, slot_of(scene, cluster, view, space))


@inner
def choose(n, extent, space):
    """List in ``space.listed`` those of the n clusters in ``space.before`` that overlap an extent; return how many."""
    n_listed = np.int64(0)
    for j in range(0, n, CLUSTER):
        found = overlapping(space.before.rectangles, j, extent)
        if n - j < CLUSTER:
            found &= (1 << (n - j)) - 1
        while found:
            entry = j + first_lane(found)
            found &= found - 1
            put(space.listed, n_listed, space.before.clusters[entry], space.before.rectangles, entry)
            n_listed += 1
    return n_listed
