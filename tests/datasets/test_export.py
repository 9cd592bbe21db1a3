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
from zbuf_occlude.datasets.export import convert, names_of
from zbuf_occlude.datasets.formats import FORMATS, Format, find_format
from zbuf_occlude.datasets.generate import generate
from zbuf_occlude.datasets.plan import DatasetConfig, Plan
from zbuf_occlude.datasets.source import open_dataset
from zbuf_occlude.datasets.verify import verify
from zbuf_occlude.meshes.collection import SPLITS, MeshCollection, MeshEntry
from zbuf_occlude.sensors import make
from zbuf_occlude.sensors.scan_config import ScanConfig

pytestmark = pytest.mark.usefixtures("no_pictures")
MESHES = [
    ("02691156/1a04e3eab45ca15d", "airplane", "train"),
    ("02691156/1a6ad7a24bb89733", "airplane", "test"),
    ("arm chair/train/a-b.c.off", "arm chair", "train"),
    ("arm chair/test/a-b.c.off", "arm chair", "val"),
]
NAMES = {"airplane": "02691156", "arm chair": "arm_chair"}
OF_A_CAMERA = ("frames", "bop", "organized-pcd", "mcap")
PAIRS = [row.name for row in FORMATS if row.exported_from == "packed"]
LAYOUTS = [row.name for row in FORMATS if row.exported_from]
N_VIEWS = {"pcn": 8, "completion3d": 1, "mvp": 26, "projected-shapenet": 16, "shapenet55": 1, "epn3d": 6}


def slab() -> Mesh:
    """A box of 1 x 2 x 4: what is centred and scaled wrongly shows."""
    return Mesh(box().vertices * [1, 2, 4] + [5, 0, 0], box().faces)


def collection(format: str) -> MeshCollection:
    listed = {"airplane": "bed", "arm chair": "chair"} if find_format(format).class_list else {}
    return MeshCollection(MeshEntry(key, listed.get(label, label), split, slab) for key, label, split in MESHES)


def plan(format: str, **changes: object) -> Plan:
    config = config_for(find_format(format), n_points=17_000, sample_size=512)
    return Plan(collection(format), replace(config, **changes), format)


def config_for(row: Format, n_points: int, sample_size: int) -> DatasetConfig:
    """Return a configuration of few views that a format can hold."""
    views = str(row.options.get("views", "ring:3@10"))
    config = DatasetConfig(method="exact", n_points=n_points, views=views, sample_size=sample_size)
    if row.name in OF_A_CAMERA:
        config = replace(config, scan=camera())
    if row.name == "kitti":
        config = replace(config, views="ring:1@0", scan=lidar(), attributes=("boxes",))
    return row.redrawn(config)


def camera() -> ScanConfig:
    """A pinhole camera that keeps all that it sees."""
    return ScanConfig(make("pinhole", width=24, height=18, fov=40), size="file", keep="all")


def lidar() -> ScanConfig:
    """A coarse LiDAR on the ground that keeps all that it meets."""
    sensor = make("hdl-64e", columns=60, divergence=0)
    return ScanConfig(sensor, range=(8, 12), size="file", scene="ground", keep="all")


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


def fits(complete: np.ndarray, partial: np.ndarray) -> None:
    """A pair: the whole slab in the middle, longest side 1, y up; of it what a camera sees."""
    assert np.allclose(complete.min(axis=0), [-0.125, -0.5, -0.25], atol=0.01)
    assert np.allclose(complete.max(axis=0), [0.125, 0.5, 0.25], atol=0.01)
    assert len(np.unique(complete, axis=0)) > 0.99 * len(complete), "points are drawn without repeating"
    assert (partial.min(axis=0) >= complete.min(axis=0) - 0.01).all()
    assert (partial.max(axis=0) <= complete.max(axis=0) + 0.01).all()
    on_sides = [np.abs(partial - side * np.array([0.125, 0.5, 0.25])) < 1e-3 for side in (-1, 1)]
    assert 1 <= (np.mean(on_sides, axis=1) > 0.03).sum() <= 3, "a camera sees at most three sides of a box"


@pytest.mark.needs("open3d")
def test_pcn_as_its_loaders_read_it(made: Made) -> None:
    import open3d as o3d

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


@pytest.mark.needs("open3d")
def test_projected_shapenet_as_its_loaders_read_it(made: Made) -> None:
    import open3d as o3d

    root = made("projected-shapenet")
    n_pairs = 0
    for split in SPLITS:
        for line in (root / f"{split}.txt").read_text().splitlines():
            taxonomy, model = line.split("-")[0].split("/")[-1], line.split("-")[1].split(".")[0]
            gt = np.load(root / line).astype(np.float32)
            assert gt.shape == (8_192, 3)
            for i in range(16):
                path = root / f"projected_partial_noise/{taxonomy}/{model}/models/{i}.pcd"
                fits(gt, np.array(o3d.io.read_point_cloud(str(path)).points))
                n_pairs += 1
    assert n_pairs == 4 * 16


def test_epn3d_as_its_loaders_read_it(made: Made) -> None:
    root, n_pairs = made("epn3d"), 0
    rows = json.loads((root / "EPN3D.json").read_text())
    assert [(row["taxonomy_name"], row["taxonomy_id"]) for row in rows] == [
        ("airplane", "02691156"), ("arm_chair", "arm_chair"),
    ]  # fmt: skip
    for row in rows:
        for split in SPLITS:
            for partial, complete in zip(row[split]["partial"], row[split]["complete"], strict=True):
                gt = np.load(root / f"{row['taxonomy_name']}/complete/{complete}.npy")
                cloud = np.load(root / f"{row['taxonomy_name']}/partial/{partial}.npy")
                assert (gt.shape, cloud.shape, gt.dtype) == ((2_048, 3), (2_048, 3), np.float32)
                fits(gt, cloud)
                n_pairs += 1
    assert n_pairs == 4 * 6


def test_shapenet55_as_its_loaders_read_it(made: Made) -> None:
    root = made("shapenet55")
    lines = [line for split in SPLITS for line in (root / f"{split}.txt").read_text().splitlines()]
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
    """Some begin with the lists of splits, others with a file of categories."""
    root = made("completion3d")
    listed = [(split, *name.split("/")) for split in SPLITS for name in (root / f"{split}.list").read_text().split()]
    categories = json.loads((root / "Completion3D.json").read_text())
    assert {category["taxonomy_name"]: category["taxonomy_id"] for category in categories} == NAMES
    named = [(split, each["taxonomy_id"], model) for each in categories for split in SPLITS for model in each[split]]
    assert sorted(listed) == sorted(named)
    assert len(listed) == 4
    for split, taxonomy, model in listed:
        pair = []
        for kind in ("gt", "partial"):
            with h5py.File(root / split / kind / taxonomy / f"{model}.h5") as h5:
                pair.append(h5["data"][()])
            assert (pair[-1].shape, pair[-1].dtype) == ((2_048, 3), np.float32)
        fits(*pair)


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


def test_modelnet40_c_is_twice_as_large_with_normals_of_length_one(tmp_path: Path) -> None:
    """`factor` and `centre` of its further file lead back to the slab, whose normals are axes."""
    generate(plan("modelnet40-c", attributes=("normals",), scale="object"), tmp_path)
    rows = np.load(tmp_path / "clouds_test.npy")
    assert np.linalg.norm(rows["normal"], axis=-1) == pytest.approx(1.0, abs=1e-6)
    for view, row in enumerate(rows):
        x, y, z = np.load(tmp_path / f"data_occlusion_{view + 1}.npy")[0].T.astype(float)
        back = np.stack([-x, z, y], axis=1) / row["factor"] + row["centre"]
        faces = np.abs(back - slab().centre) / (slab().bounds[1] - slab().centre)
        assert faces.max(axis=1) == pytest.approx(1.0, abs=1e-5)
        sides = np.abs(np.stack([-row["normal"][:, 0], row["normal"][:, 2], row["normal"][:, 1]], axis=1))
        assert (sides.argmax(axis=1) == faces.argmax(axis=1)).mean() > 0.99


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
    assert np.array_equal(np.array(row["points"], np.float32), loaded["test"].with_format("numpy")[0]["points"])


@pytest.mark.parametrize(
    "format", [pytest.param(name, marks=[pytest.mark.needs("open3d")] * (name == "voxels")) for name in LAYOUTS]
)
def test_verified_by_checksums_and_not_read_back(made: Made, tmp_path: Path, format: str) -> None:
    root = Path(shutil.copytree(made(format), tmp_path / "copy"))
    assert verify(root, plan(format).meshes).faults == []
    command = "generate" if format in ("frames", "bop", "organized-pcd", "mcap", "voxels") else "convert"
    with pytest.raises(DatasetError, match=rf"it is an export for the loaders of {format}\..*zbuf-occlude {command}"):
        open_dataset(root)
    manifest = json.loads((root / "manifest.json").read_text())
    kept = {"plan.json", "manifest.json", "contact_sheet.png"}
    names = {path.relative_to(root).as_posix() for path in root.rglob("*") if path.is_file()} - kept
    assert names == set(manifest["sha256"]), "every file has a checksum"
    victim = root / sorted(names)[len(names) // 2]
    victim.write_bytes(victim.read_bytes() + b"x")
    (fault,) = verify(root, None).faults
    assert victim.relative_to(root).as_posix() in fault


@pytest.mark.parametrize("format", [name for name in LAYOUTS if name not in ("kitti", "voxels", *OF_A_CAMERA)])
def test_the_same_from_packed(made: Made, tmp_path: Path, format: str) -> None:
    """Pairs byte for byte; other layouts' clouds are rounded there."""
    out, wanted, packed = made(format), plan(format), tmp_path / "packed"
    generate(replace(wanted, format="packed", config=replace(wanted.config, scale="cloud", complete=False)), packed)
    convert(packed, tmp_path / "converted", format)
    written = {path.relative_to(out) for path in out.rglob("*") if path.is_file()} - {Path("manifest.json")}
    assert written == {p.relative_to(tmp_path / "converted") for p in (tmp_path / "converted").rglob("*")
                       if p.is_file()} - {Path("manifest.json")}  # fmt: skip
    if format in PAIRS:
        for name in written - {Path("contact_sheet.png"), Path("plan.json")}:
            assert (tmp_path / "converted" / name).read_bytes() == (out / name).read_bytes(), name


def test_the_manifest_counts_the_clouds_that_a_conversion_keeps(tmp_path: Path) -> None:
    """Of three views of an object shapenet55 has one complete cloud."""
    wanted = plan("packed", views="ring:3@10")
    generate(wanted, tmp_path / "packed")
    counts = convert(tmp_path / "packed", tmp_path / "converted", "shapenet55")["counts"]
    n_files = len(list(tmp_path.glob("converted/shapenet_pc/*.npy")))
    assert (counts["clouds"], sum(counts["clouds_by_split"].values()), counts["meshes"]) == (n_files, n_files, 4)


@pytest.mark.parametrize("format", ["voxels", *OF_A_CAMERA])
def test_what_needs_the_meshes_is_not_converted(made: Made, tmp_path: Path, format: str) -> None:
    with pytest.raises(DatasetError, match=f"generate --format {format}"):
        convert(made("frames"), tmp_path / "converted", format)


def test_objects_of_a_class_have_names_of_their_own() -> None:
    """Also where their taxonomies differ: layouts have folders of either."""
    entries = [MeshEntry(f"{synset}/model", "thing", "train", slab) for synset in ("02691156", "03001627")]
    names = names_of(Plan(MeshCollection(entries), DatasetConfig(), "epn3d"))
    assert names.taxonomies == ["02691156", "03001627"]
    assert names.objects == ["model", "model_2"]


def test_classes_of_similar_names_lie_in_folders_of_their_own(tmp_path: Path) -> None:
    meshes = MeshCollection(MeshEntry(f"{label}/x.off", label, "train", slab) for label in ("a b", "a_b", "a-b"))
    config = DatasetConfig(method="exact", n_points=300, views="ring:1@10", sample_size=16)
    generate(Plan(meshes, config, "ply"), tmp_path)
    folders = [path.relative_to(tmp_path / "ply/train").parent.name for path in tmp_path.glob("ply/train/**/*.ply")]
    assert sorted(folders) == ["a_b", "a_b_2", "a_b_3"]


def test_clouds_tell_which_rows_are_which(made: Made) -> None:
    """By `clouds_SPLIT.npy`: a cloud's mesh and view, and its place in the world."""
    for format, split, name, rows in (
        ("scanobjectnn", "train", "training_objectdataset_augmentedrot_scale75.h5", "data"),
        ("mvp", "train", "MVP_Train_CP.h5", "incomplete_pcds"),
    ):
        rest = np.load(made(format) / f"clouds_{split}.npy")
        with h5py.File(made(format) / name) as h5:
            points = h5[rows][()][..., [0, 2, 1]] * [1, -1, 1]  # from y up to z up
        assert len(points) == len(rest)
        for row in (0, len(rest) - 1):
            world = points[row] / rest["factor"][row] + rest["centre"][row]
            assert (world.min(axis=0) > [4.4, -1.1, -2.1]).all(), "the slab is about (5, 0, 0)"
            assert (world.max(axis=0) < [5.6, 1.1, 2.1]).all()


@pytest.mark.parametrize("format", N_VIEWS)
def test_what_loaders_count_on_is_met_or_refused(format: str) -> None:
    row = find_format(format)
    row.check(plan(format))
    refused = [({"n_points": 100}, "points in each complete cloud; got 100. Give --points")]
    refused += [({"variations": 2}, "number of variations .* must be 1, .* it is 2. Give --variations 1")]
    refused += [({"scale": "cloud"}, "all clouds of an object in one frame; got --scale cloud")]
    if format not in ("completion3d", "epn3d"):
        refused += [({"frame": "camera"}, "must have one frame for all views of an object")]
    refused += [({"n_points": None, "density": 9.0}, "points in each complete cloud; got a density")]
    if not row.complete and format != "epn3d":  # its index names each view
        refused += [
            ({"views": "ring:5@0"}, f"views per object .* must be {N_VIEWS[format]}, .* it is 5. Give --views random:")
        ]
    for changes, message in refused:
        with pytest.raises(OptionError, match=message):
            row.check(plan(format, **changes))  # type: ignore[arg-type]


@pytest.mark.parametrize("format", N_VIEWS)
def test_what_was_drawn_has_no_complete_clouds(made: Made, tmp_path: Path, format: str) -> None:
    with pytest.raises(DatasetError, match=r"must be made of all points of the objects, .* convert a packed dataset"):
        convert(made("scanobjectnn"), tmp_path / "out", format)


def test_names_are_words_and_differ() -> None:
    keys = ["a/x.off", "a/y/x.off", "a/x.1.off", "a b/x.off", "a-b/x.off", "02691156/x", "02691156/x.y"]
    labels = ["a", "a", "a", "a b", "a-b", "plane", "plane"]
    entries = [MeshEntry(key, label, "train", slab) for key, label in zip(keys, labels, strict=True)]
    names = names_of(Plan(MeshCollection(entries), DatasetConfig()))
    assert names.taxonomies == ["a", "a", "a", "a_b", "a_b_2", "02691156", "02691156"]
    assert names.objects == ["x", "x_2", "x_1", "x", "x", "x", "x_y"]
    assert names.classes[-1] == "plane"
