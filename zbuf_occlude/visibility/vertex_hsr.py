"""`vertex_hsr`: the paper's HSR by vertices (section 3.3). A face goes as soon as one of its vertices is hidden."""

import warnings

import numpy as np

from zbuf_occlude.arrays import BoolArray, FloatArray
from zbuf_occlude.errors import OptionError, check_fraction, check_int
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.geometry.sampling import SurfacePoints
from zbuf_occlude.object_space.division import Division, divide_faces
from zbuf_occlude.object_space.vertex_removal import VertexRemoval
from zbuf_occlude.visibility.interface import CONTACT, VisibilityQuery


def prepare(mesh: Mesh, *, divide: float = 1.0, max_faces: int = 50_000, contact: float = CONTACT) -> "VertexHsr":
    """Make a mesh ready for HSR by vertices.

    Parameters
    ----------
    mesh : Mesh
    divide : float
        Faces of an area above this fraction of the mesh's area are divided first (Fig. 4); 1 divides none.
    max_faces : int
        The division makes no more faces than this. When it would, `divide` is raised, a warning says so and
        ``division.limited`` is True.
    contact : float
        The contact tolerance as a fraction of the mesh's diagonal.

    Raises
    ------
    OptionError
        A value is out of range.
    """
    if not 0.0 < divide <= 1.0:
        raise OptionError(f"divide must lie in (0, 1], a fraction of the mesh's area; got {divide}.")
    check_int("max_faces", max_faces, 1)
    check_fraction("contact", contact)
    division = divide_faces(mesh, divide, int(max_faces))
    if division.limited:
        areas = division.mesh.areas
        warnings.warn(
            f"dividing faces of {mesh.name} down to {divide:g} of its area would make more than {max_faces} faces; "
            f"stopped at {len(areas)}, the largest {areas.max() / areas.sum():.2g}. Raise max_faces to go on.",
            stacklevel=2,
        )
    return VertexHsr(mesh, division, contact)


class VertexHsr(VisibilityQuery):
    """Each vertex against all faces; faces with a hidden vertex are dropped, and their points with them.

    Attributes
    ----------
    division : Division
        The mesh that is tested, and how it came from the one given.
    n_tests : (k,) int64
        How many pairs of vertex and face the latest `visible` tested from each eye.

    Notes
    -----
    Not exact: a partly hidden face is dropped whole (false hidden, the more the larger the faces are), and a face that
    is hidden between visible vertices is kept whole (false visible). Dividing helps with both.

    The mask says ``face_kept[face_ids]``; a point on a divided face goes with the child it lies in. A point that lies
    on no face is tested itself, like a vertex.

    O(k v f) time whatever the number of points; all cores share the vertices, as in `oracle`. Dividing multiplies
    both v and f, as the paper warns.

    References
    ----------
    Paper section 3.3; Eq. 1-3, 5-10; Fig. 4. See `zbuf_occlude.object_space.vertex_removal` for what a vertex's own
    faces are.
    """

    def __init__(self, mesh: Mesh, division: Division, contact: float) -> None:
        super().__init__(mesh)
        self.division = division
        self._removal = VertexRemoval(division.mesh, contact * mesh.diagonal)
        self.n_tests = np.zeros(0, dtype=np.int64)

    def _visible(self, points: SurfacePoints, eyes: FloatArray) -> BoolArray:
        answer, self.n_tests = self._removal.visible(points, self.division.children_of(points), eyes)
        return answer
