"""Argoverse 2's sensor dataset: LOG/annotations.feather, LOG/sensors/lidar/TIMESTAMP.feather; needs pyarrow.

sweeps        x, y, z (half precision) and more columns; the vehicle's frame, x forward, y left, z up, metres
annotations   timestamp_ns, track_uuid, category, length_m, width_m, height_m, qw, qx, qy, qz, tx_m, ty_m, tz_m, and
              more: boxes in the vehicle's frame at the time of a sweep
calibration   LOG/calibration/egovehicle_SE3_sensor.feather, which may be missing: places of the sensors there

References: Wilson et al., "Argoverse 2: next generation datasets for self-driving perception and forecasting", NeurIPS
Datasets and Benchmarks 2021, and the user guide of its sensor dataset.
"""

from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.base.arrays import FloatArray
from zbuf_occlude.base.errors import DatasetError
from zbuf_occlude.base.extras import importing
from zbuf_occlude.datasets.real.sweeps import REMEDY, LabelledBox, Loader, Sweep, checked_sides
from zbuf_occlude.geometry.camera import rotations_of

ANNOTATIONS = "annotations.feather"
CALIBRATION = "calibration/egovehicle_SE3_sensor.feather"
LIDARS = ("up_lidar", "down_lidar")
MOUNTS = ((1.35, 0.0, 1.64, 1.0, 0.0, 0.0, 0.0), (1.35, 0.0, 1.53, 0.0, 1.0, 0.0, 0.0))
"""Places and quaternions (w first) of the two LiDARs in the vehicle's frame, where a log has no calibration. One hangs
upside down."""
COUNTS = "num_interior_pts"
"""Column of the returns in a box, which may be missing where there are points."""
_WORDS = ("timestamp_ns", "category", "track_uuid", "sensor_name")
_ROTATION = ("qw", "qx", "qy", "qz")
_PLACE = ("tx_m", "ty_m", "tz_m")
_BOX = ("length_m", "width_m", "height_m", *_ROTATION, *_PLACE)


def find(root: Path) -> list[Loader]:
    """Return a loader for each sweep, log by log; a root is a log, or holds logs or splits.

    A log without points has the sweeps of its annotations, with the returns in each box as its makers counted them.
    """
    logs = sorted(path.parent for depth in ("", "*/", "*/*/") for path in root.glob(depth + ANNOTATIONS))
    return [loader for log in logs for loader in _sweeps_of(log)]


def _sweeps_of(log: Path) -> list[Loader]:
    if files := sorted((log / "sensors" / "lidar").glob("*.feather")):
        return [partial(read_argoverse, path) for path in files]
    times = np.unique(_annotations(log / ANNOTATIONS, _version(log / ANNOTATIONS))["timestamp_ns"])
    return [partial(_sweep_at, log, time, np.empty((0, 3))) for time in times.tolist()]


def read_argoverse(path: Path) -> Sweep:
    """Read the sweep of a file of points named by its time."""
    columns = _table(path, ("x", "y", "z"))
    try:
        time = int(path.stem)
    except ValueError:
        raise DatasetError(
            f"a sweep must be named TIMESTAMP.feather, in nanoseconds; {path} is not. {REMEDY}"
        ) from None
    return _sweep_at(path.parents[2], time, np.stack([columns[name] for name in "xyz"], axis=1))


def _sweep_at(log: Path, time: int, points: FloatArray) -> Sweep:
    annotations = _annotations(log / ANNOTATIONS, _version(log / ANNOTATIONS))
    if not len(points) and COUNTS not in annotations:
        raise DatasetError(
            f"{log / ANNOTATIONS} must have the column {COUNTS} where a log has no points; it has not. {REMEDY}"
        )
    boxes = []
    for row in np.flatnonzero(annotations["timestamp_ns"] == time):
        numbers = np.array([annotations[name][row] for name in _BOX])
        if not np.isfinite(numbers).all():
            raise DatasetError(
                f"boxes in {log / ANNOTATIONS} must be finite numbers; that of row {row} is not. {REMEDY}"
            )
        try:
            size = checked_sides(numbers[:3])
        except ValueError as error:
            raise DatasetError(f"row {row} of {log / ANNOTATIONS}: {error}. {REMEDY}") from None
        rotation = _rotation(numbers[3:7], log / ANNOTATIONS)
        category, track = (str(annotations[name][row]) for name in ("category", "track_uuid"))
        n_points = int(annotations[COUNTS][row]) if COUNTS in annotations else None
        boxes.append(LabelledBox(category, numbers[7:], rotation, size, track, n_points))
    return Sweep(f"{log.name}/{time}", points, boxes, _mounts(log / CALIBRATION))


def _rotation(quaternion: FloatArray, path: Path) -> FloatArray:
    """Return the rotation (3, 3) of a quaternion, w first."""
    length = float(np.linalg.norm(quaternion))
    if not 0.5 < length < 2.0:
        raise DatasetError(
            f"qw, qx, qy, qz in {path} must be unit quaternions; one has the length {length:g}. {REMEDY}"
        )
    return np.asarray(rotations_of(quaternion[[1, 2, 3, 0]] / length))


def _version(path: Path) -> tuple[int, int]:
    """Return the size and the time of change of a file, in nanoseconds; zeros where it is missing."""
    status = path.stat() if path.exists() else None
    return (status.st_size, status.st_mtime_ns) if status else (0, 0)


@lru_cache(maxsize=1)
def _annotations(path: Path, version: tuple[int, int]) -> dict[str, NDArray[Any]]:
    """Return the boxes of a log, kept for its next sweep; a file that has changed is read again."""
    return _table(path, ("timestamp_ns", "category", "track_uuid", *_BOX), (COUNTS,))


def _mounts(path: Path) -> tuple[FloatArray, ...]:
    """Return the poses (4, 4) of a log's two LiDARs in the vehicle's frame."""
    rows = np.array(MOUNTS)
    if path.exists():
        table = _table(path, ("sensor_name", *_PLACE, *_ROTATION))
        which = np.isin(table["sensor_name"].astype(str), LIDARS)
        if not which.any():
            raise DatasetError(f"{path} must have the place of {' and '.join(LIDARS)}; it has neither. {REMEDY}")
        rows = np.stack([table[name][which] for name in (*_PLACE, *_ROTATION)], axis=1)
    poses = []
    for row in rows:
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = _rotation(row[3:], path), row[:3]
        poses.append(pose)
    return tuple(poses)


def _table(path: Path, names: tuple[str, ...], optional: tuple[str, ...] = ()) -> dict[str, NDArray[Any]]:
    """Read some columns of a feather file; `optional` ones where it has them."""
    with importing("pyarrow", "a feather file of Argoverse 2"):
        from pyarrow import ArrowException, feather
    try:
        table = feather.read_table(path)
        names += tuple(name for name in optional if name in table.column_names)
        columns = {name: table[name].to_numpy() for name in names}
        return {name: np.asarray(values, None if name in _WORDS else float) for name, values in columns.items()}
    except KeyError as error:
        raise DatasetError(
            f"{path} must have the columns {', '.join(names)}; it lacks one ({error}). {REMEDY}"
        ) from None
    except (ArrowException, OSError, ValueError, TypeError) as error:
        first = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise DatasetError(f"{path} must be a feather file; it cannot be read ({first}). {REMEDY}") from None
