"""Ten features of glTF in four encodings: the same triangles, known in closed form; meshopt is refused by name."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.gltf import Builder, Document
from zbuf_occlude import MeshError
from zbuf_occlude.meshes.gltf import read_gltf
from zbuf_occlude.meshes.mesh_files import MeshFiles

PLAIN, QUANTISED, DRACO, MESHOPT = ENCODINGS = ("plain", "quantised", "draco", "meshopt")
STEPS = 16
"""Steps of a quantised position in a unit; all positions here are whole numbers of them."""
CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [0.5, 2, 1]])
FACES = np.array([[0, 1, 2], [2, 1, 3], [2, 3, 4]])
INDICES = FACES.ravel()
JOINTS = np.array([[0, 1, 0, 0]] * 5, "u1")
WEIGHTS = np.array([[1, 0, 0, 0], [0.2, 0.8, 0, 0], [0, 1, 0, 0], [0.6, 0.4, 0, 0], [1, 0, 0, 0]])
Written = tuple[Document, np.ndarray]


class Writer(Builder):
    """Document whose positions and morph targets are in one encoding; `scale` leads from these numbers to lengths."""

    def __init__(self, encoding: str) -> None:
        super().__init__()
        self.encoding = encoding
        self.scale = 1.0 / STEPS if encoding == QUANTISED else 1.0

    def lengths(self, values: np.ndarray) -> np.ndarray:
        """Return lengths as they are stored."""
        return (values / self.scale).astype("<i2" if self.encoding == QUANTISED else "<f4")

    def primitive(self, indices: np.ndarray | None = INDICES, kind: str = "<u2", **attributes: Any) -> Document:
        """Return a primitive of triangles: `CORNERS`, and other attributes."""
        if self.encoding == DRACO:
            faces = FACES if indices is None else indices.reshape(-1, 3)
            found = self.draco(faces, POSITION=CORNERS.astype("<f4"), **attributes)
            self.document["accessors"].append({"componentType": 5123, "type": "SCALAR", "count": faces.size})
            return found | {"indices": len(self.document["accessors"]) - 1}
        corners = CORNERS[FACES.ravel()] if indices is None else CORNERS
        found = {"attributes": {"POSITION": self.accessor(self.lengths(corners))}}
        for name, values in attributes.items():
            found["attributes"][name] = self.accessor(values, normalized=name == "WEIGHTS_0" and values.dtype == "u1")
        return found if indices is None else found | {"indices": self.accessor(indices.astype(kind))}

    def shown(self, primitives: Sequence[Document], *outer: Document, **document: Any) -> Document:
        """Return the document: a mesh of some primitives below nodes in a chain, its lengths scaled in the last."""
        nodes = [{**node, "children": [number + 1]} for number, node in enumerate(outer)]
        nodes.append({"mesh": 0, "scale": [self.scale] * 3})
        mesh = {"primitives": list(primitives), **document.pop("mesh", {})}
        return self.finished(**{"meshes": [mesh], "nodes": nodes, **document})

    def finished(self, **document: Any) -> Document:
        """Return the document with its extension required; meshopt has no other data for the positions."""
        required = {QUANTISED: "KHR_mesh_quantization", DRACO: "KHR_draco_mesh_compression"}.get(self.encoding)
        required_all = [*([required] if required else []), *document.pop("required", [])]
        found = super().finished(**document, extensionsRequired=required_all, extensionsUsed=required_all)
        if self.encoding == MESHOPT:
            found["buffers"].append({"byteLength": len(self.blob)})
            packed = {"buffer": 0, "byteLength": 9, "byteStride": 12, "count": 5, "mode": "ATTRIBUTES"}
            for view in found["bufferViews"]:
                view |= {"buffer": 1, "extensions": {"EXT_meshopt_compression": packed}}
        return found


# ---- features --------------------------------------------------------------------------------------------------------


def positions(encoding: str) -> Written:
    """Without indices, but in Draco."""
    built = Writer(encoding)
    return built.shown([built.primitive(None)]), CORNERS[FACES]


def kinds_of_indices(encoding: str) -> Written:
    """Bytes, shorts and ints; some faces by each."""
    built = Writer(encoding)
    parts = [built.primitive(face, kind) for face, kind in zip(FACES, ("u1", "<u2", "<u4"), strict=True)]
    return built.shown(parts), CORNERS[FACES]


def normalised_integers(encoding: str) -> Written:
    """Positions as fractions of 32,767 where the encoding has them, else the weights of a skin as those of 255."""
    fractions = np.array([[32767, 0, -32768], [0, 16384, 0], [-32767, 0, 300]], "<i2")
    built = Builder()
    if encoding in (PLAIN, MESHOPT):
        return skins(encoding, "u1")
    if encoding == DRACO:
        primitive = built.draco(np.array([[0, 1, 2]]), POSITION=fractions)
    else:
        primitive = {"attributes": {"POSITION": built.accessor(fractions, normalized=True)}}
    required = {QUANTISED: "KHR_mesh_quantization", DRACO: "KHR_draco_mesh_compression"}[encoding]
    document = built.finished(
        meshes=[{"primitives": [primitive]}], extensionsRequired=[required], extensionsUsed=[required]
    )
    return document, np.maximum(fractions / 32767, -1.0)[None]


def sparse_accessors(encoding: str) -> Written:
    """A morph target of which two rows are stored."""
    built = Writer(encoding)
    primitive = built.primitive()
    rows, moves = np.array([1, 4], "<u2"), np.array([[0, 0, 2], [3, 0, 0.5]])
    kind = 5122 if encoding == QUANTISED else 5126
    indices = {"bufferView": built.view(rows), "componentType": 5123}
    sparse = {"count": 2, "indices": indices, "values": {"bufferView": built.view(built.lengths(moves))}}
    built.document["accessors"].append({"componentType": kind, "type": "VEC3", "count": 5, "sparse": sparse})
    primitive["targets"] = [{"POSITION": len(built.document["accessors"]) - 1}]
    expected = CORNERS.copy()
    expected[rows] += moves
    return built.shown([primitive], mesh={"weights": [1.0]}), expected[FACES]


def default_weights_of_morph_targets(encoding: str) -> Written:
    built = Writer(encoding)
    primitive = built.primitive()
    first, second = np.tile([0.0, 0.0, 2.0], (5, 1)), CORNERS * [0, 1, 0]
    primitive["targets"] = [{"POSITION": built.accessor(built.lengths(each))} for each in (first, second)]
    return built.shown([primitive], mesh={"weights": [0.5, -2.0]}), (CORNERS + 0.5 * first - 2.0 * second)[FACES]


def skins(encoding: str, kind: str = "<f4") -> Written:
    """Two joints: the second was bound 2 up, and stands 5 up and turned by a quarter about z."""
    built, half = Writer(encoding), 2**-0.5
    weights = WEIGHTS.astype(kind) if kind == "<f4" else np.round(255 * WEIGHTS).astype(kind)
    primitive = built.primitive(JOINTS_0=JOINTS, WEIGHTS_0=weights)
    binds = np.stack([np.eye(4), np.eye(4)])
    binds[1, :3, 3] = [0, -2, 0]
    in_lengths = np.diag([built.scale] * 3 + [1.0])  # a skinned mesh ignores its node: lengths are scaled here
    skin = {"joints": [1, 2], "inverseBindMatrices": built.accessor((binds @ in_lengths).mT.astype("<f4"))}
    nodes = [
        {"mesh": 0, "skin": 0, "translation": [100, 0, 0]},
        {"children": [2]},
        {"translation": [0, 5, 0], "rotation": [0, 0, half, half]},
    ]
    document = built.finished(
        meshes=[{"primitives": [primitive]}], skins=[skin], nodes=nodes, scenes=[{"nodes": [0, 1]}]
    )
    moved = (CORNERS - [0, 2, 0]) @ np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1]]) + [0, 5, 0]
    return document, (WEIGHTS[:, :1] * CORNERS + WEIGHTS[:, 1:2] * moved)[FACES]


def hierarchy_of_nodes(encoding: str) -> Written:
    """A matrix that mirrors, turns and stretches, above a translation, a turn and a scale."""
    built, half = Writer(encoding), 2**-0.5
    matrix = np.array([[0, -1, 0, 3], [-1, 0, 0, 0], [0, 0, 2, -1], [0, 0, 0, 1]])
    inner = {"translation": [10, 0, 0], "rotation": [0, 0, half, half], "scale": [2, 3, 4]}
    document = built.shown([built.primitive()], {"matrix": matrix.T.ravel().tolist()}, inner)
    turned = (CORNERS * [2, 3, 4]) @ np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1]]) + [10, 0, 0]
    return document, (turned @ matrix[:3, :3].T + matrix[:3, 3])[FACES]


def instances(encoding: str) -> Written:
    built, half = Writer(encoding), 2**-0.5
    primitive, moves = built.primitive(), np.array([[1, 0, 0], [0, 2, 0]], "<f4")
    turns = np.array([[0, 0, 0, 1], [0, 0, half, half]], "<f4")
    attributes = {"TRANSLATION": built.accessor(moves), "ROTATION": built.accessor(turns)}
    attributes["SCALE"] = built.accessor(np.full((2, 3), built.scale, "<f4"))
    extension = {"EXT_mesh_gpu_instancing": {"attributes": attributes}}
    document = built.finished(
        meshes=[{"primitives": [primitive]}], required=list(extension),
        nodes=[{"mesh": 0, "translation": [0, 0, 5], "extensions": extension}],
    )  # fmt: skip
    turned = CORNERS @ np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1]])
    shown = [CORNERS + moves[0] + [0, 0, 5], turned + moves[1] + [0, 0, 5]]
    return document, np.concatenate([each[FACES] for each in shown])


def interleaved_buffers(encoding: str) -> Written:
    """Positions with a normal and a gap in each row."""
    built = Writer(encoding)
    lengths = built.lengths(CORNERS)
    kind = [("gap", "<f4"), ("position", lengths.dtype.str, 3), ("rest", "u1", 14)]
    rows = np.zeros(5, kind)
    rows["position"], rows["rest"] = lengths, 99
    view = built.view(rows)
    built.document["bufferViews"][view]["byteStride"] = rows.itemsize
    component = 5122 if encoding == QUANTISED else 5126
    row = {"bufferView": view, "byteOffset": 4, "componentType": component, "type": "VEC3", "count": 5}
    built.document["accessors"].append(row)
    primitive = {"attributes": {"POSITION": 0}, "indices": built.accessor(FACES.ravel().astype("u1"))}
    return built.shown([primitive]), CORNERS[FACES]


def strips_and_fans(encoding: str) -> Written:
    built = Writer(encoding)
    order = np.arange(5, dtype="u1")
    parts = [built.primitive(order, "u1") | {"mode": mode} for mode in (5, 6)]
    fan = [[1, 2, 0], [2, 3, 0], [3, 4, 0]]
    return built.shown(parts), CORNERS[np.concatenate([FACES, fan])]


FEATURES = (
    positions, kinds_of_indices, normalised_integers, sparse_accessors, default_weights_of_morph_targets, skins,
    hierarchy_of_nodes, instances, interleaved_buffers, strips_and_fans,
)  # fmt: skip
CANNOT_BE = {(interleaved_buffers, DRACO), (strips_and_fans, DRACO)}
"""Draco packs attributes and triangles itself: nothing is interleaved, and its encoder makes no strips or fans."""


def sorted_triangles(triangles: np.ndarray) -> np.ndarray:
    """Return triangles with their corners, and themselves, in an order that does not depend on who read them."""
    rounded = np.round(np.asarray(triangles, np.float64), 3) + 0.0
    corners = np.array([sorted(map(tuple, each)) for each in rounded])
    return np.array(sorted(map(tuple, corners.reshape(len(corners), 9))))


CELLS = [(feature, encoding) for feature in FEATURES for encoding in ENCODINGS if (feature, encoding) not in CANNOT_BE]


@pytest.mark.parametrize(("feature", "encoding"), CELLS, ids=lambda value: getattr(value, "__name__", value))
def test_a_feature_in_an_encoding(feature: Callable[[str], Written], encoding: str) -> None:
    document, expected = feature(encoding)
    data, files = json.dumps(document).encode(), MeshFiles(Path("nowhere") / "scene.gltf")
    if encoding == MESHOPT:
        with pytest.raises(MeshError, match="compressed by meshopt"):
            read_gltf(data, files)
        document["extensionsRequired"] = ["EXT_meshopt_compression"]
        with pytest.raises(MeshError, match="it requires EXT_meshopt_compression"):
            read_gltf(json.dumps(document).encode(), files)
        return
    polygons, _ = read_gltf(data, files)
    found = polygons.vertices[polygons.corners].reshape(-1, 3, 3)
    assert np.allclose(sorted_triangles(found), sorted_triangles(expected), atol=2e-3)
