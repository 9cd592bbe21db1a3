"""How each published loader of `published_loaders.py` is called, and what its items are.

A reader runs with the loader's checkout first on `sys.path`, in a folder whose `data` is as the loader's own
configuration has it. It changes nothing of the loader's and computes nothing: it opens every split and yields items.
"""

import importlib.util
import json
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
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


def p2c_epn3d(checkout: Path, data: Path) -> Iterator[Item]:
    """Partial2Complete's EPN3D, of all classes; its configuration names one."""
    from datasets import build_dataset_from_cfg
    from utils.config import cfg_from_yaml_file

    for split in ("train", "test"):
        settings = cfg_from_yaml_file(str(checkout / "cfgs/dataset_configs/EPN3D.yaml"))
        settings.subset, settings.class_choice = split, ["airplane", "chair", "table"]
        dataset = build_dataset_from_cfg(settings)
        names = {row["taxonomy_id"]: row["taxonomy_name"] for row in dataset.dataset_categories}
        for taxonomy, model, clouds in map(dataset.__getitem__, range(len(dataset))):
            partial, complete = clouds[:2]
            yield Item(split, names[taxonomy], _without_fill(partial), complete.numpy(), model)


def mvp_rg(checkout: Path, data: Path) -> Iterator[Item]:
    """MVP_Benchmark's MVP_RG, pairs for registration; its "val" reads MVP_Test_RG.h5.

    It moves the clouds of train at random, so theirs are taken before. Those of "val" were moved: the source by the
    file's pose, the target by the loader's transform after it; both are moved back.
    """
    import h5py

    dataset = import_file(checkout / "registration" / "dataset.py")
    names = (data / "shape_names.txt").read_text().split()
    options = SimpleNamespace(max_angle=45, max_trans=0.5, category=None)
    train, test = dataset.MVP_RG("train", options), dataset.MVP_RG("val", options)
    for label, *clouds, _ in zip(
        train.label, train.src, train.tgt, map(train.__getitem__, range(len(train))), strict=True
    ):
        yield from (Item("train", names[label], cloud) for cloud in clouds)
    with h5py.File(data / "MVP_Test_RG.h5") as file:
        poses = file["pose_src"][()]
    for i, pose in enumerate(poses):
        source, target, transform, *_ = test[i]
        for cloud, moved in ((source, pose), (target, transform.numpy() @ pose)):
            yield Item("test", names[test.label[i]], (cloud.numpy() - moved[:3, 3]) @ moved[:3, :3])


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


# ---- classification --------------------------------------------------------------------------------------------------

PARTS = {"train": "training", "test": "test"}
SCANOBJECTNN = (
    "bag", "bin", "box", "cabinet", "chair", "desk", "display", "door", "shelf", "table", "bed", "pillow", "sink",
    "sofa", "toilet",
)  # fmt: skip
"""training_data/shape_names_ext.txt of hkust-vgd/scanobjectnn."""


def _beside_data(checkout: Path, file: str) -> None:
    """Link a file into the working folder, from which it looks for its data; downloads are not tried."""
    Path(Path(file).name).symlink_to(checkout / file)
    sys.path.insert(0, os.getcwd())
    os.system = lambda command: 1  # type: ignore[assignment]


def _modelnet40(checkout: Path) -> list[str]:
    """Return ModelNet40-C's own list of classes."""
    sys.path.insert(0, str(checkout / "data"))
    from process import SHAPE

    return list(SHAPE)


def modelnet40_c(checkout: Path, data: Path, corruption: str = "occlusion") -> Iterator[Item]:
    """ModelNet40-C's test set at each level."""
    from dataloader import ModelNet40C

    names = _modelnet40(checkout)
    for path in sorted(data.glob(f"data_{corruption}_*.npy")):
        dataset = ModelNet40C("test", "./data/modelnet40_c/", corruption, int(path.stem.split("_")[-1]))
        for i in range(len(dataset)):
            yield Item("test", names[dataset[i]["label"]], dataset[i]["pc"])


def modelnet40_c_lidar(checkout: Path, data: Path) -> Iterator[Item]:
    """The same, of the corruption lidar."""
    return modelnet40_c(checkout, data, "lidar")


def pointmls_modelnet_o(checkout: Path, data: Path) -> Iterator[Item]:
    """PointMLS's ModelNet-O, as its main.py opens it."""
    sys.path.insert(0, str(checkout / "ModelNet"))
    from ModelNet import ModelNet_O

    for split in ("train", "test"):
        dataset = ModelNet_O(f"data/ModelNet_O/*/{split}", 2048)
        for i, path in enumerate(dataset.filepaths):
            points, label = dataset[i]
            yield Item(split, dataset.classnames[label], points, object=Path(path).stem[:-4])


def pointmls_modelnet40(checkout: Path, data: Path) -> Iterator[Item]:
    """PointMLS's ModelNet40, which stretches and moves what it trains with."""
    _beside_data(checkout, "ModelNet/ModelNet.py")
    from ModelNet import ModelNet40

    names = (data / "shape_names.txt").read_text().splitlines()
    for split in ("train", "test"):
        dataset = ModelNet40(2048, split)
        for points, label in (dataset[i] for i in range(len(dataset))):
            yield Item(split, names[label[0]], points)


def pointmls_scanobjectnn(checkout: Path, data: Path) -> Iterator[Item]:
    """PointMLS's ScanObjectNN, which stretches and moves what it trains with."""
    _beside_data(checkout, "ScanObjectNN/ScanObjectNN.py")
    from ScanObjectNN import ScanObjectNN

    for split, part in PARTS.items():
        dataset = ScanObjectNN(2048, part)
        for points, label in (dataset[i] for i in range(len(dataset))):
            yield Item(split, SCANOBJECTNN[label], points)


def scanobjectnn_masks(checkout: Path, data: Path) -> Iterator[Item]:
    """ScanObjectNN's own functions: the points that its binary mask says are the object's."""
    import data_utils

    for split, part in PARTS.items():
        path = data / f"{part}_objectdataset_augmentedrot_scale75.h5"
        clouds, labels, masks = data_utils.load_withmask_h5(str(path))
        masks = data_utils.convert_to_binary_mask(masks)
        for cloud, label, mask in zip(clouds, labels, masks, strict=True):
            if mask.all() or cloud[mask == 0][:, 1].max() > cloud[mask == 1][:, 1].min() + 1e-3:
                raise ValueError("the background is the ground, below the object")
            yield Item(split, SCANOBJECTNN[label], cloud[mask == 1])


def _openpoints(checkout: Path) -> Any:
    """Make OpenPoints importable by its name; return its transform to tensors."""
    Path("openpoints").symlink_to(checkout)
    sys.path.insert(0, os.getcwd())
    from openpoints.transforms import PointsToTensor

    return PointsToTensor()


def openpoints_scanobjectnn(checkout: Path, data: Path) -> Iterator[Item]:
    """OpenPoints' ScanObjectNN, without its farthest points on the GPU; its heights are above the lowest point."""
    to_tensors = _openpoints(checkout)
    from openpoints.dataset.scanobjectnn.scanobjectnn import ScanObjectNNHardest

    for split in ("train", "test"):
        dataset = ScanObjectNNHardest(str(data), split, uniform_sample=False, transform=to_tensors)
        for item in (dataset[i] for i in range(len(dataset))):
            cloud = np.asarray(item["pos"])
            if not np.allclose(item["x"][:, 3], cloud[:, 1] - cloud[:, 1].min()):
                raise ValueError("the height is along y")
            yield Item(split, dataset.classes[int(item["y"])], cloud)


def openpoints_modelnet(checkout: Path, data: Path) -> Iterator[Item]:
    """OpenPoints' ModelNet40 of text files."""
    to_tensors = _openpoints(checkout)
    from openpoints.dataset.modelnet.modelnet40_normal_resampled_loader import ModelNet

    for split in ("train", "test"):
        dataset = ModelNet("data", 1024, 40, use_normals=True, split=split, transform=to_tensors)
        for item in (dataset[i] for i in range(len(dataset))):
            yield Item(split, dataset.cat[int(item["y"])], np.asarray(item["pos"]))


def pointnet2_modelnet(checkout: Path, data: Path) -> Iterator[Item]:
    """Pointnet2_pytorch's ModelNet40 of text files, as its train_classification.py opens it; it scales each cloud."""
    from data_utils.ModelNetDataLoader import ModelNetDataLoader

    args = SimpleNamespace(num_point=1024, use_uniform_sample=False, use_normals=True, num_category=40)
    for split in ("train", "test"):
        dataset = ModelNetDataLoader("data/modelnet40_normal_resampled/", args, split)
        for points, label in (dataset[i] for i in range(len(dataset))):
            yield Item(split, dataset.cat[label], points[:, :3])


def pointnet_provider(checkout: Path, data: Path) -> Iterator[Item]:
    """PointNet's provider, in the dataset's folder, to which the lists' names are relative."""
    _beside_data(checkout, "provider.py")
    import provider

    os.chdir(data)
    names = (data / "shape_names.txt").read_text().splitlines()
    for split in ("train", "test"):
        for path in provider.getDataFiles(f"{split}_files.txt"):
            for points, label in zip(*provider.loadDataFile(path), strict=True):
                yield Item(split, names[label[0]], points)


def rpmnet_modelnet(checkout: Path, data: Path) -> Iterator[Item]:
    """RPMNet's ModelNetHdf, whose transforms crop pairs of these clouds."""
    sys.path.insert(0, str(checkout / "src"))
    from data_loader.datasets import ModelNetHdf

    for split in ("train", "test"):
        dataset = ModelNetHdf(str(data), split)
        for i in range(len(dataset)):
            yield Item(split, dataset.classes[int(dataset[i]["label"])], dataset[i]["points"][:, :3])


def import_file(path: Path) -> Any:
    """Import a module by its place, whatever else has its name."""
    spec = importlib.util.spec_from_file_location(f"published_{path.stem}", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
