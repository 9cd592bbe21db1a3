"""Visible surface: the visible share of each face, visible vertices, the visible part as a mesh, coverage by views.

The visible part is cut exactly; the other functions query a method of the table about points.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from zbuf_occlude.base.arrays import BoolArray, FloatArray, IntArray, as_flag
from zbuf_occlude.base.errors import ArgumentError, MeshError, check_fraction, check_int
from zbuf_occlude.base.provenance import generator
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.meshes.conversion import MeshLike, as_mesh
from zbuf_occlude.meshes.sampling import Seed, SurfacePoints, error_of_share, points_in_triangles, sample_surface
from zbuf_occlude.visibility import find_method, prepare
from zbuf_occlude.visibility.interface import CONTACT, as_eyes

WHOLE = 1e-9
"""Share of a face's area up to which a missing part is ignored, and up to which a visible part is ignored."""


class VisibleFaces(NamedTuple):
    """Share of each face that each eye sees.

    fraction : (k, f) float64, share of the face's area
    standard_error : (k, f) float64, of `fraction`: the posterior standard deviation of the share, from a uniform prior;
        0 exactly if the face is cut
    n_points : (f,) int64, number of sampled points on the face
    proved : (k, f) bool, True if the face is cut and the eye sees all of it, `fraction` 1, or nothing, 0. False without
        `exactly`.
    """

    fraction: FloatArray
    standard_error: FloatArray
    n_points: IntArray
    proved: BoolArray


class VisiblePart(NamedTuple):
    """Part of a mesh that eyes see.

    mesh : Mesh, in the space of the whole mesh and with its winding; faces that are wholly seen are unchanged
    face_ids : (f,) int32, index into the whole mesh's ``faces`` of the face that each piece lies on
    """

    mesh: Mesh
    face_ids: IntArray


class Coverage(NamedTuple):
    """Share of a surface that a sequence of views sees.

    alone : (k,) float64, share of the area that each view sees
    together : (k,) float64, share that this view and the ones before it see together
    standard_error : (k,) float64, of `together`: above 0 even if no sampled point, or every one, is seen
    """

    alone: FloatArray
    together: FloatArray
    standard_error: FloatArray


def visible_faces(
    mesh: MeshLike,
    eyes: ArrayLike,
    *,
    points_per_face: int = 16,
    n_points: int = 100_000,
    seed: Seed = 0,
    exactly: bool = False,
    method: str = "exact",
    **options: Any,
) -> VisibleFaces:
    """Return the share of each face's area that each eye sees: estimated from random points on it, or cut exactly.

    Parameters
    ----------
    mesh : Mesh
        Or any other mesh (`as_mesh`).
    eyes : (3,) or (k, 3) float
        World space.
    points_per_face : int
        Minimum number of points on each face.
    n_points : int
        Number of additional points, distributed by area for the accuracy of large faces.
    seed : int
    exactly : bool
        Cut the faces along the edges of the shadows, as `visible_mesh`: exact except for rounding, and for other faces
        nearer than the contact tolerance. Shares within 1e-9 of 0 or 1 become 0 or 1. Faces that are edge-on or needles
        to within 1e-9 are still sampled, as are all faces for an eye in the plane and the box of a face.
    method : str
        Name in the table of methods. With an exact method the only error is that of sampling.
    **options
        Options of the method.

    Raises
    ------
    ArgumentError
        A number is out of range; `exactly` with a method that is not exact.
    OptionError, UnavailableError, GlError
        As `prepare` and `VisibilityQuery.visible`.

    Examples
    --------
    >>> mesh = zo.load_mesh("chair.off")
    >>> found = zo.visible_faces(mesh, zo.views.for_mesh(mesh, "paper100").eyes[:4])
    >>> found.fraction.shape == (4, len(mesh.faces))
    True
    """
    mesh, eyes = _with_area(mesh), as_eyes(eyes)
    check_int("points_per_face", points_per_face, 1)
    check_int("n_points", n_points, 0)
    counts = points_per_face + np.floor(n_points * mesh.areas / mesh.areas.sum()).astype(np.int64)
    every = np.arange(len(mesh.faces), dtype=np.int32)
    points = _on_faces(mesh, points_in_triangles(mesh.corners, counts, generator(seed)), np.repeat(every, counts))
    if as_flag(exactly, "exactly") and not find_method(method).exact:
        raise ArgumentError(f"exactly needs an exact method, exact or oracle; got {method}.")
    with prepare(mesh, method, **options) as query:
        seen = query.visible(points, eyes)
    n_seen = np.add.reduceat(seen, np.cumsum(counts) - counts, axis=1, dtype=np.int64)
    fraction, error = n_seen / counts, error_of_share(n_seen, counts)
    proved = np.zeros(fraction.shape, dtype=bool)
    if exactly:
        from zbuf_occlude.visibility.shadow_cuts import seen_shares  # late: it imports numba

        shares = seen_shares(mesh, eyes, float(options.get("contact", CONTACT)) * mesh.diagonal)
        cut, nothing, all_of_it = np.isfinite(shares), shares < WHOLE, shares > 1 - WHOLE
        proved = nothing | all_of_it
        fraction[cut], error[cut] = shares[cut], 0.0
        fraction[nothing], fraction[all_of_it] = 0.0, 1.0
    return VisibleFaces(fraction, error, counts, proved)


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


def coverage(
    mesh: MeshLike, eyes: ArrayLike, *, n_points: int = 20_000, seed: Seed = 0, method: str = "exact", **options: Any
) -> Coverage:
    """Estimate the share of the surface that the eyes (k, 3) see, each alone and together with those before it.

    Raises
    ------
    ArgumentError, OptionError, UnavailableError, GlError
        As `prepare` and `VisibilityQuery.visible`.

    Examples
    --------
    >>> mesh = zo.load_mesh("chair.off")
    >>> found = zo.coverage(mesh, zo.views.for_mesh(mesh, "paper100").eyes)
    >>> bool(found.together[-1] >= found.alone.max())
    True
    """
    mesh, eyes = as_mesh(mesh), as_eyes(eyes)
    points = sample_surface(mesh, n_points=n_points, seed=seed)
    with prepare(mesh, method, **options) as query:
        seen = query.visible(points, eyes)
    n_together = np.logical_or.accumulate(seen, axis=0).sum(axis=1)
    return Coverage(seen.mean(axis=1), n_together / n_points, error_of_share(n_together, n_points))


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


def _on_faces(mesh: Mesh, positions: FloatArray, face_ids: IntArray) -> SurfacePoints:
    """Return positions (n, 3) on faces (n,) as points."""
    return SurfacePoints.of_checked(positions, face_ids, mesh.face_normals[face_ids])


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
