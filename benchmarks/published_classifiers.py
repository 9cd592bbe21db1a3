"""How the loaders of `published_loaders.py` that read classification sets are called; see `published_readers.py`."""

import os
import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from published_readers import Item

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
