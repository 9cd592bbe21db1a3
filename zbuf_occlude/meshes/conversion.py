"""Conversion of every supported representation of a mesh to a Mesh."""

import os
from dataclasses import replace
from typing import Any

import numpy as np

from zbuf_occlude.base.errors import ArgumentError
from zbuf_occlude.geometry.colors import WHITE, SurfaceColors
from zbuf_occlude.geometry.mesh import Mesh, check_frame, convert_frame
from zbuf_occlude.meshes.load import load_mesh

MeshLike = Any
"""Any object that `as_mesh` accepts."""


def as_mesh(
    mesh: MeshLike, *, up: str | None = None, unit: str | None = None, colors: bool = False, name: str = "mesh"
) -> Mesh:
    """Return a Mesh of any supported representation.

    Parameters
    ----------
    mesh : Mesh, path, trimesh.Trimesh, open3d TriangleMesh, or (vertices, faces)
        Also any object with `vertices` and `faces` or `triangles`. A file is loaded and cleaned (`load_mesh`); arrays
        are not cleaned, so that face ids index the given faces.
    up, unit : str, optional
        Up axis, "z" or "y", and unit, "mm", "cm", "m" or "in", as in `load_mesh`.
    colors : bool
        Read base colours too, if there are any.
    name : str
        Name of the argument in messages.

    Raises
    ------
    ArgumentError
        Another object, or faces that are not triangles.
    MeshError, OptionError
        As `load_mesh`.
    """
    if isinstance(mesh, str | os.PathLike):
        return load_mesh(mesh, up=up, unit=unit, colors=colors)
    check_frame(up, unit)
    found = _of_object(mesh, colors, name)
    if up in (None, "z") and unit in (None, "m"):
        return found
    return replace(found, vertices=convert_frame(found.vertices, up, unit))


def _of_object(mesh: MeshLike, colors: bool, name: str) -> Mesh:
    """Return a Mesh of an object that has the attributes of a mesh."""
    if isinstance(mesh, Mesh):
        return mesh
    if isinstance(mesh, tuple | list) and len(mesh) == 2:
        return Mesh(*mesh)
    if hasattr(mesh, "to_legacy"):  # Open3D's tensor-based mesh
        mesh = mesh.to_legacy()
    if hasattr(mesh, "vertices") and hasattr(mesh, "faces"):
        return Mesh.from_trimesh(mesh, colors=colors)
    if hasattr(mesh, "vertices") and hasattr(mesh, "triangles"):
        faces, found = np.asarray(mesh.triangles), None
        if colors and len(per_vertex := np.asarray(getattr(mesh, "vertex_colors", ()))):
            found = SurfaceColors((WHITE,), np.zeros(len(faces), np.int32), per_vertex[faces])
        return Mesh(np.asarray(mesh.vertices), faces, colors=found)
    hint = " Make one mesh of a scene: scene.to_mesh()." if hasattr(mesh, "to_mesh") else ""
    raise ArgumentError(
        f"{name} must be a path, a Mesh, (vertices, faces), or have vertices and faces or triangles, as those of "
        f"trimesh and Open3D; got {type(mesh).__name__}.{hint}"
    )
