"""Frames for ROS 2 and PCL: organised PCD with camera_info.yaml, and MCAP files of messages.

Points are in the camera's optical frame: x right, y down, z forward, metres. The centre of the first pixel is (0, 0) in
ROS's camera matrices, as in OpenCV. Views are a second apart.
"""

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from zbuf_occlude.base.extras import importing
from zbuf_occlude.base.point_files import pcl_table, write_pcd_columns
from zbuf_occlude.geometry.camera import quaternion_of
from zbuf_occlude.sensors.frames import CAMERAS, Frame

CAMERA_INFO, MCAP = "camera_info.yaml", "frames.mcap"
WORLD, OPTICAL = "world", "camera_optical_frame"
"""Names of the coordinate frames."""
FLOAT32 = 7
"""Datatype of a PointField."""

_HEADER = """MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
===
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec"""
_DEFINITIONS = {
    "sensor_msgs/msg/Image": f"""std_msgs/Header header
uint32 height
uint32 width
string encoding
uint8 is_bigendian
uint32 step
uint8[] data
===
{_HEADER}""",
    "sensor_msgs/msg/CameraInfo": f"""std_msgs/Header header
uint32 height
uint32 width
string distortion_model
float64[] d
float64[9] k
float64[9] r
float64[12] p
uint32 binning_x
uint32 binning_y
sensor_msgs/RegionOfInterest roi
===
{_HEADER}
===
MSG: sensor_msgs/RegionOfInterest
uint32 x_offset
uint32 y_offset
uint32 height
uint32 width
bool do_rectify""",
    "sensor_msgs/msg/PointCloud2": f"""std_msgs/Header header
uint32 height
uint32 width
sensor_msgs/PointField[] fields
bool is_bigendian
uint32 point_step
uint32 row_step
uint8[] data
bool is_dense
===
{_HEADER}
===
MSG: sensor_msgs/PointField
uint8 INT8=1
uint8 UINT8=2
uint8 INT16=3
uint8 UINT16=4
uint8 INT32=5
uint8 UINT32=6
uint8 FLOAT32=7
uint8 FLOAT64=8
string name
uint32 offset
uint8 datatype
uint32 count""",
    "tf2_msgs/msg/TFMessage": f"""geometry_msgs/TransformStamped[] transforms
===
MSG: geometry_msgs/TransformStamped
std_msgs/Header header
string child_frame_id
geometry_msgs/Transform transform
===
{_HEADER}
===
MSG: geometry_msgs/Transform
geometry_msgs/Vector3 translation
geometry_msgs/Quaternion rotation
===
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
===
MSG: geometry_msgs/Quaternion
float64 x
float64 y
float64 z
float64 w""",
}
"""Definitions of the messages, those of ROS 2's common_interfaces and geometry2, without comments."""


def _pose(frame: Frame) -> tuple[list[float], list[float]]:
    """Return position and quaternion (w x y z) of the optical frame in the world."""
    rotation, translation = frame.extrinsics[:, :3], frame.extrinsics[:, 3]
    return (-rotation.T @ translation).tolist(), quaternion_of(rotation.T).tolist()


def _camera_matrices(frame: Frame) -> dict[str, list[float]]:
    """Return D, K, R and P of a camera without distortion."""
    matrix = frame.opencv_intrinsics
    projection = np.column_stack([matrix, np.zeros(3)])
    values = {"d": np.zeros(5), "k": matrix, "r": np.eye(3), "p": projection}
    return {name: each.ravel().tolist() for name, each in values.items()}


def _calibration(frame: Frame) -> str:
    """Return a camera as a YAML document, as ROS's camera_calibration writes it."""
    (height, width), found = frame.depth.shape, _camera_matrices(frame)
    shapes = {"k": ("camera_matrix", 3, 3), "d": ("distortion_coefficients", 1, 5)}
    shapes |= {"r": ("rectification_matrix", 3, 3), "p": ("projection_matrix", 3, 4)}
    matrices = {long: {"rows": m, "cols": n, "data": found[name]} for name, (long, m, n) in shapes.items()}
    about = {"image_width": width, "image_height": height, "camera_name": "camera", "distortion_model": "plumb_bob"}
    return str(yaml.safe_dump({**about, **matrices}, sort_keys=False, default_flow_style=None))


def organized_files(folder: Path, found: Iterable[Frame]) -> list[str]:
    """Write the frames of an object as organised clouds; return the names of the files.

    =================  =============================================================================================
    000.pcd            x, y, z, rgb of each pixel, row by row; NaN where nothing is measured; VIEWPOINT: the pose of the
                       camera in the world
    camera_info.yaml   size, K, D = 0, R, P; one for each view, 000_camera_info.yaml, where they differ
    cameras.json       `Frame.camera` of each view: R and t, world to camera; K, the first pixel's centre at (0.5, 0.5)
    =================  =============================================================================================
    """
    folder.mkdir(parents=True, exist_ok=True)
    names, calibrations, cameras = list[str](), list[str](), list[dict[str, Any]]()
    for number, frame in enumerate(found):
        names.append(f"{number:03d}.pcd")
        position, quaternion = _pose(frame)
        points, colors = frame.organized.reshape(-1, 3), frame.rgba[..., :3].reshape(-1, 3)
        size, viewpoint = frame.depth.shape, [*position, *quaternion]
        write_pcd_columns(
            folder / names[-1], points, colors=colors, size=(size[0], size[1]), viewpoint=viewpoint, synced=False
        )
        calibrations.append(_calibration(frame))
        cameras.append(frame.camera)
    if len(set(calibrations)) == 1:
        documents = {CAMERA_INFO: calibrations[0]}
    else:
        documents = {f"{number:03d}_{CAMERA_INFO}": text for number, text in enumerate(calibrations)}
    documents[CAMERAS] = json.dumps({"cameras": cameras}, indent=1)
    for name, text in documents.items():
        (folder / name).write_text(text)
    return [*names, *documents]


def mcap_file(folder: Path, found: Iterable[Frame]) -> list[str]:
    """Write the frames of an object as ``frames.mcap``; return the names of the files.

    =========================  ==================================================================================
    /camera/points             PointCloud2, organised: x, y, z, rgb; NaN where nothing is measured
    /camera/camera_info        CameraInfo
    /camera/color/image_raw    Image, rgb8
    /camera/depth/image_raw    Image, 32FC1, metres; NaN where nothing is measured
    /tf                        TFMessage: ``world`` to ``camera_optical_frame``
    =========================  ==================================================================================
    """
    with importing("mcap_ros2", "--format mcap"):
        from mcap_ros2.writer import Writer
    folder.mkdir(parents=True, exist_ok=True)
    with open(folder / MCAP, "wb") as file, Writer(file) as writer:
        schemas = {
            name: writer.register_msgdef(name, text.replace("===", "=" * 80)) for name, text in _DEFINITIONS.items()
        }
        for number, frame in enumerate(found):
            for topic, (kind, message) in _messages(frame, number + 1).items():
                time = (number + 1) * 10**9
                writer.write_message(topic, schemas[kind], message, log_time=time, publish_time=time, sequence=number)
    return [MCAP]


def _messages(frame: Frame, second: int) -> dict[str, tuple[str, dict[str, Any]]]:
    """Return type and content of the messages of a frame, by topic."""
    height, width = frame.depth.shape
    header = {"stamp": {"sec": second, "nanosec": 0}, "frame_id": OPTICAL}
    size = {"header": header, "height": height, "width": width}
    colors = np.ascontiguousarray(frame.rgba[..., :3])
    depth = np.where(np.isfinite(frame.depth), frame.depth, np.float32(np.nan)).astype("<f4")
    names, table = pcl_table(frame.organized.reshape(-1, 3), colors=colors.reshape(-1, 3))
    step = table.shape[1] * table.itemsize
    fields = [{"name": name, "offset": 4 * i, "datatype": FLOAT32, "count": 1} for i, name in enumerate(names)]
    cloud = {**size, "fields": fields, "point_step": step, "row_step": step * width, "data": table.tobytes()}
    color = {**size, "encoding": "rgb8", "step": 3 * width, "data": colors.tobytes()}
    metres = {**size, "encoding": "32FC1", "step": 4 * width, "data": depth.tobytes()}
    position, (w, x, y, z) = _pose(frame)
    transform = {
        "header": {**header, "frame_id": WORLD},
        "child_frame_id": OPTICAL,
        "transform": {
            "translation": dict(zip("xyz", position, strict=True)),
            "rotation": {"x": x, "y": y, "z": z, "w": w},
        },
    }
    return {
        "/tf": ("tf2_msgs/msg/TFMessage", {"transforms": [transform]}),
        "/camera/camera_info": (
            "sensor_msgs/msg/CameraInfo",
            {**size, "distortion_model": "plumb_bob", **_camera_matrices(frame)},
        ),
        "/camera/color/image_raw": ("sensor_msgs/msg/Image", color),
        "/camera/depth/image_raw": ("sensor_msgs/msg/Image", metres),
        "/camera/points": ("sensor_msgs/msg/PointCloud2", cloud),
    }
