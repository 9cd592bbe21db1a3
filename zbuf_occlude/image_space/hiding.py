"""Hiding: 16 faces against a packet's box, 16 points against a face, 16 faces against a point; doubts in float64."""

import numpy as np
from numba import njit

from zbuf_occlude.image_space.decide import face_blocks
from zbuf_occlude.image_space.projection import CONTACT, NORMAL, PLANE, ROWS, ZERO
from zbuf_occlude.lanes import (
    absolute,
    equal,
    first_lane,
    greater,
    load,
    minimum,
    muladd,
    not_less,
    splat,
)

SURE = np.float32(1.001)
"""What is certain is certain by this factor, which covers the rounding of the bounds themselves."""


@njit(_nrt=False, forceinline=True)
def classify(slots, slot, doubtful, used, own, boxes, index, whole):  # type: ignore[no-untyped-def]
    """Sort the 16 faces of a cluster by what they can do to the points of a packet or chunk.

    Parameters
    ----------
    slots, slot : the cluster's set-up (`projection.set_up`)
    doubtful, used : int
        Masks of the faces.
    own : tuple of 2 int
        First and last lane of the cluster, which may be none of its 16, that are the points' own faces: these do not
        cover, since they do not hide their points even where those lie behind them.
    boxes, index : (6, ...) float32 and int
        The points' box in scene space: column `index`, lower and upper corner.
    whole : tuple of 9 float32
        Their rectangle in the image and their bounds, see `projection.project_points`.

    Returns
    -------
    maybe : int
        Mask of the faces that may hide some of the points.
    covers : bool
        Whether one face certainly hides all of them.
    """
    part = np.float32(0.5)
    blur, reach, nearer, farther = whole[5], whole[6], whole[7], whole[8]
    cx, hx = splat(part * (whole[0] + whole[1])), splat(part * (whole[1] - whole[0]))
    cy, hy = splat(part * (whole[2] + whole[3])), splat(part * (whole[3] - whole[2]))
    row = slot * ROWS * 16
    zero, fuzzy, sharp = splat(ZERO), splat(-blur * SURE), splat(blur * SURE)
    best, worst = splat(np.float32(3e38)), splat(np.float32(3e38))
    for edge in range(3):
        a, b = load(slots, row + 48 * edge), load(slots, row + 48 * edge + 16)
        middle = muladd(a, cx, muladd(b, cy, load(slots, row + 48 * edge + 32)))
        half = muladd(absolute(a), hx, absolute(b) * hy)
        best, worst = minimum(best, middle + half), minimum(worst, middle - half)
    row += 16 * NORMAL
    nx, ny, nz = load(slots, row), load(slots, row + 16), load(slots, row + 32)
    cx, hx = splat(part * (boxes[0, index] + boxes[3, index])), splat(part * (boxes[3, index] - boxes[0, index]))
    cy, hy = splat(part * (boxes[1, index] + boxes[4, index])), splat(part * (boxes[4, index] - boxes[1, index]))
    cz, hz = splat(part * (boxes[2, index] + boxes[5, index])), splat(part * (boxes[5, index] - boxes[2, index]))
    middle = muladd(nx, cx, muladd(ny, cy, muladd(nz, cz, zero - load(slots, row + 48))))
    half = muladd(absolute(nx), hx, muladd(absolute(ny), hy, absolute(nz) * hz))
    contact = load(slots, row + 16 * (CONTACT - NORMAL))
    error = splat(PLANE * reach)
    behind = not_less(error + half - middle, contact * splat(farther))
    maybe = not_less(best, fuzzy) & (behind | doubtful) & used
    covering = maybe & ~doubtful & greater(worst, sharp)
    if covering:
        if own[0] < 16 and own[1] >= 0:
            covering &= ~((2 << min(own[1], 15)) - (1 << max(own[0], 0)))
        covering &= greater(zero - middle - half - error, contact * splat(nearer))
    return maybe, covering != 0


@njit(_nrt=False, forceinline=True)
def hide_by_face(  # type: ignore[no-untyped-def]
    slots, slot, lane, doubtful, face, undecided, at, points, image, whole
):
    """Test 16 points against one face.

    Parameters
    ----------
    slots, slot, lane : the face's set-up
    doubtful : bool
    face : int
        16 x cluster + lane, compared with the points' own.
    undecided : int
        Mask of the points in question.
    at : tuple of int
        Index of the packet's first point in `points.coordinates`, and in `image`.
    points : Packets
    image : (2, ...) float32
        x / w and y / w of the points.
    whole : as in `classify`

    Returns
    -------
    sure, doubt : int
        Masks of the points that the face certainly hides, and of those that float64 must decide.
    """
    blur, reach, nearer, farther = whole[5], whole[6], whole[7], whole[8]
    row = slot * ROWS * 16 + lane
    x, y = load(image, at[1]), load(image, image.shape[1] + at[1])
    inside = muladd(x, splat(slots[row]), muladd(y, splat(slots[row + 16]), splat(slots[row + 32])))
    inside = minimum(
        inside, muladd(x, splat(slots[row + 48]), muladd(y, splat(slots[row + 64]), splat(slots[row + 80])))
    )
    inside = minimum(
        inside, muladd(x, splat(slots[row + 96]), muladd(y, splat(slots[row + 112]), splat(slots[row + 128])))
    )
    possible = not_less(inside, splat(-blur * SURE)) & undecided
    if not possible:
        return 0, 0
    possible &= ~equal(points.own, at[0], np.int32(face))
    if doubtful:
        return 0, possible
    row += 16 * NORMAL
    n = points.coordinates.shape[1]
    depth = splat(slots[row + 48])
    depth = depth - load(points.coordinates, at[0]) * splat(slots[row])
    depth = depth - load(points.coordinates, n + at[0]) * splat(slots[row + 16])
    depth = depth - load(points.coordinates, 2 * n + at[0]) * splat(slots[row + 32])
    contact, error = slots[row + 16 * (CONTACT - NORMAL)], PLANE * reach
    possible &= not_less(depth, splat(contact * farther - error))
    sure = possible & greater(inside, splat(blur * SURE)) & greater(depth, splat(contact * nearer + error))
    return sure, possible & ~sure


@njit(_nrt=False, forceinline=True)
def hide_point(slots, slot, doubtful, used, cluster, i, x, y, points, whole):  # type: ignore[no-untyped-def]
    """Test one point, at (x, y) in the image, against the 16 faces of a cluster.

    Returns
    -------
    sure, doubt : int
        Masks of the faces that certainly hide it, and of those that float64 must decide.
    """
    blur, reach, nearer, farther = whole[5], whole[6], whole[7], whole[8]
    row = slot * ROWS * 16
    px, py = splat(x), splat(y)
    first = muladd(px, load(slots, row), muladd(py, load(slots, row + 16), load(slots, row + 32)))
    second = muladd(px, load(slots, row + 48), muladd(py, load(slots, row + 64), load(slots, row + 80)))
    third = muladd(px, load(slots, row + 96), muladd(py, load(slots, row + 112), load(slots, row + 128)))
    inside = minimum(minimum(first, second), third)
    own = points.own[i] - 16 * cluster
    others = used & ~(np.int64(0 <= own < 16) << (own & 15))
    possible = not_less(inside, splat(-blur * SURE)) & others
    if not possible:
        return 0, 0
    row += 16 * NORMAL
    depth = load(slots, row + 48)
    depth = depth - splat(points.coordinates[0, i]) * load(slots, row)
    depth = depth - splat(points.coordinates[1, i]) * load(slots, row + 16)
    depth = depth - splat(points.coordinates[2, i]) * load(slots, row + 32)
    contact, error = load(slots, row + 16 * (CONTACT - NORMAL)), splat(PLANE * reach)
    possible &= not_less(depth + error, contact * splat(farther)) | doubtful
    sure = greater(inside, splat(blur * SURE)) & greater(depth - error, contact * splat(nearer)) & possible & ~doubtful
    return sure, possible & ~sure


@njit(_nrt=False, forceinline=True)
def hide_points(  # type: ignore[no-untyped-def]
    scene, slots, slot, doubtful, cluster, within, ids, base, image, at, points, whole, world_eye
):
    """Test a few points, one by one, against the 16 faces of a cluster.

    Parameters
    ----------
    scene : Scene
    slots, slot : (n_slots x 14 x 16,) float32 and int
        Where `projection.set_up` has put the cluster's faces.
    doubtful : int
        Mask of the faces that float32 must not decide.
    cluster : int
    within : int
        Mask of the points.
    ids, base : (...) int32 and int
        Point i of the mask is ``ids[base + i]`` in the packets' order.
    image, at : (2, ...) float32 and int
        Its place in the image is column ``at + i``.
    points, whole : Packets and tuple
        All points, and the numbers of this packet (`projection.project_points`).
    world_eye : tuple of 3 float64

    Returns
    -------
    int
        Mask of the points that some face hides.
    """
    used = scene.used[cluster]
    hidden, unsure = 0, 0
    rest = within
    while rest:
        lane = first_lane(rest)
        rest &= rest - 1
        sure, doubt = hide_point(
            slots,
            slot,
            doubtful,
            used,
            cluster,
            ids[base + lane],
            image[0, at + lane],
            image[1, at + lane],
            points,
            whole,
        )
        hidden |= np.int64(sure != 0) << lane
        unsure |= np.int64(doubt != 0) << lane
    unsure &= ~hidden
    if unsure:
        hidden |= settle_points(
            scene, slots, slot, doubtful, cluster, unsure, ids, base, image, at, points, whole, world_eye
        )
    return hidden


@njit(_nrt=False)
def settle_points(  # type: ignore[no-untyped-def]
    scene, slots, slot, doubtful, cluster, unsure, ids, base, image, at, points, whole, world_eye
):
    """Decide in float64 what `hide_points` left unsure."""
    hidden = 0
    while unsure:
        lane = first_lane(unsure)
        unsure &= unsure - 1
        i = ids[base + lane]
        _, doubt = hide_point(
            slots,
            slot,
            doubtful,
            scene.used[cluster],
            cluster,
            i,
            image[0, at + lane],
            image[1, at + lane],
            points,
            whole,
        )
        if settle(scene, points, world_eye, i, cluster, doubt):
            hidden |= 1 << lane
    return hidden


@njit(_nrt=False)
def settle(scene, points, eye, i, cluster, faces):  # type: ignore[no-untyped-def]
    """Whether one of a mask of a cluster's faces blocks point i, by the definition itself, in float64."""
    k = points.order[i]
    point = (points.positions[k, 0], points.positions[k, 1], points.positions[k, 2])
    while faces:
        lane = first_lane(faces)
        faces &= faces - 1
        if face_blocks(eye, point, scene.world_corners[scene.face_ids[cluster, lane]], scene.world_contact):
            return True
    return False
