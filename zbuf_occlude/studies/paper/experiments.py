"""Experiments of a study: their meshes, their datasets, and the classifiers trained and tested on them.

Elevation is section 4.2 of the paper (Table 3A, Fig. 12). Augmentation is 4.3 and 4.4 (Table 3B), with a comparison of
methods of hidden-surface removal. Realism is not in the paper: classifiers are trained on uniform clouds, on scans, on
scans in streets or on scans by two eyes, and tested on all of them.
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

from zbuf_occlude.base import atomic
from zbuf_occlude.base.arrays import FloatArray
from zbuf_occlude.base.errors import DatasetError, GlError, MeshError, OptionError, UnavailableError
from zbuf_occlude.base.limits import Limits
from zbuf_occlude.base.provenance import MeshSource, seed_of
from zbuf_occlude.datasets.folder import MANIFEST
from zbuf_occlude.datasets.generate import generate
from zbuf_occlude.datasets.plan import DatasetConfig, Plan
from zbuf_occlude.datasets.presets import MODELNET8, plan_of_originals, seventy_five_each, two_hundred
from zbuf_occlude.datasets.source import open_dataset
from zbuf_occlude.datasets.workers import Done, Run, Task, run_here
from zbuf_occlude.datasets.workers.local import run_local
from zbuf_occlude.engines.object_space.occupancy import OccupancyGrid
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.meshes import shapes
from zbuf_occlude.meshes.collection import SPLITS, MeshCollection, MeshEntry
from zbuf_occlude.meshes.sampling import sample_surface
from zbuf_occlude.sensors import make
from zbuf_occlude.sensors.scan_config import LEAST_POINTS, ScanConfig
from zbuf_occlude.sensors.scanning import default_caster
from zbuf_occlude.studies.compare.cases import Subject
from zbuf_occlude.studies.learn.data import CloudSet, load_clouds
from zbuf_occlude.studies.paper.design import (
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
from zbuf_occlude.studies.paper.figures import PLANES, cells_as_mesh, degrees, make_mask, projected_areas
from zbuf_occlude.studies.paper.real_scans import find_drive, read_objects, read_scans, resampled
from zbuf_occlude.studies.paper.results import AREAS, Trial
from zbuf_occlude.views import Views, modelnet8, paper100
from zbuf_occlude.visibility import find_method

MODELNET40 = "https://modelnet.cs.princeton.edu"
MODELNET10 = (
    "bathtub", "bed", "chair", "desk", "dresser", "monitor", "night_stand", "sofa", "table", "toilet",
)  # fmt: skip
FINEST = 128
"""Maximum voxels a side: the surface of a finer grid has millions of faces."""
SAMPLES_PER_CELL = 30
"""Sample points per cell of a full side of the grid; enough to find parts thinner than a voxel."""
CACHED_SPLITS = 16
"""Number of splits of datasets kept in memory."""

# ---- meshes ------------------------------------------------------------------------------------------------------


def find_objects(modelnet: Path | None = None, *, any_ten: bool = False) -> MeshCollection:
    """Return the meshes that experiments select from: those of ModelNet40's folder, or the built-in shapes.

    `any_ten` is True where ModelNet10's folder is allowed too; its classes are not the paper's eight and have no
    vehicle. Raises MeshError where the folder or one of the classes is missing.
    """
    if modelnet is None:
        return shapes.collection()
    where = f"ModelNet40 is at {MODELNET40}. Without --modelnet the built-in shapes are used."
    if not modelnet.is_dir():
        raise MeshError(f"--modelnet must be ModelNet40's folder; there is no folder {modelnet}. {where}")
    meshes = MeshCollection.from_paths(modelnet)
    missing = [label for label in MODELNET8 if label not in meshes.classes]
    if not missing or (any_ten and is_modelnet10(meshes)):
        return meshes
    hint = " ModelNet10 suffices for `paper elevation` alone." if is_modelnet10(meshes) else ""
    raise MeshError(
        f"--modelnet must be ModelNet40's folder, with the classes {', '.join(MODELNET8)}; {modelnet} has no "
        f"{', '.join(missing)}.{hint} {where}"
    )


def is_modelnet10(meshes: MeshCollection) -> bool:
    """Return whether the meshes have all classes of ModelNet10, and not the paper's eight."""
    return set(meshes.classes) >= set(MODELNET10) and not set(meshes.classes) >= set(MODELNET8)


def as_voxels(meshes: MeshCollection, n: int) -> MeshCollection:
    """Return the collection with each mesh replaced by the surface of the voxels that it occupies.

    `n` voxels lie along the longest side. All faces of such a surface are perpendicular to an axis; horizontal ones are
    invisible at elevation 0. Keys, classes and splits are kept. Raises OptionError for `n` outside 2..`FINEST`.
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
    """Return the surface of the cells of an n^3 grid that a mesh occupies, its longest side 1."""
    mesh = load().normalized()
    points = sample_surface(mesh, n_points=SAMPLES_PER_CELL * n * n, seed=0)
    surface = cells_as_mesh(OccupancyGrid(mesh.bounds, n, points.positions).occupied).normalized()
    return replace(surface, name=mesh.name, origin=_voxel_origin(mesh.origin, n))


def _voxel_origin(of: MeshSource, n: int) -> MeshSource:
    return MeshSource.of_recipe("voxels", n, of.sha256) if of.sha256 else of


def _paper_objects(meshes: MeshCollection, shares: tuple[int, int, int]) -> MeshCollection:
    """Return the first of the paper's 75 meshes of each class: `shares` of them in the splits train, val and test."""
    return first_of_each(seventy_five_each(meshes), shares)


def first_of_each(meshes: MeshCollection, shares: tuple[int, int, int]) -> MeshCollection:
    """Return the first meshes of each class: `shares` of them in the splits train, val and test."""
    left = {(label, split): n for label in meshes.classes for split, n in zip(SPLITS, shares, strict=True)}
    entries = []
    for entry in meshes:
        left[entry.label, entry.split] -= 1
        if left[entry.label, entry.split] >= 0:
            entries.append(entry)
    return MeshCollection(entries)


# ---- base class -----------------------------------------------------------------------------


class MakeOptions(NamedTuple):
    """Progress, processes and time of making the datasets of an experiment."""

    progress: Callable[[int], None]  # called with numbers of new clouds
    n_workers: int = 1  # processes that make a dataset
    check_time: Callable[[], None] = lambda: None  # called after each new shard; raises where the time is up


class Experiment(ABC):
    """Experiment of a study: datasets in its folder, and the trials on them."""

    def __init__(self, size: Size, folder: Path) -> None:
        self.size, self.folder = size, folder

    @abstractmethod
    def plans(self) -> dict[str, Plan]:
        """Return the plan of each dataset, by its name."""

    @abstractmethod
    def trials(self) -> list[Trial]:
        """Return the trials, ordered by seed; datasets are read when a trial needs them."""

    def notes(self) -> dict[str, Any]:
        """Return facts about the finished datasets for study.json."""
        return {}

    @property
    def max_clouds(self) -> int:
        """Maximum number of clouds that `make_datasets` makes."""
        return sum(plan.n_clouds for plan in self.plans().values())

    def make_datasets(self, options: MakeOptions) -> dict[str, str]:
        """Make or resume the datasets that are not finished; return the failed meshes with their errors.

        Raises DatasetError where a folder holds a dataset of another plan; MeshError where no mesh of a class can be
        used; GlError where OpenGL is missing; and what ``options.check_time`` raises.
        """
        failures: dict[str, str] = {}
        for name, plan in self.plans().items():
            failures |= self._make_dataset(name, plan, options)
        return failures

    def _make_dataset(self, name: str, plan: Plan, options: MakeOptions) -> dict[str, str]:
        folder = self.dataset_folder(name)
        folder.parent.mkdir(parents=True, exist_ok=True)
        run: Run = run_here  # without OpenGL it raises a GlError, workers do not
        if options.n_workers > 1 and not find_method(plan.config.method).needs_gl:
            run = partial(run_local, n_workers=options.n_workers, limits=Limits())

        def run_in_time(task: Task, jobs: list[Any], done: Done) -> None:
            def done_in_time(job: Any, result: Any) -> None:
                done(job, result)
                options.check_time()

            run(task, jobs, done_in_time)

        failures: dict[str, str] = generate(plan, folder, run=run_in_time, progress=options.progress)["failures"]
        used = {entry.label for entry in plan.meshes if entry.key not in failures}
        for entry in plan.meshes:
            if entry.label not in used:
                raise MeshError(
                    f"No mesh of class {entry.label} can be used. Error of one of them: {failures[entry.key]} "
                    "Repair the meshes and choose another folder."
                )
        return failures

    def dataset_folder(self, name: str) -> Path:
        """Return the folder of a dataset."""
        return self.folder / "clouds" / name.replace(":", "-").replace("=", "")

    def load_split(self, name: str, split: str, n_points: int) -> CloudSet:
        """Return a split of a finished dataset, with `n_points` of each cloud; it is read once per process."""
        folder = self.dataset_folder(name)
        return _loaded(folder, (folder / MANIFEST).stat().st_mtime_ns, split, n_points)


@lru_cache(CACHED_SPLITS)
def _loaded(folder: Path, made: int, split: str, n_points: int) -> CloudSet:
    return load_clouds(folder, split, n_points)


def epochs_for(passes: int, n_clouds: int) -> int:
    """Return the number of epochs in which about `passes` clouds are shown."""
    return max(1, round(passes / n_clouds))


# ---- elevation ---------------------------------------------------------------------------------------------------

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


# ---- augmentation, and methods of hidden-surface removal -----------------------------------------------------------


class Augmentation(Experiment):
    """Training on occluded clouds, on complete ones, on both, and on the clouds by each method of HSR.

    `scans` are the root of the real scans and their up direction. `budgets` are keys of `BUDGETS`: the classifiers of
    Table 3B are trained under each of them, the methods are compared under the first.
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
        self.missing: dict[str, str] = {}  # reasons why methods cannot run here, set by `make_datasets`

    def plan_of(self, method: Subject) -> Plan:
        """Return the plan of the occluded clouds by a method."""
        size, views = self.size, modelnet8()
        config = DatasetConfig(
            method=method.method,
            method_options=method.options,
            views="modelnet8",
            n_points=size.sampled,
            sample_size=max(size.n_points),
        )
        # of 5 x 5 views, every sixth is on the diagonal; multiples of 6 modulo 25 reach all of them
        return Plan(self.meshes, config, "packed", views.select(np.sort(np.arange(size.views) * 6 % len(views))))

    def plans(self) -> dict[str, Plan]:
        """Return the plans of the complete clouds, and of the occluded ones by each method."""
        return {ORIGINAL: plan_of_originals(self.plan_of(MAIN)), **{m.label: self.plan_of(m) for m in METHODS}}

    def _make_dataset(self, name: str, plan: Plan, options: MakeOptions) -> dict[str, str]:
        """Make a dataset; a method that cannot run here is left out."""
        try:
            return super()._make_dataset(name, plan, options)
        except (GlError, UnavailableError) as error:
            if name == ORIGINAL:
                raise
            self.missing[name] = str(error)
            options.progress(plan.n_clouds)  # the progress bar must reach its end
            return {}

    def notes(self) -> dict[str, Any]:
        """Return the methods that cannot run here, with reasons."""
        return {"missing_methods": self.missing}

    def clouds_of(self, kind: str, split: str, n_points: int, method: Subject = MAIN) -> CloudSet:
        """Return the clouds of a split; `kind` is generated (by a method), original or both, as in `TRAINING_SETS`."""
        names = [method.label] * (kind != ORIGINAL) + [ORIGINAL] * (kind != GENERATED)
        return reduce(CloudSet.concatenate, (self.load_split(name, split, n_points) for name in names))

    def trials(self) -> list[Trial]:
        """Return the trials of Table 3B, then those that compare methods.

        Table 3B: each model, training set, number of points and budget. Methods: training on the generated clouds by
        one, tests on those by each; for `MAIN` this is training set 1 of Table 3B.
        """
        size, last, first_budget = self.size, self.size.n_points[-1], self.budgets[0]
        able = [method for method in METHODS if method.label not in self.missing]
        table_3b = [
            Trial(
                AUGMENTATION,
                {"model": model, "set": training_set, "points": n_points, "budget": budget, "seed": seed},
                partial(self.clouds_of, kind, "train", n_points),
                partial(self.clouds_of, kind, "val", n_points),
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
                partial(self.clouds_of, GENERATED, "train", last, method),
                partial(self.clouds_of, GENERATED, "val", last, method),
                self._tests(last, able),
                partial(self._epochs, first_budget),
            )
            for seed in size.seeds
            for model in size.method_models
            for method in able[1:]
        ]
        return table_3b + methods

    def _epochs(self, budget: str, n_clouds: int) -> int:
        return epochs_for(self.size.passes, n_clouds) if budget == CLOUDS else self.size.epochs

    def _tests(self, n_points: int, methods: Iterable[Subject]) -> dict[str, Callable[[], CloudSet]]:
        tests: dict[str, Callable[[], CloudSet]] = {ORIGINAL: partial(self.clouds_of, ORIGINAL, "test", n_points)}
        tests |= {
            name_of_test(method): partial(self.clouds_of, GENERATED, "test", n_points, method) for method in methods
        }
        if self.scans is not None:
            tests[SCANS] = partial(read_scans, self.scans[0], n_points, self.scans[1])
        return tests


# ---- realism -----------------------------------------------------------------------------------------------------

SENSOR = "hdl-64e"
"""LiDAR of the realism experiment: that of KITTI."""
OBJECT_METRES = 4.5
"""Longest side of every object, that of a car; a bottle of true size would have no points at these ranges."""
TRIANGULATING, NEAR_METRES, NEAR_RANGE = "kinect-v1", 1.0, (1.2, 3.5)
"""Sensor, longest side of the objects, and range of `TWO_EYES`; metres."""
RANGE = (6.0, 40.0)
HIDDEN = (0.0, 0.6)
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
        scan = ScanConfig(
            make(TRIANGULATING if near else SENSOR),
            range=NEAR_RANGE if near else RANGE,
            size={"*": NEAR_METRES if near else OBJECT_METRES},
            method=default_caster(),
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
