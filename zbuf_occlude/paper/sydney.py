"""Sydney Urban Objects: real scans of a spinning lidar, CSV or binary, in their four folds."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from zbuf_occlude.arrays import FloatArray
from zbuf_occlude.dataset.clouds import draw, fit
from zbuf_occlude.errors import DatasetError
from zbuf_occlude.learn.data import CloudSet
from zbuf_occlude.seeds import seed_of

CLASSES = (
    "4wd", "building", "bus", "car", "pedestrian", "pillar", "pole", "traffic_lights", "traffic_sign", "tree", "truck",
    "trunk", "ute", "van",
)  # fmt: skip
"""The fourteen classes that are in the folds, 588 scans; twelve others, 43 scans, are in none."""
VEHICLES = ("4wd", "bus", "car", "truck", "ute", "van")
"""The six classes that the paper's 4.4 expects to be taken for cars: 188 of the 588."""
N_FOLDS = 4
UPS = ("z", "-z")
"""Which direction of the files is up; `sydney_frame.find_frame` finds out."""
SOURCE = "https://www.acfr.usyd.edu.au/papers/SydneyUrbanObjectsDataset.shtml"
ARCHIVE = "sydney-urban-objects-dataset"
"""Folder that the archive unpacks into."""

RECORD = np.dtype(
    [
        ("t", "<i8"),
        ("intensity", "u1"),
        ("id", "u1"),
        ("x", "<f4"),
        ("y", "<f4"),
        ("z", "<f4"),
        ("azimuth", "<f4"),
        ("range", "<f4"),
        ("pid", "<i4"),
    ]
)
"""A point of a binary file, 34 bytes without gaps; a CSV file has the same columns, its time as text."""
_XYZ = (3, 4, 5)  # columns of a CSV file


@dataclass(frozen=True)
class Scan:
    """One scan of an object.

    Parameters
    ----------
    name : str
        CLASS.NUMBER.FRAME, such as 4wd.0.2299.
    fold : int
    path : Path
        Its file, binary where there is one.
    """

    name: str
    fold: int
    path: Path

    @property
    def label(self) -> str:
        """Name of its class."""
        return self.name.partition(".")[0]


def find_scans(root: Path) -> list[Scan]:
    """List the scans of the four folds.

    Parameters
    ----------
    root : Path
        The unpacked archive: the folder with ``objects/`` and ``folds/``, or the folder above it.

    Returns
    -------
    list of Scan
        Fold after fold, in the order of the fold's file.

    Raises
    ------
    DatasetError
        A folder, a fold or a scan is missing, or a scan's class is none of `CLASSES`.
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

    Raises
    ------
    DatasetError
        As `find_scans` and `read_scan`; or the folds have no scan of one of `VEHICLES`.
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
    """Return the scan of a class that has the most points.

    Raises
    ------
    DatasetError
        As `find_scans` and `read_scan`; or the folds have no scan of the class.
    """
    scans = [scan for scan in find_scans(root) if scan.label == label]
    if not scans:
        raise DatasetError(f"the folds in {root} must have scans of {label}; they have none. Unpack the archive again.")
    return max(scans, key=lambda scan: (len(read_scan(scan.path, UPS[0])), scan.name))


def read_scan(path: Path, up: str) -> FloatArray:
    """Read the points of a scan.

    Parameters
    ----------
    path : Path
        Ends in ``.bin`` (records of `RECORD`) or ``.csv``.
    up : str
        Which direction of the file is up, one of `UPS`.

    Returns
    -------
    (n, 3) float64
        Metres in the scanning vehicle's frame, turned about its x axis, if need be, so that z is up.

    Raises
    ------
    DatasetError
        Not whole records, not numbers, no point, or positions that are not finite in float32.

    Notes
    -----
    Where -z is up, both y and z change their sign, so that nothing is mirrored.
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


def read_clouds(
    root: Path, n_points: int, up: str, *, seed: int = 0, folds: Sequence[int] = range(N_FOLDS)
) -> CloudSet:
    """Read the scans of some folds as clouds of equal size.

    Parameters
    ----------
    root : Path
        As in `find_scans`.
    n_points : int
        Points of each cloud; those of a scan repeat only when it has fewer (half of them have fewer than 180).
    up : str
        As for `read_scan`.
    seed : int
    folds : sequence of int

    Returns
    -------
    CloudSet
        Labels index `CLASSES`, each scan is an object of its own; centred, longest side 1; elevations unknown.

    Raises
    ------
    DatasetError
        As `find_scans` and `read_scan`.
    """
    scans = [scan for scan in find_scans(root) if scan.fold in folds]
    positions = np.empty((len(scans), n_points, 3), dtype=np.float32)
    for cloud, scan in zip(positions, scans, strict=True):
        points = read_scan(scan.path, up)
        rng = np.random.default_rng(seed_of(seed, f"sydney/{scan.name}"))
        chosen = points[draw(np.arange(len(points)), n_points, rng)]
        centre, factor = fit(chosen)
        cloud[:] = (chosen - centre) * factor
    labels = np.array([CLASSES.index(scan.label) for scan in scans])
    return CloudSet(positions, labels, CLASSES, np.arange(len(scans)), np.full(len(scans), np.nan))
