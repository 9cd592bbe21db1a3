"""Contours: the edges at which the surface folds away from an eye or ends, in a grid over the image.

Between contours nothing begins or ceases to hide (see `regions`), so a face that none touches in the image is seen
as a whole or hidden as a whole. All is done in float32, and what is nearer than `PAD` touches.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from zbuf_occlude.arrays import IntArray
from zbuf_occlude.image_space.projection import FAR, ONE, PLANE, ZERO, project_corners
from zbuf_occlude.image_space.scene import Float32
from zbuf_occlude.image_space.sides import has
from zbuf_occlude.lanes import (
    absolute,
    divide,
    greater,
    load,
    maximum,
    minimum,
    muladd,
    not_less,
    select,
    splat,
)

SIDE = 64
"""Cells along each side of the image."""

PAD = np.float32(2e-5)
"""More than twice what float32 errs in x / w and y / w: 8 u (1 + 2.6) / w, as `projection` has it, w being 1/3 or more
for an eye outside; image units."""

TWICE = np.float32(2.0)


class Contours(NamedTuple):
    """A thread's workspace for up to n contours in up to 8 n cells altogether."""

    edges: IntArray  # (n,) of `Surface`
    ends: Float32  # (n, 6) where they begin and end, scene space
    images: Float32  # (n, 4) x and y of both ends
    boxes: Float32  # (n, 4) lowest x, highest x, lowest y, highest y, widened by PAD
    heads: IntArray  # (SIDE^2,) first entry of each cell, -1 for none
    listed: IntArray  # (8 n,) contour of an entry
    following: IntArray  # (8 n,) next entry of its cell, -1 for none
    met: IntArray  # (n,) the cluster that met the contour last
    grid: Float32  # (4,) x and y of the first cell's corner, cells per unit along x and y
    totals: NDArray[np.int64]  # (2,) how many contours, and entries, there are


@njit
def make_contours(n):  # type: ignore[no-untyped-def]
    """Allocate for n contours."""
    return Contours(
        np.empty(n, dtype=np.int32),
        np.empty((n, 6), dtype=np.float32),
        np.empty((n, 4), dtype=np.float32),
        np.empty((n, 4), dtype=np.float32),
        np.empty(SIDE * SIDE, dtype=np.int32),
        np.empty(8 * n, dtype=np.int32),
        np.empty(8 * n, dtype=np.int32),
        np.empty(n, dtype=np.int32),
        np.empty(4, dtype=np.float32),
        np.zeros(2, dtype=np.int64),
    )


@njit(_nrt=False, forceinline=True)
def image_of(x, y, z, frame):  # type: ignore[no-untyped-def]
    """Where a point of scene space is seen: x / w, y / w and w."""
    w = frame[8] * x + frame[9] * y + frame[10] * z + frame[11]
    return (
        (frame[0] * x + frame[1] * y + frame[2] * z + frame[3]) / w,
        (frame[4] * x + frame[5] * y + frame[6] * z + frame[7]) / w,
        w,
    )


@njit(_nrt=False)
def find_contours(surface, front, back, frame, contours):  # type: ignore[no-untyped-def]
    """List the contours; return False where there are too many."""
    n, x0, x1, y0, y1 = 0, FAR, -FAR, FAR, -FAR
    for edge in range(len(surface.edges)):
        a, b = surface.edges[edge]
        if b >= 0 and (has(front, a) & has(front, b)) | (has(back, a) & has(back, b)):
            continue
        if n == len(contours.met):
            return False
        contours.edges[n], contours.met[n] = edge, -1
        for i in range(2):
            px, py, pz = surface.ends[edge, i, 0], surface.ends[edge, i, 1], surface.ends[edge, i, 2]
            x, y, _ = image_of(px, py, pz, frame)
            contours.ends[n, 3 * i], contours.ends[n, 3 * i + 1], contours.ends[n, 3 * i + 2] = px, py, pz
            contours.images[n, 2 * i], contours.images[n, 2 * i + 1] = x, y
            x0, x1, y0, y1 = min(x0, x), max(x1, x), min(y0, y), max(y1, y)
        px, py, qx, qy = contours.images[n]
        contours.boxes[n, 0], contours.boxes[n, 1] = min(px, qx) - PAD, max(px, qx) + PAD
        contours.boxes[n, 2], contours.boxes[n, 3] = min(py, qy) - PAD, max(py, qy) + PAD
        n += 1
    side = np.float32(SIDE)
    contours.grid[0], contours.grid[1] = x0, y0
    contours.grid[2], contours.grid[3] = side / max(x1 - x0, PAD), side / max(y1 - y0, PAD)
    contours.heads[:] = -1
    contours.totals[0], contours.totals[1] = n, 0
    fits = True
    for i in range(n):
        fits = fits and _list_contour(contours, i)
    return fits


@njit(_nrt=False, forceinline=True)
def _cell(value, contours, axis):  # type: ignore[no-untyped-def]
    """Cell of a coordinate along an axis. Monotone, so what lies within an interval lies within its cells."""
    return np.int64(min(max((value - contours.grid[axis]) * contours.grid[2 + axis], ZERO), np.float32(SIDE - 1)))


@njit(_nrt=False, forceinline=True)
def _list_contour(contours, i):  # type: ignore[no-untyped-def]
    """Enter a contour into the cells that it passes; False where they do not fit."""
    ax, ay, bx, by = contours.images[i]
    if ay > by:
        ax, ay, bx, by = bx, by, ax, ay
    first, last = _cell(contours.boxes[i, 2], contours, 1), _cell(contours.boxes[i, 3], contours, 1)
    to, height = contours.totals[1], ONE / contours.grid[3]
    beside = max(np.float32(0.1) * height, TWICE * PAD)
    for row in range(first, last + 1):
        x0, x1 = contours.boxes[i, 0], contours.boxes[i, 1]
        if by - ay > height:
            # the part that passes this row of cells and some of the next ones
            slope = (bx - ax) / (by - ay)
            low = contours.grid[1] + np.float32(row) * height - beside if row > first else ay
            high = contours.grid[1] + np.float32(row + 1) * height + beside if row < last else by
            begin, end = ax + (low - ay) * slope, ax + (high - ay) * slope
            x0, x1 = max(x0, min(begin, end) - PAD), min(x1, max(begin, end) + PAD)
        for column in range(_cell(x0, contours, 0), _cell(x1, contours, 0) + 1):
            if to == len(contours.listed):
                return False
            at = row * SIDE + column
            contours.listed[to], contours.following[to] = i, contours.heads[at]
            contours.heads[at] = to
            to += 1
    contours.totals[1] = to
    return True


@njit(_nrt=False, forceinline=True)
def meet(cluster, rectangle, contours, met):  # type: ignore[no-untyped-def]
    """List in `met` the contours whose rectangles overlap a cluster's; return how many, -1 where it cannot take them.

    `rectangle` is a tuple of 4 float32: lowest x, highest x, lowest y, highest y.
    """
    x0, x1, y0, y1 = rectangle
    box, n = contours.boxes, 0
    left, right = _cell(x0, contours, 0), _cell(x1, contours, 0)
    for row in range(_cell(y0, contours, 1), _cell(y1, contours, 1) + 1):
        for at in range(row * SIDE + left, row * SIDE + right + 1):
            entry = contours.heads[at]
            while entry >= 0:
                i = contours.listed[entry]
                entry = contours.following[entry]
                if contours.met[i] != cluster:
                    contours.met[i] = cluster
                    if box[i, 0] <= x1 and box[i, 1] >= x0 and box[i, 2] <= y1 and box[i, 3] >= y0:
                        if n == len(met):
                            return -1
                        met[n] = i
                        n += 1
    return n


@njit(_nrt=False)
def touch(scene, cluster, wanted, eye, frame, contours, met, n, masks):  # type: ignore[no-untyped-def]
    """Find which faces of a cluster contours touch in the image, but for those behind a face's plane.

    Parameters
    ----------
    scene : Scene
    cluster : int
    wanted : int
        Mask of the faces meant, none of which is seen edge-on.
    eye : tuple of 3 float32, scene space
    frame : (12,) float32
    contours : Contours
    met, n : int32 array and int
        The contours in question are the first n of `met`.
    masks : int32 array
        Receives for each a mask of faces.
    """
    (ax, ay), (bx, by), (cx, cy) = _images(scene, cluster, frame)
    nx, ny, nz, offset = _planes(scene, cluster, eye)
    low_x, high_x = minimum(ax, minimum(bx, cx)), maximum(ax, maximum(bx, cx))
    low_y, high_y = minimum(ay, minimum(by, cy)), maximum(ay, maximum(by, cy))
    # edges turned so that the face lies to their left
    zero = splat(ZERO)
    one = select(greater(zero, (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)), splat(-ONE), splat(ONE))
    abx, aby = (bx - ax) * one, (by - ay) * one
    bcx, bcy = (cx - bx) * one, (cy - by) * one
    cax, cay = (ax - cx) * one, (ay - cy) * one
    size = high_x - low_x + (high_y - low_y)
    box, end = contours.boxes, contours.ends
    for j in range(n):
        i = met[j]
        masks[j] = 0
        found = (
            wanted
            & not_less(splat(box[i, 1]), low_x)
            & not_less(high_x, splat(box[i, 0]))
            & not_less(splat(box[i, 3]), low_y)
            & not_less(high_y, splat(box[i, 2]))
        )
        if not found:
            continue
        px, py = splat(contours.images[i, 0]), splat(contours.images[i, 1])
        qx, qy = splat(contours.images[i, 2]), splat(contours.images[i, 3])
        # the products below err by less than PAD times the lengths that enter them, twice
        ex, ey = qx - px, qy - py
        away = absolute(ax - px) + absolute(ay - py)
        guard = (size + size + away + away + absolute(ex) + absolute(ey)) * splat(TWICE * PAD)
        below = zero - guard
        found &= ~_beyond(ax, ay, abx, aby, px, py, qx, qy, below)
        found &= ~_beyond(bx, by, bcx, bcy, px, py, qx, qy, below)
        found &= ~_beyond(cx, cy, cax, cay, px, py, qx, qy, below)
        u = ex * (ay - py) - ey * (ax - px)
        v = ex * (by - py) - ey * (bx - px)
        w = ex * (cy - py) - ey * (cx - px)
        found &= ~(greater(minimum(u, minimum(v, w)), guard) | greater(below, maximum(u, maximum(v, w))))
        if found:
            p = _height(nx, ny, nz, offset, end[i, 0], end[i, 1], end[i, 2])
            q = _height(nx, ny, nz, offset, end[i, 3], end[i, 4], end[i, 5])
            masks[j] = found & ~greater(splat(-TWICE * PLANE), maximum(p, q))


@njit(_nrt=False, forceinline=True)
def _images(scene, cluster, frame):  # type: ignore[no-untyped-def]
    """x / w and y / w of the three corners of a cluster's faces."""
    base = cluster * 144
    ax, ay, aw = project_corners(scene.corners, base, frame)
    bx, by, bw = project_corners(scene.corners, base + 48, frame)
    cx, cy, cw = project_corners(scene.corners, base + 96, frame)
    one = splat(ONE)
    aw, bw, cw = divide(one, aw), divide(one, bw), divide(one, cw)
    return (ax * aw, ay * aw), (bx * bw, by * bw), (cx * cw, cy * cw)


@njit(_nrt=False, forceinline=True)
def _planes(scene, cluster, eye):  # type: ignore[no-untyped-def]
    """The planes of a cluster's faces, turned so that the eye is on the positive side."""
    base = cluster * 64
    nx, ny, nz = load(scene.planes, base), load(scene.planes, base + 16), load(scene.planes, base + 32)
    offset = load(scene.planes, base + 48)
    one = select(greater(splat(ZERO), _height(nx, ny, nz, offset, *eye)), splat(-ONE), splat(ONE))
    return nx * one, ny * one, nz * one, offset * one


@njit(_nrt=False, forceinline=True)
def _height(nx, ny, nz, offset, x, y, z):  # type: ignore[no-untyped-def]
    """Height of a point above planes."""
    return muladd(nx, splat(x), muladd(ny, splat(y), muladd(nz, splat(z), splat(ZERO) - offset)))


@njit(_nrt=False, forceinline=True)
def _beyond(x, y, dx, dy, px, py, qx, qy, below):  # type: ignore[no-untyped-def]
    """Mask of the edges, from (x, y) along (dx, dy), to the right of which both p and q lie."""
    u, v = dx * (py - y) - dy * (px - x), dx * (qy - y) - dy * (qx - x)
    return greater(below, maximum(u, v))
