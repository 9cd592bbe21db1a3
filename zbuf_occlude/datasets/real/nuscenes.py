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
from zbuf_occlude.datasets.real.sweeps import REMEDY, LabelledBox, Loader, Sweep, checked_sides
from zbuf_occlude.geometry.camera import rotations_of, unit_quaternions

Rows = dict[str, dict[str, Any]]
CHANNEL = "LIDAR_TOP"
TABLES = ("sample_data", "sensor", "calibrated_sensor", "ego_pose", "instance", "category")
"""Tables that are read besides the annotations."""


def find(root: Path) -> list[Loader]:
    """Return a loader for each key frame of the LiDAR; a root holds the tables, or the folder that does.

    Raises DatasetError where a table is damaged, or there is no such frame.
    """
    files = sorted(path for depth in ("", "*/") for path in root.glob(f"{depth}sample_annotation.json"))
    return [loader for file in files for loader in _key_frames(file)]


def _key_frames(file: Path) -> list[Loader]:
    tables = {name: _rows(_of(file, name)) for name in TABLES}

    def row_of(name: str, token: str, named_by: str) -> dict[str, Any]:
        """Return the row of a token that another table names; raise DatasetError where it is missing."""
        if token not in tables[name]:
            raise DatasetError(
                f"{_of(file, name)} must have the row {token!r:.60} that {named_by}.json names; it has not. {REMEDY}"
            )
        return tables[name][token]

    with reading(_of(file, "category"), REMEDY):
        names = {token: row["name"] for token, row in tables["category"].items()}
    with reading(_of(file, "instance"), REMEDY):
        categories = {token: row["category_token"] for token, row in tables["instance"].items()}
    annotations = defaultdict(list)
    for row in _rows(file).values():
        with reading(file, REMEDY):
            instance = row_of("instance", row["instance_token"], file.stem)["token"]
            category = row_of("category", categories[instance], "instance")["token"]
            annotations[row["sample_token"]].append({**row, "category": names[category]})
    loaders: list[Loader] = []
    for row in tables["sample_data"].values():
        with reading(_of(file, "sample_data"), REMEDY):
            mount = row_of("calibrated_sensor", row["calibrated_sensor_token"], "sample_data")
            is_key_frame, sample = row["is_key_frame"], row["sample_token"]
            car = row_of("ego_pose", row["ego_pose_token"], "sample_data") if is_key_frame else {}
            places = [root / row["filename"] for root in (file.parent, file.parent.parent)]
        with reading(_of(file, "calibrated_sensor"), REMEDY):
            sensor = row_of("sensor", mount["sensor_token"], "calibrated_sensor")
        with reading(_of(file, "sensor"), REMEDY):
            is_of_lidar = sensor["channel"] == CHANNEL
        if is_key_frame and is_of_lidar:
            cloud = next((place for place in places if place.exists()), places[-1])
            loaders.append(partial(_read, cloud, file, mount, car, annotations[sample]))
    if not loaders:
        raise DatasetError(f"{_of(file, 'sample_data')} must have a key frame of {CHANNEL}; it has none. {REMEDY}")
    return loaders


def _of(file: Path, name: str) -> Path:
    """Return the file of another table, given that of the annotations."""
    return file.with_name(f"{name}.json")


def _rows(path: Path) -> Rows:
    """Read a table, a row by its token."""
    with reading(path, REMEDY):
        return {str(row["token"]): row for row in json.loads(path.read_bytes())}


def _read(cloud: Path, file: Path, mount: dict[str, Any], car: dict[str, Any], rows: list[dict[str, Any]]) -> Sweep:
    if not cloud.exists():
        raise DatasetError(f"{cloud} must be there, as {_of(file, 'sample_data')} says; it is missing.")
    with reading(_of(file, "ego_pose"), REMEDY):
        of_car = _pose(car)
    with reading(_of(file, "calibrated_sensor"), REMEDY):
        of_lidar = of_car @ _pose(mount)
    with reading(file, REMEDY):
        to_lidar = np.asarray(np.linalg.inv(of_lidar), np.float64)
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
    size = checked_sides([length, width, height])
    return LabelledBox(str(row["category"]), pose[:3, 3], pose[:3, :3], size, str(row["instance_token"]))
