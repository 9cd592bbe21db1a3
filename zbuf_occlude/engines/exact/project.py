"""Projection of points, and of boxes around points and faces, into a view.

Error analysis, in float32 with unit roundoff u = 2^-24 and scene units (the mesh lies in the unit sphere). A projected
coordinate is the product of a row of the matrix (a unit vector) and a point, plus a number. With the rounding of its
operands it errs by less than ``COORDINATE_ERROR = 8 u`` times the point's *magnitude*: its distance from the centre, at
least 1, and at least the eye's distance where coordinates are relative to the eye.
"""

from typing import NamedTuple

import numpy as np

from zbuf_occlude.base.jit.compiler import always_inline, device_function
from zbuf_occlude.base.jit.simd import (
    absolute,
    blend,
    divide,
    greater,
    highest,
    load3,
    load3_wide,
    lowest,
    maximum,
    minimum,
    not_less,
    splat,
    store,
    transform,
)
from zbuf_occlude.engines.exact.layout import (
    BOTTOM,
    COORDINATE_ERROR,
    F32_MAX,
    GROUP,
    HALF,
    LEAF,
    LEFT,
    MAX_W,
    MIN_W,
    ONE,
    PACKET,
    RIGHT,
    TOP,
    UPPER,
    ZERO,
)


class ImageRect(NamedTuple):
    """Rectangle around points or rays in the image: bounds of x / w and y / w, widened by their error; largest w."""

    left: np.float32
    right: np.float32
    bottom: np.float32
    top: np.float32
    max_w: np.float32


class PacketRect(NamedTuple):
    """Rectangle around a packet's points in the image, and error bounds of their tests."""

    first: int  # index of the first point, in the packets' order
    left: np.float32
    right: np.float32
    bottom: np.float32
    top: np.float32
    max_w: np.float32
    error_scale: np.float32  # error of an edge function, relative to that of a point with magnitude / w = 1
    magnitude: np.float32  # largest distance of the points and the eye from the scene's centre, at least 1
    inverse_distance_max: np.float32  # upper bound of 1 / (distance from the eye - contact tolerance), or `F32_MAX`
    inverse_distance_min: np.float32  # lower bound of 1 / distance from the eye


@device_function
def project_boxes(boxes, index, stride, view, error, rectangles, to):
    """Project 16 boxes to rectangles.

    The boxes' bounds are read at flat indices `index`, `index + stride`, ...; the rectangles are written at `to`,
    `to + 16`, ...

    Rectangles are widened by `error`, the error bound of a projected coordinate. A box behind the eye or outside the
    frame gets an empty rectangle; a box that extends behind the eye gets an infinite one.
    """
    far, near, guard, edge = splat(F32_MAX), splat(-F32_MAX), splat(error), splat(view.half_width)
    x0, x1, y0, y1, w0, w1 = far, near, far, near, far, near
    left, right, below, above = near, near, near, near
    lower, upper = load3(boxes, index, stride), load3(boxes, UPPER * stride + index, stride)
    for corner in range(8):
        x = upper[0] if corner & 1 else lower[0]
        y = upper[1] if corner & 2 else lower[1]
        z = upper[2] if corner & 4 else lower[2]
        u, v, w = transform(view.matrix, x, y, z)
        inverse = divide(splat(ONE), w)
        margin = guard * inverse
        su, sv = u * inverse, v * inverse
        x0, x1 = minimum(x0, su - margin), maximum(x1, su + margin)
        y0, y1 = minimum(y0, sv - margin), maximum(y1, sv + margin)
        w0, w1 = minimum(w0, w - guard), maximum(w1, w + guard)
        rim = edge * w
        left, right = maximum(left, u + rim), maximum(right, rim - u)
        below, above = maximum(below, v + rim), maximum(above, rim - v)
    # a box that extends behind the eye has no finite rectangle
    whole = greater(w0, splat(ZERO))
    slack = splat(-error * view.half_width * np.float32(2.0)) if view.near > ZERO else near
    seen = not_less(w1, splat(ZERO)) & not_less(left, slack) & not_less(right, slack)
    seen &= not_less(below, slack) & not_less(above, slack)
    store(rectangles, LEFT * LEAF + to, blend(seen, blend(whole, x0, near), far))
    store(rectangles, RIGHT * LEAF + to, blend(seen, blend(whole, x1, far), near))
    store(rectangles, BOTTOM * LEAF + to, blend(whole, y0, near))
    store(rectangles, TOP * LEAF + to, blend(whole, y1, far))
    store(rectangles, MIN_W * LEAF + to, w0)
    store(rectangles, MAX_W * LEAF + to, w1)


@device_function
def rect_of_chunk(chunk, view, rectangles):
    """Return the rectangle of a chunk; `rectangles` holds the projected boxes of its group."""
    column, edge = chunk % GROUP, view.half_width * np.float32(1.001)
    return ImageRect(
        left=max(rectangles[LEFT, column], -edge),
        right=min(rectangles[RIGHT, column], edge),
        bottom=max(rectangles[BOTTOM, column], -edge),
        top=min(rectangles[TOP, column], edge),
        max_w=rectangles[MAX_W, column],
    )


@always_inline
def is_empty(rect):
    """Return whether the frame shows none of the points."""
    return not rect.left <= rect.right


@device_function
def union(a, b):
    """Return the rectangle around two rectangles."""
    if is_empty(a) or is_empty(b):
        return b if is_empty(a) else a
    return ImageRect(
        left=min(a.left, b.left),
        right=max(a.right, b.right),
        bottom=min(a.bottom, b.bottom),
        top=max(a.top, b.top),
        max_w=max(a.max_w, b.max_w),
    )


@always_inline
def project_packet(bvh, points, packet, view, image):
    """Project the points of a packet into `image`, (3, 32): x / w, y / w and w.

    Returns
    -------
    PacketRect
    int
        Mask of the points in the frame: without padding, points outside the frame, and points too near to the eye.
    """
    base, total = packet * PACKET, points.coordinates.shape[1]
    magnitude = max(points.magnitudes[packet], view.magnitude)
    shown = (1 << min(points.n_points - base, PACKET)) - 1
    x, y, z = load3_wide(points.coordinates, base, total)
    u, v, w = transform(view.matrix, x, y, z)
    if view.near > ZERO:
        rim = view.half_width * w
        shown &= not_less(rim, absolute(u)) & not_less(rim, absolute(v)) & greater(w, view.near * magnitude)
    inverse = divide(ONE, w)
    u, v = u * inverse, v * inverse
    store(image, 0, u)
    store(image, PACKET, v)
    store(image, 2 * PACKET, w)
    # points outside the frame must not widen the rectangle
    inverse_max = max(ONE, highest(blend(shown, inverse, -F32_MAX)))
    slack = np.float32(3.0) * COORDINATE_ERROR * magnitude * inverse_max
    bounds = _inverse_distances(points.boxes, packet, view, np.float32(bvh.contact))
    rect = PacketRect(
        first=base,
        left=lowest(blend(shown, u, F32_MAX)) - slack,
        right=highest(blend(shown, u, -F32_MAX)) + slack,
        bottom=lowest(blend(shown, v, F32_MAX)) - slack,
        top=highest(blend(shown, v, -F32_MAX)) + slack,
        max_w=highest(blend(shown, w, -F32_MAX)) + slack,
        error_scale=inverse_max * magnitude / view.magnitude,
        magnitude=magnitude,
        inverse_distance_max=bounds[0],
        inverse_distance_min=bounds[1],
    )
    return rect, shown


@always_inline
def _inverse_distances(boxes, i, view, contact):
    """Return `inverse_distance_max` and `inverse_distance_min` of the points in a box."""
    distance_squared, radius_squared = ZERO, ZERO
    for axis in range(3):
        lower, upper = boxes[axis, i], boxes[UPPER + axis, i]
        away, half = HALF * (lower + upper) - view.eye[axis], HALF * (upper - lower)
        distance_squared += away * away
        radius_squared += half * half
    distance, radius = np.sqrt(distance_squared), np.sqrt(radius_squared)
    least = distance * np.float32(0.999) - radius * np.float32(1.001) - contact
    most = (distance + radius) * np.float32(1.001)  # zero for points at the eye
    return ONE / least if least > ZERO else F32_MAX, ONE / most if most > ZERO else F32_MAX
