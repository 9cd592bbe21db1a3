"""What a sensor does to a classifier: trained on uniform clouds, on scans, on scans in streets; tested on all three.

The three kinds show the same objects from the same sides. With their `own` numbers of points a scan also differs in how
many points it has; `matched`, each cloud is thinned to as many as the poorest of the three has of that object and view,
so that only where the points lie is left to differ.
"""

from collections.abc import Callable
from dataclasses import asdict
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.dataset.folder import MANIFEST
from zbuf_occlude.dataset.plan import Plan, Recipe
from zbuf_occlude.dataset.presets import seventy_five_each
from zbuf_occlude.dataset.source import open_dataset
from zbuf_occlude.errors import DatasetError
from zbuf_occlude.learn.data import CloudSet
from zbuf_occlude.meshes.collection import SPLITS, MeshCollection
from zbuf_occlude.paper import drives
from zbuf_occlude.paper.design import COUNTS, KINDS, MATCHED, OWN, REALISM, SCENES, UNIFORM, Size, name_of_real
from zbuf_occlude.paper.objects import first_of_each, make_clouds, resampled
from zbuf_occlude.paper.trials import Trial, as_many_clouds
from zbuf_occlude.seeds import seed_of
from zbuf_occlude.sensors import make
from zbuf_occlude.sensors.scan import default_caster
from zbuf_occlude.sensors.setup import Setup, document_of

SENSOR = "hdl-64e"
"""KITTI's."""
METRES = 4.5
"""Longest side of every object: a car's, for a bottle of its own size would have no points at these ranges."""
RANGE = (6.0, 40.0)
HIDDEN = (0.0, 0.6)
ELEVATIONS = "2..8"
"""Of the views, degrees. In streets the sensor's height says it: 1.73 m, seen from the object's middle."""
LEAST_POINTS = 16
"""A view of an object is left out in which one of the three kinds has fewer."""

Clouds = dict[tuple[int, int], NDArray[np.float32]]
"""Of a mesh and view the points, each once."""


class RealismClouds:
    """The three datasets in a study's folder, and the real objects.

    Objects, views, points and models are those of 4.3. `real` has labelled sweeps in a layout of `paper.drives`.
    """

    def __init__(self, meshes: MeshCollection, size: Size, folder: Path, real: Path | None = None) -> None:
        self.size, self.folder, self.real = size, folder, real
        self.meshes = first_of_each(seventy_five_each(meshes), size.shares)

    def plan(self, kind: str) -> Plan:
        """Return the plan of a kind of clouds."""
        views = f"random:{self.size.views}@{ELEVATIONS}"
        common: dict[str, Any] = {"method": "exact", "views": views, "sample_size": self.size.n_points[-1]}
        if kind == UNIFORM:
            return Plan(self.meshes, Recipe(**common, n_points=self.size.sampled))
        scene: dict[str, Any] = {"scene": "street", "hidden": HIDDEN} if kind == SCENES else {}
        setup = Setup(document_of(make(SENSOR)), range=RANGE, size={"*": METRES}, method=default_caster(), **scene)
        return Plan(self.meshes, Recipe(**common, scanning=asdict(setup)))

    @property
    def n_clouds(self) -> int:
        """Clouds that `make` makes, at most."""
        return sum(self.plan(kind).n_clouds for kind in KINDS)

    def make(self, progress: Callable[[int], None]) -> dict[str, str]:
        """Make all datasets; return the meshes that could not be used, and why."""
        failures: dict[str, str] = {}
        for kind in KINDS:
            failures |= make_clouds(self.plan(kind), self._folder(kind), progress)
        return failures

    def of(self, kind: str, count: str, split: str) -> CloudSet:
        """Return the clouds of a kind, a way to count points (one of `COUNTS`), and a split."""
        read = self._read(split)
        return as_set(read.clouds[count][kind], read, self.size.n_points[-1], kind)

    def facts(self) -> dict[str, Any]:
        """Return what the report is to say of the clouds, of all splits; they must be made."""
        parts = [self._read(split).clouds[OWN] for split in SPLITS]
        views = [view for part in parts for view in part[UNIFORM]]
        return {
            "objects": len({mesh for mesh, _ in views}),
            "clouds": len(views),
            "points": {k: float(np.median([len(p) for part in parts for p in part[k].values()])) for k in KINDS},
            "sensor": SENSOR,
            "metres": METRES,
            "range": RANGE,
            "hidden": HIDDEN,
            "least": LEAST_POINTS,
        }

    def trials(self) -> list[Trial]:
        """Return the trials: trained on each kind, with own and with matched numbers of points; seed after seed."""
        return [
            Trial(
                REALISM,
                {"model": model, "trained_on": kind, "counts": count, "seed": seed},
                partial(self.of, kind, count, "train"),
                partial(self.of, kind, count, "val"),
                self._tests(count),
                partial(as_many_clouds, self.size.passes),
            )
            for seed in self.size.seeds
            for model in self.size.method_models
            for count in COUNTS
            for kind in KINDS
        ]

    def _tests(self, count: str) -> dict[str, Callable[[], CloudSet]]:
        tests: dict[str, Callable[[], CloudSet]] = {kind: partial(self.of, kind, count, "test") for kind in KINDS}
        if self.real is not None:
            name = name_of_real(drives.layout_of(self.real).name)
            tests[name] = partial(_read_real, self.real, self.size.n_points[-1])
        return tests

    def _folder(self, kind: str) -> Path:
        return self.folder / "clouds" / f"{REALISM}-{kind}"

    def _read(self, split: str) -> "Read":
        folders = {kind: self._folder(kind) for kind in KINDS}
        stamps = tuple((folder / MANIFEST).stat().st_mtime_ns for folder in folders.values())
        return _read_split(tuple(folders.items()), stamps, split)


class Read(NamedTuple):
    """A split of all three kinds."""

    clouds: dict[str, dict[str, Clouds]]  # by count and kind, as of `in_both_counts`
    labels: dict[int, int]  # of each mesh
    classes: tuple[str, ...]


@lru_cache(2)
def _read_real(root: Path, n_points: int) -> CloudSet:
    return drives.read_objects(root, n_points)


@lru_cache(len(SPLITS))
def _read_split(folders: tuple[tuple[str, Path], ...], stamps: tuple[int, ...], split: str) -> Read:
    sets, labels, classes = {}, dict[int, int](), tuple[str, ...]()
    for kind, folder in folders:
        source = open_dataset(folder)
        if split not in source.order:
            raise DatasetError(f"{folder} must have clouds of the split {split}; it has {', '.join(source.order)}.")
        sets[kind], classes = Clouds(), tuple(source.plan.classes)
        for record in source.take(np.sort(source.order[split])):
            mesh = int(record["mesh_id"])
            sets[kind][mesh, int(record["view_id"])] = np.unique(record["data"], axis=0)
            labels[mesh] = int(record["label"][0])
    return Read(in_both_counts(sets), labels, classes)


def in_both_counts(sets: dict[str, Clouds]) -> dict[str, dict[str, Clouds]]:
    """Return clouds of the same meshes and views by count and kind: with their own points, and thinned to the least.

    A mesh and view is in all of them or in none: where one has fewer than `LEAST_POINTS` points, it is left out.
    """
    shared = sorted(set.intersection(*(set(clouds) for clouds in sets.values())))
    least = {key: min(len(clouds[key]) for clouds in sets.values()) for key in shared}
    taken = [key for key in shared if least[key] >= LEAST_POINTS]
    return {
        OWN: {kind: {key: clouds[key] for key in taken} for kind, clouds in sets.items()},
        MATCHED: {
            kind: {key: _thinned(clouds[key], least[key], f"{kind}/{key}") for key in taken}
            for kind, clouds in sets.items()
        },
    }


def _thinned(points: NDArray[np.float32], n: int, name: str) -> NDArray[np.float32]:
    rng = np.random.default_rng(seed_of(0, f"realism/{name}"))
    return points[rng.permutation(len(points))[:n]]


def as_set(clouds: Clouds, read: Read, n_points: int, name: str) -> CloudSet:
    """Return clouds of any number of points as a set of equal ones, each centred with the longest side 1."""
    if not clouds:
        raise DatasetError(
            f"each kind of clouds must have {LEAST_POINTS} points in some view; {name} has not. Make more."
        )
    positions = np.stack(
        [resampled(points, n_points, f"realism/filled/{name}/{key}") for key, points in clouds.items()]
    )
    meshes = np.array([mesh for mesh, _ in clouds])
    labels = np.array([read.labels[mesh] for mesh in meshes])
    return CloudSet(positions, labels, read.classes, meshes, np.full(len(meshes), np.nan))
