"""The search: for each view the leaves before each packet of points, until every point is hidden or none is left."""

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.arrays import BoolArray, FloatArray, IntArray
from zbuf_occlude.exact.bvh import Bvh
from zbuf_occlude.exact.hide import NEAR_EYE, classify, find_hidden, hide_by_faces, hide_by_points, mark_near_points
from zbuf_occlude.exact.layout import (
    BOTTOM,
    CHUNK,
    COORDINATE_ERROR,
    DEPTHS,
    GROUP,
    LEAF,
    LEFT,
    NEAREST,
    PACKET,
    RIGHT,
    TOP,
    ZERO,
    Int64,
    flat,
    make_workspace,
    put,
)
from zbuf_occlude.exact.points import make_packets
from zbuf_occlude.exact.project import is_empty, joined, project_boxes, project_packet, window_of_chunk
from zbuf_occlude.exact.single_rays import BLOCK_LINES, make_lines
from zbuf_occlude.exact.triangle_setup import set_up_for_points, slot_of
from zbuf_occlude.exact.view import project_eyes, view_of
from zbuf_occlude.geometry.hilbert import hilbert_order
from zbuf_occlude.geometry.sampling import SurfacePoints
from zbuf_occlude.jit.compiler import always_inline, device_function, inline_ir
from zbuf_occlude.jit.pointer import reference
from zbuf_occlude.jit.simd import count_lanes, first_lane, load, load3_wide, load_scalar, not_less, splat
from zbuf_occlude.jit.threads import n_blocks, n_threads, next_task, parallel_for, parallel_kernel, take_block

PAIRS_ALONE = 10_000
"""Up to this many pairs of eye and point the calling thread answers alone: waking others takes as long."""
MOST_PAIRS = 1 << 20
"""Pairs that are listed at a time."""
TIGHT_LEAVES = 1024
"""Lists of at most this many leaves get the rectangles of the projected faces."""
FEW_POINTS = 5
"""Up to this many points are tested one by one against all faces of a leaf."""


def find_visible(bvh: Bvh, points: SurfacePoints, eyes: FloatArray) -> BoolArray:
    """Return which of n points each of k eyes sees; (k, n) bool in the caller's order."""
    packets = make_packets(bvh, points)
    views = project_eyes(bvh, eyes, float(packets.farthest))
    n_eyes, wanted = len(eyes), 4 * n_threads()
    n_parts = 1 if n_eyes >= wanted else min(n_blocks(len(packets.chunk_reach), GROUP), wanted)
    answer = np.ones((n_eyes, len(points)), dtype=np.uint8)
    n_tasks = 1 if answer.size <= PAIRS_ALONE else n_eyes * n_parts
    sizes = len(bvh.used), len(bvh.n_children)
    parallel_for(_search_views, n_tasks, bvh, packets, views, n_parts, answer, own=lambda: make_workspace(*sizes))
    if (views.n_frames > 1).any():
        answer_pairs(bvh, points.positions, points.face_ids, eyes, np.nonzero(answer == NEAR_EYE), answer)
    return answer.view(bool)


def find_visible_one_by_one(bvh: Bvh, points: SurfacePoints, eyes: FloatArray) -> BoolArray:
    """Return the same, line of sight after line of sight; neighbours follow each other, and meet the same boxes."""
    answer, order = np.empty((len(eyes), len(points)), dtype=np.uint8), hilbert_order(points.positions)
    n_eyes = max(1, MOST_PAIRS // len(order))
    for first in range(0, len(eyes), n_eyes):
        some = np.arange(first, min(first + n_eyes, len(eyes)))
        pairs = np.repeat(some, len(order)), np.tile(order.astype(np.int64), len(some))
        answer_pairs(bvh, points.positions, points.face_ids, eyes, pairs, answer)
    return answer.view(bool)


def answer_pairs(
    bvh: Bvh,
    positions: FloatArray,
    face_ids: IntArray,
    eyes: FloatArray,
    pairs: tuple[Int64, ...],
    answer: NDArray[np.uint8],
) -> None:
    """Write the answers of pairs of eye and point, two arrays of their numbers, to (k, n)."""
    if len(pairs[0]):
        asked = positions, face_ids, np.ascontiguousarray(eyes), pairs[0], pairs[1], answer
        parallel_for(_look_along_lines, n_blocks(len(pairs[0]), BLOCK_LINES), bvh, *asked, own=lambda: make_lines(bvh))


@parallel_kernel
def _look_along_lines(tasks, bvh, positions, face_ids, eyes, which, chosen, answer, memory):
    """Take blocks of pairs of eye and point, and fill in the answers."""
    bvh_at, lines = reference(bvh), reference(memory)
    first, last = take_block(tasks, len(which), BLOCK_LINES)
    while first < last:
        for i in range(last - first):
            k, p = which[first + i], chosen[first + i]
            for axis in range(3):
                lines.origins[3 * i + axis], lines.points[3 * i + axis] = eyes[k, axis], positions[p, axis]
            lines.own[i] = face_ids[p]
        find_hidden(bvh_at, lines, last - first)
        for i in range(last - first):
            answer[which[first + i], chosen[first + i]] = lines.faces[i] < 0
        first, last = take_block(tasks, len(which), BLOCK_LINES)


@parallel_kernel
def _search_views(tasks, bvh, points, views, n_parts, answer, space):
    """Take eyes, or blocks of points for an eye, and write 0 where a point is hidden."""
    _search_tasks(tasks, reference(bvh), reference(points), views, n_parts, answer, space)


@inline_ir
def _search_tasks(tasks, bvh, points, views, n_parts, answer, space):
    n_chunks, n_groups = len(points.chunk_reach), -(-len(points.chunk_reach) // GROUP)
    task = next_task(tasks)
    while task < len(views.eyes) * n_parts:
        k, block = task // n_parts, task % n_parts
        first = n_groups * block // n_parts * GROUP
        last = min(n_groups * (block + 1) // n_parts * GROUP, n_chunks)
        for frame in range(views.n_frames[k]):
            _search_view(bvh, points, view_of(views, k, frame), (first, last), space, answer[k])
        task = next_task(tasks)


@inline_ir
def _search_view(bvh, points, frame, chunks, workspace, answer):
    """Answer for the chunks from one to another, in one frame of a view."""
    view, space = reference(frame), reference(workspace)
    _search_chunks(bvh, points, view, chunks, space, answer)
    if view.near > ZERO and view.number % 6 == 5:
        mark_near_points(points, view, chunks, answer)


@inline_ir
def _search_chunks(bvh, points, view, chunks, space, answer):
    """List the leaves before each group of chunks, choose from them for each, and take its packets through those."""
    rectangles = space.chunk_rectangles
    error = COORDINATE_ERROR * max(points.farthest, view.reach)
    for first in range(chunks[0], chunks[1], GROUP):
        last = min(first + GROUP, chunks[1])
        project_boxes(points.chunk_boxes, first, points.chunk_boxes.shape[1], view, error, rectangles, 0)
        window = window_of_chunk(first, view, rectangles)
        for chunk in range(first + 1, last):
            window = joined(window, window_of_chunk(chunk, view, rectangles))
        if is_empty(window):
            continue
        n_before = list_candidates(bvh, view, window, space)
        if n_before <= TIGHT_LEAVES:
            _tighten(bvh, n_before, view, space)
        for chunk in range(first, last):
            window = window_of_chunk(chunk, view, rectangles)
            n_listed = choose(n_before, window, space)
            if n_listed > 0 and not is_empty(window):
                _search_packets(bvh, points, view, chunk, n_listed, space, answer)


@inline_ir
def _search_packets(bvh, points, view, chunk, n, space, answer):
    """Take the packets of a chunk through the n listed leaves."""
    for packet in range(chunk * CHUNK, (chunk + 1) * CHUNK):
        base = packet * PACKET
        if base >= points.n_points:
            return
        extent, undecided = project_packet(bvh, points, packet, view, space.image)
        if undecided:
            hidden = _search_packet(bvh, points, view, undecided, extent, n, space)
            for i in range(base, min(base + PACKET, points.n_points)):
                answer[points.order[i]] &= ~(hidden >> (i - base)) & 1


@always_inline
def _search_packet(bvh, points, view, undecided, extent, n, space):
    """Go through the n listed leaves until every point of a packet is hidden; return the mask of the hidden ones."""
    found_hidden = 0
    # more than a coordinate, or its sum with this, can err
    error = np.float32(1.5) * COORDINATE_ERROR * extent.blur * view.reach
    seen = load3_wide(space.image, 0, PACKET)
    least = seen[0] - error, seen[1] - error
    most = seen[0] + error, seen[1] + error, seen[2] + error
    for j in range(0, n, LEAF):
        found = overlapping(space.listed.rectangles, j, space.listed.rectangles.shape[1], extent)
        if n - j < LEAF:
            found &= (1 << (n - j)) - 1
        while found:
            entry = j + first_lane(found)
            found &= found - 1
            within = undecided & _within(space.listed.rectangles, entry, least, most)
            if not within:
                continue
            hidden = _hide(bvh, points, view, within, extent, space.listed.leaves[entry], space)
            found_hidden |= hidden
            undecided &= ~hidden
            if not undecided:
                _promote(space.listed, entry)
                return found_hidden
    return found_hidden


@always_inline
def _within(bounds, entry, least, most):
    """Mask of the packet's points that are in a listed leaf's rectangle and not wholly before it.

    `least` and `most` are the points' x / w, y / w and w, less and more their error bound.
    """
    capacity = bounds.shape[1]
    return (
        not_less(most[0], load_scalar(bounds, LEFT * capacity + entry))
        & not_less(load_scalar(bounds, RIGHT * capacity + entry), least[0])
        & not_less(most[1], load_scalar(bounds, BOTTOM * capacity + entry))
        & not_less(load_scalar(bounds, TOP * capacity + entry), least[1])
        & not_less(most[2], load_scalar(bounds, NEAREST * capacity + entry))
    )


@always_inline
def _hide(bvh, points, view, within, extent, leaf, space):
    """Mask of the packet's points, of those within, that some face of a leaf hides."""
    slot = slot_of(bvh, leaf, view, space, set_up_for_points)
    n_within = count_lanes(within)
    if n_within > FEW_POINTS:
        maybe, covers = classify(bvh, points, space, slot, leaf, extent)
        if covers or not maybe:
            return within if covers else 0
        if count_lanes(maybe) <= n_within:
            return hide_by_faces(bvh, points, view, space, (leaf, slot), maybe, within, extent)
    return hide_by_points(bvh, points, view, space, (leaf, slot), within, extent)


@always_inline
def _promote(listed, entry):
    """Move a leaf to the front of the list: what hides a packet is likely to hide the next."""
    listed.leaves[0], listed.leaves[entry] = listed.leaves[entry], listed.leaves[0]
    for row in range(6):
        first, other = listed.rectangles[row, 0], listed.rectangles[row, entry]
        listed.rectangles[row, 0], listed.rectangles[row, entry] = other, first


# Candidate lists: the leaves that may hide something in a window, nearest first


@device_function
def project_children(bvh, node, view, space):
    """Fill ``space.rectangles`` for the children of a node, unless this view did."""
    if space.projected[node] != view.number:
        space.projected[node] = view.number
        at, error = 6 * LEAF * node, COORDINATE_ERROR * view.reach
        project_boxes(bvh.boxes, at, LEAF, view, error, space.rectangles, at)


@always_inline
def overlapping(rectangles, i, total, window):
    """Mask of the 16 rectangles, `total` numbers apart from a flat index on, that overlap a window, not behind it."""
    return (
        not_less(splat(window.right), load(rectangles, LEFT * total + i))
        & not_less(load(rectangles, RIGHT * total + i), splat(window.left))
        & not_less(splat(window.top), load(rectangles, BOTTOM * total + i))
        & not_less(load(rectangles, TOP * total + i), splat(window.bottom))
        & not_less(splat(window.farthest), load(rectangles, NEAREST * total + i))
    )


@device_function
def list_candidates(bvh, view, window, space):
    """Descend through the nodes to the leaves that overlap a window; fill ``space.before``, return how many."""
    stack, found_at, n, n_nodes = space.scratch[0], space.scratch[1], np.int64(0), np.int64(1)
    stack[0] = 0
    while n_nodes > 0:
        n_nodes -= 1
        node = np.int64(stack[n_nodes])
        project_children(bvh, node, view, space)
        found = overlapping(space.rectangles, 6 * LEAF * node, LEAF, window) & ((1 << bvh.n_children[node]) - 1)
        while found:
            i = LEAF * node + first_lane(found)
            found &= found - 1
            if bvh.children[i] < 0:
                found_at[n] = i
                n += 1
            else:
                stack[n_nodes] = bvh.children[i]
                n_nodes += 1
    _sort_by_depth(found_at, stack, n, window.farthest, space)
    for j in range(n):
        put(space.before, j, ~bvh.children[stack[j]], space.rectangles, flat(np.int64(stack[j])), LEAF)
    return n


@device_function
def _sort_by_depth(slots, nearest_first, n, farthest, space):
    """Sort the slots of n leaves by their lowest w, into `DEPTHS` intervals of it up to `farthest`."""
    w, starts, bounds = NEAREST * LEAF, space.depth_starts, space.rectangles
    nearest = farthest
    for j in range(n):
        nearest = min(nearest, load_scalar(bounds, w + flat(np.int64(slots[j]))))
    nearest = max(nearest, ZERO)
    scale = np.float32(DEPTHS - 1) / max(farthest - nearest, np.float32(1e-30))
    starts[:] = 0
    for j in range(n):
        starts[np.int64(max(load_scalar(bounds, w + flat(np.int64(slots[j]))) - nearest, ZERO) * scale) + 1] += 1
    for i in range(DEPTHS):
        starts[i + 1] += starts[i]
    for j in range(n):
        depth = np.int64(max(load_scalar(bounds, w + flat(np.int64(slots[j]))) - nearest, ZERO) * scale)
        nearest_first[starts[depth]] = slots[j]
        starts[depth] += 1


@device_function
def _tighten(bvh, n, view, space):
    """Replace the rectangles of the n leaves in ``space.before`` by those of their projected faces."""
    for j in range(n):
        leaf = space.before.leaves[j]
        slot = slot_of(bvh, leaf, view, space, set_up_for_points)
        put(space.before, j, leaf, space.slot_rectangles, slot, len(space.slot_tags))


@device_function
def choose(n, window, space):
    """List in ``space.listed`` those of the n leaves in ``space.before`` that overlap a window; return how many."""
    n_listed, capacity = np.int64(0), space.before.rectangles.shape[1]
    for j in range(0, n, LEAF):
        found = overlapping(space.before.rectangles, j, capacity, window)
        if n - j < LEAF:
            found &= (1 << (n - j)) - 1
        while found:
            entry = j + first_lane(found)
            found &= found - 1
            put(space.listed, n_listed, space.before.leaves[entry], space.before.rectangles, entry, capacity)
            n_listed += 1
    return n_listed
