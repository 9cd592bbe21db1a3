"""Visible surface: the visible part of a mesh, cut exactly, and its visible vertices, by a method of the table."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from zbuf_occlude.base.arrays import BoolArray, FloatArray, IntArray
from zbuf_occlude.base.errors import MeshError, check_fraction
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.meshes.conversion import MeshLike, as_mesh
from zbuf_occlude.meshes.sampling import SurfacePoints
from zbuf_occlude.visibility import prepare
from zbuf_occlude.visibility.interface import CONTACT, as_eyes

WHOLE = 1e-9
"""Share of a face's area up to which a missing part is ignored, and up to which a visible part is ignored."""


class VisiblePart(NamedTuple):
    """Part of a mesh that eyes see.

    mesh : Mesh, in the space of the whole mesh and with its winding; faces that are wholly seen are unchanged
    face_ids : (f,) int32, index into the whole mesh's ``faces`` of the face that each piece lies on
    """

    mesh: Mesh
    face_ids: IntArray


def visible_vertices(mesh: MeshLike, eyes: ArrayLike, *, method: str = "exact", **options: Any) -> BoolArray:
    """Return which vertices each eye sees: (k, v) bool, (1, v) for one eye (3,).

    A vertex is hidden by faces that the line of sight crosses, never by faces that meet at the vertex. A corner on the
    silhouette is therefore visible. Vertices that no face uses are tested too.

    Raises
    ------
    ArgumentError, OptionError, UnavailableError, GlError
        As `prepare` and `VisibilityQuery.visible`.

    Examples
    --------
    >>> mesh = zo.load_mesh("chair.off")
    >>> zo.visible_vertices(mesh, [[3.0, 2.0, 1.5]]).shape == (1, len(mesh.vertices))
    True
    """
    mesh, eyes = as_mesh(mesh), as_eyes(eyes)
    with prepare(mesh, method, **options) as query:
        return query.visible(SurfacePoints.free(mesh.vertices), eyes)


def visible_mesh(mesh: MeshLike, eyes: ArrayLike, *, contact: float = CONTACT) -> VisiblePart:
    """Cut the mesh along the edges of the shadows, and keep the parts that at least one of the eyes sees.

    Exact except for rounding: from each face the cones of the eye and the faces before it are removed (`shadow_cuts`).
    A face seen edge-on is left out. Faces that an eye lies on hide nothing from it. A face more than 300 contact
    tolerances before another hides it up to where both meet; other faces hide from the tolerance on.

    Parameters
    ----------
    mesh : Mesh
        Or any other mesh (`as_mesh`).
    eyes : (3,) or (k, 3) float
        World space.
    contact : float
        Contact tolerance as a fraction of the mesh's diagonal.

    Returns
    -------
    VisiblePart
        Neighbouring pieces meet in T-junctions, at which the part is not watertight.

    Raises
    ------
    MeshError
        No part is visible.
    ArgumentError
        Eyes that are not finite vectors.
    OptionError
        `contact` is out of range.

    Examples
    --------
    >>> part = zo.visible_mesh("chair.off", [3.0, 2.0, 1.5])
    >>> len(part.face_ids) == len(part.mesh.faces)
    True
    """
    from zbuf_occlude.visibility.shadow_cuts import cut_by_shadows  # late: it imports numba

    mesh = _with_area(mesh)
    check_fraction("contact", contact)
    return _joined(mesh, *cut_by_shadows(mesh, as_eyes(eyes), contact * mesh.diagonal))


def _with_area(mesh: MeshLike) -> Mesh:
    mesh = as_mesh(mesh)
    if not mesh.areas.any():
        raise MeshError(f"{mesh.name} has no area.")
    return mesh


def _joined(mesh: Mesh, pieces: FloatArray, face_ids: IntArray, areas: FloatArray) -> VisiblePart:
    """Join pieces (n, 3, 3) of faces (n,), with areas (n,), to one mesh; a face that is complete becomes one piece."""
    seen = np.bincount(face_ids, areas, minlength=len(mesh.faces))
    whole = np.flatnonzero((mesh.areas > 0) & (seen >= (1 - WHOLE) * mesh.areas)).astype(np.int32)
    rest = np.flatnonzero((areas > 0) & ~np.isin(face_ids, whole))
    corners = np.concatenate([mesh.corners[whole], pieces[rest]])
    if len(corners) == 0:
        raise MeshError(f"No part of {mesh.name} is visible. Is the eye within a closed shell?")
    vertices, faces = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    of_face = np.concatenate([whole, face_ids[rest]])
    order = np.argsort(of_face, kind="stable")
    source = None if mesh.source_face_ids is None else mesh.source_face_ids[of_face[order]]
    part = Mesh(vertices, faces.reshape(-1, 3)[order].astype(np.int32), name=mesh.name, source_face_ids=source)
    return VisiblePart(part, of_face[order])
