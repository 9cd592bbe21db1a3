"""Clouds of unequal size: archives, convert, verify, PyTorch; formats that cannot hold them refuse."""

import io
import json
import shutil
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from tests.datasets.test_formats import equal
from tests.scenes import box, sphere
from zbuf_occlude import DatasetError, OptionError
from zbuf_occlude.datasets.export import convert
from zbuf_occlude.datasets.folder import sha256_of
from zbuf_occlude.datasets.formats import FORMATS, Format
from zbuf_occlude.datasets.generate import generate
from zbuf_occlude.datasets.plan import DatasetConfig, Plan
from zbuf_occlude.datasets.records import read_archive, to_arrays
from zbuf_occlude.datasets.source import open_dataset
from zbuf_occlude.datasets.verify import verify
from zbuf_occlude.meshes.collection import MeshCollection, MeshEntry

CONVERTED = [row.name for row in FORMATS if row.ragged and not row.exported_from and row.name not in ("hdf5", "packed")]
ENTRIES = [MeshEntry(f"{n}/{s}/{i}", n, s, m) for i, s in enumerate(("train", "test")) for n, m in
           (("chair", lambda: sphere(8)), ("table", box))]  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same dataset in hdf5 and packed."""
    root = tmp_path_factory.mktemp("ragged")
    config = DatasetConfig(
        method="oracle", views="fibonacci:5", n_points=300, variations=2, sample_size=None, scale="mesh"
    )
    for format in ("hdf5", "packed"):
        generate(Plan(MeshCollection(ENTRIES), config, format), root / format)
    return root


def test_archives_are_read_back(folder: Path) -> None:
    source = open_dataset(folder / "hdf5")
    records = source.take(source.order["train"])
    for some in (records, records[:0]):
        file = io.BytesIO()
        np.savez(file, **to_arrays(some, source.plan.config))
        assert equal(read_archive(io.BytesIO(file.getvalue()), source.plan.config), some)


@pytest.mark.parametrize(
    "spoil", [lambda o: o + 1, lambda o: o[::-1].copy(), lambda o: o[:-1]], ids=["shifted", "backwards", "short"]
)
def test_offsets_that_do_not_fit_are_named(
    folder: Path, tmp_path: Path, spoil: Callable[[np.ndarray], np.ndarray]
) -> None:
    out = shutil.copytree(folder / "hdf5", tmp_path / "copy")
    with h5py.File(out / "ply_data_train0.h5", "a") as h5:
        offsets = spoil(h5["offsets"][:])
        del h5["offsets"]
        h5["offsets"] = offsets
    source = open_dataset(out)
    with pytest.raises(DatasetError, match=r"ply_data_train0\.h5 must be .*offsets do not fit the points"):
        source.take(source.order["train"])


def test_a_dataset_has_every_visible_point(folder: Path) -> None:
    source = open_dataset(folder / "hdf5")
    for numbers in source.order.values():
        for record in source.take(numbers):
            assert len(record["data"]) == len(record["face_ids"]) == record["n_visible"]
            assert len(np.unique(record["data"], axis=0)) == record["n_visible"], "none twice"
            assert record["visible_fraction"] == pytest.approx(record["n_visible"] / 300)
    packed = open_dataset(folder / "packed")
    for split, numbers in source.order.items():
        for one, other in zip(source.take(numbers), packed.take(packed.order[split]), strict=True):
            assert np.array_equal(one["face_ids"], other["face_ids"])
            assert np.abs(one["data"] - other["data"]).max() < 1e-3


@pytest.mark.parametrize("format", CONVERTED)
def test_converted_and_verified(folder: Path, tmp_path: Path, format: str) -> None:
    manifest = convert(folder / "hdf5", tmp_path / format, format)
    assert manifest["options"]["sample_size"] is None
    one, other = open_dataset(folder / "hdf5"), open_dataset(tmp_path / format)
    for split in one.order:
        assert equal(one.take(one.order[split]), other.take(other.order[split]))
    verdict = verify(tmp_path / format, MeshCollection(ENTRIES))
    assert verdict.faults == []
    assert verdict.n_checked > 500
    assert (tmp_path / format / "contact_sheet.png").stat().st_size > 1000


def test_verify_finds_what_is_not_finite(folder: Path, tmp_path: Path) -> None:
    out = Path(shutil.copytree(folder / "hdf5", tmp_path / "copy"))
    manifest = json.loads((out / "manifest.json").read_text())
    with h5py.File(out / "ply_data_test0.h5", "a") as h5:
        h5["data"][7, 1] = np.nan
    manifest["sha256"]["ply_data_test0.h5"] = sha256_of(out / "ply_data_test0.h5")
    (out / "manifest.json").write_text(json.dumps(manifest))
    assert verify(out, None).faults == ["all positions must be finite; some of split test are not."]


def test_huggingface_reads_it(folder: Path, tmp_path: Path) -> None:
    datasets = pytest.importorskip("datasets", reason="the package datasets is not installed")
    convert(folder / "hdf5", tmp_path / "card", "huggingface")
    loaded = datasets.load_dataset(str(tmp_path / "card"), cache_dir=str(tmp_path / "cache"), split="test")
    source = open_dataset(folder / "hdf5")
    for row, record in zip(loaded.with_format("numpy"), source.take(source.order["test"]), strict=True):
        assert np.array_equal(np.stack(row["points"]), record["data"])


def test_pytorch(folder: Path) -> None:
    torch = pytest.importorskip("torch", reason="torch is not installed: pip install 'zbuf-occlude[learn]'")
    from zbuf_occlude.datasets.torch import CloudDataset, CloudStream, collate_ragged
    from zbuf_occlude.studies.learn.data import load_clouds

    for format in ("hdf5", "packed"):
        dataset = CloudDataset(folder / format, "train")
        sizes = [len(cloud) for cloud, _ in dataset]
        assert len(set(sizes)) > 2
        loader = torch.utils.data.DataLoader(dataset, batch_size=7, collate_fn=collate_ragged)
        batches = list(loader)
        assert torch.cat([offsets.diff() for _, offsets, _ in batches]).tolist() == sizes
        points, offsets, labels = batches[0]
        assert points.shape == (offsets[-1], 3)
        assert labels.tolist() == [int(label) for _, label in (dataset[i] for i in range(7))]
        assert torch.equal(points[offsets[2] : offsets[3]], dataset[2][0])
        assert {len(cloud) for cloud, _ in CloudStream(folder / format, "train")} == set(sizes)
        equal_ones = CloudDataset(folder / format, "train", n_points=500)
        assert equal_ones[0][0].shape == (500, 3)
        assert torch.equal(equal_ones[0][0][: sizes[0]], dataset[0][0])
        assert torch.equal(equal_ones[0][0][sizes[0]], dataset[0][0][0])
        with pytest.raises(OptionError, match="n_points must be at least 1; got 0"):
            CloudDataset(folder / format, n_points=0)
    assert load_clouds(folder / "hdf5", "train", 64).n_points == 64
    with pytest.raises(DatasetError, match=r"are not \(--sample-size all\). .* n_points"):
        load_clouds(folder / "hdf5", "train")


@pytest.mark.parametrize("row", [row for row in FORMATS if not row.ragged], ids=lambda row: row.name)
def test_other_formats_refuse(row: Format, tmp_path: Path, folder: Path) -> None:
    plan = Plan(MeshCollection(ENTRIES), DatasetConfig(sample_size=None), row.name)
    words = f"--format {row.name} holds clouds of one size; got --sample-size all"
    with pytest.raises(OptionError, match=words):
        row.check(plan)
    if not (row.keeps_points or row.complete or row.from_meshes):
        with pytest.raises(OptionError, match=words):
            convert(folder / "hdf5", tmp_path / "other", row.name)
        assert not (tmp_path / "other").exists()
