"""glTF 2.0 scenes, .gltf or .glb: nodes, meshes and colours; `gltf_data` reads the numbers."""

import json
import math
import re
import struct
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple, TypeVar

import numpy as np

from zbuf_occlude.base.arrays import LARGEST, BoolArray, FloatArray
from zbuf_occlude.base.errors import MeshError
from zbuf_occlude.geometry.camera import rotations_of
from zbuf_occlude.geometry.colors import CLAMP, MIRROR, REPEAT, WHITE, Bytes, Material
from zbuf_occlude.meshes.gltf_data import Attributes, Data, Json, whole
from zbuf_occlude.meshes.mesh_files import MeshFiles
from zbuf_occlude.meshes.polygon_colors import PolygonColors, Textures
from zbuf_occlude.meshes.polygons import Ints, Polygons

_LINES_AND_POINTS, _TRIANGLES, _STRIP, _FAN = (0, 1, 2, 3), 4, 5, 6
_READ = ("EXT_mesh_gpu_instancing", "KHR_draco_mesh_compression", "KHR_mesh_quantization", "KHR_node_visibility")
_HARMLESS = re.compile(r"[A-Z0-9]+_(materials|texture|lights|packing|techniques|animation|audio|xmp|physics)_")
"""Required extensions that do not affect positions and faces."""

_DEEPEST = 200  # levels of nodes
_ROUNDING = 1e-3
"""Tolerance of a quaternion's length and of negative weights: both may be stored with few decimals or as bytes."""
_WRAPS = {10497: REPEAT, 33071: CLAMP, 33648: MIRROR}


Rows = TypeVar("Rows", FloatArray, Ints)


class _Primitive(NamedTuple):
    """The triangles of one primitive, morphed, in the space of its mesh."""

    material_id: int | None
    attributes: Attributes
    positions: FloatArray
    triangles: Ints
    joints: Ints | None = None
    weights: FloatArray | None = None


def read_gltf(data: bytes, files: MeshFiles, *, colors: bool = False) -> tuple[Polygons, PolygonColors | None]:
    """Return the triangles of a glTF scene in world space and, with `colors`, their colours.

    Axes and units are the file's (y up). Triangles come mesh by mesh, in the order of the nodes, parents first.

    Triangles, strips and fans are read; points and lines are left out. Skinned meshes have the pose of the file's
    joints, usually the bind pose. Morph targets are applied with the default weights of node or mesh. All instances
    (EXT_mesh_gpu_instancing) are included; hidden nodes (KHR_node_visibility) are not. Vertices that no triangle uses
    are left out. Without a default scene the first one is read; without scenes, all nodes that are no other's child.
    Faces of mirrored nodes are reversed, so that they keep their orientation. Data that no triangle needs (targets of
    weight 0, animations, normals) are not read.

    Raises
    ------
    MeshError
        The file is not glTF 2, cut short or damaged; a buffer is missing; a required extension is not supported; or the
        file is compressed by meshopt, or by Draco without the package DracoPy (extra `draco`).
    """
    try:
        document, binary = _split(data)
        scene = _Scene(document, Data(document, binary, files))
        positions, triangles = scene.flattened()
        polygon_colors = scene.colors(triangles.reshape(-1)) if colors else None
    except (LookupError, TypeError, AttributeError, ValueError, OverflowError, RecursionError, OSError) as error:
        if isinstance(error, MeshError):
            raise
        # any of these errors may follow from a wrong structure of the JSON
        reason = f"{type(error).__name__}: {' '.join(str(error).split())[:80]}"
        raise MeshError(f"it must be valid glTF 2.0; its structure is broken ({reason}). Is it damaged?") from None
    used, corners = np.unique(triangles, return_inverse=True)
    return Polygons.from_triangles(positions[used], corners), polygon_colors


def _split(data: bytes) -> tuple[Json, bytes | None]:
    """Return the JSON document and the binary chunk of a .glb."""
    binary = None
    if data.startswith(b"glTF"):
        version, declared, n_json, kind = struct.unpack_from("<III4s", data.ljust(20, b"\0"), 4)
        if version != 2 and len(data) >= 8:  # version 1 has another layout of chunks
            raise MeshError(f"a GLB file must be of version 2; it is of version {version}. Export it as glTF 2.0.")
        rest = data[20 + n_json : declared]
        n_binary = int.from_bytes(rest[:4], "little")
        if declared > len(data) or 20 + n_json > declared or len(rest) < n_binary:
            raise MeshError(
                f"a GLB file must have the {declared:,} bytes and the chunks that it declares; it has {len(data):,}. "
                "Is it cut short?"
            )
        if kind != b"JSON":
            raise MeshError(f"a GLB file must begin with JSON; it begins with {kind!r}. Is it damaged?")
        data, binary = data[20 : 20 + n_json], rest[8 : 8 + n_binary] if rest[4:8] == b"BIN\0" else None
    try:
        document = json.loads(data)
    except (ValueError, RecursionError):
        raise MeshError("a glTF file must be JSON; this one is not. Is it damaged or cut short?") from None
    if not str(document["asset"]["version"]).startswith("2."):
        raise MeshError(f"a glTF file must be of version 2; it is of {str(document['asset']['version'])[:20]!r}.")
    required = [str(name)[:60] for name in document.get("extensionsRequired", [])]
    if unknown := [name for name in required if name not in _READ and not _HARMLESS.match(name)]:
        raise MeshError(
            f"a glTF file must not require extensions that are not read; it requires {', '.join(unknown)} "
            f"({', '.join(_READ)} are read). Export it without."
        )
    return document, binary


class _Scene:
    """The nodes of a document, and their meshes."""

    def __init__(self, document: Json, data: Data) -> None:
        self._document, self._data = document, data
        self._nodes, self._meshes = document.get("nodes", []), document.get("meshes", [])
        self._skins = document.get("skins", [])
        scenes = document.get("scenes")
        self._roots = (
            list(map(whole, scenes[whole(document.get("scene", 0))].get("nodes", [])))
            if scenes
            else sorted(set(range(len(self._nodes))).difference(*map(_children, self._nodes)))
        )
        self._primitives: dict[tuple[int, tuple[float, ...]], list[_Primitive]] = {}
        self._shown: list[tuple[_Primitive, int]] = []  # primitives and their numbers of copies, set by `flattened`

    def flattened(self) -> tuple[FloatArray, Ints]:
        """Return all vertices and triangles of the scene."""
        nodes = list(self._walk())
        matrices = {node_id: matrix for node_id, matrix, _ in nodes}
        shown: dict[tuple[int, int | None, tuple[float, ...]], list[FloatArray]] = {}  # by mesh, skin and weights
        for node_id, matrix, is_visible in nodes:
            node = self._nodes[node_id]
            if "mesh" in node and is_visible:
                mesh_id, skin = whole(node["mesh"]), whole(node["skin"]) if "skin" in node else None
                morphed = tuple(map(float, node.get("weights", self._meshes[mesh_id].get("weights", ()))))
                shown.setdefault((mesh_id, skin, morphed), []).extend(self._instances(node, matrix))
        positions, triangles, n_vertices = [np.empty((0, 3))], [np.empty((0, 3), np.int64)], 0
        for (mesh_id, skin, morphed), poses in shown.items():
            for each in self._primitives_of(mesh_id, morphed):
                self._data.count(len(poses) * (len(each.positions) + each.triangles.size))
                moved, mirrored = self._moved(each, skin, np.array(poses), matrices)
                firsts = n_vertices + len(each.positions) * np.arange(len(moved))
                oriented = np.where(mirrored[:, None, None], each.triangles[:, ::-1], each.triangles)
                positions.append(moved.reshape(-1, 3))
                triangles.append((oriented + firsts[:, None, None]).reshape(-1, 3))
                n_vertices += len(positions[-1])
                self._shown.append((each, len(moved)))
        return np.concatenate(positions), np.concatenate(triangles)

    def _walk(self) -> Iterator[tuple[int, FloatArray, bool]]:
        """Yield each node of the scene, its matrix to world space, and whether it is visible; parents first."""
        met: set[int] = set()
        stack = [(node_id, np.eye(4), True, 1) for node_id in reversed(self._roots)]
        while stack:
            node_id, above, is_visible, level = stack.pop()
            if node_id in met or level > _DEEPEST:
                raise MeshError(
                    f"the nodes of glTF must be a tree of at most {_DEEPEST} levels; they are not. Flatten them."
                )
            met.add(node_id)
            node = self._nodes[node_id]
            matrix = above if (own := _local(node)) is None else above @ own
            is_visible &= node.get("extensions", {}).get("KHR_node_visibility", {}).get("visible", True) is not False
            yield node_id, matrix, is_visible
            stack += [(child, matrix, is_visible, level + 1) for child in reversed(_children(node))]

    def _primitives_of(self, mesh_id: int, morphed: tuple[float, ...]) -> list[_Primitive]:
        key = mesh_id, morphed
        if key not in self._primitives:
            found = [self._primitive(mesh_id, each, morphed) for each in self._meshes[mesh_id]["primitives"]]
            self._primitives[key] = [each for each in found if each is not None]
        return self._primitives[key]

    def _primitive(self, mesh_id: int, primitive: Json, morphed: Sequence[float]) -> _Primitive | None:
        mode = primitive.get("mode", _TRIANGLES)
        if mode in _LINES_AND_POINTS or "POSITION" not in primitive["attributes"]:
            return None
        if mode not in (_TRIANGLES, _STRIP, _FAN):
            raise MeshError(f"meshes of glTF must be triangles, strips or fans; mesh {mesh_id} has mode {mode!r:.9}.")
        attributes = self._data.attributes(primitive)
        positions = attributes.floats("POSITION", "POSITION")
        if (triangles := attributes.triangles) is None:
            if "indices" in primitive:
                indices = self._data.integers(primitive["indices"], "indices")[:, 0]
            else:
                indices = np.arange(len(positions))
            triangles = _triangles(mode, indices)
        joints = weights = None
        if "JOINTS_0" in attributes and "WEIGHTS_0" in attributes and self._skins:
            sets = [k for k in range(len(attributes)) if f"JOINTS_{k}" in attributes and f"WEIGHTS_{k}" in attributes]
            joints = np.hstack(
                [_per_vertex(positions, attributes.integers(f"JOINTS_{k}", "JOINTS"), "JOINTS") for k in sets]
            )
            weights = np.hstack(
                [_per_vertex(positions, attributes.floats(f"WEIGHTS_{k}", "WEIGHTS"), "WEIGHTS") for k in sets]
            )
            if (weights < -_ROUNDING).any():
                raise MeshError(
                    f"the weights of joints must not be negative; one is {weights.min():g}. Export the mesh again."
                )
            weights = np.maximum(weights, 0.0)
        material_id = whole(primitive["material"]) if "material" in primitive else None
        positions = self._morphed(positions, primitive, morphed)
        return _Primitive(
            material_id, attributes, positions, _check_indices(triangles, len(positions)), joints, weights
        )

    def _morphed(self, positions: FloatArray, primitive: Json, weights: Sequence[float]) -> FloatArray:
        """Return positions (n, 3) plus the weighted morph targets of a primitive."""
        targets = primitive.get("targets", ())
        if (targets and len(weights) not in (0, len(targets))) or not all(abs(weight) <= LARGEST for weight in weights):
            raise MeshError(
                f"the weights of {len(targets)} morph targets must be as many numbers; they are "
                f"{str(list(weights))[:60]}. Export the mesh again."
            )
        for target, weight in zip(targets, weights, strict=False):
            if weight and "POSITION" in target:
                offsets = self._data.floats(target["POSITION"], "target POSITION")
                with np.errstate(all="ignore"):  # `Polygons` checks for overflow where a triangle uses it
                    positions = positions + weight * _per_vertex(positions, offsets, "targets")
        return positions

    def _moved(
        self, primitive: _Primitive, skin_id: int | None, poses: FloatArray, matrices: dict[int, FloatArray]
    ) -> tuple[FloatArray, BoolArray]:
        """Return a primitive's positions (k, n, 3) in k poses, world space, and the mask of mirrored poses."""
        if skin_id is None or primitive.joints is None or primitive.weights is None:
            with np.errstate(all="ignore"):  # `Polygons` checks for overflow where a triangle uses it
                moved = np.einsum("kab,vb->kva", poses[:, :3, :3], primitive.positions) + poses[:, None, :3, 3]
            return moved, np.linalg.det(poses[:, :3, :3]) < 0
        skin = self._skins[skin_id]
        ids = list(map(whole, skin["joints"]))
        if unplaced := [joint for joint in ids if joint not in matrices]:
            raise MeshError(
                f"the joints of a skin must be nodes of the scene; node {unplaced[0]} is not. Export it again."
            )
        posed = np.array([matrices[joint] for joint in ids])
        if "inverseBindMatrices" in skin:  # column-major, as all matrices of glTF
            binds = self._data.floats(skin["inverseBindMatrices"], "inverseBindMatrices").reshape(-1, 4, 4)
            if len(binds) < len(ids):
                raise MeshError(
                    f"a skin of {len(ids)} joints must have as many inverse bind matrices; it has {len(binds)}. Is the "
                    "file damaged?"
                )
            posed = posed @ binds[: len(ids)].transpose(0, 2, 1)
        total = primitive.weights.sum(axis=1, keepdims=True)
        weights = np.divide(primitive.weights, total, out=np.zeros_like(primitive.weights), where=total > 0)
        blended = np.einsum("vj,vjab->vab", weights, posed[primitive.joints])
        blended[total[:, 0] <= 0] = np.eye(4)
        moved = np.einsum("vab,vb->va", blended[:, :3, :3], primitive.positions) + blended[:, :3, 3]
        # the node of a skinned mesh does not move it: all its poses are one
        return moved[None], np.array([np.linalg.det(posed[:, :3, :3]).mean() < 0])

    def _instances(self, node: Json, matrix: FloatArray) -> Iterator[FloatArray]:
        """Yield the matrices of a node's mesh: its own, or those of its instances."""
        instancing = node.get("extensions", {}).get("EXT_mesh_gpu_instancing")
        if instancing is None:
            yield matrix
            return
        attributes = instancing["attributes"]
        given = {
            name: self._data.floats(attributes[name], name)
            for name in ("TRANSLATION", "ROTATION", "SCALE")
            if name in attributes
        }
        for row in range(min(map(len, given.values()))):
            local = _local({name.lower(): values[row].tolist() for name, values in given.items()})
            yield matrix if local is None else matrix @ local

    def colors(self, corners: Ints) -> PolygonColors:
        """Return the colours of the triangles of `flattened`, given their vertices (3 f,).

        Colours are linear, as the standard says. A primitive without a material is white. Without a texture that cannot
        be read (Basis Universal, a missing file) the material's factor is used.
        """
        textures, materials = Textures(), [WHITE]
        numbers: dict[Any, int] = {None: 0}
        colors, uvs, ids = [np.empty((0, 3))], [np.empty((0, 2))], [np.empty(0, np.int64)]
        for primitive, n_copies in self._shown:
            attributes, material_id, n_vertices = primitive.attributes, primitive.material_id, len(primitive.positions)
            material = {} if material_id is None else self._document["materials"][material_id]
            texture, factor = _base_color(material)
            if material_id not in numbers:
                numbers[material_id] = len(materials)
                name_and_share = str(material.get("name", "")), _transmittance(material)
                materials.append(Material(factor, *self._image(texture, textures), *name_and_share))
            own: FloatArray = np.ones((n_vertices, 3))
            if "COLOR_0" in attributes:
                own = _per_vertex(primitive.positions, attributes.floats("COLOR_0", "COLOR_0")[:, :3], "COLOR_0")
            uv: FloatArray = np.full((n_vertices, 2), np.nan)
            if texture is not None:
                transform = texture.get("extensions", {}).get("KHR_texture_transform", {})
                name = f"TEXCOORD_{whole(transform.get('texCoord', texture.get('texCoord', 0)))}"
                if name in attributes:
                    own_uv = _per_vertex(primitive.positions, attributes.floats(name, "TEXCOORD"), name)
                    uv = _transformed(own_uv, transform)
            colors.append(np.tile(own, (n_copies, 1)))
            uvs.append(np.tile(uv, (n_copies, 1)))
            ids.append(np.full(n_copies * len(primitive.triangles), numbers[material_id]))
        owners, corner_uv = np.concatenate(ids), np.concatenate(uvs)[corners]
        # triangles without texture coordinates have their material without its texture
        bare = ~np.isfinite(corner_uv).reshape(len(owners), 6).all(axis=1)
        return PolygonColors(
            (*materials, *(material._replace(texture=None) for material in materials)),
            np.where(bare, owners + len(materials), owners),
            np.clip(np.nan_to_num(np.concatenate(colors)[corners]), 0.0, 1.0),
            np.nan_to_num(corner_uv),
            linear=True,
            warnings=tuple(textures.warnings),
        )

    def _image(self, texture: Json | None, textures: Textures) -> tuple[Bytes | None, tuple[str, str]]:
        """Return the image of a texture and its wrap modes along u and v."""
        if texture is None:
            return None, (REPEAT, REPEAT)
        row = self._document["textures"][whole(texture["index"])]
        source = row.get("extensions", {}).get("EXT_texture_webp", {}).get("source", row.get("source"))
        sampler = self._document["samplers"][whole(row["sampler"])] if "sampler" in row else {}
        along_u, along_v = (_WRAPS.get(sampler.get(name, 10497), REPEAT) for name in ("wrapS", "wrapT"))
        if source is None:
            textures.warnings["a texture of an extension that is not read"] = None
            return None, (along_u, along_v)
        image = self._document["images"][whole(source)]
        uri = str(image.get("uri", f"image {source}"))
        name = f"image {source}" if uri.startswith("data:") else uri
        return textures.get(name, lambda: self._data.image(image)), (along_u, along_v)


def _triangles(mode: int, indices: Ints) -> Ints:
    """Return the triangles (f, 3) of a primitive; every second one of a strip is reversed, as the standard says."""
    if mode == _TRIANGLES:
        return indices[: len(indices) // 3 * 3].reshape(-1, 3)
    if len(indices) < 3:
        return np.empty((0, 3), np.int64)
    if mode == _FAN:
        return np.stack([indices[1:-1], indices[2:], np.full(len(indices) - 2, indices[0])], axis=1)
    triangles = np.stack([indices[:-2], indices[1:-1], indices[2:]], axis=1)
    triangles[1::2] = triangles[1::2, [1, 0, 2]]
    return triangles


def _per_vertex(positions: FloatArray, rows: Rows, name: str) -> Rows:
    """Return rows unchanged; raise MeshError unless there is one for each vertex."""
    if len(rows) != len(positions):
        raise MeshError(
            f"{name} of glTF must have a row for each of the {len(positions)} vertices of the primitive; there are "
            f"{len(rows)}. Is the file damaged?"
        )
    return rows


def _check_indices(indices: Ints, n_vertices: int) -> Ints:
    if indices.size and not 0 <= indices.min() <= indices.max() < n_vertices:
        raise MeshError(
            f"triangles must refer to the {n_vertices} vertices of their primitive by 0 to {n_vertices - 1}; "
            f"one refers to {indices.max()}. Is the file damaged?"
        )
    return indices


def _unit(rotation: Sequence[float]) -> Sequence[float]:
    """Return a quaternion scaled to length 1; unchanged if it has length 1 but for rounding."""
    length = math.hypot(*rotation)
    if abs(length - 1.0) < _ROUNDING:
        return rotation
    if not length:
        raise MeshError("the rotation of a node must be a quaternion of length 1; it is of length 0. Export it again.")
    return [each / length for each in rotation]


def _children(node: Json) -> list[int]:
    return list(map(whole, node.get("children", [])))


def _local(node: Json) -> FloatArray | None:
    """Return a node's own matrix; None for a node without a transform."""
    if not {"matrix", "translation", "rotation", "scale"} & node.keys():
        return None
    for key, size in (("matrix", 16), ("translation", 3), ("rotation", 4), ("scale", 3)):
        if key in node:
            values = np.array(node[key], dtype=np.float64)
            if values.shape != (size,) or not (np.abs(values) <= LARGEST).all():
                raise MeshError(
                    f"the {key} of a node must be finite and below {LARGEST:g}, {size} numbers; "
                    f"it is {str(node[key])[:60]}."
                )
    if "matrix" in node:
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    matrix = np.eye(4)
    matrix[:3, :3] = rotations_of(_unit(node.get("rotation", (0.0, 0.0, 0.0, 1.0))))
    matrix[:3, :3] *= np.array(node.get("scale", (1.0, 1.0, 1.0)))
    matrix[:3, 3] = node.get("translation", (0.0, 0.0, 0.0))
    return matrix


def _base_color(material: Json) -> tuple[Json | None, tuple[float, float, float]]:
    """Return a material's base colour texture, if it has one, and its factor."""
    old = material.get("extensions", {}).get("KHR_materials_pbrSpecularGlossiness")
    found = material.get("pbrMetallicRoughness")
    if found is None and old is not None:
        texture, factor = old.get("diffuseTexture"), old.get("diffuseFactor", WHITE.factor)
    else:
        texture = (found or {}).get("baseColorTexture")
        factor = (found or {}).get("baseColorFactor", WHITE.factor)
    red, green, blue = np.clip(np.nan_to_num([float(each) for each in factor[:3]]), 0.0, 1.0).tolist()
    return texture, (red, green, blue)


def _transmittance(material: Json) -> float:
    """Return the share of light that a material lets pass, by blended alpha and by KHR_materials_transmission."""
    factor = [*material.get("pbrMetallicRoughness", {}).get("baseColorFactor", ()), 1.0, 1.0, 1.0, 1.0]
    alpha = float(factor[3]) if material.get("alphaMode") == "BLEND" else 1.0
    through = float(material.get("extensions", {}).get("KHR_materials_transmission", {}).get("transmissionFactor", 0.0))
    return float(np.clip(np.nan_to_num(1.0 - alpha * (1.0 - through)), 0.0, 1.0))


def _transformed(uv: FloatArray, transform: Json) -> FloatArray:
    """Return texture coordinates (n, 2) after KHR_texture_transform, with v upwards as in `SurfaceColors`."""
    angle = float(transform.get("rotation", 0.0))
    with np.errstate(all="ignore"):  # coordinates that become NaN count as missing
        scaled = uv * np.array(transform.get("scale", (1.0, 1.0)), dtype=np.float64)
        c, s = math.cos(angle), math.sin(angle)
        offset = np.array(transform.get("offset", (0.0, 0.0)), dtype=np.float64)
        moved = scaled @ np.array([[c, -s], [s, c]]) + offset
    return np.stack([moved[:, 0], 1.0 - moved[:, 1]], axis=1)
