"""Datasets for PyTorch: every cloud once an epoch whatever the workers, mixed, seeded; formats alike."""

import pickle
from collections import Counter
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="torch is not installed: pip install 'zbuf-occlude[learn]'")

from tests.scenes import box, sphere  # noqa: E402
from zbuf_occlude import DatasetError, OptionError  # noqa: E402
from zbuf_occlude.datasets.export import convert  # noqa: E402
from zbuf_occlude.datasets.generate import generate  # noqa: E402
from zbuf_occlude.datasets.plan import DatasetConfig, Plan  # noqa: E402
from zbuf_occlude.datasets.source import open_dataset  # noqa: E402
from zbuf_occlude.datasets.torch import CloudDataset, CloudStream, CompletionPairs, augmentation  # noqa: E402
from zbuf_occlude.meshes.collection import MeshCollection, MeshEntry  # noqa: E402

CONFIG = DatasetConfig(
    method="oracle", views="fibonacci:9", n_points=120, variations=3, sample_size=40, attributes=("normals", "colors")
)
N_TRAIN = 4 * 3 * 9


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """One dataset in two formats: 4 meshes to train, 2 to test, of two classes."""
    root = tmp_path_factory.mktemp("datasets")
    entries = [
        MeshEntry(f"{label}_{i}", label, "train" if i < 2 else "test", load)
        for i in range(3)
        for label, load in (("ball", lambda: sphere(6)), ("brick", box))
    ]
    generate(Plan(MeshCollection(entries), CONFIG, "packed"), root / "packed")
    convert(root / "packed", root / "hdf5", "hdf5")
    return {"packed": root / "packed", "hdf5": root / "hdf5"}


def epoch(dataset: Any, **options: Any) -> list[tuple[bytes, int]]:
    loader = torch.utils.data.DataLoader(dataset, batch_size=16, **options)
    batches = [zip(clouds, labels, strict=True) for clouds, labels in loader]
    return [(cloud.numpy().tobytes(), int(label)) for batch in batches for cloud, label in batch]


@pytest.fixture(scope="module")
def truth(folders: dict[str, Path]) -> Counter[tuple[bytes, int]]:
    source = open_dataset(folders["hdf5"])
    records = source.take(source.order["train"])
    return Counter((r["data"].tobytes(), int(r["label"][0])) for r in records)


@pytest.mark.parametrize("format", ["hdf5", "packed"])
@pytest.mark.parametrize("kind", [CloudDataset, CloudStream])
@pytest.mark.parametrize("n_workers", [0, 2])
def test_every_cloud_comes_once_an_epoch(
    folders: dict[str, Path], truth: Counter[tuple[bytes, int]], kind: Any, format: str, n_workers: int
) -> None:
    dataset = kind(folders[format], "train", **({"pool": 3} if kind is CloudStream else {}))
    assert len(dataset) == N_TRAIN
    assert dataset.classes == ["ball", "brick"]
    assert Counter(epoch(dataset, num_workers=n_workers)) == truth


@pytest.mark.parametrize("format", ["hdf5", "packed"])
def test_items_are_what_a_training_loop_takes(folders: dict[str, Path], format: str) -> None:
    whole = CloudDataset(folders[format], "test")
    dataset = CloudDataset(folders[format], "test", n_points=16)
    cloud, label = dataset[5]
    assert (cloud.shape, cloud.dtype, label.shape, label.dtype) == ((16, 3), torch.float32, (), torch.int64)
    assert torch.equal(cloud, whole[5][0][:16])


@pytest.mark.parametrize("kind", [CloudDataset, CloudStream])
def test_normals_and_colours_are_further_columns(folders: dict[str, Path], kind: Any) -> None:
    dataset = kind(folders["hdf5"], "test", n_points=16, attributes=("colors", "normals"))
    records = dataset.source.take(dataset.numbers)
    expected = {r["data"][:16].tobytes(): np.c_[r["normal"], r["color"] / 255].astype(np.float32)[:16] for r in records}
    for cloud, _ in list(dataset) if kind is CloudStream else [dataset[0], *dataset.__getitems__([1, 4])]:
        assert (cloud.shape, cloud.dtype) == ((16, 9), torch.float32)
        np.testing.assert_array_equal(cloud[:, 3:], expected[cloud[:, :3].contiguous().numpy().tobytes()])
    assert kind(folders["hdf5"], "test", attributes=("normals",)).sample(records[0])[0].shape == (40, 6)
    with pytest.raises(OptionError, match="attribute must be one of normals, colors; got 'rgb'"):
        kind(folders["hdf5"], "test", attributes=("rgb",))


@pytest.mark.parametrize("format", ["hdf5", "packed"])
def test_a_stream_mixes_classes_and_differs_from_epoch_to_epoch(folders: dict[str, Path], format: str) -> None:
    stream = CloudStream(folders[format], "train")
    torch.manual_seed(1)
    first, second = epoch(stream), epoch(stream)
    torch.manual_seed(1)
    assert epoch(CloudStream(folders[format], "train")) == first, "seeded by torch.manual_seed"
    assert first != second
    changes = sum(a[1] != b[1] for a, b in pairwise(first))
    assert changes > N_TRAIN / 4, "classes must be mixed"


def test_persistent_workers_shuffle_anew_too(folders: dict[str, Path]) -> None:
    loader = torch.utils.data.DataLoader(
        CloudStream(folders["packed"], "train"), batch_size=16, num_workers=1, persistent_workers=True
    )
    first, second = ([label for _, labels in loader for label in labels.tolist()] for _ in range(2))
    assert first != second


def test_spawned_workers_read_it_too(folders: dict[str, Path], truth: Counter[tuple[bytes, int]]) -> None:
    stream = CloudStream(folders["packed"], "train")
    assert Counter(epoch(stream, num_workers=1, multiprocessing_context="spawn")) == truth
    assert len(pickle.dumps(stream)) < 10_000, "no file, nothing unpacked travels"


def test_transforms_are_applied_and_workers_draw_differently(folders: dict[str, Path]) -> None:
    plain = CloudDataset(folders["hdf5"], "test")
    changed = CloudDataset(folders["hdf5"], "test", transform=augmentation())
    assert not torch.equal(plain[0][0], changed[0][0])
    assert not torch.equal(changed[0][0], changed[0][0])

    class Draw(torch.utils.data.Dataset):  # type: ignore[misc]  # torch is not typed here
        def __len__(self) -> int:
            return 4

        def __getitem__(self, index: int) -> Any:
            return augmentation()(torch.ones(1, 3))

    drawn = [tuple(batch.flatten().tolist()) for batch in torch.utils.data.DataLoader(Draw(), num_workers=2)]
    assert len(set(drawn)) == 4


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"split": "val"}, "split must be one of t.*, t.*; got 'val'"),
        ({"n_points": 41}, r"n_points must lie in 1\.\.40, the size of the clouds in .*; got 41"),
    ],
)
def test_errors(folders: dict[str, Path], arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(OptionError, match=message):
        CloudDataset(folders["hdf5"], **arguments)
    with pytest.raises(OptionError, match=message):
        CloudStream(folders["packed"], **arguments)


def test_a_pool_has_a_group_at_least(folders: dict[str, Path]) -> None:
    with pytest.raises(OptionError, match="pool must be at least 1; got 0"):
        CloudStream(folders["packed"], pool=0)


def test_rounding_aside_both_formats_give_the_same(folders: dict[str, Path]) -> None:
    for index in (0, 7, 50):
        one, two = (CloudDataset(folders[format], "train")[index] for format in ("hdf5", "packed"))
        assert np.array_equal(one[0], two[0])
        assert one[1] == two[1]


@pytest.mark.parametrize("n_workers", [0, 2])
def test_pairs_are_a_part_and_the_whole_in_one_frame(folders: dict[str, Path], n_workers: int) -> None:
    pairs = CompletionPairs(folders["packed"], "train", n_partial=30, n_complete=120)
    assert len(pairs) == N_TRAIN
    loader = torch.utils.data.DataLoader(pairs, batch_size=N_TRAIN, num_workers=n_workers)
    ((partial, complete, labels),) = loader
    assert partial.shape == (N_TRAIN, 30, 3)
    assert complete.shape == (N_TRAIN, 120, 3)
    assert Counter(labels.tolist()) == {0: N_TRAIN / 2, 1: N_TRAIN / 2}
    longest = np.ptp(complete.numpy(), axis=1).max(axis=1)  # 1 of the mesh, and of 120 of its points hardly less
    assert (longest > 0.9).all()
    assert (longest <= 1.0 + 1e-6).all()
    to_partial = torch.cdist(complete, partial).amin(dim=2)  # of the whole's points
    to_complete = torch.cdist(partial, complete).amin(dim=2)
    ids = pairs.source.ids()[pairs.numbers]
    assert to_complete[ids["variation"] == 0].max() < 1e-3  # 120 points are all that were sampled
    assert to_complete.max() < 0.35  # another sampling of the same surface
    assert (to_partial.amax(dim=1) > 0.4).all()  # what no camera sees is in the whole alone


def test_pairs_need_all_points_of_the_objects(folders: dict[str, Path]) -> None:
    with pytest.raises(DatasetError, match="packed"):
        CompletionPairs(folders["hdf5"])
    with pytest.raises(OptionError, match="n_complete"):
        CompletionPairs(folders["packed"], n_complete=0)
    with pytest.raises(OptionError, match="split"):
        CompletionPairs(folders["packed"], "val")
