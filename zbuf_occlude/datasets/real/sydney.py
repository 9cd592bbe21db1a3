"""Sydney Urban Objects: 631 scans of single objects, cut out of sweeps; their folds, classes and up direction.

A binary file is records of `RECORD`; a CSV file has the same columns. The positions are in the frame of the LiDAR.

References: De Deuge, Quadros, Hung, Douillard, "Unsupervised feature learning for classification of outdoor 3D scans",
ACRA 2013.
"""

import re
from collections import Counter
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from zbuf_occlude.base.arrays import FloatArray
from zbuf_occlude.base.errors import DatasetError
from zbuf_occlude.datasets.real.sweeps import LabelledBox, Loader, Sweep

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
MIN_POINTS, MIN_HEIGHT = 30, 0.5
"""Minimum points and height (metres) of a scan that votes on the up direction."""
VOTE_SIGMAS = 3.0
"""Standard deviations of a fair coin by which the votes must differ from a draw."""


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


class UpAxis(NamedTuple):
    """Up direction of the scans' files, one of `UPS`, and a sentence on how it was found."""

    up: str
    said: str


def find_frame(scans: Sequence[SydneyScan]) -> UpAxis:
    """Find the up direction from some scans; `ASSUMED_UP` where the votes are not clear.

    Vehicles are wider below (bonnet and boot) than above (cabin); objects on trunks and poles are wider above. Neither
    depends on the position of the scanner. The number of points does not decide: only five of twelve simulated scans of
    cars have more points below. Each scan has a vote; the difference must exceed `VOTE_SIGMAS` standard deviations
    of a fair coin.
    """
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
    if len(points) < MIN_POINTS or np.ptp(heights) < MIN_HEIGHT or label not in (*VEHICLES, *TOP_HEAVY):
        return 0

    def width(part: FloatArray) -> float:
        return float(np.sqrt(part[:, :2].var(axis=0).sum())) if len(part) else 0.0

    wider_above = int(np.sign(width(points[heights > 0.0]) - width(points[heights < 0.0])))
    return -wider_above if label in VEHICLES else wider_above


# ---- as sweeps of one object each ------------------------------------------------------------------------------------

_NAME = re.compile(r"[a-z0-9_]+\.\d+\.\d+\.(bin|csv)")


def find(root: Path) -> list[Loader]:
    """Return a loader for each scan, those in no fold too; a root is the unpacked archive or the folder above it."""
    for folder in (root / "objects", root / ARCHIVE / "objects"):
        files = {path.stem: path for path in sorted(folder.glob("*.*"), reverse=True) if _NAME.fullmatch(path.name)}
        if files:
            scans = [SydneyScan(name, -1, path) for name, path in sorted(files.items())]
            up = find_frame(scans).up
            return [partial(_read, scan, up) for scan in scans]
    return []


def _read(scan: SydneyScan, up: str) -> Sweep:
    """Read a scan as a sweep with one box: the bounds of its points."""
    points = read_scan(scan.path, up)
    low, high = points.min(axis=0), points.max(axis=0)
    box = LabelledBox(scan.class_name, (low + high) / 2.0, np.eye(3), (high - low) * (1.0 + 1e-6) + 1e-6)
    return Sweep(scan.name.rpartition(".")[2], points, [box])
