"""Real scans for tests of classifiers: Sydney Urban Objects, and crops of labelled sweeps of real drives."""

from collections import Counter
from collections.abc import Callable, Iterator, Set
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from zbuf_occlude.base.arrays import BoolArray, FloatArray
from zbuf_occlude.base.errors import DatasetError
from zbuf_occlude.base.extras import importing
from zbuf_occlude.base.provenance import seed_of
from zbuf_occlude.datasets.records import draw, unit_box_transform
from zbuf_occlude.drawing.pictures import new_figure
from zbuf_occlude.geometry.camera import rotations_of
from zbuf_occlude.studies.learn.data import CloudSet


def resampled(points: NDArray[Any], n_points: int, name: str) -> NDArray[np.float32]:
    """Return a cloud (n_points, 3) float32 of points (n, 3), centred, longest side 1; `name` seeds the random draw.

    Points repeat only where there are fewer than `n_points`.
    """
    chosen = np.asarray(points[draw(np.arange(len(points)), n_points, np.random.default_rng(seed_of(0, name)))], float)
    centre, factor = unit_box_transform(chosen)
    return np.asarray((chosen - centre) * factor, np.float32)


# ---- Sydney Urban Objects --------------------------------------------------------------------------------------------

CLASSES = (
    "4wd", "building", "bus", "car", "pedestrian", "pillar", "pole", "traffic_lights", "traffic_sign", "tree", "truck",
    "trunk", "ute", "van",
)  # fmt: skip
"""The fourteen classes in the folds (588 scans); twelve other classes (43 scans) are in none."""
VEHICLES = ("4wd", "bus", "car", "truck", "ute", "van")
"""The six classes that the paper (4.4) expects to be labelled car: 188 of the 588 scans."""
N_FOLDS = 4
UPS = ("z", "-z")
"""Possible up directions of the files; `find_frame` finds the right one."""
SOURCE = "https://www.acfr.usyd.edu.au/papers/SydneyUrbanObjectsDataset.shtml"
ARCHIVE = "sydney-urban-objects-dataset"
"""Folder in the archive."""

RECORD = np.dtype(
    [("t", "<i8"), ("intensity", "u1"), ("id", "u1"), *((name, "<f4") for name in ("x", "y", "z", "azimuth", "range")),
     ("pid", "<i4")]
)  # fmt: skip
"""Record of a point in a binary file, 34 bytes; a CSV file has the same columns, with the time as text."""
_XYZ = (3, 4, 5)  # columns of a CSV file

TOP_HEAVY = ("tree", "traffic_sign", "traffic_lights")
"""Classes that are wider above than below: crowns on trunks, signs and lights on poles."""
ASSUMED_UP = "-z"
"""Up direction assumed where the scans do not decide: vehicle frames of that group have z down."""
FEWEST_POINTS, LEAST_HEIGHT = 30, 0.5
"""Minimum points and height (metres) of a scan that votes on the up direction."""
VOTE_SIGMAS = 3.0
"""Standard deviations of a fair coin by which the votes must differ from a draw."""
SHOWN = ("car", "4wd", "truck", "tree", "traffic_sign", "pedestrian")


class SydneyScan(NamedTuple):
    """One scan of an object."""

    name: str  # CLASS.NUMBER.FRAME, such as 4wd.0.2299
    fold: int
    path: Path  # binary file if there is one

    @property
    def class_name(self) -> str:
        """Name of the class."""
        return self.name.partition(".")[0]


def find_scans(root: Path) -> list[SydneyScan]:
    """Return the scans of the four folds, in the order of the files of the folds.

    `root` is the unpacked archive: the folder with ``objects/`` and ``folds/``, or the folder above it. Raises
    DatasetError where a folder, a fold or a scan is missing, or the class of a scan is not in `CLASSES`.
    """
    found = next((path for path in (root, root / ARCHIVE) if (path / "folds").is_dir()), None)
    if found is None or not (found / "objects").is_dir():
        raise DatasetError(
            f"{root} must be the Sydney Urban Objects dataset, with its folders objects and folds; it has no "
            f"{'folds' if found is None else 'objects'}. It comes from {SOURCE}: unpack its archive there."
        )
    scans = []
    for fold in range(N_FOLDS):
        names = found / "folds" / f"fold{fold}.txt"
        if not names.exists():
            raise DatasetError(f"{found / 'folds'} must have fold0.txt to fold3.txt; {names.name} is missing.")
        for line in names.read_text(encoding="utf-8-sig", errors="replace").split():
            name = line.removesuffix(".bin").removesuffix(".csv")
            files = [found / "objects" / (name + suffix) for suffix in (".bin", ".csv")]
            path = next((file for file in files if file.exists()), None)
            if path is None:
                raise DatasetError(
                    f"every scan of {names} must be in {found / 'objects'} as .bin or .csv; {name} is not. "
                    "Unpack the archive again."
                )
            scan = SydneyScan(name, fold, path)
            if scan.class_name not in CLASSES:
                raise DatasetError(
                    f"the class of a scan in {names} must be one of {', '.join(CLASSES)}; that of {name} is not."
                )
            scans.append(scan)
    return scans


def check_scans(root: Path) -> None:
    """Read every scan, to find errors before classifiers are trained.

    Raises DatasetError as `find_scans` and `read_scan` do, and where the folds lack one of `VEHICLES`.
    """
    scans = find_scans(root)
    absent = [label for label in VEHICLES if not any(scan.class_name == label for scan in scans)]
    if absent:
        raise DatasetError(
            f"the folds in {root} must have scans of {', '.join(VEHICLES)}; they have none of {', '.join(absent)}. "
            "Unpack the archive again."
        )
    for scan in scans:
        read_scan(scan.path, UPS[0])


def largest_scan(root: Path, label: str) -> SydneyScan:
    """Return the scan of a class with the most points; raises DatasetError where there is none."""
    scans = [scan for scan in find_scans(root) if scan.class_name == label]
    if not scans:
        raise DatasetError(f"the folds in {root} must have scans of {label}; they have none. Unpack the archive again.")
    return max(scans, key=lambda scan: (len(read_scan(scan.path, UPS[0])), scan.name))


def read_scan(path: Path, up: str) -> FloatArray:
    """Read the points (n, 3) of a scan, ``.bin`` (records of `RECORD`) or ``.csv``, metres, z up.

    `up` is the up direction of the file, one of `UPS`; for -z, both y and z change sign, which mirrors nothing. Raises
    DatasetError for incomplete records, text that is no number, a file without points, or positions that are not finite
    in float32.
    """
    if path.suffix == ".bin":
        size = path.stat().st_size
        if size % RECORD.itemsize:
            raise DatasetError(
                f"{path} must be records of {RECORD.itemsize} bytes; it has {size} bytes. Unpack the archive again."
            )
        records = np.fromfile(path, RECORD)
        points = np.stack([records["x"], records["y"], records["z"]], axis=1).astype(np.float64)
    else:
        lines = [line for line in path.read_text(encoding="utf-8", errors="replace").splitlines() if line.strip()]
        try:
            points = np.array([[float(line.split(",")[i]) for i in _XYZ] for line in lines]).reshape(-1, 3)
        except (ValueError, IndexError) as error:
            what = "too few commas" if isinstance(error, IndexError) else error
            raise DatasetError(
                f"{path} must have lines t,intensity,id,x,y,z,azimuth,range,pid; one is not ({what}). "
                "Unpack the archive again."
            ) from None
    if not len(points) or not (np.abs(points) <= np.finfo(np.float32).max).all():
        what = "a coordinate that is not finite" if len(points) else "no point"
        raise DatasetError(f"{path} must hold points with finite coordinates; it has {what}. Unpack the archive again.")
    return points if up == "z" else np.asarray(points * [1.0, -1.0, -1.0])


@lru_cache(2)
def read_scans(root: Path, n_points: int, up: str) -> CloudSet:
    """Read the scans of the four folds as clouds of equal size, centred, longest side 1; cached.

    Labels are indices into `CLASSES`; each scan is an object of its own; elevations are NaN. Points of a scan repeat
    only where there are fewer than `n_points` (half of the scans have fewer than 180). Raises as `find_scans` and
    `read_scan` do.
    """
    scans = find_scans(root)
    clouds = [resampled(read_scan(scan.path, up), n_points, f"sydney/{scan.name}") for scan in scans]
    labels = np.array([CLASSES.index(scan.class_name) for scan in scans])
    return CloudSet(np.stack(clouds), labels, CLASSES, np.arange(len(scans)), np.full(len(scans), np.nan))


class UpAxis(NamedTuple):
    """Up direction of the scans' files, one of `UPS`, and a sentence on how it was found."""

    up: str
    said: str


def find_frame(root: Path) -> UpAxis:
    """Find the up direction from all scans of the folds; `ASSUMED_UP` where the votes are not clear.

    Vehicles are wider below (bonnet and boot) than above (cabin); objects on trunks and poles are wider above. Neither
    depends on the position of the scanner. The number of points does not decide: only five of twelve simulated scans of
    cars have more points below. Each scan has a vote; the difference must exceed `VOTE_SIGMAS` standard deviations
    of a fair coin.
    """
    scans = find_scans(root)
    votes = Counter((scan.class_name in VEHICLES, vote(read_scan(scan.path, "z"), scan.class_name)) for scan in scans)
    up = clear_majority(votes[True, 1] + votes[False, 1], votes[True, -1] + votes[False, -1])
    return UpAxis(
        up or ASSUMED_UP,
        f"{up or ASSUMED_UP} of the files is up, {'found from the scans' if up else 'assumed'}: "
        f"wider below than above are {votes[True, -1]} vehicles if -z is up, {votes[True, 1]} if z is; wider above "
        f"than below {votes[False, -1]} trees, signs and lights if -z is up, {votes[False, 1]} if z is.",
    )


def clear_majority(for_z: int, for_minus_z: int) -> str:
    """Return the direction with a clear majority, or ""."""
    if abs(for_z - for_minus_z) <= VOTE_SIGMAS * (for_z + for_minus_z) ** 0.5:
        return ""
    return "z" if for_z > for_minus_z else "-z"


def vote(points: FloatArray, label: str) -> int:
    """Return the vote of a scan (n, 3) in the frame of its file: 1 for z up, -1 for -z up, 0 for neither."""
    heights = points[:, 2] - (points[:, 2].min() + points[:, 2].max()) / 2.0
    if len(points) < FEWEST_POINTS or np.ptp(heights) < LEAST_HEIGHT or label not in (*VEHICLES, *TOP_HEAVY):
        return 0

    def width(part: FloatArray) -> float:
        return float(np.sqrt(part[:, :2].var(axis=0).sum())) if len(part) else 0.0

    wider_above = int(np.sign(width(points[heights > 0.0]) - width(points[heights < 0.0])))
    return -wider_above if label in VEHICLES else wider_above


def picture_of_scans(root: Path, up: str) -> Figure:
    """Draw the largest scan of some classes from the side; with the right up direction, wheels are below."""
    figure, panels = new_figure(1, len(SHOWN), panel=1.85)
    for axes, label in zip(panels[0], SHOWN, strict=True):
        axes.set_aspect("equal", "datalim")
        if any(scan.class_name == label for scan in find_scans(root)):
            points = read_scan(largest_scan(root, label).path, up)
            ground = points[:, :2] - points[:, :2].mean(axis=0)
            along = np.linalg.svd(ground, full_matrices=False)[2][0]  # longest direction: the horizontal axis
            axes.plot(ground @ along, points[:, 2], linestyle="none", marker=".", markersize=1.5, color="#0072b2")
        axes.set_title(label, fontsize=10)
    return figure


# ---- objects of real drives ------------------------------------------------------------------------------------------

LEAST_POINTS = 16
"""Minimum points of a box; others are left out."""
MOST_SWEEPS = 400
"""Maximum sweeps read from a folder, evenly spaced: gigabytes of points, about ten thousand objects."""


class LabelledBox(NamedTuple):
    """A labelled box in the frame of the points, metres."""

    label: str  # label in the layout
    centre: FloatArray  # (3,)
    rotation: FloatArray  # (3, 3), box to the points' frame; its axes are length, width, height
    size: FloatArray  # (3,), length, width, height

    def contains(self, points: FloatArray) -> BoolArray:
        """Return which points (n, 3) lie in the box or on its sides, (n,) bool."""
        local = (points - self.centre) @ self.rotation
        return np.asarray((np.abs(local) <= self.size / 2.0).all(axis=1))


class Sweep(NamedTuple):
    """Points (n, 3) of one revolution of a LiDAR, metres, z up, and the labelled boxes of its objects."""

    name: str
    points: FloatArray
    boxes: list[LabelledBox]


class SweepLayout(NamedTuple):
    """Layout of the labelled sweeps of a published dataset."""

    name: str
    find: Callable[[Path], list[Path]]  # files of the sweeps in a folder; none where it has another layout
    read: Callable[[Path], Sweep]  # raises DatasetError where a file is missing or damaged
    cars: Set[str]  # labels of cars
    left_out: Set[str]  # ambiguous labels, left out; all other labels are other objects


def layout_of(root: Path) -> SweepLayout:
    """Return the layout of a folder; raises DatasetError where it has none of them."""
    for layout in LAYOUTS:
        if layout.find(root):
            return layout
    what = "does not exist" if not root.is_dir() else "has neither, or no sweep"
    raise DatasetError(
        f"--real must be a folder in KITTI's layout (velodyne/*.bin, label_2, calib) or Argoverse 2's "
        f"(LOG/annotations.feather, LOG/sensors/lidar/*.feather); {root} {what}."
    )


@lru_cache(2)
def read_objects(root: Path, n_points: int) -> CloudSet:
    """Read the objects of real sweeps as clouds of equal size, centred, longest side 1; cached.

    Labels are indices into ("car", "other"); each crop is an object of its own; elevations are NaN. A cloud has all
    points in its box, such as the ground below a car. Points repeat only where there are fewer than `n_points`.

    Raises DatasetError where a file is missing or damaged, or no car has `LEAST_POINTS` points.
    """
    clouds, labels = [], []
    for name, is_car, points in _crops(root, layout_of(root)):
        clouds.append(resampled(points, n_points, name))
        labels.append(0 if is_car else 1)
    if 0 not in labels:
        raise DatasetError(f"{root} must have a car with {LEAST_POINTS} points; it has none. Give another folder.")
    unknown = np.full(len(labels), np.nan)
    return CloudSet(np.stack(clouds), np.array(labels), ("car", "other"), np.arange(len(labels)), unknown)


def _crops(root: Path, layout: SweepLayout) -> Iterator[tuple[str, bool, FloatArray]]:
    """Yield each object's name, whether it is a car, and its points."""
    paths = layout.find(root)
    for i in np.unique(np.linspace(0, len(paths) - 1, min(len(paths), MOST_SWEEPS)).round().astype(int)):
        sweep = layout.read(paths[i])
        points = sweep.points[np.isfinite(sweep.points).all(axis=1)]
        for number, box in enumerate(sweep.boxes):
            if box.label in layout.left_out:
                continue
            mine = points[box.contains(points)]
            if len(mine) >= LEAST_POINTS:
                yield f"{sweep.name}/{number}", box.label in layout.cars, mine


# ---- KITTI ------------------------------------------------------------------------------------------------------

KITTI_FOLDERS = ("velodyne", "label_2", "calib")
"""Folders of KITTI's files, in the root or its folder `training`; each sweep has a file in each.

velodyne   float32 x, y, z, reflectance; x forward, y left, z up
label_2    type, truncated, occluded, alpha, 4 of the picture, height, width, length, x, y, z, rotation_y: the centre of
           the box's lower side in the rectified camera's frame (x right, y down, z forward), turned about its y axis
calib      lines NAME: numbers, with R0_rect (3 x 3) and Tr_velo_to_cam (3 x 4)

References: Geiger, Lenz, Urtasun, "Are we ready for autonomous driving? The KITTI vision benchmark suite", CVPR 2012,
and the readme of its object development kit.
"""
_N_FIELDS = 15


def find_kitti(root: Path) -> list[Path]:
    """Return the files of points of a folder in this layout, in order; none for another layout."""
    for folder in (root, root / "training"):
        if all((folder / name).is_dir() for name in KITTI_FOLDERS):
            return sorted((folder / "velodyne").glob("*.bin"))
    return []


def read_kitti(path: Path) -> Sweep:
    """Read the sweep of a file of points."""
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


def _boxes(path: Path, to_points: FloatArray) -> list[LabelledBox]:
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
        boxes.append(LabelledBox(fields[0], centre[:3], axes, np.array([length, width, height])))
    return boxes


def _to_camera(path: Path) -> FloatArray:
    """Return the transform (4, 4) from the frame of the points to that of the rectified camera."""
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
    with np.errstate(all="ignore"):  # the result is checked below
        matrix = found["R0_rect"] @ found["Tr_velo_to_cam"]
    if not np.isfinite(matrix).all() or abs(np.linalg.det(matrix[:3, :3])) < 0.5:
        raise DatasetError(f"R0_rect and Tr_velo_to_cam in {path} must be rotations; they are not. Unpack it again.")
    return matrix


# ---- Argoverse 2 ------------------------------------------------------------------------------------------------

ANNOTATIONS = "annotations.feather"
"""File of a log's boxes; its sweeps are LOG/sensors/lidar/TIMESTAMP.feather. A root is a log, or holds logs or splits.

sweeps        x, y, z (half precision) and more columns; the vehicle's frame, x forward, y left, z up, metres
annotations   timestamp_ns, category, length_m, width_m, height_m, qw, qx, qy, qz, tx_m, ty_m, tz_m, and more: boxes in
              the vehicle's frame at the time of a sweep

References: Wilson et al., "Argoverse 2: next generation datasets for self-driving perception and forecasting", NeurIPS
Datasets and Benchmarks 2021, and the user guide of its sensor dataset.
"""
_NO_NUMBERS = ("timestamp_ns", "category")
_BOX = ("length_m", "width_m", "height_m", "qw", "qx", "qy", "qz", "tx_m", "ty_m", "tz_m")


def find_argoverse(root: Path) -> list[Path]:
    """Return the files of sweeps of a folder in this layout, log by log, in order; none for another layout."""
    logs = sorted(path.parent for depth in ("", "*/", "*/*/") for path in root.glob(depth + ANNOTATIONS))
    return [path for log in logs for path in sorted((log / "sensors" / "lidar").glob("*.feather"))]


def read_argoverse(path: Path) -> Sweep:
    """Read the sweep of a file of points named by its time; needs the package pyarrow."""
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
            raise DatasetError(f"boxes in {log / ANNOTATIONS} must be finite numbers; that of row {row} is not.")
        w, x, y, z = numbers[3:7]
        length = float(np.linalg.norm(numbers[3:7]))
        if not 0.5 < length < 2.0:
            raise DatasetError(
                f"qw, qx, qy, qz in {log / ANNOTATIONS} must be unit quaternions; one has the length {length:g}."
            )
        rotation = rotations_of(np.array([x, y, z, w]) / length)
        boxes.append(LabelledBox(str(annotations["category"][row]), numbers[7:], rotation, numbers[:3]))
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


_LARGE = "ARTICULATED_BUS BOX_TRUCK BUS LARGE_VEHICLE SCHOOL_BUS TRUCK TRUCK_CAB VEHICULAR_TRAILER"
LAYOUTS = (
    SweepLayout("KITTI", find_kitti, read_kitti, {"Car", "Van"}, {"DontCare", "Misc", "Truck", "Tram"}),
    SweepLayout("Argoverse 2", find_argoverse, read_argoverse, {"REGULAR_VEHICLE"}, set(_LARGE.split())),
)
