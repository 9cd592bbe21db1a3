"""Backs: points on solids, hidden from every eye outside that their face is turned away from, without a search.

Let p lie on face f of a closed surface that bounds a solid (`zbuf_occlude.solids`), and let an eye outside the solid be
on the inner side of the planes of all faces of the surface within the contact tolerance of p, f among them. The line
from p to the eye starts within the solid, and does not leave it within that distance: there it could only pass faces
from their outer to their inner side. But it ends outside, so another face, farther than the tolerance, hides p.

Nor need the faces that are turned away be asked what they hide. A line from any point to the eye that passes one of
them from its outer to its inner side comes out again through a face that is not turned away, nearer to the eye, and so
that one hides the point, too; unless it is the point's own face, which it cannot be when the point lies on it. (What
float64 makes of a line in the plane of a face, to the last digit, holds for neither.)

Half of all points of a closed mesh are decided so. What is uncertain (a surface that crosses itself, points with more
than one other face within the tolerance or not on their face, faces seen at a grazing angle) is left to the search.
"""

from typing import NamedTuple

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from zbuf_occlude.arrays import BoolArray, FloatArray, IntArray
from zbuf_occlude.image_space.scene import Float32
from zbuf_occlude.lanes import N_LANES
from zbuf_occlude.mesh import Mesh
from zbuf_occlude.predicates import dot, minus
from zbuf_occlude.solids import find_solids
from zbuf_occlude.solids.clearance import edge_margins, face_beside, face_frames
from zbuf_occlude.solids.triangles import corner
from zbuf_occlude.threads import threaded

OFF = 5e-4
"""A point may lie off its face by this times the contact tolerance, as float64 points do, rounded to float32 not."""

ON = 1e-6
"""The same for `on_faces`: as sampled."""

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
    frames, margins : (f, 4, 3) and (f, 3) float64
        As in `solids.clearance`.
    reach : float
        The contact tolerance and a little more, diagonals.
    """

    outward: NDArray[np.int8]
    corners: FloatArray
    starts: NDArray[np.int64]
    others: IntArray
    frames: FloatArray
    margins: FloatArray
    reach: float


def make_solids(mesh: Mesh, contact: float) -> Solids:
    """Find the solids of a mesh; `contact` is the contact tolerance in units of its diagonal."""
    reach = 1.01 * max(contact, LEAST)
    closed, near = find_solids(mesh, reach)
    frames = face_frames(near.corners)
    margins = edge_margins(near.corners, near.starts, near.others, frames, reach)
    return Solids(closed.outward, near.corners, near.starts, near.others, frames, margins, reach)


@threaded
def find_backed(
    positions: FloatArray, face_ids: IntArray, centre: FloatArray, diagonal: float, solids: Solids
) -> tuple[IntArray, bool]:
    """Find the points that a solid hides from every eye outside on the inner side of one or two faces.

    Parameters
    ----------
    positions, face_ids : (n, 3) float64, world space, and (n,) int32
    centre, diagonal : (3,) float64 and float
        The mesh's.
    solids : Solids

    Returns
    -------
    beside : (n,) int32
        The face beside a point's own that the eye must be on the inner side of, too; its own where there is none such,
        -1 where the solid says nothing.
    on_faces : bool
        Whether all points of faces of solids lie on these.
    """
    beside, n_off = np.full(len(positions), -1, dtype=np.int32), 0
    for k in prange(len(positions)):
        face = face_ids[k]
        if face < 0 or solids.outward[face] == 0:
            continue
        f, frame = solids.corners[face], solids.frames[face]
        point = (
            (positions[k, 0] - centre[0]) / diagonal,
            (positions[k, 1] - centre[1]) / diagonal,
            (positions[k, 2] - centre[2]) / diagonal,
        )
        off = abs(dot(corner(frame, 0), minus(point, corner(f, 0))))
        on = off <= ON * solids.reach
        within, clear = True, True
        for i in range(3):
            distance = dot(corner(frame, i + 1), minus(point, corner(f, i)))
            on &= distance >= -ON * solids.reach
            within &= distance > 0.0
            clear &= distance > solids.margins[face, i]
        n_off += not on
        if not off <= OFF * solids.reach:
            continue
        if clear:
            beside[k] = face
        elif within:
            beside[k] = face_beside(point, face, solids.corners, solids.starts, solids.others, solids.reach)
    return beside, n_off == 0


@threaded
def pack_backs(
    planes: Float32, rows: IntArray, outward: NDArray[np.int8], face_ids: IntArray, beside: IntArray, order: IntArray
) -> tuple[Float32, NDArray[np.int64], BoolArray]:
    """Put what `find_backed` found into packets.

    Parameters
    ----------
    planes : (m, 4, 16) float32
        As in `Scene`.
    rows : (f + 1,) int32
        From a face to 16 x cluster + lane.
    outward : (f,) int8
        As in `Solids`.
    face_ids, beside : (n,) int32
    order : (n',) int32

    Returns
    -------
    own : (4, n') float32
        Planes of the points' own faces: outward unit normal and offset, scene space.
    backed : (n' / 16,) int64
        Masks of the points that are hidden where their faces are turned away.
    two : (n' / 16,) bool
        Whether some of these need the plane of the face beside, too.
    """
    own = np.zeros((4, len(order)), dtype=np.float32)
    backed, two = np.zeros(len(order) // N_LANES, dtype=np.int64), np.zeros(len(order) // N_LANES, dtype=np.bool_)
    for packet in prange(len(backed)):
        for i in range(packet * N_LANES, (packet + 1) * N_LANES):
            k = order[i]
            if beside[k] >= 0:
                _copy_plane(planes, rows, outward, face_ids[k], own, i)
                backed[packet] |= 1 << (i % N_LANES)
                two[packet] |= beside[k] != face_ids[k]
    return own, backed, two


@threaded
def planes_beside(
    planes: Float32, rows: IntArray, outward: NDArray[np.int8], beside: IntArray, order: IntArray
) -> Float32:
    """Planes of the faces beside the points of an order, (4, n') float32; parameters as in `pack_backs`."""
    found = np.zeros((4, len(order)), dtype=np.float32)
    for i in prange(len(order)):
        if beside[order[i]] >= 0:
            _copy_plane(planes, rows, outward, beside[order[i]], found, i)
    return found


@njit
def _copy_plane(planes, rows, outward, face, found, i):  # type: ignore[no-untyped-def]
    row = rows[face]
    if row >= 0:
        for j in range(4):
            found[j, i] = planes[row // N_LANES, j, row % N_LANES] * np.float32(outward[face])
