"""The numbers of a glTF file: buffers, accessors and attributes."""

import base64
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.base.arrays import FloatArray
from zbuf_occlude.base.errors import MeshError
from zbuf_occlude.base.extras import reason
from zbuf_occlude.meshes.mesh_files import MeshFiles
from zbuf_occlude.meshes.polygons import Ints
from zbuf_occlude.meshes.text import as_doubles

Json = dict[str, Any]

_TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
_FLOATS, _UNSIGNED = (5120, 5121, 5122, 5123, 5126), (5121, 5123, 5125)
_ROLES = {
    **dict.fromkeys(("POSITION", "target POSITION", "TRANSLATION", "SCALE"), (("VEC3",), _FLOATS)),
    **dict.fromkeys(("WEIGHTS", "ROTATION"), (("VEC4",), _FLOATS)),
    "COLOR_0": (("VEC3", "VEC4"), _FLOATS),
    "TEXCOORD": (("VEC2",), _FLOATS),
    "inverseBindMatrices": (("MAT4",), (5126,)),
    "indices": (("SCALAR",), _UNSIGNED),
    "JOINTS": (("VEC4",), _UNSIGNED),
}
"""Allowed types and component types of an accessor, for each use."""

_LARGEST_OF_BYTES = 128 / 127
"""Largest magnitude of a normalized integer: -128 in a byte, before it is clipped to -1."""

_REPEATED = 6_000_000
"""Vertices and corners that a scene may have beyond those in its bytes, by repeating the same data."""


class Data:
    """The data of a document's accessors, buffer views and buffers; `binary` is the binary chunk of a .glb file.

    Buffers are read on demand, once each.
    """

    def __init__(self, document: Json, binary: bytes | None, files: MeshFiles) -> None:
        self._accessors = document.get("accessors", [])
        self._views = document.get("bufferViews", [])
        self._buffers = document.get("buffers", [])
        self._binary, self._files = binary, files
        self._kept: dict[int | Path, bytes] = {}
        self._n_rows = 0

    def count(self, n_rows: int) -> None:
        """Count rows before their allocation; raise MeshError for far more rows than the bytes read can contain.

        A small file can repeat the same data without limit.
        """
        self._n_rows += n_rows
        if self._n_rows > 3 * sum(map(len, self._kept.values())) + _REPEATED:
            raise MeshError(f"a scene must not repeat its data to {self._n_rows:,} vertices and corners. Split it.")

    def floats(self, accessor_id: Any, role: str) -> FloatArray:
        """Return the rows of an accessor as float64; normalized integers become numbers in [-1, 1]."""
        accessor = self.checked(accessor_id, role)
        return _in_unit_range(accessor, self._read(accessor_id, accessor, role))

    def integers(self, accessor_id: Any, role: str) -> Ints:
        """Return the rows of an accessor as indices."""
        return self._read(accessor_id, self.checked(accessor_id, role), role).astype(np.int64)

    def attributes(self, primitive: Json) -> "Attributes":
        """Return the attributes of a primitive."""
        packed = primitive.get("extensions", {}).get("KHR_draco_mesh_compression")
        return Attributes(self, primitive["attributes"], {} if packed is None else packed)

    def checked(self, accessor_id: Any, role: str) -> Json:
        """Return an accessor; raise MeshError unless its types suit the role."""
        accessor: Json = self._accessors[whole(accessor_id)]
        types, components = _ROLES[role]
        found = accessor["type"], accessor["componentType"]
        if found[0] not in types or found[1] not in components:
            raise MeshError(
                f"{role} of glTF must be {' or '.join(types)} of component types {components}; it is {str(found)[:60]}."
            )
        return accessor

    def unpacked(self, packed: Json) -> Any:
        """Return DracoPy's result for the buffer view that a primitive's extension names."""
        try:
            import DracoPy
        except ImportError as error:
            cause = reason("DracoPy", error)
            raise MeshError(f"a mesh compressed by Draco {cause}, or export the mesh uncompressed.") from None
        content = self._whole_view(packed)
        try:
            return DracoPy.decode(content)
        except Exception as error:  # DracoPy raises any error on damaged bytes
            cause = " ".join(f"{type(error).__name__}: {error}".split())[:100]
            raise MeshError(f"DracoPy cannot read the compressed mesh ({cause}). Is it damaged?") from None

    def image(self, image: Json) -> bytes:
        """Return the content of an image from a buffer view, a data URI or a file."""
        if "bufferView" in image:
            return self._whole_view(image)
        uri = str(image["uri"])
        if not uri.startswith("data:"):
            return self._files.read_named(unquote(uri))
        try:
            return _from_data_uri(uri)
        except ValueError as error:
            raise MeshError(f"an image in a data URI must be base64; this one is not ({error}).") from None

    def _read(self, accessor_id: Any, accessor: Json, role: str) -> NDArray[Any]:
        """Return an accessor's numbers in their stored type, (n, width)."""
        kind, width = np.dtype(_TYPES[accessor["componentType"]]), _WIDTHS[accessor["type"]]
        n_rows = whole(accessor["count"])
        sparse = accessor.get("sparse")
        if "bufferView" in accessor:
            values = self._rows(accessor, kind, width, n_rows)
            self.count(n_rows)
        elif sparse is None and role != "target POSITION":  # many exporters leave out targets that are 0
            raise MeshError(
                f"accessor {accessor_id} of glTF has no data, or they are compressed. Export it uncompressed."
            )
        else:
            self.count(n_rows)
            values = np.zeros((n_rows, width), kind)
        if sparse is not None:
            n_changed, where = whole(sparse["count"]), sparse["indices"]
            rows = self._rows(where, np.dtype(_TYPES[where["componentType"]]), 1, n_changed)[:, 0].astype(np.int64)
            values = values.copy()
            values[rows] = self._rows(sparse["values"], kind, width, n_changed)
        return values

    def _rows(self, where: Json, kind: np.dtype[Any], width: int, n_rows: int) -> NDArray[Any]:
        """Return rows of numbers, which may have gaps, of the buffer view that a part of the document names."""
        view, offset = self._views[whole(where["bufferView"])], whole(where.get("byteOffset", 0))
        row = kind.itemsize * width
        stride = whole(view.get("byteStride", 0)) or row
        size = offset + stride * (n_rows - 1) + row if n_rows else 0
        if stride < row or size > whole(view["byteLength"]):
            raise MeshError(
                f"buffers of glTF must contain what is declared; count is {n_rows:,} of {row} bytes each in a view of "
                f"{whole(view['byteLength']):,} bytes."
            )
        data = self._bytes(view, offset, size - offset)
        shape, strides = (n_rows, width), (stride, kind.itemsize)
        return np.ndarray(shape, kind, data, strides=strides) if n_rows else np.empty(shape, kind)

    def _whole_view(self, where: Json) -> bytes:
        view = self._views[whole(where["bufferView"])]
        return bytes(self._bytes(view, 0, whole(view["byteLength"])))

    def _bytes(self, view: Json, offset: int, size: int) -> memoryview:
        """Return bytes of a buffer view."""
        is_meshopt = any(name.endswith("_meshopt_compression") for name in view.get("extensions", {}))
        buffer = self._buffer(whole(view["buffer"]), is_meshopt)
        begin = whole(view.get("byteOffset", 0)) + offset
        end = begin - offset + max(offset + size, whole(view["byteLength"]))
        if end > len(buffer):
            raise MeshError(
                f"buffers of glTF must contain what is declared; byteLength is {end:,} of {len(buffer):,} bytes."
            )
        return memoryview(buffer)[begin : begin + size]

    def _buffer(self, buffer_id: int, is_meshopt: bool) -> bytes:
        uri = self._buffers[buffer_id].get("uri")
        if uri is None:
            if buffer_id or self._binary is None:
                cause = "it has none. Is it cut short or compressed?"
                if is_meshopt:
                    cause = "it is compressed by meshopt. Export it uncompressed (gltfpack without -c)."
                raise MeshError(f"buffer {buffer_id} of glTF must have data; {cause}")
            return self._kept.setdefault(buffer_id, self._binary)
        if uri.startswith("data:"):
            if buffer_id not in self._kept:
                self._kept[buffer_id] = _from_data_uri(uri)
            return self._kept[buffer_id]
        folder = self._files.folder
        path = (folder / unquote(uri)).resolve()
        if path not in self._kept:
            missing = f"a buffer of glTF must be a file in its folder; there is no {uri[:80]!r}. Copy it there."
            if "://" in uri or not path.is_relative_to(folder.resolve()):
                raise MeshError(missing)
            try:
                self._kept[path] = self._files.read(path)
            except (OSError, MeshError):
                raise MeshError(missing) from None
        return self._kept[path]


class Attributes:
    """The attributes of one primitive, and its triangles where they are compressed by Draco."""

    def __init__(self, data: Data, accessors: Json, packed: Json) -> None:
        self._data, self._accessors = data, accessors
        self._numbers: Json = packed.get("attributes", {})
        self._unpacked = data.unpacked(packed) if packed else None

    def __contains__(self, name: str) -> bool:
        return name in self._accessors

    def __len__(self) -> int:
        return len(self._accessors)

    @property
    def triangles(self) -> Ints | None:
        """Triangles (f, 3) of a primitive that is compressed by Draco; None for any other."""
        if self._unpacked is None:
            return None
        if not hasattr(self._unpacked, "faces"):
            raise MeshError("Draco data must have triangles; these are only points. Export the mesh uncompressed.")
        return np.asarray(self._unpacked.faces, np.int64).reshape(-1, 3)

    def floats(self, name: str, role: str) -> FloatArray:
        """Return an attribute's rows, as `Data.floats` does."""
        if name not in self._numbers:
            return self._data.floats(self._accessors[name], role)
        return _in_unit_range(self._data.checked(self._accessors[name], role), self._from_draco(name))

    def integers(self, name: str, role: str) -> Ints:
        """Return an attribute's rows as indices."""
        if name not in self._numbers:
            return self._data.integers(self._accessors[name], role)
        self._data.checked(self._accessors[name], role)
        return self._from_draco(name).astype(np.int64)

    def _from_draco(self, name: str) -> NDArray[Any]:
        number = whole(self._numbers[name])
        found = None if self._unpacked is None else self._unpacked.get_attribute_by_unique_id(number)
        if found is None:
            raise MeshError(f"Draco data must have the attribute {number}, {name}; they do not. Are they damaged?")
        return np.asarray(found["data"])


def whole(value: Any) -> int:
    """Return a count, an offset or an index of the JSON; raise MeshError unless it is a whole number."""
    if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value < 1 << 60:
        raise MeshError(f"counts and indices of glTF must be whole numbers from 0; one is {str(value)[:40]!r}.")
    return value


def _in_unit_range(accessor: Json, values: NDArray[Any]) -> FloatArray:
    """Return numbers as float64; those of a normalized integer accessor in [-1, 1]."""
    numbers, kind = as_doubles(values), np.dtype(_TYPES[accessor["componentType"]])
    if not accessor.get("normalized") or kind.kind == "f":
        return numbers
    # Draco returns integers as floats, already divided where its own attribute is marked as normalized
    is_divided = values.dtype.kind == "f" and (np.abs(numbers) <= _LARGEST_OF_BYTES).all()
    return np.maximum(numbers if is_divided else numbers / np.iinfo(kind).max, -1.0)


def _from_data_uri(uri: str) -> bytes:
    return base64.b64decode(uri.partition(";base64,")[2], validate=True)
