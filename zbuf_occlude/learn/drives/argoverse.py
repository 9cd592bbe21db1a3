"""Argoverse 2's layout of labelled sweeps: LOG/sensors/lidar/TIMESTAMP.feather and LOG/annotations.feather.

sweeps        x, y, z (half precision) and more columns; the vehicle's frame, x forward, y left, z up, metres
annotations   timestamp_ns, category, length_m, width_m, height_m, qw, qx, qy, qz, tx_m, ty_m, tz_m, and more: boxes in
              the vehicle's frame at the time of a sweep

A folder may be one log, or hold logs, or splits of logs. Feather is read by the package pyarrow (extra `parquet`).

References
----------
Wilson et al., "Argoverse 2: next generation datasets for self-driving perception and forecasting", NeurIPS Datasets and
Benchmarks 2021, and the user guide of the Argoverse 2 sensor dataset.
"""

from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.arrays import FloatArray
from zbuf_occlude.errors import DatasetError
from zbuf_occlude.extras import importing
from zbuf_occlude.learn.drives.sweeps import Box, Sweep

ANNOTATIONS = "annotations.feather"
CARS = frozenset({"REGULAR_VEHICLE"})
LEFT_OUT = frozenset(
    {
        "ARTICULATED_BUS", "BOX_TRUCK", "BUS", "LARGE_VEHICLE", "SCHOOL_BUS", "TRUCK", "TRUCK_CAB",
        "VEHICULAR_TRAILER",
    }
)  # fmt: skip
"""Neither clearly a car nor clearly none."""
_NO_NUMBERS = ("timestamp_ns", "category")
_BOX = ("length_m", "width_m", "height_m", "qw", "qx", "qy", "qz", "tx_m", "ty_m", "tz_m")


def find(root: Path) -> list[Path]:
    """Return the sweeps' files of a folder in this layout, log by log, in order; none where it is not."""
    logs = sorted(path.parent for depth in ("", "*/", "*/*/") for path in root.glob(depth + ANNOTATIONS))
    return [path for log in logs for path in sorted((log / "sensors" / "lidar").glob("*.feather"))]


def read(path: Path) -> Sweep:
    """Read a sweep.

    Parameters
    ----------
    path : Path
        Of its points; its name is its time.

    Raises
    ------
    DatasetError
        A file is damaged.
    UnavailableError
        The package pyarrow is missing.
    """
    log = path.parents[2]
    annotations = _annotations(log / ANNOTATIONS)
    columns = _table(path, ("x", "y", "z"))
    points = np.stack([columns[name] for name in "xyz"], axis=1)
    try:
        time = int(path.stem)
    except ValueError:
        raise DatasetError(f"a sweep must be called TIMESTAMP.feather, nanoseconds; {path} is not.") from None
    boxes = []
    for row in np.flatnonzero(annotations["timestamp_ns"] == time):
        numbers = np.array([annotations[name][row] for name in _BOX])
        if not np.isfinite(numbers).all():
            raise DatasetError(f"boxes in {log / ANNOTATIONS} must be numbers; that of row {row} has others.")
        boxes.append(
            Box(str(annotations["category"][row]), numbers[7:], _rotation(numbers[3:7], log / ANNOTATIONS), numbers[:3])
        )
    return Sweep(f"{log.name}/{path.stem}", points, boxes)


@lru_cache(maxsize=1)
def _annotations(path: Path) -> dict[str, NDArray[Any]]:
    return _table(path, ("timestamp_ns", "category", *_BOX))


def _table(path: Path, names: tuple[str, ...]) -> dict[str, NDArray[Any]]:
    """Read some columns of a feather file."""
    with importing("pyarrow", "a feather file of Argoverse 2"):
        from pyarrow import ArrowException, feather
    try:
        table = feather.read_table(path)
        columns = {name: table[name].to_numpy() for name in names}
        return {name: np.asarray(values, None if name in _NO_NUMBERS else float) for name, values in columns.items()}
    except KeyError as error:
        raise DatasetError(f"{path} must have the columns {', '.join(names)}; it lacks one ({error}).") from None
    except (ArrowException, OSError, ValueError, TypeError) as error:
        first = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise DatasetError(f"{path} must be a feather file; it cannot be read ({first}). Copy it again.") from None


def _rotation(quaternion: FloatArray, path: Path) -> FloatArray:
    """The rotation matrix of a quaternion w, x, y, z."""
    length = float(np.linalg.norm(quaternion))
    if not 0.5 < length < 2.0:
        raise DatasetError(f"qw, qx, qy, qz in {path} must be unit quaternions; one has the length {length:g}.")
    w, x, y, z = quaternion / length
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
