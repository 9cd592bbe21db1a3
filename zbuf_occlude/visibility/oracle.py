"""`oracle`: the judge. Every point and every ray against every face, in float64, by the definition itself."""

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from zbuf_occlude.arrays import BoolArray, FloatArray, IntArray
from zbuf_occlude.errors import check_fraction
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.geometry.predicates import blocks, meeting, of_one_sign, volumes
from zbuf_occlude.geometry.sampling import SurfacePoints
from zbuf_occlude.jit.compiler import inner
from zbuf_occlude.jit.threads import shared, take, together
from zbuf_occlude.jit.vec3 import minus
from zbuf_occlude.visibility.interface import CONTACT, FirstHits, Occluder, come_nearer

RUN = 64
"""Faces that a line is held against at a time."""

ROUNDING = 1e-6
"""A box is wider than its faces by this share of reach^2 / side, `reach` being how far the point is from mesh or
eye: `blocks`, whose products cancel with the square of that distance, takes a point 10^8 sides away through faces that
the line passes a side away. That is float64's rounding, 10^10 times, which costs nothing."""
_TINY = 1e-200
"""Lengths below it count as this, so that no division overflows."""

SLANT = 5.0
"""A face that blocks a line moved by w within this many w of the point is the point's own surface at a slant of up to
79 degrees, and no silhouette."""

BAND = 1e-6
"""Default width of the boundary band, as a fraction of the bounding box's diagonal (docs/conventions.md)."""


def prepare(mesh: Mesh, *, contact: float = CONTACT) -> "Oracle":
    """Make the judge of a mesh; `contact` is the contact tolerance as a fraction of the mesh's diagonal."""
    check_fraction("contact", contact)
    return Oracle(mesh, contact)


class Oracle(Occluder):
    """Brute force over all faces, own face excluded, stopping at the first that blocks.

    Notes
    -----
    Exact up to float64 rounding of signed volumes (`geometry.predicates.blocks`); edges shared by two faces do
    not leak. Costs O(k n f) time in the worst case and no memory beyond the answer; runs on all cores.
    """

    def __init__(self, mesh: Mesh, contact: float) -> None:
        super().__init__(mesh)
        self.contact = contact * mesh.diagonal

    def _visible(self, points: SurfacePoints, eyes: FloatArray) -> BoolArray:
        targets = np.broadcast_to(points.positions, (len(eyes), len(points), 3))
        return _visible(self.mesh, points.face_ids, targets, eyes, self.contact)

    def _first_hits(self, origins: FloatArray, directions: FloatArray) -> FirstHits:
        origins, skipped = come_nearer(self.mesh, origins, directions)
        origins = np.ascontiguousarray(np.broadcast_to(origins, directions.shape))
        face_ids, fractions, _ = _nearest(self.mesh.corners, origins, directions)
        return FirstHits(face_ids, fractions * np.linalg.norm(directions, axis=1) + skipped)

    def decided_hits(self, origins: FloatArray, directions: FloatArray, width: float = BAND) -> BoolArray:
        """Say which rays' first hits do not hang on a hair; those that do are the boundary band of rays.

        Parameters
        ----------
        origins : (n, 3) or (1, 3) float
            World space.
        directions : (n, 3) float
            World space.
        width : float
            As a fraction of the mesh's diagonal.

        Returns
        -------
        (n,) bool
            True where the face named stays the same with the whole ray moved by `width` in eight directions across it
            and its origin by the contact tolerance along it, either way, and no other face meets the ray within the
            contact tolerance of it.
        """
        directions = np.asarray(directions, dtype=np.float64)
        origins, _ = come_nearer(self.mesh, np.asarray(origins, dtype=np.float64), directions)
        origins = np.ascontiguousarray(np.broadcast_to(origins, directions.shape))
        lengths = np.linalg.norm(directions, axis=1)
        first, nearest, second = _nearest(self.mesh.corners, origins, directions)
        with np.errstate(invalid="ignore"):  # no hit at all: infinity less infinity
            still = ~((second - nearest) * lengths <= self.contact)
        along = self.contact * directions / lengths[:, None]
        for shift in (*_across(directions, width * self.mesh.diagonal), along, -along):
            still &= _nearest(self.mesh.corners, origins + shift, directions)[0] == first
        return still

    def decided(self, points: SurfacePoints, eyes: FloatArray, width: float = BAND) -> BoolArray:
        """Say where the answer does not hang on a hair; what is not decided is the boundary band.

        Parameters
        ----------
        points : SurfacePoints
            n points, world space.
        eyes : (k, 3) float
            World space.
        width : float
            As a fraction of the mesh's diagonal.

        Returns
        -------
        (k, n) bool
            True where the answer stays the same with the point's end of the line moved by `width` in eight directions
            across it, and with the contact tolerance halved and doubled (DESIGN.md section 2).
        """
        answer = self.visible(points, eyes)
        eyes = np.asarray(eyes, dtype=np.float64)
        still = self._still(points, eyes, answer, width, self.contact)
        targets = np.broadcast_to(points.positions, (len(eyes), len(points), 3))
        for contact in (self.contact / 2.0, self.contact * 2.0):
            still &= _visible(self.mesh, points.face_ids, targets, eyes, contact) == answer
        return still

    def silhouette_distance(self, points: SurfacePoints, eyes: FloatArray, widths: FloatArray) -> FloatArray:
        """Say how far across the line of sight the answer first changes: the distance from the nearest silhouette.

        Parameters
        ----------
        points : SurfacePoints
            n points, world space.
        eyes : (k, 3) float
            World space.
        widths : (w,) float
            As fractions of the mesh's diagonal, positive, in any order.

        Returns
        -------
        (k, n) float64
            The smallest of `widths` by which the point's end of the line, moved in one of eight directions across it,
            gets another answer; infinity where none does. As fractions of the mesh's diagonal. A visible point's line,
            once moved, is blocked only by faces farther than `SLANT` widths from the point.

        Notes
        -----
        Without `SLANT` the faces beside a point's own would hide the moved end on every surface that is seen at a
        slant: of a ball of 9,000 faces a quarter would be within 1e-3 of a silhouette, where a twelfth is.

        Up to 8 w times the cost of `visible`; a pair that has its distance is not asked again.
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
        """Where the answer stays with the point's end of the line moved by `width` in eight directions across it."""
        still = np.ones_like(answer)
        for shift in _across(points.positions[None] - eyes[:, None], width * self.mesh.diagonal):
            still &= _visible(self.mesh, points.face_ids, points.positions + shift, eyes, contact) == answer
        return still


def _across(lines: FloatArray, length: float) -> Iterator[FloatArray]:
    """Eight vectors of a length, all round across each of the lines; (..., 3) each."""
    unit = lines / np.maximum(np.linalg.norm(lines, axis=-1, keepdims=True), np.finfo(np.float64).tiny)
    least = np.eye(3)[np.abs(unit).argmin(axis=-1)]
    across = np.cross(unit, least)
    across /= np.maximum(np.linalg.norm(across, axis=-1, keepdims=True), np.finfo(np.float64).tiny)
    upwards = np.cross(unit, across)
    for angle in np.arange(8) * (np.pi / 4.0):
        yield length * (np.cos(angle) * across + np.sin(angle) * upwards)


class _Runs(NamedTuple):
    """The faces of a mesh in m runs of `RUN`; the last one filled up by repeating its last face."""

    corners: FloatArray  # (m, 9, RUN)
    boxes: FloatArray  # (m, 6) lower and upper corners of what each holds
    centre: FloatArray  # (3,) of the mesh
    side: float  # the mesh's longest


def _visible(mesh: Mesh, own: IntArray, targets: FloatArray, eyes: FloatArray, contact: float) -> BoolArray:
    """targets (k, n, 3): each eye has its own, so that `decided` can move them."""
    answer = np.empty(targets.shape[:2], dtype=np.bool_)
    n_runs = -(-len(mesh.faces) // RUN)
    faces = np.minimum(np.arange(n_runs * RUN), len(mesh.faces) - 1)
    corners = np.ascontiguousarray(mesh.corners.take(faces, axis=0).reshape(n_runs, RUN, 9).transpose(0, 2, 1))
    coordinates = corners.reshape(n_runs, 3, 3, RUN)
    boxes = np.concatenate([coordinates.min(axis=(1, 3)), coordinates.max(axis=(1, 3))], axis=1)
    runs = _Runs(corners, boxes, np.array(mesh.centre), max(mesh.longest_side, _TINY))
    together(_look, len(own), mesh.corners, runs, own, targets, eyes, contact, answer)
    return answer


@shared
def _look(tasks, corners, runs, own, targets, eyes, contact, answer):
    """Take point after point, and for each eye ask every face about it in whose run's box the line of sight is."""
    i = take(tasks)
    while i < len(own):
        for j in range(len(eyes)):
            eye = (eyes[j, 0], eyes[j, 1], eyes[j, 2])
            point = (targets[j, i, 0], targets[j, i, 1], targets[j, i, 2])
            direction = minus(eye, point)
            inverse = (_inverse(direction[0]), _inverse(direction[1]), _inverse(direction[2]))
            reach = max(runs.side, max(_largest(direction), _largest(minus(point, runs.centre))))
            slack = ROUNDING * (reach / runs.side * reach + ROUNDING * _largest(point))
            answer[j, i] = True
            for run in range(len(runs.boxes)):
                if not _enters(runs.boxes[run], slack, point, inverse):
                    continue
                if not _passes_any(runs.corners[run], eye, point):
                    continue
                for face in range(run * RUN, min((run + 1) * RUN, len(corners))):
                    t = corners[face]
                    a, b, c = (t[0, 0], t[0, 1], t[0, 2]), (t[1, 0], t[1, 1], t[1, 2]), (t[2, 0], t[2, 1], t[2, 2])
                    if face == own[i] or not blocks(eye, point, a, b, c, contact):
                        continue
                    if _enters(_box_of(a, b, c), slack, point, inverse):  # else it blocks by rounding only
                        answer[j, i] = False
                        break
                if not answer[j, i]:
                    break
        i = take(tasks)


@inner
def _inverse(number):
    """1 / number, finite."""
    return 1.0 / number if abs(number) > _TINY else math.copysign(1.0 / _TINY, number)


@inner
def _largest(a):
    return max(abs(a[0]), max(abs(a[1]), abs(a[2])))


@inner
def _box_of(a, b, c):
    """The box of a face, as `_enters` takes it."""
    x, y, z = (a[0], b[0], c[0]), (a[1], b[1], c[1]), (a[2], b[2], c[2])
    return min(x), min(y), min(z), max(x), max(y), max(z)


@inner
def _enters(box, slack, point, inverse):
    """Whether the line of sight of a point, the inverse of its direction given, meets a box, (6,) low and high."""
    begin, end = 0.0, 1.0
    for axis in range(3):
        one = (box[axis] - slack - point[axis]) * inverse[axis]
        other = (box[3 + axis] + slack - point[axis]) * inverse[axis]
        begin, end = max(begin, min(one, other)), min(end, max(one, other))
    return begin <= end


@inner
def _passes_any(run, eye, point):
    """Whether the line passes through any face of a run, (9, RUN): what `blocks` asks first, of several at a time."""
    direction = minus(point, eye)
    n = 0
    for i in range(RUN):
        a = (run[0, i], run[1, i], run[2, i])
        b = (run[3, i], run[4, i], run[5, i])
        c = (run[6, i], run[7, i], run[8, i])
        u, v, w = volumes(point, direction, a, b, c)
        n += of_one_sign(u, v, w)
    return n > 0


def _nearest(
    corners: FloatArray, origins: FloatArray, directions: FloatArray
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Of each ray the face met first, how many times its direction away, and the same of the next face."""
    n = len(directions)
    first, nearest, second = np.full(n, -1, dtype=np.int32), np.full(n, math.inf), np.full(n, math.inf)
    together(_meet, n, corners, origins, directions, first, nearest, second)
    return first, nearest, second


@shared
def _meet(tasks, corners, origins, directions, first, nearest, second):
    """Take ray after ray, and hold it against every face."""
    i = take(tasks)
    while i < len(directions):
        origin = (origins[i, 0], origins[i, 1], origins[i, 2])
        direction = (directions[i, 0], directions[i, 1], directions[i, 2])
        for face in range(len(corners)):
            t = corners[face]
            a, b, c = (t[0, 0], t[0, 1], t[0, 2]), (t[1, 0], t[1, 1], t[1, 2]), (t[2, 0], t[2, 1], t[2, 2])
            found = meeting(origin, direction, a, b, c)
            if found < nearest[i]:
                first[i], nearest[i], second[i] = face, found, nearest[i]
            elif found < second[i]:
                second[i] = found
        i = take(tasks)
