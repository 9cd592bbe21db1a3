"""Cameras from files: JSON, CSV, NeRF's transforms.json, COLMAP's files; what is wrong in them, and distortion."""

import json
import re
import struct
from pathlib import Path

import numpy as np
import pytest

from zbuf_occlude import ArgumentError, OptionError, Views, views

# two cameras, OpenCV's way: world to eye space, y down, z forward
CAMERA_EYES = np.array([[3.0, 0.5, 1.0], [-1.0, 4.0, 2.0]])
FOCAL, WIDTH, HEIGHT = 500.0, 640.0, 480.0


def opencv() -> tuple[np.ndarray, np.ndarray]:
    """Rotations and translations of cameras that look at (0.1, 0.2, 0.3), upright."""
    rotations = []
    for eye in CAMERA_EYES:
        forward = np.array([0.1, 0.2, 0.3]) - eye
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, [0, 0, 1])
        right /= np.linalg.norm(right)
        rotations.append([right, np.cross(forward, right), forward])
    return np.array(rotations), -np.einsum("kij,kj->ki", rotations, CAMERA_EYES)


def quaternion(rotation: np.ndarray) -> np.ndarray:
    w = np.sqrt(max(0.0, 1 + np.trace(rotation))) / 2
    x, y, z = (rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1])
    return np.array([w, x / (4 * w), y / (4 * w), z / (4 * w)])


def write_cameras(folder: Path, form: str) -> str:
    rotations, translations = opencv()
    intrinsics = [[FOCAL, 0, WIDTH / 2], [0, FOCAL, HEIGHT / 2], [0, 0, 1]]
    items = [
        {"K": intrinsics, "R": r.tolist(), "t": t.tolist(), "width": WIDTH, "height": HEIGHT}
        for r, t in zip(rotations, translations, strict=True)
    ]

    def written(name: str, content: str | bytes) -> str:
        (folder / name).write_bytes(content if isinstance(content, bytes) else content.encode())
        return str(folder / name)

    if form == "json":
        return written("c.json", json.dumps(items))
    if form == "jsonl":
        return written("c.jsonl", "\n".join(map(json.dumps, items)))
    if form == "csv":
        names = [*(f"r{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3)), "t1", "t2", "t3"]
        names += ["fx", "fy", "cx", "cy", "width", "height"]
        rows = [
            [*r.ravel(), *t, FOCAL, FOCAL, WIDTH / 2, HEIGHT / 2, WIDTH, HEIGHT]
            for r, t in zip(rotations, translations, strict=True)
        ]
        return written("c.csv", "\n".join(",".join(map(str, row)) for row in [names, *rows]))
    if form == "nerf":
        frames = []
        for r, eye in zip(rotations, CAMERA_EYES, strict=True):
            to_world = np.eye(4)
            to_world[:3, :3], to_world[:3, 3] = r.T @ np.diag([1, -1, -1]), eye
            frames.append({"file_path": "x.png", "transform_matrix": to_world.tolist()})
        angle = 2 * np.arctan(WIDTH / 2 / FOCAL)
        return written(
            "transforms.json", json.dumps({"camera_angle_x": angle, "w": WIDTH, "h": HEIGHT, "frames": frames})
        )
    poses = [(i, *quaternion(r), *t, i) for i, (r, t) in enumerate(zip(rotations, translations, strict=True), 1)]
    if form == "colmap binary":
        pinhole = struct.pack("<iiQQ4d", 1, 1, 640, 480, 500, 500, 320, 240)
        radial = struct.pack("<iiQQ4d", 2, 2, 640, 480, 500, 320, 240, 0)
        written("cameras.bin", struct.pack("<Q", 2) + pinhole + radial)
        data = struct.pack("<Q", 2)
        for n_points, pose in zip((0, 3), poses, strict=True):
            data += struct.pack("<I7dI", *pose) + "straße.png".encode() + b"\0"
            data += struct.pack("<Q", n_points) + bytes(24 * n_points)
        return written("images.bin", data)
    written("cameras.txt", "# cameras\n1 PINHOLE 640 480 500 500 320 240\n2 SIMPLE_RADIAL 640 480 500 320 240 0\n")
    lines = [f"{' '.join(map(str, pose))} x.png\n{points}" for pose, points in zip(poses, ("", "1 2 3"), strict=True)]
    return written("images.txt", "\n".join(["# images", *lines]) + "\n")


@pytest.mark.parametrize("form", ["json", "jsonl", "csv", "nerf", "colmap", "colmap binary"])
def test_cameras_from_files(tmp_path: Path, form: str) -> None:
    made = views.parse(write_cameras(tmp_path, form))
    assert np.allclose(made.eyes, CAMERA_EYES, atol=1e-9)
    assert np.allclose(made.around([1, 2, 3], 7.0).eyes, CAMERA_EYES, atol=1e-9), "they stand where they are"
    points = np.random.default_rng(0).uniform(-3, 3, (500, 3))
    rotations, translations = opencv()
    x, y, z = (points @ rotations[1].T + translations[1]).T
    u, v = FOCAL * x / z + WIDTH / 2, FOCAL * y / z + HEIGHT / 2
    seen = (z > 0) & (u >= 0) & (u <= WIDTH) & (v >= 0) & (v <= HEIGHT)
    assert 50 < seen.sum() < 450
    assert (made.in_frustum(points)[1] == seen).all()


def test_a_camera_may_stand_at_the_worlds_origin_and_at_the_objects_centre(tmp_path: Path) -> None:
    """OpenCV's identity: at the origin, looking along +z, y down; of a plate in front of it all is in the picture."""
    path = tmp_path / "a.json"
    path.write_text(
        '[{"R": [[1,0,0],[0,1,0],[0,0,1]], "t": [0,0,0], "K": [[50,0,50],[0,50,50],[0,0,1]], '
        '"width": 100, "height": 100}]'
    )
    made = views.parse(str(path))
    for there in (made, made.around([0.0, 0.0, 0.0], 7.0), made.around([0.0, 3.0, 4.0], 7.0), made.select([0])):
        assert np.allclose(there.eyes, 0, atol=1e-12)
        assert np.allclose(there.poses[0], np.diag([1.0, -1.0, -1.0, 1.0]))
        assert there.in_frustum(np.array([[0.9, -0.9, 1.0], [1.1, 0, 1.0], [0, 0, -1.0]])).tolist() == [
            [True, False, False]
        ]
    assert np.array_equal(Views.from_rows(made.to_rows()).eyes, made.eyes)
    with pytest.raises(ArgumentError, match="distance must be positive; got 0"):
        Views([0.0], [0.0], 0.0)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.json", "{", "must be JSON; it cannot be read"),
        ("a.json", "[]", "must contain cameras, each with R and t; number 0 cannot be read (it has none)"),
        ("a.json", '[{"R": [[1,0,0],[0,1,0],[0,0,1]]}]', "number 0 cannot be read (no 't')"),
        ("a.json", '[{"R": [[2,0,0],[0,1,0],[0,0,1]], "t": [0,0,1]}]', "R must be a rotation, and is none"),
        ("a.json", '[{"R": [[1,0,0],[0,1,0],[0,0,-1]], "t": [0,0,1]}]', "R must be a rotation, and is none"),
        ("images.txt", "1 1 0 0 0 0 0 1 9 x.png\n\n", "must contain cameras"),
        ("images.txt", "1 1 0 0\n", "must contain cameras"),
        ("images.txt", "1 1 0 0 0 0 0 1 2 x.png\n\n", "camera 2 must have the 8 parameters of a OPENCV; it has 4"),
    ],
)
def test_bad_cameras(tmp_path: Path, name: str, content: str, message: str) -> None:
    (tmp_path / name).write_text(content)
    (tmp_path / "cameras.txt").write_text("1 PINHOLE 640 480 500 500 320 240\n2 OPENCV 640 480 500 500 320 240\n")
    with pytest.raises(OptionError, match=re.escape(message)) as caught:
        views.parse(str(tmp_path / name))
    assert str(tmp_path / name) in str(caught.value)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("# cameras\n", r"cameras\.txt contains no cameras"),
        (
            "1 PINHOLE 640 480 500 500 320 240\n2 SIMPLE_RADIAL 640 480 500 320 240 0.1\n",
            "camera 2 is a SIMPLE_RADIAL with distortion; undistort",
        ),
    ],
)
def test_no_cameras_and_distortion_are_refused(tmp_path: Path, content: str, message: str) -> None:
    path = write_cameras(tmp_path, "colmap")
    (tmp_path / "cameras.txt").write_text(content)
    with pytest.raises(OptionError, match=message):
        views.parse(path)


def test_distortion_is_refused_in_transforms_too(tmp_path: Path) -> None:
    path = tmp_path / "transforms.json"
    frame = {"transform_matrix": (np.eye(4) + np.diag([4.0], 3)).tolist()}
    plain = {"camera_angle_x": 0.7, "k1": 0.0, "p2": 0, "frames": [frame]}
    path.write_text(json.dumps(plain))
    assert len(views.parse(str(path))) == 1
    path.write_text(json.dumps(plain | {"k1": 0.2}))
    with pytest.raises(OptionError, match=r"k1 is 0\.2, a distortion; undistort the images first"):
        views.parse(str(path))
