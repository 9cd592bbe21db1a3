"""Sydney Urban Objects: real scans of a spinning lidar, in their four folds; and which direction of them is up."""

from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from zbuf_occlude.arrays import FloatArray
from zbuf_occlude.drawing.pictures import new_figure
from zbuf_occlude.errors import DatasetError
from zbuf_occlude.learn.data import CloudSet
from zbuf_occlude.paper.objects import resampled

CLASSES = (
    "4wd", "building", "bus", "car", "pedestrian", "pillar", "pole", "traffic_lights", "traffic_sign", "tree", "truck",
    "trunk", "ute", "van",
)  # fmt: skip
"""The fourteen classes that are in the folds, 588 scans; twelve others, 43 scans, are in none."""
VEHICLES = ("4wd", "bus", "car", "truck", "ute", "van")
"""The six classes that the paper's 4.4 expects to be taken for cars: 188 of the 588."""
N_FOLDS = 4
UPS = ("z", "-z")
"""Which direction of the files is up; `find_frame` finds out."""
SOURCE = "https://www.acfr.usyd.edu.au/papers/SydneyUrbanObjectsDataset.shtml"
ARCHIVE = "sydney-urban-objects-dataset"
"""Folder that the archive unpacks into."""

RECORD = np.dtype(
    [("t", "<i8"), ("intensity", "u1"), ("id", "u1"), *((name, "<f4") for name in ("x", "y", "z", "azimuth", "range")),
     ("pid", "<i4")]
)  # fmt: skip
"""A point of a binary file, 34 bytes without gaps; a CSV file has the same columns, its time as text."""
_XYZ = (3, 4, 5)  # columns of a CSV file

TOP_HEAVY = ("tree", "traffic_sign", "traffic_lights")
"""Classes that are wider above than below: a crown on a trunk, a plate or lights on a pole."""
ASSUMED = "-z"
"""Taken where the scans do not say: x forward, y right, z down, as vehicles' frames of that group are."""
LEAST_POINTS, LEAST_HEIGHT = 30, 0.5
"""A scan with fewer points, or lower (metres), does not vote."""
SURE = 3.0
"""Standard deviations that the votes must be away from a coin's."""
SHOWN = ("car", "4wd", "truck", "tree", "traffic_sign", "pedestrian")


@dataclass(frozen=True)
class Scan:
    """One scan of an object."""

    name: str  # CLASS.NUMBER.FRAME, such as 4wd.0.2299
    fold: int
    path: Path  # binary where there is one

    @property
    def label(self) -> str:
        """Name of its class."""
        return self.name.partition(".")[0]


def find_scans(root: Path) -> list[Scan]:
    """List the scans of the four folds, fold after fold, in the order of the fold's file.

    `root` is the unpacked archive: the folder with ``objects/`` and ``folds/``, or the folder above it. Raises
    DatasetError where a folder, a fold or a scan is missing, or a scan's class is none of `CLASSES`.
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
            scan = Scan(name, fold, path)
            if scan.label not in CLASSES:
                raise DatasetError(
                    f"the class of a scan in {names} must be one of {', '.join(CLASSES)}; {name} is of {scan.label!r}."
                )
            scans.append(scan)
    return scans


def check_scans(root: Path) -> None:
    """Read every scan, so that what is wrong is known before classifiers are trained, not after.

    Raises DatasetError as `find_scans` and `read_scan`; or where the folds have no scan of one of `VEHICLES`.
    """
    scans = find_scans(root)
    absent = [label for label in VEHICLES if not any(scan.label == label for scan in scans)]
    if absent:
        raise DatasetError(
            f"the folds in {root} must have scans of {', '.join(VEHICLES)}; they have none of {', '.join(absent)}. "
            "Unpack the archive again."
        )
    for scan in scans:
        read_scan(scan.path, UPS[0])


def largest_scan(root: Path, label: str) -> Scan:
    """Return the scan of a class that has the most points; raises DatasetError where there is none."""
    scans = [scan for scan in find_scans(root) if scan.label == label]
    if not scans:
        raise DatasetError(f"the folds in {root} must have scans of {label}; they have none. Unpack the archive again.")
    return max(scans, key=lambda scan: (len(read_scan(scan.path, UPS[0])), scan.name))


def read_scan(path: Path, up: str) -> FloatArray:
    """Read the points (n, 3) of a scan, ``.bin`` (records of `RECORD`) or ``.csv``, metres, z up.

    `up` says which direction of the file is up, one of `UPS`; where it is -z, both y and z change their sign, so that
    nothing is mirrored. Raises DatasetError for a file that is not whole records, not numbers, without a point, or
    with positions that are not finite in float32.
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


def read_clouds(root: Path, n_points: int, up: str) -> CloudSet:
    """Read the scans of the four folds as clouds of equal size; raises as `find_scans` and `read_scan`.

    Labels index `CLASSES`, each scan is an object of its own; centred, longest side 1; elevations unknown. Points of a
    scan repeat only where there are fewer than `n_points` (half of the scans have fewer than 180).
    """
    scans = find_scans(root)
    clouds = [resampled(read_scan(scan.path, up), n_points, f"sydney/{scan.name}") for scan in scans]
    labels = np.array([CLASSES.index(scan.label) for scan in scans])
    return CloudSet(np.stack(clouds), labels, CLASSES, np.arange(len(scans)), np.full(len(scans), np.nan))


# ---- which direction is up ---------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Frame:
    """Which way the scans' z axis points, and how that is known."""

    up: str  # one of `UPS`: the direction of the files that is up
    votes: dict[str, tuple[int, int]]  # scans of "vehicles" and "tops" that say z, and -z; empty when a person said it

    @property
    def said(self) -> str:
        """How it is known, in a sentence."""
        if not self.votes:
            return f"{self.up} of the files is up, as --sydney-up says."
        (vehicles_z, vehicles_down), (tops_z, tops_down) = self.votes["vehicles"], self.votes["tops"]
        how = (
            f"wider below than above are {vehicles_down} vehicles if -z is up, {vehicles_z} if z is; wider above than "
            f"below {tops_down} trees, signs and lights if -z is up, {tops_z} if z is."
        )
        known = decided(self.votes)
        return f"{self.up} of the files is up, " + (f"found from the scans: {how}" if known else f"assumed: {how}")

    @property
    def document(self) -> dict[str, Any]:
        """Plain data, for JSON."""
        return {"up": self.up, "said": self.said}


def find_frame(root: Path) -> Frame:
    """Find out which way is up, from all scans of the folds; `ASSUMED` where they do not say clearly.

    A vehicle is longer below, where bonnet and boot are, than its cabin; what stands on a trunk or a pole is wider
    than it. Neither needs to know where the scanner was. That there are more points below does not say it: of
    simulated scans of cars only five of twelve have. Each scan is a vote, and the votes must be `SURE` standard
    deviations away from those of a coin.
    """
    counts = Counter((kind_of(scan.label), vote(read_scan(scan.path, "z"), scan.label)) for scan in find_scans(root))
    votes = {kind: (counts[kind, 1], counts[kind, -1]) for kind in ("vehicles", "tops")}
    return Frame(decided(votes) or ASSUMED, votes)


def decided(votes: dict[str, tuple[int, int]]) -> str:
    """Return the direction that the votes are clear about, or nothing."""
    for_z, for_down = np.sum(list(votes.values()), axis=0)
    if abs(for_z - for_down) <= SURE * np.sqrt(for_z + for_down):
        return ""
    return UPS[0] if for_z > for_down else UPS[1]


def kind_of(label: str) -> str:
    """Return what a class's scans can say: vehicles, tops, or nothing."""
    return "vehicles" if label in VEHICLES else "tops" if label in TOP_HEAVY else ""


def vote(points: FloatArray, label: str) -> int:
    """Say which way is up in a scan (n, 3) as in its file: 1 for z, -1 for -z, 0 where it does not say."""
    heights = points[:, 2] - (points[:, 2].min() + points[:, 2].max()) / 2.0
    if len(points) < LEAST_POINTS or np.ptp(heights) < LEAST_HEIGHT or not kind_of(label):
        return 0
    above, below = points[heights > 0.0], points[heights < 0.0]
    wider_above = int(np.sign(width(above) - width(below)))
    return -wider_above if label in VEHICLES else wider_above


def width(points: FloatArray) -> float:
    """Return how far points lie apart on the ground, root mean square; 0 without any."""
    return float(np.sqrt(points[:, :2].var(axis=0).sum())) if len(points) else 0.0


def picture_of_scans(root: Path, up: str) -> Figure:
    """Draw the largest scan of some classes from the side, up as taken: wheels and trunks belong below."""
    figure, panels = new_figure(1, len(SHOWN), panel=1.85)
    for axes, label in zip(panels[0], SHOWN, strict=True):
        axes.set_aspect("equal", "datalim")
        if any(scan.label == label for scan in find_scans(root)):
            points = read_scan(largest_scan(root, label).path, up)
            ground = points[:, :2] - points[:, :2].mean(axis=0)
            along = np.linalg.svd(ground, full_matrices=False)[2][0]  # its longest direction lies across the picture
            axes.plot(ground @ along, points[:, 2], linestyle="none", marker=".", markersize=1.5, color="#0072b2")
        axes.set_title(label, fontsize=10)
    return figure
