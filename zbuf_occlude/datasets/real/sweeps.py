"""Labelled sweeps of real LiDARs: points, boxes of objects, and the table of the layouts that are read.

A layout is a row of `LAYOUTS` and a file of this folder with `find(root)`: it returns a loader for each sweep of a
folder, none for a folder of another layout.
"""

from collections.abc import Callable, Sequence
from importlib import import_module
from pathlib import Path
from typing import NamedTuple

import numpy as np

from zbuf_occlude.base.arrays import BoolArray, FloatArray
from zbuf_occlude.base.errors import DatasetError

REMEDY = "Copy or unpack it again."


class LabelledBox(NamedTuple):
    """A labelled box in the frame of the points, metres."""

    label: str  # label in the layout
    centre: FloatArray  # (3,)
    rotation: FloatArray  # (3, 3), box to the points' frame; its axes are length, width, height
    size: FloatArray  # (3,), length, width, height
    track: str = ""  # name of the object, the same in all sweeps; empty where the layout has none
    n_points: int | None = None  # returns in it as the makers counted them; None where they are to be counted

    def to_box(self, points: FloatArray) -> FloatArray:
        """Return points (n, 3) in the frame of the box: origin in its centre, x along its length, z up."""
        return np.asarray((points - self.centre) @ self.rotation)

    def contains(self, points: FloatArray, margin: float = 0.0) -> BoolArray:
        """Return which points (n, 3) lie in the box or within `margin` of its sides, (n,) bool."""
        return np.asarray((np.abs(self.to_box(points)) <= self.size / 2.0 + margin).all(axis=1))


class Sweep(NamedTuple):
    """Points (n, 3) of one revolution of a LiDAR, metres, z up, and the labelled boxes of its objects."""

    name: str
    points: FloatArray  # none where a log has boxes and their numbers of returns alone
    boxes: list[LabelledBox]
    mounts: tuple[FloatArray, ...] = (np.eye(4),)  # poses (4, 4) of the LiDARs in the frame of the points

    @property
    def middle(self) -> FloatArray:
        """Middle (3,) of the LiDARs in the frame of the points."""
        return np.mean([mount[:3, 3] for mount in self.mounts], axis=0)


def checked_sides(sides: Sequence[float] | FloatArray) -> FloatArray:
    """Return the sides (3,) of a box; raise ValueError where one is negative or not finite."""
    found = np.asarray(sides, dtype=np.float64)
    if not (found >= 0.0).all() or not np.isfinite(found).all():
        raise ValueError(f"the sides of a box must be 0 or more, and finite; they are {found.tolist()}")
    return found


Loader = Callable[[], Sweep]
"""Reads one sweep; raises DatasetError where a file is missing or damaged."""


class SweepLayout(NamedTuple):
    """Layout of the labelled sweeps of a published dataset."""

    name: str
    summary: str
    module: str  # of this folder
    has_ground: bool = True  # False where objects were cut out already, without the ground

    def find(self, root: Path) -> list[Loader]:
        """Return a loader for each sweep in a place, in order; none where it has another layout."""
        found: list[Loader] = import_module(f"zbuf_occlude.datasets.real.{self.module}").find(root)
        return found


LAYOUTS = (
    SweepLayout("KITTI", "velodyne/*.bin, label_2, calib", "kitti"),
    SweepLayout("Argoverse 2", "LOG/annotations.feather, LOG/sensors/lidar/*.feather", "argoverse"),
    SweepLayout("nuScenes", "v1.0-*/*.json, samples/LIDAR_TOP", "nuscenes"),
    SweepLayout("Sydney Urban Objects", "objects/CLASS.NUMBER.FRAME.bin or .csv", "sydney", has_ground=False),
    SweepLayout("box table", "a .csv or .json file with a box per row, and the clouds that it names", "box_table"),
)


def find_sweeps(root: Path) -> tuple[SweepLayout, list[Loader]]:
    """Return the layout of a place and the loaders of its sweeps; raises DatasetError where it has none of them."""
    if not root.exists():
        raise DatasetError(f"{root} does not exist. Give a folder of labelled sweeps, or a table of boxes.")
    for layout in LAYOUTS:
        if loaders := layout.find(root):
            return layout, loaders
    forms = "; ".join(f"{layout.name} ({layout.summary})" for layout in LAYOUTS)
    raise DatasetError(f"{root} must hold labelled sweeps in one of these layouts: {forms}. It has none of them.")
