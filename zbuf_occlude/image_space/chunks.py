"""Chunks of packets: lists of the clusters before them, narrowed for each, that their packets go through."""

import numpy as np
from numba import njit

from zbuf_occlude.image_space.hiding import classify
from zbuf_occlude.image_space.listing import list_clusters, overlapping
from zbuf_occlude.image_space.packet_search import row_of, search_packet, write
from zbuf_occlude.image_space.packets import CHUNK, PACKET
from zbuf_occlude.image_space.projection import (
    COORDINATE,
    FAR,
    ONE,
    ZERO,
    distance_bounds,
    project_boxes,
    project_points,
)
from zbuf_occlude.image_space.slots import slot_of
from zbuf_occlude.image_space.workspace import GROUP
from zbuf_occlude.lanes import first_lane

NEAR = np.float32(1e-3)
"""Points nearer to an eye inside than this times their reach are decided in float64 altogether."""

SHARED = 4
"""Chunks that share a list of clusters."""

TIGHT = 256
"""Lists of at most so many clusters get the rectangles of the projected faces."""

SHORT = 96
"""Lists of at most so many clusters are narrowed for a chunk before its packets go through them."""


@njit(_nrt=False)
def search_chunks(scene, points, n_left, frame, window, eye, world_eye, reach, inside, space, epoch, answer):  # type: ignore[no-untyped-def]
    """Answer for the first `n_left` packets of ``space.left``."""
    contact = np.float32(scene.contact)
    n_chunks = -(-n_left // CHUNK)
    for first in range(0, n_chunks, GROUP):
        last = min(first + GROUP, n_chunks)
        box_chunks(points, first, last, n_left, space)
        if inside:
            for chunk in range(first, last):
                whole = project_points(points, chunk, n_left, frame, window, NEAR, eye, reach, contact, space)
                for i in range(9):
                    space.chunks[chunk - first, i] = whole[i]
        else:
            project_chunks(points, last - first, frame, window, eye, contact, space)
        for start in range(first, last, SHARED):
            stop = min(start + SHARED, last)
            whole = join(space.chunks, start - first, stop - first)
            if whole[4] < ZERO:
                continue
            n_before = list_clusters(scene, whole, space)
            if n_before <= TIGHT:
                n_before = tighten(scene, n_before, frame, window, eye, reach, space, epoch)
            for chunk in range(start, stop):
                search_chunk(
                    scene,
                    points,
                    chunk,
                    n_left,
                    n_before,
                    frame,
                    window,
                    eye,
                    world_eye,
                    reach,
                    inside,
                    contact,
                    space,
                    epoch,
                    answer,
                )


@njit(_nrt=False)
def box_chunks(points, first, last, n_left, space):  # type: ignore[no-untyped-def]
    """Fill ``space.chunk_boxes`` and ``space.chunk_own`` for up to 16 chunks, and their reach in ``space.chunks``."""
    for chunk in range(first, last):
        to = chunk - first
        reach, first_own, last_own = ZERO, np.int32(1 << 30), np.int32(-1)
        for axis in range(3):
            space.chunk_boxes[axis, to], space.chunk_boxes[3 + axis, to] = FAR, -FAR
        for at in range(chunk * CHUNK, min((chunk + 1) * CHUNK, n_left)):
            packet = space.left[at]
            reach = max(reach, points.reach[packet])
            first_own = min(first_own, points.own[packet * PACKET])  # own faces ascend in a packet
            last_own = max(last_own, points.own[packet * PACKET + PACKET - 1])
            for axis in range(3):
                space.chunk_boxes[axis, to] = min(space.chunk_boxes[axis, to], points.boxes[axis, packet])
                space.chunk_boxes[3 + axis, to] = max(space.chunk_boxes[3 + axis, to], points.boxes[3 + axis, packet])
        space.chunks[to, 6] = reach
        space.chunk_own[to, 0], space.chunk_own[to, 1] = first_own, last_own


@njit(_nrt=False)
def project_chunks(points, n, frame, window, eye, contact, space):  # type: ignore[no-untyped-def]
    """Fill the other columns of ``space.chunks`` from the boxes of n chunks, for an eye outside."""
    slack = COORDINATE * points.farthest
    project_boxes(space.chunk_boxes, 0, GROUP, frame, window, slack, space.chunk_rectangles, 0)
    for i in range(n):
        for row in range(4):
            space.chunks[i, row] = space.chunk_rectangles[row, i]
        space.chunks[i, 4] = space.chunk_rectangles[5, i]
        space.chunks[i, 5] = space.chunks[i, 6] / min(ONE, space.chunk_rectangles[4, i])
        space.chunks[i, 7], space.chunks[i, 8] = distance_bounds(space.chunk_boxes, i, eye, contact)


@njit(_nrt=False, forceinline=True)
def join(rows, first, last):  # type: ignore[no-untyped-def]
    """Rectangle and highest w of several chunks, as the first five of the numbers of one; of those with points left."""
    x0, x1, y0, y1, w1 = FAR, -FAR, FAR, -FAR, -ONE
    for i in range(first, last):
        if rows[i, 4] < ZERO:
            continue
        x0, x1, y0, y1 = min(x0, rows[i, 0]), max(x1, rows[i, 1]), min(y0, rows[i, 2]), max(y1, rows[i, 3])
        w1 = max(w1, rows[i, 4])
    return x0, x1, y0, y1, w1


@njit(_nrt=False)
def tighten(scene, n_before, frame, window, eye, reach, space, epoch):  # type: ignore[no-untyped-def]
    """Replace the rectangles of listed clusters' boxes by those of their projected faces; return how many."""
    for j in range(n_before):
        slot = slot_of(scene, space.before[j], frame, window, eye, reach, space, epoch)
        for row in range(5):
            space.before_rectangles[row, j] = space.slot_rectangles[slot, row]
    return n_before


@njit(_nrt=False, forceinline=True)
def search_chunk(  # type: ignore[no-untyped-def]
    scene, points, chunk, n_left, n_before, frame, window, eye, world_eye, reach, inside, contact, space, epoch, answer
):
    """Answer for one chunk, given the clusters before it and its neighbours."""
    whole = row_of(space.chunks, chunk % GROUP)
    if whole[4] < ZERO:
        return
    n_listed = choose(space, n_before, whole)
    if n_listed <= SHORT:
        n_listed = narrow(scene, chunk, whole, n_listed, frame, window, eye, reach, space, epoch)
    if n_listed == 0:
        return
    project_points(points, chunk, n_left, frame, window, NEAR if inside else ZERO, eye, reach, contact, space)
    for packet in range(CHUNK):
        if not space.undecided[packet]:
            continue
        index = space.left[chunk * CHUNK + packet]
        space.undecided[packet] &= ~np.int64(space.decided[index])
        hidden = space.undecided[packet]
        if n_listed > 0:
            hidden = search_packet(
                scene, points, index, packet, n_listed, frame, window, eye, world_eye, reach, space, epoch
            )
        write(points, index * PACKET, hidden, answer)


@njit(_nrt=False, forceinline=True)
def choose(space, n_before, whole):  # type: ignore[no-untyped-def]
    """List those of the clusters in ``space.before`` that overlap a chunk or packet; return how many."""
    n_listed = 0
    for j in range(0, n_before, 16):
        found = overlapping(space.before_rectangles, j, whole)
        if n_before - j < 16:
            found &= (1 << (n_before - j)) - 1
        while found:
            entry = j + first_lane(found)
            found &= found - 1
            space.listed[n_listed] = space.before[entry]
            for row in range(5):
                space.listed_rectangles[row, n_listed] = space.before_rectangles[row, entry]
            n_listed += 1
    return n_listed


@njit(_nrt=False, forceinline=True)
def narrow(scene, chunk, whole, n_listed, frame, window, eye, reach, space, epoch):  # type: ignore[no-untyped-def]
    """Drop the clusters none of whose faces can hide anything of a chunk; return how many stay.

    -1: a face hides the whole chunk.
    """
    n, column = 0, chunk % GROUP
    for j in range(n_listed):
        cluster = space.listed[j]
        slot = slot_of(scene, cluster, frame, window, eye, reach, space, epoch)
        own = (space.chunk_own[column, 0] - 16 * cluster, space.chunk_own[column, 1] - 16 * cluster)
        maybe, covers = classify(
            space.slots, slot, space.doubtful[slot], scene.used[cluster], own, space.chunk_boxes, column, whole
        )
        if covers:
            return -1
        if maybe:
            space.listed[n] = cluster
            for row in range(5):
                space.listed_rectangles[row, n] = space.slot_rectangles[slot, row]
            n += 1
    return n
