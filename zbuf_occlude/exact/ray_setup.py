"""Set-ups for rays: edge functions as for points (`search.setup`), and how far along a ray each face's plane is.

A ray's place in the image is P = (X, Y, 1). Where it meets a plane is monotone in g, which is linear in X and Y:

* inside, g = -1 / w, where w is in scene units along the frame's axis: -g = n . r / h with r = X right + Y up + forward
  and h = offset - n . eye.
* outside, g = D (1 - 1 / w), where w is 1 at the scene's centre, D away from the eye: so float32 resolves the scene
  equally well from any distance. g = (offset - X n . right - Y n . up) / h with h = offset / D + n . forward.

Error analysis, u = 2^-24, `size` as in `search.setup.set_up_planes`: normal, offset and frame are rounded once, so h
errs by less than ``PLANE_ERROR size`` (from outside, ``PLANE_ERROR``), and so g by that over h, relatively. The
numerator has three terms of at most 1.5, whose factors err by 8 u at most; with the rounding of products and sums it
errs by less than 48 u. `DEPTH_ERROR` and `HEIGHT_ERROR` have room for the rounding of the bounds themselves. Faces
whose h is below twice its error are left to float64.
"""

import numpy as np

from zbuf_occlude.exact.layout import (
    CLUSTER,
    EDGES,
    ENDLESS,
    NORMAL,
    ONE,
    PLANE_ERROR,
    ROUNDOFF,
    SETUP_ROWS,
    ZERO,
)
from zbuf_occlude.exact.triangle_setup import project_corner, set_up_edges, set_up_planes
from zbuf_occlude.jit.compiler import inlined, inner
from zbuf_occlude.jit.simd import absolute, divide, dot3, load, load3, muladd, not_less, select, splat, splat3, store

DEPTH = NORMAL
"""First of the rows with g = A x + B y + C, and its error, E + F |g|; in the place of the planes that points need."""

DEPTH_ERROR = np.float32(64.0) * ROUNDOFF
HEIGHT_ERROR = np.float32(2.0) * PLANE_ERROR


@inlined
def slot_of(scene, cluster, view, space):
    """Slot of the workspace that holds a cluster's set-up for this view, after setting it up if none does."""
    slot = cluster & (len(space.slot_tags) - 1)
    tag = view.number * len(scene.used) + cluster
    if space.slot_tags[slot] != tag:
        space.slot_tags[slot] = tag
        _set_up(scene, cluster, view, space, slot)
    return slot


@inner
def _set_up(scene, cluster, view, space, slot):
    """Fill in what the workspace has of a slot."""
    base = cluster * 9 * CLUSTER
    corners = (
        project_corner(scene, base, view),
        project_corner(scene, base + 3 * CLUSTER, view),
        project_corner(scene, base + 6 * CLUSTER, view),
    )
    below, doubtful = set_up_planes(scene, cluster, view, space, slot)
    set_up_edges(corners, below, doubtful, view, space, slot)
    space.doubtful[slot] = _set_up_depths(scene, cluster, view, doubtful, space, slot)


@inlined
def _set_up_depths(scene, cluster, view, doubtful, space, slot):
    """Write g and its error; return the mask of the faces whose g means nothing."""
    base, zero, one = cluster * 4 * CLUSTER, splat(ZERO), splat(ONE)
    normal, offset = load3(scene.planes, base, CLUSTER), load(scene.planes, base + 3 * CLUSTER)
    matrix = view.matrix
    x = dot3(normal, splat3((matrix[0], matrix[1], matrix[2])), zero)
    y = dot3(normal, splat3((matrix[4], matrix[5], matrix[6])), zero)
    w = dot3(normal, splat3((matrix[8], matrix[9], matrix[10])), zero)
    if view.near > ZERO:
        size = max(abs(view.eye[0]), abs(view.eye[1]), abs(view.eye[2])) + ONE
        height, constant = offset - dot3(normal, splat3(view.eye), zero), zero - w
    else:
        size = ONE
        away = np.sqrt(view.eye[0] * view.eye[0] + view.eye[1] * view.eye[1] + view.eye[2] * view.eye[2])
        height, constant = muladd(offset, splat(ONE / away), w * splat(away)), offset
    error = splat(HEIGHT_ERROR * size)
    unknown = doubtful | not_less(error, absolute(height))
    inverse = divide(one, select(unknown, one, height))
    row, width = (slot * SETUP_ROWS + DEPTH) * CLUSTER, CLUSTER
    store(space.setups, row, select(unknown, zero, zero - x * inverse))
    store(space.setups, row + width, select(unknown, zero, zero - y * inverse))
    store(space.setups, row + 2 * width, select(unknown, zero, constant * inverse))
    inverse = absolute(inverse)
    store(space.setups, row + 3 * width, select(unknown, splat(ENDLESS), inverse * splat(DEPTH_ERROR)))
    store(space.setups, row + 4 * width, select(unknown, zero, inverse * error))
    return unknown & scene.used[cluster]


@inlined
def faces_before(scene, cluster, space, slot, window, limit):
    """Mask of the faces of a cluster that may be met within a `Window` at a g of at most `limit`."""
    base = slot * SETUP_ROWS * CLUSTER
    half = np.float32(0.5)
    cx, hx = splat(half * (window.left + window.right)), splat(half * (window.right - window.left))
    cy, hy = splat(half * (window.bottom + window.top)), splat(half * (window.top - window.bottom))
    least = splat(-WITHIN)
    mask = scene.used[cluster]
    for edge in range(3):
        a, b, c = load3(space.setups, base + (EDGES + 3 * edge) * CLUSTER, CLUSTER)
        most = muladd(a, cx, muladd(b, cy, muladd(absolute(a), hx, muladd(absolute(b), hy, c))))
        mask &= not_less(most, least)
    row = base + DEPTH * CLUSTER
    a, b, c = load3(space.setups, row, CLUSTER)
    error, relative = load(space.setups, row + 3 * CLUSTER), load(space.setups, row + 4 * CLUSTER)
    side = muladd(absolute(a), hx, absolute(b) * hy)
    middle = muladd(a, cx, muladd(b, cy, c))
    nearest = middle - side - muladd(relative, absolute(middle) + side, error)
    return mask & not_less(splat(limit), nearest)


WITHIN = np.float32(1.001)
"""Edge functions beyond this are certain; they are in units of their error."""
