"""The search: for every chunk and packet of points the clusters before it, until something hides its points."""

from typing import NamedTuple

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from zbuf_occlude.arrays import BoolArray
from zbuf_occlude.image_space.decide import line_is_blocked
from zbuf_occlude.image_space.frames import Frames
from zbuf_occlude.image_space.hiding import classify, hide_by_face, hide_point, settle
from zbuf_occlude.image_space.lanes import (
    ALL,
    absolute,
    count_lanes,
    divide,
    first_lane,
    greater,
    highest,
    load,
    lowest,
    maximum,
    muladd,
    not_less,
    select,
    splat,
    store,
)
from zbuf_occlude.image_space.packets import CHUNK, PACKET, Packets
from zbuf_occlude.image_space.projection import COORDINATE, FAR, ONE, ROWS, ZERO, project_nodes, set_up
from zbuf_occlude.image_space.scene import Float32, Scene

NEAR = np.float32(1e-3)
"""Points nearer to the eye than this times their reach are decided in float64 altogether."""

SHORT = 64
"""Lists of at most so many clusters are narrowed for a chunk before its packets go through them."""

SLOTS = 4096
"""Set-ups of clusters kept at a time."""


class Workspace(NamedTuple):
    """What one thread needs; a few megabytes, whatever the number of points."""

    rectangles: Float32  # (5, total nodes)
    list_a: NDArray[np.int64]
    list_b: NDArray[np.int64]
    listed: Float32  # (5, clusters + 16) rectangles of the clusters in list_a
    slots: Float32  # (n_slots x ROWS x 16,)
    slot_rectangles: Float32  # (n_slots, 5)
    tags: NDArray[np.int64]
    doubtful: NDArray[np.int64]
    image: Float32  # (2 x CHUNK x PACKET,)
    packets: Float32  # (CHUNK, 9)
    undecided: NDArray[np.int64]


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
                search_frame(scene, points, frames, view, face, begin, end, space, epoch, answer[view])
    return answer


@njit
def make_workspace(scene):  # type: ignore[no-untyped-def]
    """Allocate a thread's workspace."""
    n_clusters = len(scene.used)
    n_slots = 1
    while n_slots < min(n_clusters, SLOTS):
        n_slots *= 2
    return Workspace(
        np.empty((5, scene.nodes.shape[1]), dtype=np.float32),
        np.empty(n_clusters + 16, dtype=np.int64),
        np.empty(n_clusters + 16, dtype=np.int64),
        np.empty((5, n_clusters + 16), dtype=np.float32),
        np.empty(n_slots * ROWS * 16, dtype=np.float32),
        np.empty((n_slots, 5), dtype=np.float32),
        np.full(n_slots, -1, dtype=np.int64),
        np.zeros(n_slots, dtype=np.int64),
        np.zeros(2 * CHUNK * PACKET, dtype=np.float32),
        np.zeros((CHUNK, 9), dtype=np.float32),
        np.zeros(CHUNK, dtype=np.int64),
    )


@njit(_nrt=False)
def search_frame(scene, points, frames, view, face, begin, end, space, epoch, answer):  # type: ignore[no-untyped-def]
    """Answer for the chunks begin to end in one frame of an eye; writes False where a point is hidden."""
    frame, window = frames.matrices[view, face], frames.windows[view]
    e = frames.eyes[view]
    eye = (np.float32(e[0]), np.float32(e[1]), np.float32(e[2]))
    world_eye = (
        e[0] / scene.scale + scene.centre[0],
        e[1] / scene.scale + scene.centre[1],
        e[2] / scene.scale + scene.centre[2],
    )
    inside = frames.n_frames[view] > 1
    reach = np.float32(max(1.0, abs(e[0]), abs(e[1]), abs(e[2]))) if inside else ONE
    project_nodes(scene.nodes, frame, window, COORDINATE * reach, space.rectangles)
    for level in range(len(scene.level_counts)):
        first = scene.level_starts[level] + scene.level_counts[level]
        for i in range(first, first + (-first % 16)):
            space.rectangles[0, i] = FAR
            space.rectangles[1, i] = -FAR
    for chunk in range(begin, end):
        if inside and face == 0:
            hide_near(scene, points, chunk, eye, world_eye, answer)
        whole = project_points(points, chunk, frame, window, inside, eye, reach, scene.contact, space)
        if whole[4] < ZERO:
            continue
        n_listed = list_clusters(scene, whole, space)
        if n_listed <= SHORT:
            n_listed = narrow(scene, points, chunk, whole, n_listed, frame, window, eye, reach, space, epoch)
        if n_listed < 0:
            for packet in range(CHUNK):
                write(points, (chunk * CHUNK + packet) * PACKET, space.undecided[packet], answer)
            continue
        if n_listed == 0:
            continue
        for packet in range(CHUNK):
            if space.undecided[packet]:
                search_packet(
                    scene, points, chunk, packet, n_listed, frame, window, eye, world_eye, reach, space, epoch, answer
                )


@njit(_nrt=False)
def hide_near(scene, points, chunk, eye, world_eye, answer):  # type: ignore[no-untyped-def]
    """Decide the points about the eye in float64; frames do not resolve them."""
    for packet in range(CHUNK):
        base = (chunk * CHUNK + packet) * PACKET
        box = points.boxes[base // PACKET]
        radius = NEAR * max(points.reach[base // PACKET], abs(eye[0]), abs(eye[1]), abs(eye[2])) * np.float32(1.01)
        if (
            abs(box[0] - eye[0]) - box[3] > radius
            or abs(box[1] - eye[1]) - box[4] > radius
            or abs(box[2] - eye[2]) - box[5] > radius
        ):
            continue
        for i in range(base, min(base + PACKET, points.n_points)):
            away = max(
                abs(points.coordinates[0, i] - eye[0]),
                abs(points.coordinates[1, i] - eye[1]),
                abs(points.coordinates[2, i] - eye[2]),
            )
            if away <= radius:
                k = points.order[i]
                point = (points.positions[k, 0], points.positions[k, 1], points.positions[k, 2])
                margin = 1e-12 * (1.0 + radius) / scene.scale
                for axis in range(3):
                    margin += 1e-12 * (abs(world_eye[axis]) + abs(scene.centre[axis]))
                own = points.own[i]
                own_face = scene.face_ids[own // 16, own % 16] if own >= 0 else -1
                if line_is_blocked(
                    world_eye,
                    point,
                    own_face,
                    scene.face_ids,
                    scene.lower,
                    scene.upper,
                    scene.world_corners,
                    scene.world_contact,
                    margin,
                ):
                    answer[k] = False


@njit(_nrt=False, forceinline=True)
def project_points(points, chunk, frame, window, inside, eye, reach, contact, space):  # type: ignore[no-untyped-def]
    """Project a chunk's points; fill `space.image`, `space.packets` and `space.undecided`.

    Returns
    -------
    tuple of 9 float32, for the whole chunk what a row of `space.packets` is for a packet:
        lowest x, highest x, lowest y, highest y (widened by their error), highest w (negative: no point in the frame),
        blur, reach, and the bounds `nearer` and `farther` of 1 / distance.
    """
    n = points.coordinates.shape[1]
    x0, x1, y0, y1, w1, blur, far_reach = FAR, -FAR, FAR, -FAR, -ONE, ZERO, ZERO
    nearer, farther = ZERO, FAR
    for packet in range(CHUNK):
        index = chunk * CHUNK + packet
        base = index * PACKET
        space.undecided[packet] = 0
        left = points.n_points - base
        if left <= 0:
            continue
        own_reach = max(points.reach[index], reach)
        x, y, z = load(points.coordinates, base), load(points.coordinates, n + base), load(points.coordinates, 2 * n + base)
        u = muladd(x, splat(frame[0]), muladd(y, splat(frame[1]), muladd(z, splat(frame[2]), splat(frame[3]))))
        v = muladd(x, splat(frame[4]), muladd(y, splat(frame[5]), muladd(z, splat(frame[6]), splat(frame[7]))))
        w = muladd(x, splat(frame[8]), muladd(y, splat(frame[9]), muladd(z, splat(frame[10]), splat(frame[11]))))
        active = ALL if left >= PACKET else (1 << left) - 1
        if inside:
            rim = splat(window) * w
            active &= not_less(rim, absolute(u)) & not_less(rim, absolute(v)) & greater(w, splat(NEAR * own_reach))
        if not active:
            continue
        space.undecided[packet] = active
        inverse = divide(splat(ONE), w)
        u, v = u * inverse, v * inverse
        store(space.image, packet * PACKET, u)
        store(space.image, CHUNK * PACKET + packet * PACKET, v)
        far, near = splat(FAR), splat(-FAR)
        closest = max(ONE, highest(select(active, inverse, near)))
        own_blur = closest * own_reach / reach
        slack = COORDINATE * own_reach * closest
        row = (
            lowest(select(active, u, far)) - slack,
            highest(select(active, u, near)) + slack,
            lowest(select(active, v, far)) - slack,
            highest(select(active, v, near)) + slack,
            highest(select(active, w, near)) + COORDINATE * own_reach,
        )
        dx = abs(points.boxes[index, 0] - eye[0])
        dy = abs(points.boxes[index, 1] - eye[1])
        dz = abs(points.boxes[index, 2] - eye[2])
        hx, hy, hz = points.boxes[index, 3], points.boxes[index, 4], points.boxes[index, 5]
        distance = np.sqrt(dx * dx + dy * dy + dz * dz)
        radius = np.sqrt(hx * hx + hy * hy + hz * hz)
        least = distance * np.float32(0.999) - radius - np.float32(contact)
        own_nearer = ONE / least if least > ZERO else FAR
        own_farther = ONE / (distance * np.float32(1.001) + radius)
        for i in range(5):
            space.packets[packet, i] = row[i]
        space.packets[packet, 5] = own_blur
        space.packets[packet, 6] = own_reach
        space.packets[packet, 7] = own_nearer
        space.packets[packet, 8] = own_farther
        x0, x1, y0, y1 = min(x0, row[0]), max(x1, row[1]), min(y0, row[2]), max(y1, row[3])
        w1, blur, far_reach = max(w1, row[4]), max(blur, own_blur), max(far_reach, own_reach)
        nearer, farther = max(nearer, own_nearer), min(farther, own_farther)
    return x0, x1, y0, y1, w1, blur, far_reach, nearer, farther


@njit(_nrt=False, forceinline=True)
def overlapping(rectangles, i, whole):  # type: ignore[no-untyped-def]
    """Mask of the 16 rectangles from index i on that overlap a packet's and do not lie wholly behind it."""
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
    """List the clusters that may hide something of a chunk in `space.list_a` and `space.listed`; return how many."""
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
    for j in range(n):
        cluster = current[j]
        space.list_a[j] = cluster
        for row in range(5):
            space.listed[row, j] = space.rectangles[row, cluster]
    return n


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
def classify_for(scene, boxes, index, row, slot, cluster, space):  # type: ignore[no-untyped-def]
    """Apply `classify` to a packet or chunk: its box, and its row of `space.packets`."""
    half = np.float32(0.5)
    rectangle = (half * (row[0] + row[1]), half * (row[2] + row[3]), half * (row[1] - row[0]), half * (row[3] - row[2]))
    box = (
        boxes[index, 0],
        boxes[index, 1],
        boxes[index, 2],
        boxes[index, 3],
        boxes[index, 4],
        boxes[index, 5],
    )
    return classify(
        space.slots,
        slot,
        space.doubtful[slot],
        scene.used[cluster],
        rectangle,
        box,
        row[5],
        row[6],
        row[7],
        row[8],
    )


@njit(_nrt=False, forceinline=True)
def narrow(scene, points, chunk, whole, n_listed, frame, window, eye, reach, space, epoch):  # type: ignore[no-untyped-def]
    """Drop the clusters none of whose faces can hide anything of a chunk; return how many stay.

    -1: a face hides the whole chunk.
    """
    n = 0
    for j in range(n_listed):
        cluster = space.list_a[j]
        slot = slot_of(scene, cluster, frame, window, eye, reach, space, epoch)
        maybe, covers = classify_for(scene, points.chunk_boxes, chunk, whole, slot, cluster, space)
        if covers:
            return -1
        if maybe:
            space.list_a[n] = cluster
            for row in range(5):
                space.listed[row, n] = space.slot_rectangles[slot, row]
            n += 1
    return n


@njit(_nrt=False, forceinline=True)
def search_packet(  # type: ignore[no-untyped-def]
    scene, points, chunk, packet, n_listed, frame, window, eye, world_eye, reach, space, epoch, answer
):
    """Go through the listed clusters until every point of a packet is hidden or none is left."""
    undecided = space.undecided[packet]
    index = chunk * CHUNK + packet
    base = index * PACKET
    rows = space.packets
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
    slack = COORDINATE * whole[6] * whole[5]
    x, y = load(space.image, packet * PACKET), load(space.image, CHUNK * PACKET + packet * PACKET)
    hidden = 0
    for j in range(0, n_listed, 16):
        found = overlapping(space.listed, j, whole)
        if n_listed - j < 16:
            found &= (1 << (n_listed - j)) - 1
        while found:
            entry = j + first_lane(found)
            found &= found - 1
            within = (
                undecided
                & not_less(x, splat(space.listed[0, entry] - slack))
                & not_less(splat(space.listed[1, entry] + slack), x)
                & not_less(y, splat(space.listed[2, entry] - slack))
                & not_less(splat(space.listed[3, entry] + slack), y)
            )
            if not within:
                continue
            cluster = space.list_a[entry]
            slot = slot_of(scene, cluster, frame, window, eye, reach, space, epoch)
            n_within = count_lanes(within)
            maybe = 0
            if n_within > 2:
                maybe, covers = classify_for(scene, points.boxes, index, whole, slot, cluster, space)
                if covers:
                    hidden |= undecided
                    undecided = 0
                if not maybe or not undecided:
                    within = 0
            if n_within > 2 and count_lanes(maybe) <= n_within:
                while maybe and within:
                    lane = first_lane(maybe)
                    maybe &= maybe - 1
                    sure, doubt = hide_by_face(
                        space.slots,
                        slot,
                        lane,
                        (space.doubtful[slot] >> lane) & 1,
                        16 * cluster + lane,
                        within,
                        (base, packet * PACKET),
                        points,
                        space.image,
                        whole[5],
                        whole[6],
                        whole[7],
                        whole[8],
                    )
                    while doubt:
                        i = first_lane(doubt)
                        if settle(scene, points, world_eye, base + i, cluster, 1 << lane):
                            sure |= 1 << i
                        doubt &= doubt - 1
                    hidden |= sure
                    within &= ~sure
            else:
                while within:
                    i = first_lane(within)
                    within &= within - 1
                    gone, doubt = hide_point(
                        space.slots,
                        slot,
                        space.doubtful[slot],
                        scene.used[cluster],
                        cluster,
                        base + i,
                        space.image[packet * PACKET + i],
                        space.image[(CHUNK + packet) * PACKET + i],
                        points,
                        whole[5],
                        whole[6],
                        whole[7],
                        whole[8],
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


@njit(_nrt=False, forceinline=True)
def promote(space, entry):  # type: ignore[no-untyped-def]
    """Move a cluster to the front of the list: what hides a packet is likely to hide the next."""
    space.list_a[0], space.list_a[entry] = space.list_a[entry], space.list_a[0]
    for row in range(5):
        first, other = space.listed[row, 0], space.listed[row, entry]
        space.listed[row, 0], space.listed[row, entry] = other, first


@njit(_nrt=False, forceinline=True)
def write(points, base, hidden, answer):  # type: ignore[no-untyped-def]
    """Enter the hidden points of a packet into the caller's order."""
    while hidden:
        answer[points.order[base + first_lane(hidden)]] = False
        hidden &= hidden - 1
