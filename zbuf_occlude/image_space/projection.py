"""Projection into a frame: boxes of nodes to rectangles, 16 faces to 48 edge functions scaled by their own error.

Error analysis, in float32 with unit roundoff u = 2^-24 and scene units (the mesh lies in the unit sphere).

* A projected coordinate is the product of a row of the frame (a unit vector) and a point, plus a number: with the
  rounding of what enters it errs by less than ``COORDINATE = 8 u`` times the point's `reach`, its distance from the
  centre or 1, or the eye's where coordinates are about the eye.
* The plane's value ``n . p - offset`` errs by less than ``PLANE = 12 u`` times the reach.
* An edge function is the determinant of P = (x / w, y / w, 1) and the edge's projected ends A and B, computed as
  P . (A x (B - A)). Let S be the largest norm of the face's projected corners, L that of their differences, |P| < 1.8
  reach. Arithmetic errs by less than 8 u |P| S L; the point's error moves the value by less than (23 reach / w + 2) u S
  L; the ends' by 14 u (|B x P| + |A x P|) where, for a P that sees the face, P is a combination of its corners with
  weights up to 1 / nearest (the smallest w at which the face is seen), hence by 28 u S L / nearest. `EDGE` = 80 u times
  S L max(1, 1 / nearest) times reach / w covers the sum; 80 u S (1 + L) does so without knowing `nearest`.
  A P that does not see the face needs no bound: the computed functions are those of one slightly moved triangle, and
  a point that lies inside that by more than the error lies inside the true one.

So edge functions are divided by their error for a point with reach / w = 1; comparing them with the packet's `blur`,
the largest such ratio, says what is certain.
"""

import numpy as np
from numba import njit

from zbuf_occlude.image_space.packets import CHUNK, PACKET
from zbuf_occlude.lanes import (
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
    square_root,
    store,
)

ROUNDOFF = np.float32(2.0**-24)
COORDINATE = np.float32(8.0) * ROUNDOFF
EDGE = np.float32(80.0) * ROUNDOFF
PLANE = np.float32(12.0) * ROUNDOFF
FAR = np.float32(3e38)
ZERO, ONE = np.float32(0.0), np.float32(1.0)

# rows of a cluster's set-up, 16 lanes each
EDGES = 0  # A, B, C of three edge functions A x + B y + C; all are >= 0 within the face
NORMAL = 9  # unit normal x, y, z and offset: n . p - offset is positive on the eye's side
CONTACT = 13  # contact tolerance times the eye's distance from the plane
ROWS = 14


@njit(_nrt=False)
def project_boxes(boxes, first, last, frame, window, slack, rectangles, at):  # type: ignore[no-untyped-def]
    """Project boxes into a frame, 16 at a time.

    Parameters
    ----------
    boxes : (6, total) float32, scene space
        Lower and upper corners.
    first, last : int
        Which; multiples of 16.
    frame : (12,) float32
    window, slack : float32
        Half-width of the window; what a projected coordinate may err.
    rectangles, at : (6, total) float32 and int
        Receives, from column `at` on, lowest x, highest x, lowest y, highest y, lowest w and highest w of each box,
        widened by `slack`. What lies behind the eye or beside the window gets an empty rectangle; what reaches
        behind the eye, an endless one.
    """
    total, width = boxes.shape[1], rectangles.shape[1]
    far, near, one, guard, edge = splat(FAR), splat(-FAR), splat(ONE), splat(slack), splat(window)
    for i in range(first, last, 16):
        px, py, pw = splat(frame[3]), splat(frame[7]), splat(frame[11])
        x0, x1, y0, y1, w0 = far, near, far, near, far
        left, right, below, above, w1 = near, near, near, near, near
        lower = (load(boxes, i), load(boxes, total + i), load(boxes, 2 * total + i))
        upper = (load(boxes, 3 * total + i), load(boxes, 4 * total + i), load(boxes, 5 * total + i))
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
        to = at + i - first
        store(rectangles, to, select(seen, x0, far))
        store(rectangles, width + to, select(seen, x1, near))
        store(rectangles, 2 * width + to, y0)
        store(rectangles, 3 * width + to, y1)
        store(rectangles, 4 * width + to, w0)
        store(rectangles, 5 * width + to, w1)


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
    slots, slot : (n_slots x 14 x 16,) float32 and int
        Receives `EDGES`, `NORMAL`, `CONTACT` of `slot`.
    rectangles : (n_slots, 5) float32
        Receives the rectangle around the cluster's faces, as in `project_boxes`.

    Returns
    -------
    int
        Mask of the faces that float32 must not decide: seen edge-on, or without a float32 plane.
    """
    used = scene.used[cluster]
    base = cluster * 144
    xa, ya, wa = project_corners(scene.corners, base, frame)
    xb, yb, wb = project_corners(scene.corners, base + 48, frame)
    xc, yc, wc = project_corners(scene.corners, base + 96, frame)
    one, zero, far = splat(ONE), splat(ZERO), splat(FAR)

    # the plane, turned so that the eye is on its positive side
    base = cluster * 64
    nx, ny, nz = load(scene.planes, base), load(scene.planes, base + 16), load(scene.planes, base + 32)
    offset = load(scene.planes, base + 48)
    height = muladd(nx, splat(eye[0]), muladd(ny, splat(eye[1]), muladd(nz, splat(eye[2]), zero - offset)))
    below = greater(zero, height)
    size = maximum(absolute(splat(eye[0])), maximum(absolute(splat(eye[1])), absolute(splat(eye[2]))))
    edge_on = not_less(splat(np.float32(2.0) * PLANE) * (size + one), absolute(height))
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
    span = maximum(maximum(_squared(xa, ya, wa), _squared(xb, yb, wb)), _squared(xc, yc, wc))
    length = maximum(maximum(_squared(ux, uy, uw), _squared(vx, vy, vw)), _squared(tx, ty, tw))
    span, length = square_root(span), square_root(length)
    ahead = greater(nearest, zero)
    stretch = maximum(one, divide(one, select(ahead, nearest, one)))
    error = minimum(select(ahead, length * stretch, far), one + length) * span * splat(EDGE * reach)
    scale = divide(one, maximum(error, splat(np.float32(1e-30))))
    turned = select(below, scale, zero - scale)
    a1, b1, c1 = _cross(xa, ya, wa, ux, uy, uw, turned)
    a2, b2, c2 = _cross(xb, yb, wb, vx, vy, vw, turned)
    a3, b3, c3 = _cross(xc, yc, wc, tx, ty, tw, turned)
    if doubtful:
        # which side is inside is unknown: a band about the longest edge that holds the face, or everything
        first, second, third = _squared(a1, b1, c1), _squared(a2, b2, c2), _squared(a3, b3, c3)
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
def project_corners(corners, base, frame):  # type: ignore[no-untyped-def]
    """Homogeneous coordinates of 16 corners."""
    x, y, z = load(corners, base), load(corners, base + 16), load(corners, base + 32)
    return (
        muladd(x, splat(frame[0]), muladd(y, splat(frame[1]), muladd(z, splat(frame[2]), splat(frame[3])))),
        muladd(x, splat(frame[4]), muladd(y, splat(frame[5]), muladd(z, splat(frame[6]), splat(frame[7])))),
        muladd(x, splat(frame[8]), muladd(y, splat(frame[9]), muladd(z, splat(frame[10]), splat(frame[11])))),
    )


@njit(_nrt=False, forceinline=True)
def _squared(x, y, w):  # type: ignore[no-untyped-def]
    return muladd(x, x, muladd(y, y, w * w))


@njit(_nrt=False, forceinline=True)
def _cross(x, y, w, dx, dy, dw, scale):  # type: ignore[no-untyped-def]
    """(x, y, w) x (dx, dy, dw), times scale."""
    return (y * dw - w * dy) * scale, (w * dx - x * dw) * scale, (x * dy - y * dx) * scale


@njit(_nrt=False, forceinline=True)
def distance_bounds(boxes, index, eye, contact):  # type: ignore[no-untyped-def]
    """Bounds of 1 / distance between the eye and a box of points.

    Returns
    -------
    nearer : float32
        At least 1 / (distance - contact) of any point; `FAR` when there is no bound.
    farther : float32
        At most 1 / distance of any point.
    """
    half = np.float32(0.5)
    x, hx = half * (boxes[0, index] + boxes[3, index]) - eye[0], half * (boxes[3, index] - boxes[0, index])
    y, hy = half * (boxes[1, index] + boxes[4, index]) - eye[1], half * (boxes[4, index] - boxes[1, index])
    z, hz = half * (boxes[2, index] + boxes[5, index]) - eye[2], half * (boxes[5, index] - boxes[2, index])
    distance, radius = np.sqrt(x * x + y * y + z * z), np.sqrt(hx * hx + hy * hy + hz * hz)
    least = distance * np.float32(0.999) - radius * np.float32(1.001) - contact
    return ONE / least if least > ZERO else FAR, ONE / ((distance + radius) * np.float32(1.001))


@njit(_nrt=False, forceinline=True)
def project_packet(points, base, frame):  # type: ignore[no-untyped-def]
    """Homogeneous coordinates of 16 points."""
    n = points.coordinates.shape[1]
    x, y, z = load(points.coordinates, base), load(points.coordinates, n + base), load(points.coordinates, 2 * n + base)
    return (
        muladd(x, splat(frame[0]), muladd(y, splat(frame[1]), muladd(z, splat(frame[2]), splat(frame[3])))),
        muladd(x, splat(frame[4]), muladd(y, splat(frame[5]), muladd(z, splat(frame[6]), splat(frame[7])))),
        muladd(x, splat(frame[8]), muladd(y, splat(frame[9]), muladd(z, splat(frame[10]), splat(frame[11])))),
    )


@njit(_nrt=False, forceinline=True)
def project_points(points, chunk, n_left, frame, window, near, eye, reach, contact, space):  # type: ignore[no-untyped-def]
    """Project the points of a chunk, 16 of the `n_left` packets in `space.left`.

    Fills `space.image`, `space.packets` and `space.undecided`.

    Points beside the window, or with w below `near` times their reach, are left out of `undecided`.

    Returns
    -------
    tuple of 9 float32, for the whole chunk what a row of `space.packets` is for a packet:
        lowest x, highest x, lowest y, highest y (widened by their error), highest w (negative: no point in the frame),
        blur, reach, and the bounds `nearer` and `farther` of `distance_bounds`.
    """
    x0, x1, y0, y1, w1, blur, farthest = FAR, -FAR, FAR, -FAR, -ONE, ZERO, ZERO
    nearer, farther = ZERO, FAR
    for packet in range(CHUNK):
        space.undecided[packet] = 0
        if chunk * CHUNK + packet >= n_left:
            continue
        index = space.left[chunk * CHUNK + packet]
        base = index * PACKET
        left = points.n_points - base
        own_reach = max(points.reach[index], reach)
        u, v, w = project_packet(points, base, frame)
        active = (1 << min(left, PACKET)) - 1
        if near > ZERO:
            rim = splat(window) * w
            active &= not_less(rim, absolute(u)) & not_less(rim, absolute(v)) & greater(w, splat(near * own_reach))
            if not active:
                continue
        space.undecided[packet] = active
        inverse = divide(splat(ONE), w)
        u, v = u * inverse, v * inverse
        store(space.image, packet * PACKET, u)
        store(space.image, (CHUNK + packet) * PACKET, v)
        if near > ZERO:
            # what is not in the frame must not widen its rectangle
            far, low = splat(FAR), splat(-FAR)
            left_most, right_most = lowest(select(active, u, far)), highest(select(active, u, low))
            down_most, up_most = lowest(select(active, v, far)), highest(select(active, v, low))
            deepest, closest = highest(select(active, w, low)), highest(select(active, inverse, low))
        else:
            left_most, right_most = lowest(u), highest(u)
            down_most, up_most = lowest(v), highest(v)
            deepest, closest = highest(w), highest(inverse)
        closest = max(ONE, closest)
        slack = COORDINATE * own_reach * closest * np.float32(3.0)
        own_nearer, own_farther = distance_bounds(points.boxes, index, eye, contact)
        row = (
            left_most - slack,
            right_most + slack,
            down_most - slack,
            up_most + slack,
            deepest + slack,
            closest * own_reach / reach,
            own_reach,
            own_nearer,
            own_farther,
        )
        for i in range(9):
            space.packets[packet, i] = row[i]
        x0, x1, y0, y1 = min(x0, row[0]), max(x1, row[1]), min(y0, row[2]), max(y1, row[3])
        w1, blur, farthest = max(w1, row[4]), max(blur, row[5]), max(farthest, own_reach)
        nearer, farther = max(nearer, own_nearer), min(farther, own_farther)
    return x0, x1, y0, y1, w1, blur, farthest, nearer, farther
