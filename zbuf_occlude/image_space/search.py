"""The search: for every chunk and packet of points the clusters before it, until something hides its points."""

from typing import NamedTuple

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from zbuf_occlude.arrays import BoolArray
from zbuf_occlude.image_space.decide import line_is_blocked
from zbuf_occlude.image_space.frames import Frames
from zbuf_occlude.image_space.hiding import classify, hide_by_face, hide_point, settle
from zbuf_occlude.image_space.lanes import ALL, count_lanes, first_lane, load, not_less, splat
from zbuf_occlude.image_space.listing import BUCKETS, list_clusters, overlapping
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
    set_up,
)
from zbuf_occlude.image_space.scene import Float32, Scene

NEAR = np.float32(1e-3)
"""Points nearer to an eye inside than this times their reach are decided in float64 altogether."""

SHORT = 96
"""Lists of at most so many clusters are narrowed for a chunk before its packets go through them."""

SLOTS = 4096
"""Set-ups of clusters kept at a time; a power of two."""


class Workspace(NamedTuple):
    """What one thread needs: up to 4 MB of set-ups, and about 5 bytes a face."""

    rectangles: Float32  # (6, total nodes)
    chunk_rectangles: Float32  # (6, 16)
    list_a: NDArray[np.int64]  # (clusters + 16,) scratch
    list_b: NDArray[np.int64]  # the same
    listed: NDArray[np.int64]  # the clusters before the current chunk, nearest first
    listed_rectangles: Float32  # (6, clusters + 16) theirs
    slots: Float32  # (n_slots x ROWS x 16,)
    slot_rectangles: Float32  # (n_slots, 5)
    tags: NDArray[np.int64]  # (n_slots,) which cluster, in which frame
    doubtful: NDArray[np.int64]  # (n_slots,)
    image: Float32  # (2 x CHUNK x PACKET,) x / w, then y / w of the chunk's points
    packets: Float32  # (CHUNK, 9) see `projection.project_points`
    undecided: NDArray[np.int64]  # (CHUNK,)
    buckets: NDArray[np.int64]  # (BUCKETS + 1,)


@njit(parallel=True, cache=True)
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
    n_chunks = points.coordinates.shape[1] // (CHUNK * PACKET)
    for worker in prange(n_workers):
        space = make_workspace(scene)
        epoch = 0
        for task in range(worker, n_eyes * n_blocks, n_workers):
            view, block = task // n_blocks, task % n_blocks
            begin, end = n_chunks * block // n_blocks, n_chunks * (block + 1) // n_blocks
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
                    space,
                    epoch,
                    answer[view],
                )
    return answer


@njit
def make_workspace(scene):  # type: ignore[no-untyped-def]
    """Allocate a thread's workspace."""
    n_clusters = len(scene.used)
    n_slots = 1
    while n_slots < min(n_clusters, SLOTS):
        n_slots *= 2
    return Workspace(
        np.empty((6, scene.nodes.shape[1]), dtype=np.float32),
        np.empty((6, 16), dtype=np.float32),
        np.empty(n_clusters + 16, dtype=np.int64),
        np.empty(n_clusters + 16, dtype=np.int64),
        np.empty(n_clusters + 16, dtype=np.int64),
        np.empty((6, n_clusters + 16), dtype=np.float32),
        np.empty(n_slots * ROWS * 16, dtype=np.float32),
        np.empty((n_slots, 5), dtype=np.float32),
        np.full(n_slots, -1, dtype=np.int64),
        np.zeros(n_slots, dtype=np.int64),
        np.zeros(2 * CHUNK * PACKET, dtype=np.float32),
        np.zeros((CHUNK, 9), dtype=np.float32),
        np.zeros(CHUNK, dtype=np.int64),
        np.zeros(BUCKETS + 1, dtype=np.int64),
    )


# _nrt=False: the kernels allocate nothing, and counting references to their arrays would cost more than the geometry


@njit(_nrt=False)
def search_frame(scene, points, frame, window, e, face, begin, end, space, epoch, answer):  # type: ignore[no-untyped-def]
    """Answer for the chunks begin to end in one frame of an eye; writes False where a point is hidden.

    `face` is the number of the cube's face, -1 for an eye outside.
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
    for chunk in range(begin, end):
        own_reach = max(points.chunk_reach[chunk], reach)
        if inside:
            if face == 0:
                hide_near(scene, points, chunk, eye, reach, world_eye, answer)
            whole = project_points(points, chunk, frame, window, NEAR, eye, reach, contact, space)
            if whole[4] < ZERO:
                continue
        else:
            if chunk == begin or chunk % 16 == 0:
                first = chunk - chunk % 16
                project_boxes(
                    points.chunk_boxes,
                    first,
                    first + 16,
                    frame,
                    window,
                    COORDINATE * points.farthest,
                    space.chunk_rectangles,
                    0,
                )
            nearer, farther = distance_bounds(points.chunk_boxes, chunk, eye, contact)
            whole = (
                space.chunk_rectangles[0, chunk % 16],
                space.chunk_rectangles[1, chunk % 16],
                space.chunk_rectangles[2, chunk % 16],
                space.chunk_rectangles[3, chunk % 16],
                space.chunk_rectangles[5, chunk % 16],
                own_reach / min(ONE, space.chunk_rectangles[4, chunk % 16]),
                own_reach,
                nearer,
                farther,
            )
        n_listed = list_clusters(scene, whole, space)
        narrowed = n_listed <= SHORT
        if narrowed:
            n_listed = narrow(scene, points, chunk, whole, n_listed, frame, window, eye, reach, space, epoch)
        if n_listed == 0:
            continue
        if n_listed < 0:
            for packet in range(CHUNK):
                base = (chunk * CHUNK + packet) * PACKET
                left = points.n_points - base
                if inside:
                    write(points, base, space.undecided[packet], answer)
                elif left > 0:
                    write(points, base, ALL if left >= PACKET else (1 << left) - 1, answer)
            continue
        if not inside:
            project_points(points, chunk, frame, window, ZERO, eye, reach, contact, space)
        for packet in range(CHUNK):
            if space.undecided[packet]:
                search_packet(
                    scene,
                    points,
                    chunk,
                    packet,
                    n_listed,
                    narrowed,
                    frame,
                    window,
                    eye,
                    world_eye,
                    reach,
                    space,
                    epoch,
                    answer,
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
def slot_of(scene, cluster, frame, window, eye, reach, space, epoch):  # type: ignore[no-untyped-def]
    """Slot that holds a cluster's set-up for this frame, after setting it up if none does."""
    slot = cluster & (len(space.tags) - 1)
    tag = epoch * len(scene.used) + cluster
    if space.tags[slot] != tag:
        space.doubtful[slot] = set_up(
            scene, cluster, frame, window, eye, reach, space.slots, slot, space.slot_rectangles
        )
        space.tags[slot] = tag
    return slot


@njit(_nrt=False, forceinline=True)
def narrow(scene, points, chunk, whole, n_listed, frame, window, eye, reach, space, epoch):  # type: ignore[no-untyped-def]
    """Drop the clusters none of whose faces can hide anything of a chunk; return how many stay.

    -1: a face hides the whole chunk.
    """
    n = 0
    for j in range(n_listed):
        cluster = space.listed[j]
        slot = slot_of(scene, cluster, frame, window, eye, reach, space, epoch)
        maybe, covers = classify(
            space.slots, slot, space.doubtful[slot], scene.used[cluster], points.chunk_boxes, chunk, whole
        )
        if covers:
            return -1
        if maybe:
            space.listed[n] = cluster
            for row in range(5):
                space.listed_rectangles[row, n] = space.slot_rectangles[slot, row]
            n += 1
    return n


@njit(_nrt=False, forceinline=True)
def search_packet(  # type: ignore[no-untyped-def]
    scene, points, chunk, packet, n_listed, narrowed, frame, window, eye, world_eye, reach, space, epoch, answer
):
    """Go through the listed clusters until every point of a packet is hidden or none is left."""
    undecided = space.undecided[packet]
    index = chunk * CHUNK + packet
    base = index * PACKET
    rows, rectangles = space.packets, space.listed_rectangles
    whole = (
        rows[packet, 0],
        rows[packet, 1],
        rows[packet, 2],
        rows[packet, 3],
        rows[packet, 4],
        rows[packet, 5],
        rows[packet, 6],
        rows[packet, 7],
        rows[packet, 8],
    )
    slack = COORDINATE * whole[5] * reach
    hidden = 0
    for j in range(0, n_listed, 16):
        found = overlapping(rectangles, j, whole)
        if n_listed - j < 16:
            found &= (1 << (n_listed - j)) - 1
        while found:
            entry = j + first_lane(found)
            found &= found - 1
            within = undecided
            if not narrowed:
                x, y = load(space.image, packet * PACKET), load(space.image, (CHUNK + packet) * PACKET)
                within &= (
                    not_less(x, splat(rectangles[0, entry] - slack))
                    & not_less(splat(rectangles[1, entry] + slack), x)
                    & not_less(y, splat(rectangles[2, entry] - slack))
                    & not_less(splat(rectangles[3, entry] + slack), y)
                )
                if not within:
                    continue
            cluster = space.listed[entry]
            slot = slot_of(scene, cluster, frame, window, eye, reach, space, epoch)
            doubtful = space.doubtful[slot]
            n_within = count_lanes(within)
            maybe = 0
            if n_within > 2:
                maybe, covers = classify(
                    space.slots, slot, doubtful, scene.used[cluster], points.boxes, index, whole
                )
                if not maybe:
                    continue
                if covers:
                    hidden |= undecided
                    within = 0
            if n_within > 2 and count_lanes(maybe) <= n_within:
                while maybe and within:
                    lane = first_lane(maybe)
                    maybe &= maybe - 1
                    sure, doubt = hide_by_face(
                        space.slots,
                        slot,
                        lane,
                        (doubtful >> lane) & 1,
                        16 * cluster + lane,
                        within,
                        (base, packet * PACKET),
                        points,
                        space.image,
                        whole,
                    )
                    if doubt:
                        sure |= settle_face(scene, points, world_eye, base, cluster, lane, doubt)
                    hidden |= sure
                    within &= ~sure
            else:
                while within:
                    i = first_lane(within)
                    within &= within - 1
                    gone, doubt = hide_point(
                        space.slots,
                        slot,
                        doubtful,
                        scene.used[cluster],
                        cluster,
                        base + i,
                        space.image[packet * PACKET + i],
                        space.image[(CHUNK + packet) * PACKET + i],
                        points,
                        whole,
                    )
                    if gone or (doubt and settle(scene, points, world_eye, base + i, cluster, doubt)):
                        hidden |= 1 << i
            undecided &= ~hidden
            if not undecided:
                if entry > 0:
                    promote(space, entry)
                write(points, base, hidden, answer)
                return
    write(points, base, hidden, answer)


@njit(_nrt=False)
def settle_face(scene, points, world_eye, base, cluster, lane, doubt):  # type: ignore[no-untyped-def]
    """Mask of the points in doubt that a face blocks, by the definition itself."""
    sure = 0
    while doubt:
        i = first_lane(doubt)
        doubt &= doubt - 1
        if settle(scene, points, world_eye, base + i, cluster, 1 << lane):
            sure |= 1 << i
    return sure


@njit(_nrt=False, forceinline=True)
def promote(space, entry):  # type: ignore[no-untyped-def]
    """Move a cluster to the front of the list: what hides a packet is likely to hide the next."""
    space.listed[0], space.listed[entry] = space.listed[entry], space.listed[0]
    for row in range(5):
        first, other = space.listed_rectangles[row, 0], space.listed_rectangles[row, entry]
        space.listed_rectangles[row, 0], space.listed_rectangles[row, entry] = other, first


@njit(_nrt=False, forceinline=True)
def write(points, base, hidden, answer):  # type: ignore[no-untyped-def]
    """Enter the hidden points of a packet into the caller's order."""
    if hidden == ALL:
        for i in range(base, base + PACKET):
            answer[points.order[i]] = False
        return
    while hidden:
        answer[points.order[base + first_lane(hidden)]] = False
        hidden &= hidden - 1
