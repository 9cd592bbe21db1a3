"""The numbers of a glTF file: buffers, read when needed and once each; accessors, sparse and normalized too."""

import base64
from collections.abc import Callable
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.arrays import FloatArray
from zbuf_occlude.errors import MeshError
from zbuf_occlude.meshes.polygons import Ints
from zbuf_occlude.meshes.text import as_doubles

Json = dict[str, Any]
Count = Callable[[int], None]
"""Is told how many rows are about to be read, and raises when they are too many."""

_TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
_FLOATS = (5120, 5121, 5122, 5123, 5126)
_UNSIGNED = (5121, 5123, 5125)
_VECTORS = {
    **{"POSITION": ("VEC3",), "WEIGHTS": ("VEC4",), "TRANSLATION": ("VEC3",), "ROTATION": ("VEC4",)},
    **{"SCALE": ("VEC3",), "COLOR_0": ("VEC3", "VEC4"), "TEXCOORD": ("VEC2",)},
}


class Data:
    """What a document's accessors, buffer views and buffers hold.

    Parameters
    ----------
    document : dict
    binary : bytes or None
        The binary chunk of a .glb.
    folder : Path
        Where the files lie that are buffers.
    read : callable
        Returns the content of such a file.
    """

    def __init__(self, document: Json, binary: bytes | None, folder: Path, read: Callable[[Path], bytes]) -> None:
        self._accessors = document.get("accessors", [])
        self._views = document.get("bufferViews", [])
        self._buffers = document.get("buffers", [])
        self._binary, self._folder, self._read = binary, folder, read
        self._kept: dict[int | Path, bytes] = {}

    @property
    def n_bytes(self) -> int:
        """Bytes of the buffers read until now, each file once."""
        return sum(map(len, self._kept.values()))

    def floats(self, accessor_id: Any, role: str, count: Count) -> FloatArray:
        """Return vectors as float64, (n, 2), (n, 3) or (n, 4); normalized integers become numbers in [-1, 1]."""
        accessor = self._accessor(accessor_id, role, _VECTORS[role], _FLOATS)
        values = self._values(accessor_id, accessor, count)
        as_floats = as_doubles(values)
        if accessor.get("normalized") and values.dtype.kind in "iu":
            as_floats = np.maximum(as_floats / np.iinfo(values.dtype).max, -1.0)
        return as_floats

    def indices(self, accessor_id: Any, count: Count) -> Ints:
        """Return indices of vertices, (n,)."""
        accessor = self._accessor(accessor_id, "indices", ("SCALAR",), _UNSIGNED)
        return self._values(accessor_id, accessor, count)[:, 0].astype(np.int64)

    def joints(self, accessor_id: Any, count: Count) -> Ints:
        """Return the four joints of each vertex, (n, 4)."""
        accessor = self._accessor(accessor_id, "JOINTS", ("VEC4",), _UNSIGNED)
        return self._values(accessor_id, accessor, count).astype(np.int64)

    def matrices(self, accessor_id: Any, count: Count) -> FloatArray:
        """Return matrices (n, 4, 4), columns first as they are stored."""
        accessor = self._accessor(accessor_id, "inverseBindMatrices", ("MAT4",), (5126,))
        return self._values(accessor_id, accessor, count).astype(np.float64).reshape(-1, 4, 4)

    def draco(self, packed: Json) -> tuple[FloatArray, Ints]:
        """Return the positions and triangles of a primitive compressed by Draco."""
        try:
            import DracoPy
        except ImportError:
            raise MeshError(
                "a mesh compressed by Draco needs the package DracoPy; it is missing. Install it "
                "(pip install zbuf-occlude[draco]), or export the mesh plainly."
            ) from None
        view = self._views[whole(packed["bufferView"])]
        try:
            mesh = DracoPy.decode(bytes(self._bytes(view, 0, whole(view["byteLength"]))))
        except MeshError:
            raise
        except Exception as error:  # what a library does on damaged bytes is not ours to list
            said = " ".join(f"{type(error).__name__}: {error}".split())[:100]
            raise MeshError(f"a mesh compressed by Draco must be sound; DracoPy cannot read it ({said}).") from None
        return np.asarray(mesh.points, dtype=np.float64).reshape(-1, 3), np.asarray(mesh.faces, np.int64).reshape(-1, 3)

    def file(self, image: Json, read: Callable[[str], bytes]) -> bytes:
        """Return the content of an image: of a buffer view, or of the file that `read` finds by its name."""
        if "bufferView" in image:
            view = self._views[whole(image["bufferView"])]
            return bytes(self._bytes(view, 0, whole(view["byteLength"])))
        uri = str(image["uri"])
        if uri.startswith("data:"):
            try:
                return base64.b64decode(uri.partition(";base64,")[2], validate=True)
            except ValueError as error:
                raise MeshError(f"an image in a data URI must be base64; this one is not ({error}).") from None
        return read(unquote(uri))

    def _accessor(self, accessor_id: Any, role: str, types: tuple[str, ...], components: tuple[int, ...]) -> Json:
        accessor: Json = self._accessors[whole(accessor_id)]
        found = accessor["type"], accessor["componentType"]
        if found[0] not in types or found[1] not in components:
            raise MeshError(
                f"{role} of glTF must be {' or '.join(types)} of component types {components}; it is {str(found)[:60]}."
            )
        return accessor

    def _values(self, accessor_id: int, accessor: Json, count: Count) -> NDArray[Any]:
        """Return an accessor's numbers, (n, width), as they are stored."""
        kind, width = np.dtype(_TYPES[accessor["componentType"]]), _WIDTHS[accessor["type"]]
        n_rows = whole(accessor["count"])
        sparse = accessor.get("sparse")
        if "bufferView" in accessor:
            view = self._views[whole(accessor["bufferView"])]
            values = self._rows(view, whole(accessor.get("byteOffset", 0)), kind, width, n_rows)
            count(n_rows)
        elif sparse is None:
            raise MeshError(
                f"accessor {accessor_id} of glTF must have all its data; it has none, or it is compressed. Export it "
                "plainly."
            )
        else:
            count(n_rows)
            values = np.zeros((n_rows, width), kind)
        if sparse is not None:
            n_changed, where, what = whole(sparse["count"]), sparse["indices"], sparse["values"]
            index_kind = np.dtype(_TYPES[where["componentType"]])
            view = self._views[whole(where["bufferView"])]
            rows = self._rows(view, whole(where.get("byteOffset", 0)), index_kind, 1, n_changed)[:, 0].astype(np.int64)
            view = self._views[whole(what["bufferView"])]
            values = values.copy()
            values[rows] = self._rows(view, whole(what.get("byteOffset", 0)), kind, width, n_changed)
        return values

    def _rows(self, view: Json, offset: int, kind: np.dtype[Any], width: int, n_rows: int) -> NDArray[Any]:
        """Return rows of numbers of a buffer view, which may lie apart."""
        row = kind.itemsize * width
        stride = whole(view.get("byteStride", 0)) or row
        size = offset + stride * (n_rows - 1) + row if n_rows else 0
        if stride < row or size > whole(view["byteLength"]):
            raise MeshError(
                f"buffers of glTF must hold what is declared; count is {n_rows:,} of {row} bytes each in a view of "
                f"{whole(view['byteLength']):,} bytes."
            )
        data = self._bytes(view, offset, size - offset)
        shape, strides = (n_rows, width), (stride, kind.itemsize)
        return np.ndarray(shape, kind, data, strides=strides) if n_rows else np.empty(shape, kind)

    def _bytes(self, view: Json, offset: int, size: int) -> memoryview:
        """Return bytes of a buffer view."""
        extensions = view.get("extensions", {})
        buffer = self._buffer(whole(view["buffer"]), "EXT_meshopt_compression" in extensions)
        begin = whole(view.get("byteOffset", 0)) + offset
        end = begin - offset + max(offset + size, whole(view["byteLength"]))
        if end > len(buffer):
            raise MeshError(
                f"buffers of glTF must hold what is declared; byteLength is {end:,} of {len(buffer):,} bytes."
            )
        return memoryview(buffer)[begin : begin + size]

    def _buffer(self, buffer_id: int, is_meshopt: bool) -> bytes:
        uri = self._buffers[buffer_id].get("uri")
        if uri is None:
            if buffer_id or self._binary is None:
                how = "it has none. Is it cut short or compressed?"
                if is_meshopt:
                    how = "it is compressed by meshopt. Export it plainly (gltfpack without -c)."
                raise MeshError(f"buffer {buffer_id} of glTF must have data; {how}")
            self._kept[buffer_id] = self._binary
            return self._binary
        if uri.startswith("data:"):
            if buffer_id not in self._kept:
                self._kept[buffer_id] = base64.b64decode(uri.partition(";base64,")[2], validate=True)
            return self._kept[buffer_id]
        path = (self._folder / unquote(uri)).resolve()
        if path not in self._kept:
            if "://" in uri or not path.is_relative_to(self._folder.resolve()):
                raise MeshError(_missing(uri))
            try:
                self._kept[path] = self._read(path)
            except (OSError, MeshError):
                raise MeshError(_missing(uri)) from None
        return self._kept[path]


def _missing(uri: str) -> str:
    return f"a buffer of glTF must be a file in its folder; there is no {uri[:80]!r}. Copy it there."


def whole(value: Any) -> int:
    """Check a count, an offset or an index of the JSON."""
    if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value < 1 << 60:
        raise MeshError(f"counts and indices of glTF must be whole numbers from 0; one is {str(value)[:40]!r}.")
    return value
