"""Loading of meshes from files of any format, and of point clouds."""

import logging
import os
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np

from zbuf_occlude.base.arrays import LARGEST, FloatArray, as_flag
from zbuf_occlude.base.documents import as_path
from zbuf_occlude.base.errors import ArgumentError, MeshError, describe, escape_control, shown
from zbuf_occlude.base.point_files import positions_of
from zbuf_occlude.base.provenance import MeshSource
from zbuf_occlude.geometry.colors import SurfaceColors
from zbuf_occlude.geometry.mesh import Mesh, check_frame, convert_frame
from zbuf_occlude.meshes.gltf import read_gltf
from zbuf_occlude.meshes.mesh_files import MeshFiles, content_of
from zbuf_occlude.meshes.obj import read_obj, read_obj_colors
from zbuf_occlude.meshes.off import read_off
from zbuf_occlude.meshes.ply import foreign_lines, read_ply, read_ply_colors, read_ply_points
from zbuf_occlude.meshes.polygon_colors import PolygonColors
from zbuf_occlude.meshes.polygons import Polygons
from zbuf_occlude.meshes.stl import read_stl

_LOG = logging.getLogger(__name__)

READERS: dict[str, Callable[[bytes], Polygons]] = {
    ".off": read_off,
    ".obj": read_obj,
    ".ply": read_ply,
    ".stl": read_stl,
}
_COLOR_READERS: dict[str, Callable[[bytes, Polygons, MeshFiles], PolygonColors]] = {
    ".obj": read_obj_colors,
    ".ply": read_ply_colors,
}
_GLTF = (".glb", ".gltf")
SUFFIXES = (*READERS, *_GLTF)
"""File name suffixes that `load_mesh` reads, in lower case."""

_CLOUD_SUFFIXES = (".ply", ".npy", ".csv")
"""File name suffixes that `load_cloud` reads, in lower case."""

_BYTE_ORDER_MARK = b"\xef\xbb\xbf"
_BEGINNINGS = {
    ".glb": re.compile(rb"glTF"),
    ".ply": re.compile(rb"ply\s"),
    ".off": re.compile(rb"\s*[A-Z4n]{0,5}OFF[\s\d]"),
    ".stl": re.compile(rb"\s*solid\s.*\sfacet\s", re.DOTALL),
    ".gltf": re.compile(rb"\s*\{"),
    ".obj": re.compile(rb"(.*\n)?\s*v\s+[-\d.]+\s+[-\d.]+\s", re.DOTALL),
}


def load_mesh(
    path: str | os.PathLike[str],
    *,
    up: str | None = None,
    unit: str | None = None,
    name: str | None = None,
    colors: bool = False,
) -> Mesh:
    """Load a mesh from a file: OFF, OBJ, PLY, STL, or glTF (.gltf, .glb), by the file's suffix.

    Parameters
    ----------
    path : path-like
        A file, or a member of a ZIP archive: ``ModelNet40.zip/chair/train/chair_0001.off``.
    up : {"z", "y"}, optional
        Axis that points up in the file. A file with y up is turned: (x, y, z) to (x, -z, y). By default "y" for glTF,
        as its standard says, and "z" for all others, which are not turned.
    unit : {"mm", "cm", "m", "in"}, optional
        Unit of the file; the mesh is then in metres. By default coordinates stay as they are.
    name : str, optional
        Name of the mesh. Default: the file's name without its suffix.
    colors : bool
        Read base colours too (`Mesh.colors`), from OBJ (.mtl, textures, numbers after the coordinates), PLY and glTF.
        Other formats, and surfaces without a colour, are grey.

    Returns
    -------
    Mesh
        Cleaned (`Mesh.cleaned`), z up, in metres if `unit` is given and else in the file's unit. `source_face_ids` are
        indices of the file's polygons, before triangulation. `dropped` counts what `Mesh.cleaned` dropped,
        "too_few_corners" (faces of one or two corners) and "unusable_vertices" (NaN or infinite, used by no face). All
        other vertices stay, in their order.

    Raises
    ------
    MeshError
        The file is missing, unreadable, damaged or cut short, or has an unknown suffix. Or it has no faces, no face of
        non-zero area, or faces with vertices that are missing, NaN or infinite. The message names the file.
    OptionError
        An unknown `up` or `unit`.
    ArgumentError
        `path` is no path.

    Examples
    --------
    >>> zo.load_mesh("chair.off")
    Mesh('chair', 24 vertices, 36 faces)

    Notes
    -----
    All objects, groups and nodes of a file become one mesh. Vertex normals are not read. Memory stays within some 30
    times the file's size, whatever a header declares; a glTF scene may repeat its meshes to a million triangles and a
    gigabyte. Files of 100,000 faces take 0.1 to 1 s, compressed glTF longer.
    """
    path = as_path(path, "path", "Mesh.from_trimesh takes a mesh of trimesh.")
    check_frame(up, unit)
    if not isinstance(name, str | None):
        raise ArgumentError(f"name must be a word; got {shown(name)}.")
    colors = as_flag(colors, "colors")
    suffix = path.suffix.lower()
    try:
        if suffix not in SUFFIXES:
            raise MeshError(
                f"a mesh file must end in one of {', '.join(SUFFIXES)}; this ends in {suffix!r}. Convert it."
            )
        files = MeshFiles(path)
        data = files.read(path)
        if suffix != ".stl" or data.startswith(_BYTE_ORDER_MARK + b"solid"):  # a binary STL begins with any 80 bytes
            data = data.removeprefix(_BYTE_ORDER_MARK)
        try:
            polygon_colors: PolygonColors | None = None
            if suffix in _GLTF:
                polygons, polygon_colors = read_gltf(data, files, colors=colors)
            else:
                polygons = READERS[suffix](data)
                warn_of_foreign_lines(path, data)
                if colors and suffix in _COLOR_READERS:
                    polygon_colors = _COLOR_READERS[suffix](data, polygons, files)
            mesh_name = path.stem if name is None else name
            frame = up or default_up(path), unit
            return _mesh_of(polygons, polygon_colors, mesh_name, frame, files.origin, colors)
        except MeshError as error:
            raise MeshError(f"{error}{_hint(data, suffix)}") from None
    except MeshError as error:
        raise MeshError(f"{escape_control(str(path))}: {error}") from None


def load_cloud(path: str | os.PathLike[str]) -> FloatArray | None:
    """Load a point cloud: PLY without faces, .npy or .csv with x, y, z first, such as `Cloud.save` writes.

    Returns
    -------
    (n, 3) float64 or None
        Points in the file's coordinates; None for a file of another kind, such as a mesh.

    Raises
    ------
    MeshError
        The file is missing or damaged, or a point is not finite. The message names the file.
    """
    path = as_path(path, "path")
    suffix = path.suffix.lower()
    if suffix not in _CLOUD_SUFFIXES:
        return None
    try:
        content = content_of(path) if suffix == ".ply" else b""
        positions = read_ply_points(content) if suffix == ".ply" else _table(path, suffix)
        if positions is None:
            return None
        warn_of_foreign_lines(path, content)
        if not len(positions) or not (np.abs(positions) <= LARGEST).all():  # False for NaN
            raise MeshError(
                f"a point cloud must have points, with coordinates that are finite and below {LARGEST:g}; this one "
                "does not. Clean it."
            )
    except MeshError as error:
        raise MeshError(f"{escape_control(str(path))}: {error}") from None
    return positions


def default_up(path: Path) -> str:
    """Return the axis that points up in files of a suffix: "y" for glTF, as its standard says, else "z"."""
    return "y" if path.suffix.lower() in _GLTF else "z"


def has_metres(path: Path) -> bool:
    """Return whether lengths in files of a suffix are metres: true for glTF, as its standard says."""
    return path.suffix.lower() in _GLTF


def _mesh_of(
    polygons: Polygons,
    polygon_colors: PolygonColors | None,
    name: str,
    frame: tuple[str, str | None],
    origin: MeshSource,
    colors: bool,
) -> Mesh:
    """Return the cleaned mesh of polygons: triangulated, z up, and in metres if the `frame` (axis, unit) has a unit."""
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
    vertices = convert_frame(polygons.vertices, *frame)
    ids = polygon_ids.astype(np.int32)
    found = None
    if colors:
        found = SurfaceColors.plain(len(ids))
        if polygon_colors is not None:
            found = polygon_colors.of_triangles(polygons.triangle_corners(), polygon_ids)
    dropped = {reason: n for reason, n in dropped.items() if n}
    mesh = Mesh.of_checked(vertices, triangles.astype(np.int32), name, ids, dropped, origin, found)  # by `Polygons`
    with np.errstate(under="ignore"):  # areas that underflow are 0
        return mesh.cleaned()


def warn_of_foreign_lines(path: Path, data: bytes) -> None:
    """Log a warning about skipped lines in a PLY file's header."""
    if path.suffix.lower() == ".ply" and (lines := foreign_lines(data)):
        shown = escape_control(lines[0][:60])
        _LOG.warning("%s: %d lines of its header are not PLY and are skipped: %r", path, len(lines), shown)


def _hint(data: bytes, suffix: str) -> str:
    """Return a sentence on the likely cause why a file cannot be read, such as another format; else ""."""
    start = data[:4096]
    if start.startswith(b"version https://git-lfs"):
        return " It is a Git LFS pointer, not the file itself: run `git lfs pull` in the clone."
    if re.match(rb"\s*<(!doctype\s+)?html", start, re.IGNORECASE):
        return " It is a web page: download the file again."
    for other, beginning in _BEGINNINGS.items():
        if beginning.match(start):
            return "" if other == suffix else f" Its content looks like {other}: rename it?"
    return ""


def _table(path: Path, suffix: str) -> FloatArray:
    """Return x, y, z of each row of a .npy or .csv file; a first line of words is a header."""
    try:
        if suffix == ".npy":
            table = np.load(path, allow_pickle=False)
        else:
            with path.open(encoding="utf-8", errors="replace") as file:
                has_header = any(letter.isalpha() and letter not in "einfaE" for letter in file.readline())
            table = np.loadtxt(path, delimiter=",", skiprows=int(has_header), ndmin=2)
        return positions_of(table)
    except (OSError, ValueError) as error:
        raise MeshError(f"cannot read the points: {describe(error)}. Check it.") from None
