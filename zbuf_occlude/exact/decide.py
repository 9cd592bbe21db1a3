"""Decisions in float64, by the definition itself, on the caller's own coordinates."""

import numpy as np

from zbuf_occlude.exact.layout import CHUNK, CLUSTER, PACKET, UPPER, ZERO
from zbuf_occlude.geometry.predicates import blocks
from zbuf_occlude.jit.compiler import inner
from zbuf_occlude.jit.simd import first_lane

BESIDE = 1e-6
"""A face blocks no line of sight that passes its box by this share of reach^2 / diagonal, `reach` being how far the
point is from mesh or eye: as the oracle (`visibility.oracle.ROUNDING`), which leaves out runs of faces so."""


@inner
def decide(scene, points, view, cluster, faces, doubt, first):
    """Mask of the points in doubt, numbered from `first` on, that one of a mask of a cluster's faces blocks."""
    hidden = 0
    while doubt:
        i = first_lane(doubt)
        doubt &= doubt - 1
        hidden |= np.int64(_faces_block(scene, points, view, first + i, cluster, faces)) << i
    return hidden


@inner
def _faces_block(scene, points, view, i, cluster, faces):
    """Whether one of a mask of a cluster's faces, not its own, blocks the line of sight of point i."""
    point = _world_point(points, i)
    while faces:
        lane = first_lane(faces)
        faces &= faces - 1
        is_own = points.own[i] == cluster * CLUSTER + lane
        if not is_own and _face_blocks(scene, view.world_eye, point, scene.face_ids[cluster, lane]):
            return True
    return False


@inner
def hide_near_points(scene, points, view, first, last, answer):
    """Write 0 for the hidden points of chunks first to last that are too near to an eye inside for any frame."""
    for packet in range(first * CHUNK, last * CHUNK):
        radius = view.near * max(points.reach[packet], view.reach) * 1.01
        apart = ZERO
        for axis in range(3):
            lower, upper = points.boxes[axis, packet], points.boxes[UPPER + axis, packet]
            apart = max(apart, lower - view.eye[axis], view.eye[axis] - upper)
        if apart > radius:
            continue
        for i in range(packet * PACKET, min((packet + 1) * PACKET, points.n_points)):
            if _is_near(points, view, i, radius) and _line_is_blocked(scene, points, view, i):
                answer[points.order[i]] = 0


@inner
def _is_near(points, view, i, radius):
    """Whether point i is within a cube about the eye."""
    away = ZERO
    for axis in range(3):
        away = max(away, abs(points.coordinates[axis, i] - view.eye[axis]))
    return away <= radius


@inner
def _line_is_blocked(scene, points, view, i):
    """Whether any face but its own blocks the line of sight of point i; asks those whose clusters' boxes it meets."""
    point, own = _world_point(points, i), points.own[i]
    # more than float64 can err
    margin = 1e-12 * ((1.0 + view.reach) / scene.scale + abs(scene.centre[0]) + abs(scene.centre[1]))
    margin += 1e-12 * abs(scene.centre[2])
    for cluster in range(len(scene.face_ids)):
        if not _segment_meets_box(view.world_eye, point, scene.world_boxes[cluster], margin):
            continue
        for lane in range(CLUSTER):
            face = scene.face_ids[cluster, lane]
            if face >= 0 and cluster * CLUSTER + lane != own and _face_blocks(scene, view.world_eye, point, face):
                return True
    return False


@inner
def _segment_meets_box(eye, point, box, margin):
    """Whether the segment (eye, point) may meet a box widened by `margin`; never False when it does."""
    enter, leave = 0.0, 1.0
    for axis in range(3):
        lower, upper = box[axis] - margin, box[UPPER + axis] + margin
        enter, leave = _within_slab(eye[axis], point[axis], lower, upper, enter, leave)
    return enter <= leave


@inner
def _within_slab(eye, point, lower, upper, enter, leave):
    """Of a part of a segment, from how many times its length after the eye to how many, what is between two walls."""
    low, high, step = lower - eye, upper - eye, point - eye
    if low <= 0.0 <= high and low <= step <= high:
        return enter, leave  # inside this slab all the way; no division by a small step
    if step == 0.0:
        return 1.0, 0.0
    first, second = low / step, high / step
    return max(enter, min(first, second)), min(leave, max(first, second))


@inner
def _face_blocks(scene, eye, point, face):
    """Whether a face blocks a line of sight: by the definition, and not where that can but be rounding."""
    corners = scene.world_corners[face]
    a, b, c = corners[0], corners[1], corners[2]
    by_definition = blocks(eye, point, (a[0], a[1], a[2]), (b[0], b[1], b[2]), (c[0], c[1], c[2]), scene.world_contact)
    return by_definition and not _passes_beside(scene, eye, point, corners)


@inner
def _passes_beside(scene, eye, point, corners):
    """Whether a line of sight passes beside a face's box: one in the face's plane to the last digit, whose volumes'
    signs are rounding."""
    reach, size = 2.0 / scene.scale, 0.0
    for axis in range(3):
        reach = max(reach, abs(eye[axis] - point[axis]), abs(point[axis] - scene.centre[axis]))
        size = max(size, abs(point[axis]))
    margin = BESIDE * (reach * scene.scale * reach + BESIDE * size)
    enter, leave = 0.0, 1.0
    for axis in range(3):
        one, two, three = corners[0, axis], corners[1, axis], corners[2, axis]
        lower, upper = min(one, two, three), max(one, two, three)
        enter, leave = _within_slab(eye[axis], point[axis], lower - margin, upper + margin, enter, leave)
    return enter > leave


@inner
def _world_point(points, i):
    k = points.order[i]
    return points.positions[k, 0], points.positions[k, 1], points.positions[k, 2]
