"""The search: for every chunk and packet of points the clusters before it, until something hides its points."""

from typing import NamedTuple

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from zbuf_occlude.arrays import BoolArray
from zbuf_occlude.image_space.decide import line_is_blocked
from zbuf_occlude.image_space.frames import Frames
from zbuf_occlude.image_space.hiding import classify
from zbuf_occlude.image_space.listing import BUCKETS, drop_turned, list_clusters, overlapping
from zbuf_occlude.image_space.packet_search import hide_backs, row_of, search_packet, write
from zbuf_occlude.image_space.packets import CHUNK, PACKET, Packets
from zbuf_occlude.image_space.projection import (
    COORDINATE,
    FAR,
    ONE,
    ROWS,
    ZERO,
    distance_bounds,
    project_boxes,
    project_points,
)
from zbuf_occlude.image_space.scene import Float32, Scene
from zbuf_occlude.image_space.slots import SLOTS, slot_of
from zbuf_occlude.image_space.tiles import make_tiles, search_tiles
from zbuf_occlude.lanes import ALL, first_lane
from zbuf_occlude.threads import threaded

NEAR = np.float32(1e-3)
"""Points nearer to an eye inside than this times their reach are decided in float64 altogether."""

GROUP = 16
"""Chunks whose boxes are projected at once."""

FEW_POINTS = 4
"""With fewer points than so many times the faces, an eye outside goes by tiles."""

SHARED = 4
"""Chunks that share a list of clusters."""

TIGHT = 256
"""Lists of at most so many clusters get the rectangles of the projected faces."""

SHORT = 96
"""Lists of at most so many clusters are narrowed for a chunk before its packets go through them."""


class Workspace(NamedTuple):
    """What one thread needs: up to 4 MB of set-ups, and about 5 bytes a face."""

    rectangles: Float32  # (6, total nodes)
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
    turned: NDArray[np.int64]  # (packets,) masks of the points that are hidden as backs
    buckets: NDArray[np.int64]  # (BUCKETS + 1,)


@threaded
def find_visible(scene: Scene, points: Packets, frames: Frames, n_blocks: int, n_workers: int) -> BoolArray:
    """Answer for all points and eyes.

    Parameters
    ----------
    scene, points, frames : what `make_scene`, `make_packets`, `make_frames` made
    n_blocks : int
        Parts into which the points are cut, for few eyes and many threads.
    n_workers : int
        Threads.

    Returns
    -------
    (k, n) bool, True = visible.
    """
    n_eyes = len(frames.matrices)
    answer = np.ones((n_eyes, points.n_points), dtype=np.bool_)
    n_groups = -(-points.coordinates.shape[1] // (GROUP * CHUNK * PACKET))
    few = points.n_points < FEW_POINTS * len(scene.world_corners)
    for worker in prange(n_workers):
        space = make_workspace(scene, len(points.backed))
        tiles = make_tiles(points.coordinates.shape[1] if few else 0, len(scene.used) if few else 0)
        epoch = 0
        for task in range(worker, n_eyes * n_blocks, n_workers):
            view, block = task // n_blocks, task % n_blocks
            begin, end = n_groups * block // n_blocks, n_groups * (block + 1) // n_blocks
            for face in range(frames.n_frames[view]):
                epoch += 1
                search_frame(
                    scene,
                    points,
                    frames.matrices[view, face],
                    frames.windows[view],
                    frames.eyes[view],
                    face if frames.n_frames[view] > 1 else -1,
                    begin,
                    end,
                    few,
                    space,
                    tiles,
                    epoch,
                    answer[view],
                )
    return answer


@njit
def make_workspace(scene, n_packets):  # type: ignore[no-untyped-def]
    """Allocate a thread's workspace."""
    n_clusters = len(scene.used)
    n_slots = 1
    while n_slots < min(n_clusters, SLOTS):
        n_slots *= 2
    return Workspace(
        np.empty((6, scene.nodes.shape[1]), dtype=np.float32),
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
        np.zeros(n_packets, dtype=np.int64),
        np.zeros(BUCKETS + 1, dtype=np.int64),
    )


# _nrt=False: the kernels allocate nothing, and counting references to their arrays would cost more than the geometry


@njit(_nrt=False)
def search_frame(scene, points, frame, window, e, face, begin, end, few, space, tiles, epoch, answer):  # type: ignore[no-untyped-def]
    """Answer for the groups begin to end in one frame of an eye; writes False where a point is hidden.

    `face` is the number of the cube's face, -1 for an eye outside; `few` whether that one goes by tiles.
    """
    inside = face >= 0
    eye = (np.float32(e[0]), np.float32(e[1]), np.float32(e[2]))
    world_eye = (
        e[0] / scene.scale + scene.centre[0],
        e[1] / scene.scale + scene.centre[1],
        e[2] / scene.scale + scene.centre[2],
    )
    reach = ONE
    if inside:
        reach = max(ONE, np.float32(1.001 * np.sqrt(e[0] * e[0] + e[1] * e[1] + e[2] * e[2])))
    contact = np.float32(scene.contact)
    project_boxes(scene.nodes, 0, scene.nodes.shape[1], frame, window, COORDINATE * reach, space.rectangles, 0)
    for level in range(len(scene.level_counts)):
        first = scene.level_starts[level] + scene.level_counts[level]
        for i in range(first, first + (-first % 16)):  # padding
            space.rectangles[0, i] = FAR
            space.rectangles[1, i] = -FAR
    if not inside:
        n_packets = points.coordinates.shape[1] // PACKET
        if points.on_faces:
            drop_turned(scene, eye, space.rectangles)
        hide_backs(points, begin * GROUP * CHUNK, min(end * GROUP * CHUNK, n_packets), eye, space.turned, answer)
    if few and not inside:
        size = GROUP * CHUNK * PACKET
        first, last = begin * size, min(end * size, points.n_points)
        search_tiles(scene, points, frame, window, eye, world_eye, first, last, space, tiles, epoch, answer)
        return
    for group in range(begin, end):
        first, last = group * GROUP, min((group + 1) * GROUP, points.coordinates.shape[1] // (CHUNK * PACKET))
        if inside:
            for chunk in range(first, last):
                if face == 0:
                    hide_near(scene, points, chunk, eye, reach, world_eye, answer)
                whole = project_points(points, chunk, frame, window, NEAR, eye, reach, contact, space)
                for i in range(9):
                    space.chunks[chunk - first, i] = whole[i]
        else:
            project_chunks(points, first, last, frame, window, eye, contact, space)
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
def project_chunks(points, first, last, frame, window, eye, contact, space):  # type: ignore[no-untyped-def]
    """Fill the rows of `space.chunks` from the boxes of up to 16 chunks, for an eye outside; see `hide_backs`."""
    slack = COORDINATE * points.farthest
    project_boxes(points.chunk_boxes, first, first + GROUP, frame, window, slack, space.chunk_rectangles, 0)
    for i in range(last - first):
        reach = points.chunk_reach[first + i]
        for row in range(4):
            space.chunks[i, row] = space.chunk_rectangles[row, i]
        space.chunks[i, 4] = space.chunk_rectangles[5, i]
        space.chunks[i, 5] = reach / min(ONE, space.chunk_rectangles[4, i])
        space.chunks[i, 6] = reach
        space.chunks[i, 7], space.chunks[i, 8] = distance_bounds(points.chunk_boxes, first + i, eye, contact)
        everything = ALL
        for packet in range((first + i) * CHUNK, (first + i + 1) * CHUNK):
            everything &= space.turned[packet]
        if everything == ALL:
            space.chunks[i, 4] = -ONE


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
    scene, points, chunk, n_before, frame, window, eye, world_eye, reach, inside, contact, space, epoch, answer
):
    """Answer for one chunk, given the clusters before it and its neighbours."""
    whole = row_of(space.chunks, chunk % GROUP)
    if whole[4] < ZERO:
        return
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
    narrowed = n_listed <= SHORT
    if narrowed:
        n_listed = narrow(scene, points, chunk, whole, n_listed, frame, window, eye, reach, space, epoch)
    if n_listed == 0:
        return
    if inside:
        project_points(points, chunk, frame, window, NEAR, eye, reach, contact, space)
    if n_listed < 0:
        for packet in range(CHUNK):
            base = (chunk * CHUNK + packet) * PACKET
            left = points.n_points - base
            if inside:
                write(points, base, space.undecided[packet], answer)
            elif left > 0:
                write(points, base, (1 << min(left, PACKET)) - 1, answer)
        return
    if not inside:
        project_points(points, chunk, frame, window, ZERO, eye, reach, contact, space)
        for packet in range(CHUNK):
            space.undecided[packet] &= ~space.turned[chunk * CHUNK + packet]
    for packet in range(CHUNK):
        if space.undecided[packet]:
            search_packet(
                scene, points, chunk, packet, n_listed, frame, window, eye, world_eye, reach, space, epoch, answer
            )


@njit(_nrt=False)
def hide_near(scene, points, chunk, eye, reach, world_eye, answer):  # type: ignore[no-untyped-def]
    """Decide the points about the eye in float64; frames do not resolve them."""
    for index in range(chunk * CHUNK, (chunk + 1) * CHUNK):
        radius = NEAR * max(points.reach[index], reach) * np.float32(1.01)
        apart = ZERO
        for axis in range(3):
            apart = max(apart, points.boxes[axis, index] - eye[axis], eye[axis] - points.boxes[3 + axis, index])
        if apart > radius:
            continue
        for i in range(index * PACKET, min((index + 1) * PACKET, points.n_points)):
            away = max(
                abs(points.coordinates[0, i] - eye[0]),
                abs(points.coordinates[1, i] - eye[1]),
                abs(points.coordinates[2, i] - eye[2]),
            )
            if away <= radius:
                k = points.order[i]
                point = (points.positions[k, 0], points.positions[k, 1], points.positions[k, 2])
                margin = 1e-12 * (1.0 + reach) / scene.scale
                for axis in range(3):
                    margin += 1e-12 * abs(scene.centre[axis])
                own = points.own[i]
                if line_is_blocked(
                    world_eye,
                    point,
                    scene.face_ids[own // 16, own % 16] if own >= 0 else -1,
                    scene.face_ids,
                    scene.lower,
                    scene.upper,
                    scene.world_corners,
                    scene.world_contact,
                    margin,
                ):
                    answer[k] = False


@njit(_nrt=False, forceinline=True)
def narrow(scene, points, chunk, whole, n_listed, frame, window, eye, reach, space, epoch):  # type: ignore[no-untyped-def]
    """Drop the clusters none of whose faces can hide anything of a chunk; return how many stay.

    -1: a face hides the whole chunk.
    """
    n, first, last = 0, chunk * CHUNK * PACKET, (chunk + 1) * CHUNK * PACKET - 1  # own faces ascend
    for j in range(n_listed):
        cluster = space.listed[j]
        slot = slot_of(scene, cluster, frame, window, eye, reach, space, epoch)
        own = (points.own[first] - 16 * cluster, points.own[last] - 16 * cluster)
        maybe, covers = classify(
            space.slots, slot, space.doubtful[slot], scene.used[cluster], own, points.chunk_boxes, chunk, whole
        )
        if covers:
            return -1
        if maybe:
            space.listed[n] = cluster
            for row in range(5):
                space.listed_rectangles[row, n] = space.slot_rectangles[slot, row]
            n += 1
    return n
