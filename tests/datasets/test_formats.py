"""Every format through one door: written from a source and read as one, nothing lost; shards, names, same bytes."""

from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from tests.scenes import box
from zbuf_occlude import OptionError
from zbuf_occlude.datasets.formats import FORMATS, Format, find_format
from zbuf_occlude.datasets.plan import DatasetConfig, Numbers, Plan
from zbuf_occlude.datasets.records import point_fields, record_type
from zbuf_occlude.datasets.source import CloudReader
from zbuf_occlude.meshes.collection import MeshCollection, MeshEntry
from zbuf_occlude.sensors import make
from zbuf_occlude.sensors.scan_config import ScanConfig

SIZE = 6
SIZES = (3, 1, 40, 7, 2, 9, 4, 1, 12, 5, 6)
"""Points of the clouds where they are of unequal size."""
DRAWN = [row for row in FORMATS if not (row.exported_from or row.keeps_points)]
ids = [row.name for row in DRAWN]


SCAN = ScanConfig(make("vlp-16"), keep_clean=True)


def plan(config: DatasetConfig) -> Plan:
    entries = [
        MeshEntry(f"{label}/{split}/a b.{i}.off", label, split, box)
        for i, (label, split) in enumerate([("bed", "train"), ("arm chair", "test"), ("bed", "test")])
    ]
    return Plan(MeshCollection(entries), config)


def random_records(config: DatasetConfig) -> np.ndarray:
    """Records of every field filled with values that a careless format would change."""
    rng, n = np.random.default_rng(5), len(SIZES)
    records = np.zeros(n, record_type(config))

    def values(kind: np.dtype, shape: tuple[int, ...]) -> np.ndarray:
        found = rng.normal(scale=1e6, size=shape) if kind.kind == "f" else rng.integers(-1, 2**31 - 1, shape)
        return found.astype(kind)

    for name in records.dtype.names or ():
        if records.dtype[name].hasobject:
            kind, shape = point_fields(config)[name]
            records[name] = [values(np.dtype(kind), (size, *shape)) for size in SIZES]
        else:
            records[name] = values(records[name].dtype, records[name].shape)
    records["mesh_id"] = np.arange(n) % 3
    records["label"][:, 0] = [[1, 0, 1][i % 3] for i in range(n)]
    records["variation"], records["view_id"] = np.arange(n) // 6, np.arange(n) // 3 % 2
    return records


def equal(a: np.ndarray, b: np.ndarray) -> bool:
    """Whether records are the same, bit for bit, types too."""
    if a.dtype != b.dtype or len(a) != len(b):
        return False
    for name in a.dtype.names or ():
        for x, y in zip(a[name], b[name], strict=True):
            if np.asarray(x).dtype != np.asarray(y).dtype or not np.array_equal(x, y):
                return False
    return True


@pytest.fixture(
    params=[(None, SIZE), (SCAN, SIZE), (None, None), (SCAN, None)],
    ids=["surface", "scans", "ragged surface", "ragged scans"],
)
def source(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> CloudReader:
    """Eleven of the plan's twelve clouds, of which each file takes three."""
    monkeypatch.setattr("zbuf_occlude.datasets.plan.CLOUDS_PER_FILE", 3)
    scan, size = request.param
    config = DatasetConfig(views="ring:2@10", variations=2, sample_size=size, scan=scan)
    records = random_records(config)
    numbers: Numbers = np.random.default_rng(1).permutation(11)
    train = numbers[records["mesh_id"][numbers] == 0]
    test = numbers[records["mesh_id"][numbers] != 0]
    return CloudReader(plan(config), {"train": train, "test": test}, lambda wanted: records[wanted])


def write(row: Format, source: CloudReader, out: Path) -> dict[str, list[str]]:
    """Write all clouds of a source; return the names of the files of each split."""
    plan, module = replace(source.plan, format=row.name), row.load()
    names: dict[str, list[str]] = {split: [] for split in source.order}
    for split in source.order:
        for number, numbers in source.files(split):
            names[split].append(module.file_name(split, number))
            module.write(out / names[split][-1], source.take(numbers), plan, number)
    row.finish(out, plan, names)
    return names


def content(source: CloudReader) -> dict[str, np.ndarray]:
    return {split: source.take(numbers) for split, numbers in source.order.items()}


@pytest.mark.parametrize("row", DRAWN, ids=ids)
def test_round_trip(row: Format, source: CloudReader, tmp_path: Path) -> None:
    before = content(source)
    files = write(row, source, tmp_path)
    back = row.load().read(tmp_path, source.plan, files)
    assert back.n_clouds == {"train": 4, "test": 7}
    for split, records in content(back).items():
        assert equal(records, before[split]), split
    some = back.order["test"][[5, 0, 5, 2]]
    assert equal(back.take(some), before["test"][[5, 0, 5, 2]])
    assert all(equal(after, before[split]) for split, after in content(source).items()), "input changed"


@pytest.mark.parametrize("row", DRAWN, ids=ids)
def test_same_clouds_same_bytes_and_the_names_that_were_said(row: Format, source: CloudReader, tmp_path: Path) -> None:
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        write(row, source, tmp_path / name)
    written = sorted(path.relative_to(tmp_path / "one") for path in (tmp_path / "one").rglob("*") if path.is_file())
    for path in written:
        assert (tmp_path / "one" / path).read_bytes() == (tmp_path / "two" / path).read_bytes(), path
    names = {Path(name) for name in row.names(source.plan)}
    assert names == {path for path in written if not path.name.endswith("_files.txt")}, "--overwrite removes these"


def test_webdataset_reads_the_shards(source: CloudReader, tmp_path: Path) -> None:
    wds = pytest.importorskip("webdataset", reason="the package webdataset is not installed")
    files = write(find_format("webdataset"), source, tmp_path)
    assert files["test"] == ["test-000000.tar", "test-000001.tar", "test-000002.tar"]
    samples = list(wds.WebDataset(str(tmp_path / "test-{000000..000002}.tar"), shardshuffle=False).decode())
    before = content(source)["test"]
    assert [sample["cls"] for sample in samples] == before["label"][:, 0].tolist()
    for sample, record in zip(samples, before, strict=True):
        assert np.array_equal(sample["data.npy"], record["data"])
        assert np.array_equal(sample["face_ids.npy"], record["face_ids"])
        assert sample["json"]["class"] == ["arm chair", "bed"][int(record["label"][0])]
        assert np.array_equal(sample["json"]["pose"], record["pose"])


def test_numpy_reads_the_npz_and_h5py_the_hdf5(source: CloudReader, tmp_path: Path) -> None:
    before = content(source)["test"]
    write(find_format("npz"), source, tmp_path)
    with np.load(tmp_path / "test-000002.npz") as archive:
        assert np.array_equal(archive["data"].reshape(-1, 3), np.concatenate(before["data"][6:]))
    write(find_format("hdf5"), source, tmp_path)
    with h5py.File(tmp_path / "ply_data_test1.h5") as h5:
        assert np.array_equal(h5["data"][()].reshape(-1, 3), np.concatenate(before["data"][3:6]))
        assert h5.attrs["fingerprint"] == source.plan.fingerprint


def test_an_unknown_format_says_which_there_are() -> None:
    with pytest.raises(OptionError, match=r"format must be one of hdf5, packed, webdataset, npz, ply, .*; got 'csv'"):
        find_format("csv")
