"""Packets of points: held against the listed clusters, until each point is hidden or no cluster is left."""

import numpy as np

from zbuf_occlude.exact.hide import classify, hide_by_faces, hide_by_points
from zbuf_occlude.exact.layout import BOTTOM, CLUSTER, COORDINATE_ERROR, LEFT, NEAREST, PACKET, RIGHT, TOP
from zbuf_occlude.exact.listing import overlapping
from zbuf_occlude.exact.triangle_setup import slot_of
from zbuf_occlude.jit.compiler import inlined
from zbuf_occlude.jit.simd import count_lanes, first_lane, load3_wide, not_less, number

FEW_POINTS = 5
"""Up to this many points are tested one by one against all faces of a cluster."""


@inlined
def search_packet(scene, points, view, undecided, extent, n, space):
    """Go through the n listed clusters until every point of a packet is hidden or none is left.

    `undecided` is the mask of the points in question; returns that of the hidden ones. ``space.image`` has the points'
    place in the image.
    """
    found_hidden = 0
    # more than a coordinate, or its sum with this, can err
    error = np.float32(1.5) * COORDINATE_ERROR * extent.blur * view.reach
    seen = load3_wide(space.image, 0, PACKET)
    least = seen[0] - error, seen[1] - error
    most = seen[0] + error, seen[1] + error, seen[2] + error
    for j in range(0, n, CLUSTER):
        found = overlapping(space.listed.rectangles, j, extent)
        if n - j < CLUSTER:
            found &= (1 << (n - j)) - 1
        while found:
            entry = j + first_lane(found)
            found &= found - 1
            within = undecided & _within(space, entry, least, most)
            if not within:
                continue
            hidden = _hide(scene, points, view, within, extent, space.listed.clusters[entry], space)
            found_hidden |= hidden
            undecided &= ~hidden
            if not undecided:
                _promote(space.listed, entry)
                return found_hidden
    return found_hidden


@inlined
def _within(space, entry, least, most):
    """Mask of the points in hand that are in a listed cluster's rectangle and not wholly before it.

    `least` and `most` are the points' x / w, y / w and w, less and more what they may err.
    """
    bounds, capacity = space.listed.rectangles, space.listed.rectangles.shape[1]
    return (
        not_less(most[0], number(bounds, LEFT * capacity + entry))
        & not_less(number(bounds, RIGHT * capacity + entry), least[0])
        & not_less(most[1], number(bounds, BOTTOM * capacity + entry))
        & not_less(number(bounds, TOP * capacity + entry), least[1])
        & not_less(most[2], number(bounds, NEAREST * capacity + entry))
    )


@inlined
def _hide(scene, points, view, within, extent, cluster, space):
    """Mask of the points in hand, of those within, that some face of a cluster hides."""
    slot = slot_of(scene, cluster, view, space)
    n_within = count_lanes(within)
    if n_within > FEW_POINTS:
        maybe, covers = classify(scene, points, space, slot, cluster, extent)
        if covers or not maybe:
            return within if covers else 0
        if count_lanes(maybe) <= n_within:
            return hide_by_faces(scene, points, view, space, (cluster, slot), maybe, within, extent)
    return hide_by_points(scene, points, view, space, (cluster, slot), within, extent)


@inlined
def _promote(listed, entry):
    """Move a cluster to the front of the list: what hides a packet is likely to hide the next."""
    listed.clusters[0], listed.clusters[entry] = listed.clusters[entry], listed.clusters[0]
    for row in range(6):
        first, other = listed.rectangles[row, 0], listed.rectangles[row, entry]
        listed.rectangles[row, 0], listed.rectangles[row, entry] = other, first


@inlined
def write_hidden(points, base, hidden, answer):
    """Enter the hidden points of a packet into the caller's order."""
    for i in range(base, min(base + PACKET, points.n_points)):
        answer[points.order[i]] &= ~(hidden >> (i - base)) & 1
