"""Wavefront OBJ: positions and faces; colours after the coordinates, materials (.mtl) and their textures."""

import posixpath
import re
from typing import NamedTuple

import numpy as np

from zbuf_occlude.arrays import BoolArray, FloatArray
from zbuf_occlude.errors import MeshError
from zbuf_occlude.geometry.colors import CLAMP, GREY, PLAIN, REPEAT, WHITE, Material
from zbuf_occlude.meshes.looks import PolygonColors, Textures, in_unit_range
from zbuf_occlude.meshes.mesh_files import MeshFiles
from zbuf_occlude.meshes.polygons import Polygons
from zbuf_occlude.meshes.text import Keywords, Lines, unix_lines

KEYWORDS = Keywords(of_numbers=(b"v", b"f"), with_slashes=b"f")
_VERTEX, _FACE = KEYWORDS.kind(b"v"), KEYWORDS.kind(b"f")

_COLOR_KEYWORDS = Keywords(of_numbers=(b"v", b"vt", b"f"), others=(b"usemtl",))
_V, _VT, _F, _USEMTL = map(_COLOR_KEYWORDS.kind, (b"v", b"vt", b"f", b"usemtl"))
_WITH_SLASHES = re.compile(rb"(?<=[ \t])[+-]?\d+/(-?\d*)(?:/-?\d*)?")
_NAMES = re.compile(rb"^[ \t]*(usemtl|mtllib)(?:[ \t]+([^\n]*))?$", re.MULTILINE)
_OPTIONS = {"-mm": 2, "-o": 3, "-s": 3, "-t": 3}  # of map_Kd: how many words follow at most; one after all others


def read_obj(data: bytes) -> Polygons:
    """Read an OBJ file, all its objects and groups together: a polygon for each `f` line, in the order of the file.

    Raises MeshError for a vertex without three numbers, and a face that refers to what is not there. Texture
    coordinates, normals, points, lines and curves are ignored. Indices count from 1; negative ones count back from the
    last vertex before their line. A file that was cut short between two lines cannot be told from a whole one.
    """
    lines = Lines(_joined(data) if b"\\" in data else data, comment=b"#", keywords=KEYWORDS)
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


def _joined(data: bytes) -> bytes:
    """Join the lines that a backslash at the end continues; rare, and so not the scanner's business."""
    return re.sub(rb"#[^\n]*", b"", unix_lines(data)).replace(b"\\\n", b" ")


class _Paint(NamedTuple):
    """A material of a .mtl file; its texture by name."""

    color: tuple[float, float, float] | None = None
    texture: str = ""
    folder: str = ""  # of the .mtl file, where its textures lie
    wrap: str = REPEAT
    scale: tuple[float, float] = (1.0, 1.0)
    offset: tuple[float, float] = (0.0, 0.0)
    transmittance: float = 0.0


def read_obj_look(data: bytes, polygons: Polygons, files: MeshFiles) -> PolygonColors:
    """Read the colours of an OBJ file's polygons, as `read_obj` returned them.

    A texture (map_Kd) is multiplied by its material's Kd, which counts as white where it is black or not there.
    Polygons without a texture have the colours of their vertices where the file has any, else Kd, else grey. Raises
    MeshError for texture coordinates that are no numbers, or refer to what is not there.
    """
    text = unix_lines(_joined(data) if b"\\" in data else data)
    lines = Lines(_WITH_SLASHES.sub(rb"\1.25", text), comment=b"#", keywords=_COLOR_KEYWORDS)
    is_face = np.asarray((lines.kinds == _F) & (lines.counts > 0))
    owners = np.repeat(np.arange(len(polygons.counts)), polygons.counts)
    uv = _uv_of_corners(lines, is_face)
    has_uv: BoolArray = np.asarray(np.isfinite(uv).all(axis=1))
    whole = np.bincount(owners[~has_uv], minlength=len(polygons.counts)) == 0

    words = [(kind, name.decode("utf-8", "replace").strip()) for kind, name in _NAMES.findall(text)]
    used = [name for kind, name in words if kind == b"usemtl"]
    lacking: dict[str, None] = {}
    paints: dict[str, _Paint] = {}
    for name in (name for kind, name in words if kind == b"mtllib"):
        try:
            paints |= _read_materials(name, files)
        except MeshError as error:
            lacking[f"materials {error}"] = None
    textures = Textures()
    materials, places = [PLAIN, WHITE], [_Paint(), _Paint()]
    numbers: dict[str, tuple[int, int]] = {"": (0, 0)}  # of each material: with its texture, and without
    for name in used:
        if name not in numbers:
            paint = paints.get(name, _Paint())
            numbers[name] = _add(name, paint, textures, files, materials, places)
    turn = np.cumsum(lines.kinds == _USEMTL)[is_face]
    pairs = np.array([numbers[name] for name in ["", *used]])
    ids = np.where(whole, *pairs[np.minimum(turn, len(used))].T)
    textured = np.array([material.texture is not None for material in materials])[ids]

    colors = None
    if (lines.counts[lines.kinds == _V] >= 6).any():
        colors = np.where(textured[owners, None], 1.0, _colors_of_vertices(lines)[polygons.corners])
        materials = [
            m if m.texture is not None else WHITE._replace(name=m.name, transmittance=m.transmittance)
            for m in materials
        ]
    scale, offset = (np.array([getattr(place, name) for place in places])[ids][owners] for name in ("scale", "offset"))
    placed = np.where(has_uv[:, None], uv, 0.0) * scale + offset
    return PolygonColors(tuple(materials), ids, colors, placed, lacking=(*lacking, *textures.lacking))


def _add(
    name: str, paint: _Paint, textures: Textures, files: MeshFiles, materials: list[Material], places: list[_Paint]
) -> tuple[int, int]:
    """Add a material's rows; return the one with its texture and the one for polygons without coordinates."""
    texture = None
    if paint.texture:
        texture = textures.get(posixpath.join(paint.folder, paint.texture), lambda: _read_texture(paint, files))
    base = PLAIN if paint.color is None else Material(paint.color)
    plain = len(materials)
    materials.append(base._replace(name=name, transmittance=paint.transmittance))
    places.append(_Paint())
    if texture is None:
        return plain, plain
    factor = paint.color if paint.color is not None and any(paint.color) else WHITE.factor
    materials.append(Material(factor, texture, (paint.wrap, paint.wrap), name, paint.transmittance))
    places.append(paint)
    return len(materials) - 1, plain


def _read_texture(paint: _Paint, files: MeshFiles) -> bytes:
    """Return the content of a texture: named from the .mtl file's folder, or else, as some do, from the mesh's."""
    for name in (paint.texture, posixpath.basename(paint.texture.replace("\\", "/"))):
        try:
            return files.read_named(posixpath.join(paint.folder, name))
        except MeshError:
            continue
    return files.read_named(paint.texture)


def _uv_of_corners(lines: Lines, is_face: BoolArray) -> FloatArray:
    """Return the texture coordinates of all corners (c, 2); NaN where a corner has none."""
    numbers = lines.numbers()
    is_vt = lines.kinds == _VT
    table = np.full((int(is_vt.sum()) + 1, 2), np.nan)
    table[1:, 0] = numbers[lines.first[is_vt]] if (lines.counts[is_vt] > 0).all() else np.nan
    has_v = lines.counts[is_vt] > 1
    table[1:, 1] = np.where(has_v, numbers[np.minimum(lines.first[is_vt] + 1, len(numbers) - 1)], 0.0)
    given = numbers[np.repeat(is_face, lines.counts)]
    ids = np.where(given == np.trunc(given), 0.0, np.trunc(given))  # what had a slash ends in .25
    before = np.repeat(np.cumsum(is_vt)[is_face], lines.counts[is_face])
    ids = np.where(ids < 0, ids + before + 1, ids)
    if ids.size and not (ids.min() >= 0 and ids.max() < len(table)):
        raise MeshError(
            f"faces must refer to the {len(table) - 1} vt lines of an OBJ file; one does not. Is it damaged?"
        )
    return np.asarray(table[ids.astype(np.int64)])


def _colors_of_vertices(lines: Lines) -> FloatArray:
    """Return the colours of all vertices (v, 3): numbers after the coordinates."""
    is_vertex = lines.kinds == _V
    has_color = lines.counts[is_vertex] >= 6
    first = lines.first[is_vertex][has_color, None] + np.arange(3, 6)
    colors = np.full((len(has_color), 3), GREY / 255)
    found = lines.numbers()[first]
    colors[has_color] = in_unit_range(found)
    return colors


def _read_materials(name: str, files: MeshFiles) -> dict[str, _Paint]:
    """Read the .mtl file, or files, that an mtllib line names."""
    try:
        texts = {name: files.read_named(name)}
    except MeshError:
        if len(name.split()) < 2:
            raise
        texts = {each: files.read_named(each) for each in name.split()}
    paints: dict[str, _Paint] = {}
    for each, text in texts.items():
        paints |= _materials_of(text.decode("utf-8-sig", "replace"), posixpath.dirname(each.replace("\\", "/")))
    return paints


def _materials_of(text: str, folder: str) -> dict[str, _Paint]:
    """Read the materials of one .mtl file, which lies in this folder, from the mesh's on."""
    paints: dict[str, _Paint] = {}
    current = None
    for line in text.splitlines():
        word, _, rest = line.replace("\t", " ").strip().partition(" ")
        rest = rest.strip()
        if word == "newmtl":
            current, paints[rest] = rest, _Paint(folder=folder)
        elif current is not None and word == "Kd":
            try:
                values = np.clip(np.nan_to_num([float(each) for each in rest.split()[:3]]), 0.0, 1.0).tolist()
            except ValueError:
                continue  # "spectral", "xyz"
            red, green, blue = (values * 3)[:3] if values else WHITE.factor
            paints[current] = paints[current]._replace(color=(red, green, blue))
        elif current is not None and word in ("d", "Tr") and _is_number(rest.split(" ")[-1]):
            stopped = min(max(float(rest.split(" ")[-1]), 0.0), 1.0)  # after -halo, if that is there
            paints[current] = paints[current]._replace(transmittance=1.0 - stopped if word == "d" else stopped)
        elif current is not None and word.lower() == "map_kd":
            paints[current] = _with_texture(paints[current], rest)
    return paints


def _with_texture(paint: _Paint, text: str) -> _Paint:
    """Read what follows map_Kd: options, then a file's name, which may hold blanks."""
    words = text.split(" ")
    while words and (words[0].startswith("-") or not words[0]):
        option = words.pop(0)
        values: list[str] = []
        while words and len(values) < _OPTIONS.get(option, int(bool(option))) and (not values or _is_number(words[0])):
            values.append(words.pop(0))
        if option == "-clamp" and values == ["on"]:
            paint = paint._replace(wrap=CLAMP)
        elif option in ("-s", "-o") and all(map(_is_number, values)):
            u, v = (*map(float, values), *(1.0, 1.0))[:2] if option == "-s" else (*map(float, values), 0.0, 0.0)[:2]
            paint = paint._replace(scale=(u, v)) if option == "-s" else paint._replace(offset=(u, v))
    return paint._replace(texture=" ".join(words))


def _is_number(word: str) -> bool:
    return re.fullmatch(r"[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?", word, re.IGNORECASE) is not None
