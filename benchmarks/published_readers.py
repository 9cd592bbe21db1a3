"""How each published loader of `published_loaders.py` is called, and what its items are.

A reader runs with the loader's checkout first on `sys.path`, in a folder whose `data` is as the loader's own
configuration has it. It changes nothing of the loader's and computes nothing: it opens every split and yields items.
"""

import importlib.util
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray


class Item(NamedTuple):
    """What a loader gives: the split, the class's name, clouds (n, 3) or None, what it calls the object or None."""

    split: str
    label: str
    partial: NDArray[Any] | None
    complete: NDArray[Any] | None = None
    object: str | None = None


def _pointr(checkout: Path, config: str, splits: tuple[str, ...]) -> Iterator[tuple[str, Any]]:
    """Yield (split, item) of a dataset of PoinTr's registry by its own configuration."""
    from datasets import build_dataset_from_cfg
    from utils.config import cfg_from_yaml_file

    for split in splits:
        settings = cfg_from_yaml_file(str(checkout / "cfgs/dataset_configs" / config))
        settings.subset = split
        dataset = build_dataset_from_cfg(settings)
        yield from ((split, dataset[i]) for i in range(len(dataset)))


def _synsets(checkout: Path) -> dict[str, str]:
    """Return PoinTr's own names of the synsets."""
    names: dict[str, str] = json.loads((checkout / "data/shapenet_synset_dict.json").read_text())
    return names


def _pairs(checkout: Path, config: str, splits: tuple[str, ...]) -> Iterator[Item]:
    names = _synsets(checkout)
    for split, (taxonomy, model, (partial, complete)) in _pointr(checkout, config, splits):
        yield Item(split, names[taxonomy], _without_fill(partial), complete.numpy(), model)


def _without_fill(points: Any) -> NDArray[Any]:
    """Leave out the zeros with which loaders fill clouds of too few points."""
    cloud = np.asarray(points)
    return cloud[(cloud != 0).any(axis=1)]


def pointr_pcn(checkout: Path, data: Path) -> Iterator[Item]:
    """PoinTr's PCN."""
    return _pairs(checkout, "PCN.yaml", ("train", "val", "test"))


def pointr_projected(checkout: Path, data: Path) -> Iterator[Item]:
    """PoinTr's Projected_ShapeNet."""
    return _pairs(checkout, "Projected_ShapeNet-55_noise.yaml", ("train", "test"))


def pointr_completion3d(checkout: Path, data: Path) -> Iterator[Item]:
    """PoinTr's Completion3D."""
    names = _synsets(checkout)
    for split, (taxonomy, model, found) in _pointr(checkout, "Completion3D.yaml", ("train", "val", "test")):
        partial, complete = (found, None) if split == "test" else found
        yield Item(split, names[taxonomy], partial, complete, model)


def pointr_shapenet(checkout: Path, data: Path) -> Iterator[Item]:
    """PoinTr's ShapeNet: complete clouds alone, which it centres and scales."""
    names = _synsets(checkout)
    for split, (taxonomy, model, complete) in _pointr(checkout, "ShapeNet-55.yaml", ("train", "test")):
        yield Item(split, names[taxonomy], None, complete.numpy(), model)


MVP = (
    "airplane", "cabinet", "car", "chair", "lamp", "sofa", "table", "watercraft", "bed", "bench", "bookshelf", "bus",
    "guitar", "motorbike", "pistol", "skateboard",
)  # fmt: skip
"""`cat_name` of VRCNet's test.py."""


def mvp_cp(checkout: Path, data: Path) -> Iterator[Item]:
    """MVP_Benchmark's MVP_CP; its "val" reads MVP_Test_CP.h5."""
    dataset = import_file(checkout / "completion" / "dataset.py")
    for prefix, split in (("train", "train"), ("val", "test")):
        yield from _of_mvp(dataset.MVP_CP(prefix), split)


def vrcnet(checkout: Path, data: Path) -> Iterator[Item]:
    """VRCNet's ShapeNetH5, novel classes too, as by default."""
    dataset = import_file(checkout / "dataset.py")
    for train in (True, False):
        yield from _of_mvp(dataset.ShapeNetH5(train=train), "train" if train else "test")


def _of_mvp(dataset: Any, split: str) -> Iterator[Item]:
    for label, partial, complete in map(dataset.__getitem__, range(len(dataset))):
        yield Item(split, MVP[int(label)], partial.numpy(), complete.numpy())


def completion3d(checkout: Path, data: Path) -> Iterator[Item]:
    """ShapenetDataProcess of lynetcha/completion3d, in this process, as its main.py sets it up, without augmentation.

    Of test it gives the partial cloud for the complete one.
    """
    from argparse import Namespace

    shapenet = import_file(checkout / "shared" / "datasets" / "shapenet.py")
    for split in ("train", "val", "test"):
        args = Namespace(dataset="shapenet", batch_size=1, inpts=2048)
        args.pc_augm_scale = args.pc_augm_rot = args.pc_augm_mirror_prob = args.pc_augm_jitter = 0
        process = shapenet.ShapenetDataProcess(None, args, split=split, repeat=False)
        for path in process.data_paths:
            complete, (meta, partial) = process.collate([process.load_data(path)])
            taxonomy, model = meta[0].removesuffix(".h5.0").split("/")
            yield Item(split, args.classmap[taxonomy], partial[0].T, None if split == "test" else complete[0], model)


def import_file(path: Path) -> Any:
    """Import a module by its place, whatever else has its name."""
    spec = importlib.util.spec_from_file_location(f"published_{path.stem}", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
