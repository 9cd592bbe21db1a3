"""Point clouds from files: what is read, what is no cloud, what is refused."""

from pathlib import Path

import numpy as np
import pytest

from tests.scenes import box
from zbuf_occlude import SurfacePoints, prepare
from zbuf_occlude.errors import MeshError, OptionError
from zbuf_occlude.geometry.mesh import box_around
from zbuf_occlude.meshes.load import load_cloud

ASCII = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float z\nproperty float x\nproperty float y\n"


def test_ply_without_faces(tmp_path: Path) -> None:
    path = tmp_path / "a.ply"
    path.write_text(ASCII + "end_header\n3 1 2\n6 4 5\n")
    cloud = load_cloud(path)
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
        ("a.csv", b"x,y,z\n1,2,north\n", "must be readable as numbers"),
        ("a.csv", b"1,2\n3,4\n", "must have rows x, y, z"),
        ("a.npy", b"nothing of the kind", "must be readable as numbers"),
        ("a.csv", b"1,2,nan\n", "points with finite coordinates"),
        ("a.ply", b"ply\nformat ascii 1.0\nelement vertex 9\nproperty float x\nend_header\n", "must hold the 9 rows"),
    ],
)
def test_damage(tmp_path: Path, name: str, content: bytes, message: str) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(MeshError, match=message) as caught:
        load_cloud(tmp_path / name)
    assert str(tmp_path / name) in str(caught.value)


def test_csv_needs_no_heading(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("1e0,2,3,9\n4,5,6,9\n")
    cloud = load_cloud(tmp_path / "a.csv")
    assert cloud is not None
    assert cloud.tolist() == [[1, 2, 3], [4, 5, 6]]


def test_the_box_around_points() -> None:
    mesh = box_around(box((1.0, 0.5, 0.25)).vertices)
    assert np.allclose(mesh.bounds, box((1.0, 0.5, 0.25)).bounds)
    assert mesh.areas.sum() == pytest.approx(2 * (0.5 + 0.25 + 0.125))


def test_a_cloud_needs_a_method_without_faces() -> None:
    cloud = SurfacePoints.free(np.eye(3))
    with pytest.raises(OptionError, match="needs no faces for a point cloud, hidden_point_removal; got 'oracle'"):
        prepare(cloud, "oracle")
