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
ROOF = np.array([1.35, 0.0, 1.58])
"""Default middle of the two LiDARs in the vehicle's frame, metres, for logs without calibration."""
_WORDS = ("timestamp_ns", "category", "track_uuid", "sensor_name")
_BOX = ("length_m", "width_m", "height_m", "qw", "qx", "qy", "qz", "tx_m", "ty_m", "tz_m")


def find(root: Path) -> list[Loader]:
    """Return a loader for each sweep, log by log; a root is a log, or holds logs or splits.

    Raises DatasetError where there are logs, but no sweep.
    """
    logs = sorted(path.parent for depth in ("", "*/", "*/*/") for path in root.glob(depth + ANNOTATIONS))
    sweeps = [path for log in logs for path in sorted((log / "sensors" / "lidar").glob("*.feather"))]
    if logs and not sweeps:
        raise DatasetError(f"{logs[0] / 'sensors/lidar'} must hold a .feather file per sweep; it has none. {REMEDY}")
    return [partial(read_argoverse, path) for path in sweeps]


def read_argoverse(path: Path) -> Sweep:
    """Read the sweep of a file of points named by its time."""
    log = path.parents[2]
    annotations = _annotations(log / ANNOTATIONS, _version(log / ANNOTATIONS))
    columns = _table(path, ("x", "y", "z"))
    points = np.stack([columns[name] for name in "xyz"], axis=1)
    try:
        time = int(path.stem)
    except ValueError:
        raise DatasetError(
            f"a sweep must be named TIMESTAMP.feather, in nanoseconds; {path} is not. {REMEDY}"
        ) from None
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
        w, x, y, z = numbers[3:7]
        length = float(np.linalg.norm(numbers[3:7]))
        if not 0.5 < length < 2.0:
            raise DatasetError(
                f"qw, qx, qy, qz in {log / ANNOTATIONS} must be unit quaternions; one has the length {length:g}. "
                f"{REMEDY}"
            )
        rotation = rotations_of(np.array([x, y, z, w]) / length)
        category, track = (str(annotations[name][row]) for name in ("category", "track_uuid"))
        boxes.append(LabelledBox(category, numbers[7:], rotation, size, track))
    return Sweep(f"{log.name}/{path.stem}", points, boxes, _place_of_lidars(log / CALIBRATION))


def _version(path: Path) -> tuple[int, int]:
    """Return the size and the time of change of a file, in nanoseconds; zeros where it is missing."""
    status = path.stat() if path.exists() else None
    return (status.st_size, status.st_mtime_ns) if status else (0, 0)


@lru_cache(maxsize=1)
def _annotations(path: Path, version: tuple[int, int]) -> dict[str, NDArray[Any]]:
    """Return the boxes of a log, kept for its next sweep; a file that has changed is read again."""
    return _table(path, ("timestamp_ns", "category", "track_uuid", *_BOX))


def _place_of_lidars(path: Path) -> FloatArray:
    """Return the middle (3,) of a log's two LiDARs in the vehicle's frame."""
    if not path.exists():
        return ROOF
    table = _table(path, ("sensor_name", "tx_m", "ty_m", "tz_m"))
    rows = np.isin(table["sensor_name"].astype(str), LIDARS)
    if not rows.any():
        raise DatasetError(f"{path} must have the place of {' and '.join(LIDARS)}; it has neither. {REMEDY}")
    return np.array([table[name][rows].mean() for name in ("tx_m", "ty_m", "tz_m")])


def _table(path: Path, names: tuple[str, ...]) -> dict[str, NDArray[Any]]:
    """Read some columns of a feather file."""
    with importing("pyarrow", "a feather file of Argoverse 2"):
        from pyarrow import ArrowException, feather
    try:
        table = feather.read_table(path)
        columns = {name: table[name].to_numpy() for name in names}
        return {name: np.asarray(values, None if name in _WORDS else float) for name, values in columns.items()}
    except KeyError as error:
        raise DatasetError(
            f"{path} must have the columns {', '.join(names)}; it lacks one ({error}). {REMEDY}"
        ) from None
    except (ArrowException, OSError, ValueError, TypeError) as error:
        first = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise DatasetError(f"{path} must be a feather file; it cannot be read ({first}). {REMEDY}") from None
