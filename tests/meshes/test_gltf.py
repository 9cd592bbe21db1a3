"""glTF scenes are read as the standard says; what is broken, missing or hostile is refused in words."""

import base64
import copy
import json
import struct
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from tests.gltf import Builder, Document, data_uri
from zbuf_occlude import MeshError, load_mesh
from zbuf_occlude.base.limits import Limits
from zbuf_occlude.meshes.gltf import read_gltf
from zbuf_occlude.meshes.mesh_files import MeshFiles
from zbuf_occlude.meshes.polygons import Polygons

HERE = Path("nowhere")
CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [0.5, 2, 1]], dtype="<f4")


def scene() -> trimesh.Scene:
    """Two shapes, one shown twice and nested, with rotations and scales."""
    built = trimesh.Scene()
    box, ball = trimesh.creation.box((1, 2, 3)), trimesh.creation.icosphere(subdivisions=1)
    turn = trimesh.transformations.rotation_matrix(0.7, [1, 2, 3], [4, 5, 6])
    squeeze = np.diag([1.0, -2.0, 0.5, 1.0])
    built.add_geometry(box, node_name="first", geom_name="box", transform=turn)
    built.add_geometry(ball, node_name="second", geom_name="ball", parent_node_name="first", transform=squeeze)
    built.graph.update("third", "second", matrix=turn, geometry="box")
    return built


def as_document(positions: np.ndarray = CORNERS, indices: np.ndarray | None = None, **primitive: Any) -> Document:
    """The least document that shows one primitive, its buffer inside."""
    built = Builder()
    primitive["attributes"] = {"POSITION": built.accessor(positions)}
    if indices is not None:
        primitive["indices"] = built.accessor(indices)
    return built.finished(scene=0, meshes=[{"primitives": [primitive]}])


def polygons_of(data: bytes, folder: Path = HERE) -> Polygons:
    return read_gltf(data, MeshFiles(folder / "scene.gltf"))[0]


def read(document: Document, folder: Path = HERE) -> np.ndarray:
    polygons = polygons_of(json.dumps(document).encode(), folder)
    return polygons.vertices[polygons.corners].reshape(-1, 3, 3)


def moved(shift: list[float]) -> np.ndarray:
    """The triangle of the first three corners, elsewhere."""
    return np.asarray(CORNERS[:3] + np.array(shift))


def glb(document: Document, blob: bytes) -> bytes:
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    blob += bytes(-len(blob) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(blob), b"BIN\0") + blob
    return b"glTF" + struct.pack("<II", 2, 12 + len(chunks)) + chunks


def test_a_scene_is_flattened_as_trimesh_does_it() -> None:
    polygons = polygons_of(scene().export(file_type="glb"))
    expected = scene().to_mesh().triangles
    found = polygons.vertices[polygons.corners].reshape(-1, 3, 3)
    assert found.shape == expected.shape == (12 + 80 + 12, 3, 3)
    # the same triangles, whatever their order and their first corner (trimesh turns those of a mirrored node over)
    near = np.abs(found.mean(axis=1)[:, None] - expected.mean(axis=1)).max(axis=2).argmin(axis=1)
    assert sorted(near) == list(range(len(expected)))
    assert np.allclose(np.sort(found, axis=1), np.sort(expected[near], axis=1), atol=1e-4)


def test_gltf_with_buffers_beside_it_is_the_same(tmp_path: Path) -> None:
    files = scene().export(file_type="gltf")
    for name, content in files.items():
        (tmp_path / name).write_bytes(content)
    polygons = polygons_of((tmp_path / "model.gltf").read_bytes(), tmp_path)
    packed = polygons_of(scene().export(file_type="glb"))
    assert polygons.vertices.tobytes() == packed.vertices.tobytes()
    assert polygons.corners.tobytes() == packed.corners.tobytes()


def test_gltf_has_y_up_and_other_formats_z(tmp_path: Path) -> None:
    tower = trimesh.creation.box((1, 10, 2))  # ten high where y is up
    tower.apply_translation([0, 5, 0.5])
    for ending in ("glb", "ply"):
        tower.export(tmp_path / f"tower.{ending}")
    assert np.allclose(load_mesh(tmp_path / "tower.glb").bounds, [[-0.5, -1.5, 0], [0.5, 0.5, 10]])
    assert np.allclose(load_mesh(tmp_path / "tower.glb", up="z").bounds, [[-0.5, 0, -0.5], [0.5, 10, 1.5]])
    assert np.allclose(load_mesh(tmp_path / "tower.ply").bounds, [[-0.5, 0, -0.5], [0.5, 10, 1.5]])
    assert np.allclose(load_mesh(tmp_path / "tower.ply", up="y").bounds, [[-0.5, -1.5, 0], [0.5, 0.5, 10]])


def sorted_corners(triangles: np.ndarray) -> list[list[list[float]]]:
    """Triangles, their corners and themselves in an order that does not depend on who read them."""
    return sorted(sorted(triangle) for triangle in np.asarray(triangles).tolist())


@pytest.mark.parametrize(
    ("mode", "order", "expected"),
    [
        (4, [0, 1, 2, 2, 1, 3], [[0, 1, 2], [2, 1, 3]]),
        (5, [0, 1, 2, 3, 4], [[0, 1, 2], [2, 1, 3], [2, 3, 4]]),  # every other one turned over, as the standard says
        (6, [0, 1, 2, 3, 4], [[1, 2, 0], [2, 3, 0], [3, 4, 0]]),
    ],
    ids=["triangles", "strip", "fan"],
)
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.uint32])
def test_primitives(mode: int, order: list[int], expected: list[list[int]], dtype: type) -> None:
    found = read(as_document(indices=np.array(order, dtype=dtype), mode=mode))
    normals, wanted = (
        np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0]) for t in (found, CORNERS[np.array(expected)].astype(float))
    )
    assert np.allclose(normals, wanted)
    assert [sorted(t) for t in found.tolist()] == [sorted(t) for t in CORNERS[np.array(expected)].tolist()]
    if order == sorted(order):
        assert read(as_document(mode=mode)).tolist() == found.tolist()  # without indices: vertices in their order


def test_points_and_lines_are_left_out() -> None:
    document = as_document()
    primitive = document["meshes"][0]["primitives"][0]
    document["meshes"][0]["primitives"] = [{**primitive, "mode": mode} for mode in (0, 1, 2, 3, 5)]
    assert len(read(document)) == 3


def test_a_node_without_triangles_still_moves_what_is_below_it() -> None:
    document = as_document(CORNERS[:3])
    document["meshes"].append({"primitives": [{"attributes": {"POSITION": 0}, "mode": 1}]})
    document["nodes"] = [{"mesh": 1, "translation": [5, 0, 0], "children": [1]}, {"mesh": 0}]
    assert read(document).tolist() == [moved([5, 0, 0]).tolist()]


def test_transforms_of_nodes() -> None:
    document = as_document(CORNERS[:3])
    half = 2**-0.5  # a quarter turn about z
    document["nodes"] = [
        {"mesh": 0, "translation": [10, 0, 0], "rotation": [0, 0, half, half], "scale": [2, 3, 4], "children": [1]},
        {"mesh": 0, "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 5, 1]},
        {"mesh": 0},  # not in the scene
    ]
    outer = [[10, 0, 0], [10, 2, 0], [7, 0, 0]]
    inner = [[10, 0, 20], [10, 2, 20], [7, 0, 20]]
    assert np.allclose(sorted_corners(read(document)), sorted_corners([outer, inner]))
    del document["scenes"], document["scene"]
    assert np.allclose(sorted_corners(read(document)), sorted_corners([outer, inner, CORNERS[:3]]))


def test_quantized_and_interleaved_positions() -> None:
    rows = np.zeros(3, dtype=[("position", "<i2", 3), ("pad", "<u2"), ("other", "<f4", 2)])
    rows["position"] = [[32767, 0, -32768], [0, 32767, 0], [-32767, 0, 0]]
    document = as_document(CORNERS[:3])
    document["buffers"][0] = {"uri": data_uri(rows.tobytes()), "byteLength": rows.nbytes}
    document["bufferViews"][0] = {"buffer": 0, "byteLength": rows.nbytes, "byteStride": 16}
    document["accessors"][0] |= {"componentType": 5122, "normalized": True}
    document["extensionsRequired"] = ["KHR_mesh_quantization"]
    wanted = np.maximum(rows["position"] / 32767, -1)
    assert read(document).tolist() == [wanted.tolist()]
    del document["accessors"][0]["normalized"]
    assert read(document).tolist() == [rows["position"].tolist()]


def test_buffers_in_files_with_odd_names(tmp_path: Path) -> None:
    document = as_document(CORNERS[:3])
    (tmp_path / "my mesh.bin").write_bytes(CORNERS.tobytes())
    document["buffers"][0]["uri"] = "my%20mesh.bin"
    assert read(document, tmp_path).tolist() == [CORNERS[:3].tolist()]


def broken(**changes: Any) -> Document:
    """The least document with values replaced: keys are paths, their steps joined by `__`."""
    document = copy.deepcopy(as_document(CORNERS[:3], np.array([0, 1, 2], dtype=np.uint8)))
    for path, value in changes.items():
        *steps, last = (int(step) if step.isdecimal() else step for step in path.split("__"))
        target: Any = document
        for step in steps:
            target = target[step]
        target[last] = value
    return document


@pytest.mark.parametrize(
    ("document", "message"),
    [
        (broken(asset={"version": "1.0"}), r"must be of version 2; it is of '1\.0'"),
        (
            broken(extensionsRequired=["KHR_materials_unlit", "EXT_x", "Y_z"]),
            "it requires EXT_x, Y_z .EXT_mesh",
        ),
        (broken(meshes__0__primitives__0__mode=7), "must be triangles, strips or fans; mesh 0 has mode 7"),
        (broken(accessors__0__count=353535235358), "count is 353,535,235,358 of 12 bytes each in a view of 36 bytes"),
        (broken(accessors__0__count=-1), "must be whole numbers from 0; one is '-1'"),
        (broken(accessors__0__type="MAT4"), "POSITION of glTF must be VEC3 of component types"),
        (broken(accessors__1__componentType=5126), "indices of glTF must be SCALAR of component types"),
        (
            broken(accessors__0={"componentType": 5126, "type": "VEC3", "count": 3}),
            "has no data, or they are compressed",
        ),
        (broken(accessors__0__sparse={"count": 1}), "structure is broken .KeyError"),
        (broken(bufferViews__0__byteLength=99, accessors__0__count=8), "byteLength is 99 of 39 bytes"),
        (broken(bufferViews__0__byteOffset=1 << 59), "byteLength is 576,460,752,303,423,524 of 39 bytes"),
        (broken(buffers__0__uri="data:;base64,@"), "structure is broken .Error: .*base64"),
        (broken(buffers__0__uri="missing.bin"), "must be a file in its folder; there is no 'missing.bin'"),
        (broken(buffers__0__uri="http://x/y.bin"), "must be a file in its folder"),
        (broken(buffers__0={}), "buffer 0 of glTF must have data; it has none"),
        (broken(nodes__0__children=[0]), "must be a tree"),
        (broken(nodes__0__matrix=[1, 2]), "the matrix of a node must be finite and below 1e.70, 16 numbers"),
        (broken(nodes__0__rotation=[0, 0, 0, 0]), "must be a quaternion of length 1; it is of length 0"),
        (broken(nodes__0__rotation=[float("nan"), 0, 0, 1]), "rotation of a node must be finite and below"),
        ({"asset": []}, "structure is broken .TypeError"),
        (broken(accessors__1__count=2, meshes__0__primitives__0__attributes={}), None),
    ],
)
def test_broken_documents_are_refused_in_words(document: Document, message: str | None) -> None:
    if message is None:
        assert len(read(document)) == 0
        return
    with pytest.raises(MeshError, match=message):
        read(document)


def test_indices_beyond_the_vertices_are_refused() -> None:
    document = as_document(CORNERS[:3], np.array([0, 1, 3], dtype=np.uint8))
    # joined with a second part, vertex 3 would be that one's first
    document["meshes"][0]["primitives"].append({"attributes": {"POSITION": 0}})
    with pytest.raises(MeshError, match="refer to the 3 vertices of their primitive by 0 to 2; one refers to 3"):
        read(document)


def test_buffers_outside_the_folder_are_refused(tmp_path: Path) -> None:
    (tmp_path / "inside").mkdir()
    (tmp_path / "secret.bin").write_bytes(CORNERS.tobytes())
    (tmp_path / "inside" / "link.bin").symlink_to(tmp_path / "secret.bin")
    document = as_document(CORNERS[:3])
    for uri in ("../secret.bin", "%2e%2e/secret.bin", str(tmp_path / "secret.bin"), "link.bin"):
        document["buffers"][0]["uri"] = uri
        with pytest.raises(MeshError, match="must be a file in its folder"):
            read(document, tmp_path / "inside")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda data: data[:15], "that it declares; it has 15. Is it cut short"),
        (
            lambda data: data[:-4],
            r"must have the [\d,]+ bytes and the chunks that it declares; it has [\d,]+. Is it cut",
        ),
        (lambda data: data.replace(b"glTF\2", b"glTF\1"), "must be of version 2; it is of version 1"),
        (lambda data: data[:12] + b"\xff\xff\xff\x7f" + data[16:], "the chunks that it declares"),
        (lambda data: data.replace(b"JSON", b"NOSJ"), "must begin with JSON; it begins with b'NOSJ'"),
        (lambda data: data.replace(b"BIN\0", b"BAN\0"), "buffer 0 of glTF must have data"),
        (lambda data: data.replace(b'{"asset"', b'{"asset}'), "must be JSON"),
    ],
)
def test_damaged_glb_is_refused_in_words(change: Any, message: str) -> None:
    document = as_document(CORNERS[:3])
    del document["buffers"][0]["uri"]
    data = glb(document, CORNERS.tobytes())
    assert len(polygons_of(data).counts) == 1
    with pytest.raises(MeshError, match=message):
        polygons_of(change(data))


@pytest.mark.parametrize("text", [b"", b"[]", b"{", b"\xff\xfe", b"[" * 100_000, b'{"asset": {"version": []}}'])
def test_text_that_is_no_gltf_is_refused(text: bytes) -> None:
    with pytest.raises(MeshError):
        polygons_of(text)


def test_a_small_file_cannot_grow_without_end() -> None:
    many = 3 * 10**5
    document = as_document(np.zeros((many, 3), dtype="<f4"))
    document["nodes"] = [{"mesh": 0}] * 100
    document["scenes"] = [{"nodes": list(range(100))}]
    with pytest.raises(MeshError, match="must not repeat its data to"):
        read(document)


def test_nodes_may_not_be_nested_without_end() -> None:
    document = as_document(CORNERS[:3])
    document["nodes"] = [{"children": [i + 1]} for i in range(10_000)] + [{"mesh": 0}]
    with pytest.raises(MeshError, match="a tree of at most 200 levels"):
        read(document)
    document["nodes"] = [{"children": [i + 1], "translation": [1, 0, 0]} for i in range(199)] + [{"mesh": 0}]
    assert read(document).tolist() == [moved([199, 0, 0]).tolist()]


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


def skinned(
    weights: Any, *, joints: Any = ((0, 1, 0, 0),) * 3, n_binds: int = 2, shown: Any = (0, 1), more: Any = None
) -> Document:
    """A triangle held by two joints, the second of which stands 3 above where it was bound; its node moves nothing."""
    built = Builder()
    attributes = {"POSITION": built.accessor(CORNERS[:3]), "JOINTS_0": built.accessor(np.array(joints, "u1"))}
    attributes["WEIGHTS_0"] = built.accessor(np.array(weights, "<f4"))
    if more is not None:
        attributes["JOINTS_1"] = built.accessor(np.array([[1, 0, 0, 0]] * 3, "u1"))
        attributes["WEIGHTS_1"] = built.accessor(np.array(more, "<f4"))
    skin: dict[str, Any] = {"joints": [1, 2]}
    if n_binds:
        binds = np.stack([np.eye(4)] * n_binds).astype("<f4")
        binds[1:, 3, :3] = [0, -2, 0]  # columns first: the second joint was bound 2 up
        skin["inverseBindMatrices"] = built.accessor(binds)
    return built.finished(
        meshes=[{"primitives": [{"attributes": attributes}]}],
        skins=[skin],
        nodes=[
            {"mesh": 0, "skin": 0, "translation": [100, 0, 0]},
            {"children": [2]},
            {"translation": [0, 5 if n_binds else 3, 0]},
        ],
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
        (skinned([[1, 0, 0, 0], [1, 0, 0, 0], [1, -0.9, 0, 0]]), "weights of joints must not be negative; one is -0.9"),
        (skinned([[1, 0, 0, 0]] * 3, n_binds=1), "a skin of 2 joints must have as many inverse .*; it has 1"),
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


def draco_document() -> Document:
    ball, built = trimesh.creation.icosphere(subdivisions=2), Builder()
    primitive = built.draco(ball.faces, POSITION=ball.vertices.astype("<f4"))
    return built.finished(
        meshes=[{"primitives": [primitive]}], nodes=[{"mesh": 0, "translation": [5, 0, 0]}],
        extensionsRequired=["KHR_draco_mesh_compression"],
    )  # fmt: skip


def test_draco() -> None:
    found = read(draco_document())
    assert found.shape == (320, 3, 3)
    assert np.allclose(np.linalg.norm(found - [5, 0, 0], axis=2), 1, atol=1e-3)


@pytest.mark.parametrize("marked", [False, True])
def test_normalized_integers_of_draco_are_fractions(marked: bool) -> None:
    """Also where Draco's own attribute is marked as normalized: then it divides by itself."""
    whole = np.array([[32767, 0, -32768], [0, 16384, 0], [-32767, 0, 300]], "<i2")
    built = Builder()
    primitive = built.draco(np.array([[0, 1, 2]]), POSITION=whole)
    if marked:
        assert built.blob.count(bytes([0, 3, 3, 0])) == 1
        built.blob = built.blob.replace(bytes([0, 3, 3, 0]), bytes([0, 3, 3, 1]))
    found = read(built.finished(meshes=[{"primitives": [primitive]}]))
    assert np.allclose(found, [np.maximum(whole / 32767, -1)], atol=1e-7)
    if not marked:
        for row in built.document["accessors"]:
            row["normalized"] = False
        assert read(built.document).tolist() == [whole.tolist()]


@pytest.mark.parametrize("kind", ["<f4", "u1", "<u2"])
def test_a_skin_compressed_by_draco_is_posed_as_a_plain_one(kind: str) -> None:
    shares = np.array([[1, 0, 0, 0], [0.4, 0.6, 0, 0], [0, 1, 0, 0]])
    plain = skinned(shares)
    weights = shares.astype(kind) if kind == "<f4" else np.round(shares * np.iinfo(kind).max).astype(kind)
    built = Builder()
    built.document = {**plain, "bufferViews": list(plain["bufferViews"]), "accessors": list(plain["accessors"])}
    built.blob = base64.b64decode(plain["buffers"][0]["uri"].partition(",")[2])
    joints = np.array([[0, 1, 0, 0]] * 3, "u1")
    primitive = built.draco(np.array([[0, 1, 2]]), POSITION=CORNERS[:3], JOINTS_0=joints, WEIGHTS_0=weights)
    packed = built.finished(scenes=plain["scenes"], nodes=plain["nodes"], meshes=[{"primitives": [primitive]}])
    expected = CORNERS[:3] + np.array([[0, 0, 0], [0, 1.8, 0], [0, 3, 0]])
    assert np.allclose(read(plain), [expected], atol=1e-6)
    assert np.allclose(read(packed), [expected], atol=1e-6)


def test_colours_compressed_by_draco_are_read() -> None:
    colors = np.array([[255, 0, 0], [0, 255, 0], [51, 0, 255]], "u1")
    built = Builder()
    primitive = built.draco(np.array([[0, 1, 2]]), POSITION=CORNERS[:3], COLOR_0=colors)
    document = built.finished(meshes=[{"primitives": [primitive]}])
    look = read_gltf(json.dumps(document).encode(), MeshFiles(HERE / "scene.gltf"), colors=True)[1]
    assert look is not None
    assert look.corners is not None
    assert np.allclose(look.corners, colors / 255)


def test_draco_that_lacks_what_the_document_says_is_refused() -> None:
    document = draco_document()
    packed = document["meshes"][0]["primitives"][0]["extensions"]["KHR_draco_mesh_compression"]
    packed["attributes"]["POSITION"] = 77
    with pytest.raises(MeshError, match="must have the attribute 77, POSITION; they do not"):
        read(document)


def morphed(weights: dict[str, Any], *, draco: bool = False, kind: str = "<f4") -> Document:
    """A triangle with two morph targets, the first (0, 0, 1) for all, the second (1, 0, 0) for the last corner."""
    built = Builder()
    one = 1 if kind == "<f4" else np.iinfo(kind).max
    first, second = np.zeros((2, 3, 3), kind)
    first[:, 2], second[2, 0] = one, one
    rows = [built.accessor(each, normalized=kind != "<f4") for each in (first, second)]
    built.document["accessors"].append({"componentType": 5126, "type": "VEC3", "count": 3})  # without data: zeros
    if draco:
        primitive = built.draco(np.array([[0, 1, 2]]), POSITION=CORNERS[:3])
    else:
        primitive = {"attributes": {"POSITION": built.accessor(CORNERS[:3])}}
    primitive["targets"] = [{"POSITION": row} for row in (*rows, 2)] + [{"NORMAL": 99}]
    mesh = {"primitives": [primitive], **{key: value for key, value in weights.items() if key == "weights"}}
    nodes = [{"mesh": 0, **({"weights": weights["of_node"]} if "of_node" in weights else {})}, {"mesh": 0}]
    return built.finished(meshes=[mesh], nodes=nodes, scenes=[{"nodes": [0, 1]}])


@pytest.mark.parametrize("draco", [False, True])
@pytest.mark.parametrize("kind", ["<f4", "i1", "<i2"])
def test_morph_targets_have_the_weights_of_the_node_else_of_the_mesh(draco: bool, kind: str) -> None:
    def moved_by(first: float, second: float) -> list[Any]:
        return list(CORNERS[:3] + np.array([[0, 0, first], [0, 0, first], [second, 0, first]]))

    both = read(morphed({"weights": [0.5, -2, 3, 1], "of_node": [0, 1, 0, 0]}, draco=draco, kind=kind))
    assert np.allclose(both, [moved_by(0, 1), moved_by(0.5, -2)])
    of_mesh = read(morphed({"weights": [0.5, -2, 3, 1]}, draco=draco, kind=kind))
    assert np.allclose(of_mesh, [moved_by(0.5, -2), moved_by(0.5, -2)])
    assert np.allclose(read(morphed({}, draco=draco, kind=kind)), [CORNERS[:3], CORNERS[:3]])


@pytest.mark.parametrize("weights", [[1], [1, 0, 0, float("nan")], [1, 0, 0, 1e200], [1, 0, 0, 0, 0]])
def test_weights_of_morph_targets_that_cannot_be_are_refused(weights: list[float]) -> None:
    with pytest.raises(MeshError, match="weights of 4 morph targets must be as many numbers; they are"):
        read(morphed({"weights": weights}))


def test_morph_targets_of_other_vertices_are_refused() -> None:
    document = morphed({"weights": [1, 0, 0, 0]})
    document["accessors"][0]["count"] = 2
    with pytest.raises(
        MeshError, match="targets of glTF must have a row for each of the 3 vertices of the primitive; there are 2"
    ):
        read(document)


def test_joints_of_other_vertices_are_refused() -> None:
    document = skinned([[1, 0, 0, 0]] * 3)
    document["accessors"][1]["count"] = 2
    with pytest.raises(
        MeshError, match="JOINTS of glTF must have a row for each of the 3 vertices of the primitive; there are 2"
    ):
        read(document)


def test_hidden_nodes_are_not_shown_nor_what_is_below_them() -> None:
    document = as_document(CORNERS[:3])
    hidden = {"extensions": {"KHR_node_visibility": {"visible": False}}}
    document["nodes"] = [
        {"mesh": 0, "children": [1, 3]},
        {"mesh": 0, "translation": [5, 0, 0], "children": [2], **hidden},
        {"mesh": 0, "translation": [1, 0, 0]},
        {"mesh": 0, "translation": [9, 0, 0], "extensions": {"KHR_node_visibility": {"visible": True}}},
    ]
    document["extensionsRequired"] = ["KHR_node_visibility"]
    assert np.allclose(read(document), [CORNERS[:3], moved([9, 0, 0])])


@pytest.mark.parametrize(
    "name", ["KHR_texture_basisu", "EXT_lights_image_based", "ADOBE_materials_thin_transparency", "KHR_xmp_json_ld"]
)
def test_extensions_that_shape_nothing_refuse_nothing(name: str) -> None:
    document = as_document(CORNERS[:3])
    document["extensionsRequired"] = [name]
    assert read(document).tolist() == [CORNERS[:3].tolist()]


def test_damaged_draco_and_none_at_all_are_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    document = draco_document()
    document["bufferViews"][0]["byteLength"] //= 2
    with pytest.raises(MeshError, match="DracoPy cannot read the compressed mesh"):
        read(document)
    monkeypatch.setitem(sys.modules, "DracoPy", None)
    with pytest.raises(MeshError, match=r"needs the package DracoPy; .*zbuf-occlude\[draco\]"):
        read(document)


@pytest.mark.parametrize("vendor", ["EXT", "KHR"])
def test_meshopt_without_a_fallback_is_one_line(vendor: str) -> None:
    document = as_document(CORNERS[:3])
    document["buffers"] = [{"byteLength": 36}]
    document["bufferViews"][0]["extensions"] = {f"{vendor}_meshopt_compression": {"buffer": 1, "mode": "ATTRIBUTES"}}
    with pytest.raises(MeshError, match=r"must have data; it is compressed by meshopt\. Export it uncompressed"):
        read(document)


def test_hostile_files_read_nothing_twice(tmp_path: Path) -> None:
    """20,000 buffers that are the file itself; 200 that are one file: only what is shown is read, and once."""
    document = as_document(CORNERS[:3])
    document["buffers"] += [{"uri": "self.gltf", "byteLength": 1}] * 20_000
    document["bufferViews"] += [{"buffer": i + 1, "byteLength": 1} for i in range(20_000)]
    (tmp_path / "self.gltf").write_text(json.dumps(document))
    origin = load_mesh(tmp_path / "self.gltf").origin
    assert [file.name for file in origin.files] == ["self.gltf"]
    (tmp_path / "one.bin").write_bytes(CORNERS.tobytes() + bytes(20_000_000))
    document = as_document(CORNERS[:3])
    document["buffers"] = [{"uri": "one.bin", "byteLength": 20_000_060}] * 200
    document["bufferViews"] = [{"buffer": i, "byteLength": 36} for i in range(200)]
    document["accessors"] = [{**document["accessors"][0], "bufferView": i} for i in range(200)]
    document["meshes"][0]["primitives"] = [{"attributes": {"POSITION": i}} for i in range(200)]
    (tmp_path / "many.gltf").write_text(json.dumps(document))
    with Limits(seconds=60, gigabytes=3.0).watch():  # 4 GB, if each were read
        mesh = load_mesh(tmp_path / "many.gltf")
    assert mesh.dropped["duplicate"] == 199
    assert [file.name for file in mesh.origin.files] == ["many.gltf", "one.bin"]
