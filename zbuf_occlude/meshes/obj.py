"""Wavefront OBJ, of which only positions (`v`) and faces (`f`) matter here."""

import re

import numpy as np

from zbuf_occlude.arrays import FloatArray
from zbuf_occlude.errors import MeshError
from zbuf_occlude.meshes.polygons import Polygons
from zbuf_occlude.meshes.text import Lines, tidy

_VERTEX = re.compile(rb"^[ \t]*v[ \t]+([^\n]*)", re.MULTILINE)
_FACE = re.compile(rb"^[ \t]*f[ \t]+([^\n]*)", re.MULTILINE)
_TEXTURE_AND_NORMAL = re.compile(rb"(?<=\d)/\S*")  # of a corner 7/1/3


def read_obj(data: bytes) -> Polygons:
    """Read an OBJ file: all its objects and groups together.

    Parameters
    ----------
    data : bytes
        The whole file.

    Returns
    -------
    Polygons
        One for each `f` line, in the order of the file.

    Raises
    ------
    MeshError
        A vertex without three numbers, a face that refers to what is not there.

    Notes
    -----
    Materials, texture coordinates, normals, colours after the coordinates, points, lines and curves are ignored.
    Indices count from 1; negative ones count back from the last vertex before their line. A file that was cut short
    between two lines cannot be told from a whole one.
    """
    text = tidy(data).replace(b"\\\n", b" ")
    vertex_lines = _VERTEX.findall(text)
    lines = Lines(b"\n".join(vertex_lines))
    if len(lines) != len(vertex_lines) or (lines.counts < 3).any():
        raise MeshError("every v line of an OBJ file must have three coordinates; one has fewer. Is it damaged?")
    vertices = lines.numbers()[lines.first[:, None] + np.arange(3)]
    faces = Lines(_TEXTURE_AND_NORMAL.sub(b"", b"\n".join(_FACE.findall(text))))
    corners = faces.numbers()
    if (corners == 0).any():
        raise MeshError("indices in an OBJ file must count from 1, or back from -1; one is 0. Is it damaged?")
    if (corners < 0).any():
        corners = np.where(corners < 0, corners + np.repeat(_vertices_before_faces(text), faces.counts) + 1, corners)
    return Polygons(vertices, corners - 1, faces.counts)


def _vertices_before_faces(text: bytes) -> FloatArray:
    """For each `f` line that holds anything, how many `v` lines stand before it, (p,)."""
    vertex_starts = [match.start() for match in _VERTEX.finditer(text)]
    face_starts = [match.start() for match in _FACE.finditer(text) if match[1].strip()]
    return np.searchsorted(vertex_starts, face_starts).astype(np.float64)
