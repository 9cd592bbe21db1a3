"""Colours of PLY: of vertices, of faces, or a texture with coordinates at the vertices."""

import re
from pathlib import Path
from typing import Any

import numpy as np

from zbuf_occlude.arrays import FloatArray
from zbuf_occlude.geometry.colors import PLAIN, WHITE, Material
from zbuf_occlude.meshes.looks import Look, Read, Textures, in_unit_range, read_named
from zbuf_occlude.meshes.ply import Columns, Element, read_elements, read_header
from zbuf_occlude.meshes.polygons import Polygons
from zbuf_occlude.meshes.text import as_doubles

_CHANNELS = (("red", "green", "blue"), ("r", "g", "b"), ("diffuse_red", "diffuse_green", "diffuse_blue"))
_COORDINATES = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"), ("texture_s", "texture_t"))
_TEXTURE = re.compile(rb"^comment TextureFile (.*?)\s*$", re.MULTILINE)


def read_ply_look(data: bytes, polygons: Polygons, folder: Path, read: Read) -> Look:
    """Read the colours of a PLY file's polygons.

    Parameters
    ----------
    data, folder, read
        As in `obj_colors.read_obj_look`.
    polygons : Polygons
        As `read_ply` returned them.

    Returns
    -------
    Look
        A texture ("comment TextureFile") where vertices have coordinates in it, else the colours of vertices, else
        those of faces, else grey. Integers count to the largest of their type, or to 255 where none is above; floats to
        1, or to 255 (`in_unit_range`).

    Raises
    ------
    MeshError
        As `read_ply`.
    """
    elements = {element.name: element for element in read_header(data)[0]}
    columns = read_elements(data, {"vertex", "face"})
    vertices, faces = columns["vertex"], columns["face"]
    everything, textures = np.zeros(len(polygons.counts), np.int64), Textures()
    pair = next((names for names in _COORDINATES if all(name in vertices.scalars for name in names)), None)
    named = _TEXTURE.search(data[: data.find(b"end_header")])
    if named is not None and pair is not None:
        name = named[1].decode("utf-8", "replace")
        texture = textures.get(name, lambda: read_named(name, folder, read))
        if texture is not None:
            uv = np.stack([as_doubles(vertices.scalars[each]) for each in pair], axis=1)
            return Look((Material(WHITE.factor, texture),), everything, uv=uv[polygons.corners])
    lacking = tuple(textures.lacking)
    if (colors := _colors(elements["vertex"], vertices)) is not None:
        return Look((WHITE,), everything, colors[polygons.corners], lacking=lacking)
    if (colors := _colors(elements["face"], faces)) is not None:
        return Look((WHITE,), everything, np.repeat(colors, polygons.counts, axis=0), lacking=lacking)
    if _channels(elements["face"]) is not None:
        lacking = (*lacking, "colours of faces: they are not read beside lists of different lengths")
    return Look((PLAIN,), everything, lacking=lacking)


def _channels(element: Element) -> tuple[str, str, str] | None:
    names = {column.name for column in element.properties}
    return next((each for each in _CHANNELS if names.issuperset(each)), None)


def _colors(element: Element, columns: Columns) -> FloatArray | None:
    """Return the colours (rows, 3) of an element in [0, 1]; None where it has none."""
    channels = _channels(element)
    if channels is None or not all(name in columns.scalars for name in channels):
        return None
    found = np.stack([as_doubles(columns.scalars[name]) for name in channels], axis=1)
    kinds: list[np.dtype[Any]] = [column.dtype for column in element.properties if column.name in channels]
    if all(kind.kind in "iu" for kind in kinds):
        most = max(np.iinfo(kind).max for kind in kinds)
        if most > 255 and not (found > 255).any():
            most = 255  # bytes, whatever room they have
        found = found / most
    return in_unit_range(found)
