"""Accuracy against the camera's elevation (paper 4.2, Table 3A): clouds, trials, and the areas seen (Fig. 12)."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property, partial, reduce
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.arrays import FloatArray
from zbuf_occlude.dataset import atomic
from zbuf_occlude.dataset.plan import Plan, Recipe
from zbuf_occlude.dataset.presets import two_hundred
from zbuf_occlude.learn.data import CloudSet
from zbuf_occlude.meshes.collection import SPLITS, MeshCollection, MeshEntry
from zbuf_occlude.paper.design import ELEVATION, MAIN, SPLIT_BY, Size
from zbuf_occlude.paper.figures import make_mask, projected_areas
from zbuf_occlude.paper.objects import loaded, make_clouds
from zbuf_occlude.paper.reported import TEST_ELEVATIONS, TRAIN_ELEVATIONS
from zbuf_occlude.paper.results import AREAS
from zbuf_occlude.paper.trials import Trial, as_many_clouds
from zbuf_occlude.views import Views, paper100

PARTS = ("train", "train", "train", "val", "test")
"""Splits of each class's objects, in turn, when some are held out."""
VALIDATION_SHARE = 0.1
"""Of the clouds at the training elevations, where no object is held out."""
AREA_POINTS = 2_000
AREA_OBJECTS = 40
PLANES = ("y-z", "x-z", "x-y")
"""That areas are projected on, as `projected_areas` orders them."""


class ElevationClouds:
    """The dataset of 4.1 in a study's folder, its parts, and the trials on them; `meshes` are all there are."""

    def __init__(self, meshes: MeshCollection, size: Size, folder: Path) -> None:
        self.meshes, self.size, self.folder = meshes, size, folder

    @cached_property
    def plan(self) -> Plan:
        """Objects, views and recipe; `two_hundred` of the meshes, or as many of each class as the size says."""
        size = self.size
        each, n_classes = size.elevation_each, len(self.meshes.classes)
        chosen = two_hundred(self.meshes) if each is None else self.meshes.interleaved().limit(each * n_classes)
        recipe = Recipe(
            method=MAIN.method,
            views="paper100",
            n_points=size.elevation_sampled,
            variations=size.variations,
            sample_size=size.elevation_points,
        )
        return Plan(divided(chosen), recipe, "packed", at_most(paper100(), size.azimuths))

    @property
    def n_clouds(self) -> int:
        """Clouds that `make` makes."""
        return self.plan.n_clouds

    def make(self, progress: Callable[[int], None]) -> dict[str, str]:
        """Make the dataset, and measure the areas; return the meshes that could not be used, and why."""
        failures = make_clouds(self.plan, self.folder / "clouds" / ELEVATION, progress)
        write_areas([e for e in self.plan.meshes if e.key not in failures][:AREA_OBJECTS], self.folder / AREAS)
        return failures

    def trials(self) -> list[Trial]:
        """Return the trials: each model with the paper's split and with objects held out, seed after seed."""
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

    @cached_property
    def _splits(self) -> dict[str, CloudSet]:
        folder = self.folder / "clouds" / ELEVATION
        return {split: loaded(folder, split, self.size.elevation_points) for split in SPLITS}

    @cached_property
    def _all(self) -> CloudSet:
        return reduce(CloudSet.joined, self._splits.values())

    @cached_property
    def _for_validation(self) -> Any:
        """Which clouds validate where no object is held out; (m,) bool."""
        return np.random.default_rng(0).random(len(self._all)) < VALIDATION_SHARE

    def training(self, split_by: str) -> CloudSet:
        """Return the clouds to train on, all at the training elevations."""
        if split_by == "objects":
            return _at(self._splits["train"], TRAIN_ELEVATIONS)
        return _at(self._all.subset(~self._for_validation), TRAIN_ELEVATIONS)

    def epochs(self, n_clouds: int) -> int:
        """Return how often each of `n_clouds` training clouds is shown: as many in all as with objects held out."""
        return as_many_clouds(self.size.elevation_epochs * len(self.training("objects")), n_clouds)

    def validation(self, split_by: str) -> CloudSet:
        """Return the clouds to validate with, all at the training elevations."""
        if split_by == "objects":
            return _at(self._splits["val"], TRAIN_ELEVATIONS)
        return _at(self._all.subset(self._for_validation), TRAIN_ELEVATIONS)

    def test(self, split_by: str, elevation: int) -> CloudSet:
        """Return the clouds to test on at an elevation (degrees)."""
        if split_by == "objects":
            return _at(self._splits["test"], (elevation,))
        clouds = _at(self._all, (elevation,))
        return clouds.thinned(clouds.object_ids, self.size.per_elevation, seed=0)


def divided(meshes: MeshCollection) -> MeshCollection:
    """Return the meshes with the splits of `PARTS`, class by class."""
    seen: dict[str, int] = {}
    entries = []
    for entry in meshes:
        place = seen.get(entry.label, 0)
        seen[entry.label] = place + 1
        entries.append(replace(entry, split=PARTS[place % len(PARTS)]))
    return MeshCollection(entries)


def at_most(views: Views, azimuths: int) -> Views:
    """Return at most `azimuths` views of each elevation, evenly spaced."""
    levels = degrees(views.elevation)
    chosen: list[int] = []
    for level in np.unique(levels):
        places = np.flatnonzero(levels == level)
        n = min(azimuths, len(places))
        chosen += places[np.arange(n) * len(places) // n].tolist()
    return views.select(sorted(chosen))


def write_areas(meshes: Sequence[MeshEntry], path: Path) -> None:
    """Measure what is seen of objects from each elevation, once, and keep it as JSON."""
    if path.exists():
        return
    names, shares = areas_seen(meshes)
    document = {"elevations": names.tolist(), "planes": list(PLANES), "n_objects": len(shares)}
    document |= {"mean": shares.mean(axis=0).tolist(), "spread": shares.std(axis=0).tolist()}
    atomic.write_json(path, document)


def areas_seen(meshes: Sequence[MeshEntry]) -> tuple[NDArray[np.int64], FloatArray]:
    """Return how much of each of m objects is seen from each elevation of the paper's 100 views.

    The elevations (19,) in degrees, and shares (m, 19, 3) of the areas projected on `PLANES` (`projected_areas`), mean
    over the azimuths. Each object's own largest is 1 on each plane: large and small objects count alike, and what
    shows is where an object shows less of itself than from elsewhere. The paper's Fig. 12 shows one airplane.
    """
    views, mask = paper100(), make_mask(MAIN.method, {})
    levels = degrees(views.elevation)
    names = np.unique(levels)
    curves = []
    for entry in meshes:
        areas = projected_areas(entry.load().normalized(), mask, views, 0, AREA_POINTS)
        curves.append([areas[levels == level].mean(axis=0) for level in names])
    return names, np.array(curves) / np.max(curves, axis=1, keepdims=True)


def degrees(elevations: Any) -> Any:
    """Return elevations (radians) as whole degrees."""
    return np.round(np.degrees(elevations)).astype(int)


def _at(clouds: CloudSet, elevations: tuple[int, ...]) -> CloudSet:
    return clouds.subset(np.isin(degrees(clouds.elevations), elevations))
