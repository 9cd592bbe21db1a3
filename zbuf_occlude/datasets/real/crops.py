"""Crops: the points in labelled boxes of real sweeps as clouds of single objects, and the folder that holds them.

    CLASS/SWEEP-NUMBER.ply    x, y, z in metres, float32, a file per cloud
    objects.csv               a row per cloud: `FIELDS`

A class is a folder, so every tool that reads clouds by class reads crops; `datasets.cloud_folder` reads the table too.
"""

import csv
import io
import logging
import math
import re
from collections import Counter, defaultdict
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np

from zbuf_occlude.base import atomic
from zbuf_occlude.base.arrays import BoolArray, FloatArray, as_array, as_number
from zbuf_occlude.base.documents import as_new_path, as_path
from zbuf_occlude.base.errors import (
    DatasetError,
    OptionError,
    check_choice,
    check_int,
    did_you_mean,
    escape_control,
    shown,
)
from zbuf_occlude.base.point_files import write_table
from zbuf_occlude.datasets.cloud_folder import OBJECTS
from zbuf_occlude.datasets.real.sweeps import LabelledBox, Sweep, find_sweeps
from zbuf_occlude.sensors.scan_config import LEAST_POINTS

FRAMES = ("object", "sensor")
FIT: Literal["fit"] = "fit"
FIELDS = (
    *("file", "class", "label", "sweep", "track", "range", "azimuth", "elevation", "n_points"),
    *("x", "y", "z", "length", "width", "height", "yaw"),
)
"""Columns of objects.csv: lengths in metres, angles in degrees.

range, azimuth and elevation are those of the sensor: the distance along the ground from the box's centre, and its
direction seen from there, azimuth 0 ahead of the object. x, y, z, length, width, height and yaw are the labelled box in
the frame of the sweep.
"""
EDGES = (0.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 80.0, math.inf)
"""Bounds of the ranges that are counted, metres."""
DISTINCT = 1.0
"""Default of the metres that the sensor must have moved, seen from an object, for another crop of it."""
AROUND, BAND, MIN_GROUND, CLEARANCE, STEEPEST, FITS = 2.0, 0.5, 20, 0.1, 0.3, 4
"""Fit of the ground: metres around a box and above or below its bottom in which points are taken, their least number,
metres that noise and grass may rise above the plane, the largest slope that a ground has, and the number of fits."""
SAME_SIDES = 0.01
"""Metres to which the sides of two boxes agree where layouts do not say which objects are the same."""

OTHER_LABELS = "of other labels"
"""Reason for which boxes are left out that are in no class."""

Classes = Mapping[str, Sequence[str]]
Ground = float | Literal["fit"] | None
_LOG = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class Crop:
    """Points of one object in one sweep."""

    class_name: str
    sweep: str
    box: LabelledBox
    points: FloatArray  # (n, 3), metres, in the frame of the box or of the sensor
    sensor: FloatArray  # (3,), place of the sensor in the frame of the sweep

    def __repr__(self) -> str:
        return f"Crop({self.class_name}, {len(self.points)} points, {self.range:.1f} m away, {self.sweep})"

    @cached_property
    def eye(self) -> FloatArray:
        """Place of the sensor in the frame of the box, (3,)."""
        return self.box.to_box(self.sensor[None])[0]

    @property
    def range(self) -> float:
        """Distance along the ground from the sensor to the centre of the box, metres."""
        return float(np.hypot(*(self.box.centre - self.sensor)[:2]))

    def to_row(self) -> dict[str, Any]:
        """Return the columns of objects.csv but for the file."""
        x, y, z = self.eye
        yaw = np.arctan2(self.box.rotation[1, 0], self.box.rotation[0, 0])
        numbers = {
            "range": self.range,
            "azimuth": np.degrees(np.arctan2(y, x)),
            "elevation": np.degrees(np.arctan2(z, np.hypot(x, y))),
            **dict(zip("xyz", self.box.centre, strict=True)),
            **dict(zip(("length", "width", "height"), self.box.size, strict=True)),
            "yaw": np.degrees(yaw),
        }
        words = {"class": self.class_name, "label": self.box.label, "sweep": self.sweep, "track": self.box.track}
        return {**words, "n_points": len(self.points), **{name: f"{value:.6g}" for name, value in numbers.items()}}


@dataclass(frozen=True, eq=False)
class Crops(Sequence[Crop]):
    """Crops of the objects of some sweeps, and what was left out."""

    layout: str  # name of the layout of the sweeps
    objects: list[Crop]
    left_out: Counter[str]  # boxes by the reason for which they were left out
    n_sweeps: int  # sweeps that were read
    failures: list[str]  # a message for each sweep that could not be read

    def __len__(self) -> int:
        return len(self.objects)

    def __repr__(self) -> str:
        counts = Counter(crop.class_name for crop in self.objects)
        said = ", ".join(f"{n} {name}" for name, n in sorted(counts.items()))
        return f"Crops({len(self)} of {self.n_sweeps} sweeps of {self.layout}: {said})"

    def __getitem__(self, index: Any) -> Any:
        """Return a crop, or a list for a slice."""
        return self.objects[index]

    def counts(self) -> tuple[list[str], dict[str, list[int]]]:
        """Return the names of the ranges that have crops, in metres, and the crops of each class in them."""
        bins = np.searchsorted(EDGES, [crop.range for crop in self.objects], side="right") - 1
        used = np.unique(bins).tolist()
        found = {name: [0] * len(used) for name in sorted({crop.class_name for crop in self.objects})}
        for crop, place in zip(self.objects, bins.tolist(), strict=True):
            found[crop.class_name][used.index(place)] += 1
        ends = [(EDGES[place], EDGES[place + 1]) for place in used]
        return [f"{low:g}-{high:g} m" if math.isfinite(high) else f"{low:g} m-" for low, high in ends], found

    @property
    def reasons(self) -> str:
        """Number of boxes left out for each reason, as text."""
        return ", ".join(f"{n} {reason}" for reason, n in self.left_out.most_common())

    def save(self, out: str | Path) -> None:
        """Write the clouds and objects.csv into a folder, which must be empty or missing.

        The table is written last: a folder without it is unfinished. Raises DatasetError where the folder holds files,
        or where there is no crop.
        """
        if not self.objects:
            left_out = f"left out: {self.reasons}" if self.left_out else "the sweeps have no labelled boxes"
            raise DatasetError(f"there must be an object to write; none is left ({left_out}). Choose wider options.")
        out = as_new_path(out, "out")
        check_empty(out)
        text, taken = io.StringIO(newline=""), Counter[str]()
        table = csv.DictWriter(text, FIELDS, lineterminator="\n")
        table.writeheader()
        for crop in self.objects:
            stem = f"{_plain(crop.class_name)}/{_plain(crop.sweep)}"
            name = f"{stem}-{taken[stem]}.ply"
            taken[stem] += 1
            (out / name).parent.mkdir(parents=True, exist_ok=True)
            columns = np.empty(len(crop.points), [(axis, "<f4") for axis in "xyz"])
            for axis, values in zip("xyz", crop.points.T, strict=True):
                columns[axis] = values
            write_table(out / name, columns, synced=False)
            table.writerow({"file": name, **crop.to_row()})
        atomic.write(out / OBJECTS, lambda file: file.write(text.getvalue().encode()))


def check_empty(out: Path) -> None:
    """Raise DatasetError unless a folder is empty or missing."""
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise DatasetError(f"{out} must be an empty folder, or missing; it is not. Choose another, or delete it.")


def _plain(name: str) -> str:
    """Return a name of a file or folder: other characters than letters, digits, dots and dashes become underscores."""
    return re.sub(r"[^\w.+-]", "_", name).lstrip(".") or "_"


def crop_objects(
    source: str | Path,
    out: str | Path | None = None,
    *,
    classes: Mapping[str, str | Sequence[str]] | None = None,
    least_points: int = LEAST_POINTS,
    margin: float = 0.0,
    ground: Ground = FIT,
    range: tuple[float, float] | None = None,
    frame: str = "object",
    distinct: float = DISTINCT,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Crops:
    """Crop the labelled objects of real LiDAR sweeps.

    Parameters
    ----------
    source : path-like
        A folder in the layout of KITTI's object benchmark, Argoverse 2 (extra ``parquet``), nuScenes or Sydney Urban
        Objects; or a table of boxes, .csv or .json, with columns file, label, x, y, z, length, width, height and yaw
        (degrees), whose files are PLY, PCD, .bin, .npy or .npz, in the frame of the LiDAR.
    out : path-like, optional
        Folder to write to: CLASS/SWEEP-NUMBER.ply and objects.csv. By default nothing is written.
    classes : mapping of str to label or labels, optional
        Labels of each class, with * as a wildcard; other labels are left out. By default a label is a class.
    least_points : int
        Minimum points of a crop; others are left out.
    margin : float
        Metres around the box in which points are taken too.
    ground : "fit", float or None
        "fit": points up to 0.1 m above a plane fitted to the points around the box are removed. A number: those up to
        so many metres above the bottom of the box. None: nothing is removed. Scans of Sydney stay whole: they have no
        ground.
    range : (float, float), optional
        Least and largest distance along the ground from the sensor to the box's centre, metres.
    frame : {"object", "sensor"}
        "object": origin in the box's centre, x ahead, z up; "sensor": origin in the sensor, axes of the sweep.
    distinct : float
        Metres that the sensor must have moved, seen from an object, for another crop of it: others are near duplicates.
        The same objects have the same track; where the layout has no tracks, the same label and sides to 1 cm. 0 takes
        all.
    progress : callable
        Called after each sweep with the sweeps done and their number.

    Returns
    -------
    Crops
        A sequence of `Crop`; `left_out` counts the boxes left out by reason, `failures` names unread sweeps.

    Raises
    ------
    DatasetError
        The source has no known layout, no sweep can be read, the folder is not empty, or there is no crop to write.
    OptionError
        A value is out of range, or no label of the sweeps is in a class. A single class without a label of the sweeps
        is a warning of the logger ``zbuf_occlude``.
    UnavailableError
        A package that reads the layout is missing.

    Examples
    --------
    >>> np.save("sweep.npy", zo.sample_surface("car.obj", n_points=500, seed=0).positions)
    >>> box = "file,label,x,y,z,length,width,height\\nsweep.npy,Car,0,0,0,99,99,99"
    >>> _ = open("boxes.csv", "w").write(box)
    >>> (crop,) = zo.crop_objects("boxes.csv", ground=None)
    >>> crop.class_name, len(crop.points)
    ('Car', 500)
    """
    source, out = as_path(source, "source"), None if out is None else as_new_path(out, "out")
    cutter = _Cutter(_checked_classes(classes), least_points, margin, ground, range, frame, distinct)
    if out is not None:
        check_empty(out)
    layout, loaders = find_sweeps(source)
    if not layout.has_ground:
        cutter.ground = None
    objects, labels, failures = list[Crop](), Counter[str](), list[str]()
    for number, load in enumerate(loaders, 1):
        try:
            sweep = load()
        except DatasetError as error:
            failures.append(str(error))
        else:
            labels.update(box.label for box in sweep.boxes)
            objects += cutter.crops_of(sweep)
        progress(number, len(loaders))
    if len(failures) == len(loaders):
        raise DatasetError(failures[0])
    if labels and cutter.left_out[OTHER_LABELS] == labels.total():
        wanted = [label for labels_of in cutter.classes.values() for label in labels_of]
        raise OptionError(
            f"a class must have a label of {source}: {', '.join(sorted(labels))}; got {', '.join(wanted)}."
            f"{did_you_mean(wanted[0], labels)}"
        )
    cutter.warn_of_empty_classes(labels)
    found = Crops(layout.name, objects, cutter.left_out, len(loaders) - len(failures), failures)
    if out is not None:
        found.save(out)
    return found


class _Cutter:
    """Options of crops, what was left out so far, and the sensor's places from which each object was cropped."""

    def __init__(
        self,
        classes: Classes,
        least_points: int,
        margin: float,
        ground: Ground,
        range: tuple[float, float] | None,
        frame: str,
        distinct: float,
    ) -> None:
        check_int("least_points", least_points, 1)
        check_choice("frame", frame, FRAMES)

        def metres(name: str, value: float) -> float:
            return as_number(value, name, "a number of metres, 0 or more", lambda number: number >= 0.0)

        self.classes, self.least_points, self.frame = classes, least_points, frame
        self.margin, self.distinct = metres("margin", margin), metres("distinct", distinct)
        self.ground: Ground = ground  # an array has no one answer to ==
        if ground is not None and not (isinstance(ground, str) and ground == FIT):
            self.ground = metres("ground", ground)
        self.low, self.high = (0.0, math.inf) if range is None else _checked_range(range)
        self.left_out = Counter[str]()
        self.seen = defaultdict[tuple[Any, ...], list[tuple[str, FloatArray]]](list)

    def crops_of(self, sweep: Sweep) -> list[Crop]:
        """Return the crops of a sweep; count the boxes left out by reason."""
        points = sweep.points[np.isfinite(sweep.points).all(axis=1)]
        found = []
        for box in sweep.boxes:
            class_name = self.class_of(box.label)
            if class_name is None:
                self.left_out[OTHER_LABELS] += 1
                continue
            near = points[is_near(box, points, self.margin + AROUND)]
            mine = near[self.is_in(box, near)]
            crop = Crop(class_name, sweep.name, box, self.placed(mine, box, sweep.middle), sweep.middle)
            if not self.low <= crop.range < self.high:
                self.left_out["out of range"] += 1
            elif len(mine) < self.least_points:
                self.left_out[f"with fewer than {self.least_points} points"] += 1
            elif self.is_near_duplicate(crop):
                self.left_out["near duplicates"] += 1
            else:
                found.append(crop)
        return found

    def class_of(self, label: str) -> str | None:
        """Return the class of a label; None where it is in no class."""
        if not self.classes:
            return label
        names = (name for name, labels in self.classes.items() if any(fnmatchcase(label, each) for each in labels))
        return next(names, None)

    def warn_of_empty_classes(self, labels: Collection[str]) -> None:
        """Log a warning for each class that has none of the labels of the sweeps."""
        used = set(map(self.class_of, labels))
        for name, wanted in self.classes.items() if labels else ():
            if name not in used:
                said = (
                    f"class {name} has no box: the sweeps do not have {', '.join(wanted)}, or an earlier class takes "
                    f"it. Their labels are {', '.join(sorted(labels))}."
                )
                _LOG.warning("%s%s", escape_control(said), did_you_mean(wanted[0], set(labels) - set(wanted)))

    def is_in(self, box: LabelledBox, points: FloatArray) -> BoolArray:
        """Return which points (n, 3) are the object's."""
        inside = box.contains(points, self.margin)
        if self.ground is None:
            return inside
        local = box.to_box(points)
        bottom = -box.size[2] / 2.0
        floor = ground_below(local, box.size) + CLEARANCE if self.ground == FIT else bottom + self.ground
        return np.asarray(inside & (local[:, 2] > floor))

    def placed(self, points: FloatArray, box: LabelledBox, sensor: FloatArray) -> FloatArray:
        """Return points (n, 3) of a sweep in the frame that was chosen."""
        return box.to_box(points) if self.frame == "object" else points - sensor

    def is_near_duplicate(self, crop: Crop) -> bool:
        """Return whether an object was cropped in another sweep from nearly the same place; note the place if not."""
        sides = tuple(np.rint(crop.box.size / SAME_SIDES).astype(int).tolist())
        seen = self.seen[(crop.box.label, crop.box.track or sides)]
        if any(np.linalg.norm(eye - crop.eye) < self.distinct for sweep, eye in seen if sweep != crop.sweep):
            return True
        seen.append((crop.sweep, crop.eye))
        return False


def is_near(box: LabelledBox, points: FloatArray, distance: float) -> BoolArray:
    """Return which points (n, 3) may be within a distance of a box, (n,): a cheap bound that leaves few of a sweep."""
    reach = np.linalg.norm(box.size) / 2.0 + math.sqrt(3.0) * distance
    return np.asarray((np.abs(points[:, 0] - box.centre[0]) < reach) & (np.abs(points[:, 1] - box.centre[1]) < reach))


def ground_below(local: FloatArray, size: FloatArray) -> FloatArray:
    """Return the height of the ground below points (n, 3) in the frame of a box (size (3,)), (n,).

    It is a plane fitted by least squares, again and again without the points farther than `CLEARANCE` above it, to
    those within `AROUND` of the box's sides and `BAND` of its bottom. Where they are few, or the plane is steep, the
    bottom is the ground.
    """
    beside = np.abs(local[:, :2]) - size[:2] / 2.0
    bottom = -size[2] / 2.0
    around = (beside < AROUND).all(axis=1) & (beside > 0.0).any(axis=1) & (np.abs(local[:, 2] - bottom) < BAND)
    near = local[around]
    plane = np.array([0.0, 0.0, bottom])
    for _ in range(FITS):
        if len(near) < MIN_GROUND:
            break
        columns = np.column_stack([near[:, :2], np.ones(len(near))])
        fitted = np.linalg.lstsq(columns, near[:, 2], rcond=None)[0]
        if np.hypot(fitted[0], fitted[1]) > STEEPEST:
            break
        plane = fitted
        near = near[near[:, 2] - columns @ plane < CLEARANCE]
    return np.asarray(local[:, :2] @ plane[:2] + plane[2])


def _checked_classes(classes: Mapping[str, str | Sequence[str]] | None) -> Classes:
    """Return the labels of each class; raise OptionError for a class without a name or labels."""
    if not isinstance(classes, Mapping | None):
        raise OptionError(f"classes must be a dict of the labels of each class; it is {shown(classes)}.")
    found = {}
    for name, labels in (classes or {}).items():
        several = [labels] if isinstance(labels, str) else list(labels) if isinstance(labels, Collection) else []
        named = isinstance(name, str) and name
        if not named or not several or not all(isinstance(each, str) and each for each in several):
            raise OptionError(f"a class must have a name and labels; {shown(name)} has {shown(labels)}.")
        found[name] = several
    return found


def _checked_range(span: tuple[float, float]) -> tuple[float, float]:
    """Return the least and the largest distance; raise OptionError where they are not two numbers in order."""
    numbers = as_array(span, "range", "metres A..B")
    if numbers.shape != (2,) or numbers.dtype.kind not in "fiu" or not 0.0 <= numbers[0] < numbers[1]:
        raise OptionError(f"range must be metres A..B, two numbers with 0 <= A < B; got {shown(span)}.")
    return float(numbers[0]), float(numbers[1])
