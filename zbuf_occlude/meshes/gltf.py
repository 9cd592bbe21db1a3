"""glTF 2.0 scenes, as .gltf with its buffers or as one .glb, flattened to one set of triangles."""

import base64
import binascii
import json
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import unquote, unquote_to_bytes

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.arrays import FloatArray
from zbuf_occlude.errors import MeshError
from zbuf_occlude.meshes.polygons import Ints, Polygons
from zbuf_occlude.meshes.text import as_doubles

_COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC3": 3}  # of the accessors read here
_TRIANGLES, _STRIP, _FAN = 4, 5, 6
_HARMLESS = ("KHR_materials_", "KHR_texture_", "KHR_lights_", "EXT_texture_", "KHR_mesh_quantization")
"""Extensions that a file may require without that positions or faces were hidden from a reader that ignores them."""

_REPEATED = 6_000_000
"""Corners that a scene may have beyond what its bytes can hold, by referring to the same data again and again."""


def read_gltf(data: bytes, folder: Path) -> Polygons:
    """Read the triangles of a glTF scene, each node's mesh moved to where the scene shows it.

    Parameters
    ----------
    data : bytes
        The whole .gltf or .glb file.
    folder : Path
        Where the buffers that the file names are looked for.

    Returns
    -------
    Polygons
        Triangles in the scene's own axes (y up), node after node, depth first. Units of the file (metres).

    Raises
    ------
    MeshError
        Not glTF 2, cut short, damaged, compressed (Draco, meshopt), or its buffers are missing.

    Notes
    -----
    Triangles, strips and fans are read, with sparse and quantized accessors; points and lines are left out. Skins and
    morph targets are not applied: an animated figure has the pose of its mesh. Vertices that no triangle uses are left
    out. Without a default scene the first one is shown, without scenes every node that is no other's child.
    """
    try:
        document, binary = _split(data)
        return _Scene(document, binary, folder).flattened()
    except (KeyError, IndexError, TypeError, AttributeError, ValueError, OverflowError, RecursionError) as error:
        if isinstance(error, MeshError):
            raise
        # the structure of the JSON is the file's, and so are its mistakes
        reason = f"{type(error).__name__}: {str(error)[:80]}"
        raise MeshError(f"it must be valid glTF 2.0; its structure is broken ({reason}). Is it damaged?") from None


def _split(data: bytes) -> tuple[dict[str, Any], bytes | None]:
    """Return the JSON document, and the binary chunk of a .glb."""
    binary = None
    if data.startswith(b"glTF"):
        if len(data) < 20:
            raise MeshError("a GLB file must have two headers of 20 bytes; it ends before. Is it cut short?")
        version, declared = struct.unpack_from("<II", data, 4)
        if version != 2:
            raise MeshError(f"a GLB file must be of version 2; it is of version {version}. Convert it.")
        if declared > len(data):
            raise MeshError(
                f"a GLB file must have the {declared:,} bytes that it declares; it has {len(data):,}. Is it cut short?"
            )
        chunks = dict(reversed(list(_chunks(data[:declared]))))  # the first of each kind counts
        data, binary = chunks[b"JSON"], chunks.get(b"BIN\0")
    try:
        document = json.loads(data)
    except (ValueError, RecursionError):
        raise MeshError(
            "a glTF file must be JSON; this one cannot be read as that. Is it damaged or cut short?"
        ) from None
    version = document.get("asset", {}).get("version", "2.0")
    if not str(version).startswith("2"):
        raise MeshError(f"a glTF file must be of version 2; it is of version {version}. Convert it.")
    unknown = [name for name in document.get("extensionsRequired", []) if not str(name).startswith(_HARMLESS)]
    if unknown:
        raise MeshError(
            f"a glTF file must be readable without extensions; it requires {unknown[0]}. Export it plainly."
        )
    return document, binary


def _chunks(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    position = 12
    while position + 8 <= len(data):
        length, kind = struct.unpack_from("<I4s", data, position)
        if position + 8 + length > len(data):
            raise MeshError("the chunks of a GLB file must lie within it; one does not. Is it damaged or cut short?")
        yield kind, data[position + 8 : position + 8 + length]
        position += 8 + length


class _Scene:
    """A document with its buffers, read as far as needed."""

    def __init__(self, document: dict[str, Any], binary: bytes | None, folder: Path) -> None:
        self._document = document
        self._binary = binary
        self._folder = folder
        self._buffers: dict[int, bytes] = {}
        self._meshes: dict[int, tuple[FloatArray, Ints]] = {}
        self._n_bytes = 0 if binary is None else len(binary)
        self._n_corners = 0

    def flattened(self) -> Polygons:
        parts = []
        for mesh_id, matrix in self._placements():
            positions, corners = self._mesh(mesh_id)
            self._spend(len(corners))
            with np.errstate(over="ignore", invalid="ignore"):  # what overflows is refused with the other infinities
                parts.append((positions @ matrix[:3, :3].T + matrix[:3, 3], corners))
        vertices, corners = _joined(parts)
        return Polygons.from_triangles(vertices, corners)

    def _spend(self, n_corners: int) -> None:
        """Keep memory bounded before it is taken: a small file can refer to the same data without end."""
        self._n_corners += n_corners
        if (
            self._n_corners > 3 * self._n_bytes + _REPEATED
        ):  # a byte holds one index at most, an index of a strip 3 corners
            raise MeshError(f"a scene must not repeat its data to {self._n_corners:,} corners and more. Split it.")

    def _placements(self) -> Iterator[tuple[int, FloatArray]]:
        """Meshes and the matrices from their coordinates to the scene's, node after node."""
        nodes = self._document.get("nodes", [])
        scenes = self._document.get("scenes")
        if scenes:
            roots = list(scenes[_index(self._document.get("scene", 0))].get("nodes", []))
        else:
            children = {child for node in nodes for child in node.get("children", [])}
            roots = [node for node in range(len(nodes)) if node not in children]
        todo = [(root, np.eye(4)) for root in reversed(roots)]
        seen = set()
        while todo:
            node_id, parent = todo.pop()
            if node_id in seen:
                raise MeshError(f"the nodes of a glTF scene must form a tree; node {node_id} is met twice.")
            seen.add(node_id)
            node = nodes[_index(node_id)]
            with np.errstate(over="ignore", invalid="ignore"):
                matrix = parent @ _transform(node)
            if "mesh" in node:
                yield node["mesh"], matrix
            todo += [(child, matrix) for child in reversed(node.get("children", []))]

    def _mesh(self, mesh_id: int) -> tuple[FloatArray, Ints]:
        """Positions (v, 3) and corners (3 f,) of all the triangles of a mesh."""
        if mesh_id not in self._meshes:
            parts = []
            for primitive in self._document["meshes"][_index(mesh_id)]["primitives"]:
                mode = primitive.get("mode", _TRIANGLES)
                if mode not in (_TRIANGLES, _STRIP, _FAN) or "POSITION" not in primitive["attributes"]:
                    continue
                held = self._accessor(primitive["attributes"]["POSITION"], "VEC3")
                if "indices" in primitive:
                    order = self._accessor(primitive["indices"], "SCALAR")[:, 0].astype(np.int64)
                else:
                    order = np.arange(len(held))
                if len(order) and order.max() >= len(held):
                    raise MeshError(
                        f"mesh {mesh_id} must refer to its {len(held)} vertices by 0 to {len(held) - 1}; "
                        f"it refers to {order.max()}. Is the file damaged?"
                    )
                self._spend(len(order) if mode == _TRIANGLES else 3 * len(order))
                used, corners = np.unique(_assembled(order, mode), return_inverse=True)
                parts.append((held[used], corners))
            self._meshes[mesh_id] = _joined(parts)
        return self._meshes[mesh_id]

    def _accessor(self, accessor_id: int, kind: str) -> FloatArray:
        """Values of an accessor, (count, width) float64."""
        accessor = self._document["accessors"][_index(accessor_id)]
        if accessor["type"] != kind:
            raise MeshError(f"accessor {accessor_id} must be of type {kind}; it is of {str(accessor['type'])[:20]!r}.")
        dtype, width, count = np.dtype(_COMPONENTS[accessor["componentType"]]), _WIDTHS[kind], _index(accessor["count"])
        if kind == "SCALAR" and dtype.kind != "u":
            raise MeshError(f"indices of glTF must be unsigned integers; accessor {accessor_id} has {dtype}.")
        sparse = accessor.get("sparse")
        if "bufferView" in accessor:
            values = as_doubles(self._view(accessor, dtype, width, count))
        elif sparse is None:
            # by the standard all zeros, in practice geometry that an extension has compressed
            raise MeshError(f"accessor {accessor_id} must have data; it has none. Is it compressed? Export it plainly.")
        else:
            n_changed = _index(sparse["count"])
            if count > 64 * max(n_changed, 1) + 1_000_000:
                raise MeshError(f"accessor {accessor_id} must not be almost empty; {n_changed} of {count:,} are given.")
            values = np.zeros((count, width))
        if sparse is not None:
            n_changed = _index(sparse["count"])
            index_type = np.dtype(_COMPONENTS[sparse["indices"]["componentType"]])
            where = self._view(sparse["indices"], index_type, 1, n_changed)[:, 0]
            values[where] = as_doubles(self._view(sparse["values"], dtype, width, n_changed))
        if kind == "VEC3" and accessor.get("normalized") and dtype.kind in "iu":
            values = np.maximum(values / np.iinfo(dtype).max, -1.0)
        return values

    def _view(self, where: dict[str, Any], dtype: np.dtype[Any], width: int, count: int) -> NDArray[Any]:
        """Items of a buffer view, (count, width), without copying; nothing beyond the view can be reached."""
        view = self._document["bufferViews"][_index(where["bufferView"])]
        buffer = self._buffer(_index(view["buffer"]))
        start, size = _index(view.get("byteOffset", 0)), _index(view["byteLength"])
        offset, item = _index(where.get("byteOffset", 0)), width * dtype.itemsize
        stride = _index(view.get("byteStride", item))
        needed = offset + (count - 1) * stride + item if count else 0
        if stride < item or needed > size or start + size > len(buffer):
            raise MeshError(
                f"a buffer of glTF must hold what it declares; {needed:,} bytes are wanted of a view of {size:,} "
                f"in a buffer of {len(buffer):,}. Is it damaged or cut short?"
            )
        if count == 0:
            return np.empty((0, width), dtype=dtype)
        return np.ndarray((count, width), dtype, buffer, start + offset, (stride, dtype.itemsize))

    def _buffer(self, buffer_id: int) -> bytes:
        if buffer_id not in self._buffers:
            uri = self._document["buffers"][buffer_id].get("uri")
            if uri is None:
                if buffer_id != 0 or self._binary is None:
                    raise MeshError(f"buffer {buffer_id} of glTF must have data; it has none. Is the file cut short?")
                self._buffers[buffer_id] = self._binary
            else:
                self._buffers[buffer_id] = _fetch(uri, self._folder)
                self._n_bytes += len(self._buffers[buffer_id])
        return self._buffers[buffer_id]


def _fetch(uri: str, folder: Path) -> bytes:
    if uri.startswith("data:"):
        kind, _, content = uri.partition(",")
        try:
            return base64.b64decode(content, validate=True) if kind.endswith(";base64") else unquote_to_bytes(content)
        except binascii.Error:
            raise MeshError("a buffer inside a glTF file must be base64; it is not. Is it damaged?") from None
    path = Path(unquote(uri))
    shown = str(path)[:80]
    if path.is_absolute() or "://" in uri:
        raise MeshError(f"a buffer of glTF must lie beside it; it is at {shown!r}. Copy it there.")
    if not (folder / path).is_file():
        raise MeshError(f"a buffer of glTF must be a file beside it; there is no {shown!r}. Copy it there.")
    try:
        return (folder / path).read_bytes()
    except OSError as error:
        raise MeshError(f"a buffer of glTF must be readable; {shown!r} is not: {error.strerror}.") from None


def _joined(parts: list[tuple[FloatArray, Ints]]) -> tuple[FloatArray, Ints]:
    """One set of vertices and corners from several."""
    vertices, corners = [np.empty((0, 3))], [np.empty(0, dtype=np.int64)]
    n_vertices = 0
    for positions, indices in parts:
        vertices.append(positions)
        corners.append(indices + n_vertices)
        n_vertices += len(positions)
    return np.concatenate(vertices), np.concatenate(corners)


def _index(value: Any) -> int:
    """Check a count, an offset or an index of the JSON."""
    if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value < 1 << 60:
        raise MeshError(f"counts and indices of glTF must be whole numbers from 0; one is {str(value)[:40]!r}.")
    return value


def _assembled(order: Ints, mode: int) -> Ints:
    """Corners of separate triangles, (3 f,), from the order in which a primitive lists its vertices."""
    if mode == _TRIANGLES:
        return order[: len(order) // 3 * 3]
    if len(order) < 3:
        return order[:0]
    first = order[:-2] if mode == _STRIP else np.full(len(order) - 2, order[0])
    return np.stack([first, order[1:-1], order[2:]], axis=1).reshape(-1)


def _transform(node: dict[str, Any]) -> FloatArray:
    """Matrix of a node, (4, 4), from its coordinates to its parent's."""
    if "matrix" in node:
        return np.asarray(node["matrix"], dtype=np.float64).reshape(4, 4).T  # stored by columns
    matrix = np.eye(4)
    x, y, z, w = np.asarray(node.get("rotation", (0, 0, 0, 1)), dtype=np.float64)
    matrix[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    matrix[:3, :3] *= np.asarray(node.get("scale", (1, 1, 1)), dtype=np.float64)
    matrix[:3, 3] = np.asarray(node.get("translation", (0, 0, 0)), dtype=np.float64)
    return matrix
