"""Faces far away from all else of a mesh: they enlarge its bounding box, and each tolerance that is a share of it."""

from typing import Any, NamedTuple

import numpy as np

from zbuf_occlude.arrays import FloatArray, IntArray
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.jit.compiler import njit
from zbuf_occlude.jit.vec3 import cross, dot, minus

MOST_AREA = 0.99
NEAR = 0.01
"""A mesh has far faces where `MOST_AREA` of its area lies within this share of its diagonal."""
BINS = 256
GLANCED_AT = 50_000
"""So many faces, every n-th of more, tell whether a closer look is worth its time; nearly always it is not."""
NAMED = 3
"""So many of them are named."""


class FarFaces(NamedTuple):
    """What lies far away from most of a mesh."""

    face_ids: IntArray  # (m,) into the mesh's faces, the farthest first
    distance: float  # of the farthest from the middle of the others
    size: float  # diagonal of the others' bounding box

    def said(self, mesh: Mesh) -> str:
        """Say which faces they are and how far away, by their numbers in the file."""
        assert mesh.source_face_ids is not None
        numbers = mesh.source_face_ids[self.face_ids]
        names = ", ".join(map(str, numbers[:NAMED].tolist()))
        more = f" and {len(numbers) - NAMED} more" if len(numbers) > NAMED else ""
        return (
            f"{MOST_AREA:.0%} of the area of {mesh.name} lies within {self.size:.3g}, and face {names}{more} up to "
            f"{self.distance:.3g} away from it"
        )


def far_faces(mesh: Mesh) -> FarFaces | None:
    """Return the faces far from most of a mesh's area; None where there are none, which most often a glance tells."""
    low, sides = mesh.bounds[0], np.ptp(mesh.bounds, axis=0)
    axis, reach = int(sides.argmax()), NEAR * mesh.diagonal
    if not (mesh.diagonal > 0.0 and mesh.areas.any()):
        return None
    shares = np.zeros(BINS)
    step = -(-len(mesh.faces) // GLANCED_AT)
    _fill_shares(mesh.vertices, mesh.faces, step, axis, low[axis], BINS / sides[axis], shares)
    width = int(np.ceil(reach / (sides[axis] / BINS))) + 1
    if np.convolve(shares, np.ones(width)).max() < (MOST_AREA if step == 1 else 0.9) * shares.sum():
        return None
    middles, areas = mesh.corners.mean(axis=1), mesh.areas
    median = np.array([_weighted_median(middles[:, i], areas) for i in range(3)])
    order = np.argsort(_farthest(mesh.corners, median), kind="stable")
    most = order[: np.searchsorted(np.cumsum(areas[order]), MOST_AREA * areas.sum()) + 1]
    corners = mesh.corners[most].reshape(-1, 3)
    if np.linalg.norm(np.ptp(corners, axis=0)) > reach:
        return None
    distances = _farthest(mesh.corners, (corners.min(axis=0) + corners.max(axis=0)) / 2.0)
    far = distances > reach
    ids = np.argsort(-distances, kind="stable")[: int(far.sum())].astype(np.int32)
    others = mesh.corners[~far].reshape(-1, 3)
    return FarFaces(ids, float(distances[ids[0]]), float(np.linalg.norm(np.ptp(others, axis=0))))


def _farthest(corners: FloatArray, place: FloatArray) -> FloatArray:
    """Return how far the farthest corner of each face (f, 3, 3) is from a place, (f,)."""
    return np.asarray(np.linalg.norm(corners - place, axis=2).max(axis=1))


def _weighted_median(values: FloatArray, weights: FloatArray) -> float:
    order = np.argsort(values, kind="stable")
    sums = np.cumsum(weights[order])
    return float(values[order[np.searchsorted(sums, sums[-1] / 2.0)]])


@njit(cache=True, nogil=True)
def _fill_shares(vertices: Any, faces: Any, step: Any, axis: Any, low: Any, per_bin: Any, shares: Any) -> None:
    """Add the area of every n-th face to the bin that its middle is in along an axis."""
    for face in range(0, len(faces), step):
        a, b, c = vertices[faces[face, 0]], vertices[faces[face, 1]], vertices[faces[face, 2]]
        n = cross(minus(b, a), minus(c, a))
        place = ((a[axis] + b[axis] + c[axis]) / 3.0 - low) * per_bin
        shares[min(max(int(place), 0), len(shares) - 1)] += np.sqrt(dot(n, n)) / 2.0
