"""A folder of BOP, the benchmark for 6D poses, read: cameras, poses and models; millimetres in, metres out."""

import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from zbuf_occlude.arrays import FloatArray
from zbuf_occlude.errors import DatasetError, OptionError, describe, escape_control
from zbuf_occlude.extras import importing
from zbuf_occlude.sensors.bop import MILLIMETRES
from zbuf_occlude.sensors.sensor import Sensor

CAMERA_TO_SENSOR = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""From a camera's frame (x right, y down, z forward) to a sensor's (x forward, y left, z up)."""
_MODEL = re.compile(r"obj_(\d+)\.ply", re.IGNORECASE)


class Camera(NamedTuple):
    """The camera of a depth image: K counted from the first pixel's centre, and metres of one step of the image."""

    image: Path
    matrix: FloatArray
    depth_unit: float

    def sensor(self, sensor: Sensor) -> Sensor:
        """Return a pinhole sensor with this camera's K and the image's size.

        Raises
        ------
        OptionError
            It is no pinhole.
        DatasetError
            The image cannot be read.
        """
        if sensor.kind != "pinhole":
            raise OptionError(f"a depth image must be of a pinhole sensor; {sensor.name} is {sensor.kind}.")
        (fx, _, cx), (_, fy, cy), _ = self.matrix.tolist()
        width, height = _size(self.image)
        return sensor.with_numbers(width=width, height=height, f=fx, fy=fy, cx=cx + 0.5, cy=cy + 0.5)


def camera_of(image: Path) -> Camera | None:
    """Read what ``scene_camera.json`` says of a scene's depth image ``depth/000000.png``; None where there is none.

    Raises
    ------
    DatasetError
        It cannot be read, or says nothing of this image.
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
            raise ValueError("cam_K and depth_scale must be finite, and the scale above 0")
        if matrix[0, 1] or matrix[1, 0]:
            raise ValueError("cam_K must have no skew")
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        said = f"it has no {error}" if isinstance(error, KeyError) else describe(error)
        raise DatasetError(escape_control(f"{path}: cannot read the camera of {image.name}: {said}")) from None
    return Camera(image, matrix, scale / MILLIMETRES)


def model_number(mesh: Path) -> int | None:
    """Return the ``obj_id`` of a model of BOP, ``obj_000001.ply`` beside ``models_info.json``; None of other files."""
    found = _MODEL.fullmatch(mesh.name)
    return int(found[1]) if found and mesh.with_name("models_info.json").exists() else None


def poses_of(document: Any, scans: Sequence[Path], model: int | None) -> list[FloatArray]:
    """Return of each scan the sensor's pose (4, 4) in the model's space, metres, by ``scene_gt.json``.

    Scans that are named by the numbers of images are these images; others are in their order. Of several objects of
    the same model in an image the first is taken.

    Raises
    ------
    ValueError, KeyError, TypeError, AttributeError
        It is not what it should be; an image has not the model; or several objects where `model` is None.
    """
    images = {int(number): rows for number, rows in document.items()}
    stems = [int(scan.stem) if scan.stem.isdecimal() else -1 for scan in scans]
    numbers = stems if set(stems) <= set(images) else sorted(images)
    poses = []
    for number in numbers:
        rows = [row for row in images[number] if model is None or row["obj_id"] == model]
        kinds = sorted({row["obj_id"] for row in rows})
        if not rows:
            raise ValueError(f"image {number} must have the object {'' if model is None else model}; it has not")
        if len(kinds) > 1:
            raise ValueError(
                f"image {number} has the objects {', '.join(map(str, kinds))}. Give one's model, models/obj_000001.ply "
                "beside models_info.json"
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
