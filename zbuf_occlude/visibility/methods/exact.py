"""`exact`: exact image-space visibility on the CPU, with the oracle's answers."""

from zbuf_occlude.base.arrays import BoolArray, FloatArray
from zbuf_occlude.base.errors import check_fraction
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.meshes.sampling import SurfacePoints
from zbuf_occlude.visibility.interface import CONTACT, FirstHits, VisibilityQuery


def prepare(mesh: Mesh, *, contact: float = CONTACT) -> "Exact":
    """Prepare a mesh; `contact` is the contact tolerance as a fraction of the mesh's diagonal."""
    check_fraction("contact", contact)
    return Exact(mesh, contact)


class Exact(VisibilityQuery):
    """Projected packets of points against projected leaves of faces, in float32 where certain, else in float64."""

    _rescales_directions = True  # its threads check lengths as they process the rays

    def __init__(self, mesh: Mesh, contact: float) -> None:
        from zbuf_occlude.engines.exact import Engine  # late: listing the options must not import numba

        super().__init__(mesh)
        self._engine = Engine(mesh, contact * mesh.diagonal)

    def _visible(self, points: SurfacePoints, eyes: FloatArray) -> BoolArray:
        return self._engine.visible(points, eyes)

    def _first_hits(self, origins: FloatArray, directions: FloatArray) -> FirstHits:
        return FirstHits(*self._engine.first_hits(origins, directions))
