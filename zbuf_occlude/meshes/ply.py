"""The polygon file format (PLY), ASCII and binary, with polygons of any and of mixed sizes."""

import re
import struct
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.arrays import FloatArray
from zbuf_occlude.errors import MeshError
from zbuf_occlude.meshes.polygons import Ints, Polygons
from zbuf_occlude.meshes.text import Lines, as_doubles, runs

_TYPES = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"},
    **{"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4"},
    **{"int64": "i8", "uint64": "u8", "float": "f4", "double": "f8", "float32": "f4", "float64": "f8"},
}
_COUNT_CODES = {1: "B", 2: "H", 4: "I", 8: "Q"}  # of struct, by size
_INDEX_LISTS = ("vertex_indices", "vertex_index")


@dataclass
class _Property:
    name: str
    dtype: np.dtype[np.generic]
    count_dtype: np.dtype[np.generic] | None = None  # of a list


@dataclass
class Element:
    """One element of a header."""

    name: str
    n_rows: int
    properties: list[_Property] = field(default_factory=list)

    @property
    def n_bytes_least(self) -> int:
        """Bytes of a row whose lists are empty."""
        return sum((p.count_dtype or p.dtype).itemsize for p in self.properties)


@dataclass
class Columns:
    """What was read of an element: scalars (rows,), and one list as values end to end and their number per row."""

    scalars: dict[str, NDArray[Any]]
    values: NDArray[Any]
    counts: Ints


def read_ply(data: bytes) -> Polygons:
    """Read a PLY file.

    Parameters
    ----------
    data : bytes
        The whole file.

    Returns
    -------
    Polygons
        Of any number of corners, in the order of the file.

    Raises
    ------
    MeshError
        Not a PLY file, of unknown types, cut short, damaged, or declaring more than it holds.

    Notes
    -----
    Of the elements, `vertex` (x, y, z) and `face` (vertex_indices or vertex_index) are read, all others skipped;
    triangle strips are not read. In an ASCII file each row must have a line of its own, as in every one that we met.
    Nothing is allocated by what the header says before it was compared with the size of the file.
    """
    columns = read_elements(data, {"vertex", "face"})
    if "vertex" not in columns or "face" not in columns:
        raise MeshError("a PLY file must have the elements vertex and face; this one has not. Is it a point cloud?")
    return Polygons(_positions(columns["vertex"]), columns["face"].values, columns["face"].counts)


def read_ply_points(data: bytes) -> FloatArray | None:
    """Read the vertices of a PLY file that has no faces.

    Returns
    -------
    (n, 3) float64 or None
        None when the file has faces or no vertices: it is no point cloud.

    Raises
    ------
    MeshError
        As `read_ply`.
    """
    counts = {element.name: element.n_rows for element in read_header(data)[0]}
    if counts.get("face") or not counts.get("vertex"):
        return None
    return _positions(read_elements(data, {"vertex"})["vertex"])


def read_elements(data: bytes, wanted: set[str]) -> dict[str, Columns]:
    """Return the columns of the elements up to the last of those wanted; raises as `read_ply`."""
    elements, encoding, body = read_header(data)
    source = _Ascii(body) if encoding == "ascii" else _Binary(body, "<" if "little" in encoding else ">")
    columns: dict[str, Columns] = {}
    if wanted <= {element.name for element in elements}:
        for element in elements:
            columns[element.name] = source.read(element)
            if wanted <= columns.keys():
                break
    return columns


def _positions(vertices: Columns) -> FloatArray:
    """(v, 3) float64."""
    if not all(axis in vertices.scalars for axis in "xyz"):
        raise MeshError("the vertices of a PLY file must have x, y and z; these have not. Is it damaged?")
    return np.stack([as_doubles(vertices.scalars[axis]) for axis in "xyz"], axis=1)


def read_header(data: bytes) -> tuple[list[Element], str, bytes]:
    """Return elements, encoding (one of the three names), and the bytes after the header; raises as `read_ply`."""
    newline = re.match(rb"ply[ \t]*(\r\n|\n|\r)", data)
    if newline is None:
        raise MeshError("a PLY file must begin with the line 'ply'; this one does not. Is it of another format?")
    ends = (re.escape(newline[1]) + rb"|$", rb"\r\n|\n|\r")  # the last line may end in another way than the first
    end = next(filter(None, (re.search(rb"[\r\n]end_header[ \t]*(%s)" % each, data) for each in ends)), None)
    if end is None:
        raise MeshError("the header of a PLY file must end with end_header; this one does not. Is it cut short?")
    encoding = ""
    elements: list[Element] = []
    for line in data[: end.start()].splitlines()[1:]:
        words = line.decode("latin-1").split()
        try:
            match words:
                case ["format", name, _]:
                    encoding = name
                case ["element", name, count]:
                    elements.append(Element(name, _row_count(count)))
                case ["property", "list", count_type, value_type, name]:
                    # lengths are read as unsigned: a negative one is then larger than any file
                    of_count = np.dtype(_TYPES[count_type].replace("i", "u"))
                    if of_count.kind == "f":
                        raise KeyError(count_type)
                    elements[-1].properties.append(_Property(name, np.dtype(_TYPES[value_type]), of_count))
                case ["property", value_type, name]:
                    elements[-1].properties.append(_Property(name, np.dtype(_TYPES[value_type])))
                case [] | ["comment", *_] | ["obj_info", *_]:
                    pass
                case _:
                    raise KeyError(words[0])
        except (KeyError, IndexError, ValueError):
            shown = line[:60].decode("latin-1")
            raise MeshError(f"the header of a PLY file must be readable; it has the line {shown!r}.") from None
    if encoding not in ("ascii", "binary_little_endian", "binary_big_endian"):
        raise MeshError(f"a PLY file must be ascii or binary; its format is {encoding!r}. Is it damaged?")
    return elements, encoding, data[end.end() :]


def _row_count(word: str) -> int:
    if not re.fullmatch(r"\d{1,18}", word, re.ASCII):
        raise ValueError(word)
    return int(word)


def _too_short(element: Element, n_held: int, what: str) -> MeshError:
    return MeshError(
        f"a PLY file must hold the {element.n_rows:,} rows of the element {element.name} that it declares; "
        f"it has {n_held:,} {what} for them. Is it damaged or cut short?"
    )


class _Ascii:
    """Rows as lines of numbers."""

    def __init__(self, body: bytes) -> None:
        self._lines = Lines(body)
        self._numbers: FloatArray | None = None
        self._next_line = 0

    def read(self, element: Element) -> Columns:
        here, end = self._next_line, self._next_line + element.n_rows
        if end > len(self._lines):
            raise _too_short(element, len(self._lines) - here, "lines")
        self._next_line = end
        if self._numbers is None:
            self._numbers = self._lines.numbers()
        position = self._lines.first[here:end].copy()
        line_end = position + self._lines.counts[here:end]
        columns = Columns({}, np.empty(0), np.zeros(element.n_rows, dtype=np.int64))
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
                    f"a list in the element {element.name} must stand whole on its line; one does not. Is it damaged?"
                )
            counts = values.astype(np.int64)
            if column.name in _INDEX_LISTS:
                columns.values, columns.counts = self._numbers[runs(position, counts)], counts
            position += counts
        return columns


class _Binary:
    """Rows as packed records."""

    def __init__(self, body: bytes, byte_order: Literal["<", ">"]) -> None:
        self._body = body
        self._order = byte_order
        self._next_byte = 0

    def read(self, element: Element) -> Columns:
        room = len(self._body) - self._next_byte
        if element.n_rows * element.n_bytes_least > room:
            raise _too_short(element, room, "bytes")
        if not element.properties or element.n_rows == 0:
            return Columns({p.name: np.empty(0) for p in element.properties}, np.empty(0), np.zeros(0, dtype=np.int64))
        return self._alike(element) or self._one_by_one(element)

    def _alike(self, element: Element) -> Columns | None:
        """Read rows whose lists are all as long as the first row's, or return None when they are not."""
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
        columns = Columns({}, np.empty(0), np.zeros(element.n_rows, dtype=np.int64))
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

    def _one_by_one(self, element: Element) -> Columns:
        """Read rows of different lengths."""
        if element.name == "vertex":
            raise MeshError("the vertices of a PLY file must have no lists of different lengths. Convert it.")
        starts, counts, self._next_byte = self._walk(element, element.n_rows)
        lists = [p for p in element.properties if p.count_dtype is not None]
        wanted = next((i for i, p in enumerate(lists) if p.name in _INDEX_LISTS), None)
        if wanted is None:
            return Columns({}, np.empty(0), np.zeros(element.n_rows, dtype=np.int64))
        dtype = lists[wanted].dtype
        packed = np.frombuffer(self._body, dtype=np.uint8)[runs(starts[:, wanted], counts[:, wanted] * dtype.itemsize)]
        return Columns({}, packed.view(dtype.newbyteorder(self._order)), counts[:, wanted])

    def _walk(self, element: Element, n_rows: int) -> tuple[Ints, Ints, int]:
        """Byte offsets and lengths of the lists of the next rows, (n_rows, lists), and where the last row ends."""
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
            for _ in range(n_rows):  # where a row begins is only known once the one before it is read
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
