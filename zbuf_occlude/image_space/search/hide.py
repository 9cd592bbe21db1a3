"""Hiding: 16 faces against a box of points, 16 points against a face, 16 faces against a point."""

import numpy as np
from numba import njit

from zbuf_occlude.image_space.layout import (
    CLUSTER,
    CONTACT,
    EDGES,
    ENDLESS,
    HALF,
    NORMAL,
    PACKET,
    PLANE_ERROR,
    SETUP_ROWS,
    UPPER,
    ZERO,
)
from zbuf_occlude.image_space.search.decide import faces_block
from zbuf_occlude.lanes import (
    absolute,
    dot3,
    equal,
    first_lane,
    greater,
    load,
    load3,
    minimum,
    muladd,
    not_less,
    splat,
    splat3,
)

SURE = np.float32(1.001)
"""What is certain is certain by this factor, which covers the rounding of the bounds themselves."""


@njit(_nrt=False, forceinline=True)
def classify(scene, space, slot, cluster, own, boxes, column, extent):
    """Sort the 16 faces of a cluster by what they can do to the points of a packet.

    Parameters
    ----------
    scene, space, slot, cluster
        The cluster, and where the workspace has its set-up.
    own : tuple of 2 int
        First and last of the points' own rows: these faces do not cover, since they do not hide their points even
        where those lie behind them.
    boxes, column : (6, ...) float32 and int
        The points' box in scene space.
    extent : Extent
        Theirs.

    Returns
    -------
    maybe : int
        Mask of the faces that may hide some of the points.
    covers : bool
        Whether one face certainly hides all of them.
    """
    row = slot * SETUP_ROWS * CLUSTER
    cx, hx = splat(HALF * (extent.left + extent.right)), splat(HALF * (extent.right - extent.left))
    cy, hy = splat(HALF * (extent.bottom + extent.top)), splat(HALF * (extent.top - extent.bottom))
    best, worst = splat(ENDLESS), splat(ENDLESS)
    for edge in range(3):
        a, b, c = load3(space.setups, row + (EDGES + 3 * edge) * CLUSTER, CLUSTER)
        middle = muladd(a, cx, muladd(b, cy, c))
        half = muladd(absolute(a), hx, absolute(b) * hy)
        best, worst = minimum(best, middle + half), minimum(worst, middle - half)
    zero, doubtful, used = splat(ZERO), space.doubtful[slot], scene.used[cluster]
    normal = load3(space.setups, row + NORMAL * CLUSTER, CLUSTER)
    offset = load(space.setups, row + (NORMAL + 3) * CLUSTER)
    contact = load(space.setups, row + CONTACT * CLUSTER)
    middle, half = zero - offset, splat(PLANE_ERROR * extent.reach)
    for axis in range(3):
        lower, upper = boxes[axis, column], boxes[UPPER + axis, column]
        middle = muladd(normal[axis], splat(HALF * (lower + upper)), middle)
        half = muladd(absolute(normal[axis]), splat(HALF * (upper - lower)), half)
    behind = not_less(half - middle, contact * splat(extent.inverse_distance_min))
    maybe = not_less(best, splat(-extent.blur * SURE)) & (behind | doubtful) & used
    covering = maybe & ~doubtful & greater(worst, splat(extent.blur * SURE))
    if covering:
        first, last = own[0] - CLUSTER * cluster, own[1] - CLUSTER * cluster
        if first < CLUSTER and last >= 0:
            covering &= ~((2 << min(last, CLUSTER - 1)) - (1 << max(first, 0)))
        covering &= greater(zero - middle - half, contact * splat(extent.inverse_distance_max))
    return maybe, covering != 0


@njit(_nrt=False, forceinline=True)
def hide_by_face(scene, points, view, space, slot, row, undecided, extent):
    """Return the mask of the points in hand, of those undecided, that a face hides; `row` is the face's.

    The points are a packet: ``space.ids`` are consecutive.
    """
    cluster, lane = row // CLUSTER, row % CLUSTER
    base = slot * SETUP_ROWS * CLUSTER + lane
    x, y = load(space.image, 0), load(space.image, PACKET)
    inside = splat(ENDLESS)
    for edge in range(3):
        at = base + (EDGES + 3 * edge) * CLUSTER
        a, b, c = space.setups[at], space.setups[at + CLUSTER], space.setups[at + 2 * CLUSTER]
        inside = minimum(inside, muladd(x, splat(a), muladd(y, splat(b), splat(c))))
    possible = not_less(inside, splat(-extent.blur * SURE)) & undecided
    if not possible:
        return 0
    first = np.int64(space.ids[0])
    possible &= ~equal(points.own, first, np.int32(row))
    sure = 0
    if not (space.doubtful[slot] >> lane) & 1:
        at = base + NORMAL * CLUSTER
        depth = splat(space.setups[at + 3 * CLUSTER])
        for axis in range(3):
            coordinate = load(points.coordinates, axis * points.coordinates.shape[1] + first)
            depth = depth - coordinate * splat(space.setups[at + axis * CLUSTER])
        contact, error = space.setups[base + CONTACT * CLUSTER], PLANE_ERROR * extent.reach
        possible &= not_less(depth, splat(contact * extent.inverse_distance_min - error))
        sure = possible & greater(inside, splat(extent.blur * SURE))
        sure &= greater(depth, splat(contact * extent.inverse_distance_max + error))
    doubt = possible & ~sure
    while doubt:
        i = first_lane(doubt)
        doubt &= doubt - 1
        sure |= np.int64(faces_block(scene, points, view, first + i, cluster, 1 << lane)) << i
    return sure


@njit(_nrt=False, forceinline=True)
def hide_by_cluster(scene, points, view, space, slot, cluster, undecided, extent):
    """Return the mask of the points in hand, of those undecided, that some face of a cluster hides; one by one."""
    hidden = 0
    while undecided:
        lane = first_lane(undecided)
        undecided &= undecided - 1
        sure, doubt = _hide_point(scene, points, space, slot, cluster, lane, extent)
        if sure or (doubt and faces_block(scene, points, view, space.ids[lane], cluster, doubt)):
            hidden |= 1 << lane
    return hidden


@njit(_nrt=False, forceinline=True)
def _hide_point(scene, points, space, slot, cluster, lane, extent):
    """Masks of a cluster's faces that certainly hide a point in hand, and of those that float64 must decide."""
    row, i = slot * SETUP_ROWS * CLUSTER, space.ids[lane]
    x, y = splat(space.image[0, lane]), splat(space.image[1, lane])
    inside = splat(ENDLESS)
    for edge in range(3):
        a, b, c = load3(space.setups, row + (EDGES + 3 * edge) * CLUSTER, CLUSTER)
        inside = minimum(inside, muladd(x, a, muladd(y, b, c)))
    own = points.own[i] - CLUSTER * cluster
    others = scene.used[cluster] & ~(np.int64(0 <= own < CLUSTER) << (own & (CLUSTER - 1)))
    possible = not_less(inside, splat(-extent.blur * SURE)) & others
    if not possible:
        return 0, 0
    normal = load3(space.setups, row + NORMAL * CLUSTER, CLUSTER)
    contact = load(space.setups, row + CONTACT * CLUSTER)
    point = (-points.coordinates[0, i], -points.coordinates[1, i], -points.coordinates[2, i])
    depth = dot3(normal, splat3(point), load(space.setups, row + (NORMAL + 3) * CLUSTER))
    error, doubtful = splat(PLANE_ERROR * extent.reach), space.doubtful[slot]
    possible &= not_less(depth + error, contact * splat(extent.inverse_distance_min)) | doubtful
    sure = possible & ~doubtful & greater(inside, splat(extent.blur * SURE))
    sure &= greater(depth - error, contact * splat(extent.inverse_distance_max))
    return sure, possible & ~sure
