"""glTF scenes are read as the standard says; what is broken, missing or hostile is refused in words."""

import base64
import copy
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from zbuf_occlude import MeshError, load_mesh
from zbuf_occlude.meshes.gltf import read_gltf
from zbuf_occlude.meshes.mesh_files import MeshFiles
from zbuf_occlude.meshes.polygons import Polygons

HERE = Path("nowhere")
CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [0.5, 2, 1]], dtype="<f4")
Document = dict[str, Any]


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
    blob = positions.tobytes()
    document: Document = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, **primitive}]}],
        "bufferViews": [{"buffer": 0, "byteLength": len(blob)}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "type": "VEC3", "count": len(positions)}],
    }
    if indices is not None:
        kinds = {"uint8": 5121, "uint16": 5123, "uint32": 5125}
        document["bufferViews"].append({"buffer": 0, "byteOffset": len(blob), "byteLength": indices.nbytes})
        document["accessors"].append(
            {"bufferView": 1, "componentType": kinds[indices.dtype.name], "type": "SCALAR", "count": len(indices)}
        )
        document["meshes"][0]["primitives"][0]["indices"] = 1
        blob += indices.tobytes()
    document["buffers"] = [{"byteLength": len(blob), "uri": data_uri(blob)}]
    return document


def data_uri(blob: bytes) -> str:
    return "data:application/octet-stream;base64," + base64.b64encode(blob).decode()


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


def test_turning_up_is_a_rotation_not_a_mirror(tmp_path: Path) -> None:
    trimesh.creation.icosphere(subdivisions=1).export(tmp_path / "ball.ply")
    turned, straight = (load_mesh(tmp_path / "ball.ply", up=up) for up in ("y", "z"))
    rotation = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]])
    assert np.linalg.det(rotation) == 1
    assert np.array_equal(turned.vertices, straight.vertices @ rotation.T)


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


def test_cameras_hide_nothing() -> None:
    document = as_document(CORNERS[:3])
    document["cameras"] = [{"perspective": {"znear": 1, "aspectRatio": 1, "yfov": 1}, "name": "1"}]
    document["nodes"] = [
        {"camera": 0, "mesh": 0, "translation": [5, 0, 0], "children": [1]},
        {"mesh": 0, "translation": [0, 5, 0]},
    ]
    expected = [moved([5, 0, 0]), moved([5, 5, 0])]
    assert sorted_corners(read(document)) == sorted_corners(np.array(expected))


def test_names_change_nothing() -> None:
    document = as_document(CORNERS[:3])
    for key, name in {"nodes": "world", "meshes": "GLTF"}.items():
        document[key] *= 3
        document[key] = [{**row, "name": name} for row in document[key]]
    document["nodes"] = [{**node, "mesh": i, "translation": [i, 0, 0]} for i, node in enumerate(document["nodes"])]
    document["scenes"] = [{"nodes": [0, 1, 2]}]
    assert sorted_corners(read(document)) == sorted_corners([moved([i, 0, 0]) for i in range(3)])


def test_the_order_of_faces_is_the_same_each_time() -> None:
    document = as_document()
    primitive = document["meshes"][0]["primitives"][0]
    document["meshes"][0]["primitives"] = [{**primitive, "mode": 5} for _ in range(20)]
    document["nodes"] = [{"mesh": 0, "translation": [i, 0, 0]} for i in range(20)]
    document["scenes"] = [{"nodes": list(range(20))}]
    assert read(document).shape == (20 * 20 * 3, 3, 3)
    assert read(document).tobytes() == read(document).tobytes()


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
            broken(extensionsRequired=["KHR_materials_unlit", "EXT_meshopt_compression"]),
            "readable without extensions; it requires EXT_meshopt_compression. Export it plainly",
        ),
        (broken(meshes__0__primitives__0__mode=7), "must be triangles, strips or fans; mesh 0 has mode 7"),
        (broken(meshes__0__primitives__0__mode=[]), r"must be triangles, strips or fans; mesh 0 has mode \[\]"),
        (broken(accessors__0__count=353535235358), "count is 353,535,235,358 of 12 bytes each in a view of 36 bytes"),
        (broken(accessors__0__count=4), "count is 4 of 12 bytes each in a view of 36"),
        (broken(accessors__0__count=10**30), "must be whole numbers from 0"),
        (broken(accessors__0__count=-1), "must be whole numbers from 0; one is '-1'"),
        (broken(accessors__0__count="3"), "must be whole numbers from 0; one is '3'"),
        (broken(accessors__0__type="MAT4"), "POSITION of glTF must be VEC3 of component types"),
        (broken(accessors__0__componentType=1), "POSITION of glTF must be VEC3 of component types"),
        (broken(accessors__1__componentType=5126), "indices of glTF must be SCALAR of component types"),
        (broken(accessors__0={"componentType": 5126, "type": "VEC3", "count": 3}), "must have all.*compressed"),
        (broken(accessors__0__sparse={"count": 1}), "structure is broken .KeyError"),
        (broken(bufferViews__0__byteLength=99, accessors__0__count=8), "byteLength is 99 of 39 bytes"),
        (broken(bufferViews__0__byteOffset=9), "byteLength is 45 of 39 bytes"),
        (broken(bufferViews__0__byteOffset=1 << 59), "byteLength is 576,460,752,303,423,524 of 39 bytes"),
        (broken(buffers__0__uri="data:;base64,@"), "structure is broken .Error: .*base64"),
        (broken(buffers__0__uri="missing.bin"), "must be a file in its folder; there is no 'missing.bin'"),
        (broken(buffers__0__uri="/dev/zero"), "must be a file in its folder; there is no '/dev/zero'"),
        (broken(buffers__0__uri="http://x/y.bin"), "must be a file in its folder"),
        (broken(buffers__0={}), "buffer 0 of glTF must have data; it has none"),
        (broken(nodes__0__children=[0]), "must be a tree"),
        (broken(nodes__0__children=[7]), "structure is broken .IndexError"),
        (broken(nodes__0__children=[-1]), "must be whole numbers from 0"),
        (broken(nodes__0__matrix=[1, 2]), "the matrix of a node must be finite and below 1e.70, 16 numbers"),
        (broken(nodes__0__mesh={}), "must be whole numbers from 0"),
        (broken(nodes__0__scale=[1e300, 1, 1]), "scale of a node must be finite and below"),
        (broken(nodes__0__rotation=[float("nan"), 0, 0, 1]), "rotation of a node must be finite and below"),
        (broken(nodes={}), "structure is broken|must"),
        (broken(meshes=[[]]), "structure is broken .TypeError"),
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
    with pytest.raises(MeshError, match="refer to the 3 vertices of their part by 0 to 2; one refers to 3"):
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
        (lambda data: data.replace(b"glTF\2", b"glTF\1"), "must be of version 2 and begin with JSON; it has 1"),
        (lambda data: data[:12] + b"\xff\xff\xff\x7f" + data[16:], "the chunks that it declares"),
        (lambda data: data.replace(b"JSON", b"NOSJ"), "must be of version 2 and begin with JSON; it has 2 and b'NOSJ'"),
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
