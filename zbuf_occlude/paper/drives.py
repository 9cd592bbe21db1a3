"""From labelled sweeps to clouds of equal size: what lies in each box that has points enough."""

from collections.abc import Callable, Iterator, Set
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from zbuf_occlude.arrays import FloatArray
from zbuf_occlude.dataset.clouds import draw, fit
from zbuf_occlude.errors import DatasetError
from zbuf_occlude.learn.data import CloudSet
from zbuf_occlude.paper import argoverse, kitti
from zbuf_occlude.paper.sweeps import Sweep
from zbuf_occlude.seeds import seed_of

CAR, OTHER = "car", "other"
LEAST_POINTS = 16
"""A box with fewer is left out."""
MOST_SWEEPS = 400
"""Of a folder with more, this many are read, evenly spaced: some gigabytes of points, ten thousand objects."""


@dataclass(frozen=True)
class Layout:
    """How a published dataset lays out its labelled sweeps.

    Parameters
    ----------
    name : str
    find : callable
        Returns the files of the sweeps of a folder, none where it is not in this layout.
    read : callable
        Returns the sweep of one of them.
    cars : set of str
        Labels of cars.
    left_out : set of str
        Labels that are neither cars nor surely none; all others are other objects.
    """

    name: str
    find: Callable[[Path], list[Path]]
    read: Callable[[Path], Sweep]
    cars: Set[str]
    left_out: Set[str]


LAYOUTS = (
    Layout("KITTI", kitti.find, kitti.read, kitti.CARS, kitti.LEFT_OUT),
    Layout("Argoverse 2", argoverse.find, argoverse.read, argoverse.CARS, argoverse.LEFT_OUT),
)


def layout_of(root: Path) -> Layout:
    """Return the layout of a folder.

    Raises
    ------
    DatasetError
        It is in none of them.
    """
    for layout in LAYOUTS:
        if layout.find(root):
            return layout
    what = "is not there" if not root.is_dir() else "is neither, or has no sweep"
    raise DatasetError(
        f"--real must be a folder in KITTI's layout (velodyne/*.bin, label_2, calib) or Argoverse 2's "
        f"(LOG/annotations.feather, LOG/sensors/lidar/*.feather); {root} {what}."
    )


def check_drive(root: Path) -> None:
    """Read all sweeps that will be read, so that what is wrong is known before classifiers are trained.

    Raises
    ------
    DatasetError
        As `read_clouds`.
    """
    read_clouds(root, 1)


def read_clouds(root: Path, n_points: int, *, seed: int = 0) -> CloudSet:
    """Read the objects of real sweeps as clouds of equal size.

    Parameters
    ----------
    root : Path
        As in `layout_of`.
    n_points : int
        Points of each cloud; those of an object repeat only when it has fewer.
    seed : int

    Returns
    -------
    CloudSet
        Labels index (`CAR`, `OTHER`); each crop is an object of its own; centred, longest side 1; elevations unknown.
        What else lies in a box, such as the ground below a car, is in its cloud.

    Raises
    ------
    DatasetError
        A file is missing or damaged, or no box has `LEAST_POINTS` points.
    """
    clouds, labels = [], []
    for name, is_car, points in _crops(root, layout_of(root)):
        chosen = points[draw(np.arange(len(points)), n_points, np.random.default_rng(seed_of(seed, name)))]
        centre, factor = fit(chosen)
        clouds.append(((chosen - centre) * factor).astype(np.float32))
        labels.append(0 if is_car else 1)
    if 0 not in labels:
        raise DatasetError(f"{root} must have a car with {LEAST_POINTS} points; it has none. Give another folder.")
    return CloudSet(
        np.stack(clouds), np.array(labels), (CAR, OTHER), np.arange(len(labels)), np.full(len(labels), np.nan)
    )


def _crops(root: Path, layout: Layout) -> Iterator[tuple[str, bool, FloatArray]]:
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
