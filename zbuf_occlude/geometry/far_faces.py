"""Faces far from all others of a mesh: they enlarge its bounding box, and every tolerance relative to it."""

from typing import Any, NamedTuple

import numpy as np

from zbuf_occlude.base.arrays import FloatArray, IntArray
from zbuf_occlude.base.jit.compiler import njit
from zbuf_occlude.base.jit.vec3 import cross, dot, minus
from zbuf_occlude.geometry.mesh import Mesh

NEAR_AREA, NEAR_SIZE = 0.99, 0.01
"""A mesh has far faces if `NEAR_AREA` of its area lies within `NEAR_SIZE` of its diagonal."""
BINS = 256
"""Bins along the mesh's longest side."""
SAMPLED, MAX_STEP = 1_000, 50
"""Number of faces that the first test samples, every n-th one with n at most `MAX_STEP`."""
SAMPLED_SHARE = 0.5
"""Share of the sampled faces, by area or number, that lies together in a mesh with far faces. These have at most 1 % of
the area. A sample that misses the large faces of the others may be mostly far by area, but then not by number."""
NAMED = 3
"""Maximum number of faces that a message names."""


class FarFaces(NamedTuple):
    """Faces far from most of a mesh."""

    face_ids: IntArray  # (m,) into the mesh's faces, the farthest first
    distance: float  # of the farthest from the middle of the others
    size: float  # diagonal of the others' bounding box

    def summary(self, mesh: Mesh) -> str:
        """Return a clause that names the faces by their ids in the file, and their distance."""
        assert mesh.source_face_ids is not None
        numbers = mesh.source_face_ids[self.face_ids]
        names = ", ".join(map(str, numbers[:NAMED].tolist()))
        more = f" and {len(numbers) - NAMED} more" if len(numbers) > NAMED else ""
        return (
            f"{NEAR_AREA:.0%} of the area of {mesh.name} lies within {self.size:.3g}, and face {names}{more} up to "
            f"{self.distance:.3g} away from it"
        )


def far_faces(mesh: Mesh) -> FarFaces | None:
    """Return the faces far from most of a mesh's area; None if there are none, which nearly always a sample shows."""
    step = min(-(-len(mesh.faces) // SAMPLED), MAX_STEP)
    limit = NEAR_SIZE * mesh.diagonal
    if not (_is_concentrated(mesh, limit, step, SAMPLED_SHARE) and _is_concentrated(mesh, limit, 1, NEAR_AREA)):
        return None
    middles, areas = mesh.corners.mean(axis=1), mesh.areas
    median = np.array([_weighted_median(middles[:, i], areas) for i in range(3)])
    order = np.argsort(_farthest(mesh.corners, median), kind="stable")
    most = order[: np.searchsorted(np.cumsum(areas[order]), NEAR_AREA * areas.sum()) + 1]
    corners = mesh.corners[most].reshape(-1, 3)
    if np.linalg.norm(np.ptp(corners, axis=0)) > limit:
        return None
    distances = _farthest(mesh.corners, (corners.min(axis=0) + corners.max(axis=0)) / 2.0)
    far = distances > limit
    ids = np.argsort(-distances, kind="stable")[: int(far.sum())].astype(np.int32)
    others = mesh.corners[~far].reshape(-1, 3)
    return FarFaces(ids, float(distances[ids[0]]), float(np.linalg.norm(np.ptp(others, axis=0))))


def _is_concentrated(mesh: Mesh, limit: float, step: int, share: float) -> bool:
    """Return whether `share` of every `step`-th face, by area or number, may lie within `limit` along an axis."""
    low, high = mesh.bounds
    axis = int((high - low).argmax())
    width = float(high[axis] - low[axis]) / BINS
    if width == 0.0:
        return False
    return bool(_has_dense_bins(mesh.vertices, mesh.faces, step, axis, low[axis], width, limit, share))


def _farthest(corners: FloatArray, position: FloatArray) -> FloatArray:
    """Return the distance of the farthest corner of each face (f, 3, 3) from a position, (f,)."""
    return np.asarray(np.linalg.norm(corners - position, axis=2).max(axis=1))


def _weighted_median(values: FloatArray, weights: FloatArray) -> float:
    order = np.argsort(values, kind="stable")
    sums = np.cumsum(weights[order])
    return float(values[order[np.searchsorted(sums, sums[-1] / 2.0)]])


@njit(cache=True, nogil=True, _nrt=True)
def _has_dense_bins(
    vertices: Any, faces: Any, step: Any, axis: Any, low: Any, width: Any, limit: Any, share: Any
) -> Any:
    """Return whether consecutive bins that may span `limit` hold `share` of every `step`-th face, by area or number."""
    areas, counts, area_total, n_faces = np.zeros(BINS), np.zeros(BINS), 0.0, 0
    for face in range(0, len(faces), step):
        a, b, c = vertices[faces[face, 0]], vertices[faces[face, 1]], vertices[faces[face, 2]]
        n = cross(minus(b, a), minus(c, a))
        index = min(max(int(((a[axis] + b[axis] + c[axis]) / 3.0 - low) / width), 0), BINS - 1)
        area = np.sqrt(dot(n, n))
        areas[index] += area
        counts[index] += 1.0
        area_total += area
        n_faces += 1
    n_bins, area, count, most_area, most = int(np.ceil(limit / width)) + 1, 0.0, 0.0, 0.0, 0.0
    for i in range(BINS):
        area += areas[i]
        count += counts[i]
        if i >= n_bins:
            area -= areas[i - n_bins]
            count -= counts[i - n_bins]
        most_area, most = max(most_area, area), max(most, count)
    return area_total > 0.0 and (most_area >= share * area_total * (1.0 - 1e-9) or most >= share * n_faces)
