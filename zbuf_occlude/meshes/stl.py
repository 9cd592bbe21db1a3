"""Stereolithography (STL), binary and ASCII."""

import re
import struct

import numpy as np

from zbuf_occlude.errors import MeshError
from zbuf_occlude.meshes.polygons import Polygons
from zbuf_occlude.meshes.text import as_doubles, read_numbers, tidy

_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_HEADER = 84  # 80 bytes of anything, then the number of facets
_SOLID_LINE = re.compile(rb"^[ \t]*(end[ \t]*)?solid\b[^\n]*", re.MULTILINE)
_VERTEX = re.compile(rb"\bvertex\s+(\S+\s+\S+\s+\S+)")


def read_stl(data: bytes) -> Polygons:
    """Read an STL file; every facet has three vertices of its own.

    Parameters
    ----------
    data : bytes
        The whole file.

    Returns
    -------
    Polygons
        Triangles, in the order of the file.

    Raises
    ------
    MeshError
        Cut short or damaged.

    Notes
    -----
    A binary file may begin with "solid" too: what decides is whether the declared number of facets gives the file's
    size. Bytes after the last facet are ignored; normals and attributes are not read.
    """
    n_declared = struct.unpack_from("<I", data, _HEADER - 4)[0] if len(data) >= _HEADER else None
    fits_exactly = n_declared is not None and len(data) == _HEADER + n_declared * _FACET.itemsize
    if not fits_exactly and data[:512].lstrip()[:5].lower() == b"solid" and b"\0" not in data:
        return _read_ascii(data)
    if n_declared is None:
        raise MeshError(f"a binary STL file must have {_HEADER} bytes at least; it has {len(data)}. Is it cut short?")
    n_held = (len(data) - _HEADER) // _FACET.itemsize
    if n_declared > n_held:
        raise MeshError(
            f"a binary STL file must hold the {n_declared:,} facets that it declares; it has room for {n_held:,}. "
            "Is it damaged or cut short?"
        )
    corners = np.frombuffer(data, dtype=_FACET, count=n_declared, offset=_HEADER)["corners"]
    return _own_corners(corners)


def _read_ascii(data: bytes) -> Polygons:
    text = tidy(data, comment=None).lower()
    solids = list(_SOLID_LINE.finditer(text))
    # without the lines that name solids: a name may be anything, "vertex 1 2 3" too
    begins, ends = [0, *(solid.end() for solid in solids)], [*(solid.start() for solid in solids), len(text)]
    body = b"".join(text[begin:end] for begin, end in zip(begins, ends, strict=True))
    n_ended = sum(solid[1] is not None for solid in solids)
    n_whole = body.count(b"endfacet")
    n_facets = body.count(b"facet") - n_whole
    vertices = _VERTEX.findall(body)
    if 2 * n_ended != len(solids) or n_facets != n_whole:
        raise MeshError("every solid and facet of an ASCII STL file must end; one does not. Is it cut short?")
    if len(vertices) != 3 * n_facets:
        raise MeshError(
            f"the {n_facets:,} facets of an ASCII STL file must have three vertices each; there are "
            f"{len(vertices):,} in all. Is it damaged?"
        )
    return _own_corners(read_numbers(b"\n".join(vertices)))


def _own_corners(positions: np.ndarray[tuple[int, ...], np.dtype[np.floating]]) -> Polygons:
    vertices = as_doubles(positions).reshape(-1, 3)
    return Polygons.from_triangles(vertices, np.arange(len(vertices)))
