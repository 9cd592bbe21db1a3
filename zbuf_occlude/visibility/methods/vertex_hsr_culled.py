"""`vertex_hsr_culled`: HSR by vertices, with far faces excluded (paper 3.6, first and second suggestion)."""

import numpy as np

from zbuf_occlude.base.arrays import BoolArray, FloatArray
from zbuf_occlude.base.errors import OptionError, check_fraction, check_int
from zbuf_occlude.engines.object_space.distances import Distances, PlaneDistances, SampleDistances
from zbuf_occlude.engines.object_space.vertex_removal import VertexRemoval
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.meshes.sampling import SurfacePoints
from zbuf_occlude.visibility.interface import CONTACT, VisibilityQuery


def prepare(
    mesh: Mesh, *, suggestion: int = 2, n_samples: int = 10_000, seed: int = 0, contact: float = CONTACT
) -> "VertexHsrCulled":
    """Prepare a mesh for HSR by vertices with far faces excluded.

    Parameters
    ----------
    mesh : Mesh
    suggestion : {1, 2}
        Distance by which faces are excluded: 1, that of their planes; 2, that of points sampled on them.
    n_samples : int
        Approximate number of points sampled on the mesh for suggestion 2; every face gets at least one.
    seed : int
        Seed of that sampling.
    contact : float
        Contact tolerance as a fraction of the mesh's diagonal.

    Raises
    ------
    OptionError
        A value is out of range.
    """
    if suggestion not in (1, 2):
        raise OptionError(f"suggestion must be 1 or 2, the paper's first or second (section 3.6); got {suggestion!r}.")
    check_int("n_samples", n_samples, 1)
    check_int("seed", seed, 0)
    check_fraction("contact", contact)
    return VertexHsrCulled(mesh, suggestion, n_samples, seed, contact)


class VertexHsrCulled(VisibilityQuery):
    """Test of each vertex against the faces nearer to the eye; faces with a hidden vertex are removed.

    Attributes
    ----------
    n_tests : (k,) int64
        Number of pairs of vertex and face that the latest `visible` tested from each eye, without excluded pairs.

    Notes
    -----
    With ``suggestion=1`` the answers are those of `vertex_hsr`: no face that could hide a vertex is excluded. With 2, a
    face is excluded if its nearest sample is farther than the vertex, even if a part of it is nearer. Some hidden
    vertices are then taken for visible and their faces kept.

    O(k v f) comparisons of distances remain, and about half of the tests.

    References
    ----------
    Paper section 3.6 and Table 1A; `zbuf_occlude.engines.object_space.distances`.
    """

    def __init__(self, mesh: Mesh, suggestion: int, n_samples: int, seed: int, contact: float) -> None:
        super().__init__(mesh)
        self._removal = VertexRemoval(mesh, contact * mesh.diagonal)
        self._distances: Distances
        if suggestion == 1:
            self._distances = PlaneDistances(self._removal.planes)
        else:
            self._distances = SampleDistances(mesh, n_samples, seed)
        self.n_tests = np.zeros(0, dtype=np.int64)

    def _visible(self, points: SurfacePoints, eyes: FloatArray) -> BoolArray:
        answer, self.n_tests = self._removal.visible(points, points.face_ids, eyes, self._distances)
        return answer
