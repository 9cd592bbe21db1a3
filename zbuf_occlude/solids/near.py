"""Which faces of closed surfaces are near each other: what has to be compared before a surface passes for a solid's."""

from typing import NamedTuple

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from zbuf_occlude.arrays import BoolArray, FloatArray, IntArray
from zbuf_occlude.mesh import Mesh
from zbuf_occlude.solids.closed import ClosedSurfaces
from zbuf_occlude.threads import threaded

MOST_COMPARED = 10**9
"""Pairs of boxes that are compared at most, in a second or less; a mesh that needs more is left alone."""

MOST_NEAR = 64
"""Pairs kept at most for a face in the mean, or `FEW_NEAR` in all; a reach that needs more leaves nothing to say."""

FEW_NEAR = 4 * 10**6
"""Pairs that are always kept: 50 MB."""

KEPT = 24
"""Neighbours kept for a face while they are counted; who has more is compared once more."""


class NearFaces(NamedTuple):
    """Pairs of faces of the same closed surface whose boxes, widened, overlap.

    Attributes
    ----------
    corners : (f, 3, 3) float64
        Of all faces, about the mesh's centre, in units of its diagonal.
    starts : (f + 1,) int64
    others : (2 x pairs,) int32
        Those near face i are ``others[starts[i] : starts[i + 1]]``, itself not among them.
    complete : (s,) bool, by the number of the surface
        False where there were too many to compare (`MOST_COMPARED`) or to keep (`MOST_NEAR`); its faces have no others
        then.
    """

    corners: FloatArray
    starts: NDArray[np.int64]
    others: IntArray
    complete: BoolArray


def near_faces(mesh: Mesh, closed: ClosedSurfaces, reach: float) -> NearFaces:
    """Find the pairs of faces of each closed surface whose boxes come nearer than `reach` diagonals to each other.

    Notes
    -----
    Sort and sweep, surface after surface, along the axis on which faces overlap least.
    """
    corners = (mesh.corners - mesh.centre) / mesh.diagonal
    faces = np.flatnonzero(closed.outward).astype(np.int32)
    complete = np.ones(int(closed.surfaces.max()) + 1, dtype=np.bool_)
    lower, upper = corners[faces].min(axis=1) - reach, corners[faces].max(axis=1) + reach
    none = np.zeros(len(corners) + 1, dtype=np.int64), faces[:0]
    if len(faces) == 0:
        return NearFaces(corners, *none, complete)
    order, ends = sweep(lower, upper, closed.surfaces[faces] * np.float64(2.0))  # the mesh is less than 2 units long
    if int((ends - np.arange(len(ends))).sum()) > MOST_COMPARED:
        complete[closed.surfaces[faces]] = False
        return NearFaces(corners, *none, complete)
    faces, boxes = faces[order], np.concatenate([lower[order], upper[order]], axis=1)
    surfaces = closed.surfaces[faces]
    counts, kept = _count(boxes, ends, surfaces)
    if int(counts.sum()) > max(FEW_NEAR, MOST_NEAR * len(faces)):
        complete[surfaces] = False
        return NearFaces(corners, *none, complete)
    later = np.concatenate([[0], np.cumsum(counts)])
    starts, others = _both_ways(faces, later, _list(boxes, ends, surfaces, later, kept), len(corners))
    return NearFaces(corners, starts, others, complete)


def sweep(lower: FloatArray, upper: FloatArray, shift: FloatArray) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Order boxes along the axis on which they overlap least, so that only near ones need be compared.

    Parameters
    ----------
    lower, upper : (n, 3) float64
    shift : (n,) float64
        By which each is moved along the axis first.

    Returns
    -------
    order : (n,) int64
    ends : (n,) int64
        The i-th of them overlaps on this axis those from i + 1 to ``ends[i]``, of the later ones, and no others.
    """
    extent = np.maximum((upper - lower).max(axis=0), np.ptp(lower, axis=0))
    axis = int(((upper - lower).sum(axis=0) / np.maximum(extent, 1e-300)).argmin())
    begin = lower[:, axis] + shift
    order = np.argsort(begin, kind="stable")
    ends = np.searchsorted(begin[order], (begin + upper[:, axis] - lower[:, axis])[order] + 1e-6, side="right")
    return order.astype(np.int64), ends.astype(np.int64)


@njit(inline="always")
def overlap(boxes, i, j):  # type: ignore[no-untyped-def]
    """Whether boxes (n, 6), lower and upper corners, i and j overlap."""
    return (
        boxes[j, 1] <= boxes[i, 4]
        and boxes[i, 1] <= boxes[j, 4]
        and boxes[j, 2] <= boxes[i, 5]
        and boxes[i, 2] <= boxes[j, 5]
        and boxes[j, 0] <= boxes[i, 3]
        and boxes[i, 0] <= boxes[j, 3]
    )


@threaded
def _count(boxes: FloatArray, ends: NDArray[np.int64], surfaces: IntArray) -> tuple[NDArray[np.int64], IntArray]:
    """How many later boxes of its surface each overlaps, and the first `KEPT` of them."""
    counts, kept = np.zeros(len(boxes), dtype=np.int64), np.empty((len(boxes), KEPT), dtype=np.int32)
    for i in prange(len(boxes)):
        for j in range(i + 1, ends[i]):
            if overlap(boxes, i, j) and surfaces[i] == surfaces[j]:
                if counts[i] < KEPT:
                    kept[i, counts[i]] = j
                counts[i] += 1
    return counts, kept


@threaded
def _list(
    boxes: FloatArray, ends: NDArray[np.int64], surfaces: IntArray, later: NDArray[np.int64], kept: IntArray
) -> IntArray:
    """Those later boxes, one list after the other."""
    listed = np.empty(later[-1], dtype=np.int32)
    for i in prange(len(boxes)):
        to = later[i]
        if later[i + 1] - to <= KEPT:
            listed[to : later[i + 1]] = kept[i, : later[i + 1] - to]
            continue
        for j in range(i + 1, ends[i]):
            if overlap(boxes, i, j) and surfaces[i] == surfaces[j]:
                listed[to] = j
                to += 1
    return listed


@njit(cache=True)
def _both_ways(
    faces: IntArray, later: NDArray[np.int64], listed: IntArray, n_faces: int
) -> tuple[NDArray[np.int64], IntArray]:
    """Turn lists of later neighbours, by place in `faces`, into lists of all, by face."""
    starts = np.zeros(n_faces + 1, dtype=np.int64)
    for i in range(len(faces)):
        starts[faces[i] + 1] += later[i + 1] - later[i]
        for j in listed[later[i] : later[i + 1]]:
            starts[faces[j] + 1] += 1
    for face in range(n_faces):
        starts[face + 1] += starts[face]
    others, at = np.empty(starts[-1], dtype=np.int32), starts[:-1].copy()
    for i in range(len(faces)):
        for j in listed[later[i] : later[i + 1]]:
            f, g = faces[i], faces[j]
            others[at[f]], others[at[g]] = g, f
            at[f] += 1
            at[g] += 1
    return starts, others
