"""Wavefront OBJ: vertices and faces; vertex colours, materials (.mtl) and their textures."""

import posixpath
import re
from typing import NamedTuple

import numpy as np

from zbuf_occlude.base.arrays import BoolArray, FloatArray
from zbuf_occlude.base.errors import MeshError
from zbuf_occlude.geometry.colors import CLAMP, GREY, PLAIN, REPEAT, WHITE, Material
from zbuf_occlude.meshes.mesh_files import MeshFiles
from zbuf_occlude.meshes.polygon_colors import PolygonColors, Textures, in_unit_range
from zbuf_occlude.meshes.polygons import Polygons
from zbuf_occlude.meshes.text import Keywords, Lines, unix_lines

KEYWORDS = Keywords(of_numbers=(b"v", b"f"), with_slashes=b"f")
_VERTEX, _FACE = KEYWORDS.kind(b"v"), KEYWORDS.kind(b"f")

_COLOR_KEYWORDS = Keywords(of_numbers=(b"v", b"vt", b"f"), others=(b"usemtl",))
_V, _VT, _F, _USEMTL = map(_COLOR_KEYWORDS.kind, (b"v", b"vt", b"f", b"usemtl"))
_WITH_SLASHES = re.compile(rb"(?<=[ \t])[+-]?\d+/(-?\d*)(?:/-?\d*)?")
_NAMES = re.compile(rb"^[ \t]*(usemtl|mtllib)(?:[ \t]+([^\n]*))?$", re.MULTILINE)
_OPTIONS = {"-mm": 2, "-o": 3, "-s": 3, "-t": 3}  # maximum number of words after an option of map_Kd; 1 for others


def read_obj(data: bytes) -> Polygons:
    """Return the polygons of an OBJ file, one for each `f` line, of all objects and groups.

    Texture coordinates, normals, points, lines and curves are ignored. Indices count from 1; negative ones count back
    from the last vertex before their line. A file cut short between two lines looks complete.

    Raises
    ------
    MeshError
        A vertex without three numbers; a face that refers to no vertex.
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
    """Return the text with each line that ends in a backslash joined to the next; too rare for the scanner."""
    return re.sub(rb"#[^\n]*", b"", unix_lines(data)).replace(b"\\\n", b" ")


class _MtlMaterial(NamedTuple):
    """A material of a .mtl file."""

    color: tuple[float, float, float] | None = None
    texture: str = ""  # file name
    folder: str = ""  # of the .mtl file and its textures
    wrap: str = REPEAT
    scale: tuple[float, float] = (1.0, 1.0)
    offset: tuple[float, float] = (0.0, 0.0)
    transmittance: float = 0.0


def read_obj_colors(data: bytes, polygons: Polygons, files: MeshFiles) -> PolygonColors:
    """Return the colours of an OBJ file's polygons, as `read_obj` returned them.

    A texture (map_Kd) is multiplied by its material's Kd, or by white where Kd is black or missing. Polygons without a
    texture have the colours of their vertices where the file has any, else Kd, else grey.

    Raises
    ------
    MeshError
        A texture coordinate that is no number; a face that refers to no texture coordinate.
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
    warnings: dict[str, None] = {}
    definitions: dict[str, _MtlMaterial] = {}
    for name in (name for kind, name in words if kind == b"mtllib"):
        try:
            definitions |= _read_materials(name, files)
        except MeshError as error:
            warnings[f"materials {error}"] = None
    textures = Textures()
    materials, mappings = [PLAIN, WHITE], [_MtlMaterial(), _MtlMaterial()]
    numbers: dict[str, tuple[int, int]] = {"": (0, 0)}  # rows of each material: with its texture, and without
    for name in used:
        if name not in numbers:
            definition = definitions.get(name, _MtlMaterial())
            numbers[name] = _add(name, definition, textures, files, materials, mappings)
    current = np.cumsum(lines.kinds == _USEMTL)[is_face]
    pairs = np.array([numbers[name] for name in ["", *used]])
    ids = np.where(whole, *pairs[np.minimum(current, len(used))].T)
    textured = np.array([material.texture is not None for material in materials])[ids]

    colors = None
    if (lines.counts[lines.kinds == _V] >= 6).any():
        colors = np.where(textured[owners, None], 1.0, _colors_of_vertices(lines)[polygons.corners])
        materials = [
            m if m.texture is not None else WHITE._replace(name=m.name, transmittance=m.transmittance)
            for m in materials
        ]
    scale, offset = (np.array([getattr(each, name) for each in mappings])[ids][owners] for name in ("scale", "offset"))
    mapped = np.where(has_uv[:, None], uv, 0.0) * scale + offset
    return PolygonColors(tuple(materials), ids, colors, mapped, warnings=(*warnings, *textures.warnings))


def _add(
    name: str,
    definition: _MtlMaterial,
    textures: Textures,
    files: MeshFiles,
    materials: list[Material],
    mappings: list[_MtlMaterial],
) -> tuple[int, int]:
    """Append a material's rows; return the row with its texture, and that for polygons without coordinates."""
    texture = None
    if definition.texture:
        path = posixpath.join(definition.folder, definition.texture)
        texture = textures.get(path, lambda: _read_texture(definition, files))
    base = PLAIN if definition.color is None else Material(definition.color)
    plain = len(materials)
    materials.append(base._replace(name=name, transmittance=definition.transmittance))
    mappings.append(_MtlMaterial())
    if texture is None:
        return plain, plain
    factor = definition.color if definition.color is not None and any(definition.color) else WHITE.factor
    wrap = definition.wrap, definition.wrap
    materials.append(Material(factor, texture, wrap, name, definition.transmittance))
    mappings.append(definition)
    return len(materials) - 1, plain


def _read_texture(definition: _MtlMaterial, files: MeshFiles) -> bytes:
    """Return the content of a texture, named relative to the .mtl file's folder or, in some files, to the mesh's."""
    for name in (definition.texture, posixpath.basename(definition.texture.replace("\\", "/"))):
        try:
            return files.read_named(posixpath.join(definition.folder, name))
        except MeshError:
            continue
    return files.read_named(definition.texture)


def _uv_of_corners(lines: Lines, is_face: BoolArray) -> FloatArray:
    """Return the texture coordinates of all corners (c, 2); NaN for a corner without any."""
    numbers = lines.numbers()
    is_vt = lines.kinds == _VT
    table = np.full((int(is_vt.sum()) + 1, 2), np.nan)
    table[1:, 0] = numbers[lines.first[is_vt]] if (lines.counts[is_vt] > 0).all() else np.nan
    has_v = lines.counts[is_vt] > 1
    table[1:, 1] = np.where(has_v, numbers[np.minimum(lines.first[is_vt] + 1, len(numbers) - 1)], 0.0)
    given = numbers[np.repeat(is_face, lines.counts)]
    ids = np.where(given == np.trunc(given), 0.0, np.trunc(given))  # indices after a slash were marked by .25
    before = np.repeat(np.cumsum(is_vt)[is_face], lines.counts[is_face])
    ids = np.where(ids < 0, ids + before + 1, ids)
    if ids.size and not (ids.min() >= 0 and ids.max() < len(table)):
        raise MeshError(
            f"faces must refer to the {len(table) - 1} vt lines of an OBJ file; one does not. Is it damaged?"
        )
    return np.asarray(table[ids.astype(np.int64)])


def _colors_of_vertices(lines: Lines) -> FloatArray:
    """Return the colours of all vertices (v, 3), from the numbers after the coordinates."""
    is_vertex = lines.kinds == _V
    has_color = lines.counts[is_vertex] >= 6
    first = lines.first[is_vertex][has_color, None] + np.arange(3, 6)
    colors = np.full((len(has_color), 3), GREY / 255)
    found = lines.numbers()[first]
    colors[has_color] = in_unit_range(found)
    return colors


def _read_materials(name: str, files: MeshFiles) -> dict[str, _MtlMaterial]:
    """Return the materials of the .mtl file or files that an mtllib line names."""
    try:
        texts = {name: files.read_named(name)}
    except MeshError:
        if len(name.split()) < 2:
            raise
        texts = {each: files.read_named(each) for each in name.split()}
    definitions: dict[str, _MtlMaterial] = {}
    for each, text in texts.items():
        definitions |= _materials_of(text.decode("utf-8-sig", "replace"), posixpath.dirname(each.replace("\\", "/")))
    return definitions


def _materials_of(text: str, folder: str) -> dict[str, _MtlMaterial]:
    """Return the materials of one .mtl file, whose folder is relative to the mesh's."""
    definitions: dict[str, _MtlMaterial] = {}
    current = None
    for line in text.splitlines():
        word, _, rest = line.replace("\t", " ").strip().partition(" ")
        rest = rest.strip()
        if word == "newmtl":
            current, definitions[rest] = rest, _MtlMaterial(folder=folder)
        elif current is not None and word == "Kd":
            try:
                values = np.clip(np.nan_to_num([float(each) for each in rest.split()[:3]]), 0.0, 1.0).tolist()
            except ValueError:
                continue  # "spectral", "xyz"
            red, green, blue = (values * 3)[:3] if values else WHITE.factor
            definitions[current] = definitions[current]._replace(color=(red, green, blue))
        elif current is not None and word in ("d", "Tr") and _is_number(rest.split(" ")[-1]):
            value = min(max(float(rest.split(" ")[-1]), 0.0), 1.0)  # the last word: -halo may come before
            transmittance = 1.0 - value if word == "d" else value
            definitions[current] = definitions[current]._replace(transmittance=transmittance)
        elif current is not None and word.lower() == "map_kd":
            definitions[current] = _with_texture(definitions[current], rest)
    return definitions


def _with_texture(definition: _MtlMaterial, text: str) -> _MtlMaterial:
    """Return a material with the arguments of map_Kd: options, then a file name, which may contain blanks."""
    words = text.split(" ")
    while words and (words[0].startswith("-") or not words[0]):
        option = words.pop(0)
        values: list[str] = []
        while words and len(values) < _OPTIONS.get(option, int(bool(option))) and (not values or _is_number(words[0])):
            values.append(words.pop(0))
        if option == "-clamp" and values == ["on"]:
            definition = definition._replace(wrap=CLAMP)
        elif option in ("-s", "-o") and all(map(_is_number, values)):
            u, v = (*map(float, values), *(1.0, 1.0))[:2] if option == "-s" else (*map(float, values), 0.0, 0.0)[:2]
            definition = definition._replace(scale=(u, v)) if option == "-s" else definition._replace(offset=(u, v))
    return definition._replace(texture=" ".join(words))


def _is_number(word: str) -> bool:
    return re.fullmatch(r"[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?", word, re.IGNORECASE) is not None
