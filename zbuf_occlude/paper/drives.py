"""Objects of real drives: crops of labelled LiDAR sweeps as clouds, from folders in KITTI's or Argoverse 2's layout."""

from collections.abc import Callable, Iterator, Set
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.arrays import BoolArray, FloatArray
from zbuf_occlude.errors import DatasetError
from zbuf_occlude.extras import importing
from zbuf_occlude.learn.data import CloudSet
from zbuf_occlude.paper.objects import resampled

CAR, OTHER = "car", "other"
LEAST_POINTS = 16
"""A box with fewer is left out."""
MOST_SWEEPS = 400
"""Sweeps read of a folder, evenly spaced: some gigabytes of points, ten thousand objects."""


@dataclass(frozen=True, eq=False)
class Box:
    """A labelled box in the frame of the points, metres."""

    label: str  # as its layout writes it
    centre: FloatArray  # (3,)
    rotation: FloatArray  # (3, 3), box to the points' frame; its axes are length, width, height
    size: FloatArray  # (3,), length, width, height

    def holds(self, points: FloatArray) -> BoolArray:
        """Which points (n, 3) lie in the box, its sides included."""
        local = (points - self.centre) @ self.rotation
        return np.asarray((np.abs(local) <= self.size / 2.0).all(axis=1))


@dataclass(frozen=True, eq=False)
class Sweep:
    """The points of one turn of a LiDAR, (n, 3) float64, metres, z up; and the labelled boxes of the objects in it."""

    name: str
    points: FloatArray
    boxes: list[Box]


@dataclass(frozen=True)
class SweepLayout:
    """How a published dataset lays out its labelled sweeps."""

    name: str
    find: Callable[[Path], list[Path]]  # the files of the sweeps of a folder, none where it is not in this layout
    read: Callable[[Path], Sweep]  # raises DatasetError where a file is missing or damaged
    cars: Set[str]  # labels of cars
    left_out: Set[str]  # labels that are neither cars nor surely none; all others are other objects


def layout_of(root: Path) -> SweepLayout:
    """Return the layout of a folder; raises DatasetError where it is in none of them."""
    for layout in LAYOUTS:
        if layout.find(root):
            return layout
    what = "is not there" if not root.is_dir() else "is neither, or has no sweep"
    raise DatasetError(
        f"--real must be a folder in KITTI's layout (velodyne/*.bin, label_2, calib) or Argoverse 2's "
        f"(LOG/annotations.feather, LOG/sensors/lidar/*.feather); {root} {what}."
    )


def read_clouds(root: Path, n_points: int) -> CloudSet:
    """Read the objects of real sweeps as clouds of equal size.

    Labels index (`CAR`, `OTHER`); each crop is an object of its own; centred, longest side 1; elevations unknown. What
    else lies in a box, such as the ground below a car, is in its cloud. Points repeat only where there are fewer.

    Raises DatasetError where a file is missing or damaged, or no car has `LEAST_POINTS` points.
    """
    clouds, labels = [], []
    for name, is_car, points in _crops(root, layout_of(root)):
        clouds.append(resampled(points, n_points, name))
        labels.append(0 if is_car else 1)
    if 0 not in labels:
        raise DatasetError(f"{root} must have a car with {LEAST_POINTS} points; it has none. Give another folder.")
    unknown = np.full(len(labels), np.nan)
    return CloudSet(np.stack(clouds), np.array(labels), (CAR, OTHER), np.arange(len(labels)), unknown)


def _crops(root: Path, layout: SweepLayout) -> Iterator[tuple[str, bool, FloatArray]]:
    """Yield each object's name, whether it is a car, and its points."""
    paths = layout.find(root)
    for i in np.unique(np.linspace(0, len(paths) - 1, min(len(paths), MOST_SWEEPS)).round().astype(int)):
        sweep = layout.read(paths[i])
        points = sweep.points[np.isfinite(sweep.points).all(axis=1)]
        for number, box in enumerate(sweep.boxes):
            if box.label in layout.left_out:
                continue
            mine = points[box.holds(points)]
            if len(mine) >= LEAST_POINTS:
                yield f"{sweep.name}/{number}", box.label in layout.cars, mine


# ---- KITTI -------------------------------------------------------------------------------------------------------

KITTI_FOLDERS = ("velodyne", "label_2", "calib")
"""In a folder or its `training`, a file of each for each sweep.

velodyne   float32 x, y, z, reflectance; x forward, y left, z up
label_2    type, truncated, occluded, alpha, 4 of the picture, height, width, length, x, y, z, rotation_y: the middle of
           the box's lower side in the rectified camera's frame (x right, y down, z forward), turned about its y axis
calib      NAME: numbers; of them R0_rect (3 x 3) and Tr_velo_to_cam (3 x 4)

References: Geiger, Lenz, Urtasun, "Are we ready for autonomous driving? The KITTI vision benchmark suite", CVPR 2012,
and the readme of its object development kit.
"""
_N_FIELDS = 15


def find_kitti(root: Path) -> list[Path]:
    """Return the points' files of a folder in this layout, in order; none where it is not."""
    for folder in (root, root / "training"):
        if all((folder / name).is_dir() for name in KITTI_FOLDERS):
            return sorted((folder / "velodyne").glob("*.bin"))
    return []


def read_kitti(path: Path) -> Sweep:
    """Read the sweep whose points are in a file."""
    folder = path.parents[1]
    label, calibration = (folder / name / f"{path.stem}.txt" for name in KITTI_FOLDERS[1:])
    for file in (label, calibration):
        if not file.is_file():
            raise DatasetError(f"{path} must have its {file.parent.name}/{file.name}; it is missing. Unpack it there.")
    if path.stat().st_size % 16:
        raise DatasetError(f"{path} must be records of four float32; it has {path.stat().st_size} bytes. Unpack again.")
    points = np.fromfile(path, "<f4").reshape(-1, 4)[:, :3].astype(np.float64)
    to_points = np.asarray(np.linalg.inv(_to_camera(calibration)), dtype=np.float64)
    return Sweep(path.stem, points, _boxes(label, to_points))


def _boxes(path: Path, to_points: FloatArray) -> list[Box]:
    boxes = []
    for number, line in enumerate(path.read_text(encoding="utf-8", errors="replace").splitlines(), 1):
        fields = line.split()
        if not fields or fields[0] == "DontCare":
            continue
        try:
            height, width, length, x, y, z, turned = np.array(fields[8:_N_FIELDS], dtype=np.float64)
            if not np.isfinite([height, width, length, x, y, z, turned]).all():
                raise ValueError
        except ValueError:
            raise DatasetError(
                f"{path} must have {_N_FIELDS} fields per line, from the 9th on numbers; line {number} is {line!r:.60}."
            ) from None
        along = np.array([np.cos(turned), 0.0, -np.sin(turned)])
        up = np.array([0.0, -1.0, 0.0])
        axes = to_points[:3, :3] @ np.stack([along, np.cross(up, along), up], axis=1)
        centre = to_points @ [x, y - height / 2.0, z, 1.0]
        boxes.append(Box(fields[0], centre[:3], axes, np.array([length, width, height])))
    return boxes


def _to_camera(path: Path) -> FloatArray:
    """Points' frame to the rectified camera's, (4, 4)."""
    found: dict[str, FloatArray] = {}
    shapes = {"R0_rect": (3, 3), "Tr_velo_to_cam": (3, 4)}
    for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
        name, _, numbers = line.partition(":")
        if name in shapes:
            try:
                values = np.array(numbers.split(), dtype=np.float64).reshape(shapes[name])
            except ValueError:
                raise DatasetError(f"{name} in {path} must be {shapes[name]} numbers; it is {numbers!r:.60}.") from None
            found[name] = np.eye(4)
            found[name][:3, : values.shape[1]] = values
    if missing := [name for name in shapes if name not in found]:
        raise DatasetError(f"{path} must have {' and '.join(missing)}; it has not. Take the object benchmark's calib.")
    with np.errstate(all="ignore"):  # judged by what comes out
        matrix = found["R0_rect"] @ found["Tr_velo_to_cam"]
    if not np.isfinite(matrix).all() or abs(np.linalg.det(matrix[:3, :3])) < 0.5:
        raise DatasetError(f"R0_rect and Tr_velo_to_cam in {path} must be rotations; they are not. Unpack it again.")
    return matrix


# ---- Argoverse 2 -------------------------------------------------------------------------------------------------

ANNOTATIONS = "annotations.feather"
"""LOG/sensors/lidar/TIMESTAMP.feather and LOG/annotations.feather; a folder may be a log, hold logs, or splits of logs.

sweeps        x, y, z (half precision) and more columns; the vehicle's frame, x forward, y left, z up, metres
annotations   timestamp_ns, category, length_m, width_m, height_m, qw, qx, qy, qz, tx_m, ty_m, tz_m, and more: boxes in
              the vehicle's frame at the time of a sweep

References: Wilson et al., "Argoverse 2: next generation datasets for self-driving perception and forecasting", NeurIPS
Datasets and Benchmarks 2021, and the user guide of its sensor dataset.
"""
_NO_NUMBERS = ("timestamp_ns", "category")
_BOX = ("length_m", "width_m", "height_m", "qw", "qx", "qy", "qz", "tx_m", "ty_m", "tz_m")


def find_argoverse(root: Path) -> list[Path]:
    """Return the sweeps' files of a folder in this layout, log by log, in order; none where it is not."""
    logs = sorted(path.parent for depth in ("", "*/", "*/*/") for path in root.glob(depth + ANNOTATIONS))
    return [path for log in logs for path in sorted((log / "sensors" / "lidar").glob("*.feather"))]


def read_argoverse(path: Path) -> Sweep:
    """Read the sweep whose points are in a file named by its time; needs the package pyarrow."""
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


_LARGE = "ARTICULATED_BUS BOX_TRUCK BUS LARGE_VEHICLE SCHOOL_BUS TRUCK TRUCK_CAB VEHICULAR_TRAILER"
LAYOUTS = (
    SweepLayout("KITTI", find_kitti, read_kitti, {"Car", "Van"}, {"DontCare", "Misc", "Truck", "Tram"}),
    SweepLayout("Argoverse 2", find_argoverse, read_argoverse, {"REGULAR_VEHICLE"}, set(_LARGE.split())),
)
