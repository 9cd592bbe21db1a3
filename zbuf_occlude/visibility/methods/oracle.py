"""`oracle`: the reference, every point and every ray against every face, by the definition."""

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from zbuf_occlude.base.arrays import BoolArray, FloatArray, IntArray, as_number, unit_vectors
from zbuf_occlude.base.errors import check_fraction
from zbuf_occlude.base.jit.compiler import device_function
from zbuf_occlude.base.jit.threads import next_task, parallel_for, parallel_kernel
from zbuf_occlude.base.jit.vec3 import dot, minus
from zbuf_occlude.base.precompiler import Compilation
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.geometry.predicates import blocks, is_nearer, passes, ray_triangle_t
from zbuf_occlude.meshes.sampling import SurfacePoints
from zbuf_occlude.visibility.interface import CONTACT, FirstHits, VisibilityQuery

RUN = 64
"""Faces tested per vectorised step."""

SLANT = 5.0
"""Distance from the point, in units of the shift, within which a face that blocks the shifted line is taken for the
point's own surface, slanted by up to 79 degrees, and not for a silhouette."""

BAND = 1e-6
"""Default width of the boundary band, as a fraction of the bounding box's diagonal (docs/conventions.md)."""


def prepare(mesh: Mesh, *, contact: float = CONTACT) -> "Oracle":
    """Prepare a mesh; `contact` is the contact tolerance as a fraction of the mesh's diagonal."""
    check_fraction("contact", contact)
    return Oracle(mesh, contact)


class Oracle(VisibilityQuery):
    """Brute force over all faces, own face excluded, stopping at the first that blocks.

    Notes
    -----
    Exact: the answers of rational arithmetic (`geometry.predicates`). Costs O(k n f) time in the worst case and no
    memory beyond the answer; runs on all cores.
    """

    def __init__(self, mesh: Mesh, contact: float) -> None:
        super().__init__(mesh)
        self.contact = contact * mesh.diagonal

    def _visible(self, points: SurfacePoints, eyes: FloatArray) -> BoolArray:
        return _visible(self.mesh, points.face_ids, points.positions[None], eyes, self.contact)

    def _first_hits(self, origins: FloatArray, directions: FloatArray) -> FirstHits:
        face_ids, distances = np.empty(len(directions), dtype=np.int32), np.empty(len(directions))
        parallel_for(
            _meet, len(directions), _runs_of(self.mesh), self.mesh.corners, origins, directions, face_ids, distances
        )
        return FirstHits(face_ids, distances)

    def decided(self, points: SurfacePoints, eyes: FloatArray, width: float = BAND) -> BoolArray:
        """Return where the answer is stable; the rest lie in the boundary band.

        Parameters
        ----------
        points : SurfacePoints
            n points, world space.
        eyes : (k, 3) float
            World space.
        width : float
            Width of the band as a fraction of the mesh's diagonal.

        Returns
        -------
        (k, n) bool
            True if the answer stays the same when the point's end of the line is moved by `width` in eight directions
            across it, and when the contact tolerance is halved or doubled (docs/conventions.md).
        """
        width = as_number(width, "width", "a number")
        answer = self.visible(points, eyes)
        eyes = np.asarray(eyes, dtype=np.float64)
        still = self._still(points, eyes, answer, width, self.contact)
        for contact in (self.contact / 2.0, self.contact * 2.0):
            still &= _visible(self.mesh, points.face_ids, points.positions[None], eyes, contact) == answer
        return still

    def silhouette_distance(self, points: SurfacePoints, eyes: FloatArray, widths: FloatArray) -> FloatArray:
        """Return the shift across the line of sight at which the answer first changes: the silhouette's distance.

        Parameters
        ----------
        points : SurfacePoints
            n points, world space.
        eyes : (k, 3) float
            World space.
        widths : (w,) float
            Shifts as fractions of the mesh's diagonal, positive, in any order.

        Returns
        -------
        (k, n) float64
            Smallest of `widths` for which the answer changes when the point's end of the line is moved in one of eight
            directions across it; infinity if none does. As fractions of the mesh's diagonal. The moved line of a
            visible point is blocked only by faces farther than `SLANT` widths from the point.

        Notes
        -----
        Without `SLANT` the neighbours of a point's own face would hide the moved end on every slanted surface: a
        quarter of a ball of 9,000 faces would be within 1e-3 of a silhouette, where a twelfth is.

        Up to 8 w times the cost of `visible`; a pair whose distance is known is not tested again.
        """
        answer = self.visible(points, eyes)
        eyes = np.asarray(eyes, dtype=np.float64)
        nearest = np.full(answer.shape, np.inf)
        for width in np.unique(widths):
            beyond = max(self.contact, SLANT * float(width) * self.mesh.diagonal)
            for j in range(len(eyes)):
                for seen, contact in ((True, beyond), (False, self.contact)):
                    asked = np.flatnonzero(np.isinf(nearest[j]) & (answer[j] == seen))
                    same = answer[j : j + 1, asked]
                    still = self._still(points.select(asked), eyes[j : j + 1], same, float(width), contact)
                    nearest[j, asked[~still[0]]] = width
        return nearest

    def _still(
        self, points: SurfacePoints, eyes: FloatArray, answer: BoolArray, width: float, contact: float
    ) -> BoolArray:
        """Return where the answer stays when the point's end of the line moves by `width` in eight directions."""
        still = np.ones_like(answer)
        for shift in _across(points.positions[None] - eyes[:, None], width * self.mesh.diagonal):
            still &= _visible(self.mesh, points.face_ids, points.positions + shift, eyes, contact) == answer
        return still


def _across(lines: FloatArray, length: float) -> Iterator[FloatArray]:
    """Yield eight vectors of a length, evenly spaced around and perpendicular to each line; (..., 3) each."""
    unit = unit_vectors(lines)
    least = np.eye(3)[np.abs(unit).argmin(axis=-1)]
    across = unit_vectors(np.cross(unit, least))
    upwards = np.cross(unit, across)
    for angle in np.arange(8) * (np.pi / 4.0):
        yield length * (np.cos(angle) * across + np.sin(angle) * upwards)


class _Runs(NamedTuple):
    """Faces of a mesh in m runs of `RUN`; the last run is padded by repeating the last face."""

    corners: FloatArray  # (m, 9, RUN)
    boxes: FloatArray  # (m, 6) lower and upper corner of each run's box


def _runs_of(mesh: Mesh) -> _Runs:
    n_runs = -(-len(mesh.faces) // RUN)
    faces = np.minimum(np.arange(n_runs * RUN), len(mesh.faces) - 1)
    corners = np.ascontiguousarray(mesh.corners.take(faces, axis=0).reshape(n_runs, RUN, 9).transpose(0, 2, 1))
    coordinates = corners.reshape(n_runs, 3, 3, RUN)
    return _Runs(corners, np.concatenate([coordinates.min(axis=(1, 3)), coordinates.max(axis=(1, 3))], axis=1))


def _visible(mesh: Mesh, own: IntArray, targets: FloatArray, eyes: FloatArray, contact: float) -> BoolArray:
    """Return the answers (k, n) for targets (n, 3) of all eyes, (1, n, 3), or of each, (k, n, 3)."""
    answer = np.empty((len(eyes), len(own)), dtype=np.bool_)
    parallel_for(_look, len(own), mesh.corners, _runs_of(mesh), own, targets, eyes, contact, answer)
    return answer


def _compile() -> None:
    """Compile the answers to points, by a question without points."""
    triangle, points = Mesh(np.eye(3), np.array([[0, 1, 2]])), SurfacePoints.free(np.empty((0, 3)))
    _visible(triangle, points.face_ids, points.positions[None], np.empty((0, 3)), 0.0)


@parallel_kernel
def _look(tasks, corners, runs, own, targets, eyes, contact, answer):
    """Test the line of sight from each eye to each point against every face."""
    i = next_task(tasks)
    while i < len(own):
        for j in range(len(eyes)):
            eye, point = _triple(eyes[j]), _triple(targets[j if len(targets) > 1 else 0, i])
            low, high = _least(eye, point), _most(eye, point)
            direction = minus(point, eye)
            answer[j, i] = True
            for run in range(len(runs.boxes)):
                if _are_apart(runs.boxes[run], low, high) or not _may_pass(runs.corners[run], point, direction):
                    continue
                for face in range(run * RUN, min((run + 1) * RUN, len(corners))):
                    a, b, c = _corners_of(corners, face)
                    if face != own[i] and blocks(eye, point, a, b, c, contact):
                        answer[j, i] = False
                        break
                if not answer[j, i]:
                    break
        i = next_task(tasks)


@parallel_kernel
def _meet(tasks, runs, corners, origins, directions, face_ids, distances):
    """Test each ray against every face."""
    i = next_task(tasks)
    while i < len(directions):
        origin, direction = _triple(origins[i if len(origins) > 1 else 0]), _triple(directions[i])
        first, nearest, error = -1, math.inf, 0.0
        for run in range(len(runs.boxes)):
            if not _may_pass(runs.corners[run], origin, direction):
                continue
            for face in range(run * RUN, min((run + 1) * RUN, len(corners))):
                own = _corners_of(corners, face)
                found, found_error = ray_triangle_t(origin, direction, *own)
                if is_nearer(
                    *(origin, direction, face, found, found_error, first, nearest, error),
                    *(own, _corners_of(corners, max(first, 0))),
                ):
                    first, nearest, error = face, found, found_error
        face_ids[i], distances[i] = first, nearest * math.sqrt(dot(direction, direction))
        i = next_task(tasks)


@device_function
def _triple(row):
    return row[0], row[1], row[2]


@device_function
def _corners_of(corners, face):
    t = corners[face]
    return (t[0, 0], t[0, 1], t[0, 2]), (t[1, 0], t[1, 1], t[1, 2]), (t[2, 0], t[2, 1], t[2, 2])


@device_function
def _least(a, b):
    return min(a[0], b[0]), min(a[1], b[1]), min(a[2], b[2])


@device_function
def _most(a, b):
    return max(a[0], b[0]), max(a[1], b[1]), max(a[2], b[2])


@device_function
def _are_apart(box, low, high):
    """Return whether a box, (6,) low and high, is disjoint from the box of a segment."""
    apart = False
    for axis in range(3):
        apart |= (box[axis] > high[axis]) | (box[3 + axis] < low[axis])
    return apart


@device_function
def _may_pass(run, origin, direction):
    """Return whether a line may pass through any face of a run, (9, RUN); vectorised."""
    n = 0
    for i in range(RUN):
        a, b, c = (
            (run[0, i], run[1, i], run[2, i]),
            (run[3, i], run[4, i], run[5, i]),
            (run[6, i], run[7, i], run[8, i]),
        )
        n += passes(origin, direction, a, b, c) != 0
    return n > 0


ORACLE = Compilation(_look, _compile)
"""Compilation of the answers to points."""
