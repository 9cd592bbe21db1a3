"""Set-ups: the 16 faces of a cluster as a view sees them, in edge functions scaled by their own error, and planes.

Error analysis, continued from `project`: u is float32's unit roundoff, *reach* a point's distance from the centre or 1.

* The plane's value ``n . p - offset`` errs by less than ``PLANE_ERROR = 12 u`` times the reach.
* An edge function is the determinant of P = (x / w, y / w, 1) and the edge's projected ends A and B, computed as
  P . (A x (B - A)). Let S be the largest norm of the face's projected corners, L that of their differences, |P| < 1.8
  reach. Arithmetic errs by less than 8 u |P| S L; the point's error moves the value by less than (23 reach / w + 2) u S
  L; the ends' by 14 u (|B x P| + |A x P|) where, for a P that sees the face, P is a combination of its corners with
  weights up to 1 / nearest (the smallest w at which the face is seen), hence by 28 u S L / nearest. ``EDGE_ERROR`` =
  80 u times S L max(1, 1 / nearest) times reach / w covers the sum; 80 u S (1 + L) does so without knowing `nearest`.
  A P that does not see the face needs no bound: the computed functions are those of one slightly moved triangle, and
  a point that lies inside that by more than the error lies inside the true one.

So edge functions are divided by their error for a point with reach / w = 1; comparing them with the points' `blur`,
the largest such ratio, says what is certain.
"""

import numpy as np

from zbuf_occlude.exact.layout import (
    BOTTOM,
    CLUSTER,
    CONTACT,
    COORDINATE_ERROR,
    EDGE_ERROR,
    EDGES,
    ENDLESS,
    FARTHEST,
    LEFT,
    NEAREST,
    NORMAL,
    ONE,
    PLANE_ERROR,
    RIGHT,
    SETUP_ROWS,
    TOP,
    ZERO,
)
from zbuf_occlude.jit.compiler import inlined, inner
from zbuf_occlude.jit.simd import (
    absolute,
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
    not_less,
    select,
    splat,
    splat3,
    square_root,
    store,
    store3,
    transform,
)


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
    base, used = cluster * 9 * CLUSTER, scene.used[cluster]
    corners = (
        project_corner(scene, base, view),
        project_corner(scene, base + 3 * CLUSTER, view),
        project_corner(scene, base + 6 * CLUSTER, view),
    )
    below, doubtful = set_up_planes(scene, cluster, view, space, slot)
    space.doubtful[slot] = doubtful
    set_up_edges(corners, below, doubtful, view, space, slot)
    _bound(corners, used, view, space, slot)


@inlined
def project_corner(scene, base, view):
    """Homogeneous coordinates of a corner of 16 faces, which begins at a flat index of the scene's."""
    x, y, z = load3(scene.corners, base, CLUSTER)
    return transform(view.matrix, x, y, z)


@inlined
def set_up_planes(scene, cluster, view, space, slot):
    """Write planes, turned so that the eye is on their positive side.

    Returns
    -------
    below, doubtful : int
        Masks of the faces that were turned, and of those seen edge-on or without a float32 plane.
    """
    base, used, zero = cluster * 4 * CLUSTER, scene.used[cluster], splat(ZERO)
    normal, offset = load3(scene.planes, base, CLUSTER), load(scene.planes, base + 3 * CLUSTER)
    height = dot3(normal, splat3(view.eye), zero - offset)
    below = greater(zero, height)
    size = max(abs(view.eye[0]), abs(view.eye[1]), abs(view.eye[2])) + ONE
    edge_on = not_less(splat(np.float32(2.0) * PLANE_ERROR * size), absolute(height))
    row = (slot * SETUP_ROWS + NORMAL) * CLUSTER
    for axis in range(3):
        store(space.setups, row + axis * CLUSTER, select(below, zero - normal[axis], normal[axis]))
    store(space.setups, row + 3 * CLUSTER, select(below, zero - offset, offset))
    row = (slot * SETUP_ROWS + CONTACT) * CLUSTER
    store(space.setups, row, absolute(height) * splat(np.float32(scene.contact)))
    return below, (edge_on | scene.weak[cluster]) & used


@inlined
def set_up_edges(corners, below, doubtful, view, space, slot):
    """Write edge functions P . (A x (B - A)), turned like the planes, in units of their error."""
    a, b, c = corners
    one, zero, endless = splat(ONE), splat(ZERO), splat(ENDLESS)
    # nearest w at which the window can show the face: of its corners, or its distance from the eye
    nearest = minimum(a[2], minimum(b[2], c[2]))
    if view.near > ZERO:
        aside = maximum(
            maximum(minimum(a[0], minimum(b[0], c[0])), zero - maximum(a[0], maximum(b[0], c[0]))),
            maximum(minimum(a[1], minimum(b[1], c[1])), zero - maximum(a[1], maximum(b[1], c[1]))),
        )
        nearest = maximum(nearest, aside * splat(ONE / (view.window * np.float32(1.001))))
    nearest = nearest - splat(COORDINATE_ERROR * view.reach)
    ab, bc, ca = _difference(b, a), _difference(c, b), _difference(a, c)
    span = square_root(maximum(maximum(dot3(a, a, zero), dot3(b, b, zero)), dot3(c, c, zero)))
    length = square_root(maximum(maximum(dot3(ab, ab, zero), dot3(bc, bc, zero)), dot3(ca, ca, zero)))
    ahead = greater(nearest, zero)
    stretch = maximum(one, divide(one, select(ahead, nearest, one)))
    size = minimum(select(ahead, length * stretch, endless), one + length) * span
    scale = divide(one, maximum(size * splat(EDGE_ERROR * view.reach), splat(np.float32(1e-30))))
    scale = select(below, scale, zero - scale)
    p, q, r = _scaled(cross3(a, ab), scale), _scaled(cross3(b, bc), scale), _scaled(cross3(c, ca), scale)
    if doubtful:
        # which side is inside is unknown: a band about the longest edge that holds the face, or everything
        first, second, third = dot3(p, p, zero), dot3(q, q, zero), dot3(r, r, zero)
        is_second, is_third = greater(second, maximum(first, third)), greater(third, maximum(first, second))
        edge = _chosen(is_third, r, _chosen(is_second, q, p))
        # the determinant of the corners is what each edge function is at the corner across
        volume = absolute(dot3(p, c, zero))
        band = divide(one, splat(np.float32(3.0)) + volume * stretch)
        edge = _scaled(edge, select(ahead, band, zero))
        p = _chosen(doubtful, edge, p)
        q = _chosen(doubtful, _scaled(edge, zero - one), q)
        r = _chosen(doubtful, (zero, zero, zero), r)
    row = (slot * SETUP_ROWS + EDGES) * CLUSTER
    store3(space.setups, row, CLUSTER, p)
    store3(space.setups, row + 3 * CLUSTER, CLUSTER, q)
    store3(space.setups, row + 6 * CLUSTER, CLUSTER, r)


@inlined
def _difference(a, b):
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@inlined
def _scaled(a, scale):
    return a[0] * scale, a[1] * scale, a[2] * scale


@inlined
def _chosen(mask, a, b):
    return select(mask, a[0], b[0]), select(mask, a[1], b[1]), select(mask, a[2], b[2])


@inlined
def _bound(corners, used, view, space, slot):
    """Write the rectangle around the faces, as `project.project_boxes` does."""
    a, b, c = corners
    far, low = splat(ENDLESS), splat(-ENDLESS)
    error, bounds = COORDINATE_ERROR * view.reach, space.slot_rectangles
    nearest = lowest(select(used, minimum(a[2], minimum(b[2], c[2])), far)) - error
    bounds[NEAREST, slot] = nearest
    bounds[FARTHEST, slot] = highest(select(used, maximum(a[2], maximum(b[2], c[2])), low)) + error
    if nearest <= ZERO:
        bounds[LEFT, slot], bounds[RIGHT, slot] = -ENDLESS, ENDLESS
        bounds[BOTTOM, slot], bounds[TOP, slot] = -ENDLESS, ENDLESS
        return
    ia, ib, ic = divide(splat(ONE), a[2]), divide(splat(ONE), b[2]), divide(splat(ONE), c[2])
    blur = error * np.float32(1.01) / nearest
    xa, xb, xc, ya, yb, yc = a[0] * ia, b[0] * ib, c[0] * ic, a[1] * ia, b[1] * ib, c[1] * ic
    bounds[LEFT, slot] = lowest(select(used, minimum(xa, minimum(xb, xc)), far)) - blur
    bounds[RIGHT, slot] = highest(select(used, maximum(xa, maximum(xb, xc)), low)) + blur
    bounds[BOTTOM, slot] = lowest(select(used, minimum(ya, minimum(yb, yc)), far)) - blur
    bounds[TOP, slot] = highest(select(used, maximum(ya, maximum(yb, yc)), low)) + blur
