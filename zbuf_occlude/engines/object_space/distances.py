"""Distances from the eye to the faces, for the exclusion of far faces (paper 3.6, first and second suggestion)."""

import numpy as np

from zbuf_occlude.base.arrays import FloatArray, IntArray
from zbuf_occlude.engines.object_space.planes import FacePlanes
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.meshes.sampling import Seed, points_in_triangles, stochastic_counts


class PlaneDistances:
    """First suggestion: the distance from the eye to the *plane* of each face.

    Notes
    -----
    No point of a face is nearer than its plane, so a face that could hide a point is never excluded: the answers are
    those of the search without exclusion (up to rounding). O(f) per view.

    References
    ----------
    Paper 3.6: "calculate the distances between the camera and the planes of elementary surfaces".
    """

    def __init__(self, faces: FacePlanes) -> None:
        self._origin = faces.origin
        lengths = np.linalg.norm(faces.planes[:, :3], axis=1, keepdims=True)
        # a face without a normal (of a mesh that was not cleaned) occludes nothing, so its distance does not matter
        self._unit = faces.planes[:, :4] / np.where(lengths > 0.0, lengths, 1.0)

    def from_eye(self, eye: FloatArray) -> FloatArray:
        """Return the distances of all planes from an eye (world space), (f,)."""
        return np.abs(self._unit[:, :3] @ (eye - self._origin) + self._unit[:, 3])


class SampleDistances:
    """Second suggestion: the distance from the eye to the nearest of about `n_samples` points of Algorithm 1.

    Notes
    -----
    The nearest sample is farther than the nearest point of the face, so some faces are wrongly excluded: points farther
    than the face's nearest part but nearer than its nearest sample may be taken for visible. O(samples) per view.

    References
    ----------
    Paper 3.6: "choose a set of points from inside the surface and calculate the minimum distance". Departure: every
    face gets at least one sample, drawn separately if Algorithm 1 gives none; the paper does not define the distance of
    a face without samples, and on fine meshes most faces have none.
    """

    def __init__(self, mesh: Mesh, n_samples: int, seed: Seed = 0) -> None:
        rng = np.random.default_rng(seed)
        area = float(mesh.areas.sum())
        counts: IntArray = np.zeros(len(mesh.faces), dtype=np.int32)
        if area > 0.0:
            counts = stochastic_counts(mesh.areas, n_samples / area, rng)
        counts = np.maximum(counts, 1)
        self.positions = points_in_triangles(mesh.corners, counts, rng)
        self._first = np.cumsum(counts) - counts

    def from_eye(self, eye: FloatArray) -> FloatArray:
        """Return the distance of each face's nearest sample from an eye (world space), (f,)."""
        return np.asarray(np.minimum.reduceat(np.linalg.norm(self.positions - eye, axis=1), self._first))


Distances = PlaneDistances | SampleDistances
