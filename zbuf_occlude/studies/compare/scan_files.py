"""Readers of real scans and their poses in the formats of common tools."""

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from zbuf_occlude.base.arrays import FloatArray
from zbuf_occlude.base.errors import ArgumentError, DatasetError, OptionError, describe, escape_control
from zbuf_occlude.base.extras import importing
from zbuf_occlude.datasets.cloud_files import read_points, real_points
from zbuf_occlude.geometry.camera import as_rigid, rotations_of, unit_quaternions
from zbuf_occlude.sensors.sensor import Sensor
from zbuf_occlude.studies.compare.bop_folder import poses_of

NOT_RIGID = 1e-3
"""Tolerance on the entries of a pose: a larger deviation is no rigid motion."""


def read_scan_file(path: Path, sensor: Sensor, depth_unit: float) -> FloatArray:
    """Read the points (n, 3) of a scan in its file's frame and unit; points not finite or at the origin are left out.

    Parameters
    ----------
    path : Path
        A cloud in a format of `cloud_files.read_points`; or ``.png``: a depth image of 16 bits, of the sensor's width
        and height, whose points are in the sensor's own frame.
    sensor : Sensor
        A pinhole where the scan is a depth image.
    depth_unit : float
        Metres of one step of a depth image.

    Raises
    ------
    DatasetError
        The file cannot be read, has another format, has no points, or has coordinates beyond `LARGEST`.
    OptionError
        A depth image where the sensor is no pinhole, or of another size.
    UnavailableError
        PCD without Open3D, PNG without Pillow.
    """
    if path.suffix.lower() != ".png":
        return read_points(path)
    name = escape_control(str(path))
    try:
        points = _of_depth_image(path, sensor, depth_unit)
    except (OSError, ValueError) as error:
        raise DatasetError(f"{name}: cannot read the depth image: {escape_control(describe(error))}") from None
    return real_points(points, name)


def _of_depth_image(path: Path, sensor: Sensor, unit: float) -> FloatArray:
    with importing("PIL", "reading depth images"):
        from PIL import Image
    if sensor.kind != "pinhole":
        raise OptionError(f"a depth image must be of a pinhole sensor; {sensor.name} is {sensor.kind}.")
    with Image.open(path) as image:
        depths = np.asarray(image).astype(np.float64)
    size = sensor.pattern["height"], sensor.pattern["width"]
    if depths.shape != size:
        raise OptionError(
            f"{escape_control(path.name)} must have {size[1]} x {size[0]} pixels and one channel, as {sensor.name}; "
            f"it is {' x '.join(map(str, depths.shape[::-1]))}. Set width and height of the sensor."
        )
    directions = sensor.rays().directions
    along_axis = directions / directions[:, :1]
    return np.asarray(along_axis * (depths.reshape(-1, 1) * unit))


def read_poses(path: Path, scans: Sequence[Path], model: int | None) -> list[FloatArray]:
    """Read the pose of each scan: a rigid motion (4, 4) from the scan's frame to the mesh's.

    Parameters
    ----------
    path : Path
        ``.conf`` of the Stanford scanning repository (``bmesh FILE tx ty tz qx qy qz qw``, found by the file's name);
        ``.json`` of BOP (see `bop_folder.poses_of`); else text of numbers: 4 x 4 of one scan, or a row of 12 or 16 for
        each.
    scans : sequence of Path
    model : int or None
        BOP's ``obj_id`` of the mesh.

    Raises
    ------
    DatasetError
        The file cannot be read, or does not hold one rigid motion for each scan.
    """
    name = escape_control(str(path))
    try:
        text = path.read_text(encoding="utf-8", errors="replace")
        if path.suffix.lower() == ".conf":
            poses = _of_stanford(text, scans)
        elif path.suffix.lower() == ".json":
            poses = poses_of(json.loads(text), scans, model)
        else:
            rows = [[float(word) for word in line.split()] for line in text.splitlines() if line.strip()]
            if len(rows) == 4 and len(rows[0]) == 4:
                rows = [[number for row in rows for number in row]]
            poses = [_square(row) for row in rows]
    except (OSError, ValueError, KeyError, IndexError, TypeError, AttributeError) as error:
        raise DatasetError(f"{name}: cannot read poses: {escape_control(describe(error))}") from None
    if len(poses) != len(scans):
        raise DatasetError(f"{name} must hold a pose for each of {len(scans)} scans; it has {len(poses)}.")
    try:
        return [rigid(pose, f"a pose of {name}") for pose in poses]
    except ArgumentError as error:
        raise DatasetError(str(error)) from None


def rigid(pose: ArrayLike, name: str) -> FloatArray:
    """Return a pose (4, 4) with an orthonormal rotation; raises ArgumentError where it is no rigid motion."""
    matrix = np.array(as_rigid(pose, name, NOT_RIGID))
    u, _, vt = np.linalg.svd(matrix[:3, :3])  # removes the rounding of files with few digits
    matrix[:3, :3], matrix[3] = u @ vt, (0.0, 0.0, 0.0, 1.0)
    return matrix


def _square(row: list[float]) -> FloatArray:
    if len(row) not in (12, 16):
        raise ValueError(f"a pose must have 12 or 16 numbers; it has {len(row)}")
    return np.array([*row, 0.0, 0.0, 0.0, 1.0][:16]).reshape(4, 4)


def _of_stanford(text: str, scans: Sequence[Path]) -> list[FloatArray]:
    found = {}
    for words in map(str.split, text.splitlines()):
        if words[:1] == ["bmesh"]:
            x, y, z, i, j, k, real = map(float, words[2:9])  # these files have the opposite sign of the last number
            pose = np.eye(4)
            pose[:3, :3], pose[:3, 3] = (
                rotations_of(unit_quaternions([i, j, k, -real])),
                (x, y, z),
            )
            found[Path(words[1]).name] = pose
    if missing := [scan.name for scan in scans if scan.name not in found]:
        raise ValueError(f"the line `bmesh {missing[0]}` is missing")
    return [found[scan.name] for scan in scans]
