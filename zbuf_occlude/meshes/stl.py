"""Stereolithography (STL), binary and ASCII."""

import re
import struct
from contextlib import suppress

import numpy as np

from zbuf_occlude.base.arrays import FloatArray
from zbuf_occlude.base.errors import MeshError
from zbuf_occlude.meshes.polygons import Polygons
from zbuf_occlude.meshes.text import Keywords, Lines, as_doubles, unix_lines

_HEADER = 84  # bytes: 80 of anything and the number of facets
_FACET = np.dtype([("normal", "<f4", 3), ("vertices", "<f4", (3, 3)), ("attributes", "<u2")])
KEYWORDS = Keywords((b"vertex",), (b"facet", b"endfacet", b"solid", b"endsolid"), lower_case=True)
_ONE_RECORD_PER_LINE = re.compile(rb"(?:\x04(?:\x02\x01{3}\x03)*\x05)+")  # numbers of KEYWORDS
_SOLID_LINE = re.compile(rb"^[ \t]*(end[ \t]*)?solid\b[^\n]*", re.MULTILINE)
_VERTEX = re.compile(rb"\bvertex((?:\s+\S+){3})\s+(?=vertex|outer|(?:end)?(?:loop|facet|solid))")
_NORMAL = re.compile(rb"\bnormal(\s+\S+){3}")


def read_stl(data: bytes) -> Polygons:
    """Return the triangles of an STL file, each with three vertices of its own.

    A file is binary if its size follows from the declared number of facets, even if it begins with "solid". Bytes after
    the last facet are ignored; normals and attributes are not read.

    Raises
    ------
    MeshError
        The file is cut short or damaged.
    """
    n_declared = struct.unpack_from("<I", data, _HEADER - 4)[0] if len(data) >= _HEADER else None
    fits_exactly = n_declared is not None and len(data) == _HEADER + n_declared * _FACET.itemsize
    is_text = not fits_exactly and data[:512].lstrip()[:5].lower() == b"solid" and b"\0" not in data
    vertices = _read_text(data) if is_text else _read_binary(data, n_declared)
    return Polygons.from_triangles(vertices, np.arange(len(vertices)))


def _read_binary(data: bytes, n_declared: int | None) -> FloatArray:
    if n_declared is None:
        raise MeshError(f"a binary STL file must have at least {_HEADER} bytes; it has {len(data)}. Is it cut short?")
    n_held = (len(data) - _HEADER) // _FACET.itemsize
    if n_declared > n_held:
        raise MeshError(
            f"a binary STL file must contain the {n_declared:,} facets that it declares; it has room for {n_held:,}. "
            "Is it damaged or cut short?"
        )
    return as_doubles(np.frombuffer(data, _FACET, n_declared, _HEADER)["vertices"].reshape(-1, 3))


def _read_text(data: bytes) -> FloatArray:
    """Return the vertices of an ASCII file; fast where each record is a line."""
    lines = Lines(data, keywords=KEYWORDS)
    counts = lines.counts[lines.kinds == KEYWORDS.kind(b"vertex")]
    if _ONE_RECORD_PER_LINE.fullmatch(lines.kinds.tobytes()) and (counts == 3).all():
        with suppress(MeshError):  # the code below reports a word that is no number
            return lines.numbers().reshape(-1, 3)
    # a solid may have any name, such as "vertex 1 2 3"
    text = _SOLID_LINE.sub(lambda line: b"endsolid" if line[1] else b"solid", unix_lines(data).lower())
    text = _NORMAL.sub(b"", text)
    n_facets, n_vertices = text.count(b"endfacet"), text.count(b"vertex")
    if text.count(b"solid") != 2 * text.count(b"endsolid") or text.count(b"facet") != 2 * n_facets:
        raise MeshError("every solid and facet of an ASCII STL file must end; one does not. Is it cut short?")
    if any(facet.count(b"vertex") != 3 for facet in text.split(b"endfacet")[:-1]):
        raise MeshError(
            f"the {n_facets:,} facets of an ASCII STL file must have three vertices each; there are "
            f"{n_vertices:,} in all. Is it damaged?"
        )
    vertices = _VERTEX.findall(text)
    if len(vertices) != n_vertices:
        raise MeshError("every vertex of an ASCII STL file must have three coordinates; one does not. Is it damaged?")
    return Lines(b"\n".join(vertices)).numbers().reshape(-1, 3)
