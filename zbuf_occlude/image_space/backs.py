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
from zbuf_occlude.lanes import N_LANES
from zbuf_occlude.mesh import Mesh
from zbuf_occlude.solids import find_clearance, find_solids
from zbuf_occlude.solids.clearance import edge_margins, face_beside, face_frames
from zbuf_occlude.threads import threaded

OFF = 5e-4
"""A point may lie off its face by this times the contact tolerance, as float64 points do, rounded to float32 not."""

ON = 1e-6
"""The same for `on_faces`: as sampled."""

GRAZING = np.float32(1e-3)
"""Sine of the angle between line of sight and face below which nothing is said. More than `OFF`: a line from a point
before its face is then behind it before it leaves the point's ball."""

BLOCK = 4096
"""Points that one thread asks for at a time."""

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
    n_unbounded : (f,) int32
        As in `solids.clearance`; the unbounded of a face's others come first.
    records : (f, 20) float64
        What decides of most points where they are on a face: unit normal, unit vectors inwards across the three edges,
        the offsets of these four, the margins, and one of `UNRELATED`, `FOLLOWED`, `SOLID`. In diagonals.
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
    n_unbounded: IntArray
    records: FloatArray
    reach: float


def make_solids(mesh: Mesh, contact: float) -> Solids:
    """Find the solids of a mesh; `contact` is the contact tolerance in units of its diagonal."""
    reach = 1.01 * max(contact, LEAST)
    closed, near = find_solids(mesh, reach)
    frames = face_frames(near.corners)
    margins, others, n_unbounded = edge_margins(near.corners, near.starts, near.others, frames, reach)
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
        n_unbounded,
        np.concatenate([frames.reshape(-1, 12), offsets, margins, kinds[:, None]], axis=1),
        reach,
    )


def followed_area(mesh: Mesh, solids: Solids) -> float:
    """Tell over which part of a mesh's area visibility may be followed (`regions`)."""
    followed = solids.clear | (np.diff(solids.barrier_starts) > 0)
    return float(mesh.areas[followed].sum() / mesh.areas.sum())


@threaded
def find_backed(
    positions: FloatArray,
    face_ids: IntArray,
    order: IntArray,
    own: IntArray,
    centre: FloatArray,
    diagonal: float,
    solids: Solids,
    records: FloatArray,
) -> tuple[IntArray, bool]:
    """Find the points that a solid hides from every eye outside on the inner side of one or two faces.

    Parameters
    ----------
    positions, face_ids : (n, 3) float64, world space, and (n,) int32
    order : (n',) int32
        In which they are asked and answered for; best those of a face one after the other.
    own : (n',) int32
        Where in `records` those of their faces are; -1 for none.
    centre, diagonal : (3,) float64 and float
        The mesh's.
    solids : Solids
    records : (..., 20) float64
        Those of `solids`, maybe in another order.

    Returns
    -------
    beside : (n',) int32
        The face beside a point's own that the eye must be on the inner side of, too; its own where there is none such,
        -1 where the solid says nothing.
    on_faces : bool
        Whether all points of faces that are clear, or have barriers, or are of solids, lie on these.
    """
    beside, n_off = np.full(len(order), -1, dtype=np.int32), 0
    for block in prange(-(-len(order) // BLOCK)):
        begin, end = block * BLOCK, min((block + 1) * BLOCK, len(order))
        n_off += _find_block(positions, face_ids, order, own, centre, diagonal, solids, records, begin, end, beside)
    return beside, n_off == 0


@njit(_nrt=False)
def _find_block(positions, face_ids, order, own, centre, diagonal, solids, records, begin, end, beside):  # type: ignore[no-untyped-def]
    """Fill `beside` from begin to end; return how many of these points are not on their faces."""
    n_off = 0
    for i in range(begin, end):
        if own[i] < 0 or records[own[i], 19] == UNRELATED:
            continue
        record, k = records[own[i]], order[i]
        x, y, z = (
            (positions[k, 0] - centre[0]) / diagonal,
            (positions[k, 1] - centre[1]) / diagonal,
            (positions[k, 2] - centre[2]) / diagonal,
        )
        off = abs(record[0] * x + record[1] * y + record[2] * z - record[12])
        inside_a = record[3] * x + record[4] * y + record[5] * z - record[13]
        inside_b = record[6] * x + record[7] * y + record[8] * z - record[14]
        inside_c = record[9] * x + record[10] * y + record[11] * z - record[15]
        least = min(inside_a, min(inside_b, inside_c))
        n_off += not (off <= ON * solids.reach and least >= -ON * solids.reach)
        if record[19] != SOLID or not (off <= OFF * solids.reach and least > 0.0):
            continue
        face = face_ids[k]
        first, last = solids.starts[face], solids.starts[face + 1]
        if inside_a > record[16] and inside_b > record[17] and inside_c > record[18]:
            last = first + solids.n_unbounded[face]
        beside[i] = face_beside((x, y, z), face, solids.corners, solids.others, first, last, solids.reach)
    return n_off


@threaded
def pack_backs(face_ids: IntArray, beside: IntArray, order: IntArray) -> tuple[NDArray[np.int64], BoolArray]:
    """Put what `find_backed` found into packets.

    Parameters
    ----------
    face_ids : (n,) int32
    beside, order : (n',) int32

    Returns
    -------
    backed : (n' / 16,) int64
        Masks of the points that are hidden where their faces are turned away.
    two : (n' / 16,) bool
        Whether for some of these the face beside their own must be, too.
    """
    backed, two = np.zeros(len(order) // N_LANES, dtype=np.int64), np.zeros(len(order) // N_LANES, dtype=np.bool_)
    for packet in prange(len(backed)):
        for i in range(packet * N_LANES, (packet + 1) * N_LANES):
            if beside[i] >= 0:
                backed[packet] |= 1 << (i % N_LANES)
                two[packet] |= beside[i] != face_ids[order[i]]
    return backed, two
