"""Projection into a frame: boxes of nodes to rectangles, 16 faces to 48 edge functions scaled by their own error.

Error analysis, in float32 with unit roundoff u = 2^-24, scene units (the mesh lies in the unit sphere).

* A projected coordinate (x, y, w) is a sum of four products; with the rounding of its inputs it errs by less than
  ``COORDINATE = 16 u`` times the largest coordinate involved (`reach`: 1 or the farthest of the point, the mesh, and
  the eye where coordinates are about the eye).
* An edge function is the determinant of the point P = (x / w, y / w, 1) and the edge's projected ends, computed as
  P . (A x (B - A)). With S the largest 1-norm of the face's projected corners and L that of their differences, it
  errs for a point of the face by less than u S L (7 |P| + 32 reach(P) / w + 64 / nearest): rounding; the point's own
  error; that of the ends, where a P within the face is a combination of its corners with weights up to 1 / nearest,
  nearest = the smallest w of the face. `EDGE` covers the sum. Outside the face no bound is needed: computed edge
  functions are those of one slightly moved triangle, so a point that they place inside it by more than their error is
  inside the true one, and a point of the true one they cannot place outside by more than their error.
* The distance from a face's plane errs by less than ``PLANE = 16 u`` times the point's reach.

So the functions are scaled such that 1 is their error for a point with reach / w = 1, and comparing with the packet's
`blur` (the largest such ratio) decides what is certain.
"""

import numpy as np
from numba import njit

from zbuf_occlude.image_space.lanes import (
    absolute,
    divide,
    greater,
    highest,
    load,
    lowest,
    maximum,
    minimum,
    muladd,
    not_less,
    select,
    splat,
    store,
)

ROUNDOFF = np.float32(2.0**-24)
COORDINATE = np.float32(16.0) * ROUNDOFF
EDGE = np.float32(128.0) * ROUNDOFF
PLANE = np.float32(16.0) * ROUNDOFF
FAR = np.float32(3e38)
ZERO, ONE = np.float32(0.0), np.float32(1.0)

# rows of a cluster's set-up, 16 lanes each
EDGES = 0  # A, B, C of three edge functions A x + B y + C; all are >= 0 within the face
NORMAL = 9  # unit normal x, y, z and offset: n . p - offset is positive on the eye's side
CONTACT = 13  # contact tolerance times the eye's distance from the plane
ROWS = 14


@njit(_nrt=False)
def project_nodes(nodes, frame, window, slack, rectangles):  # type: ignore[no-untyped-def]
    """Project boxes into a frame.

    Parameters
    ----------
    nodes : (6, total) float32, scene space
    frame : (12,) float32
    window, slack : float32
        Half-width of the window; what a projected coordinate may err.
    rectangles : (5, total) float32
        Receives lowest x, highest x, lowest y, highest y, and lowest w of each box, widened by `slack`. What lies behind
        the eye or beside the window gets an empty rectangle; what reaches behind the eye, an endless one.
    """
    total = nodes.shape[1]
    far, near, one, guard, edge = splat(FAR), splat(-FAR), splat(ONE), splat(slack), splat(window)
    for i in range(0, total, 16):
        px, py, pw = splat(frame[3]), splat(frame[7]), splat(frame[11])
        x0, x1, y0, y1, w0 = far, near, far, near, far
        left, right, below, above, w1 = near, near, near, near, near
        lower = (load(nodes, i), load(nodes, total + i), load(nodes, 2 * total + i))
        upper = (load(nodes, 3 * total + i), load(nodes, 4 * total + i), load(nodes, 5 * total + i))
        for corner in range(8):
            x = upper[0] if corner & 1 else lower[0]
            y = upper[1] if corner & 2 else lower[1]
            z = upper[2] if corner & 4 else lower[2]
            u = muladd(x, splat(frame[0]), muladd(y, splat(frame[1]), muladd(z, splat(frame[2]), px)))
            v = muladd(x, splat(frame[4]), muladd(y, splat(frame[5]), muladd(z, splat(frame[6]), py)))
            w = muladd(x, splat(frame[8]), muladd(y, splat(frame[9]), muladd(z, splat(frame[10]), pw)))
            inverse = divide(one, w)
            blur = guard * inverse
            su, sv = u * inverse, v * inverse
            x0, x1 = minimum(x0, su - blur), maximum(x1, su + blur)
            y0, y1 = minimum(y0, sv - blur), maximum(y1, sv + blur)
            w0, w1 = minimum(w0, w - guard), maximum(w1, w + guard)
            reach = edge * w
            left, right = maximum(left, u + reach), maximum(right, reach - u)
            below, above = maximum(below, v + reach), maximum(above, reach - v)
        zero = splat(ZERO)
        # a box that is not wholly before the eye has no rectangle of its own
        whole = greater(w0, zero)
        x0, x1 = select(whole, x0, near), select(whole, x1, far)
        y0, y1 = select(whole, y0, near), select(whole, y1, far)
        rim = splat(-slack * window * np.float32(2.0)) if window < np.float32(1e3) else near
        seen = (
            not_less(w1, zero)
            & not_less(left, rim)
            & not_less(right, rim)
            & not_less(below, rim)
            & not_less(above, rim)
        )
        store(rectangles, i, select(seen, x0, far))
        store(rectangles, total + i, select(seen, x1, near))
        store(rectangles, 2 * total + i, y0)
        store(rectangles, 3 * total + i, y1)
        store(rectangles, 4 * total + i, w0)


@njit(_nrt=False)
def set_up(scene, cluster, frame, window, eye, reach, slots, slot, rectangles):  # type: ignore[no-untyped-def]
    """Project the faces of a cluster and write their edge functions and planes.

    Parameters
    ----------
    scene : Scene
    cluster : int
    frame : (12,) float32
    window : float32
    eye : tuple of 3 float32, scene space
    reach : float32
        Largest coordinate that enters projected ones: 1, or the eye's where coordinates are about it.
    slots : (n_slots x 14 x 16,) float32
        Receives `EDGES`, `NORMAL`, `CONTACT` of `slot`.
    rectangles : (n_slots, 5) float32
        Receives the rectangle around the cluster's faces, as in `project_nodes`.

    Returns
    -------
    int
        Mask of the faces that float32 must not decide: seen edge-on, or without a float32 plane.
    """
    used = scene.used[cluster]
    base = cluster * 144
    xa, ya, wa = _project(scene.corners, base, frame)
    xb, yb, wb = _project(scene.corners, base + 48, frame)
    xc, yc, wc = _project(scene.corners, base + 96, frame)
    one, zero, far = splat(ONE), splat(ZERO), splat(FAR)

    # the plane, turned so that the eye is on its positive side
    base = cluster * 64
    nx, ny, nz = load(scene.planes, base), load(scene.planes, base + 16), load(scene.planes, base + 32)
    offset = load(scene.planes, base + 48)
    height = muladd(nx, splat(eye[0]), muladd(ny, splat(eye[1]), muladd(nz, splat(eye[2]), zero - offset)))
    below = greater(zero, height)
    size = maximum(absolute(splat(eye[0])), maximum(absolute(splat(eye[1])), absolute(splat(eye[2]))))
    edge_on = not_less(splat(PLANE) * (size + one), absolute(height))
    doubtful = (edge_on | scene.weak[cluster]) & used
    row = slot * ROWS * 16
    store(slots, row + 16 * NORMAL, select(below, zero - nx, nx))
    store(slots, row + 16 * (NORMAL + 1), select(below, zero - ny, ny))
    store(slots, row + 16 * (NORMAL + 2), select(below, zero - nz, nz))
    store(slots, row + 16 * (NORMAL + 3), select(below, zero - offset, offset))
    store(slots, row + 16 * CONTACT, absolute(height) * splat(np.float32(scene.contact)))

    # nearest w at which the window can show the face: of its corners, or its distance from the eye
    w0 = minimum(wa, minimum(wb, wc))
    nearest = w0
    if window < np.float32(1e3):
        aside = maximum(
            maximum(minimum(xa, minimum(xb, xc)), zero - maximum(xa, maximum(xb, xc))),
            maximum(minimum(ya, minimum(yb, yc)), zero - maximum(ya, maximum(yb, yc))),
        )
        nearest = maximum(w0, aside * splat(ONE / (window * np.float32(1.001))))
    nearest = nearest - splat(COORDINATE * reach)

    # edge functions P . (A x (B - A)), oriented by the plane's side, divided by their error
    ux, uy, uw = xb - xa, yb - ya, wb - wa
    vx, vy, vw = xc - xb, yc - yb, wc - wb
    tx, ty, tw = xa - xc, ya - yc, wa - wc
    span = maximum(
        maximum(_norm(xa, ya, wa), _norm(xb, yb, wb)),
        _norm(xc, yc, wc),
    )
    length = maximum(maximum(_norm(ux, uy, uw), _norm(vx, vy, vw)), _norm(tx, ty, tw))
    ahead = greater(nearest, zero)
    stretch = maximum(one, divide(one, select(ahead, nearest, one)))
    error = minimum(select(ahead, length * stretch, far), (span + span) * splat(np.float32(2.0)))
    error = error * span * splat(EDGE * reach)
    scale = divide(one, maximum(error, splat(np.float32(1e-30))))
    turned = select(below, scale, zero - scale)
    a1, b1, c1 = _cross(xa, ya, wa, ux, uy, uw, turned)
    a2, b2, c2 = _cross(xb, yb, wb, vx, vy, vw, turned)
    a3, b3, c3 = _cross(xc, yc, wc, tx, ty, tw, turned)
    if doubtful:
        # which side is inside is unknown: a band about the longest edge that holds the face, or everything
        first, second, third = _norm(a1, b1, c1), _norm(a2, b2, c2), _norm(a3, b3, c3)
        is_second = greater(second, maximum(first, third))
        is_third = greater(third, maximum(first, second))
        a = select(is_third, a3, select(is_second, a2, a1))
        b = select(is_third, b3, select(is_second, b2, b1))
        c = select(is_third, c3, select(is_second, c2, c1))
        # the determinant of the corners is what each edge function is at the corner across
        volume = absolute(muladd(a1, xc, muladd(b1, yc, c1 * wc)))
        band = divide(one, splat(np.float32(3.0)) + volume * stretch)
        band = select(ahead, band, zero)
        a, b, c = a * band, b * band, c * band
        a1, b1, c1 = select(doubtful, a, a1), select(doubtful, b, b1), select(doubtful, c, c1)
        a2, b2, c2 = select(doubtful, zero - a, a2), select(doubtful, zero - b, b2), select(doubtful, zero - c, c2)
        a3, b3, c3 = select(doubtful, zero, a3), select(doubtful, zero, b3), select(doubtful, zero, c3)
    store(slots, row, a1)
    store(slots, row + 16, b1)
    store(slots, row + 32, c1)
    store(slots, row + 48, a2)
    store(slots, row + 64, b2)
    store(slots, row + 80, c2)
    store(slots, row + 96, a3)
    store(slots, row + 112, b3)
    store(slots, row + 128, c3)

    slack = COORDINATE * reach
    floor = lowest(select(used, w0, far)) - slack
    rectangles[slot, 4] = floor
    if floor > ZERO:
        ia, ib, ic = divide(one, wa), divide(one, wb), divide(one, wc)
        xa, xb, xc = xa * ia, xb * ib, xc * ic
        ya, yb, yc = ya * ia, yb * ib, yc * ic
        blur = slack * np.float32(1.01) / floor
        rectangles[slot, 0] = lowest(select(used, minimum(xa, minimum(xb, xc)), far)) - blur
        rectangles[slot, 1] = highest(select(used, maximum(xa, maximum(xb, xc)), splat(-FAR))) + blur
        rectangles[slot, 2] = lowest(select(used, minimum(ya, minimum(yb, yc)), far)) - blur
        rectangles[slot, 3] = highest(select(used, maximum(ya, maximum(yb, yc)), splat(-FAR))) + blur
    else:
        rectangles[slot, 0] = rectangles[slot, 2] = -FAR
        rectangles[slot, 1] = rectangles[slot, 3] = FAR
    return doubtful


@njit(_nrt=False, forceinline=True)
def _project(corners, base, frame):  # type: ignore[no-untyped-def]
    """Homogeneous coordinates of 16 corners."""
    x, y, z = load(corners, base), load(corners, base + 16), load(corners, base + 32)
    return (
        muladd(x, splat(frame[0]), muladd(y, splat(frame[1]), muladd(z, splat(frame[2]), splat(frame[3])))),
        muladd(x, splat(frame[4]), muladd(y, splat(frame[5]), muladd(z, splat(frame[6]), splat(frame[7])))),
        muladd(x, splat(frame[8]), muladd(y, splat(frame[9]), muladd(z, splat(frame[10]), splat(frame[11])))),
    )


@njit(_nrt=False, forceinline=True)
def _norm(x, y, w):  # type: ignore[no-untyped-def]
    return absolute(x) + absolute(y) + absolute(w)


@njit(_nrt=False, forceinline=True)
def _cross(x, y, w, dx, dy, dw, scale):  # type: ignore[no-untyped-def]
    """(x, y, w) x (dx, dy, dw), times scale."""
    return (y * dw - w * dy) * scale, (w * dx - x * dw) * scale, (x * dy - y * dx) * scale
