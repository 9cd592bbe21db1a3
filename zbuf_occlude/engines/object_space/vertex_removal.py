"""Hidden-surface removal by vertices (paper 3.3): a face with a hidden vertex is removed."""

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.base.arrays import BoolArray, FloatArray, IntArray
from zbuf_occlude.engines.object_space.distances import Distances
from zbuf_occlude.engines.object_space.exhaustive import NO_DISTANCES, hidden_points
from zbuf_occlude.engines.object_space.planes import FacePlanes
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.meshes.sampling import SurfacePoints


class VertexRemoval:
    """Mesh prepared for hidden-surface removal by vertices; `contact` is tau, world units.

    Notes
    -----
    A vertex is not tested against its own faces: those with a corner at the same *position*. The paper's meshes repeat
    a vertex for every face around it (chair_0003 has three per face); by index, the neighbouring faces would hide it.
    If faces merely touch (a vertex on another face's edge), the contact tolerance keeps the other face from hiding it.
    Repeated vertices are each tested, as in the paper's counts of points (2,628 faces, 7,884 points); vertices that no
    face uses are not tested.

    References
    ----------
    Paper 3.3: "The occluded vertices are firstly found, then they are removed with their associated elementary
    surfaces".
    """

    def __init__(self, mesh: Mesh, contact: float) -> None:
        self.mesh = mesh
        self.planes = FacePlanes.from_mesh(mesh)
        self._contact = contact
        # adding 0.0 turns -0.0 into 0.0
        _, position_ids = np.unique(mesh.vertices + 0.0, axis=0, return_inverse=True)
        labels: IntArray = position_ids.reshape(-1).astype(np.int32)
        self._face_labels: IntArray = labels[mesh.faces]
        self._used, corner_ids = np.unique(mesh.faces, return_inverse=True)
        self._corner_ids = corner_ids.reshape(-1, 3)
        self._labels: IntArray = labels[self._used]

    def visible(
        self, points: SurfacePoints, face_ids: IntArray, eyes: FloatArray, distances: Distances | None = None
    ) -> tuple[BoolArray, NDArray[np.int64]]:
        """Return which points lie on faces that are kept for each eye (world space).

        `face_ids`, (n,), index the mesh's faces; a point on none (-1) is tested itself. `distances` exclude far faces
        as occluders. Returns (k, n) bool, and the number of tested pairs of vertex and face for each eye.
        """
        free = face_ids < 0
        used, off_faces = self.mesh.vertices[self._used], points.positions[free]
        no_labels = np.full(len(off_faces), -1, dtype=np.int32)
        answer = np.empty((len(eyes), len(points)), dtype=bool)
        n_tests = np.zeros(len(eyes), dtype=np.int64)
        for j, eye in enumerate(eyes):
            far = NO_DISTANCES if distances is None else distances.from_eye(eye)
            search = self.planes, self._face_labels
            hidden, n_tests[j] = hidden_points(*search, used, self._labels, eye, self._contact, far)
            kept = np.asarray(~hidden[self._corner_ids].any(axis=1))
            answer[j] = kept[face_ids]
            hidden, n_free = hidden_points(*search, off_faces, no_labels, eye, self._contact, far)
            answer[j, free] = ~hidden
            n_tests[j] += n_free
        return answer, n_tests
