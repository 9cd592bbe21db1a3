"""What glTF adds to plain meshes: sparse data, instances, skins, compressed and hostile files."""

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from tests.meshes.test_gltf import CORNERS, Document, as_document, data_uri, read
from zbuf_occlude import MeshError, load_mesh


class Builder:
    """Appends arrays to a document's only buffer as accessors."""

    def __init__(self) -> None:
        self.document: Document = {"asset": {"version": "2.0"}, "bufferViews": [], "accessors": []}
        self.blob = b""

    def view(self, values: np.ndarray) -> int:
        self.document["bufferViews"].append({"buffer": 0, "byteOffset": len(self.blob), "byteLength": values.nbytes})
        self.blob += values.tobytes()
        return len(self.document["bufferViews"]) - 1

    def accessor(self, values: np.ndarray, **more: Any) -> int:
        kinds = {"float32": 5126, "uint16": 5123, "uint8": 5121}
        shapes = {(): "SCALAR", (3,): "VEC3", (4,): "VEC4", (4, 4): "MAT4"}
        row = {"componentType": kinds[values.dtype.name], "type": shapes[values.shape[1:]], "count": len(values)}
        self.document["accessors"].append({"bufferView": self.view(values), **row, **more})
        return len(self.document["accessors"]) - 1

    def finished(self, **document: Any) -> Document:
        self.document |= {"scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}], **document}
        self.document["buffers"] = [{"byteLength": len(self.blob), "uri": data_uri(self.blob)}]
        return self.document


@pytest.mark.parametrize("based", [True, False])
def test_sparse_positions(based: bool) -> None:
    built = Builder()
    base = np.zeros((3, 3), "<f4") if not based else CORNERS[:3].copy()
    position = built.accessor(base)
    rows, values = np.array([1, 2], "<u2"), np.array([[7, 0, 0], [0, 8, 0]], "<f4")
    accessor = built.document["accessors"][position]
    accessor["sparse"] = {
        "count": 2,
        "indices": {"bufferView": built.view(rows), "componentType": 5123},
        "values": {"bufferView": built.view(values)},
    }
    if not based:
        del accessor["bufferView"]
    document = built.finished(meshes=[{"primitives": [{"attributes": {"POSITION": position}}]}])
    assert read(document).tolist() == [[[0, 0, 0], [7, 0, 0], [0, 8, 0]]]


def test_what_no_triangle_needs_refuses_nothing() -> None:
    document = as_document(CORNERS[:3])
    document["accessors"] += [
        {"componentType": 5126, "type": "VEC3", "count": 3},  # a morph target of zeros, without data
        {"componentType": 5126, "type": "VEC3", "count": 3, "sparse": {"count": 1, "indices": {}, "values": {}}},
        {"componentType": 99, "type": "?", "count": -1},
    ]
    document["meshes"][0]["primitives"][0]["targets"] = [{"POSITION": 1}, {"POSITION": 2}]
    document["buffers"].append({"uri": "nowhere.bin", "byteLength": 3})
    assert read(document).tolist() == [CORNERS[:3].tolist()]


def test_instances_are_all_shown() -> None:
    built = Builder()
    position = built.accessor(CORNERS[:3])
    moves, half = np.array([[1, 0, 0], [0, 2, 0]], "<f4"), 2**-0.5
    turns = np.array([[0, 0, 0, 1], [0, 0, half, half]], "<f4")
    attributes = {"TRANSLATION": built.accessor(moves), "ROTATION": built.accessor(turns)}
    node = {"mesh": 0, "translation": [0, 0, 5], "extensions": {"EXT_mesh_gpu_instancing": {"attributes": attributes}}}
    document = built.finished(
        meshes=[{"primitives": [{"attributes": {"POSITION": position}}]}], nodes=[node],
        extensionsUsed=["EXT_mesh_gpu_instancing"], extensionsRequired=["EXT_mesh_gpu_instancing"],
    )  # fmt: skip
    expected = [[[1, 0, 5], [2, 0, 5], [1, 1, 5]], [[0, 2, 5], [0, 3, 5], [-1, 2, 5]]]
    assert np.allclose(read(document), expected, atol=1e-6)


@pytest.mark.parametrize("raised", [0.0, 3.0])
def test_skins_stand_as_their_joints_do(raised: float) -> None:
    """The mesh's own node does not move it; joints in the bind pose leave it where it was bound."""
    built = Builder()
    position = built.accessor(CORNERS[:3])
    joints = built.accessor(np.array([[0, 1, 0, 0]] * 3, "u1"))
    weights = built.accessor(np.array([[1, 0, 0, 0], [0.5, 0.5, 0, 0], [0, 1, 0, 0]], "<f4"))
    binds = np.stack([np.eye(4), np.eye(4)]).astype("<f4")
    binds[1, 3, :3] = [0, -2, 0]  # columns first: the second joint was bound 2 up
    attributes = {"POSITION": position, "JOINTS_0": joints, "WEIGHTS_0": weights}
    document = built.finished(
        meshes=[{"primitives": [{"attributes": attributes}]}],
        skins=[{"joints": [1, 2], "inverseBindMatrices": built.accessor(binds)}],
        nodes=[
            {"mesh": 0, "skin": 0, "translation": [100, 0, 0]},
            {"children": [2]},
            {"translation": [0, 2 + raised, 0]},
        ],
        scenes=[{"nodes": [0, 1]}],
    )
    assert np.allclose(read(document), [CORNERS[:3] + np.array([[0, 0, 0], [0, raised / 2, 0], [0, raised, 0]])])


def skinned(
    weights: Any, *, joints: Any = ((0, 1, 0, 0),) * 3, n_binds: int = 2, shown: Any = (0, 1), more: Any = None
) -> Document:
    """A triangle held by two joints, the second of which stands 3 above where it was bound."""
    built = Builder()
    attributes = {"POSITION": built.accessor(CORNERS[:3]), "JOINTS_0": built.accessor(np.array(joints, "u1"))}
    attributes["WEIGHTS_0"] = built.accessor(np.array(weights, "<f4"))
    if more is not None:
        attributes["JOINTS_1"] = built.accessor(np.array([[1, 0, 0, 0]] * 3, "u1"))
        attributes["WEIGHTS_1"] = built.accessor(np.array(more, "<f4"))
    skin: dict[str, Any] = {"joints": [1, 2]}
    if n_binds:
        skin["inverseBindMatrices"] = built.accessor(np.stack([np.eye(4)] * n_binds).astype("<f4"))
    return built.finished(
        meshes=[{"primitives": [{"attributes": attributes}]}],
        skins=[skin],
        nodes=[{"mesh": 0, "skin": 0}, {"children": [2]}, {"translation": [0, 3, 0]}],
        scenes=[{"nodes": list(shown)}],
    )


@pytest.mark.parametrize("n_binds", [2, 0])
def test_a_skin_may_have_eight_weights_a_vertex_and_no_bind_matrices(n_binds: int) -> None:
    document = skinned(
        [[1, 0, 0, 0], [0.5, 0, 0, 0], [2e-7, 0, 0, 0]], n_binds=n_binds, more=[[0] * 4, [0.5, 0, 0, 0], [0] * 4]
    )
    assert np.allclose(read(document), [CORNERS[:3] + np.array([[0, 0, 0], [0, 1.5, 0], [0, 0, 0]])])


@pytest.mark.parametrize(
    ("document", "message"),
    [
        (
            skinned([[1, 0, 0, 0], [1, 0, 0, 0], [1, -0.99999, 0, 0]]),
            "weights of joints must not be negative; one is -0.99999",
        ),
        (
            skinned([[1, 0, 0, 0]] * 3, n_binds=1),
            "a skin of 2 joints must have as many inverse bind matrices; it has 1",
        ),
        (skinned([[1, 0, 0, 0]] * 3, shown=[0]), "joints of a skin must be nodes of the scene; node 1 is not"),
    ],
)
def test_skins_that_would_pull_a_mesh_apart_are_refused(document: Document, message: str) -> None:
    with pytest.raises(MeshError, match=message):
        read(document)


def test_weights_that_rounding_made_negative_are_none() -> None:
    document = skinned([[1, -1e-4, 0, 0], [1, 0, 0, 0], [-1e-7, 1.0000001e-7, 0, 0]])
    assert np.allclose(read(document), [CORNERS[:3] + np.array([[0, 0, 0], [0, 0, 0], [0, 3, 0]])])


@pytest.mark.parametrize("length", [0.5, 1.0, 2.0])
def test_rotations_of_another_length_turn_all_the_same(length: float) -> None:
    """And are what trimesh makes of them."""
    document = as_document(CORNERS[:3])
    turn = length * np.array([0.36, 0.48, 0, 0.8])
    document["nodes"] = [{"mesh": 0, "rotation": turn.tolist()}]
    matrix = trimesh.transformations.quaternion_matrix(np.roll(turn, 1))[:3, :3]
    assert np.allclose(read(document), [CORNERS[:3] @ matrix.T])


def test_a_rotation_of_no_length_is_refused() -> None:
    document = as_document(CORNERS[:3])
    document["nodes"] = [{"mesh": 0, "rotation": [0, 0, 0, 0]}]
    with pytest.raises(MeshError, match="rotation of a node must be a quaternion of length 1; it is of length 0"):
        read(document)


def draco_document() -> Document:
    draco = pytest.importorskip("DracoPy", reason="the package DracoPy is not installed")
    ball = trimesh.creation.icosphere(subdivisions=2)
    data = draco.encode(ball.vertices, ball.faces, quantization_bits=16)
    built = Builder()
    view = built.view(np.frombuffer(data, np.uint8))
    count = {"componentType": 5126, "type": "VEC3", "count": len(ball.vertices)}
    built.document["accessors"].append(count)
    primitive = {
        "attributes": {"POSITION": 0},
        "extensions": {"KHR_draco_mesh_compression": {"bufferView": view, "attributes": {"POSITION": 0}}},
    }
    return built.finished(
        meshes=[{"primitives": [primitive]}], nodes=[{"mesh": 0, "translation": [5, 0, 0]}],
        extensionsRequired=["KHR_draco_mesh_compression"],
    )  # fmt: skip


def test_draco() -> None:
    found = read(draco_document())
    assert found.shape == (320, 3, 3)
    assert np.allclose(np.linalg.norm(found - [5, 0, 0], axis=2), 1, atol=1e-3)


def test_damaged_draco_and_none_at_all_are_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    document = draco_document()
    document["bufferViews"][0]["byteLength"] //= 2
    with pytest.raises(MeshError, match="compressed by Draco must be sound; DracoPy cannot read it"):
        read(document)
    monkeypatch.setitem(sys.modules, "DracoPy", None)
    with pytest.raises(MeshError, match=r"needs the package DracoPy; it is missing.*zbuf-occlude\[draco\]"):
        read(draco_document_of_bytes())


def draco_document_of_bytes() -> Document:
    built = Builder()
    view = built.view(np.zeros(8, np.uint8))
    extension = {"KHR_draco_mesh_compression": {"bufferView": view, "attributes": {}}}
    primitive = {"attributes": {"POSITION": 0}, "extensions": extension}
    return built.finished(meshes=[{"primitives": [primitive]}])


def test_meshopt_without_a_fallback_is_one_line() -> None:
    document = as_document(CORNERS[:3])
    document["buffers"] = [{"byteLength": 36}]
    document["bufferViews"][0]["extensions"] = {"EXT_meshopt_compression": {"buffer": 1, "mode": "ATTRIBUTES"}}
    with pytest.raises(MeshError, match=r"must have data; it is compressed by meshopt\. Export it plainly"):
        read(document)


def test_a_thousand_nodes() -> None:
    document = as_document(CORNERS[:3])
    document["nodes"] = [{"mesh": 0, "translation": [i, 0, 0]} for i in range(1_000)]
    document["scenes"] = [{"nodes": list(range(1_000))}]
    assert read(document)[:, 0, 0].tolist() == list(range(1_000))


def test_hostile_files_read_nothing_twice(tmp_path: Path) -> None:
    """20,000 buffers that are the file itself; 200 that are one file: only what is shown is read, and once."""
    document = as_document(CORNERS[:3])
    document["buffers"] += [{"uri": "self.gltf", "byteLength": 1}] * 20_000
    document["bufferViews"] += [{"buffer": i + 1, "byteLength": 1} for i in range(20_000)]
    (tmp_path / "self.gltf").write_text(json.dumps(document))
    origin = load_mesh(tmp_path / "self.gltf").origin
    assert [file.name for file in origin.files] == ["self.gltf"]
    (tmp_path / "one.bin").write_bytes(CORNERS.tobytes())
    document = as_document(CORNERS[:3])
    document["buffers"] = [{"uri": "one.bin", "byteLength": 60}] * 200
    document["bufferViews"] = [{"buffer": i, "byteLength": 36} for i in range(200)]
    document["accessors"] = [{**document["accessors"][0], "bufferView": i} for i in range(200)]
    document["meshes"][0]["primitives"] = [{"attributes": {"POSITION": i}} for i in range(200)]
    (tmp_path / "many.gltf").write_text(json.dumps(document))
    mesh = load_mesh(tmp_path / "many.gltf")
    assert mesh.dropped["duplicate"] == 199
    assert [file.name for file in mesh.origin.files] == ["many.gltf", "one.bin"]
