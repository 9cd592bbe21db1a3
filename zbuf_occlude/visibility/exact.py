"""`exact`: image space made exact on the CPU. The oracle's answers, faster than a ray caster's."""

from zbuf_occlude.arrays import BoolArray, FloatArray
from zbuf_occlude.errors import check_fraction
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.geometry.sampling import SurfacePoints
from zbuf_occlude.visibility.interface import CONTACT, FirstHits, VisibilityQuery


def prepare(mesh: Mesh, *, contact: float = CONTACT) -> "Exact":
    """Make a mesh ready; `contact` is the contact tolerance as a fraction of the mesh's diagonal."""
    check_fraction("contact", contact)
    return Exact(mesh, contact)


class Exact(VisibilityQuery):
    """Packets of points against leaves of faces, both projected: float32 where it is certain, else the definition."""

    _measures_directions = True  # as its threads come to them

    def __init__(self, mesh: Mesh, contact: float) -> None:
        from zbuf_occlude.exact import Engine  # late: its options are looked at where nothing is computed

        super().__init__(mesh)
        self._engine = Engine(mesh, contact * mesh.diagonal)

    def _visible(self, points: SurfacePoints, eyes: FloatArray) -> BoolArray:
        return self._engine.visible(points, eyes)

    def _first_hits(self, origins: FloatArray, directions: FloatArray) -> FirstHits:
        return FirstHits(*self._engine.first_hits(origins, directions))
