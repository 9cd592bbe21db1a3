"""glTF 2.0 scenes, .gltf or .glb: trimesh's reader behind checks that refuse what it would misread."""

import base64
import json
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np

from zbuf_occlude.errors import MeshError
from zbuf_occlude.meshes.library import read_triangles
from zbuf_occlude.meshes.polygons import LARGEST, Polygons

Json = dict[str, Any]

_LINES_AND_POINTS, _TRIANGLES, _STRIP = (0, 1, 2, 3), 4, 5
_KINDS = {"POSITION": ("VEC3", (5120, 5121, 5122, 5123, 5126)), "indices": ("SCALAR", (5121, 5123, 5125))}
_HARMLESS = ("KHR_materials_", "KHR_texture_", "KHR_lights_", "EXT_texture_", "KHR_mesh_quantization")
"""Extensions that a file may require without that positions or faces were hidden from a reader that ignores them."""

_REPEATED = 6_000_000
"""Vertices and corners that a scene may have beyond what its bytes can hold, by showing the same data repeatedly."""

_DEEPEST = 200  # levels of nodes; trimesh's time grows with their square


def read_gltf(data: bytes, folder: Path, read: Callable[[Path], bytes] = Path.read_bytes) -> Polygons:
    """Read the triangles of a glTF scene, each node's mesh moved to where the scene shows it.

    Parameters
    ----------
    data : bytes
        The whole .gltf or .glb file.
    folder : Path
        Where the buffers that the file names must lie.
    read : callable
        Returns the content of such a file.

    Returns
    -------
    Polygons
        Triangles in the scene's own axes (y up), in the order in which trimesh walks the nodes. Units of the file.

    Raises
    ------
    MeshError
        Not glTF 2, cut short, damaged, compressed (Draco, meshopt), with missing buffers, or with what trimesh passes
        over: sparse accessors, normalized positions, fans, instances (EXT_mesh_gpu_instancing).

    Notes
    -----
    Triangles and strips are read; points and lines are left out. Skins and morph targets are not applied: an animated
    figure has the pose of its mesh. Vertices that no triangle uses are left out. Without a default scene the first one
    is shown, without scenes every node that is no other's child. Faces of mirrored nodes are turned over, to face as
    they did. A node's transform within 1e-8 of none is taken as none.
    """
    try:
        document, binary = _split(data)
        buffers = {str(i): _buffer(i, b, binary, folder, read) for i, b in enumerate(document.get("buffers", []))}
        document["buffers"] = [{"uri": name} for name in buffers]
        n_bytes = sum({id(view.obj): len(view) for view in buffers.values()}.values())  # shared ones once
        _prepare_meshes(document, n_bytes)
        _prepare_nodes(document, 3 * n_bytes + _REPEATED)
    except (LookupError, TypeError, AttributeError, ValueError, OverflowError, RecursionError, OSError) as error:
        if isinstance(error, MeshError):
            raise
        # the structure of the JSON is the file's, and so are its mistakes
        reason = f"{type(error).__name__}: {' '.join(str(error).split())[:80]}"
        raise MeshError(f"it must be valid glTF 2.0; its structure is broken ({reason}). Is it damaged?") from None
    vertices, triangles = read_triangles(json.dumps(document).encode(), "gltf", buffers)
    used, corners = np.unique(triangles, return_inverse=True)
    return Polygons.from_triangles(vertices[used], corners)


def _split(data: bytes) -> tuple[Json, bytes | None]:
    """Return the JSON document, readable without extensions, and the binary chunk of a .glb."""
    binary = None
    if data.startswith(b"glTF"):
        version, declared, n_json, kind = struct.unpack_from("<III4s", data.ljust(20, b"\0"), 4)
        rest = data[20 + n_json : declared]
        n_binary = int.from_bytes(rest[:4], "little")
        if declared > len(data) or 20 + n_json > declared or len(rest) < n_binary:
            raise MeshError(
                f"a GLB file must have the {declared:,} bytes and the chunks that it declares; it has {len(data):,}. "
                "Is it cut short?"
            )
        if version != 2 or kind != b"JSON":
            raise MeshError(f"a GLB file must be of version 2 and begin with JSON; it has {version} and {kind!r}.")
        data, binary = data[20 : 20 + n_json], rest[8 : 8 + n_binary] if rest[4:8] == b"BIN\0" else None
    try:
        document = json.loads(data)
    except (ValueError, RecursionError):
        raise MeshError(
            "a glTF file must be JSON; this one cannot be read as that. Is it damaged or cut short?"
        ) from None
    required = [name for name in document.get("extensionsRequired", []) if not str(name).startswith(_HARMLESS)]
    # without this one a file can be read, and shows one of its many instances
    required += [name for name in document.get("extensionsUsed", []) if name == "EXT_mesh_gpu_instancing"]
    if required:
        raise MeshError(
            f"a glTF file must be readable without extensions; it requires {required[0]}. Export it plainly."
        )
    return document, binary


def _buffer(
    buffer_id: int, buffer: Json, binary: bytes | None, folder: Path, read: Callable[[Path], bytes]
) -> memoryview:
    """Bytes of a buffer; as a view, for trimesh slices it once for every view in the file."""
    uri = buffer.get("uri")
    if uri is None:
        if buffer_id or binary is None:
            raise MeshError(f"buffer {buffer_id} of glTF must have data; it has none. Is it cut short or compressed?")
        return memoryview(binary)
    if uri.startswith("data:"):
        return memoryview(base64.b64decode(uri.partition(";base64,")[2], validate=True))
    path = (folder / unquote(uri)).resolve()
    if "://" in uri or not path.is_relative_to(folder.resolve()) or not path.is_file():
        raise MeshError(f"a buffer of glTF must be a file in its folder; there is no {uri[:80]!r}. Copy it there.")
    return memoryview(read(path))


def _prepare_meshes(document: Json, n_bytes: int) -> None:
    """Check every accessor and leave meshes nothing but their triangles."""
    accessors = document.get("accessors", [])
    for i, accessor in enumerate(accessors):
        if "sparse" in accessor or "bufferView" not in accessor:  # trimesh has zeros there, as many as are declared
            what = "is sparse" if "sparse" in accessor else "has none, or it is compressed"
            raise MeshError(f"accessor {i} of glTF must have all its data; it {what}. Export it plainly.")
    for row in (*accessors, *document.get("bufferViews", [])):
        for key in {"bufferView", "buffer", "count", "byteOffset", "byteLength", "byteStride"} & row.keys():
            if _whole(row[key]) > n_bytes:
                raise MeshError(
                    f"buffers of glTF must hold what is declared; {key} is {row[key]:,} of {n_bytes:,} bytes."
                )
    for mesh_id, mesh in enumerate(document.get("meshes", [])):
        kept = []
        for primitive in mesh["primitives"]:
            mode, position = primitive.get("mode", _TRIANGLES), primitive["attributes"].get("POSITION")
            if mode in _LINES_AND_POINTS or position is None:
                continue
            if mode not in (_TRIANGLES, _STRIP):
                raise MeshError(
                    f"meshes of glTF must be triangles or strips; mesh {mesh_id} has mode {mode!r:.9}, fans."
                )
            _check_kind("POSITION", accessors[_whole(position)])
            kept.append({"mode": mode, "attributes": {"POSITION": position}})
            if "indices" in primitive:
                kept[-1]["indices"] = _whole(primitive["indices"])
                _check_kind("indices", accessors[kept[-1]["indices"]])
        mesh["primitives"] = kept


def _check_kind(role: str, accessor: Json) -> None:
    kind, components = _KINDS[role]
    found = accessor["type"], accessor["componentType"]
    if found[0] != kind or found[1] not in components or (role == "POSITION" and accessor.get("normalized")):
        raise MeshError(
            f"{role} of glTF must be {kind} of component types {components}, not normalized; it is {str(found)[:60]}."
        )


def _prepare_nodes(document: Json, n_allowed: int) -> None:
    """Check that the nodes are a tree and show no more than so many vertices and corners."""
    nodes, accessors, meshes = (document.get(key, []) for key in ("nodes", "accessors", "meshes"))
    if not document.get("scenes"):
        document["scenes"] = [{"nodes": sorted(set(range(len(nodes))).difference(*map(_children, nodes)))}]
    level = list(map(_whole, document["scenes"][_whole(document.get("scene", 0))].get("nodes", [])))
    met: set[int] = set()
    n_rows = sum(accessor["count"] for accessor in accessors)
    for _ in range(_DEEPEST):
        if len(met | set(level)) < len(met) + len(level):
            break
        met.update(level)
        for node in map(nodes.__getitem__, level):
            node.pop("camera", None)  # trimesh passes over such a node and what it holds
            for key in {"matrix", "translation", "rotation", "scale"} & node.keys():
                if not (np.abs(np.array(node[key], dtype=np.float64)) <= LARGEST).all():  # NaN trimesh takes for none
                    raise MeshError(
                        f"the {key} of a node must be finite and below {LARGEST:g}; it is {str(node[key])[:60]}."
                    )
            primitives = meshes[_whole(node["mesh"])]["primitives"] if "mesh" in node else []
            if not primitives:
                node.pop("mesh", None)  # or trimesh passes over it too
            for primitive in primitives:
                ids = primitive["attributes"]["POSITION"], primitive.get("indices", primitive["attributes"]["POSITION"])
                n_corners = accessors[ids[1]]["count"] * (3 if primitive["mode"] == _STRIP else 1)
                n_rows += accessors[ids[0]]["count"] + n_corners
        level = [child for node in level for child in _children(nodes[node])]
    if level:
        raise MeshError(f"the nodes of glTF must be a tree of at most {_DEEPEST} levels; they are not. Flatten them.")
    if n_rows > n_allowed:  # a small file can show the same data without end
        raise MeshError(f"a scene must not repeat its data to {n_rows:,} vertices and corners. Split it.")


def _children(node: Json) -> list[int]:
    return list(map(_whole, node.get("children", [])))


def _whole(value: Any) -> int:
    """Check a count, an offset or an index of the JSON."""
    if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value < 1 << 60:
        raise MeshError(f"counts and indices of glTF must be whole numbers from 0; one is {str(value)[:40]!r}.")
    return value
