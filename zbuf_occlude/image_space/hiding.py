"""Hiding: 16 faces against a packet's box, 16 points against a face, 16 faces against a point; doubts in float64."""

import numpy as np
from numba import njit

from zbuf_occlude.image_space.decide import face_blocks
from zbuf_occlude.image_space.lanes import (
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
from zbuf_occlude.image_space.projection import CONTACT, NORMAL, PLANE, ROWS, ZERO

SURE = np.float32(1.001)
"""What is certain is certain by this factor, which covers the rounding of the bounds themselves."""


@njit(_nrt=False, forceinline=True)
def classify(slots, slot, doubtful, used, rectangle, box, blur, reach, nearer, farther):  # type: ignore[no-untyped-def]
    """Sort the 16 faces of a cluster by what they can do to the points in a box.

    Parameters
    ----------
    slots, slot : the cluster's set-up (`projection.set_up`)
    doubtful, used : int
        Masks of the faces.
    rectangle : tuple of 4 float32
        Centre and half-sides of the points' rectangle in the image.
    box : tuple of 6 float32
        Centre and half-sides of their box, scene space.
    blur, reach : float32
        Largest reach / w, and largest reach, of the points.
    nearer, farther : float32
        Bounds of 1 / (distance from the eye, less the contact tolerance): the largest, the smallest.

    Returns
    -------
    maybe : int
        Mask of the faces that may hide some of the points.
    covers : bool
        Whether one face certainly hides all of them.
    """
    row = slot * ROWS * 16
    zero, fuzzy, sharp = splat(ZERO), splat(-blur * SURE), splat(blur * SURE)
    cx, cy, hx, hy = splat(rectangle[0]), splat(rectangle[1]), splat(rectangle[2]), splat(rectangle[3])
    best, worst = splat(np.float32(3e38)), splat(np.float32(3e38))
    for edge in range(3):
        a, b = load(slots, row + 48 * edge), load(slots, row + 48 * edge + 16)
        middle = muladd(a, cx, muladd(b, cy, load(slots, row + 48 * edge + 32)))
        half = muladd(absolute(a), hx, absolute(b) * hy)
        best, worst = minimum(best, middle + half), minimum(worst, middle - half)
    row += 16 * NORMAL
    nx, ny, nz = load(slots, row), load(slots, row + 16), load(slots, row + 32)
    middle = muladd(nx, splat(box[0]), muladd(ny, splat(box[1]), muladd(nz, splat(box[2]), zero - load(slots, row + 48))))
    half = muladd(absolute(nx), splat(box[3]), muladd(absolute(ny), splat(box[4]), absolute(nz) * splat(box[5])))
    contact = load(slots, row + 16 * (CONTACT - NORMAL))
    error = splat(PLANE * reach)
    behind = not_less(error + half - middle, contact * splat(farther))
    maybe = not_less(best, fuzzy) & (behind | doubtful) & used
    covering = maybe & ~doubtful & greater(worst, sharp)
    if covering:
        covering &= greater(zero - middle - half - error, contact * splat(nearer))
    return maybe, covering != 0


@njit(_nrt=False, forceinline=True)
def hide_by_face(  # type: ignore[no-untyped-def]
    slots, slot, lane, doubtful, face, undecided, at, points, image, blur, reach, nearer, farther
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
    image : (512,) float32
        x / w of the chunk's points, then y / w.
    blur, reach, nearer, farther : as in `classify`

    Returns
    -------
    sure, doubt : int
        Masks of the points that the face certainly hides, and of those that float64 must decide.
    """
    row = slot * ROWS * 16 + lane
    x, y = load(image, at[1]), load(image, len(image) // 2 + at[1])
    inside = muladd(x, splat(slots[row]), muladd(y, splat(slots[row + 16]), splat(slots[row + 32])))
    inside = minimum(inside, muladd(x, splat(slots[row + 48]), muladd(y, splat(slots[row + 64]), splat(slots[row + 80]))))
    inside = minimum(inside, muladd(x, splat(slots[row + 96]), muladd(y, splat(slots[row + 112]), splat(slots[row + 128]))))
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
def hide_point(slots, slot, doubtful, used, cluster, i, x, y, points, blur, reach, nearer, farther):  # type: ignore[no-untyped-def]
    """Test one point, at (x, y) in the image, against the 16 faces of a cluster.

    Returns
    -------
    hidden : bool
        Whether one of them certainly hides it.
    doubt : int
        Mask of the faces that float64 must decide, if it is not.
    """
    row = slot * ROWS * 16
    px, py = splat(x), splat(y)
    inside = muladd(px, load(slots, row), muladd(py, load(slots, row + 16), load(slots, row + 32)))
    inside = minimum(inside, muladd(px, load(slots, row + 48), muladd(py, load(slots, row + 64), load(slots, row + 80))))
    inside = minimum(
        inside, muladd(px, load(slots, row + 96), muladd(py, load(slots, row + 112), load(slots, row + 128)))
    )
    possible = not_less(inside, splat(-blur * SURE)) & used
    own = points.own[i] - 16 * cluster
    if 0 <= own < 16:
        possible &= ~(1 << own)
    if not possible:
        return False, 0
    row += 16 * NORMAL
    depth = load(slots, row + 48)
    depth = depth - splat(points.coordinates[0, i]) * load(slots, row)
    depth = depth - splat(points.coordinates[1, i]) * load(slots, row + 16)
    depth = depth - splat(points.coordinates[2, i]) * load(slots, row + 32)
    contact, error = load(slots, row + 16 * (CONTACT - NORMAL)), splat(PLANE * reach)
    possible &= not_less(depth + error, contact * splat(farther)) | doubtful
    sure = possible & ~doubtful & greater(inside, splat(blur * SURE)) & greater(depth - error, contact * splat(nearer))
    return sure != 0, possible & ~sure


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


