"""Real scans as test sets of the experiments: Sydney Urban Objects, and objects of labelled sweeps of drives."""

from collections.abc import Set
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from zbuf_occlude.base.errors import DatasetError
from zbuf_occlude.base.provenance import seed_of
from zbuf_occlude.datasets.real.sweeps import Loader, SweepLayout, find_sweeps
from zbuf_occlude.datasets.real.sydney import CLASSES, UPS, VEHICLES, SydneyScan, find_scans, read_scan
from zbuf_occlude.datasets.records import draw_points, unit_box_transform
from zbuf_occlude.drawing.pictures import new_figure
from zbuf_occlude.studies.learn.data import CloudSet

SHOWN = ("car", "4wd", "truck", "tree", "traffic_sign", "pedestrian")
"""Classes of the picture of scans."""
MIN_POINTS = 16
"""Minimum points of a box of a drive; others are left out."""
MAX_SWEEPS = 400
"""Maximum sweeps of a drive, evenly spaced: gigabytes of points, about ten thousand objects."""
_LARGE = "ARTICULATED_BUS BOX_TRUCK BUS LARGE_VEHICLE SCHOOL_BUS TRUCK TRUCK_CAB VEHICULAR_TRAILER"
CARS: dict[str, tuple[Set[str], Set[str]]] = {
    "KITTI": ({"Car", "Van"}, {"Misc", "Truck", "Tram"}),
    "Argoverse 2": ({"REGULAR_VEHICLE"}, set(_LARGE.split())),
}
"""Labels of cars in each layout of a drive, and ambiguous labels, which are left out; others are other objects."""


def resampled(points: NDArray[Any], n_points: int, name: str) -> NDArray[np.float32]:
    """Return a cloud (n_points, 3) float32 of points (n, 3), centred, longest side 1; `name` seeds the random draw.

    Points repeat only where there are fewer than `n_points`.
    """
    chosen = np.asarray(
        points[draw_points(np.arange(len(points)), n_points, np.random.default_rng(seed_of(0, name)))], float
    )
    centre, factor = unit_box_transform(chosen)
    return np.asarray((chosen - centre) * factor, np.float32)


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


def find_drive(root: Path) -> tuple[SweepLayout, list[Loader]]:
    """Return the layout and the sweeps of a drive; raises DatasetError where its layout is not in `CARS`."""
    layout, loaders = find_sweeps(root)
    if layout.name not in CARS:
        raise DatasetError(f"--real must be a folder in the layout of {' or '.join(CARS)}; {root} is {layout.name}.")
    return layout, loaders


@lru_cache(2)
def read_objects(root: Path, n_points: int) -> CloudSet:
    """Read the objects of real sweeps as clouds of equal size, centred, longest side 1; cached.

    Labels are indices into ("car", "other"); each crop is an object of its own; elevations are NaN. A cloud has all
    points in its box, such as the ground below a car. Points repeat only where there are fewer than `n_points`.

    Raises DatasetError where a file is missing or damaged, or no car has `MIN_POINTS` points.
    """
    clouds, labels = [], []
    layout, loaders = find_drive(root)
    cars, left_out = CARS[layout.name]
    for i in np.unique(np.linspace(0, len(loaders) - 1, min(len(loaders), MAX_SWEEPS)).round().astype(int)):
        sweep = loaders[i]()
        for number, box in enumerate(sweep.boxes):
            points = sweep.points[box.contains(sweep.points)]
            if box.label not in left_out and len(points) >= MIN_POINTS:
                clouds.append(resampled(points, n_points, f"{sweep.name}/{number}"))
                labels.append(0 if box.label in cars else 1)
    if 0 not in labels:
        raise DatasetError(f"{root} must have a car with {MIN_POINTS} points; it has none. Give another folder.")
    unknown = np.full(len(labels), np.nan)
    return CloudSet(np.stack(clouds), np.array(labels), ("car", "other"), np.arange(len(labels)), unknown)
