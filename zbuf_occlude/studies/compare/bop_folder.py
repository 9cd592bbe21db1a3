"""Reader of BOP folders (benchmark for 6D object poses): cameras, poses and models; millimetres to metres."""

import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from zbuf_occlude.base.arrays import FloatArray
from zbuf_occlude.base.errors import DatasetError, OptionError, describe, escape_control
from zbuf_occlude.base.extras import importing
from zbuf_occlude.sensors.bop import MILLIMETRES
from zbuf_occlude.sensors.sensor import Sensor

CAMERA_TO_SENSOR = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""Rotation from a camera's frame (x right, y down, z forward) to a sensor's (x forward, y left, z up)."""
_MODEL = re.compile(r"obj_(\d+)\.ply", re.IGNORECASE)


class Camera(NamedTuple):
    """Camera of a depth image: K with the origin at the first pixel's centre, and metres of one step of the image."""

    image: Path
    matrix: FloatArray
    depth_unit: float

    def sensor(self, sensor: Sensor) -> Sensor:
        """Return a pinhole sensor with this camera's K and the image's size.

        Raises
        ------
        OptionError
            The sensor is no pinhole.
        DatasetError
            The image cannot be read.
        """
        if sensor.kind != "pinhole":
            raise OptionError(f"a depth image must be of a pinhole sensor; {sensor.name} is {sensor.kind}.")
        (fx, _, cx), (_, fy, cy), _ = self.matrix.tolist()
        width, height = _size(self.image)
        return sensor.with_numbers(width=width, height=height, f=fx, fy=fy, cx=cx + 0.5, cy=cy + 0.5)


def camera_of(image: Path) -> Camera | None:
    """Read the camera of a depth image ``depth/000000.png`` from ``scene_camera.json``; None without that file.

    Raises
    ------
    DatasetError
        The file cannot be read, or lacks this image.
    """
    path = image.absolute().parent.parent / "scene_camera.json"
    if not path.exists():
        return None
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
        found = {int(number): each for number, each in document.items()}[int(image.stem)]
        matrix = np.array(found["cam_K"], dtype=np.float64).reshape(3, 3)
        scale = float(found["depth_scale"])
        if not (np.isfinite(matrix).all() and 0.0 < scale < np.inf):
            raise ValueError("cam_K and depth_scale must be finite, and depth_scale above 0")
        if matrix[0, 1] or matrix[1, 0]:
            raise ValueError("cam_K must have no skew")
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        said = f"{error} is missing" if isinstance(error, KeyError) else describe(error)
        raise DatasetError(escape_control(f"{path}: cannot read the camera of {image.name}: {said}")) from None
    return Camera(image, matrix, scale / MILLIMETRES)


def model_number(mesh: Path) -> int | None:
    """Return the ``obj_id`` of a BOP model (``obj_000001.ply`` beside ``models_info.json``); None for other files."""
    found = _MODEL.fullmatch(mesh.name)
    return int(found[1]) if found and mesh.with_name("models_info.json").exists() else None


def poses_of(document: Any, scans: Sequence[Path], model: int | None) -> list[FloatArray]:
    """Return the sensor's pose (4, 4) in the model's space for each scan, in metres, from ``scene_gt.json``.

    Scans whose names are numbers of images belong to these images; other scans follow the order of the images. Where an
    image has several instances of the model, the first counts.

    Raises
    ------
    ValueError, KeyError, TypeError, AttributeError
        The document is malformed; an image lacks the model; or an image has several objects and `model` is None.
    """
    images = {int(number): rows for number, rows in document.items()}
    stems = [int(scan.stem) if scan.stem.isdecimal() else -1 for scan in scans]
    numbers = stems if set(stems) <= set(images) else sorted(images)
    poses = []
    for number in numbers:
        rows = [row for row in images[number] if model is None or row["obj_id"] == model]
        kinds = sorted({row["obj_id"] for row in rows})
        if not rows:
            raise ValueError(f"image {number} has no object" + ("" if model is None else f" {model}"))
        if len(kinds) > 1:
            raise ValueError(
                f"image {number} has the objects {', '.join(map(str, kinds))}. Give the model of one of them "
                "(models/obj_000001.ply beside models_info.json)"
            )
        pose = np.eye(4)
        pose[:3, :3] = CAMERA_TO_SENSOR @ np.array(rows[0]["cam_R_m2c"], dtype=np.float64).reshape(3, 3)
        pose[:3, 3] = CAMERA_TO_SENSOR @ np.array(rows[0]["cam_t_m2c"], dtype=np.float64).reshape(3) / MILLIMETRES
        poses.append(np.asarray(np.linalg.inv(pose), dtype=np.float64))
    return poses


def _size(image: Path) -> tuple[int, int]:
    with importing("PIL", "reading depth images"):
        from PIL import Image
    try:
        with Image.open(image) as opened:
            return opened.size
    except OSError as error:
        raise DatasetError(
            f"{escape_control(str(image))}: cannot read the scan: {escape_control(describe(error))}"
        ) from None
