"""Hidden surface removal by vertices (paper 3.3): a face goes as soon as one of its vertices is hidden."""

from typing import NamedTuple

import numpy as np

from zbuf_occlude.arrays import BoolArray, FloatArray, IntArray
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.geometry.sampling import SurfacePoints
from zbuf_occlude.object_space.exhaustive import NO_DISTANCES, hidden_points
from zbuf_occlude.object_space.planes import FacePlanes


class Removal(NamedTuple):
    """What is left of a mesh from one eye.

    Parameters
    ----------
    face_kept : (f,) bool
    n_tests : int
        Pairs of vertex and face that were tested.
    """

    face_kept: BoolArray
    n_tests: int


class VertexRemoval:
    """A mesh made ready for hidden surface removal by vertices.

    Parameters
    ----------
    mesh : Mesh
    contact : float
        The contact tolerance tau, world units.

    Notes
    -----
    A vertex is not tested against its own faces: those with a corner at the same *position*. Meshes of the kind that
    the paper uses repeat a vertex for every face around it (chair_0003 has three a face), so going by the vertex's
    index would leave its neighbours as occluders. Where faces merely touch (a vertex upon another face's edge), the
    contact tolerance keeps the other face from hiding it. Repeated vertices are each tested, as the paper's counts of
    points say (2,628 faces, 7,884 points); vertices that no face uses are not.

    References
    ----------
    Paper 3.3: "The occluded vertices are firstly found, then they are removed with their associated elementary
    surfaces".
    """

    def __init__(self, mesh: Mesh, contact: float) -> None:
        self.mesh = mesh
        self.planes = FacePlanes.of(mesh)
        self._contact = contact
        # + 0.0 turns -0.0 into 0.0
        _, position_ids = np.unique(mesh.vertices + 0.0, axis=0, return_inverse=True)
        labels: IntArray = position_ids.reshape(-1).astype(np.int32)
        self._face_labels: IntArray = labels[mesh.faces]
        self._used, corner_ids = np.unique(mesh.faces, return_inverse=True)
        self._corner_ids = corner_ids.reshape(-1, 3)
        self._labels: IntArray = labels[self._used]

    @property
    def n_vertices(self) -> int:
        """How many vertices are tested: N of the paper's O(N M)."""
        return len(self._used)

    def seen_from(self, eye: FloatArray, distances: FloatArray = NO_DISTANCES) -> Removal:
        """Find the faces that are left from an eye (world space); `distances` exclude far faces as occluders."""
        vertices = self.mesh.vertices[self._used]
        hidden, n_tests = hidden_points(
            self.planes, self._face_labels, vertices, self._labels, eye, self._contact, distances
        )
        return Removal(np.asarray(~hidden[self._corner_ids].any(axis=1)), n_tests)

    def free_points_seen_from(
        self, points: SurfacePoints, eye: FloatArray, distances: FloatArray = NO_DISTANCES
    ) -> tuple[BoolArray, int]:
        """Test points that lie on no face against all faces; (n,) bool, True = visible, and the tests made."""
        labels: IntArray = np.full(len(points), -1, dtype=np.int32)
        hidden, n_tests = hidden_points(
            self.planes, self._face_labels, points.positions, labels, eye, self._contact, distances
        )
        return ~hidden, n_tests
