"""Intrinsics of a camera's file: each kind against its own library or description, pixel conventions, and refusals."""

import json
from pathlib import Path

import numpy as np
import pytest
import yaml

import zbuf_occlude as zo
from tests.net.options import run
from tests.scenes import box

FX, FY, CX, CY, WIDTH, HEIGHT = 612.5, 610.25, 322.75, 238.5, 640, 480
"""Of OpenCV: the centre of the first pixel is (0, 0)."""
NUMBERS = {"f": FX, "fy": FY, "cx": CX + 0.5, "cy": CY + 0.5, "width": WIDTH, "height": HEIGHT}
ROS = {
    "image_width": WIDTH,
    "image_height": HEIGHT,
    "camera_name": "camera",
    "camera_matrix": {"rows": 3, "cols": 3, "data": [FX, 0.0, CX, 0.0, FY, CY, 0.0, 0.0, 1.0]},
    "distortion_model": "plumb_bob",
    "distortion_coefficients": {"rows": 1, "cols": 5, "data": [0.0] * 5},
}
ECHO = {
    "height": HEIGHT,
    "width": WIDTH,
    "distortion_model": "plumb_bob",
    "d": [0.0] * 5,
    "k": ROS["camera_matrix"]["data"],  # type: ignore[index]
}
"""As ``ros2 topic echo`` prints a CameraInfo."""
BOP = {"fx": FX, "fy": FY, "cx": CX, "cy": CY, "width": WIDTH, "height": HEIGHT, "depth_scale": 1.0}
COLMAP = f"# cameras\n1 PINHOLE 640 480 {FX} {FY} {CX + 0.5} {CY + 0.5}\n"


def written(path: Path, content: str) -> Path:
    path.write_text(content)
    return path


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("camera.json", json.dumps(BOP)),
        ("camera_info.yaml", yaml.safe_dump(ROS)),
        ("camera_info.yaml", yaml.safe_dump(ECHO)),
        ("camera_info.yaml", yaml.safe_dump({**ECHO, "binning_x": 0, "binning_y": 1})),
        ("cameras.txt", COLMAP),
        ("cameras.txt", f"7 OPENCV 640 480 {FX} {FY} {CX + 0.5} {CY + 0.5} 0 0 0 0\n"),
    ],
)
def test_each_kind_gives_the_same_camera(name: str, content: str, tmp_path: Path) -> None:
    assert zo.sensors.read_intrinsics(written(tmp_path / name, content)) == NUMBERS


def test_one_focal_length_of_colmap(tmp_path: Path) -> None:
    found = zo.sensors.read_intrinsics(written(tmp_path / "cameras.txt", "1 SIMPLE_PINHOLE 64 48 50 32 24\n"))
    assert found == {"f": 50.0, "fy": 50.0, "cx": 32.0, "cy": 24.0, "width": 64.0, "height": 48.0}


@pytest.mark.needs("open3d")
def test_what_open3d_writes(tmp_path: Path) -> None:
    import open3d as o3d

    path = str(tmp_path / "intrinsic.json")
    assert o3d.io.write_pinhole_camera_intrinsic(path, o3d.camera.PinholeCameraIntrinsic(WIDTH, HEIGHT, FX, FY, CX, CY))
    assert zo.sensors.read_intrinsics(path) == NUMBERS


def test_a_point_falls_on_the_pixel_that_opencv_projects_it_to(tmp_path: Path) -> None:
    """A small box before the camera: the mean of its pixels' numbers, the first 0, is where K projects its centre."""
    sensor = zo.sensors.make("pinhole", **zo.sensors.read_intrinsics(written(tmp_path / "c.json", json.dumps(BOP))))
    mesh = box((0.1, 0.1, 0.1))
    mesh = mesh.transformed(1.0, np.array([0.0, 0.4, 0.3]) - mesh.centre)
    views = zo.views.from_angles(0, 0, distance=3.0).looking((0.0, 0.0, 0.0))
    (frame,) = zo.frames(mesh, views, sensor=sensor)
    rows, columns = np.nonzero(frame.mask)
    face = 3.0 - 0.05  # the near side alone is seen, from nearly straight ahead
    assert columns[frame.normals[rows, columns, 0] > 0.9].mean() == pytest.approx(CX + FX * 0.4 / face, abs=0.51)
    assert rows[frame.normals[rows, columns, 0] > 0.9].mean() == pytest.approx(CY - FY * 0.3 / face, abs=0.51)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("cameras.txt", f"3 OPENCV 640 480 {FX} {FY} 320 240 0.1 0 0 0\n", "camera 3 is a OPENCV with distortion"),
        ("cameras.txt", "1 OPENCV_FISHEYE 64 48 50 50 32 24 0 0 0 0\n", "is a OPENCV_FISHEYE with distortion"),
        ("cameras.txt", COLMAP + COLMAP, "it has 2 cameras"),
        ("cameras.txt", "", "it has 0 cameras"),
        ("camera.json", "{}", "must have the intrinsics of one camera.*it has no 'fx'"),
        ("camera.json", "[]", r"must have the intrinsics of one camera.*no names with values"),
        ("camera.json", "7", "no names with values"),
        ("camera_info.yaml", "", "no names with values"),
        ("camera_info.yaml", yaml.safe_dump(ROS | {"camera_matrix": 5}), "camera_matrix must be 3 x 3 numbers"),
        ("camera.json", json.dumps({**BOP, "fx": "wide"}), "fx must be a number"),
        ("camera.json", json.dumps({"intrinsic_matrix": [1.0] * 9, "width": 4, "height": 4}), "without skew"),
        ("camera.json", json.dumps({"intrinsic_matrix": [1.0] * 4}), "intrinsic_matrix must be 3 x 3 numbers"),
        ("camera.json", json.dumps({"intrinsic_matrix": [FX, 0, CX, 0, FY, CY, 0, 0, 1]}), "column by column"),
        ("camera.png", "", "ends in '.png'"),
        (
            "info.yaml",
            yaml.safe_dump({**ROS, "distortion_coefficients": {"data": [0.1, 0, 0, 0, 0]}}),
            r"its distortion \(plumb_bob\) is not 0",
        ),
        ("info.yaml", yaml.safe_dump({**ECHO, "binning_x": 1, "binning_y": 2}), "its binning_y is 2; divide fx"),
        ("info.yaml", "a: 1", "it has no 'camera_matrix'"),
    ],
)
def test_what_is_refused(name: str, content: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(zo.OptionError, match=message) as error:
        zo.sensors.read_intrinsics(written(tmp_path / name, content))
    assert str(error.value).startswith(str(tmp_path / name))


def test_a_scan_from_the_command_line(tmp_path: Path) -> None:
    written(tmp_path / "camera.json", json.dumps({**BOP, "width": 64, "height": 48, "cx": 31.5, "cy": 23.5}))
    box().to_trimesh().export(tmp_path / "box.stl")
    command = ["scan", tmp_path / "box.stl", "--unit", "m", "--range", "9", "--camera", tmp_path / "camera.json"]
    found = run(*command, "--sensor", "pinhole", "--out", tmp_path / "scan.npz")
    assert found.returncode == 0, found.stderr
    with np.load(tmp_path / "scan.npz") as scan:
        assert 1000 < len(scan["points"]) <= 64 * 48, "the box is 68 pixels wide"
    found = run(*command, "--sensor", "vlp-16", "--out", tmp_path / "scan.npz")
    assert found.returncode != 0
    assert "--camera must go with a pinhole sensor" in found.stderr
    found = run(*command, "--sensor", "pinhole", "--set-sensor", "fov=40", "--out", tmp_path / "both.npz")
    assert found.returncode != 0, "fov would change fx alone"
    assert "--set-sensor fov must not be beside --camera" in found.stderr


def test_views_with_intrinsics_of_their_own_go_without_a_camera(tmp_path: Path) -> None:
    """Both files say what the pictures are like; of those of the views --camera would not count."""
    written(tmp_path / "camera.json", json.dumps(BOP))
    pose = {"R": np.diag([1.0, -1.0, -1.0]).tolist(), "t": [0.0, 0.0, 5.0]}
    matrix = [[50.0, 0.0, 50.0], [0.0, 50.0, 50.0], [0.0, 0.0, 1.0]]
    box().to_trimesh().export(tmp_path / "box.stl")
    command = [
        "generate",
        tmp_path / "box.stl",
        "--unit",
        "m",
        "--sensor",
        "pinhole",
        "--camera",
        tmp_path / "camera.json",
    ]
    for intrinsics, code in (({"K": matrix, "width": 100, "height": 100}, 2), ({}, 0)):
        views = written(tmp_path / "views.json", json.dumps([{**pose, **intrinsics}]))
        found = run(*command, "--views", views, "--dry-run", "--out", tmp_path / "out")
        assert found.returncode == code, found.stderr
        assert ("--camera must go without --views of a file that has intrinsics" in found.stderr) == (code == 2)
