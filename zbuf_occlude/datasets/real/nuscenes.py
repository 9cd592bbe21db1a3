"""nuScenes: tables v1.0-*/NAME.json and the files samples/LIDAR_TOP/*.pcd.bin of its key frames.

sample_annotation   boxes in the world: translation, size (width, length, height), rotation (w, x, y, z), instance_token
sample_data         files, with is_key_frame, filename, and tokens of ego_pose and calibrated_sensor
ego_pose            pose of the car in the world; calibrated_sensor the pose of a sensor on the car
instance, category  names of the objects' categories, such as vehicle.car

Points are in the LiDAR's frame (x right, y forward, z up), metres. Boxes are turned into it.

References: Caesar et al., "nuScenes: a multimodal dataset for autonomous driving", CVPR 2020, and its schema.
"""

import json
from collections import defaultdict
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from zbuf_occlude.base.arrays import FloatArray
from zbuf_occlude.base.atomic import reading
from zbuf_occlude.base.errors import DatasetError
from zbuf_occlude.datasets.cloud_files import read_points
from zbuf_occlude.datasets.real.sweeps import REMEDY, LabelledBox, Loader, Sweep
from zbuf_occlude.geometry.camera import rotations_of, unit_quaternions

Rows = dict[str, dict[str, Any]]
CHANNEL = "LIDAR_TOP"
TABLES = ("sample_data", "sensor", "calibrated_sensor", "ego_pose", "instance", "category")
"""Tables that are read besides the annotations."""


def find(root: Path) -> list[Loader]:
    """Return a loader for each key frame of the LiDAR; a root holds the tables, or the folder that does."""
    files = sorted(path for depth in ("", "*/") for path in root.glob(f"{depth}sample_annotation.json"))
    return [loader for file in files for loader in _key_frames(file)]


def _key_frames(file: Path) -> list[Loader]:
    tables = {name: _rows(file.with_name(f"{name}.json")) for name in TABLES}
    with reading(file.with_name("instance.json"), REMEDY):
        categories, instances = tables["category"], tables["instance"].values()
        category_of = {row["token"]: categories[row["category_token"]]["name"] for row in instances}
    annotations = defaultdict(list)
    for row in _rows(file).values():
        with reading(file, REMEDY):
            annotations[row["sample_token"]].append({**row, "category": category_of[row["instance_token"]]})
    loaders: list[Loader] = []
    data = file.with_name("sample_data.json")
    with reading(data, REMEDY):
        for row in tables["sample_data"].values():
            mount = tables["calibrated_sensor"][row["calibrated_sensor_token"]]
            if row["is_key_frame"] and tables["sensor"][mount["sensor_token"]]["channel"] == CHANNEL:
                car, rows = tables["ego_pose"][row["ego_pose_token"]], annotations[row["sample_token"]]
                places = [root / row["filename"] for root in (file.parent, file.parent.parent)]
                cloud = next((place for place in places if place.exists()), places[-1])
                loaders.append(partial(_read, cloud, file, mount, car, rows))
    return loaders


def _rows(path: Path) -> Rows:
    """Read a table, a row by its token."""
    with reading(path, REMEDY):
        return {str(row["token"]): row for row in json.loads(path.read_bytes())}


def _read(cloud: Path, file: Path, mount: dict[str, Any], car: dict[str, Any], rows: list[dict[str, Any]]) -> Sweep:
    if not cloud.exists():
        raise DatasetError(f"{cloud} must be there, as {file.with_name('sample_data.json')} says; it is missing.")
    with reading(file, REMEDY):
        to_lidar = np.asarray(np.linalg.inv(_pose(car) @ _pose(mount)), np.float64)
        boxes = [_box(row, to_lidar) for row in rows]
    return Sweep(cloud.name.partition(".")[0], read_points(cloud), boxes)


def _pose(row: dict[str, Any]) -> FloatArray:
    """Return the pose (4, 4) in a row with a translation and a rotation; raises ValueError for another shape."""
    place, rotation = (np.asarray(row[name], dtype=np.float64) for name in ("translation", "rotation"))
    if place.shape != (3,) or rotation.shape != (4,) or not np.isfinite(place).all():
        raise ValueError("a pose must have three numbers of a translation and four of a rotation")
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotations_of(unit_quaternions(rotation[[1, 2, 3, 0]])), place
    return matrix


def _box(row: dict[str, Any], to_lidar: FloatArray) -> LabelledBox:
    pose = to_lidar @ _pose(row)
    width, length, height = (float(side) for side in row["size"])
    if not np.isfinite([width, length, height]).all():
        raise ValueError("a size must be three finite numbers")
    size = np.array([length, width, height])
    return LabelledBox(str(row["category"]), pose[:3, 3], pose[:3, :3], size, str(row["instance_token"]))
