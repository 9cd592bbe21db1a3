"""Experiment `realism`, not in the paper: training on uniform clouds, scans, scans in streets, or scans by two eyes.

Classifiers are tested on all of them.
"""

from collections.abc import Callable
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.base.errors import DatasetError
from zbuf_occlude.base.provenance import seed_of
from zbuf_occlude.datasets.folder import MANIFEST
from zbuf_occlude.datasets.plan import DatasetConfig, Plan
from zbuf_occlude.datasets.source import open_dataset
from zbuf_occlude.meshes.collection import SPLITS, MeshCollection
from zbuf_occlude.sensors import make
from zbuf_occlude.sensors.scan_config import LEAST_POINTS, ScanConfig
from zbuf_occlude.studies.learn.data import CloudSet
from zbuf_occlude.studies.paper.design import COUNTS, KINDS, MATCHED, OWN, REALISM, SCENES, TWO_EYES, UNIFORM, Size
from zbuf_occlude.studies.paper.experiments import Experiment, epochs_for, paper_objects
from zbuf_occlude.studies.paper.real_scans import find_drive, read_objects, resampled
from zbuf_occlude.studies.paper.results import Trial

SENSOR = "hdl-64e"
"""LiDAR of the scans: that of KITTI."""
OBJECT_METRES = 4.5
"""Longest side of every object, that of a car; a bottle of true size would have no points at these ranges."""
TRIANGULATING, NEAR_METRES, NEAR_RANGE = "kinect-v1", 1.0, (1.2, 3.5)
"""Sensor, longest side of the objects, and range of `TWO_EYES`; metres."""
RANGE = (6.0, 40.0)
HIDDEN = (0.0, 0.6)
"""Share of an object that others in its street hide."""
ELEVATIONS = "2..8"
"""Elevations of the views, degrees. In streets the sensor's height of 1.73 m determines them."""

Clouds = dict[tuple[int, int], NDArray[np.float32]]
"""Points by mesh and view, without repeats."""


class Realism(Experiment):
    """Datasets of the same objects and views in several `KINDS`, and real objects in a layout of `real_scans`.

    With their `own` numbers of points, the clouds of the kinds differ in size. With `matched` numbers, each cloud is
    thinned to the smallest of its object and view: only the positions of the points differ.
    """

    def __init__(self, meshes: MeshCollection, size: Size, folder: Path, real: Path | None = None) -> None:
        super().__init__(size, folder)
        self.real, self.meshes = real, paper_objects(meshes, size.shares)

    def plans(self) -> dict[str, Plan]:
        """Return the plan of each kind of clouds."""
        return {f"{REALISM}-{kind}": self._plan(kind) for kind in KINDS}

    def _plan(self, kind: str) -> Plan:
        views = f"random:{self.size.views}@{ELEVATIONS}"
        common: dict[str, Any] = {"method": "exact", "views": views, "sample_size": self.size.n_points[-1]}
        if kind == UNIFORM:
            return Plan(self.meshes, DatasetConfig(**common, n_points=self.size.sampled))
        scene: dict[str, Any] = {"scene": "street", "hidden": HIDDEN} if kind == SCENES else {}
        near = kind == TWO_EYES
        scan = ScanConfig(
            make(TRIANGULATING if near else SENSOR),
            range=NEAR_RANGE if near else RANGE,
            size={"*": NEAR_METRES if near else OBJECT_METRES},
            **scene,
        )
        return Plan(self.meshes, DatasetConfig(**common, scan=scan))

    def clouds_of(self, kind: str, count: str, split: str) -> CloudSet:
        """Return the clouds of a kind, one of `COUNTS` and a split."""
        read = self._read(split)
        clouds = read.clouds[count][kind]
        if not clouds:
            raise DatasetError(f"No view of {kind} clouds has {LEAST_POINTS} points. Use more objects or views.")
        n_points = self.size.n_points[-1]
        positions = [resampled(points, n_points, f"realism/filled/{kind}/{key}") for key, points in clouds.items()]
        meshes = np.array([mesh for mesh, _ in clouds])
        labels = np.array([read.labels[mesh] for mesh in meshes])
        return CloudSet(np.stack(positions), labels, read.classes, meshes, np.full(len(meshes), np.nan))

    def notes(self) -> dict[str, Any]:
        """Return facts about the clouds of all splits for the report."""
        parts = [self._read(split).clouds[OWN] for split in SPLITS]
        views = [view for part in parts for view in part[UNIFORM]]
        facts = {
            "objects": len({mesh for mesh, _ in views}),
            "clouds": len(views),
            "points": {k: float(np.median([len(p) for part in parts for p in part[k].values()])) for k in KINDS},
            "sensor": SENSOR,
            "metres": OBJECT_METRES,
            "range": RANGE,
            "hidden": HIDDEN,
            "least": LEAST_POINTS,
            "two_eyes": {"sensor": TRIANGULATING, "metres": NEAR_METRES, "range": NEAR_RANGE},
        }
        return {"realism": facts}

    def trials(self) -> list[Trial]:
        """Return the trials: trained on each kind, with own and matched numbers of points, ordered by seed."""
        return [
            Trial(
                REALISM,
                {"model": model, "trained_on": kind, "counts": count, "seed": seed},
                partial(self.clouds_of, kind, count, "train"),
                partial(self.clouds_of, kind, count, "val"),
                self._tests(count),
                partial(epochs_for, self.size.passes),
            )
            for seed in self.size.seeds
            for model in self.size.method_models
            for count in COUNTS
            for kind in KINDS
        ]

    def _tests(self, count: str) -> dict[str, Callable[[], CloudSet]]:
        tests: dict[str, Callable[[], CloudSet]] = {
            kind: partial(self.clouds_of, kind, count, "test") for kind in KINDS
        }
        if self.real is not None:
            tests[f"real:{find_drive(self.real)[0].name}"] = partial(read_objects, self.real, self.size.n_points[-1])
        return tests

    def _read(self, split: str) -> "_Split":
        folders = tuple((kind, self.dataset_folder(f"{REALISM}-{kind}")) for kind in KINDS)
        return _read_split(folders, tuple((folder / MANIFEST).stat().st_mtime_ns for _, folder in folders), split)


class _Split(NamedTuple):
    """A split of all kinds of clouds."""

    clouds: dict[str, dict[str, Clouds]]  # by count and kind, as returned by `own_and_matched`
    labels: dict[int, int]  # label of each mesh
    classes: tuple[str, ...]


@lru_cache(len(SPLITS))
def _read_split(folders: tuple[tuple[str, Path], ...], made: tuple[int, ...], split: str) -> _Split:
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
    return _Split(own_and_matched(sets), labels, classes)


def own_and_matched(sets: dict[str, Clouds]) -> dict[str, dict[str, Clouds]]:
    """Return the clouds by count and kind: with their own points, and thinned to the smallest of a mesh and view.

    A mesh and view is left out of all kinds where one kind has fewer than `LEAST_POINTS` points.
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
