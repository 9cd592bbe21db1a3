"""Base class of the experiments of a study, and the meshes that experiments select from."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, NamedTuple

from zbuf_occlude.base.errors import MeshError, OptionError
from zbuf_occlude.base.limits import Limits
from zbuf_occlude.base.provenance import MeshSource
from zbuf_occlude.datasets.folder import MANIFEST
from zbuf_occlude.datasets.generate import generate
from zbuf_occlude.datasets.plan import Plan
from zbuf_occlude.datasets.presets import MODELNET8, seventy_five_each
from zbuf_occlude.datasets.workers import Done, Run, Task, run_here
from zbuf_occlude.datasets.workers.local import run_local
from zbuf_occlude.engines.object_space.occupancy import OccupancyGrid
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.meshes import shapes
from zbuf_occlude.meshes.collection import SPLITS, MeshCollection
from zbuf_occlude.meshes.sampling import sample_surface
from zbuf_occlude.studies.learn.data import CloudSet, load_clouds
from zbuf_occlude.studies.paper.design import Size
from zbuf_occlude.studies.paper.figures import cells_as_mesh
from zbuf_occlude.studies.paper.results import Trial
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


def paper_objects(meshes: MeshCollection, shares: tuple[int, int, int]) -> MeshCollection:
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
