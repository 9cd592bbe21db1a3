"""load_mesh: a file of any of the formats read here becomes a clean Mesh, or one clear MeshError."""

import os
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np

from zbuf_occlude.errors import ArgumentError, MeshError, check_word
from zbuf_occlude.geometry.colors import SurfaceColors
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.meshes.gltf import read_gltf_and_look
from zbuf_occlude.meshes.looks import Look, Read
from zbuf_occlude.meshes.mesh_files import MeshFiles
from zbuf_occlude.meshes.obj import read_obj
from zbuf_occlude.meshes.obj_colors import read_obj_look
from zbuf_occlude.meshes.off import read_off
from zbuf_occlude.meshes.ply import read_ply
from zbuf_occlude.meshes.ply_colors import read_ply_look
from zbuf_occlude.meshes.polygons import Polygons
from zbuf_occlude.meshes.stl import read_stl
from zbuf_occlude.provenance import Origin

_READERS: dict[str, Callable[[bytes], Polygons]] = {
    ".off": read_off,
    ".obj": read_obj,
    ".ply": read_ply,
    ".stl": read_stl,
}
_LOOKS: dict[str, Callable[[bytes, Polygons, Path, Read], Look]] = {".obj": read_obj_look, ".ply": read_ply_look}
_GLTF = (".glb", ".gltf")
SUFFIXES = (*_READERS, *_GLTF)
"""Endings of the files that `load_mesh` reads, in lower case."""

UP = ("z", "y")
_BOM = b"\xef\xbb\xbf"
_BEGINNINGS = {
    ".glb": re.compile(rb"glTF"),
    ".ply": re.compile(rb"ply\s"),
    ".off": re.compile(rb"\s*[A-Z4n]{0,5}OFF[\s\d]"),
    ".stl": re.compile(rb"\s*solid\s.*\sfacet\s", re.DOTALL),
    ".gltf": re.compile(rb"\s*\{"),
    ".obj": re.compile(rb"(.*\n)?\s*v\s+[-\d.]+\s+[-\d.]+\s", re.DOTALL),
}


def load_mesh(
    path: str | os.PathLike[str], *, up: str | None = None, name: str | None = None, colors: bool = False
) -> Mesh:
    """Load a mesh from a file: OFF, OBJ, PLY, STL, or glTF (.gltf, .glb), by the file's ending.

    Parameters
    ----------
    path : path-like
        Of a file, or of one in a ZIP archive: ``ModelNet40.zip/chair/train/chair_0001.off``.
    up : {"z", "y"}, optional
        Which way is up in the file. Here z is: a file with y up is turned, (x, y, z) to (x, -z, y).
        By default "y" for glTF, whose standard says so, and "z" for all others, which leaves them as they are.
    name : str, optional
        The mesh's name; by default the file's without its ending.
    colors : bool
        Read base colours too (`Mesh.colors`): of OBJ (.mtl and textures, numbers after the coordinates), PLY and glTF.
        Other formats, and surfaces without a colour, are grey.

    Returns
    -------
    Mesh
        Cleaned (`Mesh.cleaned`), in the file's own units. `source_face_ids` are indices of the file's faces: its
        polygons, before they were cut into triangles. `dropped` counts, besides what `Mesh.cleaned` dropped,
        "too_few_corners" (faces of one or two corners) and "unusable_vertices" (NaN or infinite ones that no face
        uses; all other vertices stay, in their order, used or not).

    Raises
    ------
    MeshError
        No such file, not readable, of an unknown ending, damaged, cut short, without faces, with faces that refer to
        vertices that are missing, NaN or infinite, or without any face of some area. The message names the file.
    OptionError
        `up` is neither "z" nor "y".
    ArgumentError
        `path` is no path.

    Examples
    --------
    >>> zo.load_mesh("chair.off")
    Mesh('chair', 24 vertices, 36 faces)

    Notes
    -----
    All objects, groups and nodes of a file become one mesh. Normals of vertices are not read. Whatever
    a header says, memory stays within some thirty times the file's size (a glTF scene may beyond that repeat its
    meshes, to a million triangles and a gigabyte); files of 100,000 faces take 0.1 to 1 s,
    compressed glTF longer.
    """
    if not isinstance(path, (str, os.PathLike)):
        raise ArgumentError(f"path must be a path; got {type(path).__name__}. A mesh of trimesh: Mesh.from_trimesh.")
    path = Path(path)
    if up is not None:
        check_word("up", up, UP)
    suffix = path.suffix.lower()
    try:
        if suffix not in SUFFIXES:
            raise MeshError(
                f"a mesh file must end in one of {', '.join(SUFFIXES)}; this ends in {suffix!r}. Convert it."
            )
        files = MeshFiles(path)
        data = files.read(path)
        if suffix != ".stl" or data.startswith(_BOM + b"solid"):  # the head of a binary STL is anybody's
            data = data.removeprefix(_BOM)
        try:
            look: Look | None = None
            if suffix in _GLTF:
                polygons, look = read_gltf_and_look(data, path.parent, files.read, colors=colors)
            else:
                polygons = _READERS[suffix](data)
                if colors and suffix in _LOOKS:
                    look = _LOOKS[suffix](data, polygons, path.parent, files.read)
            mesh_name = path.stem if name is None else name
            return _finished(polygons, look, mesh_name, up or default_up(path), files.origin, colors)
        except MeshError as error:
            raise MeshError(f"{error}{_hint(data, suffix)}") from None
    except MeshError as error:
        raise MeshError(f"{path}: {error}") from None


def default_up(path: Path) -> str:
    """Return the axis that points up in a file of this ending: "y" in glTF, as its standard says, else "z"."""
    return "y" if path.suffix.lower() in _GLTF else "z"


def _finished(polygons: Polygons, look: Look | None, name: str, up: str, origin: Origin, colors: bool) -> Mesh:
    """Cut into triangles, turn z up, clean."""
    if not (polygons.counts >= 3).any():
        raise MeshError(
            f"a mesh must have faces; the file has {len(polygons.vertices):,} vertices and no face of three corners. "
            "Is it a point cloud, a wireframe or empty?"
        )
    n_vertices = len(polygons.vertices)
    polygons = polygons.without_unusable_vertices()
    triangles, polygon_ids = polygons.triangles()
    dropped = {
        "too_few_corners": int((polygons.counts < 3).sum()),
        "unusable_vertices": n_vertices - len(polygons.vertices),
    }
    vertices = polygons.vertices
    if up == "y":
        vertices = np.stack([vertices[:, 0], 0.0 - vertices[:, 2], vertices[:, 1]], axis=1)
    ids = polygon_ids.astype(np.int32)
    found = None
    if colors:
        found = SurfaceColors.plain(len(ids)) if look is None else look.on(polygons.triangle_corners(), polygon_ids)
    dropped = {reason: n for reason, n in dropped.items() if n}
    mesh = Mesh.of_checked(vertices, triangles.astype(np.int32), name, ids, dropped, origin, found)  # by `Polygons`
    with np.errstate(under="ignore"):  # faces too small for their areas to be numbers are faces of no area
        return mesh.cleaned()


def _hint(data: bytes, suffix: str) -> str:
    """Say so when a file that could not be read looks like one of another format."""
    start = data[:4096]
    if start.startswith(b"version https://git-lfs"):
        return " It is a pointer of Git LFS, not the file itself: run `git lfs pull` where it was cloned."
    if re.match(rb"\s*<(!doctype\s+)?html", start, re.IGNORECASE):
        return " It is a web page: download the file again."
    for other, beginning in _BEGINNINGS.items():
        if beginning.match(start):
            return "" if other == suffix else f" Its content looks like {other}: rename it?"
    return ""
