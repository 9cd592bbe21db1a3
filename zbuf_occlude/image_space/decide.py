"""Decisions in float64: one line of sight against the faces of the clusters whose boxes it passes through."""

from numba import njit

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
