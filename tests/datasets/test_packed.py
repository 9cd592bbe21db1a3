"""Packed: the coding, the archive, the reader, and that it gives back what was computed, rounded to the stated step."""

import gc
import json
import multiprocessing
import os
import pickle
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from tests.scenes import box, sphere
from zbuf_occlude import DatasetError, Mesh, OptionError, prepare
from zbuf_occlude.base.provenance import seed_of
from zbuf_occlude.datasets.export import convert
from zbuf_occlude.datasets.generate import generate
from zbuf_occlude.datasets.packed import (
    PackedDataset,
    Quantizer,
    pack_integers,
    pack_mask,
    unpack_integers,
    unpack_mask,
)
from zbuf_occlude.datasets.pipeline import sample
from zbuf_occlude.datasets.plan import DatasetConfig, Plan
from zbuf_occlude.datasets.source import open_dataset
from zbuf_occlude.meshes.collection import MeshCollection, MeshEntry

CONFIG = DatasetConfig(method="oracle", views="fibonacci:7", n_points=301, variations=2, sample_size=50)


def ball() -> Mesh:
    return sphere(6).transformed(30.0, [5.0, -2.0, 100.0])


def brick() -> Mesh:
    return box((3.0, 2.0, 1.0))


LOADS: dict[str, Callable[[], Mesh]] = {"ball_0": ball, "brick_0": brick, "ball_1": ball}


def plan(config: DatasetConfig = CONFIG, format: str = "packed") -> Plan:
    splits = ("train", "test", "train")
    entries = [MeshEntry(k, k[:-2], split, load) for (k, load), split in zip(LOADS.items(), splits, strict=True)]
    return Plan(MeshCollection(entries), config, format)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("packed") / "out"
    generate(plan(), out)
    return out


@given(
    arrays(np.uint16, st.tuples(st.integers(1, 40), st.just(3)))
    | arrays(np.uint8, st.tuples(st.integers(1, 40), st.just(3)))
    | arrays(np.int32, st.integers(1, 40))
)
def test_integers_round_trip(values: Any) -> None:
    again = unpack_integers(pack_integers(values), values.dtype.str, values.shape, "values")
    assert again.dtype == values.dtype
    assert np.array_equal(again, values)


@given(arrays(np.bool_, st.tuples(st.integers(1, 5), st.integers(1, 40))))
def test_mask_round_trip(mask: Any) -> None:
    assert np.array_equal(unpack_mask(pack_mask(mask), *mask.shape), mask)


def test_the_grid_rounds_by_half_a_step_at_most_and_reaches_the_corners() -> None:
    bounds = np.array([[-3.0, 5, 0], [7, 6, 0]])
    grid = Quantizer.of_box(bounds)
    assert grid.step == pytest.approx(10 / 65535)
    positions = np.random.default_rng(0).uniform(bounds[0], bounds[1], (1000, 3))
    assert np.abs(grid.positions(grid.quantize(positions)) - positions).max() <= grid.step / 2 * (1 + 1e-9)
    assert np.allclose(grid.positions(grid.quantize(bounds))[:, 0], bounds[:, 0], rtol=0, atol=1e-12)


def test_every_cloud_is_the_selection_rounded_to_the_step(folder: Path) -> None:
    """Against the oracle's answer to the points before rounding, computed here again from the config."""
    clouds = PackedDataset(folder)
    assert len(clouds) == 3 * 2 * 7
    index = 0
    for mesh_id, (key, load) in enumerate(LOADS.items()):
        mesh = load()
        views = plan().views.around(mesh.centre, mesh.longest_side)
        with prepare(mesh, "oracle") as oracle:
            for variation in range(2):
                points = sample(mesh, CONFIG, seed_of(CONFIG.seed, key, variation))
                mask = oracle.visible(points, views.eyes)
                for view in range(7):
                    cloud, seen = clouds[index], mask[view]
                    assert np.array_equal(cloud.face_ids, points.face_ids[seen])
                    error = np.abs(cloud.positions - points.positions[seen]).max()
                    assert 0 < error <= mesh.longest_side / 65535 / 2 * (1 + 1e-6)
                    assert (cloud.key, cloud.mesh_id, cloud.variation, cloud.view_id) == (key, mesh_id, variation, view)
                    assert clouds.classes[cloud.label] == key[:-2]
                    assert cloud.n_points == 301
                    assert np.allclose(cloud.pose @ [*views.eyes[view], 1], [0, 0, 0, 1], atol=1e-9 * mesh.longest_side)
                    assert cloud.view[2] == pytest.approx(4 * mesh.longest_side)
                    index += 1


def test_converted_it_is_what_generate_makes_within_the_rounding(folder: Path, tmp_path: Path) -> None:
    generate(plan(format="hdf5"), tmp_path / "made")
    document = convert(folder, tmp_path / "converted", "hdf5")
    assert document["converted_from"]["format"] == "packed"
    assert document["fingerprint"] != plan(format="hdf5").fingerprint, "its positions are rounded"
    made, converted = open_dataset(tmp_path / "made"), open_dataset(tmp_path / "converted")
    for split in made.order:
        one, two = made.take(made.order[split]), converted.take(converted.order[split])
        for name in one.dtype.names or ():
            if name == "data":
                assert np.abs(one[name] - two[name]).max() < 3 / 65535  # a small cloud is scaled up
            elif name in ("centre", "factor"):
                assert np.allclose(one[name], two[name], rtol=1e-4, atol=60 / 65535)
            else:
                assert np.array_equal(one[name], two[name]), name
    again = (tmp_path / "converted" / "manifest.json").stat().st_mtime_ns
    assert convert(folder, tmp_path / "converted", "hdf5") == document
    assert (tmp_path / "converted" / "manifest.json").stat().st_mtime_ns == again


def test_a_split_has_its_own_clouds(folder: Path) -> None:
    test = PackedDataset(folder, split="test")
    assert len(test) == 14
    assert {cloud.key for cloud in test} == {"brick_0"}
    assert [cloud.view_id for cloud in test[3:5]] == [3, 4]
    with pytest.raises(OptionError, match="split must be one of test, train; got 'val'"):
        PackedDataset(folder, split="val")


def test_views_that_see_nothing_are_no_clouds(tmp_path: Path) -> None:
    from zbuf_occlude.visibility.methods import oracle

    class Blind(oracle.Oracle):
        def _visible(self, points: Any, eyes: Any) -> Any:
            mask = np.ones((len(eyes), len(points)), dtype=bool)
            if len(eyes) == 7:  # and not when a few answers are checked
                mask[[1, 4]] = False
            return mask

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(oracle, "prepare", lambda mesh, contact=1e-5: Blind(mesh, contact))
        document = generate(plan(), tmp_path / "out")
    assert document["counts"]["views_that_see_nothing"] == 12
    clouds = PackedDataset(tmp_path / "out")
    assert [cloud.view_id for cloud in clouds] == [0, 2, 3, 5, 6] * 6


def test_a_split_without_a_cloud_is_read_as_none(tmp_path: Path) -> None:
    from zbuf_occlude.visibility.methods import oracle

    class Blind(oracle.Oracle):
        def _visible(self, points: Any, eyes: Any) -> Any:
            return np.zeros((len(eyes), len(points)), dtype=bool)

    def prepare_oracle(mesh: Mesh, contact: float = 1e-5) -> oracle.Oracle:
        return Blind(mesh, contact) if len(mesh.faces) == len(brick().faces) else oracle.Oracle(mesh, contact)

    entries = [MeshEntry("seen", "ball", "train", ball), MeshEntry("unseen", "brick", "test", brick)]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(oracle, "prepare", prepare_oracle)
        document = generate(Plan(MeshCollection(entries), CONFIG, "packed"), tmp_path / "out")
    assert list(document["counts"]["clouds_by_split"]) == ["train"]
    assert open_dataset(tmp_path / "out").n_clouds == document["counts"]["clouds_by_split"]


def test_any_unzip_reads_it(folder: Path) -> None:
    """The documented layout, read without this package's reader."""
    with zipfile.ZipFile(folder / "packed-000001.zip") as archive:  # the brick is the test split
        assert archive.testzip() is None
        facts = json.loads(archive.read("000001/mesh.json"))
        assert facts["key"] == "brick_0"
        assert facts["n_points"] == [301, 301]
        content = archive.read("000001/1.steps")
        bits = archive.read("000001/1.visible")
    columns = []
    for axis in range(3):
        low, high = content[602 * axis :][:301], content[602 * axis + 301 :][:301]
        value, column = 0, []
        for small, large in zip(low, high, strict=True):
            folded = small + 256 * large
            value = (value + (folded // 2 if folded % 2 == 0 else -(folded // 2) - 1)) % 65536
            column.append(facts["low"][axis] + facts["step"] * value)
        columns.append(column)
    seen = [i for i in range(301) if bits[38 * 3 + i // 8] >> (7 - i % 8) & 1]  # of view 3
    expected = next(c for c in PackedDataset(folder) if (c.mesh_id, c.variation, c.view_id) == (1, 1, 3))
    assert np.allclose(np.array(columns).T[seen], expected.positions, rtol=0, atol=1e-12)


def test_it_is_small(folder: Path) -> None:
    """A tenth of what the drawn clouds take, though all points are there."""
    size = sum(path.stat().st_size for path in folder.glob("packed-*.zip"))
    assert size < 0.1 * 42 * (301 / 2) * 24


def _first_of(clouds: PackedDataset, queue: Any) -> None:
    queue.put([clouds[index].positions for index in (0, 20, 41)])


@pytest.mark.parametrize("start", ["spawn", "fork"])
def test_other_processes_read_it_too(folder: Path, start: Any) -> None:
    clouds = PackedDataset(folder)
    expected = [clouds[index].positions for index in (0, 20, 41)]  # the files are open now
    context = multiprocessing.get_context(start)
    queue = context.Queue()
    child = context.Process(target=_first_of, args=(clouds, queue))
    child.start()
    found = queue.get(timeout=60)
    child.join()
    assert all(np.array_equal(a, b) for a, b in zip(found, expected, strict=True))
    assert os.getpid() == clouds.archives._process
    assert len(pickle.dumps(clouds)) < 20_000, "nothing unpacked travels"


@pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="open files are listed by Linux alone")
def test_files_close_with_their_reader(folder: Path) -> None:
    def is_open() -> bool:
        return any(folder.resolve() in link.resolve().parents for link in Path("/proc/self/fd").iterdir())

    gc.collect()
    gc.disable()  # it would end cycles, whenever it comes
    try:
        clouds = PackedDataset(folder)
        assert len(clouds[0].positions)
        assert is_open()
        del clouds
        assert not is_open()
    finally:
        gc.enable()


def test_damage_is_named(folder: Path, tmp_path: Path) -> None:
    for path in filter(Path.is_file, folder.iterdir()):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    victim = tmp_path / "packed-000000.zip"
    content = bytearray(victim.read_bytes())
    with zipfile.ZipFile(victim) as archive:
        offset = archive.getinfo("000000/0.steps").header_offset
    content[offset + 60] ^= 255
    victim.write_bytes(bytes(content))
    with pytest.raises(
        DatasetError, match=r"packed-000000\.zip must be as it was written; it cannot be read \(Error -3 while"
    ):
        PackedDataset(tmp_path)[0]
    victim.write_bytes(bytes(content[:-30]))
    with pytest.raises(DatasetError, match=r"\.zip must be as it .* \(File is not a zip file\)\. Copy it again"):
        PackedDataset(tmp_path)


def test_another_format_is_not_packed(folder: Path, tmp_path: Path) -> None:
    convert(folder, tmp_path / "npz", "npz")
    with pytest.raises(DatasetError, match="must be in the format packed; it is in npz"):
        PackedDataset(tmp_path / "npz")
    with pytest.raises(DatasetError, match="must be made of all points"):
        convert(tmp_path / "npz", tmp_path / "packed", "packed")
    assert not (tmp_path / "packed").exists()
    with pytest.raises(DatasetError, match=r"must hold a dataset; it has no plan\.json"):
        PackedDataset(tmp_path / "nowhere")
