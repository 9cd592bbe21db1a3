"""The polygon file format (PLY), ASCII and binary: polygons of any size, strips, points, colours."""

import re
import struct
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.base.arrays import FloatArray
from zbuf_occlude.base.errors import MeshError, did_you_mean
from zbuf_occlude.geometry.colors import PLAIN, WHITE, Material
from zbuf_occlude.meshes.mesh_files import MeshFiles
from zbuf_occlude.meshes.polygon_colors import PolygonColors, Textures, in_unit_range
from zbuf_occlude.meshes.polygons import Ints, Polygons
from zbuf_occlude.meshes.text import Lines, as_doubles, runs

_TYPES = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"},
    **{"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4"},
    **{"int64": "i8", "uint64": "u8", "float": "f4", "double": "f8", "float32": "f4", "float64": "f8"},
}
_COUNT_CODES = {1: "B", 2: "H", 4: "I", 8: "Q"}  # formats of struct by size
_KEYWORDS = ("format", "element", "property", "comment", "obj_info", "end_header")
_INDEX_LISTS = ("vertex_indices", "vertex_index")
_CHANNELS = (("red", "green", "blue"), ("r", "g", "b"), ("diffuse_red", "diffuse_green", "diffuse_blue"))
_COORDINATES = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"), ("texture_s", "texture_t"))
_TEXTURE = re.compile(rb"^comment TextureFile (.*?)\s*$", re.MULTILINE)


@dataclass
class _Property:
    name: str
    dtype: np.dtype[np.generic]
    count_dtype: np.dtype[np.generic] | None = None  # of a list


@dataclass
class _Element:
    """One element of a header."""

    name: str
    n_rows: int
    properties: list[_Property] = field(default_factory=list)


@dataclass
class _Columns:
    """The rows of an element: its scalar properties and one list property."""

    scalars: dict[str, NDArray[Any]]  # (rows,) each
    values: NDArray[Any]  # of the list, row after row
    counts: Ints  # (rows,): values of each row


def read_ply(data: bytes) -> Polygons:
    """Return the polygons of a PLY file, of any number of corners, in the order of the file; then those of strips.

    The elements `vertex` (x, y, z), `face` and `tristrips` (vertex_indices or vertex_index; -1 separates strips) are
    read, all others skipped. In an ASCII file each row must have a line of its own.

    Raises
    ------
    MeshError
        The file is no PLY file, has unknown types, is cut short or damaged, or declares more than it contains. Declared
        counts are compared with the size of the file before any allocation.
    """
    columns = _read_elements(data)
    if "vertex" not in columns or not {"face", "tristrips"} & columns.keys():
        raise MeshError("a PLY file must have the elements vertex and face; this one does not. Is it a point cloud?")
    corners, counts = [], []
    if "face" in columns:
        corners.append(columns["face"].values)
        counts.append(columns["face"].counts)
    if "tristrips" in columns:
        triangles = _of_strips(columns["tristrips"])
        corners.append(triangles.reshape(-1))
        counts.append(np.full(len(triangles), 3))
    return Polygons(_positions(columns["vertex"]), np.concatenate(corners), np.concatenate(counts))


def foreign_lines(data: bytes) -> list[str]:
    """Return the lines of a PLY file's header that are not PLY: some exporters leave out the word "comment"."""
    lines = (line.decode("latin-1") for line in data[: _header_end(data).start()].splitlines()[1:])
    return [line for line in lines if line.split() and line.split()[0] not in _KEYWORDS]


def read_ply_points(data: bytes) -> FloatArray | None:
    """Return the vertices (n, 3) of a PLY file without faces; None for a file with faces or without vertices."""
    counts = {element.name: element.n_rows for element in _read_header(data)[0]}
    if counts.get("face") or counts.get("tristrips") or not counts.get("vertex"):
        return None
    return _positions(_read_elements(data)["vertex"])


def read_ply_colors(data: bytes, polygons: Polygons, files: MeshFiles) -> PolygonColors:
    """Return the colours of a PLY file's polygons, as `read_ply` returned them.

    They are those of the texture ("comment TextureFile") if vertices have texture coordinates, else of the vertices,
    else of the faces, else grey. Integers range to the maximum of their type, or to 255 if none is above; floats to 1,
    or to 255 (`in_unit_range`).
    """
    elements = {element.name: element for element in _read_header(data)[0]}
    columns = _read_elements(data)
    vertices = columns["vertex"]
    everything, textures = np.zeros(len(polygons.counts), np.int64), Textures()
    pair = next((names for names in _COORDINATES if all(name in vertices.scalars for name in names)), None)
    named = _TEXTURE.search(data[: _header_end(data).start()])
    if named is not None and pair is not None:
        name = named[1].decode("utf-8", "replace")
        texture = textures.get(name, lambda: files.read_named(name))
        if texture is not None:
            uv = np.stack([as_doubles(vertices.scalars[each]) for each in pair], axis=1)
            return PolygonColors((Material(WHITE.factor, texture),), everything, uv=uv[polygons.corners])
    warnings = tuple(textures.warnings)
    if (colors := _colors(elements["vertex"], vertices)) is not None:
        return PolygonColors((WHITE,), everything, colors[polygons.corners], warnings=warnings)
    if "face" in columns and _channels(elements["face"]) is not None:
        colors = _colors(elements["face"], columns["face"])
        if colors is not None and len(colors) == len(polygons.counts):
            return PolygonColors((WHITE,), everything, np.repeat(colors, polygons.counts, axis=0), warnings=warnings)
        warnings = (*warnings, "colours of faces: they are not read beside strips, or lists of different lengths")
    return PolygonColors((PLAIN,), everything, warnings=warnings)


def _channels(element: _Element) -> tuple[str, str, str] | None:
    names = {column.name for column in element.properties}
    return next((each for each in _CHANNELS if names.issuperset(each)), None)


def _colors(element: _Element, columns: _Columns) -> FloatArray | None:
    """Return the colours (rows, 3) of an element in [0, 1]; None for an element without."""
    channels = _channels(element)
    if channels is None or not all(name in columns.scalars for name in channels):
        return None
    found = np.stack([as_doubles(columns.scalars[name]) for name in channels], axis=1)
    kinds: list[np.dtype[Any]] = [column.dtype for column in element.properties if column.name in channels]
    if all(kind.kind in "iu" for kind in kinds):
        most = max(np.iinfo(kind).max for kind in kinds)
        if most > 255 and not (found > 255).any():
            most = 255  # bytes in a larger type
        found = found / most
    return in_unit_range(found)


def _read_elements(data: bytes) -> dict[str, _Columns]:
    """Return the columns of the elements, up to the last one that a mesh needs; raises as `read_ply`."""
    elements, encoding, body = _read_header(data)
    source = _Ascii(body) if encoding == "ascii" else _Binary(body, "<" if "little" in encoding else ">")
    n_wanted = max((i for i, each in enumerate(elements, 1) if each.name in ("vertex", "face", "tristrips")), default=0)
    return {element.name: source.read(element) for element in elements[:n_wanted]}


def _of_strips(strips: _Columns) -> NDArray[Any]:
    """Return the triangles (t, 3) of strips, rows of indices in which -1 separates strips.

    Every second triangle of a strip is reversed, so that all have the same orientation.
    """
    row = np.repeat(np.arange(len(strips.counts)), strips.counts)
    is_end = strips.values == -1
    strip = np.cumsum(is_end) + row  # grows where either changes
    kept = np.flatnonzero(~is_end)
    ids, strip = strips.values[kept], strip[kept]
    within = np.arange(len(ids)) - np.searchsorted(strip, strip)
    last = np.flatnonzero(within >= 2)
    triangles = np.stack([ids[last - 2], ids[last - 1], ids[last]], axis=1)
    is_odd = within[last] % 2 == 1
    triangles[is_odd] = triangles[is_odd][:, [1, 0, 2]]
    return triangles


def _positions(vertices: _Columns) -> FloatArray:
    """Return the positions (v, 3) of the vertices, float64."""
    if not all(axis in vertices.scalars for axis in "xyz"):
        raise MeshError("the vertices of a PLY file must have x, y and z; they do not. Is it damaged?")
    return np.stack([as_doubles(vertices.scalars[axis]) for axis in "xyz"], axis=1)


def _header_end(data: bytes) -> re.Match[bytes]:
    """Return the match of the header's last line; raises as `read_ply`."""
    newline = re.match(rb"ply[ \t]*(\r\n|\n|\r)", data)
    if newline is None:
        raise MeshError("a PLY file must begin with the line 'ply'; this one does not. Is it of another format?")
    ends = (re.escape(newline[1]) + rb"|$", rb"\r\n|\n|\r")  # the last line end may differ from the first
    end = next(filter(None, (re.search(rb"[\r\n]end_header[ \t]*(%s)" % each, data) for each in ends)), None)
    if end is None:
        raise MeshError("the header of a PLY file must end with end_header; this one does not. Is it cut short?")
    return end


def _read_header(data: bytes) -> tuple[list[_Element], str, bytes]:
    """Return elements, encoding (one of the three names), and the bytes after the header; raises as `read_ply`."""
    end = _header_end(data)
    encoding = ""
    elements: list[_Element] = []
    for line in data[: end.start()].splitlines()[1:]:
        words = line.decode("latin-1").split()
        try:
            match words:
                case ["format", name, _]:
                    encoding = name
                case ["element", name, count] if re.fullmatch(r"[0-9]{1,18}", count):
                    elements.append(_Element(name, int(count)))
                case ["property", "list", count_type, value_type, name]:
                    # lengths are read as unsigned, so that a negative one exceeds the file's size
                    of_count = np.dtype(_TYPES[count_type].replace("i", "u"))
                    if of_count.kind == "f":
                        raise KeyError(count_type)
                    elements[-1].properties.append(_Property(name, np.dtype(_TYPES[value_type]), of_count))
                case ["property", value_type, name]:
                    elements[-1].properties.append(_Property(name, np.dtype(_TYPES[value_type])))
                case [] | ["comment", *_] | ["obj_info", *_]:
                    pass
                case [word, *_] if b"\0" in line or _is_like_a_keyword(word):
                    raise KeyError(word)  # binary data, or a mistyped keyword
        except (KeyError, IndexError):
            shown = line[:60].decode("latin-1")
            raise MeshError(f"cannot read the header of the PLY file: its line {shown!r} is invalid.") from None
    if twice := [each.name for i, each in enumerate(elements) if each.name in {other.name for other in elements[:i]}]:
        raise MeshError(f"a PLY file must have each element once; it has {twice[0][:60]!r} twice. Is it damaged?")
    if encoding not in ("ascii", "binary_little_endian", "binary_big_endian"):
        raise MeshError(f"a PLY file must be ascii or binary; its format is {encoding!r}. Is it damaged?")
    return elements, encoding, data[end.end() :]


def _is_like_a_keyword(word: str) -> bool:
    return bool(did_you_mean(word, _KEYWORDS)) or word.lower().startswith(tuple(each[:4] for each in _KEYWORDS))


def _too_short(element: _Element, n_held: int, what: str) -> MeshError:
    return MeshError(
        f"a PLY file must contain the {element.n_rows:,} rows of the element {element.name} that it declares; "
        f"it has {n_held:,} {what} for them. Is it damaged or cut short?"
    )


class _Ascii:
    """The body of an ASCII file: rows as lines of numbers."""

    def __init__(self, body: bytes) -> None:
        self._lines = Lines(body)
        self._numbers: FloatArray | None = None
        self._next_line = 0

    def read(self, element: _Element) -> _Columns:
        here, end = self._next_line, self._next_line + element.n_rows
        if end > len(self._lines):
            raise _too_short(element, len(self._lines) - here, "lines")
        self._next_line = end
        if self._numbers is None:
            self._numbers = self._lines.numbers()
        position = self._lines.first[here:end].copy()
        line_end = position + self._lines.counts[here:end]
        columns = _Columns({}, np.empty(0), np.zeros(element.n_rows, dtype=np.int64))
        for column in element.properties:
            if (position >= line_end).any():
                raise _too_short(element, int((position < line_end).sum()), "whole lines")
            values = self._numbers[position]
            position += 1
            if column.count_dtype is None:
                columns.scalars[column.name] = values
                continue
            if not ((values >= 0) & (values <= line_end - position) & (values == np.floor(values))).all():
                raise MeshError(
                    f"a list in the element {element.name} must be complete on its line; one is not. Is it damaged?"
                )
            counts = values.astype(np.int64)
            if column.name in _INDEX_LISTS:
                columns.values, columns.counts = self._numbers[runs(position, counts)], counts
            position += counts
        return columns


class _Binary:
    """The body of a binary file: rows as packed records."""

    def __init__(self, body: bytes, byte_order: Literal["<", ">"]) -> None:
        self._body = body
        self._order = byte_order
        self._next_byte = 0

    def read(self, element: _Element) -> _Columns:
        room = len(self._body) - self._next_byte
        row = sum((p.count_dtype or p.dtype).itemsize for p in element.properties)  # with empty lists
        if element.n_rows * row > room:
            raise _too_short(element, room, "bytes")
        if not element.properties or element.n_rows == 0:
            return _Columns({p.name: np.empty(0) for p in element.properties}, np.empty(0), np.zeros(0, dtype=np.int64))
        return self._read_equal_rows(element) or self._read_unequal_rows(element)

    def _read_equal_rows(self, element: _Element) -> _Columns | None:
        """Return the columns if all rows have lists as long as the first row's; else None."""
        of_lists = iter(self._walk(element, 1)[1][0])
        lengths = [1 if p.count_dtype is None else int(next(of_lists)) for p in element.properties]
        fields: list[tuple[str, object]] = []
        size = 0
        for i, (column, length) in enumerate(zip(element.properties, lengths, strict=True)):
            if column.count_dtype is not None:
                fields.append((f"count{i}", column.count_dtype.newbyteorder(self._order)))
                size += column.count_dtype.itemsize
            fields.append((f"value{i}", (column.dtype.newbyteorder(self._order), (length,))))
            size += column.dtype.itemsize * length
        if element.n_rows * size > len(self._body) - self._next_byte:
            return None
        rows = np.frombuffer(self._body, dtype=fields, count=element.n_rows, offset=self._next_byte)
        columns = _Columns({}, np.empty(0), np.zeros(element.n_rows, dtype=np.int64))
        for i, (column, length) in enumerate(zip(element.properties, lengths, strict=True)):
            values = rows[f"value{i}"]
            if column.count_dtype is None:
                columns.scalars[column.name] = values[:, 0]
            elif (rows[f"count{i}"] != length).any():
                return None
            elif column.name in _INDEX_LISTS:
                columns.values, columns.counts = values.reshape(-1), np.full(element.n_rows, length)
        self._next_byte += element.n_rows * size
        return columns

    def _read_unequal_rows(self, element: _Element) -> _Columns:
        """Return the columns of rows of different lengths."""
        if element.name == "vertex":
            raise MeshError("the vertices of a PLY file must have no lists of different lengths. Convert it.")
        starts, counts, self._next_byte = self._walk(element, element.n_rows)
        lists = [p for p in element.properties if p.count_dtype is not None]
        wanted = next((i for i, p in enumerate(lists) if p.name in _INDEX_LISTS), None)
        if wanted is None:
            return _Columns({}, np.empty(0), np.zeros(element.n_rows, dtype=np.int64))
        dtype = lists[wanted].dtype
        packed = np.frombuffer(self._body, dtype=np.uint8)[runs(starts[:, wanted], counts[:, wanted] * dtype.itemsize)]
        return _Columns({}, packed.view(dtype.newbyteorder(self._order)), counts[:, wanted])

    def _walk(self, element: _Element, n_rows: int) -> tuple[Ints, Ints, int]:
        """Return offsets and lengths of the lists of the next rows, (n_rows, lists), and the end of the last row."""
        steps = []
        gap = 0  # bytes since the last list
        for column in element.properties:
            if column.count_dtype is None:
                gap += column.dtype.itemsize
                continue
            count = struct.Struct(self._order + _COUNT_CODES[column.count_dtype.itemsize])
            steps.append((gap, count.unpack_from, count.size, column.dtype.itemsize))
            gap = 0
        starts, counts = [], []
        position = self._next_byte
        try:
            for _ in range(n_rows):  # the start of a row depends on the one before
                for before, unpack_from, size, item in steps:
                    position += before
                    (count_here,) = unpack_from(self._body, position)
                    position += size
                    starts.append(position)
                    counts.append(count_here)
                    position += count_here * item
                position += gap
        except struct.error:
            position = len(self._body) + 1
        if position > len(self._body):
            raise _too_short(element, len(self._body) - self._next_byte, "bytes")
        shape = (n_rows, len(steps))
        return (
            np.array(starts, dtype=np.int64).reshape(shape),
            np.array(counts, dtype=np.int64).reshape(shape),
            position,
        )
