"""Exhaustive search (paper 3.3 and 3.5): every point against every face, until a face occludes it."""

import math

import numpy as np
from numba import njit

from zbuf_occlude.base.arrays import BoolArray, FloatArray, IntArray
from zbuf_occlude.base.jit.threads import next_task, parallel_for, parallel_kernel
from zbuf_occlude.engines.object_space.planes import FacePlanes, occludes

NO_DISTANCES = np.empty(0)
"""Default distances, with which no face is excluded."""


def hidden_points(
    faces: FacePlanes,
    face_labels: IntArray,
    positions: FloatArray,
    labels: IntArray,
    eye: FloatArray,
    contact: float,
    distances: FloatArray = NO_DISTANCES,
) -> tuple[BoolArray, int]:
    """Find the points that some face hides from one eye.

    Parameters
    ----------
    faces : FacePlanes
        f faces.
    face_labels : (f, m) int32
        Labels of each face. A point is not tested against its own faces, which carry its label. For samples m = 1, and
        the label is the face's index. For vertices m = 3, and the labels are the ids of the face's corners.
    positions : (n, 3) float
        World space.
    labels : (n,) int32
        Label of each point; -1 for a point without faces of its own.
    eye : (3,) float
        World space.
    contact : float
        Contact tolerance tau, world units.
    distances : (f,) float, optional
        Distance from the eye to each face (`zbuf_occlude.engines.object_space.distances`). Faces farther than the point
        are excluded (paper 3.6, first and second suggestion).

    Returns
    -------
    hidden : (n,) bool
    n_tests : int
        Number of tested pairs of point and face (Eq. 6); the paper's ``k N M`` counts these.

    Notes
    -----
    O(n f) time at most, since a search stops at the first hiding face; no memory beyond the answer. All cores share the
    points. Each point tests the faces in the mesh's order.
    """
    hidden, n_tests = np.zeros(len(positions), dtype=np.bool_), np.zeros(len(positions), dtype=np.int64)
    parallel_for(
        _search,
        len(positions),
        faces.planes,
        faces.sides,
        faces.edges,
        face_labels,
        positions - faces.origin,
        labels,
        eye - faces.origin,
        contact,
        distances,
        hidden,
        n_tests,
    )
    return hidden, int(n_tests.sum())


@parallel_kernel
def _search(tasks, planes, sides, edges, face_labels, positions, labels, eye, contact, distances, hidden, n_tests):
    """Search the faces for one point after another."""
    cull = len(distances) > 0
    i = next_task(tasks)
    while i < len(positions):
        p = (positions[i, 0], positions[i, 1], positions[i, 2])
        u = (eye[0] - p[0], eye[1] - p[1], eye[2] - p[2])
        length = math.sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2])
        from_origin = math.sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2])
        tests = 0
        for face in range(len(planes)):
            if cull and distances[face] > length:
                continue
            tests += 1
            if occludes(p, u, from_origin, length, planes, sides, edges, face, contact) and not _carries(
                face_labels, face, labels[i]
            ):
                hidden[i] = True
                break
        n_tests[i] = tests
        i = next_task(tasks)


@njit
def _carries(face_labels: IntArray, face: int, label: int) -> bool:
    found = False
    for m in range(face_labels.shape[1]):
        found |= face_labels[face, m] == label
    return found
