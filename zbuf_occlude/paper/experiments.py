"""The experiments of a study: their meshes, the datasets they make, the classifiers trained and tested on them.

Elevation is 4.2 of the paper (Table 3A, Fig. 12), augmentation 4.3 and 4.4 (Table 3B) with a comparison of methods of
hidden-surface removal. Realism is ours: trained on uniform clouds, on scans, on scans in streets or
by two eyes; tested on all.
"""

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import cached_property, lru_cache, partial, reduce
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude import shapes
from zbuf_occlude.arrays import FloatArray
from zbuf_occlude.compare.cases import Subject
from zbuf_occlude.dataset import atomic
from zbuf_occlude.dataset.folder import MANIFEST
from zbuf_occlude.dataset.generate import generate
from zbuf_occlude.dataset.plan import DatasetConfig, Plan
from zbuf_occlude.dataset.presets import MODELNET8, plan_of_originals, seventy_five_each, two_hundred
from zbuf_occlude.dataset.source import open_dataset
from zbuf_occlude.errors import DatasetError, GlError, MeshError, OptionError, UnavailableError
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.geometry.sampling import sample_surface
from zbuf_occlude.learn.data import CloudSet, load_clouds
from zbuf_occlude.meshes.collection import SPLITS, MeshCollection, MeshEntry
from zbuf_occlude.object_space.occupancy import OccupancyGrid
from zbuf_occlude.paper.design import (
    AUGMENTATION,
    CLOUDS,
    COUNTS,
    ELEVATION,
    GENERATED,
    HSR,
    KINDS,
    MAIN,
    MATCHED,
    METHODS,
    ORIGINAL,
    OWN,
    REALISM,
    SCANS,
    SCENES,
    SPLIT_BY,
    TEST_ELEVATIONS,
    TRAIN_ELEVATIONS,
    TRAINING_SETS,
    TWO_EYES,
    UNIFORM,
    Size,
    name_of_test,
)
from zbuf_occlude.paper.figures import PLANES, cells_as_mesh, degrees, make_mask, projected_areas
from zbuf_occlude.paper.real_scans import layout_of, read_objects, read_scans, resampled
from zbuf_occlude.paper.results import AREAS, Trial
from zbuf_occlude.provenance import MeshSource, seed_of
from zbuf_occlude.sensors import make
from zbuf_occlude.sensors.scanning import default_caster
from zbuf_occlude.sensors.setup import ScanConfig
from zbuf_occlude.views import Views, modelnet8, paper100

MODELNET40 = "https://modelnet.cs.princeton.edu"
MODELNET10 = (
    "bathtub", "bed", "chair", "desk", "dresser", "monitor", "night_stand", "sofa", "table", "toilet",
)  # fmt: skip
FINEST = 128
"""Voxels a side, at most: the surface of a finer grid has millions of faces."""
SAMPLES_PER_CELL = 30
"""Of a surface that fills a side of the grid; what is thinner than a voxel is still met."""
KEPT = 16
"""Splits of datasets that stay in memory."""

# ---- meshes ------------------------------------------------------------------------------------------------------


def find_objects(modelnet: Path | None = None, *, any_ten: bool = False) -> MeshCollection:
    """Return all meshes that experiments may choose from: of ModelNet40's folder, or the built-in shapes.

    `any_ten`: whether ModelNet10's folder will do: its classes are not the paper's eight, among them no vehicle.
    Raises MeshError where the folder is missing, or lacks one of those classes.
    """
    if modelnet is None:
        return shapes.collection()
    where = f"ModelNet40 comes from {MODELNET40}; without --modelnet the built-in shapes are used."
    if not modelnet.is_dir():
        raise MeshError(f"--modelnet must be ModelNet40's folder; there is no folder {modelnet}. {where}")
    meshes = MeshCollection.from_paths(modelnet)
    missing = [label for label in MODELNET8 if label not in meshes.classes]
    if not missing or (any_ten and is_modelnet10(meshes)):
        return meshes
    hint = " ModelNet10 will do for `paper elevation` alone." if is_modelnet10(meshes) else ""
    raise MeshError(
        f"--modelnet must be ModelNet40's folder, with the classes {', '.join(MODELNET8)}; {modelnet} has no "
        f"{', '.join(missing)}.{hint} {where}"
    )


def is_modelnet10(meshes: MeshCollection) -> bool:
    """Whether there are all of ModelNet10's classes, and not the paper's eight."""
    return set(meshes.classes) >= set(MODELNET10) and not set(meshes.classes) >= set(MODELNET8)


def as_voxels(meshes: MeshCollection, n: int) -> MeshCollection:
    """Return the same collection, each mesh replaced by the surface of the voxels that it meets.

    `n` voxels lie along the longest side. All faces of such a surface lie across an axis, and level ones vanish at
    elevation 0. Keys, classes and splits stay. Raises OptionError for fewer than 2 voxels, or more than `FINEST`.
    """
    if not 2 <= n <= FINEST:
        raise OptionError(f"voxels must lie in 2..{FINEST}, along the longest side; got {n}.")
    return MeshCollection(
        [
            replace(e, load=partial(voxel_surface, e.load, n), path=None, up="", origin=_voxel_origin(e.origin, n))
            for e in meshes
        ]
    )


def voxel_surface(load: Callable[[], Mesh], n: int) -> Mesh:
    """Return the surface of the n^3 grid's cells that a mesh's surface meets, its longest side 1."""
    mesh = load().normalized()
    points = sample_surface(mesh, n_points=SAMPLES_PER_CELL * n * n, seed=0)
    surface = cells_as_mesh(OccupancyGrid(mesh.bounds, n, points.positions).occupied).normalized()
    return replace(surface, name=mesh.name, origin=_voxel_origin(mesh.origin, n))


def _voxel_origin(of: MeshSource, n: int) -> MeshSource:
    return MeshSource.of_recipe("voxels", n, of.sha256) if of.sha256 else of


def _paper_objects(meshes: MeshCollection, shares: tuple[int, int, int]) -> MeshCollection:
    """The paper's 75 meshes of each class; of each class and split the first, as `shares` says of train, val, test."""
    meshes = seventy_five_each(meshes)
    left = {(label, split): n for label in meshes.classes for split, n in zip(SPLITS, shares, strict=True)}
    entries = []
    for entry in meshes:
        left[entry.label, entry.split] -= 1
        if left[entry.label, entry.split] >= 0:
            entries.append(entry)
    return MeshCollection(entries)


# ---- what experiments have in common -----------------------------------------------------------------------------


class Experiment(ABC):
    """Datasets in a study's folder, and the trials on them."""

    def __init__(self, size: Size, folder: Path) -> None:
        self.size, self.folder = size, folder

    @abstractmethod
    def plans(self) -> dict[str, Plan]:
        """Return the plan of each dataset, by its name."""

    @abstractmethod
    def trials(self) -> list[Trial]:
        """Return the trials, seed after seed; datasets are read when a trial needs them."""

    def notes(self) -> dict[str, Any]:
        """Return what study.json says of the datasets, once they are made."""
        return {}

    @property
    def n_clouds(self) -> int:
        """Clouds that `make` makes, at most."""
        return sum(plan.n_clouds for plan in self.plans().values())

    def make(self, progress: Callable[[int], None]) -> dict[str, str]:
        """Make the datasets, resume them, or find them finished; return the meshes that could not be used, and why.

        `progress` is called with the number of clouds each time some are done. Raises DatasetError where a folder holds
        another plan's dataset, MeshError where no mesh of a class could be used, GlError where OpenGL is missing.
        """
        failures: dict[str, str] = {}
        for name, plan in self.plans().items():
            failures |= self._make(name, plan, progress)
        return failures

    def _make(self, name: str, plan: Plan, progress: Callable[[int], None]) -> dict[str, str]:
        folder = self.clouds(name)
        folder.parent.mkdir(parents=True, exist_ok=True)
        failures: dict[str, str] = generate(plan, folder, progress=progress)["failures"]
        used = {entry.label for entry in plan.meshes if entry.key not in failures}
        for entry in plan.meshes:
            if entry.label not in used:
                raise MeshError(
                    f"each class must have a mesh that can be used; {entry.label} has none. One failed so: "
                    f"{failures[entry.key]} Mend them, and choose another folder."
                )
        return failures

    def clouds(self, name: str) -> Path:
        """Return the folder of a dataset."""
        return self.folder / "clouds" / name.replace(":", "-").replace("=", "")

    def load(self, name: str, split: str, n_points: int) -> CloudSet:
        """Return a split of a finished dataset, with `n_points` of each cloud; read once a process."""
        folder = self.clouds(name)
        return _loaded(folder, (folder / MANIFEST).stat().st_mtime_ns, split, n_points)


@lru_cache(KEPT)
def _loaded(folder: Path, made: int, split: str, n_points: int) -> CloudSet:
    return load_clouds(folder, split, n_points)


def as_many_clouds(passes: int, n_clouds: int) -> int:
    """Return in how many epochs a set of clouds comes to about `passes` clouds shown."""
    return max(1, round(passes / n_clouds))


# ---- elevation ---------------------------------------------------------------------------------------------------

PARTS = ("train", "train", "train", "val", "test")
"""Splits of each class's objects, in turn, when some are held out."""
VALIDATION_SHARE = 0.1
"""Of the clouds at the training elevations, where no object is held out."""
AREA_POINTS = 2_000
AREA_OBJECTS = 40


class Elevation(Experiment):
    """Accuracy against the camera's elevation: each model with the paper's split, and with objects held out.

    The objects are `two_hundred` of the meshes, or as many of each class as the size says.
    """

    def __init__(self, meshes: MeshCollection, size: Size, folder: Path) -> None:
        super().__init__(size, folder)
        each, n_classes = size.elevation_each, len(meshes.classes)
        self.meshes = _divided(two_hundred(meshes) if each is None else meshes.interleaved().limit(each * n_classes))

    def plans(self) -> dict[str, Plan]:
        """Return the plan of the dataset of 4.1."""
        size = self.size
        recipe = DatasetConfig(
            method=MAIN.method,
            views="paper100",
            n_points=size.elevation_sampled,
            variations=size.variations,
            sample_size=size.elevation_points,
        )
        return {ELEVATION: Plan(self.meshes, recipe, "packed", _at_most(paper100(), size.azimuths))}

    def make(self, progress: Callable[[int], None]) -> dict[str, str]:
        """Make the dataset, and measure the areas that are seen of some objects (Fig. 12)."""
        failures = super().make(progress)
        if not (self.folder / AREAS).exists():
            usable = [entry for entry in self.meshes if entry.key not in failures]
            levels, shares = areas_seen(usable[:AREA_OBJECTS])
            document = {"elevations": levels.tolist(), "planes": list(PLANES), "n_objects": len(shares)}
            document |= {"mean": shares.mean(axis=0).tolist(), "spread": shares.std(axis=0).tolist()}
            atomic.write_json(self.folder / AREAS, document)
        return failures

    def trials(self) -> list[Trial]:
        """Return the trials, seed after seed."""
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
        return self.load(ELEVATION, split, self.size.elevation_points)

    @cached_property
    def _all(self) -> CloudSet:
        return reduce(CloudSet.concatenate, map(self._split, SPLITS))

    @cached_property
    def _for_validation(self) -> Any:
        """Which clouds validate where no object is held out; (m,) bool."""
        return np.random.default_rng(0).random(len(self._all)) < VALIDATION_SHARE

    def training(self, split_by: str) -> CloudSet:
        """Return the clouds to train on, all at the training elevations."""
        clouds = self._split("train") if split_by == "objects" else self._all.subset(~self._for_validation)
        return _at(clouds, *TRAIN_ELEVATIONS)

    def validation(self, split_by: str) -> CloudSet:
        """Return the clouds to validate with, all at the training elevations."""
        clouds = self._split("val") if split_by == "objects" else self._all.subset(self._for_validation)
        return _at(clouds, *TRAIN_ELEVATIONS)

    def test(self, split_by: str, elevation: int) -> CloudSet:
        """Return the clouds to test on at an elevation (degrees)."""
        if split_by == "objects":
            return _at(self._split("test"), elevation)
        clouds = _at(self._all, elevation)
        return clouds.thinned(clouds.object_ids, self.size.per_elevation, seed=0)

    def epochs(self, n_clouds: int) -> int:
        """Return how often each of `n_clouds` training clouds is shown: as many in all as with objects held out."""
        return as_many_clouds(self.size.elevation_epochs * len(self.training("objects")), n_clouds)


def _divided(meshes: MeshCollection) -> MeshCollection:
    """Return the meshes with the splits of `PARTS`, class by class."""
    seen = Counter[str]()
    entries = []
    for entry in meshes:
        entries.append(replace(entry, split=PARTS[seen[entry.label] % len(PARTS)]))
        seen[entry.label] += 1
    return MeshCollection(entries)


def _at_most(views: Views, azimuths: int) -> Views:
    """Return at most `azimuths` views of each elevation, evenly spaced."""
    levels = degrees(views.elevation)
    chosen: list[int] = []
    for level in np.unique(levels):
        places = np.flatnonzero(levels == level)
        n = min(azimuths, len(places))
        chosen += places[np.arange(n) * len(places) // n].tolist()
    return views.select(sorted(chosen))


def areas_seen(meshes: Sequence[MeshEntry]) -> tuple[NDArray[np.int64], FloatArray]:
    """Return how much of each of m objects is seen from each elevation of the paper's 100 views.

    The elevations (19,) in degrees, and shares (m, 19, 3) of the areas projected on `PLANES` (`projected_areas`), mean
    over the azimuths. Each object's own largest is 1 on each plane: large and small objects count alike, and what
    shows is where an object shows less of itself than from elsewhere. The paper's Fig. 12 shows one airplane.
    """
    views, mask = paper100(), make_mask(MAIN.method, {})
    each = degrees(views.elevation)
    levels = np.unique(each)
    curves = []
    for entry in meshes:
        areas = projected_areas(entry.load().normalized(), mask, views, 0, AREA_POINTS)
        curves.append([areas[each == level].mean(axis=0) for level in levels])
    return levels, np.array(curves) / np.max(curves, axis=1, keepdims=True)


def _at(clouds: CloudSet, *elevations: int) -> CloudSet:
    return clouds.subset(np.isin(degrees(clouds.elevations), elevations))


# ---- augmentation, and methods of hidden-surface removal -----------------------------------------------------------


class Augmentation(Experiment):
    """Training on occluded clouds, complete ones, or both, and on the clouds of each method of HSR.

    `scans` are the root of real scans and which direction of them is up. `budgets` (of `BUDGETS`) say how long
    classifiers are trained: those of Table 3B under each, methods under the first.
    """

    def __init__(
        self,
        meshes: MeshCollection,
        size: Size,
        folder: Path,
        scans: tuple[Path, str] | None = None,
        budgets: Sequence[str] = (CLOUDS,),
    ) -> None:
        super().__init__(size, folder)
        self.scans, self.budgets = scans, tuple(budgets)
        self.meshes = _paper_objects(meshes, size.shares)
        self.missing: dict[str, str] = {}  # methods that cannot run here, and why; `make` fills it

    def plan(self, method: Subject) -> Plan:
        """Return the plan of the occluded clouds by a method."""
        size, views = self.size, modelnet8()
        recipe = DatasetConfig(
            method=method.method,
            method_options=method.options,
            views="modelnet8",
            n_points=size.sampled,
            sample_size=max(size.n_points),
        )
        # 5 elevations by 5 azimuths, row by row: every sixth goes down the diagonal, and in the end comes to all
        return Plan(self.meshes, recipe, "packed", views.select(np.sort(np.arange(size.views) * 6 % len(views))))

    def plans(self) -> dict[str, Plan]:
        """Return the plans of the complete clouds, and of the occluded ones by each method."""
        return {ORIGINAL: plan_of_originals(self.plan(MAIN)), **{m.label: self.plan(m) for m in METHODS}}

    def _make(self, name: str, plan: Plan, progress: Callable[[int], None]) -> dict[str, str]:
        """Make a dataset; a method that cannot run here is left out."""
        try:
            return super()._make(name, plan, progress)
        except (GlError, UnavailableError) as error:
            if name == ORIGINAL:
                raise
            self.missing[name] = str(error)
            progress(plan.n_clouds)  # there will be none to wait for
            return {}

    def notes(self) -> dict[str, Any]:
        """Return the methods that cannot run here, and why."""
        return {"missing_methods": self.missing}

    def of(self, kind: str, split: str, n_points: int, method: Subject = MAIN) -> CloudSet:
        """Return the clouds of a split; `kind` is of `TRAINING_SETS`: generated (by a method), original, both."""
        names = [method.label] * (kind != ORIGINAL) + [ORIGINAL] * (kind != GENERATED)
        return reduce(CloudSet.concatenate, (self.load(name, split, n_points) for name in names))

    def trials(self) -> list[Trial]:
        """Return the trials of Table 3B, then those that compare methods.

        Of Table 3B: each model on each training set, with each number of points, under each budget. Of the methods:
        trained on the generated clouds of one, tested on those of each; with `MAIN` that is training set 1 of Table 3B.
        """
        size, last, first_budget = self.size, self.size.n_points[-1], self.budgets[0]
        able = [method for method in METHODS if method.label not in self.missing]
        table_3b = [
            Trial(
                AUGMENTATION,
                {"model": model, "set": training_set, "points": n_points, "budget": budget, "seed": seed},
                partial(self.of, kind, "train", n_points),
                partial(self.of, kind, "val", n_points),
                self._tests(n_points, able if n_points == last and model in size.method_models else [MAIN]),
                partial(self._epochs, budget),
            )
            for seed in size.seeds
            for budget in self.budgets
            for n_points in size.n_points
            for model in size.augmentation_models
            for training_set, kind in TRAINING_SETS.items()
        ]
        methods = [
            Trial(
                HSR,
                {"model": model, "method": method.label, "points": last, "budget": first_budget, "seed": seed},
                partial(self.of, GENERATED, "train", last, method),
                partial(self.of, GENERATED, "val", last, method),
                self._tests(last, able),
                partial(self._epochs, first_budget),
            )
            for seed in size.seeds
            for model in size.method_models
            for method in able[1:]
        ]
        return table_3b + methods

    def _epochs(self, budget: str, n_clouds: int) -> int:
        return as_many_clouds(self.size.passes, n_clouds) if budget == CLOUDS else self.size.epochs

    def _tests(self, n_points: int, methods: Iterable[Subject]) -> dict[str, Callable[[], CloudSet]]:
        tests: dict[str, Callable[[], CloudSet]] = {ORIGINAL: partial(self.of, ORIGINAL, "test", n_points)}
        tests |= {name_of_test(method): partial(self.of, GENERATED, "test", n_points, method) for method in methods}
        if self.scans is not None:
            tests[SCANS] = partial(read_scans, self.scans[0], n_points, self.scans[1])
        return tests


# ---- realism -----------------------------------------------------------------------------------------------------

SENSOR = "hdl-64e"
"""KITTI's."""
METRES = 4.5
"""Longest side of every object: a car's, for a bottle of its own size would have no points at these ranges."""
TRIANGULATING, NEAR_METRES, NEAR_RANGE = "kinect-v1", 1.0, (1.2, 3.5)
"""Of `TWO_EYES`: the sensor, the longest side of every object, and the range."""
RANGE = (6.0, 40.0)
HIDDEN = (0.0, 0.6)
ELEVATIONS = "2..8"
"""Of the views, degrees. In streets the sensor's height says it: 1.73 m, seen from the object's middle."""
LEAST_POINTS = 16
"""A view of an object is left out in which one of the kinds has fewer."""

Clouds = dict[tuple[int, int], NDArray[np.float32]]
"""Of a mesh and view the points, each once."""


class Realism(Experiment):
    """Datasets of the same objects from the same sides (`KINDS`), and real objects in a layout of `real_scans`.

    With their `own` numbers of points, the kinds differ in how many points a cloud has. `matched`, each cloud is
    thinned to the fewest that one of them has of that object and view: only where the points lie differs.
    """

    def __init__(self, meshes: MeshCollection, size: Size, folder: Path, real: Path | None = None) -> None:
        super().__init__(size, folder)
        self.real, self.meshes = real, _paper_objects(meshes, size.shares)

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
        setup = ScanConfig(
            make(TRIANGULATING if near else SENSOR).to_dict(),
            range=NEAR_RANGE if near else RANGE,
            size={"*": NEAR_METRES if near else METRES},
            method=default_caster(),
            **scene,
        )
        return Plan(self.meshes, DatasetConfig(**common, scanning=setup.to_dict()))

    def of(self, kind: str, count: str, split: str) -> CloudSet:
        """Return the clouds of a kind, a way to count points (one of `COUNTS`), and a split."""
        read = self._read(split)
        clouds = read.clouds[count][kind]
        if not clouds:
            raise DatasetError(
                f"each kind of clouds must have {LEAST_POINTS} points in some view; {kind} has not. Make more."
            )
        n_points = self.size.n_points[-1]
        positions = [resampled(points, n_points, f"realism/filled/{kind}/{key}") for key, points in clouds.items()]
        meshes = np.array([mesh for mesh, _ in clouds])
        labels = np.array([read.labels[mesh] for mesh in meshes])
        return CloudSet(np.stack(positions), labels, read.classes, meshes, np.full(len(meshes), np.nan))

    def notes(self) -> dict[str, Any]:
        """Return what the report is to say of the clouds, of all splits."""
        parts = [self._read(split).clouds[OWN] for split in SPLITS]
        views = [view for part in parts for view in part[UNIFORM]]
        facts = {
            "objects": len({mesh for mesh, _ in views}),
            "clouds": len(views),
            "points": {k: float(np.median([len(p) for part in parts for p in part[k].values()])) for k in KINDS},
            "sensor": SENSOR,
            "metres": METRES,
            "range": RANGE,
            "hidden": HIDDEN,
            "least": LEAST_POINTS,
            "two_eyes": {"sensor": TRIANGULATING, "metres": NEAR_METRES, "range": NEAR_RANGE},
        }
        return {"realism": facts}

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
            tests[f"real:{layout_of(self.real).name}"] = partial(read_objects, self.real, self.size.n_points[-1])
        return tests

    def _read(self, split: str) -> "_Split":
        folders = tuple((kind, self.clouds(f"{REALISM}-{kind}")) for kind in KINDS)
        return _read_split(folders, tuple((folder / MANIFEST).stat().st_mtime_ns for _, folder in folders), split)


class _Split(NamedTuple):
    """A split of all kinds."""

    clouds: dict[str, dict[str, Clouds]]  # by count and kind, as of `in_both_counts`
    labels: dict[int, int]  # of each mesh
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
    return _Split(in_both_counts(sets), labels, classes)


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
