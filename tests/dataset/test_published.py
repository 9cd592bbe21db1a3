"""The layouts of published benchmarks, read by code written from their descriptions, by Open3D, h5py and datasets."""

import json
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from tests.scenes import box
from zbuf_occlude import DatasetError, Mesh, OptionError
from zbuf_occlude.dataset.claim import strangers
from zbuf_occlude.dataset.convert import convert, open_dataset
from zbuf_occlude.dataset.formats import FORMATS, find_format
from zbuf_occlude.dataset.formats.published import names_of
from zbuf_occlude.dataset.generate import generate
from zbuf_occlude.dataset.parts import n_parts
from zbuf_occlude.dataset.plan import Plan, Recipe
from zbuf_occlude.dataset.verify import verify
from zbuf_occlude.meshes.collection import MeshCollection, MeshEntry

MESHES = [
    ("02691156/1a04e3eab45ca15d", "airplane", "train"),
    ("02691156/1a6ad7a24bb89733", "airplane", "test"),
    ("arm chair/train/a-b.c.off", "arm chair", "train"),
    ("arm chair/test/a-b.c.off", "arm chair", "val"),
]
NAMES = {"airplane": "02691156", "arm chair": "arm_chair"}
PAIRS = [row.name for row in FORMATS if row.pairs]
PUBLISHED = [row.name for row in FORMATS if row.name not in ("hdf5", "webdataset", "npz", "ply", "packed")]
INDICES = ("PCN.json", "Completion3D.json", "shapenet_synset_dict.json")
N_VIEWS = {"pcn": 8, "completion3d": 1, "mvp": 26, "projected-shapenet": 16, "shapenet55": 1}


def slab() -> Mesh:
    """A box of 1 x 2 x 4: what is centred and scaled wrongly shows."""
    return Mesh(box().vertices * [1, 2, 4] + [5, 0, 0], box().faces)


def collection(format: str) -> MeshCollection:
    listed = {"airplane": "bed", "arm chair": "chair"} if find_format(format).classes else {}
    return MeshCollection(MeshEntry(key, listed.get(label, label), split, slab) for key, label, split in MESHES)


def plan(format: str, **changes: object) -> Plan:
    row = find_format(format)
    recipe = Recipe(method="exact", n_points=17_000, views=str(row.options.get("views", "ring:3@10")), sample_size=512)
    return Plan(collection(format), replace(row.redrawn(recipe), **changes), format)


Made = Callable[[str], Path]


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory) -> Made:
    """Return a function that makes a small dataset in a format, once per session."""
    done: dict[str, Path] = {}

    def make(format: str) -> Path:
        if format not in done:
            done[format] = tmp_path_factory.mktemp("published") / format
            generate(plan(format), done[format])
        return done[format]

    return make


def read_all(root: Path) -> None:
    source = open_dataset(root)
    for numbers in source.order.values():
        source.take(numbers)


def fits(complete: np.ndarray, partial: np.ndarray) -> None:
    """A pair: the whole slab in the middle, longest side 1, y up; of it what a camera sees."""
    assert np.allclose(complete.min(axis=0), [-0.125, -0.5, -0.25], atol=0.01)
    assert np.allclose(complete.max(axis=0), [0.125, 0.5, 0.25], atol=0.01)
    assert len(np.unique(complete, axis=0)) > 0.99 * len(complete), "points are drawn without repeating"
    assert (partial.min(axis=0) >= complete.min(axis=0) - 0.01).all()
    assert (partial.max(axis=0) <= complete.max(axis=0) + 0.01).all()
    on_sides = [np.abs(partial - side * np.array([0.125, 0.5, 0.25])) < 1e-3 for side in (-1, 1)]
    assert 1 <= (np.mean(on_sides, axis=1) > 0.03).sum() <= 3, "a camera sees at most three sides of a box"


@pytest.mark.parametrize("format", PUBLISHED)
def test_every_file_has_a_name_that_its_plan_says(made: Made, format: str) -> None:
    assert strangers(made(format), plan(format)) == []


def test_pcn_as_its_loaders_read_it(made: Made) -> None:
    o3d = pytest.importorskip("open3d", reason="the package open3d cannot be imported", exc_type=ImportError)
    root = made("pcn")
    taxonomies = json.loads((root / "PCN.json").read_text())
    assert [row["taxonomy_id"] for row in taxonomies] == ["02691156", "arm_chair"]
    assert [row["taxonomy_name"] for row in taxonomies] == ["airplane", "arm chair"]
    n_pairs = 0
    for row in taxonomies:
        for split, n_renderings in (("train", 8), ("val", 1), ("test", 1)):
            for model in row[split]:
                gt = np.array(
                    o3d.io.read_point_cloud(str(root / f"{split}/complete/{row['taxonomy_id']}/{model}.pcd")).points
                )
                assert gt.shape == (16_384, 3)
                folder = root / f"{split}/partial/{row['taxonomy_id']}/{model}"
                assert sorted(path.name for path in folder.iterdir()) == [f"{i:02d}.pcd" for i in range(n_renderings)]
                for i in range(n_renderings):
                    partial = np.array(o3d.io.read_point_cloud(str(folder / f"{i:02d}.pcd")).points)
                    assert partial.shape == (512, 3)
                    fits(gt, partial)
                    n_pairs += 1
    assert n_pairs == 8 + 8 + 1 + 1


def test_projected_shapenet_as_its_loaders_read_it(made: Made) -> None:
    o3d = pytest.importorskip("open3d", reason="the package open3d cannot be imported", exc_type=ImportError)
    root = made("projected-shapenet")
    n_pairs = 0
    for split in ("train", "test", "val"):
        for line in (root / f"{split}.txt").read_text().splitlines():
            taxonomy, model = line.split("-")[0].split("/")[-1], line.split("-")[1].split(".")[0]
            gt = np.load(root / line).astype(np.float32)
            assert gt.shape == (8_192, 3)
            for i in range(16):
                path = root / f"projected_partial_noise/{taxonomy}/{model}/models/{i}.pcd"
                fits(gt, np.array(o3d.io.read_point_cloud(str(path)).points))
                n_pairs += 1
    assert n_pairs == 4 * 16


def test_shapenet55_as_its_loaders_read_it(made: Made) -> None:
    root = made("shapenet55")
    lines = [line for split in ("train", "test", "val") for line in (root / f"{split}.txt").read_text().splitlines()]
    assert len(lines) == 4
    for line in lines:
        assert re.fullmatch(r"(02691156|arm_chair)-\w+\.npy", line), "one hyphen, one dot: loaders split there"
        cloud = np.load(root / "shapenet_pc" / line)
        assert (cloud.shape, cloud.dtype) == ((8_192, 3), np.float32)
        assert np.allclose(np.ptp(cloud, axis=0), [0.25, 1.0, 0.5], atol=0.01)


@pytest.mark.parametrize("format", ["pcn", "completion3d", "projected-shapenet", "shapenet55"])
def test_what_a_report_of_a_test_looks_up(made: Made, format: str) -> None:
    """PoinTr's prints `shapenet_synset_dict.json`'s name of each taxonomy that it met."""
    called = json.loads((made(format) / "shapenet_synset_dict.json").read_text())
    assert called == {"02691156": "airplane", "arm_chair": "arm chair"}


def test_mvp_as_its_loaders_read_it(made: Made) -> None:
    for name, n in (("Train", 2), ("Test", 1), ("Val", 1)):
        with h5py.File(made("mvp") / f"MVP_{name}_CP.h5") as h5:
            partial, complete, labels = (h5[key][()] for key in ("incomplete_pcds", "complete_pcds", "labels"))
        assert (partial.shape, partial.dtype) == ((26 * n, 2_048, 3), np.float32)
        assert (complete.shape, complete.dtype) == ((n, 2_048, 3), np.float32)
        assert (labels.shape, labels.dtype) == ((26 * n,), np.int64)
        for index in range(len(partial)):
            fits(complete[index // 26], partial[index])
        assert all(len(set(labels[26 * i : 26 * i + 26])) == 1 for i in range(n))
        np.eye(16)[labels]  # as one loader does


def test_completion3d_as_its_loaders_read_it(made: Made) -> None:
    root = made("completion3d")
    n_pairs = 0
    for split in ("train", "val", "test"):
        for name in (root / f"{split}.list").read_text().splitlines():
            pair = []
            for kind in ("gt", "partial"):
                with h5py.File(root / split / kind / f"{name}.h5") as h5:
                    pair.append(h5["data"][()])
                assert (pair[-1].shape, pair[-1].dtype) == ((2_048, 3), np.float32)
            fits(*pair)
            n_pairs += 1
    assert n_pairs == 4


def test_completion3d_as_loaders_with_a_category_file_read_it(made: Made) -> None:
    root = made("completion3d")
    n_pairs = 0
    for category in json.loads((root / "Completion3D.json").read_text()):
        taxonomy = category["taxonomy_id"]
        assert NAMES[category["taxonomy_name"]] == taxonomy
        for subset in ("train", "val", "test"):
            for model in category[subset]:
                pair = []
                for pattern in ("%s/gt/%s/%s.h5", "%s/partial/%s/%s.h5"):
                    with h5py.File(root / (pattern % (subset, taxonomy, model)), "r") as h5:
                        pair.append(h5["data"][()])
                fits(*pair)
                n_pairs += 1
    assert n_pairs == 4


def test_modelnet40_c_as_its_loaders_read_it(made: Made) -> None:
    root = made("modelnet40-c")
    label = np.load(root / "label.npy")
    assert (label.shape, label.dtype) == ((1, 1), np.int64)
    assert label[0].item() == 2
    for severity in (1, 2, 3):
        data = np.load(root / f"data_occlusion_{severity}.npy")
        assert (data.shape, data.dtype) == ((1, 512, 3), np.float32)
    assert np.load(root / "train" / "data_occlusion_1.npy").shape == (2, 512, 3)
    assert np.load(root / "train" / "label.npy").tolist() == [[2], [8]]
    assert len(np.unique([np.load(root / f"data_occlusion_{i}.npy")[0, 0, 0] for i in (1, 2, 3)])) == 3


@pytest.mark.parametrize("format", ["modelnet40-c", "modelnet-o", "scanobjectnn"])
def test_an_earlier_version_is_refused(made: Made, tmp_path: Path, format: str) -> None:
    """Its files had other names, labels and axes: other clouds would be read."""
    root = Path(shutil.copytree(made(format), tmp_path / "earlier"))
    document = json.loads((root / "plan.json").read_text()) | {"data_version": 7}
    document["fingerprint"] = Plan.from_document(document).fingerprint
    (root / "plan.json").write_text(json.dumps(document))
    with pytest.raises(DatasetError, match="must be of data version 8 or later; this is of 7"):
        open_dataset(root)


def test_records_in_one_file_per_split_as_before_are_the_datasets_own() -> None:
    names = set(find_format("pcn").load().names(plan("pcn")))
    assert {"clouds_train.npy", "clouds_val.npy", "clouds_test.npy"} < names


@pytest.mark.parametrize("format", PAIRS)
def test_small_datasets_of_whole_objects_are_written_in_parts_by_all_workers(format: str) -> None:
    """200 objects of 8 views were a single part, which a second worker waited for."""
    entries = [MeshEntry(f"m{i}", "airplane", "train", slab) for i in range(40_000)]
    small, large = (replace(plan(format), meshes=MeshCollection(some)) for some in (entries[:200], entries))
    assert n_parts(small) == len(small.shards)
    assert n_parts(large) < len(large.shards)


def test_scanobjectnn_as_its_loaders_read_it(made: Made) -> None:
    for name, n in (("training", 6), ("test", 3), ("val", 3)):
        with h5py.File(made("scanobjectnn") / f"{name}_objectdataset_augmentedrot_scale75.h5") as h5:
            data, label, mask = (h5[key][()] for key in ("data", "label", "mask"))
        assert (data.shape, data.dtype) == ((n, 512, 3), np.float32)
        assert label.shape == (n,)
        assert mask.shape == (n, 512)
        assert (mask != -1).all(), "no point is of the background"


def test_modelnet_o_as_its_description_says(made: Made) -> None:
    root = made("modelnet-o")
    names = sorted(path.relative_to(root).as_posix() for path in root.rglob("*.xyz"))
    assert len(names) == 12
    assert names[:3] == [f"bed/test/1a6ad7a24bb89733_{i:03d}.xyz" for i in (1, 2, 3)]
    cloud = np.loadtxt(root / names[0])
    assert cloud.shape == (512, 3)


def test_huggingface_reads_the_folder(made: Made, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    datasets = pytest.importorskip("datasets", reason="the package datasets is not installed")
    root = made("huggingface")
    loaded = datasets.load_dataset(str(root), cache_dir=str(tmp_path))
    assert {split: len(part) for split, part in loaded.items()} == {"train": 6, "test": 3, "validation": 3}
    assert "malformed" not in capfd.readouterr().err, "of the card"
    row = loaded["test"][0]
    assert row["mesh"] == "02691156/1a6ad7a24bb89733"
    assert loaded["test"].features["label"].names == ["airplane", "arm chair"]
    assert np.shape(row["points"]) == (512, 3)
    assert np.shape(row["pose"]) == (4, 4)
    source = open_dataset(root)
    record = source.take(source.order["test"])[0]
    assert np.array_equal(np.array(row["points"], np.float32), record["data"])
    assert np.array_equal(loaded["test"].with_format("numpy")[0]["points"], record["data"])


@pytest.mark.parametrize("format", PUBLISHED)
def test_read_back_verified_and_the_same_from_packed(made: Made, tmp_path: Path, format: str) -> None:
    out, wanted = made(format), plan(format)
    verdict = verify(out, wanted.meshes)
    assert verdict.faults == []
    source = open_dataset(out)
    clouds = {split: source.take(numbers) for split, numbers in source.order.items()}
    assert all((np.ptp(records["data"], axis=1) > 0).any(axis=1).all() for records in clouds.values())
    packed = tmp_path / "packed"
    generate(replace(wanted, format="packed", recipe=replace(wanted.recipe, scale="cloud", complete=False)), packed)
    convert(packed, tmp_path / "converted", format)
    written = {path.relative_to(out): path for path in out.rglob("*") if path.is_file()}
    same = [name for name in written if not name.name.endswith((".json", ".png", ".md")) or name.name in INDICES]
    exactly = find_format(format).pairs
    for name in same:
        converted = tmp_path / "converted" / name
        assert converted.is_file(), name
        assert not exactly or converted.read_bytes() == written[name].read_bytes(), name
    back = open_dataset(tmp_path / "converted")
    for split, records in clouds.items():
        others = back.take(back.order[split])
        assert np.array_equal(others["mesh_id"], records["mesh_id"])
        if wanted.recipe.scale != "cloud" and not find_format(format).complete:
            continue
        assert np.allclose(others["data"], records["data"], atol=1e-4), "rounded to the packed step"


@pytest.mark.parametrize("format", [*PAIRS, "shapenet55"])
def test_what_loaders_count_on_is_met_or_refused(format: str) -> None:
    row = find_format(format)
    row.check(plan(format))
    refused = [({"n_points": 100}, "points in each complete cloud; got 100. Give --points")]
    refused += [({"variations": 2}, "must have 1 variation, for its loaders count on it; got 2. See --variations")]
    refused += [({"scale": "cloud"}, "partial and complete clouds in one frame; got --scale cloud")]
    refused += [({"frame": "camera"}, "in one frame; got --scale object --frame camera")]
    refused += [({"n_points": None, "density": 9.0}, "points in each complete cloud; got a density")]
    if not row.complete:
        refused += [({"views": "ring:5@0"}, f"must have {N_VIEWS[format]} views per object, .* got 5. See --views")]
    for changes, message in refused:
        with pytest.raises(OptionError, match=message):
            row.check(plan(format, **changes))  # type: ignore[arg-type]


@pytest.mark.parametrize("format", [*PAIRS, "shapenet55"])
def test_what_was_drawn_has_no_complete_clouds(made: Made, tmp_path: Path, format: str) -> None:
    with pytest.raises(DatasetError, match=r"must be made of all points of the objects, .* convert a packed dataset"):
        convert(made("scanobjectnn"), tmp_path / "out", format)


@pytest.mark.parametrize("format", [*PAIRS, "shapenet55"])
def test_a_damaged_file_is_named(made: Made, tmp_path: Path, format: str) -> None:
    root = Path(shutil.copytree(made(format), tmp_path / "copy"))
    kinds = ("partial", "incomplete", "shapenet_pc" if format == "shapenet55" else "projected", "MVP_Train")
    victim = next(
        p for p in sorted(root.rglob("*")) if p.is_file() and any(k in str(p.relative_to(root)) for k in kinds)
    )
    content = victim.read_bytes()
    for damaged in (content[: len(content) // 2], b"\x07" * len(content), b"", None):
        victim.unlink() if damaged is None else victim.write_bytes(damaged)
        with pytest.raises(DatasetError, match=re.escape(f"{victim} must be")):
            read_all(root)


def test_names_are_words_and_differ() -> None:
    keys = ["a/x.off", "a/y/x.off", "a/x.1.off", "a b/x.off", "a-b/x.off", "02691156/x", "02691156/x.y"]
    labels = ["a", "a", "a", "a b", "a-b", "plane", "plane"]
    entries = [MeshEntry(key, label, "train", slab) for key, label in zip(keys, labels, strict=True)]
    names = names_of(Plan(MeshCollection(entries), Recipe()))
    assert names.taxonomies == ["a", "a", "a", "a_b", "a_b_2", "02691156", "02691156"]
    assert names.objects == ["x", "x_2", "x_1", "x", "x", "x", "x_y"]
    assert names.classes[-1] == "plane"
