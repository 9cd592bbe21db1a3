"""`exact`: image space made exact on the CPU. The same answers as the oracle outside the boundary band, fast."""

import numpy as np
from numba import njit, prange

from zbuf_occlude.arrays import BoolArray, FloatArray, IntArray
from zbuf_occlude.errors import OptionError
from zbuf_occlude.image_space.clusters import make_clusters
from zbuf_occlude.image_space.decide import line_is_blocked
from zbuf_occlude.mesh import Mesh
from zbuf_occlude.sampling import SurfacePoints
from zbuf_occlude.visibility.interface import CONTACT, Occluder


def prepare(mesh: Mesh, *, contact: float = CONTACT) -> "Exact":
    """Make a mesh ready; `contact` is the contact tolerance as a fraction of the mesh's diagonal."""
    if not 0.0 <= contact < 1.0:
        raise OptionError(f"contact must lie in [0, 1), a fraction of the mesh's diagonal; got {contact}.")
    return Exact(mesh, contact)


class Exact(Occluder):
    """Faces in clusters, lines of sight tested against the clusters whose boxes they meet."""

    def __init__(self, mesh: Mesh, contact: float) -> None:
        super().__init__(mesh)
        self.contact = contact * mesh.diagonal
        self._clusters = make_clusters(mesh)

    def _visible(self, points: SurfacePoints, eyes: FloatArray) -> BoolArray:
        c = self._clusters
        reach = np.abs(eyes).max() + np.abs(points.positions).max() + np.abs(self.mesh.bounds).max()
        return _visible(
            points.positions,
            points.face_ids,
            eyes,
            c.face_ids,
            c.lower,
            c.upper,
            self.mesh.corners,
            self.contact,
            1e-12 * reach,
        )


@njit(parallel=True, cache=True)
def _visible(
    positions: FloatArray,
    own: IntArray,
    eyes: FloatArray,
    face_ids: IntArray,
    lower: FloatArray,
    upper: FloatArray,
    corners: FloatArray,
    contact: float,
    margin: float,
) -> BoolArray:
    answer = np.ones((len(eyes), len(positions)), dtype=np.bool_)
    for i in prange(len(positions)):
        point = (positions[i, 0], positions[i, 1], positions[i, 2])
        for j in range(len(eyes)):
            eye = (eyes[j, 0], eyes[j, 1], eyes[j, 2])
            answer[j, i] = not line_is_blocked(eye, point, own[i], face_ids, lower, upper, corners, contact, margin)
    return answer
