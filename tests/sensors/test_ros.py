"""Organised PCD and MCAP of a camera's views, read by Open3D, PyYAML and rosbags; against `zo.frames` of the same."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import zbuf_occlude as zo
from tests.scenes import box
from zbuf_occlude.sensors.frames import Frame
from zbuf_occlude.sensors.ros import mcap_file, organized_files
from zbuf_occlude.sensors.scenes import Placed, moved

SENSOR = zo.sensors.make("realsense-d435", width=64, height=48, fov=60, cx=30.25, match_window=1)
SCENE = zo.Scene.joined([Placed(box(), "a"), Placed(box(), "b", moved(scale=0.4, to=(1.2, 0.3, 0.1)))])
VIEWS = zo.views.ring(3, elevation=25, distance=2.5)


@pytest.fixture(scope="module")
def found() -> list[Frame]:
    frames = list(zo.frames(SCENE, VIEWS, sensor=SENSOR))
    assert all(0.02 < np.isfinite(frame.depth).mean() < 0.9 for frame in frames)
    return frames


@pytest.mark.needs("open3d")
def test_organised_clouds_are_read_by_open3d(found: list[Frame], tmp_path: Path) -> None:
    import open3d as o3d

    names = organized_files(tmp_path, found)
    assert sorted(names) == sorted(path.name for path in tmp_path.iterdir())
    assert names == ["000.pcd", "001.pcd", "002.pcd", "camera_info.yaml", "cameras.json"]
    for number, frame in enumerate(found):
        path = tmp_path / f"{number:03d}.pcd"
        header = dict(line.split(" ", 1) for line in path.read_bytes().partition(b"DATA")[0].decode().splitlines()[1:])
        assert (header["WIDTH"], header["HEIGHT"], header["POINTS"]) == ("64", "48", "3072")
        cloud = o3d.io.read_point_cloud(str(path))
        points, measured = np.asarray(cloud.points).reshape(48, 64, 3), np.isfinite(frame.depth)
        assert (np.isfinite(points).all(axis=2) == measured).all()
        assert points[..., 2][measured] == pytest.approx(frame.depth[measured])
        assert np.asarray(cloud.colors).reshape(48, 64, 3) == pytest.approx(frame.rgba[..., :3] / 255.0)
        rows, columns = np.nonzero(measured)
        pixels = points[measured] @ frame.intrinsics.T
        assert pixels[:, :2] / pixels[:, 2:] == pytest.approx(np.stack([columns + 0.5, rows + 0.5], axis=1), abs=1e-4)
        x, y, z, *quaternion = map(float, header["VIEWPOINT"].split())
        in_world = points[measured] @ o3d.geometry.get_rotation_matrix_from_quaternion(quaternion).T + [x, y, z]
        assert in_world == pytest.approx(frame.points, abs=1e-5)
        kept = o3d.io.read_point_cloud(str(path), remove_nan_points=True)
        assert len(kept.points) == measured.sum()


def test_the_camera_beside_organised_clouds(found: list[Frame], tmp_path: Path) -> None:
    organized_files(tmp_path, found)
    about = yaml.safe_load((tmp_path / "camera_info.yaml").read_text())
    assert (about["image_width"], about["image_height"]) == (64, 48)
    assert about["camera_matrix"]["data"][2] == pytest.approx(30.25 - 0.5), "the first pixel is 0, as in OpenCV"
    assert (
        np.reshape(about["projection_matrix"]["data"], (3, 4))[:, :3].ravel().tolist() == about["camera_matrix"]["data"]
    )
    again = zo.sensors.make("pinhole", **zo.sensors.read_intrinsics(tmp_path / "camera_info.yaml"))
    assert again.intrinsics == pytest.approx(SENSOR.intrinsics)
    assert zo.views.from_json(tmp_path / "cameras.json").poses == pytest.approx(VIEWS.poses)


def test_cameras_that_differ_have_a_file_each(tmp_path: Path) -> None:
    wide, narrow = (next(zo.frames(SCENE, VIEWS, width=16, height=12, fov=fov)) for fov in (80, 40))
    assert organized_files(tmp_path, [wide, narrow])[2:4] == ["000_camera_info.yaml", "001_camera_info.yaml"]


@pytest.mark.needs("mcap_ros2")
@pytest.mark.needs("rosbags")
def test_messages_are_read_by_rosbags(found: list[Frame], tmp_path: Path) -> None:
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    assert mcap_file(tmp_path, found) == ["frames.mcap"]
    read: dict[str, list[Any]] = {}
    with AnyReader([tmp_path / "frames.mcap"], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
        for connection, time, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            read.setdefault(connection.topic, []).append(message)
            if connection.topic != "/tf":
                assert (message.header.frame_id, message.header.stamp.sec) == ("camera_optical_frame", time // 10**9)
    assert {len(messages) for messages in read.values()} == {3}
    topics = ("/camera/points", "/camera/camera_info", "/camera/color/image_raw", "/camera/depth/image_raw", "/tf")
    for frame, cloud, info, color, depth, moved_by in zip(found, *(read[topic] for topic in topics), strict=True):
        measured = np.isfinite(frame.depth)
        assert [(each.name, each.offset, each.datatype) for each in cloud.fields][:3] == [
            ("x", 0, 7), ("y", 4, 7), ("z", 8, 7)]  # fmt: skip
        assert (cloud.height, cloud.width, cloud.is_dense, cloud.row_step) == (48, 64, False, 64 * cloud.point_step)
        points = np.frombuffer(cloud.data.tobytes(), "<f4").reshape(48, 64, 4)[..., :3]
        assert (np.isfinite(points).all(axis=2) == measured).all()
        metres = np.frombuffer(depth.data.tobytes(), "<f4").reshape(depth.height, depth.width)
        assert (depth.encoding, depth.step) == ("32FC1", 4 * 64)
        assert np.array_equal(metres, np.where(measured, frame.depth, np.nan), equal_nan=True)
        assert np.array_equal(color.data.reshape(48, 64, 3), frame.rgba[..., :3])
        assert info.k.reshape(3, 3) == pytest.approx(frame.opencv_intrinsics)
        assert info.p.reshape(3, 4)[:, :3] == pytest.approx(frame.opencv_intrinsics)
        (stamped,) = moved_by.transforms
        assert (stamped.header.frame_id, stamped.child_frame_id) == ("world", "camera_optical_frame")
        at, turn = stamped.transform.translation, stamped.transform.rotation
        rotation = rotation_of(turn.x, turn.y, turn.z, turn.w)
        assert points[measured] @ rotation.T + [at.x, at.y, at.z] == pytest.approx(frame.points, abs=1e-5)


def rotation_of(x: float, y: float, z: float, w: float) -> np.ndarray:
    """Return the rotation of a unit quaternion: the vectors that q v q* turns the axes to."""
    scalar, vector = w, np.array([x, y, z])
    assert scalar**2 + vector @ vector == pytest.approx(1.0)
    return np.array([v + 2 * np.cross(vector, np.cross(vector, v) + scalar * v) for v in np.eye(3)]).T


def test_the_fields_of_a_pcd_hold_what_they_name(tmp_path: Path) -> None:
    """Of one pixel without a hit the colour is black and the point NaN."""
    frame = next(zo.frames(SCENE, VIEWS, width=8, height=6, fov=100))
    organized_files(tmp_path, [frame])
    header, _, body = (tmp_path / "000.pcd").read_bytes().partition(b"DATA binary\n")
    assert b"FIELDS x y z rgb\n" in header
    table = np.frombuffer(body, "<f4").reshape(6, 8, 4)
    assert np.isnan(table[..., :3][~frame.mask]).all()
    assert (table[..., 3].view("<u4")[~frame.mask] == 0).all()
    assert json.loads((tmp_path / "cameras.json").read_text())["cameras"][0]["width"] == 8
