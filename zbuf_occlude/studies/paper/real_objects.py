"""Experiment `real`: which generated clouds train classifiers of real objects; the paper's Test 3 (4.4) on real drives.

Road users of the built-in shapes are made into complete clouds, occluded ones and simulated LiDAR scans. Classifiers
that are trained on them are tested on the labelled objects of real sweeps, and on simulated scans held out.
"""

import hashlib
import json
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from functools import lru_cache, partial, reduce
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from zbuf_occlude.base import atomic
from zbuf_occlude.base.errors import DatasetError
from zbuf_occlude.datasets.cloud_folder import OBJECTS
from zbuf_occlude.datasets.plan import DatasetConfig, Plan
from zbuf_occlude.datasets.real.crops import crop_objects
from zbuf_occlude.datasets.real.sweeps import find_sweeps
from zbuf_occlude.datasets.source import open_dataset
from zbuf_occlude.drawing.pictures import draw_cloud, new_figure
from zbuf_occlude.meshes.collection import MeshCollection
from zbuf_occlude.meshes.shapes import traffic
from zbuf_occlude.sensors import make
from zbuf_occlude.sensors.scan_config import LEAST_POINTS, ScanConfig
from zbuf_occlude.studies.learn.data import CloudSet, load_clouds
from zbuf_occlude.studies.paper.design import (
    ALL_AROUND,
    COMPLETE,
    COMPLETE_AND_OCCLUDED,
    COMPLETE_AND_SCANS,
    DRIVE,
    FITTED,
    FITTED_ON,
    HELD_OUT,
    LIDAR,
    OCCLUDED,
    REAL,
    REAL_OBJECTS,
    RECIPES,
    SIMULATED,
    Size,
)
from zbuf_occlude.studies.paper.experiments import Experiment, MakeOptions, epochs_for, first_of_each
from zbuf_occlude.studies.paper.realism import ELEVATIONS, HIDDEN, SENSOR
from zbuf_occlude.studies.paper.results import REAL_PICTURE, Trial

RANGE = (5.0, 50.0)
TO_SHAPES = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], np.float32)
"""Matrix that turns rows of positions from the axes of labelled boxes, x ahead, to those of the shapes, -y ahead."""
CLASSES = {
    "car": ("Car", "REGULAR_VEHICLE", "vehicle.car"),
    "cyclist": ("Cyclist", "BICYCLIST"),
    "pedestrian": ("Pedestrian", "PEDESTRIAN", "human.pedestrian.*"),
    "truck": ("Truck", "BUS", "BOX_TRUCK", "SCHOOL_BUS", "TRUCK", "vehicle.truck", "vehicle.bus.*"),
    "van": ("Van", "LARGE_VEHICLE"),
}
"""Labels of each class in KITTI, Argoverse 2 and nuScenes. A truck is any large vehicle, and so a bus too."""
MERGED = {"bus": "truck"}
"""Classes of the shapes that are part of another one here."""
BANDS = ((5.0, 20.0), (20.0, 35.0), (35.0, 50.0))
"""Ranges by which the answers about real objects are told apart, metres."""
ABOUT = "drive.json"
"""File with the identity of the drive of the crops."""
SHOWN = 4
"""Real and simulated clouds of each class in the picture."""
DRAWN_FROM = np.array([9.0, -12.0, 4.0])
"""Place of the picture's eye, from the middle of a cloud, metres."""

SETS = {
    COMPLETE: (COMPLETE,),
    OCCLUDED: (OCCLUDED,),
    COMPLETE_AND_OCCLUDED: (COMPLETE, OCCLUDED),
    LIDAR: (LIDAR,),
    COMPLETE_AND_SCANS: (COMPLETE, LIDAR),
}
"""Kinds of clouds in each training set."""


class RealObjects(Experiment):
    """Datasets of road users, and classifiers trained on them and tested on the objects of a real drive."""

    def __init__(self, size: Size, folder: Path, real: Path) -> None:
        super().__init__(size, folder)
        renamed = [replace(entry, label=MERGED.get(entry.label, entry.label)) for entry in traffic.collection()]
        self.real, self.meshes = real, first_of_each(MeshCollection(renamed), size.shares)

    @property
    def crops(self) -> Path:
        """Folder of the real objects."""
        return self.dataset_folder(REAL_OBJECTS)

    def plans(self) -> dict[str, Plan]:
        """Return the plans of complete clouds, of occluded ones, and of scans with both laws of the azimuth."""
        n_points, n_views = self.size.n_points[-1], self.size.views
        common: dict[str, Any] = {"method": "exact", "sample_size": n_points, "scale": "metres"}
        uniform = common | {"n_points": self.size.sampled, "views": f"random:{n_views}@0..30"}
        scan = ScanConfig(
            make(SENSOR),
            range=RANGE,
            size="file",
            scene="street",
            hidden=HIDDEN,
            least_points=LEAST_POINTS,
        )
        scans = common | {"scan": scan}
        configs = {
            COMPLETE: DatasetConfig(**uniform, complete=True),
            OCCLUDED: DatasetConfig(**uniform),
            f"{LIDAR}-{ALL_AROUND}": DatasetConfig(**scans, views=f"random:{n_views}@{ELEVATIONS}"),
            f"{LIDAR}-{DRIVE}": DatasetConfig(**scans, views=f"drive:{n_views}@{ELEVATIONS}"),
        }
        return {f"{REAL}-{name}": Plan(self.meshes, config) for name, config in configs.items()}

    def make_datasets(self, options: MakeOptions) -> dict[str, str]:
        """Make the datasets, the crops of the real objects, and the picture of both; as `Experiment.make_datasets`."""
        failures = self._crop()  # first: hours of work follow
        failures |= super().make_datasets(options)
        picture = picture_of_objects(self.tested(), self.simulated("test"))
        atomic.write(self.folder / REAL_PICTURE, lambda file: picture.savefig(file, format="png", dpi=120))
        return failures

    def _crop(self) -> dict[str, str]:
        """Crop the real objects, unless they are there; return the sweeps that could not be read, with the reasons.

        Raises DatasetError where the crops are of another drive, or there is no object.
        """
        path, classes = self.crops.with_name(ABOUT), {name: list(labels) for name, labels in CLASSES.items()}
        about = identity_of(self.real)
        if (self.crops / OBJECTS).exists():
            if json.loads(path.read_text(encoding="utf-8")) != about:
                raise DatasetError(
                    f"{self.folder} must be a study of the drive {self.real}; its objects are not of those sweeps. "
                    "Choose another folder."
                )
            return {}
        crops = crop_objects(self.real, classes=classes, least_points=LEAST_POINTS, range=RANGE)
        path.parent.mkdir(parents=True, exist_ok=True)
        atomic.write_json(path, about)
        crops.save(self.crops)
        return {f"unreadable sweep {number}": why for number, why in enumerate(crops.failures, 1)}

    def training(self, name: str, azimuths: str, scale: str, split: str) -> CloudSet:
        """Return the clouds of a training set, one of `SETS`, and a split; positions are metres.

        With the scale "cloud" classifiers scale each cloud to its longest side, with "metres" they keep the sizes.
        """
        parts = []
        for kind in SETS[name]:
            dataset = f"{kind}-{azimuths}" if kind == LIDAR else kind
            parts.append(self.load_split(f"{REAL}-{dataset}", split, self.size.n_points[-1]))
        return replace(reduce(CloudSet.concatenate, parts), scale=scale)

    def simulated(self, split: str) -> CloudSet:
        """Return the scans with the azimuths of traffic in a split."""
        return self.training(LIDAR, DRIVE, "metres", split)

    def tested(self, low: float = 0.0, high: float = np.inf) -> CloudSet:
        """Return the real objects from `low` to below `high` metres from the sensor, with the classes of the shapes."""
        clouds = _read_crops(self.crops, self.size.n_points[-1]).with_classes(self.meshes.classes)
        clouds = replace(clouds, positions=clouds.positions @ TO_SHAPES)
        ranges = np.asarray(clouds.ranges)
        return clouds.subset((ranges >= low) & (ranges < high))

    def tested_by_fit(self, fitted: bool) -> CloudSet:
        """Return the real objects of the sweeps that are in `FITTED_ON`, or of the others."""
        clouds = self.tested()
        names = np.array(sorted(set(open_dataset(self.crops).origins)))  # sweeps, in the order of their group ids
        return clouds.subset(np.isin(names[clouds.group_ids], FITTED_ON) == fitted)

    def trials(self) -> list[Trial]:
        """Return the trials of `RECIPES`, ordered by seed."""
        return [
            Trial(
                REAL,
                {"model": model, "trained_on": name, "azimuths": azimuths, "scale": scale, "seed": seed},
                partial(self.training, name, azimuths, scale, "train"),
                partial(self.training, name, azimuths, scale, "val"),
                self._tests(),
                partial(epochs_for, self.size.real_passes),
            )
            for seed in self.size.seeds
            for model in self.size.models
            for name, azimuths, scale in RECIPES
        ]

    def _tests(self) -> dict[str, Callable[[], CloudSet]]:
        by_range = {f"{REAL_OBJECTS} {low:g}-{high:g} m": partial(self.tested, low, high) for low, high in BANDS}
        by_fit = {FITTED: partial(self.tested_by_fit, True), HELD_OUT: partial(self.tested_by_fit, False)}
        return {REAL_OBJECTS: self.tested, SIMULATED: partial(self.simulated, "test"), **by_range, **by_fit}

    def notes(self) -> dict[str, Any]:
        """Return facts about the test for the report."""
        clouds = self.tested()
        counts = np.bincount(clouds.labels, minlength=len(clouds.classes)).tolist()
        return {
            REAL: {
                "objects": dict(zip(clouds.classes, counts, strict=True)),
                "sweeps": len(np.unique(clouds.group_ids)),
                "range": RANGE,
                "least": LEAST_POINTS,
            }
        }


def identity_of(drive: Path) -> dict[str, Any]:
    """Return the number of sweeps and a digest of the first that can be read: the same wherever the folder lies."""
    loaders, digest = find_sweeps(drive)[1], ""
    for load in loaders:
        with suppress(DatasetError):
            digest = hashlib.sha256(np.ascontiguousarray(load().points).data).hexdigest()
            break
    return {"sweeps": len(loaders), "sha256": digest}


@lru_cache(1)
def _read_crops(folder: Path, n_points: int) -> CloudSet:
    """Read the real objects as clouds of equal size, metres."""
    return load_clouds(folder, "test", n_points)


def picture_of_objects(real: CloudSet, simulated: CloudSet) -> Figure:
    """Draw some real objects of each class, and below each the simulated one nearest in range."""
    labels = np.unique(real.labels).tolist()
    figure, panels = new_figure(2 * len(labels), SHOWN, panel=1.8)
    for row, label in enumerate(labels):
        mine, theirs = (np.flatnonzero(each.labels == label) for each in (real, simulated))
        order = mine[np.argsort(np.asarray(real.ranges)[mine])]
        for column, number in enumerate(order[np.unique(np.linspace(0, len(order) - 1, SHOWN).astype(int))]):
            range_here = float(np.asarray(real.ranges)[number])
            twin = theirs[np.abs(np.asarray(simulated.ranges)[theirs] - range_here).argmin()] if len(theirs) else None
            pairs = [("real", real.positions[number])]
            if twin is not None:
                pairs.append(("simulated", simulated.positions[twin]))
            for part, (word, positions) in enumerate(pairs):
                axes = panels[2 * row + part, column]
                points = np.unique(positions, axis=0)
                middle = points.mean(axis=0)
                draw_cloud(axes, points, eye=middle + DRAWN_FROM, target=middle)
                axes.set_title(f"{real.classes[label]}, {word}, {range_here:.0f} m", fontsize=7)
    return figure
