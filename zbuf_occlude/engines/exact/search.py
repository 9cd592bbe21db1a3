"""Visibility search: each packet of points against the leaves in front of it, until all points are hidden."""

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.base.arrays import BoolArray, FloatArray, IntArray
from zbuf_occlude.base.jit.compiler import always_inline, device_function, inline_ir
from zbuf_occlude.base.jit.pointer import pointer_to
from zbuf_occlude.base.jit.simd import count_lanes, first_lane, load, load3_wide, load_scalar, not_less, splat
from zbuf_occlude.base.jit.threads import n_blocks, n_threads, next_task, parallel_for, parallel_kernel, take_block
from zbuf_occlude.base.precompiler import Compilation
from zbuf_occlude.engines.exact.bvh import Bvh, empty_bvh
from zbuf_occlude.engines.exact.hide import (
    UNDECIDED,
    classify,
    find_hidden,
    hide_by_faces,
    hide_by_points,
    mark_near_points,
)
from zbuf_occlude.engines.exact.layout import (
    BOTTOM,
    CHUNK,
    COORDINATE_ERROR,
    DEPTHS,
    GROUP,
    LEAF,
    LEFT,
    MIN_W,
    PACKET,
    RIGHT,
    TOP,
    ZERO,
    Int64,
    flat,
    make_workspace,
    put,
)
from zbuf_occlude.engines.exact.points import make_packets
from zbuf_occlude.engines.exact.project import is_empty, project_boxes, project_packet, rect_of_chunk, union
from zbuf_occlude.engines.exact.single_rays import TRAVERSAL_RAYS, make_traversal_scratch
from zbuf_occlude.engines.exact.triangle_setup import set_up_for_points, slot_of
from zbuf_occlude.engines.exact.view import project_eyes, view_of
from zbuf_occlude.geometry.hilbert import hilbert_order
from zbuf_occlude.meshes.sampling import SurfacePoints

SINGLE_THREAD_PAIRS = 10_000
"""Maximum pairs of eye and point that the calling thread answers alone: waking other threads takes as long."""
MAX_PAIRS = 1 << 20
"""Maximum pairs of eye and point per list."""
TIGHT_LEAVES = 1024
"""Maximum leaves of a list whose rectangles are tightened around the projected faces."""
MAX_SINGLE_POINTS = 5
"""Maximum points of a packet that are tested one by one against all faces of a leaf."""


def find_visible(bvh: Bvh, points: SurfacePoints, eyes: FloatArray) -> BoolArray:
    """Return which of n points each of k eyes sees; (k, n) bool in the caller's order."""
    packets = make_packets(bvh, points)
    views = project_eyes(bvh, eyes, float(packets.max_magnitude))
    n_eyes, wanted = len(eyes), 4 * n_threads()
    n_parts = 1 if n_eyes >= wanted else min(n_blocks(len(packets.chunk_magnitudes), GROUP), wanted)
    answer = np.ones((n_eyes, len(points)), dtype=np.uint8)
    n_tasks = 1 if answer.size <= SINGLE_THREAD_PAIRS else n_eyes * n_parts
    sizes = len(bvh.used), len(bvh.n_children)
    parallel_for(_search_views, n_tasks, bvh, packets, views, n_parts, answer, own=lambda: make_workspace(*sizes))
    if (views.n_frames > 1).any():
        answer_pairs(bvh, points.positions, points.face_ids, eyes, np.nonzero(answer == UNDECIDED), answer)
    return answer.view(bool)


def compile_search() -> None:
    """Compile the search of points, by a question without eyes about a mesh without faces."""
    find_visible(empty_bvh(), SurfacePoints.free(np.zeros((1, 3))), np.empty((0, 3)))


def find_visible_one_by_one(bvh: Bvh, points: SurfacePoints, eyes: FloatArray) -> BoolArray:
    """Return the answers of `find_visible`, each line of sight tested alone, in an order that meets the same boxes."""
    answer, order = np.empty((len(eyes), len(points)), dtype=np.uint8), hilbert_order(points.positions)
    n_eyes = max(1, MAX_PAIRS // len(order))
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
    """Write the answers of pairs, an array of eye and one of point indices, to `answer`, (k, n)."""
    if len(pairs[0]):
        asked = positions, face_ids, np.ascontiguousarray(eyes), pairs[0], pairs[1], answer
        parallel_for(
            _test_lines_of_sight,
            n_blocks(len(pairs[0]), TRAVERSAL_RAYS),
            bvh,
            *asked,
            own=lambda: make_traversal_scratch(bvh),
        )


@parallel_kernel
def _test_lines_of_sight(tasks, bvh, positions, face_ids, eyes, which, chosen, answer, memory):
    """Answer blocks of pairs of eye and point."""
    bvh_at, scratch = pointer_to(bvh), pointer_to(memory)
    first, last = take_block(tasks, len(which), TRAVERSAL_RAYS)
    while first < last:
        for i in range(last - first):
            k, p = which[first + i], chosen[first + i]
            for axis in range(3):
                scratch.origins[3 * i + axis], scratch.points[3 * i + axis] = eyes[k, axis], positions[p, axis]
            scratch.own[i] = face_ids[p]
        find_hidden(bvh_at, scratch, last - first)
        for i in range(last - first):
            answer[which[first + i], chosen[first + i]] = scratch.faces[i] < 0
        first, last = take_block(tasks, len(which), TRAVERSAL_RAYS)


@parallel_kernel
def _search_views(tasks, bvh, points, views, n_parts, answer, space):
    """Search eyes, or parts of the points for an eye; write 0 for hidden points."""
    _search_tasks(tasks, pointer_to(bvh), pointer_to(points), views, n_parts, answer, space)


@inline_ir
def _search_tasks(tasks, bvh, points, views, n_parts, answer, space):
    n_chunks, n_groups = len(points.chunk_magnitudes), -(-len(points.chunk_magnitudes) // GROUP)
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
    """Search a range of chunks in one frame of an eye."""
    view, space = pointer_to(frame), pointer_to(workspace)
    _search_chunks(bvh, points, view, chunks, space, answer)
    if view.near > ZERO and view.number % 6 == 5:
        mark_near_points(points, view, chunks, answer)


@inline_ir
def _search_chunks(bvh, points, view, chunks, space, answer):
    """List the leaves before each group of chunks, select from them for each chunk, and search its packets."""
    rectangles = space.chunk_rectangles
    error = COORDINATE_ERROR * max(points.max_magnitude, view.magnitude)
    for first in range(chunks[0], chunks[1], GROUP):
        last = min(first + GROUP, chunks[1])
        project_boxes(points.chunk_boxes, first, points.chunk_boxes.shape[1], view, error, rectangles, 0)
        rect = rect_of_chunk(first, view, rectangles)
        for chunk in range(first + 1, last):
            rect = union(rect, rect_of_chunk(chunk, view, rectangles))
        if is_empty(rect):
            continue
        n_before = list_candidates(bvh, view, rect, space)
        if n_before <= TIGHT_LEAVES:
            _tighten(bvh, n_before, view, space)
        for chunk in range(first, last):
            rect = rect_of_chunk(chunk, view, rectangles)
            n_listed = select_candidates(n_before, rect, space)
            if n_listed > 0 and not is_empty(rect):
                _search_packets(bvh, points, view, chunk, n_listed, space, answer)


@inline_ir
def _search_packets(bvh, points, view, chunk, n, space, answer):
    """Test the packets of a chunk against the n listed leaves."""
    for packet in range(chunk * CHUNK, (chunk + 1) * CHUNK):
        base = packet * PACKET
        if base >= points.n_points:
            return
        rect, undecided = project_packet(bvh, points, packet, view, space.image)
        if undecided:
            hidden = _search_packet(bvh, points, view, undecided, rect, n, space)
            while hidden:
                answer[points.order[base + first_lane(hidden)]] = 0
                hidden &= hidden - 1


@always_inline
def _search_packet(bvh, points, view, undecided, rect, n, space):
    """Test a packet against the n listed leaves until all its points are hidden; return the mask of hidden points."""
    found_hidden = 0
    # error bound of a coordinate and of its sum with this bound
    error = np.float32(1.5) * COORDINATE_ERROR * rect.error_scale * view.magnitude
    seen = load3_wide(space.image, 0, PACKET)
    least = seen[0] - error, seen[1] - error
    most = seen[0] + error, seen[1] + error, seen[2] + error
    for j in range(0, n, LEAF):
        found = overlapping(space.listed.rectangles, j, space.listed.rectangles.shape[1], rect)
        if n - j < LEAF:
            found &= (1 << (n - j)) - 1
        while found:
            entry = j + first_lane(found)
            found &= found - 1
            within = undecided & _within(space.listed.rectangles, entry, least, most)
            if not within:
                continue
            hidden = _hide(bvh, points, view, within, rect, space.listed.leaves[entry], space)
            found_hidden |= hidden
            undecided &= ~hidden
            if not undecided:
                _promote(space.listed, entry)
                return found_hidden
    return found_hidden


@always_inline
def _within(bounds, entry, least, most):
    """Return the mask of the packet's points in a listed leaf's rectangle that are not in front of it.

    `least` and `most` are bounds of the points' x / w and y / w; `most` has the upper bound of w too.
    """
    capacity = bounds.shape[1]
    return (
        not_less(most[0], load_scalar(bounds, LEFT * capacity + entry))
        & not_less(load_scalar(bounds, RIGHT * capacity + entry), least[0])
        & not_less(most[1], load_scalar(bounds, BOTTOM * capacity + entry))
        & not_less(load_scalar(bounds, TOP * capacity + entry), least[1])
        & not_less(most[2], load_scalar(bounds, MIN_W * capacity + entry))
    )


@always_inline
def _hide(bvh, points, view, within, rect, leaf, space):
    """Return the mask of the points `within` of a packet that some face of a leaf hides."""
    slot = slot_of(bvh, leaf, view, space, set_up_for_points)
    n_within = count_lanes(within)
    if n_within > MAX_SINGLE_POINTS:
        maybe, covers = classify(bvh, points, space, slot, leaf, rect)
        if covers or not maybe:
            return within if covers else 0
        if count_lanes(maybe) <= n_within:
            return hide_by_faces(bvh, points, view, space, (leaf, slot), maybe, within, rect)
    return hide_by_points(bvh, points, view, space, (leaf, slot), within, rect)


@always_inline
def _promote(listed, entry):
    """Move a leaf to the front of the list: a leaf that hides a packet is likely to hide the next."""
    listed.leaves[0], listed.leaves[entry] = listed.leaves[entry], listed.leaves[0]
    for row in range(6):
        first, other = listed.rectangles[row, 0], listed.rectangles[row, entry]
        listed.rectangles[row, 0], listed.rectangles[row, entry] = other, first


# Candidate lists: the leaves that may hide points in a rectangle, nearest first


@device_function
def project_children(bvh, node, view, space):
    """Fill ``space.rectangles`` for the children of a node, unless they are of this view already."""
    if space.projected[node] != view.number:
        space.projected[node] = view.number
        at, error = 6 * LEAF * node, COORDINATE_ERROR * view.magnitude
        project_boxes(bvh.boxes, at, LEAF, view, error, space.rectangles, at)


@always_inline
def overlapping(rectangles, i, total, rect):
    """Return the mask of the 16 rectangles, read from flat index `i`, that overlap `rect` and are not behind it."""
    return (
        not_less(splat(rect.right), load(rectangles, LEFT * total + i))
        & not_less(load(rectangles, RIGHT * total + i), splat(rect.left))
        & not_less(splat(rect.top), load(rectangles, BOTTOM * total + i))
        & not_less(load(rectangles, TOP * total + i), splat(rect.bottom))
        & not_less(splat(rect.max_w), load(rectangles, MIN_W * total + i))
    )


@device_function
def list_candidates(bvh, view, rect, space):
    """List the leaves that overlap a rectangle in ``space.before``; return their number."""
    stack, found_at, n, n_nodes = space.scratch[0], space.scratch[1], np.int64(0), np.int64(1)
    stack[0] = 0
    while n_nodes > 0:
        n_nodes -= 1
        node = np.int64(stack[n_nodes])
        project_children(bvh, node, view, space)
        found = overlapping(space.rectangles, 6 * LEAF * node, LEAF, rect) & ((1 << bvh.n_children[node]) - 1)
        while found:
            i = LEAF * node + first_lane(found)
            found &= found - 1
            if bvh.children[i] < 0:
                found_at[n] = i
                n += 1
            else:
                stack[n_nodes] = bvh.children[i]
                n_nodes += 1
    _sort_by_depth(found_at, stack, n, rect.max_w, space)
    for j in range(n):
        put(space.before, j, ~bvh.children[stack[j]], space.rectangles, flat(np.int64(stack[j])), LEAF)
    return n


@device_function
def _sort_by_depth(slots, nearest_first, n, max_w, space):
    """Sort the slots of n leaves by their smallest w, in `DEPTHS` intervals up to `max_w`."""
    w, starts, bounds = MIN_W * LEAF, space.depth_starts, space.rectangles
    nearest = max_w
    for j in range(n):
        nearest = min(nearest, load_scalar(bounds, w + flat(np.int64(slots[j]))))
    nearest = max(nearest, ZERO)
    scale = np.float32(DEPTHS - 1) / max(max_w - nearest, np.float32(1e-30))
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
    """Replace the rectangles of the n leaves in ``space.before`` by those around their projected faces."""
    for j in range(n):
        leaf = space.before.leaves[j]
        slot = slot_of(bvh, leaf, view, space, set_up_for_points)
        put(space.before, j, leaf, space.slot_rectangles, slot, len(space.slot_tags))


@device_function
def select_candidates(n, rect, space):
    """List the leaves in ``space.before`` that overlap a rectangle in ``space.listed``; return their number."""
    n_listed, capacity = np.int64(0), space.before.rectangles.shape[1]
    for j in range(0, n, LEAF):
        found = overlapping(space.before.rectangles, j, capacity, rect)
        if n - j < LEAF:
            found &= (1 << (n - j)) - 1
        while found:
            entry = j + first_lane(found)
            found &= found - 1
            put(space.listed, n_listed, space.before.leaves[entry], space.before.rectangles, entry, capacity)
            n_listed += 1
    return n_listed


SEARCH = Compilation(_search_views, compile_search)
