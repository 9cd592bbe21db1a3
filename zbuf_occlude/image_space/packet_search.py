"""Packets of points: held against the clusters before them, until each point is hidden or no cluster is left."""

from numba import njit

from zbuf_occlude.image_space.hiding import classify, hide_by_face, hide_points, settle
from zbuf_occlude.image_space.listing import overlapping
from zbuf_occlude.image_space.packets import CHUNK, PACKET
from zbuf_occlude.image_space.projection import COORDINATE
from zbuf_occlude.image_space.slots import slot_of
from zbuf_occlude.lanes import ALL, count_lanes, first_lane, load, not_less, splat

WIDE = 128
"""In longer lists a packet's points are compared with every rectangle, one by one."""

FEW = 3
"""So few points are tested one by one against all faces of a cluster."""


@njit(_nrt=False, forceinline=True)
def row_of(rows, i):  # type: ignore[no-untyped-def]
    """The nine numbers of a chunk or packet."""
    return (
        rows[i, 0],
        rows[i, 1],
        rows[i, 2],
        rows[i, 3],
        rows[i, 4],
        rows[i, 5],
        rows[i, 6],
        rows[i, 7],
        rows[i, 8],
    )


@njit(_nrt=False, forceinline=True)
def search_packet(  # type: ignore[no-untyped-def]
    scene, points, index, packet, n_listed, frame, window, eye, world_eye, reach, space, epoch
):
    """Go through the listed clusters until every point of a packet is hidden or none is left.

    `index` is the packet's number, `packet` its place in the chunk.

    Returns
    -------
    int
        Mask of the hidden ones, of those in ``space.undecided[packet]``.
    """
    undecided = space.undecided[packet]
    base = index * PACKET
    whole, rectangles = row_of(space.packets, packet), space.listed_rectangles
    slack = COORDINATE * whole[5] * reach
    wide = n_listed > WIDE
    hidden = 0
    for j in range(0, n_listed, 16):
        found = overlapping(rectangles, j, whole)
        if n_listed - j < 16:
            found &= (1 << (n_listed - j)) - 1
        while found:
            entry = j + first_lane(found)
            found &= found - 1
            within = undecided
            cluster = space.listed[entry]
            if wide:
                x, y = load(space.image, packet * PACKET), load(space.image, (CHUNK + packet) * PACKET)
                within &= (
                    not_less(x, splat(rectangles[0, entry] - slack))
                    & not_less(splat(rectangles[1, entry] + slack), x)
                    & not_less(y, splat(rectangles[2, entry] - slack))
                    & not_less(splat(rectangles[3, entry] + slack), y)
                )
                if not within:
                    continue
            slot = slot_of(scene, cluster, frame, window, eye, reach, space, epoch)
            doubtful = space.doubtful[slot]
            n_within = count_lanes(within)
            maybe, n_maybe = 0, 16
            if n_within > FEW:
                own = (points.own[base] - 16 * cluster, points.own[base + PACKET - 1] - 16 * cluster)
                maybe, covers = classify(
                    space.slots, slot, doubtful, scene.used[cluster], own, points.boxes, index, whole
                )
                if not maybe:
                    continue
                if covers:
                    hidden |= undecided
                    within = 0
                n_maybe = count_lanes(maybe)
            if n_maybe <= n_within:
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
            elif within:
                hidden |= hide_points(
                    scene,
                    space.slots,
                    slot,
                    doubtful,
                    cluster,
                    within,
                    points.identity,
                    base,
                    space.image,
                    packet * PACKET,
                    points,
                    whole,
                    world_eye,
                )
            undecided &= ~hidden
            if not undecided:
                if entry > 0:
                    promote(space, entry)
                return hidden
    return hidden


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
