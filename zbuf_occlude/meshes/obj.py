"""Wavefront OBJ, of which only positions (`v`) and faces (`f`) matter here."""

import re

import numpy as np

from zbuf_occlude.errors import MeshError
from zbuf_occlude.meshes.polygons import Polygons
from zbuf_occlude.meshes.text import Keywords, Lines, check_text, unix_lines

_KEYWORDS = Keywords(of_numbers=(b"v", b"f"), with_slashes=b"f")
_VERTEX, _FACE = _KEYWORDS.kind(b"v"), _KEYWORDS.kind(b"f")


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
    check_text(data)
    lines = Lines(joined(data) if b"\\" in data else data, comment=b"#", keywords=_KEYWORDS)
    is_vertex = lines.kinds == _VERTEX
    if (lines.counts[is_vertex] < 3).any():
        raise MeshError("every v line of an OBJ file must have three coordinates; one has fewer. Is it damaged?")
    vertices = lines.numbers(kind=_VERTEX).take(lines.first.compress(is_vertex)[:, None] + np.arange(3))
    is_face = (lines.kinds == _FACE) & (lines.counts > 0)
    corners = lines.numbers(kind=_FACE).compress(np.repeat(is_face, lines.counts))
    if (corners == 0).any():
        raise MeshError("indices in an OBJ file must count from 1, or back from -1; one is 0. Is it damaged?")
    counts = lines.counts[is_face]
    if (corners < 0).any():
        n_before = np.cumsum(is_vertex)[is_face]
        corners = np.where(corners < 0, corners + np.repeat(n_before, counts) + 1, corners)
    return Polygons(vertices, corners - 1, counts)


def joined(data: bytes) -> bytes:
    """Join the lines that a backslash at the end continues; rare, and so not the scanner's business."""
    return re.sub(rb"#[^\n]*", b"", unix_lines(data)).replace(b"\\\n", b" ")
