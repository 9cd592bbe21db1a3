"""Backs: points on solids, hidden from every eye outside that their face is turned away from, without a search.

Let p lie on face f of a closed surface that bounds a solid (`zbuf_occlude.solids`), and let an eye outside the solid be
on the inner side of the planes of all faces of the surface within the contact tolerance of p, f among them. The line
from p to the eye starts within the solid, and does not leave it within that distance: there it could only pass faces
from their outer to their inner side. But it ends outside, so another face, farther than the tolerance, hides p.

Half of all points of a closed mesh are decided so. What is uncertain (a surface that crosses itself, points with more
than one other face within the tolerance or not on their face, faces seen at a grazing angle) is left to the search.
"""

from typing import NamedTuple

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from zbuf_occlude.arrays import FloatArray, IntArray
from zbuf_occlude.image_space.lanes import ALL, N_LANES, first_lane, greater, load, muladd, splat
from zbuf_occlude.image_space.scene import Float32
from zbuf_occlude.mesh import Mesh
from zbuf_occlude.predicates import dot, minus
from zbuf_occlude.solids import edge_margins, find_solids
from zbuf_occlude.solids.clearance import face_beside
from zbuf_occlude.solids.triangles import corner, inward, unit_normal
from zbuf_occlude.threads import threaded

OFF = 5e-4
"""A point may lie off its face by this times the contact tolerance, as float64 points do, rounded to float32 not."""

GRAZING = np.float32(1e-3)
"""Sine of the angle between line of sight and face below which nothing is said. More than `OFF`: a line from a point
before its face is then behind it before it leaves the point's ball."""

LEAST = 1e-6
"""Smallest contact tolerance, in diagonals, that the test is made with."""


class Solids(NamedTuple):
    """The faces of a mesh that bound solids.

    Parameters
    ----------
    outward : (f,) int8
        As in `solids.ClosedSurfaces`.
    corners, starts, others
        As in `solids.NearFaces`.
    margins : (f, 3) float64
        As in `solids.edge_margins`.
    reach : float
        The contact tolerance and a little more, diagonals.
    """

    outward: NDArray[np.int8]
    corners: FloatArray
    starts: NDArray[np.int64]
    others: IntArray
    margins: FloatArray
    reach: float


def make_solids(mesh: Mesh, contact: float) -> Solids:
    """Find the solids of a mesh; `contact` is the contact tolerance in units of its diagonal."""
    reach = 1.01 * max(contact, LEAST)
    closed, near = find_solids(mesh, reach)
    return Solids(closed.outward, near.corners, near.starts, near.others, edge_margins(near, reach), reach)


@threaded
def find_backed(
    positions: FloatArray, face_ids: IntArray, centre: FloatArray, diagonal: float, solids: Solids
) -> IntArray:
    """Find the points that a solid hides from every eye outside on the inner side of one or two faces.

    Parameters
    ----------
    positions, face_ids : (n, 3) float64, world space, and (n,) int32
    centre, diagonal : (3,) float64 and float
        The mesh's.
    solids : Solids

    Returns
    -------
    (n,) int32
        The face beside a point's own that the eye must be on the inner side of, too; its own where there is none such,
        -1 where the solid says nothing.
    """
    beside = np.full(len(positions), -1, dtype=np.int32)
    for k in prange(len(positions)):
        face = face_ids[k]
        if face < 0 or solids.outward[face] == 0:
            continue
        f = solids.corners[face]
        point = (
            (positions[k, 0] - centre[0]) / diagonal,
            (positions[k, 1] - centre[1]) / diagonal,
            (positions[k, 2] - centre[2]) / diagonal,
        )
        n = unit_normal(f)
        if abs(dot(n, minus(point, corner(f, 0)))) > OFF * solids.reach:
            continue
        within, clear = True, True
        for i in range(3):
            distance = dot(inward(f, n, i), minus(point, corner(f, i)))
            within &= distance > 0.0
            clear &= distance > solids.margins[face, i]
        if clear:
            beside[k] = face
        elif within:
            beside[k] = face_beside(point, face, solids.corners, solids.starts, solids.others, solids.reach)
    return beside


@threaded
def outward_planes(planes: Float32, rows: IntArray, face_ids: IntArray, outward: NDArray[np.int8]) -> Float32:
    """Planes of faces of solids, (4, n') float32: outward unit normal and offset, scene space.

    `planes` as in `Scene`, `rows` (f + 1,) from a face to 16 x cluster + lane, `face_ids` (n',).
    """
    found = np.zeros((4, len(face_ids)), dtype=np.float32)
    for i in prange(len(face_ids)):
        face_row = rows[face_ids[i]]
        if face_row >= 0:
            for row in range(4):
                found[row, i] = planes[face_row // 16, row, face_row % 16] * np.float32(outward[face_ids[i]])
    return found


@njit(_nrt=False, forceinline=True)
def _turned(planes, base, eye, limit):  # type: ignore[no-untyped-def]
    """Mask of the 16 planes from column `base` on that the eye is on the inner side of."""
    n = planes.shape[1]
    height = muladd(splat(eye[2]), load(planes, 2 * n + base), splat(np.float32(0.0)) - load(planes, 3 * n + base))
    height = muladd(splat(eye[0]), load(planes, base), muladd(splat(eye[1]), load(planes, n + base), height))
    return greater(splat(limit), height)


@njit(_nrt=False)
def hide_backs(points, first, last, eye, turned, answer):  # type: ignore[no-untyped-def]
    """Hide what is turned away of the packets first to last from an eye outside; note it in `turned`.

    Parameters
    ----------
    points : Packets
    first, last : int
    eye : tuple of 3 float32, scene space
    turned : (n' / 16,) int64
        Receives the masks of the points that are decided.
    answer : (n,) bool
        Receives False.
    """
    limit = -GRAZING * (np.float32(1.0) + abs(eye[0]) + abs(eye[1]) + abs(eye[2]))
    for packet in range(first, last):
        found = points.backed[packet]
        if found:
            found &= _turned(points.outward, packet * N_LANES, eye, limit)
        if found and points.beside[packet] >= 0:
            found &= _turned(points.outward, points.beside[packet], eye, limit)
        turned[packet] = found
        base = packet * N_LANES
        if found == ALL:
            for i in range(base, base + N_LANES):
                answer[points.order[i]] = False
        else:
            while found:
                answer[points.order[base + first_lane(found)]] = False
                found &= found - 1
