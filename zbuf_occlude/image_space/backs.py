"""Backs: points on solids, hidden from every eye outside that their face is turned away from, without a search.

Let p lie on face f of a closed surface that bounds a solid (`zbuf_occlude.solids`), and let an eye outside the solid be
on the inner side of the planes of all faces of the surface within the contact tolerance of p, f among them. The line
from p to the eye starts within the solid, and does not leave it within that distance: there it could only pass faces
from their outer to their inner side. But it ends outside, so another face, farther than the tolerance, hides p.

Nor need the faces that are turned away be asked what they hide. A line from any point to the eye that passes one of
them from its outer to its inner side comes out again through a face that is not turned away, nearer to the eye, and so
that one hides the point, too; unless it is the point's own face, which it cannot be when the point lies on it. (What
float64 makes of a line in the plane of a face, to the last digit, holds for neither.)

Points inside another solid, farther from its surface than the tolerance, are hidden from every eye outside
(`solids.buried`): by the face at which the line from the eye enters it. So what a face inside hides, that one hides,
too. The first face of any solid that a line from an eye outside meets is neither turned away nor inside of one, so both
kinds can be left out at once.

Half of all points of a closed mesh are decided so. What is uncertain (a surface that crosses itself, points with more
than one other face within the tolerance or not on their face, faces seen at a grazing angle) is left to the search.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from zbuf_occlude.arrays import BoolArray, FloatArray, IntArray
from zbuf_occlude.mesh import Mesh
from zbuf_occlude.solids import find_buried, find_clearance, find_solids
from zbuf_occlude.solids.buried import WHOLE, is_buried
from zbuf_occlude.solids.clearance import edge_margins, face_beside, face_frames

OFF = 5e-4
"""A point may lie off its face by this times the contact tolerance, as float64 points do, rounded to float32 not."""

ON = 1e-6
"""The same for `on_faces`: as sampled."""

GRAZING = np.float32(1e-3)
"""Sine of the angle between line of sight and face below which nothing is said. More than `OFF`: a line from a point
before its face is then behind it before it leaves the point's ball."""

DIAGONAL = 2.0
"""The mesh's diagonal in scene space."""

UNRELATED, FOLLOWED, SOLID = 0.0, 1.0, 2.0
"""Kinds of faces: none of the others; those that visibility may be followed over; those of solids."""

LEAST = 1e-6
"""Smallest contact tolerance, in diagonals, that the test is made with."""


class Solids(NamedTuple):
    """The surfaces of a mesh, and which of them bound solids.

    Parameters
    ----------
    outward, sides : (f,) int8
        As in `solids.ClosedSurfaces`, without those that cross themselves.
    vertices : (f, 3) int32
    twins : (3 f,) int64
        As there.
    clear : (f,) bool
        As in `solids.Clearance`.
    barrier_starts, barrier_ends, barrier_radii
        `solids.Barriers`.
    corners, starts, others
        As in `solids.NearFaces`.
    ends : (f, 4) int64
        Where groups of them end, as in `solids.clearance.edge_margins`.
    records : (f, 20) float64
        What decides of most points where they are on a face: unit normal, unit vectors inwards across the three edges,
        the offsets of these four, the margins, and one of `UNRELATED`, `FOLLOWED`, `SOLID`. In diagonals.
    buried : (f,) int8
        `solids.find_buried`.
    reach : float
        The contact tolerance and a little more, diagonals.
    """

    outward: NDArray[np.int8]
    sides: NDArray[np.int8]
    vertices: IntArray
    twins: NDArray[np.int64]
    clear: BoolArray
    barrier_starts: NDArray[np.int64]
    barrier_ends: FloatArray
    barrier_radii: FloatArray
    corners: FloatArray
    starts: NDArray[np.int64]
    others: IntArray
    ends: NDArray[np.int64]
    records: FloatArray
    buried: NDArray[np.int8]
    reach: float


def make_solids(mesh: Mesh, contact: float) -> Solids:
    """Find the solids of a mesh; `contact` is the contact tolerance in units of its diagonal."""
    reach = 1.01 * max(contact, LEAST)
    closed, near = find_solids(mesh, reach)
    frames = face_frames(near.corners)
    margins, others, ends = edge_margins(near.corners, near.starts, near.others, frames, reach)
    clearance = find_clearance(near.corners, closed, reach)
    offsets = np.einsum("fij,fij->fi", frames, near.corners[:, [0, 0, 1, 2]])
    followed = clearance.clear | (np.diff(clearance.barriers.starts) > 0)
    kinds = np.where(closed.outward != 0, SOLID, np.where(followed, FOLLOWED, UNRELATED))
    return Solids(
        closed.outward,
        closed.sides,
        closed.vertices,
        closed.twins,
        clearance.clear,
        *clearance.barriers,
        near.corners,
        near.starts,
        others,
        ends,
        np.concatenate([frames.reshape(-1, 12), offsets, margins, kinds[:, None]], axis=1),
        find_buried(near.corners, closed, clearance),
        reach,
    )


def no_solids() -> Solids:
    """Return what is known before they are looked for: nothing."""
    none, no_ids = np.zeros(0, dtype=np.int8), np.zeros(0, dtype=np.int32)
    no_places, no_numbers = np.zeros(0, dtype=np.int64), np.zeros(0)
    return Solids(
        none,
        none,
        no_ids.reshape(0, 3),
        no_places,
        np.zeros(0, dtype=np.bool_),
        no_places,
        no_numbers.reshape(0, 2, 3),
        no_numbers,
        no_numbers.reshape(0, 3, 3),
        no_places,
        no_ids,
        no_places.reshape(0, 4),
        no_numbers.reshape(0, 20),
        none,
        0.0,
    )


def followed_area(mesh: Mesh, solids: Solids) -> float:
    """Tell over which part of a mesh's area visibility may be followed (`regions`)."""
    followed = solids.clear | (np.diff(solids.barrier_starts) > 0)
    return float(mesh.areas[followed].sum() / mesh.areas.sum())


@njit(_nrt=False, forceinline=True)
def back_of(point, face, record, solids):  # type: ignore[no-untyped-def]
    """Find whether a solid hides a point from every eye outside on the inner side of one or two faces.

    Parameters
    ----------
    point : tuple of 3 float64, scene space
    face : int
        Its own.
    record : (20,) float64
        The face's, of `Solids.records`.
    solids : Solids

    Returns
    -------
    beside : int
        The face beside its own that the eye must be on the inner side of, too; its own where there is none such, -1
        where the solid says nothing.
    off : bool
        Whether the face is clear, or has barriers, or is of a solid, and the point does not lie on it.
    buried : bool
        Whether it is inside another solid, so that no eye outside sees it.
    """
    if record[19] == UNRELATED:
        return -1, False, False
    x, y, z = point[0] / DIAGONAL, point[1] / DIAGONAL, point[2] / DIAGONAL
    away = abs(record[0] * x + record[1] * y + record[2] * z - record[12])
    inside = (
        record[3] * x + record[4] * y + record[5] * z - record[13],
        record[6] * x + record[7] * y + record[8] * z - record[14],
        record[9] * x + record[10] * y + record[11] * z - record[15],
    )
    least = min(inside[0], min(inside[1], inside[2]))
    off = not (away <= ON * solids.reach and least >= -ON * solids.reach)
    buried = not off and _is_buried((x, y, z), face, record, solids)
    if buried or record[19] != SOLID or not (away <= OFF * solids.reach and least > 0.0):
        return -1, off, buried
    beside, first = face, solids.starts[face]
    for group in range(4):
        last = solids.ends[face, group]
        if beside >= 0 and last > first and (group == 0 or inside[group - 1] <= record[15 + group]):
            beside = face_beside((x, y, z), face, beside, solids.corners, solids.others, first, last, solids.reach)
        first = last
    return beside, off, False


@njit(_nrt=False, forceinline=True)
def _is_buried(point, face, record, solids):  # type: ignore[no-untyped-def]
    """Whether a point of a face is inside another solid."""
    corners = solids.buried[face]
    if corners == 0 or corners == WHOLE:
        return corners == WHOLE
    return is_buried(
        point,
        (record[0], record[1], record[2]),
        solids.corners[face],
        corners,
        solids.barrier_ends,
        solids.barrier_radii,
        solids.barrier_starts[face],
        solids.barrier_starts[face + 1],
    )
