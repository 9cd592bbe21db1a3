"""Hiding: 16 faces against a box of points, a packet against a face, 16 faces against a point."""

import numpy as np

from zbuf_occlude.exact.decide import decide
from zbuf_occlude.exact.layout import (
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
from zbuf_occlude.jit.compiler import inlined
from zbuf_occlude.jit.simd import (
    absolute,
    dot3,
    equal_wide,
    first_lane,
    greater,
    load,
    load3,
    load3_wide,
    load_wide,
    minimum,
    muladd,
    not_less,
    number,
    numbers3,
    splat,
)

SURE = np.float32(1.001)
"""What is certain is certain by this factor, which covers the rounding of the bounds themselves."""


@inlined
def classify(scene, points, space, slot, cluster, extent):
    """Sort the 16 faces of a cluster by what they can do to the points of a packet.

    Parameters
    ----------
    scene, points, space, slot, cluster
        The cluster, and where the workspace has its set-up.
    extent : Extent
        The packet's.

    Returns
    -------
    maybe : int
        Mask of the faces that may hide some of the points.
    covers : bool
        Whether one face certainly hides all of them; a face does not hide its own points even where they lie behind it.
    """
    row, packet = slot * SETUP_ROWS * CLUSTER, extent.first // PACKET
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
        lower, upper = points.boxes[axis, packet], points.boxes[UPPER + axis, packet]
        middle = muladd(normal[axis], splat(HALF * (lower + upper)), middle)
        half = muladd(absolute(normal[axis]), splat(HALF * (upper - lower)), half)
    behind = not_less(half - middle, contact * splat(extent.inverse_distance_min))
    maybe = not_less(best, splat(-extent.blur * SURE)) & (behind | doubtful) & used
    covering = maybe & ~doubtful & greater(worst, splat(extent.blur * SURE))
    if covering:
        covering &= greater(zero - middle - half, contact * splat(extent.inverse_distance_max))
        while covering:
            lane = first_lane(covering)
            if not equal_wide(points.own, extent.first, np.int32(CLUSTER * cluster + lane)):
                return maybe, True
            covering &= covering - 1
    return maybe, False


@inlined
def hide_by_faces(scene, points, view, space, at, faces, within, extent):
    """Return the mask of the points of a packet, of those within, that some face of a mask hides; face by face.

    `at` are the cluster's number and the slot that holds its set-up. No branch depends on what a test says: they could
    not be predicted, and cost more than the tests.
    """
    base, width = at[1] * SETUP_ROWS * CLUSTER, points.coordinates.shape[1]
    x, y = load_wide(space.image, 0), load_wide(space.image, PACKET)
    point = load3_wide(points.coordinates, extent.first, width)
    blur, error = extent.blur * SURE, PLANE_ERROR * extent.reach
    most, least, doubtful = extent.inverse_distance_max, extent.inverse_distance_min, space.doubtful[at[1]]
    hidden, doubt, doubt_faces = 0, 0, 0
    while faces:
        lane = first_lane(faces)
        faces &= faces - 1
        row = base + lane
        p, q, r = _edge_of(space, row, 0), _edge_of(space, row, 1), _edge_of(space, row, 2)
        inside = _inside(x, y, p, q, r)
        normal = numbers3(space.setups, row + NORMAL * CLUSTER, CLUSTER)
        height = number(space.setups, row + (NORMAL + 3) * CLUSTER) - dot3(point, normal, ZERO)
        contact = number(space.setups, row + CONTACT * CLUSTER)
        unknown = -((doubtful >> lane) & 1)
        possible = within & not_less(inside, -blur) & (not_less(height + error, contact * least) | unknown)
        possible &= ~equal_wide(points.own, extent.first, np.int32(at[0] * CLUSTER + lane))
        sure = possible & greater(inside, blur) & greater(height - error, contact * most) & ~unknown
        hidden |= sure
        doubt |= possible & ~sure
        doubt_faces |= np.int64((possible & ~sure) != 0) << lane
    if doubt & ~hidden:
        hidden |= decide(scene, points, view, at[0], doubt_faces, doubt & ~hidden, extent.first)
    return hidden


@inlined
def hide_by_points(scene, points, view, space, at, within, extent):
    """Return the mask of the points of a packet, of those within, that some face of a cluster hides; point by point."""
    base, width = at[1] * SETUP_ROWS * CLUSTER, points.coordinates.shape[1]
    p, q, r = _edge(space, base, 0), _edge(space, base, 1), _edge(space, base, 2)
    normal = load3(space.setups, base + NORMAL * CLUSTER, CLUSTER)
    offset = load(space.setups, base + (NORMAL + 3) * CLUSTER)
    contact = load(space.setups, base + CONTACT * CLUSTER)
    blur, error = splat(extent.blur * SURE), splat(PLANE_ERROR * extent.reach)
    most, least = contact * splat(extent.inverse_distance_max), contact * splat(extent.inverse_distance_min)
    no_blur, zero, doubtful, used = splat(-extent.blur * SURE), splat(ZERO), space.doubtful[at[1]], scene.used[at[0]]
    hidden, doubt, doubt_faces = 0, 0, 0
    while within:
        lane = first_lane(within)
        within &= within - 1
        i = extent.first + lane
        x, y = number(space.image, lane), number(space.image, PACKET + lane)
        inside = _inside(x, y, p, q, r)
        height = offset - dot3(numbers3(points.coordinates, i, width), normal, zero)
        possible = not_less(inside, no_blur) & (not_less(height + error, least) | doubtful)
        possible &= used & ~_own_face(points.own[i] - CLUSTER * at[0])
        sure = possible & greater(inside, blur) & greater(height - error, most) & ~doubtful
        unsure = possible & ~sure
        hidden |= np.int64(sure != 0) << lane
        doubt |= np.int64(unsure != 0) << lane
        doubt_faces |= unsure
    if doubt & ~hidden:
        hidden |= decide(scene, points, view, at[0], doubt_faces, doubt & ~hidden, extent.first)
    return hidden


@inlined
def _edge(space, base, edge):
    """An edge function of 16 faces."""
    return load3(space.setups, base + (EDGES + 3 * edge) * CLUSTER, CLUSTER)


@inlined
def _edge_of(space, row, edge):
    """An edge function of one face."""
    return numbers3(space.setups, row + (EDGES + 3 * edge) * CLUSTER, CLUSTER)


@inlined
def _inside(x, y, p, q, r):
    """The least of three edge functions: of points in a face, or of a point in faces."""
    inside = minimum(muladd(x, p[0], muladd(y, p[1], p[2])), muladd(x, q[0], muladd(y, q[1], q[2])))
    return minimum(inside, muladd(x, r[0], muladd(y, r[1], r[2])))


@inlined
def _own_face(lane):
    """Mask of one lane, if it is one of the 16."""
    return np.int64(0 <= lane < CLUSTER) << (lane & (CLUSTER - 1))
