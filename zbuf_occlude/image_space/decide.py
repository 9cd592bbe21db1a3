"""Decisions in float64: one line of sight against the faces of the clusters whose boxes it passes through."""

import numpy as np
from numba import njit

from zbuf_occlude.image_space.packets import PACKET
from zbuf_occlude.predicates import blocks


@njit(_nrt=False)
def segment_meets_box(eye, point, lower, upper, margin):  # type: ignore[no-untyped-def]
    """Whether the segment (eye, point) may meet a box widened by `margin`; never False when it does."""
    enter, leave = 0.0, 1.0
    for axis in range(3):
        low, high = lower[axis] - margin - eye[axis], upper[axis] + margin - eye[axis]
        step = point[axis] - eye[axis]
        if low <= 0.0 <= high and low <= step <= high:
            continue  # inside this slab all the way; no division by a small step
        if step == 0.0:
            return False
        first, second = low / step, high / step
        enter = max(enter, min(first, second))
        leave = min(leave, max(first, second))
    return enter <= leave


@njit(_nrt=False)
def face_blocks(eye, point, corners, contact):  # type: ignore[no-untyped-def]
    """Ask the definition itself for one face; corners (3, 3) float64."""
    a = (corners[0, 0], corners[0, 1], corners[0, 2])
    b = (corners[1, 0], corners[1, 1], corners[1, 2])
    c = (corners[2, 0], corners[2, 1], corners[2, 2])
    return blocks(eye, point, a, b, c, contact)


@njit(_nrt=False)
def line_is_blocked(eye, point, own, face_ids, lower, upper, corners, contact, margin):  # type: ignore[no-untyped-def]
    """Whether any face but `own` blocks the line of sight, in float64.

    Parameters
    ----------
    eye, point : tuples of 3 float64, world space
    own : int
    face_ids : (m, 16) int32
        Faces of the clusters, -1 for none.
    lower, upper : (m, 3) float64
        Boxes of the clusters.
    corners : (f, 3, 3) float64
    contact, margin : float
        Contact tolerance; widening of the boxes, more than float64 can err.
    """
    for cluster in range(len(face_ids)):
        if segment_meets_box(eye, point, lower[cluster], upper[cluster], margin):
            for face in face_ids[cluster]:
                if face >= 0 and face != own and face_blocks(eye, point, corners[face], contact):
                    return True
    return False


@njit(_nrt=False)
def hide_near(scene, points, first, last, eye, near, reach, world_eye, answer):  # type: ignore[no-untyped-def]
    """Decide in float64 the points of packets first to last that are nearer to an eye inside than `near` times `reach`.

    Frames do not resolve them.
    """
    for index in range(first, last):
        radius = near * max(points.reach[index], reach) * np.float32(1.01)
        apart = np.float32(0.0)
        for axis in range(3):
            apart = max(apart, points.boxes[axis, index] - eye[axis], eye[axis] - points.boxes[3 + axis, index])
        if apart > radius:
            continue
        for i in range(index * PACKET, min((index + 1) * PACKET, points.n_points)):
            away = max(
                abs(points.coordinates[0, i] - eye[0]),
                abs(points.coordinates[1, i] - eye[1]),
                abs(points.coordinates[2, i] - eye[2]),
            )
            if away <= radius:
                k = points.order[i]
                point = (points.positions[k, 0], points.positions[k, 1], points.positions[k, 2])
                margin = 1e-12 * (1.0 + reach) / scene.scale
                for axis in range(3):
                    margin += 1e-12 * abs(scene.centre[axis])
                own = points.own[i]
                if line_is_blocked(
                    world_eye,
                    point,
                    scene.face_ids[own // 16, own % 16] if own >= 0 else -1,
                    scene.face_ids,
                    scene.lower,
                    scene.upper,
                    scene.world_corners,
                    scene.world_contact,
                    margin,
                ):
                    answer[k] = False
