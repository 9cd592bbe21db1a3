"""load_mesh as a person meets it: what loads, what is said when a file does not, and what a mesh then knows."""

import os
import stat
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh

from tests.scenes import DATA, box
from zbuf_occlude import MeshError, OptionError, SurfacePoints, load_mesh, prepare
from zbuf_occlude.geometry.mesh import box_around
from zbuf_occlude.meshes.load import load_cloud

HARD = DATA / "hard"
needs_data = pytest.mark.skipif(not HARD.is_dir(), reason=f"{HARD} is not there; set ZBUF_OCCLUDE_DATA")

LOADS = {
    # file: faces, area
    "busted.STL": (3878, None),  # its holes and crossings are no reason to refuse
    "comments.off": (12, 32.0),
    "nancolor.obj": (12, 6.0),  # the colour of a vertex is NaN
    "negative_indices.obj": (12, 24.0),  # six quadrilaterals
    "origin_inside.STL": (28, None),  # binary, though its header begins with "solid"
    "polygonfaces.obj": (3, None),  # one folded polygon of five corners, spelt 1// 2//
    "two_objects.obj": (16, 6.0 + 1.5 + 3**0.5 / 2),
    "whitespace.off": (12, 32.0),
}
REFUSED = {
    "empty.stl": "0 vertices and no face",
    "obj_empty.obj": "0 vertices and no face",
    "obj_wireframe.obj": "8 vertices and no face.*wireframe",
    "ply_empty_ascii.ply": "0 vertices and no face",
    "ply_empty_header.ply": "must have the elements vertex and face",
    "ply_points_bin.ply": "8 vertices and no face.*point cloud",
    "points_ascii.ply": "must have the elements vertex and face.*point cloud",
}


@needs_data
@pytest.mark.parametrize(("name", "n_faces", "area"), [(name, *facts) for name, facts in LOADS.items()])
def test_hard_files_load_as_a_person_would_expect(name: str, n_faces: int, area: float | None) -> None:
    mesh = load_mesh(HARD / name)
    assert len(mesh.faces) == n_faces
    assert mesh.name == Path(name).stem
    assert mesh.dropped == {"degenerate": 0, "duplicate": 0}
    if area is not None:
        assert mesh.areas.sum() == pytest.approx(area, rel=1e-5)
    if not name.startswith(("negative", "polygon")):  # the two that trimesh does not read as they are meant
        peer = trimesh.load_mesh(HARD / name, process=False)
        assert mesh.areas.sum() == pytest.approx(peer.area, rel=1e-6)


@needs_data
@pytest.mark.parametrize(("name", "message"), REFUSED.items())
def test_hard_files_without_a_surface_are_refused_in_one_line(name: str, message: str) -> None:
    with pytest.raises(MeshError, match=message) as caught:
        load_mesh(HARD / name)
    assert str(caught.value).startswith(str(HARD / name))
    assert "\n" not in str(caught.value)


@needs_data
@pytest.mark.parametrize("path", sorted(DATA.glob("modelnet/*/*/*.off")), ids=lambda path: path.stem)
def test_modelnet_files_are_what_trimesh_reads(path: Path) -> None:
    mesh = load_mesh(path)
    peer = trimesh.load_mesh(path, process=False)
    assert np.array_equal(mesh.vertices, peer.vertices)
    assert np.array_equal(mesh.faces, peer.faces[mesh.source_face_ids])
    assert len(mesh.faces) + mesh.dropped["degenerate"] + mesh.dropped["duplicate"] == len(peer.faces)


def write(folder: Path, name: str, text: str | bytes) -> Path:
    (folder / name).write_bytes(text if isinstance(text, bytes) else text.encode())
    return folder / name


def test_source_face_ids_lead_to_the_polygons_of_the_file(tmp_path: Path) -> None:
    text = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nf 1 2\nf 1 2 3 4\nf 1 1 2\nf 3 2 1\nf 1 2 5\nf 4 5 1 2 3\n"
    mesh = load_mesh(write(tmp_path, "a.obj", text))
    assert mesh.source_face_ids is not None
    # 0 is a line; 2 has no area; 3 is a triangle that the quadrilateral 1 has too
    assert mesh.source_face_ids.tolist()[:3] == [1, 1, 4]
    assert set(mesh.source_face_ids[3:].tolist()) == {5}
    assert mesh.dropped["too_few_corners"] == 1
    assert mesh.dropped["degenerate"] == 1
    assert mesh.dropped["duplicate"] >= 1
    assert len(mesh.vertices) == 5


def test_vertices_that_no_face_uses_may_be_anything(tmp_path: Path) -> None:
    text = "OFF 6 1 0\nnan nan nan\n0 0 0\n1 0 0\ninf 0 0\n0 1 0\n9 9 9\n3 1 2 4\n"
    mesh = load_mesh(write(tmp_path, "a.off", text))
    assert mesh.vertices.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0], [9, 9, 9]]
    assert mesh.dropped == {"unusable_vertices": 2, "degenerate": 0, "duplicate": 0}
    with pytest.raises(MeshError, match=r"vertex 0 must be finite and below .*, since face 0 uses it; it is .nan"):
        load_mesh(write(tmp_path, "b.off", text.replace("3 1 2 4", "3 1 2 0")))


TRIANGLE = "OFF 3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"


@pytest.mark.parametrize("name", ["a.off", "a.OFF", "a b.c.Off"])
def test_the_ending_decides_whatever_its_case(tmp_path: Path, name: str) -> None:
    mesh = load_mesh(write(tmp_path, name, TRIANGLE))
    assert mesh.name == name[:-4]
    assert load_mesh(str(tmp_path / name), name="chair/train/a.off").name == "chair/train/a.off"


def fifo(folder: Path) -> Path:
    if not hasattr(os, "mkfifo"):
        pytest.skip("Windows has no pipes that are files")
    os.mkfifo(folder / "pipe.off")
    return folder / "pipe.off"


def folder_as_file(folder: Path) -> Path:
    (folder / "a.off").mkdir()
    return folder / "a.off"


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda folder: folder / "none.off", "there is no such file. Check the path"),
        (lambda folder: folder / "a\0.off", "there is no such file"),
        (lambda folder: folder, "must end in one of .off, .obj, .ply, .stl, .glb, .gltf; this ends in ''"),
        (lambda folder: write(folder, "a.dae", TRIANGLE), "must end in one of .*; this ends in '.dae'. Convert it"),
        (lambda folder: write(folder, "empty.obj", ""), "the file is empty"),
        (fifo, "it is a device or a pipe"),
        (folder_as_file, r"must be a file; it is a folder\. Use MeshCollection\.from_paths"),
        (lambda folder: write(folder, "a.off", TRIANGLE.replace("0 1 0\n3", "2 0 0\n3")), "have zero area"),
        (lambda folder: write(folder, "a.obj", TRIANGLE), r"no face of three corners.* looks like \.off: rename it\?"),
        (lambda folder: write(folder, "a.stl", b"ply\nformat ascii 1.0\n"), r"84 bytes.* looks like \.ply: rename"),
        (lambda folder: write(folder, "a.gltf", "solid x\nfacet normal 0 0 1\n"), r"JSON.* looks like \.stl: rename"),
        (lambda folder: write(folder, "a.off", b"glTF\2\0\0\0"), r"NUL bytes.* looks like \.glb: rename it\?"),
    ],
)
def test_one_line_names_the_file_and_says_what_to_do(
    tmp_path: Path, make: Callable[[Path], Path], message: str
) -> None:
    path = make(tmp_path)
    with pytest.raises(MeshError, match=message) as caught:
        load_mesh(path)
    shown = str(path).replace("\0", r"\x00")  # what cannot be printed is escaped
    assert str(caught.value).startswith(f"{shown}: ")
    assert str(caught.value).count(shown) == 1
    assert "\n" not in str(caught.value)
    assert caught.value.__suppress_context__  # no traceback of another kind behind it


@pytest.mark.skipif(getattr(os, "geteuid", lambda: 0)() == 0, reason="root may read everything, as on Windows")
def test_a_file_that_may_not_be_read(tmp_path: Path) -> None:
    path = write(tmp_path, "a.off", TRIANGLE)
    path.chmod(stat.S_IWUSR)
    with pytest.raises(MeshError, match="cannot read it: Permission denied"):
        load_mesh(path)


def test_up_is_checked_first(tmp_path: Path) -> None:
    with pytest.raises(OptionError, match="up must be one of z, y; got 'x'"):
        load_mesh(tmp_path / "none.off", up="x")


ASCII = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float z\nproperty float x\nproperty float y\n"


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.ply", ASCII + "end_header\n3 1 2\n6 4 5\n"),
        ("a.csv", "1e0,2,3,9\n4,5,6,9\n"),
    ],
)
def test_ply_without_faces_and_csv_without_a_heading(tmp_path: Path, name: str, text: str) -> None:
    cloud = load_cloud(write(tmp_path, name, text))
    assert cloud is not None
    assert cloud.tolist() == [[1, 2, 3], [4, 5, 6]]


def test_a_mesh_is_no_cloud(tmp_path: Path) -> None:
    path = tmp_path / "a.ply"
    path.write_text(ASCII + "element face 1\nproperty list uchar int vertex_index\nend_header\n0 1 2\n3 4 5\n2 0 1\n")
    assert load_cloud(path) is None
    assert load_cloud(tmp_path / "chair.off") is None


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.csv", b"x,y,z\n1,2,north\n", "cannot read the points"),
        ("a.csv", b"1,2\n3,4\n", "must have rows of x, y, z"),
        ("a.npy", b"nothing of the kind", "cannot read the points"),
        ("a.csv", b"1,2,nan\n", "coordinates that are finite and below"),
        (
            "a.ply",
            b"ply\nformat ascii 1.0\nelement vertex 9\nproperty float x\nend_header\n",
            "must contain the 9 rows",
        ),
    ],
)
def test_damage(tmp_path: Path, name: str, content: bytes, message: str) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(MeshError, match=message) as caught:
        load_cloud(tmp_path / name)
    assert str(tmp_path / name) in str(caught.value)


def test_the_box_around_points() -> None:
    mesh = box_around(box((1.0, 0.5, 0.25)).vertices)
    assert np.allclose(mesh.bounds, box((1.0, 0.5, 0.25)).bounds)
    assert mesh.areas.sum() == pytest.approx(2 * (0.5 + 0.25 + 0.125))


def test_a_cloud_needs_a_method_without_faces() -> None:
    cloud = SurfacePoints.free(np.eye(3))
    with pytest.raises(OptionError, match="needs no faces for a point cloud, hidden_point_removal; got 'oracle'"):
        prepare(cloud, "oracle")
