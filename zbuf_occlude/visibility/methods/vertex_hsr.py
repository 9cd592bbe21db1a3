"""`vertex_hsr`: the paper's HSR by vertices (section 3.3). A face with a hidden vertex is removed."""

import warnings

import numpy as np

from zbuf_occlude.base.arrays import BoolArray, FloatArray
from zbuf_occlude.base.errors import OptionError, check_fraction, check_int
from zbuf_occlude.engines.object_space.division import Division, divide_faces
from zbuf_occlude.engines.object_space.vertex_removal import VertexRemoval
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.meshes.sampling import SurfacePoints
from zbuf_occlude.visibility.interface import CONTACT, VisibilityQuery


def prepare(mesh: Mesh, *, divide: float = 1.0, max_faces: int = 50_000, contact: float = CONTACT) -> "VertexHsr":
    """Prepare a mesh for HSR by vertices.

    Parameters
    ----------
    mesh : Mesh
    divide : float
        Largest area of a face, as a fraction of the mesh's area; larger faces are divided first (Fig. 4). 1 divides
        none.
    max_faces : int
        Maximum number of faces after division. If it would be exceeded, `divide` is raised, a warning is given and
        ``division.limited`` is True.
    contact : float
        Contact tolerance as a fraction of the mesh's diagonal.

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
            f"stopped at {len(areas)}, the largest {areas.max() / areas.sum():.2g}. Raise max_faces.",
            stacklevel=2,
        )
    return VertexHsr(mesh, division, contact)


class VertexHsr(VisibilityQuery):
    """Test of each vertex against all faces; faces with a hidden vertex are removed, with their points.

    Attributes
    ----------
    division : Division
        The divided mesh that is tested, and its relation to the given mesh.
    n_tests : (k,) int64
        Number of pairs of vertex and face that the latest `visible` tested from each eye.

    Notes
    -----
    Not exact: a partly hidden face is removed as a whole (false hidden, more for larger faces), and a face that is
    hidden only between its visible vertices is kept as a whole (false visible). Division reduces both errors.

    The mask is ``face_kept[face_ids]``; a point on a divided face has the answer of the child it lies in. A point on no
    face is tested itself, like a vertex.

    O(k v f) time, independent of the number of points; all cores share the vertices. Division multiplies both v and f,
    as the paper warns.

    References
    ----------
    Paper section 3.3; Eq. 1-3, 5-10; Fig. 4. `zbuf_occlude.engines.object_space.vertex_removal` defines a vertex's own
    faces.
    """

    def __init__(self, mesh: Mesh, division: Division, contact: float) -> None:
        super().__init__(mesh)
        self.division = division
        self._removal = VertexRemoval(division.mesh, contact * mesh.diagonal)
        self.n_tests = np.zeros(0, dtype=np.int64)

    def _visible(self, points: SurfacePoints, eyes: FloatArray) -> BoolArray:
        answer, self.n_tests = self._removal.visible(points, self.division.children_of(points), eyes)
        return answer
