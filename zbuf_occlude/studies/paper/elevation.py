"""Experiment `elevation`: accuracy against the camera's elevation; section 4.2 of the paper (Table 3A, Fig. 12)."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property, partial, reduce
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.base import atomic
from zbuf_occlude.base.arrays import FloatArray
from zbuf_occlude.datasets.plan import DatasetConfig, Plan
from zbuf_occlude.datasets.presets import two_hundred
from zbuf_occlude.meshes.collection import SPLITS, MeshCollection, MeshEntry
from zbuf_occlude.studies.learn.data import CloudSet
from zbuf_occlude.studies.paper.design import ELEVATION, MAIN, SPLIT_BY, TEST_ELEVATIONS, TRAIN_ELEVATIONS, Size
from zbuf_occlude.studies.paper.experiments import Experiment, MakeOptions, epochs_for
from zbuf_occlude.studies.paper.figures import PLANES, degrees, make_mask, projected_areas
from zbuf_occlude.studies.paper.results import AREAS, Trial
from zbuf_occlude.views import Views, paper100

PARTS = ("train", "train", "train", "val", "test")
"""Splits assigned in turn to the objects of each class where some are held out."""
VALIDATION_SHARE = 0.1
"""Fraction of the training clouds used for validation where no object is held out."""
AREA_POINTS = 2_000
AREA_OBJECTS = 40


class Elevation(Experiment):
    """Accuracy against the camera's elevation: each model with the paper's split, and with objects held out.

    The objects are those of `two_hundred`, or `elevation_each` of each class.
    """

    def __init__(self, meshes: MeshCollection, size: Size, folder: Path) -> None:
        super().__init__(size, folder)
        each, n_classes = size.elevation_each, len(meshes.classes)
        self.meshes = _assign_splits(
            two_hundred(meshes) if each is None else meshes.interleaved().limit(each * n_classes)
        )

    def plans(self) -> dict[str, Plan]:
        """Return the plan of the dataset of 4.1."""
        size = self.size
        config = DatasetConfig(
            method=MAIN.method,
            views="paper100",
            n_points=size.elevation_sampled,
            variations=size.variations,
            sample_size=size.elevation_points,
        )
        return {ELEVATION: Plan(self.meshes, config, "packed", _at_most(paper100(), size.azimuths))}

    def make_datasets(self, options: MakeOptions) -> dict[str, str]:
        """Make the dataset, and measure the visible areas of some objects (Fig. 12)."""
        failures = super().make_datasets(options)
        if not (self.folder / AREAS).exists():
            usable = [entry for entry in self.meshes if entry.key not in failures]
            levels, shares = visible_areas(usable[:AREA_OBJECTS])
            document = {"elevations": levels.tolist(), "planes": list(PLANES), "n_objects": len(shares)}
            document |= {"mean": shares.mean(axis=0).tolist(), "spread": shares.std(axis=0).tolist()}
            atomic.write_json(self.folder / AREAS, document)
        return failures

    def trials(self) -> list[Trial]:
        """Return the trials, ordered by seed."""
        return [
            Trial(
                ELEVATION,
                {"model": model, "split": split_by, "seed": seed},
                partial(self.training, split_by),
                partial(self.validation, split_by),
                {str(elevation): partial(self.test, split_by, elevation) for elevation in TEST_ELEVATIONS},
                self.epochs,
            )
            for seed in self.size.elevation_seeds
            for model in self.size.models
            for split_by in SPLIT_BY
        ]

    def _split(self, split: str) -> CloudSet:
        return self.load_split(ELEVATION, split, self.size.elevation_points)

    @cached_property
    def _all(self) -> CloudSet:
        return reduce(CloudSet.concatenate, map(self._split, SPLITS))

    @cached_property
    def _for_validation(self) -> Any:
        """Mask (m,) of the clouds for validation where no object is held out."""
        return np.random.default_rng(0).random(len(self._all)) < VALIDATION_SHARE

    def training(self, split_by: str) -> CloudSet:
        """Return the training clouds, all at the training elevations."""
        clouds = self._split("train") if split_by == "objects" else self._all.subset(~self._for_validation)
        return _at_elevations(clouds, *TRAIN_ELEVATIONS)

    def validation(self, split_by: str) -> CloudSet:
        """Return the validation clouds, all at the training elevations."""
        clouds = self._split("val") if split_by == "objects" else self._all.subset(self._for_validation)
        return _at_elevations(clouds, *TRAIN_ELEVATIONS)

    def test(self, split_by: str, elevation: int) -> CloudSet:
        """Return the test clouds at an elevation (degrees)."""
        if split_by == "objects":
            return _at_elevations(self._split("test"), elevation)
        clouds = _at_elevations(self._all, elevation)
        return clouds.thinned(clouds.group_ids, self.size.per_elevation, seed=0)

    def epochs(self, n_clouds: int) -> int:
        """Return the epochs for `n_clouds` training clouds: as many clouds are shown as with objects held out."""
        return epochs_for(self.size.elevation_epochs * len(self.training("objects")), n_clouds)


def _assign_splits(meshes: MeshCollection) -> MeshCollection:
    """Return the meshes of each class with the splits of `PARTS` in turn."""
    seen = Counter[str]()
    entries = []
    for entry in meshes:
        entries.append(replace(entry, split=PARTS[seen[entry.label] % len(PARTS)]))
        seen[entry.label] += 1
    return MeshCollection(entries)


def _at_most(views: Views, azimuths: int) -> Views:
    """Return at most `azimuths` views per elevation, evenly spaced."""
    levels = degrees(views.elevation)
    chosen: list[int] = []
    for level in np.unique(levels):
        found = np.flatnonzero(levels == level)
        n = min(azimuths, len(found))
        chosen += found[np.arange(n) * len(found) // n].tolist()
    return views.select(sorted(chosen))


def visible_areas(meshes: Sequence[MeshEntry]) -> tuple[NDArray[np.int64], FloatArray]:
    """Return the visible areas of m objects at each elevation of the paper's 100 views.

    Returns the elevations (19,) in degrees, and projected areas (m, 19, 3) on `PLANES` (see `projected_areas`), means
    over the azimuths. On each plane the largest area of an object is 1, so large and small objects count equally. The
    paper's Fig. 12 shows one airplane.
    """
    views, mask = paper100(), make_mask(MAIN.method, {})
    each = degrees(views.elevation)
    levels = np.unique(each)
    curves = []
    for entry in meshes:
        areas = projected_areas(entry.load().normalized(), mask, views, 0, AREA_POINTS)
        curves.append([areas[each == level].mean(axis=0) for level in levels])
    return levels, np.array(curves) / np.max(curves, axis=1, keepdims=True)


def _at_elevations(clouds: CloudSet, *elevations: int) -> CloudSet:
    return clouds.subset(np.isin(degrees(clouds.elevations), elevations))
