"""Nodes of the BVH: a binary tree over the leaves, collapsed to nodes of up to 16 children.

References
----------
Wald: On fast construction of SAH-based bounding volume hierarchies. IEEE RT 2007, doi:10.1109/RT.2007.4342588 (bins).
Ylitie, Karras, Laine: Efficient incoherent ray traversal on GPUs through compressed wide BVHs. HPG 2017,
doi:10.1145/3105762.3105773 (the choice of nodes that costs least).
"""

from typing import NamedTuple

import numpy as np

from zbuf_occlude.base.arrays import IntArray
from zbuf_occlude.base.jit.compiler import always_inline, device_function
from zbuf_occlude.base.jit.simd import (
    load,
    load_scalar,
    load_unchecked,
    minimum,
    splat,
    store,
    store_unchecked,
)
from zbuf_occlude.engines.exact.layout import F32_MAX, LEAF, UPPER, ZERO, Float32, Int64, aligned
from zbuf_occlude.engines.exact.rows import CENTRE, ROW, cheapest, half_area, joined_rows, partition, range_of_centres

SAH_BINS = 16
"""Maximum number of bins along an axis of the surface area heuristic that halves spans of leaves."""
COSTS = 2 * LEAF
"""Length of a row of costs: 16 times infinity, then those of at most 1, 2, ... 16 nodes or leaves."""


class BinaryTree(NamedTuple):
    """Binary tree over m leaves, nodes of up to 16 children that it is collapsed to, and working memory.

    Its nodes are spans of at least two leaves. The first half of span i is span i + 1, its second half is span i + the
    number of leaves of the first. A half of one leaf is no span.
    """

    leaves: IntArray  # (m,) in the order of the tree
    spans: Int64  # (m, 3) first leaf, start of the second half, end
    rows: Float32  # (m,) row around each span
    costs: Float32  # (m + 1, 32) least area of the nodes that a span needs (`COSTS`); the last row is that of a leaf
    bins: Float32  # (3 SAH_BINS + 1,) rows of bins along each axis, and a spare one
    sizes: Int64  # (3 SAH_BINS,) leaves of each bin
    lows: Float32  # (3,) twice the least centre of a span along each axis
    scales: Float32  # (3,) bins per that unit
    areas: Float32  # (SAH_BINS,)
    keys: IntArray  # (3 m,) bin of each leaf, axis after axis
    spare: IntArray  # (m,)
    numbers: IntArray  # (3 SAH_BINS,) 0, 1, 2, ...
    stack: Int64  # (16, 2) stack of the node being filled: span or ~leaf, and the roots it may have
    todo: Int64  # (m, 3) stack of nodes to be filled: span, node, depth
    boxes: Float32  # (6 m, 16) and so on as in `bvh.Bvh`
    children: IntArray  # (16 m,)
    n_children: IntArray  # (m,)
    totals: Int64  # (2,) receives the number of nodes and the depth


def new_tree(n_leaves: int) -> BinaryTree:
    """Allocate the tree over a number of leaves, which has at most as many nodes."""
    room = max(n_leaves, 1)
    costs = np.full((room + 1, COSTS), np.inf, dtype=np.float32)
    costs[-1, LEAF:] = 0.0
    return BinaryTree(
        leaves=np.arange(n_leaves, dtype=np.int32),
        spans=np.empty((room, 3), dtype=np.int64),
        rows=aligned(room * ROW),
        costs=costs,
        bins=aligned((3 * SAH_BINS + 1) * ROW),
        sizes=np.empty(3 * SAH_BINS, dtype=np.int64),
        lows=np.empty(3, dtype=np.float32),
        scales=np.empty(3, dtype=np.float32),
        areas=np.empty(SAH_BINS, dtype=np.float32),
        keys=np.empty(3 * room, dtype=np.int32),
        spare=np.empty(room, dtype=np.int32),
        numbers=np.arange(3 * SAH_BINS, dtype=np.int32),
        stack=np.empty((LEAF, 2), dtype=np.int64),
        todo=np.empty((room, 3), dtype=np.int64),
        boxes=np.empty((room * 6, LEAF), dtype=np.float32),
        children=np.empty(room * LEAF, dtype=np.int32),
        n_children=np.empty(room, dtype=np.int32),
        totals=np.zeros(2, dtype=np.int64),
    )


@device_function
def grow(rows, tree):
    """Fill in the nodes over leaves with these rows: halve spans, sum their costs, collapse the binary tree."""
    n = len(tree.leaves)
    if n > 0:
        _halve_all(rows, tree)
    for span in range(n - 2, -1, -1):
        _sum_costs(span, tree)
    _collapse(rows, tree)


# The binary tree


@device_function
def _halve_all(rows, tree):
    """Halve the span of all leaves, and its halves, down to single leaves."""
    spans, n = tree.spans, len(tree.leaves)
    spans[0, 0], spans[0, 2] = 0, n
    store(tree.rows, 0, joined_rows(rows, tree.leaves, spans[0, 0], n))
    for span in range(n - 1):
        first, last = spans[span, 0], spans[span, 2]
        middle = first + 1 if last - first == 2 else _halve(rows, span, tree)
        spans[span, 1] = middle
        one, other = span + 1, span + middle - first
        if middle - first > 1:
            spans[one, 0], spans[one, 2] = first, middle
        if last - middle > 1:
            spans[other, 0], spans[other, 2] = middle, last


@device_function
def _halve(rows, span, tree):
    """Halve a span where the cost is least; return the start of the second half. Neither half is empty."""
    first, last, leaves, bins, sizes = tree.spans[span, 0], tree.spans[span, 2], tree.leaves, tree.bins, tree.sizes
    n_bins, lows, scales = min(last - first, SAH_BINS), tree.lows, tree.scales
    for axis in range(3):
        low, width = range_of_centres(tree.rows, span, axis)
        lows[axis], scales[axis] = low, np.float32(n_bins) * np.float32(0.9999) / width if width > ZERO else ZERO
        for i in range(SAH_BINS * axis, SAH_BINS * axis + n_bins):
            store(bins, ROW * i, splat(F32_MAX))
            store_unchecked(sizes, i, 0)
    for i in range(first, last):
        leaf = np.int64(load_unchecked(leaves, i))
        row = load(rows, ROW * leaf)
        for axis in range(3):
            centre = load_scalar(rows, ROW * leaf + CENTRE + axis)
            key = np.int64((centre - load_scalar(lows, axis)) * load_scalar(scales, axis)) + SAH_BINS * axis
            store_unchecked(tree.keys, len(leaves) * axis + leaf, key)
            store_unchecked(sizes, key, load_unchecked(sizes, key) + 1)
            store(bins, ROW * key, minimum(load(bins, ROW * key), row))
    least, start, cut = np.float32(np.inf), 0, 0
    for axis in range(3):
        cost, n = cheapest(bins, SAH_BINS * axis, sizes[SAH_BINS * axis :], n_bins, tree.areas)
        if cost < least:
            least, start, cut = cost, SAH_BINS * axis, SAH_BINS * axis + n
    is_cut, middle = least < np.inf, (first + last) // 2  # infinite where all centres coincide
    if is_cut:
        middle = first + partition(leaves[first:last], tree.keys[start // SAH_BINS * len(leaves) :], cut, tree.spare)
    for part in range(2):
        begin, end = (middle, last) if part else (first, middle)
        if end - begin > 1:
            if is_cut:
                joined = joined_rows(bins, tree.numbers, cut if part else start, start + n_bins if part else cut)
            else:
                joined = joined_rows(rows, leaves, begin, end)
            store(tree.rows, ROW * (span + middle - first if part else span + 1), joined)
    return middle


# Its collapse


@always_inline
def _rows_of_halves(span, tree):
    """Return the rows of costs of the two halves of a span."""
    first, middle, last = tree.spans[span, 0], tree.spans[span, 1], tree.spans[span, 2]
    leaf = len(tree.costs) - 1
    one = span + 1 if middle - first > 1 else leaf
    other = span + middle - first if last - middle > 1 else leaf
    return one, other


@device_function
def _sum_costs(span, tree):
    """Fill in the costs of a span whose halves have theirs: j roots are in its first half, the others in its second."""
    costs, (one, other) = tree.costs, _rows_of_halves(span, tree)
    least = splat(F32_MAX)
    for j in range(1, LEAF):  # lanes of up to j roots read infinity
        split = load(costs, COSTS * other + LEAF - j) + splat(load_scalar(costs, COSTS * one + LEAF + j - 1))
        least = minimum(split, least)
    store(costs, COSTS * span + LEAF, least)
    whole = half_area(tree.rows, span) + load_scalar(costs, COSTS * span + COSTS - 1)
    store(costs, COSTS * span + LEAF, minimum(least, splat(whole)))


@device_function
def _collapse(rows, tree):
    """Make nodes of the spans that cost least, parents before children."""
    todo, stack, costs, spans = tree.todo, tree.stack, tree.costs, tree.spans
    n_leaves, n_todo, n_nodes, most = len(tree.leaves), 1, 1, 0
    todo[0, 0], todo[0, 1], todo[0, 2] = 0, 0, 1
    while n_todo > 0:
        n_todo -= 1
        top, node, depth = todo[n_todo, 0], todo[n_todo, 1], todo[n_todo, 2]
        most = max(most, depth)
        n, n_stacked = 0, min(n_leaves, 1)
        for row in range(2 * UPPER):  # empty boxes, until there are children
            store(tree.boxes, LEAF * (6 * node + row), splat(F32_MAX if row < UPPER else -F32_MAX))
        stack[0, 0], stack[0, 1] = top if n_leaves > 1 else ~0, LEAF
        while n_stacked > 0:
            n_stacked -= 1
            span, roots = stack[n_stacked, 0], stack[n_stacked, 1]
            is_leaf = span < 0
            if is_leaf or (span != top and not costs[span, LEAF + roots - 1] < costs[span, LEAF]):
                boxes, row = (rows, ~span) if is_leaf else (tree.rows, span)
                for axis in range(3):
                    tree.boxes[6 * node + axis, n] = boxes[ROW * row + axis]
                    tree.boxes[6 * node + UPPER + axis, n] = -boxes[ROW * row + UPPER + axis]
                tree.children[LEAF * node + n] = span if is_leaf else n_nodes
                n += 1
                if not is_leaf:
                    todo[n_todo, 0], todo[n_todo, 1], todo[n_todo, 2] = span, n_nodes, depth + 1
                    n_todo += 1
                    n_nodes += 1
            else:
                one, other = _rows_of_halves(span, tree)
                j = _best_share(costs, one, other, roots)
                first, middle, last = spans[span, 0], spans[span, 1], spans[span, 2]
                stack[n_stacked, 0] = other if last - middle > 1 else ~np.int64(tree.leaves[middle])
                stack[n_stacked, 1] = roots - j
                stack[n_stacked + 1, 0] = one if middle - first > 1 else ~np.int64(tree.leaves[first])
                stack[n_stacked + 1, 1] = j
                n_stacked += 2
        tree.n_children[node] = n
    tree.totals[0], tree.totals[1] = n_nodes, most


@device_function
def _best_share(costs, one, other, roots):
    """Return how many of a number of roots the first half gets at the least cost."""
    least, share = np.float32(np.inf), 1
    for j in range(1, roots):
        cost = costs[one, LEAF + j - 1] + costs[other, LEAF + roots - j - 1]
        if cost < least:
            least, share = cost, j
    return share
