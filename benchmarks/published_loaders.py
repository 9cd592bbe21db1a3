"""Published loaders, unmodified, on datasets in their layouts: what they read is compared with the meshes.

    python benchmarks/published_loaders.py FOLDER [--only NAME] [--keep FOLDER]

FOLDER holds checkouts: OWNER+NAME, OWNER/NAME or NAME. What is not there is skipped, and said. The script makes meshes
(boxes at random, in ShapeNet's folders, y up, or ModelNet's, z up), generates a dataset in each layout, and runs each
loader in a process of its own, where only imports that have nothing to do with data are stubs. Loaders need
`pip install transforms3d easydict six "pandas<3"`.

Of what a loader gives some items of each split are checked with trimesh and Open3D alone. The cloud must lie on one
mesh, turned and placed as the layout says; that mesh must have the item's label and split; and Open3D's rays to all
points must be free from one of the cameras, which stand about the true vertical. Exit status 1 if an item fails.
"""

import csv
import importlib.util
import json
import pickle
import subprocess
import sys
import tempfile
import types
from collections.abc import Iterable
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import published_readers as readers
import trimesh
from common import Open3D, heads, row, run
from numpy.typing import NDArray
from published_readers import Item

Array = NDArray[Any]

CLASSES = {"02691156": "airplane", "03001627": "chair", "04379243": "table"}
KINDS = ("shapenet", "modelnet")
SPLITS = ("train", "train", "val", "test", "test")
"""Of the objects of a class, in order."""
Z_UP_TO_Y_UP = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
DISTANCE = 2.0
"""Of the cameras from the object's centre, in longest sides."""
PLACED, FITTED = 5e-4, 4e-3
"""Longest sides that a point may be from the mesh, or behind the face that the camera sees: where the layout says place
and scale, and where they had to be fitted."""
SEEN = 0.995
"""Least share of points that the camera sees."""
REAL = ("openpoints", "scipy")
"""Packages of which only a part is a stub."""
FITTING = 300
"""Points of a cloud by which it is placed."""
CHECKED = 4
"""Items of a split that are checked."""


@dataclass(frozen=True)
class Loader:
    """A row of the table."""

    repository: str  # on GitHub
    name: str  # the class or function of it that reads
    layout: str  # `--format`
    read: Any  # yields the loader's items, in a folder that has `links`, with the checkout on `sys.path`
    # names as the loader's configuration has them, to the dataset's
    links: dict[str, str] = field(default_factory=dict)
    meshes: str = "shapenet"  # in whose folders the meshes lie
    up: str = "y"  # the layout's up axis
    n_views: int = 8
    options: tuple[str, ...] = ()  # of `generate`
    packages: tuple[str, ...] = ()  # that the loader needs
    stubs: tuple[str, ...] = ()  # that it imports, and that have nothing to do with data
    fitted: bool = False  # whether each item has been centred and scaled by itself, by the layout or the loader
    mirrored: bool = False  # whether the loader mirrors horizontal axes at random
    half_turn: bool = False  # whether the layout is turned by half a turn about the vertical
    stretched: bool = False  # whether the loader stretches and moves each cloud of train at random, along each axis
    longest: float = 1.0  # side of an object in the layout


_POINTR = ("transforms3d", "easydict", "yaml", "h5py", "open3d", "torch")
_C = {"data/modelnet40_c": ".", "data/modelnet40_ply_hdf5_2048": "."}
_C_STUBS = (
    "progressbar", "torchvision.transforms", "PCT_Pytorch.pointnet2_ops_lib.pointnet2_ops.pointnet2_utils",
)  # fmt: skip
_OPENPOINTS = (
    "openpoints.models.layers", "torchvision.datasets.utils", "sklearn.metrics", "sklearn.neighbors", "multimethod",
    "termcolor", "shortuuid",
)  # fmt: skip
LOADERS = (
    Loader(
        "yuxumin/PoinTr", "PCN", "pcn", readers.pointr_pcn, {"data/PCN": "."}, packages=_POINTR, mirrored=True,
    ),
    Loader(
        "yuxumin/PoinTr", "Completion3D", "completion3d", readers.pointr_completion3d, {"data/Completion3D": "."},
        n_views=1, packages=_POINTR,
    ),
    Loader(
        "yuxumin/PoinTr", "Projected_ShapeNet", "projected-shapenet", readers.pointr_projected,
        {
            "data/ShapeNet55-34/Projected_ShapeNet-55_noise": ".",
            "data/ShapeNet55-34/projected_partial_noise": "projected_partial_noise",
            "data/ShapeNet55-34/shapenet_pc": "shapenet_pc",
        },
        n_views=16, packages=_POINTR, mirrored=True,
    ),
    Loader(
        "yuxumin/PoinTr", "ShapeNet", "shapenet55", readers.pointr_shapenet,
        {"data/ShapeNet55-34/ShapeNet-55": ".", "data/ShapeNet55-34/shapenet_pc": "shapenet_pc"},
        n_views=1, packages=_POINTR, fitted=True,
    ),
    Loader(
        "CuiRuikai/Partial2Complete", "EPN3D", "epn3d", readers.p2c_epn3d, {"data/EPN3D": "."}, n_views=6,
        packages=_POINTR, mirrored=True,
    ),
    Loader(
        "paul007pl/MVP_Benchmark", "MVP_CP", "mvp", readers.mvp_cp, {"data": "."}, "modelnet", n_views=26,
        packages=("h5py", "torch"),
    ),
    Loader(
        "paul007pl/MVP_Benchmark", "MVP_RG", "pairs", readers.mvp_rg, {"data": "."}, options=("--overlap", "0.1..0.9"),
        packages=("h5py", "open3d", "torch"),
    ),
    Loader(
        "paul007pl/VRCNet", "ShapeNetH5", "mvp", readers.vrcnet, {"data": "."}, n_views=26, packages=("h5py", "torch"),
    ),
    Loader(
        "lynetcha/completion3d", "ShapenetDataProcess", "completion3d", readers.completion3d, {"data/shapenet": "."},
        n_views=1, packages=("h5py", "pandas", "six", "transforms3d"), stubs=("vis",),
    ),
    Loader(
        "jiachens/ModelNet40-C", "ModelNet40C", "modelnet40-c", readers.modelnet40_c, _C, "modelnet", n_views=5,
        packages=("torch",), stubs=_C_STUBS, fitted=True, half_turn=True, longest=2.0,
    ),
    Loader(
        "jiachens/ModelNet40-C", "ModelNet40C (lidar)", "modelnet40-c", readers.modelnet40_c_lidar, _C, "modelnet",
        n_views=5, options=("--sensor", "modelnet40-c-lidar", "--size", "1", "--scale", "object"),
        packages=("torch",), stubs=_C_STUBS, half_turn=True, longest=2.0,
    ),
    Loader(
        "fanglaosi/ModelNet-O_PointMLS", "ModelNet_O", "modelnet-o", readers.pointmls_modelnet_o,
        {"data/ModelNet_O": "."}, "modelnet", "z", packages=("torch",),
    ),
    Loader(
        "fanglaosi/ModelNet-O_PointMLS", "ModelNet40", "hdf5", readers.pointmls_modelnet40,
        {"data/modelnet40_ply_hdf5_2048": "."}, "modelnet", "z", packages=("torch",), fitted=True, stretched=True,
    ),
    Loader(
        "fanglaosi/ModelNet-O_PointMLS", "ScanObjectNN", "scanobjectnn", readers.pointmls_scanobjectnn,
        {"data/h5_files/main_split": "."}, "modelnet", packages=("torch",), fitted=True, stretched=True,
    ),
    Loader(
        "guochengqian/openpoints", "ScanObjectNNHardest", "scanobjectnn", readers.openpoints_scanobjectnn, {},
        "modelnet", packages=("torch", "easydict"), stubs=_OPENPOINTS, fitted=True,
    ),
    Loader(
        "hkust-vgd/scanobjectnn", "convert_to_binary_mask", "scanobjectnn", readers.scanobjectnn_masks, {},
        "modelnet", n_views=0, stubs=("pc_util", "plyfile", "scipy.misc"),
        options=(
            "--sensor", "pinhole:width=320,height=240,fov=40", "--scene", "ground", "--keep", "box", "--size", "1",
            "--scale", "mesh", "--views", "ring:4@30", "--range", "3",
        ),
    ),
    Loader(
        "guochengqian/openpoints", "ModelNet", "modelnet40-normal", readers.openpoints_modelnet,
        {"data/modelnet40_normal_resampled": "."}, "modelnet", packages=("torch", "easydict"), stubs=_OPENPOINTS,
        options=("--with", "normals"), fitted=True, half_turn=True,
    ),
    Loader(
        "yanx27/Pointnet_Pointnet2_pytorch", "ModelNetDataLoader", "modelnet40-normal", readers.pointnet2_modelnet,
        {"data/modelnet40_normal_resampled": "."}, "modelnet", packages=("torch",), options=("--with", "normals"),
        fitted=True, half_turn=True,
    ),
    Loader(
        "charlesq34/pointnet", "provider", "hdf5", readers.pointnet_provider,
        {"data/modelnet40_ply_hdf5_2048": "."}, "modelnet", "z", fitted=True,
    ),
    Loader(
        "yewzijian/RPMNet", "ModelNetHdf", "hdf5", readers.rpmnet_modelnet,
        {"data/modelnet40_ply_hdf5_2048": "."}, "modelnet", "z", options=("--with", "normals"),
        packages=("h5py", "open3d", "torch"), stubs=("torchvision",), fitted=True,
    ),
)  # fmt: skip


@dataclass(frozen=True)
class Object:
    """A mesh that the script has made: vertices in the file's coordinates, about z or y."""

    key: str
    label: str
    split: str
    up: str
    mesh: trimesh.Trimesh

    @property
    def longest(self) -> float:
        return float(self.mesh.extents.max())

    @property
    def centre(self) -> Array:
        return np.asarray(self.mesh.bounds.mean(axis=0))

    def turned(self, vectors: Array, up: str) -> Array:
        """Turn vectors of the file into a layout whose vertical is `up`."""
        if self.up == up:
            return vectors
        return vectors @ (Z_UP_TO_Y_UP.T if up == "y" else Z_UP_TO_Y_UP)


def make_meshes(kind: str, folder: Path) -> list[Object]:
    """Write meshes in ShapeNet's or ModelNet's folders, splits in PCN.json or folders."""
    rng = np.random.default_rng(36)
    objects, index = [], []
    for synset, label in CLASSES.items():
        index.append({"taxonomy_id": synset, "taxonomy_name": label, "train": [], "val": [], "test": []})
        for number, split in enumerate(SPLITS):
            boxes = [
                trimesh.creation.box(rng.uniform(0.1, 0.9, 3)).apply_translation(rng.uniform(-0.5, 0.5, 3))
                for _ in range(6)
            ]
            mesh = trimesh.util.concatenate(boxes).apply_translation(rng.uniform(-3, 3, 3))
            model = f"{int(synset):x}{number}".rjust(32, "0")
            if kind == "shapenet":
                key, path, up = model, folder / synset / model / "models/model_normalized.obj", "y"
                index[-1][split].append(model)
            else:
                key, path, up = f"{label}_{number:04d}", folder / label / split / f"{label}_{number:04d}.off", "z"
            path.parent.mkdir(parents=True, exist_ok=True)
            mesh.export(path)
            objects.append(Object(key, label, split, up, mesh))
    if kind == "shapenet":
        (folder / "PCN.json").write_text(json.dumps(index))
    return objects


def directions(n_views: int) -> Array:
    """Return directions (n, 3) to the cameras about z, most of them oblique."""
    numbers = np.arange(n_views)
    azimuths, elevations = 2.4 * numbers, np.arcsin(0.95 * (1 - (2 * numbers + 1) / n_views))
    flat = np.cos(elevations)
    return np.stack([flat * np.cos(azimuths), flat * np.sin(azimuths), np.sin(elevations)], axis=1)


def write_views(path: Path, n_views: int) -> None:
    """Write the cameras as a CSV for `--views`."""
    with open(path, "w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(["azimuth", "elevation", "distance"])
        for x, y, z in directions(n_views):
            rows.writerow([np.degrees(np.arctan2(y, x)), np.degrees(np.arcsin(z)), DISTANCE])


class Surface(Open3D):
    """A mesh for Open3D: distances to it, and what can be seen of it."""

    def __init__(self, made: Object) -> None:
        super().__init__(made.mesh)
        self.made = made
        self.samples = np.asarray(trimesh.sample.sample_surface(made.mesh, 20_000, seed=0)[0])

    def closest(self, points: Array) -> Array:
        return self.scene.compute_closest_points(self.tensor(points.astype(np.float32)))["points"].numpy()

    def distance(self, points: Array) -> float:
        """Return the largest distance of points from the mesh, in longest sides."""
        return float(np.linalg.norm(points - self.closest(points), axis=1).max() / self.made.longest)

    def eyes(self, n_views: int) -> Array:
        about_z = directions(n_views)
        turned = about_z @ Z_UP_TO_Y_UP.T if self.made.up == "y" else about_z
        return self.made.centre + DISTANCE * self.made.longest * turned

    def seen(self, points: Array, eye: Array, tolerance: float) -> Array:
        """Say which points are not behind the plane of the first face that their ray from the eye meets."""
        away = points - eye
        first = self.scene.cast_rays(self.rays(eye, away))
        left = np.maximum(1 - first["t_hit"].numpy(), 0)  # of the ray, behind the face
        behind = left * np.abs((first["primitive_normals"].numpy() * away).sum(axis=1))
        return np.asarray(behind <= tolerance * self.made.longest)


def fit(points: Array, surface: Surface, like: Array, stretched: bool) -> Array:
    """Place points on a mesh by a scale (or three) and a translation, beginning with the box of some points of it."""
    axis = 0 if stretched else None
    factor = np.ptp(like, axis=0) / np.ptp(points, axis=0)
    factor = factor if stretched else np.ptp(like, axis=0).max() / np.ptp(points, axis=0).max()
    middles = [(each.min(axis=0) + each.max(axis=0)) / 2 for each in (like, points)]
    shift = middles[0] - factor * middles[1]
    some = points[:: max(1, len(points) // FITTING)]
    centred = some - some.mean(axis=0)
    for _ in range(100):
        closest = surface.closest(factor * some + shift)
        factor = (centred * (closest - closest.mean(axis=0))).sum(axis=axis) / (centred**2).sum(axis=axis)
        shift = closest.mean(axis=0) - factor * some.mean(axis=0)
    return factor * points + shift


def mistaken(item: Item, made: Object) -> str:
    """Return what is wrong with what an item says of the mesh that it lies on, or nothing."""
    if (made.label, made.split) != (item.label, item.split):
        return f"is {item.label} in {item.split}; its mesh {made.key} is {made.label} in {made.split}"
    if item.object is not None and item.object != made.key:
        return f"is called {item.object}; it lies on {made.key}"
    return ""


def check_item(item: Item, loader: Loader, surfaces: list[Surface]) -> str:
    """Return what is wrong with an item, or nothing; where it fits several meshes, the right one counts."""
    limit = FITTED if loader.fitted else PLACED
    signs = list(product([1, -1], repeat=2)) if loader.mirrored and item.split == "train" else [(1, 1)]
    signs = [(-1, -1)] if loader.half_turn else signs
    stretched = loader.stretched and item.split == "train"
    best: tuple[Any, ...] = (2,)
    for surface, (first, second) in product(sorted(surfaces, key=lambda s: bool(mistaken(item, s.made))), signs):
        made = surface.made
        mirror = np.array([first, 1, second] if loader.up == "y" else [first, second, 1])

        def back(cloud: Array, made: Object = made, mirror: Array = mirror) -> Array:
            """Turn a cloud into the file's axes."""
            turned = cloud.astype(float) * mirror
            if made.up == loader.up:
                return turned
            return turned @ (Z_UP_TO_Y_UP if loader.up == "y" else Z_UP_TO_Y_UP.T)

        clouds = [back(cloud) for cloud in (item.partial, item.complete) if cloud is not None]
        eyes = surface.eyes(loader.n_views) if item.partial is not None and loader.n_views else [None]
        for eye in eyes:
            if loader.fitted:
                like = surface.samples if eye is None else surface.samples[surface.seen(surface.samples, eye, PLACED)]
                placed = [fit(clouds[0], surface, like, stretched)]
            else:
                placed = [cloud * made.longest / loader.longest + made.centre for cloud in clouds]
            off = max(surface.distance(cloud) for cloud in placed)
            share = 1.0 if eye is None else float(surface.seen(placed[0], eye, limit).mean())
            best = min(best, (off > limit, share < SEEN, mistaken(item, made), off, share))
            if best[:3] == (False, False, ""):
                return ""
            if not loader.fitted and off > limit:
                break  # from every eye alike
    is_off, is_hidden, mistake, off, share = best
    if is_off:
        return f"lies on no mesh: {off:.4f} longest sides away from the nearest"
    return f"{1 - share:.1%} of its points are hidden from every camera" if is_hidden else mistake


class Stub(types.ModuleType):
    """Stands for a module that has nothing to do with data: has every name, none of which is used."""

    __path__: list[str] = []  # noqa: RUF012  # a package, if need be

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return sys.modules.get(f"{self.__name__}.{name}") or type(name, (), {"__init__": lambda *_, **__: None})


def read_in_child(number: int, checkout: Path, data: Path, out: Path) -> None:
    """In a child, whose working folder has the loader's links: run the loader and keep its items."""
    loader = LOADERS[number]
    for name in loader.stubs:
        parts = name.split(".")
        for n in range(1, len(parts) + 1):
            if n == len(parts) or parts[0] not in REAL:
                sys.modules.setdefault(".".join(parts[:n]), Stub(".".join(parts[:n])))
    sys.path.insert(0, str(checkout))
    items = list(loader.read(checkout, data))
    out.write_bytes(pickle.dumps(items))


def items_of(number: int, checkout: Path, data: Path, work: Path) -> list[Item]:
    """Run a loader in a process of its own."""
    for name, place in LOADERS[number].links.items():
        link = work / name
        link.parent.mkdir(parents=True, exist_ok=True)
        link.symlink_to((data / place).resolve(), target_is_directory=True)
    out = work / "items.pickle"
    command = [sys.executable, Path(__file__).resolve(), "--child", number, checkout.resolve(), data.resolve(), out]
    done = subprocess.run([*map(str, command)], cwd=work, capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError((done.stderr.strip().splitlines() or ["no word"])[-1])
    return list(pickle.loads(out.read_bytes()))


def find_checkout(folder: Path, repository: str) -> tuple[Path, str] | None:
    """Return a repository's checkout and its commit."""
    names = (repository.replace("/", "+"), repository, repository.split("/")[1])
    path = next((folder / name for name in names if (folder / name).is_dir()), None)
    if path is None:
        return None
    done = subprocess.run(["git", "-C", path, "rev-parse", "--short=8", "HEAD"], capture_output=True, text=True)
    return path.resolve(), done.stdout.strip() or "?"


def some_of(items: Iterable[Item]) -> list[Item]:
    """Return items spread evenly over each split."""
    by_split: dict[str, list[Item]] = {}
    for item in items:
        by_split.setdefault(item.split, []).append(item)
    return [of[i] for of in by_split.values() for i in np.unique(np.linspace(0, len(of) - 1, CHECKED).astype(int))]


def check_loader(
    number: int, checkout: Path, folder: Path, surfaces: dict[str, list[Surface]]
) -> tuple[int, str, bool]:
    """Generate the loader's layout, run it, check its items; return how many it read, what came of it, if right."""
    loader = LOADERS[number]
    views, data = folder / "views.csv", folder / "dataset"
    write_views(views, loader.n_views)
    command = [sys.executable, "-m", "zbuf_occlude", "generate", folder.parent / loader.meshes, "--out", data]
    command += ["--format", loader.layout, "--views", views, "--method", "exact", *loader.options]
    made = subprocess.run([*map(str, command)], cwd=folder, capture_output=True, text=True)
    if made.returncode:
        return 0, f"generate: {made.stderr.strip().splitlines()[-1]}", False
    (folder / "work").mkdir()
    try:
        items = items_of(number, checkout, data, folder / "work")
    except RuntimeError as error:
        return 0, f"the loader stopped: {error}", False
    chosen = some_of(items)
    faults = [fault for item in chosen if (fault := check_item(item, loader, surfaces[loader.meshes]))]
    if faults or not items:
        return len(items), f"{len(faults)} of {len(chosen)} wrong: {faults[0] if faults else 'nothing read'}", False
    return len(items), f"{len(chosen)} of {len(chosen)} right", True


def main(folder: Path, *, only: str = "", keep: Path | None = None) -> int:
    with tempfile.TemporaryDirectory() as name:
        root = (keep or Path(name)).resolve()
        surfaces = {
            kind: [Surface(made) for made in make_meshes(kind, root / kind)] for kind in ("shapenet", "modelnet")
        }
        heads("repository", "commit", "class", "layout", "items read", "checks", "stubs", words=7)
        right = True
        for number, loader in enumerate(LOADERS):
            if only not in f"{loader.repository} {loader.name} {loader.layout}":
                continue
            found = find_checkout(folder, loader.repository)
            missing = [package for package in loader.packages if importlib.util.find_spec(package) is None]
            if found is None or missing:
                commit, n_items, said = "", 0, f"skipped: no {', '.join(missing) or 'checkout'}"
            else:
                (root / str(number)).mkdir()
                n_items, said, fine = check_loader(number, found[0], root / str(number), surfaces)
                commit, right = found[1], right and fine
            row(loader.repository, commit, loader.name, loader.layout, n_items, said, ", ".join(loader.stubs))
    return 0 if right else 1


if __name__ == "__main__":
    if sys.argv[1:2] == ["--child"]:
        read_in_child(int(sys.argv[2]), *map(Path, sys.argv[3:]))
    else:
        run(main, __doc__)
