"""Objects and datasets of the experiments: ModelNet or built-in shapes, also as voxels; clouds made once and loaded."""

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude import shapes
from zbuf_occlude.dataset.folder import MANIFEST
from zbuf_occlude.dataset.generate import generate
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.dataset.presets import MODELNET8
from zbuf_occlude.dataset.records import draw, fit
from zbuf_occlude.errors import MeshError, OptionError
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.geometry.sampling import sample_surface
from zbuf_occlude.learn.data import CloudSet, load_clouds
from zbuf_occlude.meshes.collection import SPLITS, MeshCollection
from zbuf_occlude.object_space.occupancy import OccupancyGrid
from zbuf_occlude.origin import Origin
from zbuf_occlude.paper.figures import cells_as_mesh
from zbuf_occlude.seeds import seed_of

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


def first_of_each(meshes: MeshCollection, shares: tuple[int, int, int]) -> MeshCollection:
    """Return the first meshes of each class and split, as many as `shares` says of train, val and test."""
    left = {(label, split): n for label in meshes.classes for split, n in zip(SPLITS, shares, strict=True)}
    entries = []
    for entry in meshes:
        left[entry.label, entry.split] -= 1
        if left[entry.label, entry.split] >= 0:
            entries.append(entry)
    return MeshCollection(entries)


def as_voxels(meshes: MeshCollection, n: int) -> MeshCollection:
    """Return the same collection, each mesh replaced by the surface of the voxels that it meets.

    `n` voxels lie along the longest side. All faces of such a surface lie across an axis, and level ones vanish at
    elevation 0. Keys, classes and splits stay. Raises OptionError for fewer than 2 voxels, or more than `FINEST`.
    """
    if not 2 <= n <= FINEST:
        raise OptionError(f"voxels must lie in 2..{FINEST}, along the longest side; got {n}.")
    return MeshCollection(
        [
            replace(e, load=partial(voxel_surface, e.load, n), path=None, up="", origin=_origin(e.origin, n))
            for e in meshes
        ]
    )


def voxel_surface(load: Callable[[], Mesh], n: int) -> Mesh:
    """Return the surface of the n^3 grid's cells that a mesh's surface meets, its longest side 1."""
    mesh = load().normalized()
    points = sample_surface(mesh, n_points=SAMPLES_PER_CELL * n * n, seed=0)
    surface = cells_as_mesh(OccupancyGrid(mesh.bounds, n, points.positions).occupied).normalized()
    return replace(surface, name=mesh.name, origin=_origin(mesh.origin, n))


def _origin(of: Origin, n: int) -> Origin:
    return Origin.of_recipe("voxels", n, of.sha256) if of.sha256 else of


def make_clouds(plan: Plan, folder: Path, progress: Callable[[int], None] = lambda clouds: None) -> dict[str, str]:
    """Make the dataset of a plan in a folder, or resume it, or find it finished.

    `progress` is called with the number of clouds each time some are done. Returns the meshes that could not be used,
    and why. Raises DatasetError where the folder holds another plan's dataset, MeshError where no mesh of a class
    could be used, GlError where the method needs OpenGL and there is none.
    """
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


def loaded(folder: Path, split: str, n_points: int) -> CloudSet:
    """Return a split of a finished dataset, with `n_points` of each cloud; read once a process."""
    return _loaded(folder, (folder / MANIFEST).stat().st_mtime_ns, split, n_points)


@lru_cache(KEPT)
def _loaded(folder: Path, made: int, split: str, n_points: int) -> CloudSet:
    return load_clouds(folder, split, n_points)


def resampled(points: NDArray[Any], n_points: int, name: str) -> NDArray[np.float32]:
    """Return a cloud (n_points, 3) float32 of points (n, 3), drawn by its name; centred, its longest side 1.

    Points repeat only where there are fewer.
    """
    chosen = np.asarray(points[draw(np.arange(len(points)), n_points, np.random.default_rng(seed_of(0, name)))], float)
    centre, factor = fit(chosen)
    return np.asarray((chosen - centre) * factor, np.float32)
