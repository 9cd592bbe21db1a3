"""Which faces keep clear of all but those that they are joined to, so that visibility can be followed over them."""

from typing import NamedTuple

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from zbuf_occlude.arrays import BoolArray, FloatArray, IntArray
from zbuf_occlude.predicates import dot, minus
from zbuf_occlude.solids.barriers import Barriers, make_barriers, no_barriers
from zbuf_occlude.solids.clearance import face_frames
from zbuf_occlude.solids.closed import ClosedSurfaces
from zbuf_occlude.solids.crossing import APART, may_meet, separated
from zbuf_occlude.solids.near import MOST_COMPARED, overlap, sweep
from zbuf_occlude.solids.triangles import corner
from zbuf_occlude.threads import threaded

MOST_NEAR = 8
"""A face that more others come near to is left alone."""

SHARP = -0.5
"""Cosine of the turn of the normal from a face to one that it is joined to, beyond which the fold is sharp: the strip
along it in which they are within reach of each other is wide."""

MOST_CROWDED = 0.5
"""Of the faces; in a mesh that has more, barriers are not looked for."""


class Clearance(NamedTuple):
    """How faces keep from others that they are not joined to.

    A face is joined to those of the fans around its corners: to what can be reached from it around a corner through
    edges that exactly two faces share.

    Attributes
    ----------
    clear : (f,) bool
        Whether no other face comes within reach, and the fans neither cross themselves nor fold sharply over the face.
    barriers : Barriers
        Where on faces with such fans a few others come within reach.
    """

    clear: BoolArray
    barriers: Barriers


def find_clearance(corners: FloatArray, closed: ClosedSurfaces, reach: float) -> Clearance:
    """Find the faces with nothing near them but what they are joined to, and what is near the others.

    Parameters
    ----------
    corners : (f, 3, 3) float64
        About the mesh's centre, in units of its diagonal.
    closed : ClosedSurfaces
    reach : float
        Diagonals. A face that is not joined to a clear one is not nearer to it than this.

    Returns
    -------
    Clearance
        Of no face clear, and without barriers, where too many pairs would have to be compared (`near.MOST_COMPARED`).

    Notes
    -----
    Sort and sweep; some 2 microseconds a face on two cores.
    """
    lower, upper = corners.min(axis=1) - reach, corners.max(axis=1) + reach
    order, ends = sweep(lower, upper, np.zeros(len(lower)))
    if int((ends - np.arange(len(ends))).sum()) > MOST_COMPARED:
        return Clearance(np.zeros(len(corners), dtype=np.bool_), no_barriers(len(corners)))
    fans = find_fans(closed.twins, closed.vertices.reshape(-1))
    boxes = np.concatenate([lower[order], upper[order]], axis=1)
    crowded, crossed, folded = _compare(
        corners, fans, order, ends, boxes, face_frames(corners), closed.sides, closed.outward, reach
    )
    sound = ~(folded | crossed[fans].any(axis=1))
    if crowded.mean() > MOST_CROWDED:
        return Clearance(sound & ~crowded, no_barriers(len(corners)))
    near, counts = _list(corners, fans, order, ends, boxes, reach, crowded)
    counts[~sound | (counts > MOST_NEAR)] = 0
    return Clearance(sound & ~crowded, make_barriers(corners, near, counts, reach))


@njit(cache=True)
def find_fans(twins: NDArray[np.int64], starts: IntArray) -> IntArray:
    """Number the fans: (f, 3) int32, of each corner of each face.

    Parameters
    ----------
    twins : (3 f,) int64
        As in `ClosedSurfaces`.
    starts : (3 f,) int32
        Numbers of the corners' positions.
    """
    parents = np.arange(len(twins)).astype(np.int32)
    for half in range(len(twins)):
        twin = twins[half]
        if twin < half:
            continue
        after, twin_after = half - half % 3 + (half + 1) % 3, twin - twin % 3 + (twin + 1) % 3
        if starts[twin] != starts[half]:
            twin, twin_after = twin_after, twin
        for a, b in ((half, twin), (after, twin_after)):
            while parents[a] != a:
                parents[a] = parents[parents[a]]
                a = parents[a]
            while parents[b] != b:
                parents[b] = parents[parents[b]]
                b = parents[b]
            parents[max(a, b)] = min(a, b)
    for half in range(len(parents)):
        parents[half] = parents[parents[half]]  # lower numbers have found theirs
    return parents.reshape(-1, 3)


@njit
def _joined(fans, f, g):  # type: ignore[no-untyped-def]
    """Whether two faces have a fan in common."""
    found = False
    for a in range(3):
        for b in range(3):
            found |= fans[f, a] == fans[g, b]
    return found


@threaded
def _compare(
    corners: FloatArray,
    fans: IntArray,
    order: NDArray[np.int64],
    ends: NDArray[np.int64],
    boxes: FloatArray,
    frames: FloatArray,
    sides: NDArray[np.int8],
    outward: NDArray[np.int8],
    reach: float,
) -> tuple[BoolArray, BoolArray, BoolArray]:
    """Which faces have others near them that they are not joined to, in which fans faces may meet, what is folded over.

    `frames` are those of `clearance.face_frames`.
    """
    folded = np.zeros(len(corners), dtype=np.bool_)
    crowded, crossed = np.zeros(len(corners), dtype=np.bool_), np.zeros(fans.size, dtype=np.bool_)
    for i in prange(len(order)):
        f = order[i]
        for j in range(i + 1, ends[i]):
            g = order[j]
            if not overlap(boxes, i, j):
                continue
            if not _joined(fans, f, g):
                if not (crowded[f] and crowded[g]) and not separated(corners[f], corners[g], reach):
                    crowded[f] = crowded[g] = True
                continue
            if dot(corner(frames[f], 0), corner(frames[g], 0)) * sides[f] * sides[g] < SHARP:
                folded[f] |= outward[f] == 0 or _rises(corners[f], corner(frames[f], 0), outward[f], corners[g])
                folded[g] |= outward[g] == 0 or _rises(corners[g], corner(frames[g], 0), outward[g], corners[f])
            if may_meet(corners[f], corners[g]):
                for a in range(3):
                    for b in range(3):
                        if fans[f, a] == fans[g, b]:
                            crossed[fans[f, a]] = True
    return crowded, crossed, folded


@njit
def _rises(f, normal, outward, g):  # type: ignore[no-untyped-def]
    """Whether g comes before the outer side of a solid's face f."""
    before = False
    for i in range(3):
        before |= outward * dot(normal, minus(corner(g, i), corner(f, 0))) > APART
    return before


@njit(cache=True)
def _list(
    corners: FloatArray,
    fans: IntArray,
    order: NDArray[np.int64],
    ends: NDArray[np.int64],
    boxes: FloatArray,
    reach: float,
    crowded: BoolArray,
) -> tuple[IntArray, IntArray]:
    """The first `MOST_NEAR` faces near each crowded one, (f, MOST_NEAR), and how many there are, (f,)."""
    near, counts = np.zeros((len(corners), MOST_NEAR), dtype=np.int32), np.zeros(len(corners), dtype=np.int32)
    for i in range(len(order)):
        f = order[i]
        if not crowded[f]:
            continue
        for j in range(i + 1, ends[i]):
            g = order[j]
            if not (crowded[g] and overlap(boxes, i, j)) or _joined(fans, f, g):
                continue
            if not separated(corners[f], corners[g], reach):
                for one, other in ((f, g), (g, f)):
                    if counts[one] < MOST_NEAR:
                        near[one, counts[one]] = other
                    counts[one] += 1
    return near, counts
