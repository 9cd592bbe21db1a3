"""Triangle set-up: edge functions, in units of their error, and planes of the 16 faces of a leaf in a view.

Error analysis, continued from `project`: u is float32's unit roundoff, *magnitude* as there.

* A corner is the sum of the first corner and an edge, all rounded: it errs by 3 u more than a rounded position, and its
  projected coordinates by less than ``CORNER_ERROR = 11 u`` times the magnitude.
* The plane's value ``n . p - offset`` errs by less than ``PLANE_ERROR = 12 u`` times the magnitude.
* An edge function is the determinant of P = (x / w, y / w, 1) and the edge's projected ends A and B, computed as
  P . (A x (B - A)). Let S be the largest norm of the face's projected corners, L that of their differences, |P| < 1.8
  magnitude. Arithmetic errs by less than 8 u |P| S L. The point's error moves the value by less than
  (23 magnitude / w + 2) u S L. The ends' errors move it by 19.1 u (|B x P| + |A x P|). Let `nearest` be the smallest w
  at which the face is seen. A P inside the projected face is a combination of its corners with weights up to
  1 / nearest, so the ends' errors move it by 39 u S L / nearest. ``EDGE_ERROR`` = 80 u times S L max(1, 1 / nearest)
  times magnitude / w covers the sum; 80 u S (1 + L) covers it without knowing `nearest`. A P outside the face needs no
  bound: the computed functions are those of a slightly moved triangle, and a point inside that by more than the error
  is inside the true triangle.

Edge functions are therefore divided by their error for a point with magnitude / w = 1. Comparing them with the points'
`error_scale`, the largest magnitude / w, tells which answers are certain.

A doubtful face has a band about its longest edge instead, for its inner side is unknown. On the projected face that
edge's function is the *volume*, the determinant of the corners, times a weight of at most `stretch` = max(1, 1 /
nearest). The volume errs by 19.1 u magnitude for each of three cross products of at most S L. Its arithmetic errs by
8 u S L S, and S < 2.6 magnitude, so the sum is below 80 u S L magnitude. Times `stretch`, in units of the edges' error,
that is `doubt` = max(1, L stretch / (1 + L)). On each side of the edge, the band is 1 + 2 doubt + volume stretch wide.

Rays also need the depth of each face's plane. A ray's position in the image is P = (X, Y, 1). The distance at which it
meets a plane is monotone in g, which is linear in X and Y:

* For an eye inside, g = -1 / w, with w in scene units along the frame's axis. With r = X right + Y up + forward and
  h = offset - n . eye, -g = n . r / h.
* For an eye outside, g = D (1 - 1 / w). Here w is 1 at the scene's centre, at the distance D from the eye, so that
  float32 resolves the scene equally well from any distance. With h = offset / D + n . forward,
  g = (offset - X n . right - Y n . up) / h.

Let `size` be as in `_set_up_planes`. Normal, offset and frame are rounded once, so h errs by less than ``PLANE_ERROR
size`` (from outside, ``PLANE_ERROR``), and g by that over h, relatively. The numerator has three terms of at most 1.5,
whose factors err by 8 u at most; with the rounding of products and sums it errs by less than 48 u. `DEPTH_ERROR` and
`HEIGHT_ERROR` have a margin for the rounding of the bounds themselves. If h is below twice its error, float64 decides.
"""

import numpy as np

from zbuf_occlude.base.jit.compiler import always_inline, device_function
from zbuf_occlude.base.jit.simd import (
    absolute,
    blend,
    cross3,
    divide,
    dot3,
    greater,
    highest,
    load,
    load3,
    lowest,
    maximum,
    minimum,
    muladd,
    not_less,
    splat,
    splat3,
    square_root,
    store,
    store3,
    transform,
)
from zbuf_occlude.base.jit.vec3 import minus
from zbuf_occlude.engines.exact.bvh import corners_in_leaf
from zbuf_occlude.engines.exact.layout import (
    BOTTOM,
    CONTACT,
    CORNER_ERROR,
    EDGE_ERROR,
    EDGES,
    F32_MAX,
    HALF,
    LEAF,
    LEFT,
    MAX_W,
    MIN_W,
    NORMAL,
    ONE,
    PLANE_ERROR,
    RIGHT,
    ROUNDOFF,
    SETUP_ROWS,
    TOP,
    ZERO,
)

DEPTH = NORMAL
"""First row of g = A x + B y + C and its error E + F |g|; these rows replace the planes that points need."""
DEPTH_ERROR = np.float32(64.0) * ROUNDOFF
HEIGHT_ERROR = np.float32(2.0) * PLANE_ERROR
CERTAIN = np.float32(1.001)
"""Value of all edge functions, in units of their error, above which a ray certainly passes through the face."""


@always_inline
def slot_of(bvh, leaf, view, space, set_up):
    """Return the slot of a leaf's set-up for this view; fill it by `set_up` (for points or for rays) if need be."""
    slot = leaf & (len(space.slot_tags) - 1)
    tag = view.number * len(bvh.used) + leaf
    if space.slot_tags[slot] != tag:
        space.slot_tags[slot] = tag
        set_up(bvh, leaf, view, space, slot)
    return slot


@device_function
def set_up_for_points(bvh, leaf, view, space, slot):
    """Write edge functions, planes and the rectangle around a leaf's faces to a slot."""
    corners, doubtful = _set_up_faces(bvh, leaf, view, space, slot)
    space.doubtful[slot] = doubtful
    _bound(corners, bvh.used[leaf], view, space, slot)


@device_function
def set_up_for_rays(bvh, leaf, view, space, slot):
    """Write edge functions and depths of a leaf's faces to a slot."""
    _, doubtful = _set_up_faces(bvh, leaf, view, space, slot)
    space.doubtful[slot] = _set_up_depths(bvh, leaf, view, doubtful, space, slot)


@always_inline
def _set_up_faces(bvh, leaf, view, space, slot):
    """Write planes and edge functions; return the projected corners and the mask of the doubtful faces."""
    a, b, c = corners_in_leaf(bvh, leaf)
    corners = transform(view.matrix, *a), transform(view.matrix, *b), transform(view.matrix, *c)
    below, doubtful = _set_up_planes(bvh, leaf, view, space, slot)
    _set_up_edges(corners, below, doubtful, view, space, slot)
    return corners, doubtful


@always_inline
def _set_up_planes(bvh, leaf, view, space, slot):
    """Write planes, turned so that the eye is on their positive side.

    Returns
    -------
    below, doubtful : int
        Masks of the faces that were turned, and of those seen edge-on or without a float32 plane.
    """
    base, used, zero = leaf * 4 * LEAF, bvh.used[leaf], splat(ZERO)
    normal, offset = load3(bvh.planes, base, LEAF), load(bvh.planes, base + 3 * LEAF)
    height = dot3(normal, splat3(view.eye)) - offset
    below = greater(zero, height)
    size = max(abs(view.eye[0]), abs(view.eye[1]), abs(view.eye[2])) + ONE
    edge_on = not_less(splat(np.float32(2.0) * PLANE_ERROR * size), absolute(height))
    row = (slot * SETUP_ROWS + NORMAL) * LEAF
    for axis in range(3):
        store(space.setups, row + axis * LEAF, blend(below, -normal[axis], normal[axis]))
    store(space.setups, row + 3 * LEAF, blend(below, -offset, offset))
    row = (slot * SETUP_ROWS + CONTACT) * LEAF
    store(space.setups, row, absolute(height) * splat(np.float32(bvh.contact)))
    return below, (edge_on | bvh.weak[leaf]) & used


@always_inline
def _set_up_edges(corners, below, doubtful, view, space, slot):
    """Write edge functions P . (A x (B - A)), turned like the planes, in units of their error."""
    a, b, c = corners
    one, zero, endless = splat(ONE), splat(ZERO), splat(F32_MAX)
    # smallest w at which the frame can show the face: that of its corners, or its distance from the eye
    nearest = minimum(a[2], minimum(b[2], c[2]))
    if view.near > ZERO:
        aside = maximum(
            maximum(minimum(a[0], minimum(b[0], c[0])), -maximum(a[0], maximum(b[0], c[0]))),
            maximum(minimum(a[1], minimum(b[1], c[1])), -maximum(a[1], maximum(b[1], c[1]))),
        )
        nearest = maximum(nearest, aside * splat(ONE / (view.half_width * np.float32(1.001))))
    nearest = nearest - splat(CORNER_ERROR * view.magnitude)
    ab, bc, ca = minus(b, a), minus(c, b), minus(a, c)
    span = square_root(maximum(maximum(dot3(a, a), dot3(b, b)), dot3(c, c)))
    length = square_root(maximum(maximum(dot3(ab, ab), dot3(bc, bc)), dot3(ca, ca)))
    ahead = greater(nearest, zero)
    stretch = maximum(one, divide(one, blend(ahead, nearest, one)))
    size = minimum(blend(ahead, length * stretch, endless), one + length) * span
    scale = divide(one, maximum(size * splat(EDGE_ERROR * view.magnitude), splat(np.float32(1e-30))))
    scale = blend(below, scale, -scale)
    p, q, r = _scaled(cross3(a, ab), scale), _scaled(cross3(b, bc), scale), _scaled(cross3(c, ca), scale)
    if doubtful:
        # the inner side is unknown: take a band about the longest edge that holds the face, or the whole image
        first, second, third = dot3(p, p), dot3(q, q), dot3(r, r)
        is_second, is_third = greater(second, maximum(first, third)), greater(third, maximum(first, second))
        edge = _chosen(is_third, r, _chosen(is_second, q, p))
        # the determinant of the corners is the value of each edge function at the opposite corner
        volume = absolute(dot3(p, c))
        doubt = maximum(one, divide(length * stretch, one + length))
        band = divide(one, one + doubt + doubt + volume * stretch)
        edge = _scaled(edge, blend(ahead, band, zero))
        p = _chosen(doubtful, edge, p)
        q = _chosen(doubtful, _scaled(edge, -one), q)
        r = _chosen(doubtful, (zero, zero, zero), r)
    row = (slot * SETUP_ROWS + EDGES) * LEAF
    store3(space.setups, row, LEAF, p)
    store3(space.setups, row + 3 * LEAF, LEAF, q)
    store3(space.setups, row + 6 * LEAF, LEAF, r)


@always_inline
def _scaled(a, scale):
    return a[0] * scale, a[1] * scale, a[2] * scale


@always_inline
def _chosen(mask, a, b):
    return blend(mask, a[0], b[0]), blend(mask, a[1], b[1]), blend(mask, a[2], b[2])


@always_inline
def _bound(corners, used, view, space, slot):
    """Write the rectangle around the faces, as `project.project_boxes` does."""
    a, b, c = corners
    far, low = splat(F32_MAX), splat(-F32_MAX)
    error, bounds = CORNER_ERROR * view.magnitude, space.slot_rectangles
    nearest = lowest(blend(used, minimum(a[2], minimum(b[2], c[2])), far)) - error
    bounds[MIN_W, slot] = nearest
    bounds[MAX_W, slot] = highest(blend(used, maximum(a[2], maximum(b[2], c[2])), low)) + error
    if nearest <= ZERO:
        bounds[LEFT, slot], bounds[RIGHT, slot] = -F32_MAX, F32_MAX
        bounds[BOTTOM, slot], bounds[TOP, slot] = -F32_MAX, F32_MAX
        return
    ia, ib, ic = divide(splat(ONE), a[2]), divide(splat(ONE), b[2]), divide(splat(ONE), c[2])
    margin = error * np.float32(1.01) / nearest
    xa, xb, xc, ya, yb, yc = a[0] * ia, b[0] * ib, c[0] * ic, a[1] * ia, b[1] * ib, c[1] * ic
    bounds[LEFT, slot] = lowest(blend(used, minimum(xa, minimum(xb, xc)), far)) - margin
    bounds[RIGHT, slot] = highest(blend(used, maximum(xa, maximum(xb, xc)), low)) + margin
    bounds[BOTTOM, slot] = lowest(blend(used, minimum(ya, minimum(yb, yc)), far)) - margin
    bounds[TOP, slot] = highest(blend(used, maximum(ya, maximum(yb, yc)), low)) + margin


@always_inline
def _set_up_depths(bvh, leaf, view, doubtful, space, slot):
    """Write g and its error; return the mask of the faces whose g is unknown."""
    base, zero, one = leaf * 4 * LEAF, splat(ZERO), splat(ONE)
    normal, offset = load3(bvh.planes, base, LEAF), load(bvh.planes, base + 3 * LEAF)
    matrix = view.matrix
    x = dot3(normal, splat3((matrix[0], matrix[1], matrix[2])))
    y = dot3(normal, splat3((matrix[4], matrix[5], matrix[6])))
    w = dot3(normal, splat3((matrix[8], matrix[9], matrix[10])))
    if view.near > ZERO:
        size = max(abs(view.eye[0]), abs(view.eye[1]), abs(view.eye[2])) + ONE
        height, constant = offset - dot3(normal, splat3(view.eye)), -w
    else:
        size = ONE
        away = np.sqrt(view.eye[0] * view.eye[0] + view.eye[1] * view.eye[1] + view.eye[2] * view.eye[2])
        height, constant = muladd(offset, splat(ONE / away), w * splat(away)), offset
    error = splat(HEIGHT_ERROR * size)
    unknown = doubtful | not_less(error, absolute(height))
    inverse = divide(one, blend(unknown, one, height))
    row, width = (slot * SETUP_ROWS + DEPTH) * LEAF, LEAF
    store(space.setups, row, blend(unknown, zero, -x * inverse))
    store(space.setups, row + width, blend(unknown, zero, -y * inverse))
    store(space.setups, row + 2 * width, blend(unknown, zero, constant * inverse))
    inverse = absolute(inverse)
    store(space.setups, row + 3 * width, blend(unknown, splat(F32_MAX), inverse * splat(DEPTH_ERROR)))
    store(space.setups, row + 4 * width, blend(unknown, zero, inverse * error))
    return unknown & bvh.used[leaf]


@always_inline
def faces_before(bvh, leaf, space, slot, rect, limit):
    """Return the mask of the faces of a leaf that may be met within an `ImageRect` at a g of at most `limit`."""
    base = slot * SETUP_ROWS * LEAF
    cx, hx = splat(HALF * (rect.left + rect.right)), splat(HALF * (rect.right - rect.left))
    cy, hy = splat(HALF * (rect.bottom + rect.top)), splat(HALF * (rect.top - rect.bottom))
    least = splat(-CERTAIN)
    mask = bvh.used[leaf]
    for edge in range(3):
        a, b, c = load3(space.setups, base + (EDGES + 3 * edge) * LEAF, LEAF)
        most = muladd(a, cx, muladd(b, cy, muladd(absolute(a), hx, muladd(absolute(b), hy, c))))
        mask &= not_less(most, least)
    row = base + DEPTH * LEAF
    a, b, c = load3(space.setups, row, LEAF)
    error, relative = load(space.setups, row + 3 * LEAF), load(space.setups, row + 4 * LEAF)
    side = muladd(absolute(a), hx, absolute(b) * hy)
    middle = muladd(a, cx, muladd(b, cy, c))
    nearest = middle - side - muladd(relative, absolute(middle) + side, error)
    return mask & not_less(splat(limit), nearest)
