"""Damaged datasets: whatever its reader says, the error names the file, what is wrong and what to do."""

import json
import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest

from zbuf_occlude.base.atomic import DAMAGES, reading
from zbuf_occlude.base.errors import DatasetError
from zbuf_occlude.datasets.folder import checksums, read_manifest
from zbuf_occlude.datasets.formats import FORMATS
from zbuf_occlude.datasets.generate import generate
from zbuf_occlude.datasets.plan import DatasetConfig, Plan
from zbuf_occlude.datasets.source import open_dataset
from zbuf_occlude.datasets.verify import verify
from zbuf_occlude.meshes import shapes

SUFFIXES = (".h5", ".zip", ".tar", ".npz")
CLASSES = ("bed", "table")
"""Which every format has."""
CONFIG = DatasetConfig(method="oracle", views="ring:2@30", n_points=100, sample_size=8)


@pytest.fixture(scope="module", params=[row.name for row in FORMATS if not row.exported_from])
def whole(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small dataset in each format."""
    folder = tmp_path_factory.mktemp("datasets") / "clouds"
    meshes = shapes.collection(n_members=16 // len(CLASSES)).select(classes=CLASSES)
    generate(Plan(meshes, CONFIG, request.param), folder)
    return folder


@pytest.fixture
def dataset(whole: Path, tmp_path: Path) -> Path:
    """A copy, to be damaged."""
    return Path(shutil.copytree(whole, tmp_path / "clouds"))


def data_files(dataset: Path) -> list[Path]:
    found = sorted(path for path in dataset.rglob("*") if path.suffix in SUFFIXES)
    assert found
    return found


def read_all(dataset: Path) -> int:
    source = open_dataset(dataset)
    return sum(len(records) for split in source.order for records in source.batches(split))


def test_cut_emptied_overwritten_or_missing_files_are_named(dataset: Path) -> None:
    n_clouds = read_all(dataset)
    assert n_clouds == 32
    for path in data_files(dataset)[-3:]:
        content = path.read_bytes()
        for damaged in (content[: len(content) // 2 - 100], b"", b"\x07" * len(content), None):
            if damaged is None:
                path.unlink()
            else:
                path.write_bytes(damaged)
            with pytest.raises(DatasetError, match=r" must .*; it .*\. Copy it again from where it was made") as caught:
                read_all(dataset)
            assert str(path) in str(caught.value)
        path.write_bytes(content)
    assert read_all(dataset) == n_clouds


def test_bytes_changed_by_chance_give_clouds_or_an_error_in_words(dataset: Path) -> None:
    rng = np.random.default_rng(3)
    n_errors = 0
    for path in data_files(dataset)[-2:]:
        content = path.read_bytes()
        for _ in range(60):
            changed = np.frombuffer(content, np.uint8).copy()
            # where the structure is: the first and last bytes, and some anywhere
            places = rng.integers(0, len(changed), 3)
            places[:2] %= min(1024, len(changed))
            places[1] = len(changed) - 1 - places[1]
            changed[places] = rng.integers(0, 256, 3)
            path.write_bytes(changed.tobytes())
            try:
                read_all(dataset)
            except DatasetError:
                n_errors += 1
        path.write_bytes(content)
    assert n_errors > 0


def test_a_tar_cut_between_two_members_is_not_read_as_a_shorter_one(tmp_path: Path) -> None:
    generate(Plan(shapes.collection(n_members=2), CONFIG, "webdataset"), tmp_path)
    path = next(tmp_path.glob("train-*.tar"))
    content = path.read_bytes()
    last = content.rindex(b".face_ids.npy") - 9  # where the header of the last member begins
    assert last % 512 == 0
    path.write_bytes(content[:last])
    with pytest.raises(DatasetError, match=r"train-000000\.tar must be as .* members for "):
        read_all(tmp_path)


@pytest.mark.parametrize(("field", "n"), [("label", 8), ("mesh_id", 16)])
def test_indices_that_the_plan_does_not_have(tmp_path: Path, field: str, n: int) -> None:
    generate(Plan(shapes.collection(n_members=2), CONFIG, "hdf5"), tmp_path)
    path = next(tmp_path.glob("ply_data_*.h5"))
    with h5py.File(path, "a") as file:
        file[field][0] = n
    with pytest.raises(DatasetError, match=rf"{path.name} must be as .* \({field} {n}, where there are {n}\)"):
        read_all(tmp_path)


def test_verify_tells_a_file_that_cannot_be_read_though_its_checksum_is_right(dataset: Path) -> None:
    path = data_files(dataset)[0]
    path.write_bytes(b"\xff\x00" * 20)
    manifest = json.loads((dataset / "manifest.json").read_text())
    manifest["sha256"] = checksums(dataset, manifest["sha256"])
    (dataset / "manifest.json").write_text(json.dumps(manifest))
    (fault,) = verify(dataset, None).faults
    assert path.name in fault


def test_a_manifest_that_lacks_anything_that_is_read_of_it(tmp_path: Path) -> None:
    generate(Plan(shapes.collection(n_members=1), CONFIG, "npz"), tmp_path)
    path = tmp_path / "manifest.json"
    good = json.loads(path.read_text())
    said = r"manifest\.json must be as it was written; it cannot be read \({}\)\. Copy it again"
    for key in ("classes", "counts", "error", "failures", "files", "format", "options", "renderer", "seed", "sha256"):
        path.write_text(json.dumps({name: value for name, value in good.items() if name != key}))
        with pytest.raises(DatasetError, match=said.format(f"no '{key}'")):
            read_manifest(tmp_path)
    for key, value, reason in (
        ("counts", {}, "no 'clouds'"),
        ("counts", [], "counts is no object"),
        ("error", {name: value for name, value in good["error"].items() if name != "worst_view"}, "no 'worst_view'"),
        ("cut_by_range", 1, "cut_by_range is 1"),
        ("seed", "one", 'seed is "one"'),
        ("files", {}, "it names no files"),
        ("files", {"train": []}, "it names no files"),
        ("files", {"train": ["a.npz"]}, "no 'a.npz'"),
        ("sha256", dict.fromkeys(good["sha256"]), "sha256 is null"),
    ):
        path.write_text(json.dumps({**good, key: value}))
        with pytest.raises(DatasetError, match=said.format(reason)):
            read_manifest(tmp_path)
    path.write_text(json.dumps(good))
    assert read_manifest(tmp_path) == good


def test_what_was_said_already_and_what_is_no_damage_pass(tmp_path: Path) -> None:
    for error in (DatasetError("said"), KeyboardInterrupt(), MemoryError()):
        with pytest.raises(type(error)) as caught, reading(tmp_path):
            raise error
        assert caught.value is error
    assert not any(issubclass(error, DAMAGES) for error in (MemoryError, KeyboardInterrupt, AssertionError))
