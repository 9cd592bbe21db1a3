"""Layouts with published lists of classes, from the command line to their files: labels, masks, frames, names."""

import json
from pathlib import Path

import h5py
import numpy as np
import pytest

from tests.cli.conftest import Run, write_off

SMALL = "--points 400 --sample-size 64 --views ring:3@30 --method oracle --workers 1"
WEDGE = np.array([[0.0, 0, 0], [3, 0, 0], [0, 2, 0], [0, 0, 5]])
"""A tetrahedron that no rotation but the identity takes into itself."""
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])


def off_surface(points: np.ndarray, vertices: np.ndarray) -> float:
    """Return how far points are from the surface of a tetrahedron with these corners."""
    heights, _ = heights_over_faces(points, vertices)
    return float(np.abs(heights.max(axis=1)).max())


def heights_over_faces(points: np.ndarray, vertices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return how far points (p, 3) are outside a tetrahedron's faces, (p, 4), and the normals of these, (4, 3)."""
    corners = vertices[FACES]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return np.einsum("pfc,fc->pf", points[:, None] - corners[:, 0], normals), normals


def similar(points: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Return points moved and scaled so that their box is that of others."""
    factor = np.ptp(others, axis=0).max() / np.ptp(points, axis=0).max()
    return (points - points.min(axis=0)) * factor + others.min(axis=0)


@pytest.fixture
def meshes(tmp_path: Path) -> Path:
    """ModelNet's folders: two classes of all lists, one of ModelNet40 alone, one of none."""
    for label in ("chair", "table", "xbox", "gadget"):
        for split, number in (("train", 1), ("train", 2), ("test", 3)):
            path = tmp_path / "meshes" / label / split / f"{label}_{number:04d}.off"
            write_off(path, WEDGE * number, FACES)
    return tmp_path / "meshes"


def read_scanobjectnn(folder: Path, split: str) -> dict[str, np.ndarray]:
    """Read the only file of a split that there is."""
    (path,) = folder.glob(f"{split}_objectdataset*.h5")
    with h5py.File(path) as h5:
        return {name: h5[name][()] for name in ("data", "label", "mask")}


def test_scanobjectnn_counts_its_own_fifteen_classes(run: Run, meshes: Path, tmp_path: Path) -> None:
    said = "no class gadget, xbox: 6 of 12 meshes are left out"
    run(f"generate {meshes} --out out {SMALL} --format scanobjectnn", says=said)
    assert (tmp_path / "out" / "training_objectdataset_augmentedrot_scale75.h5").is_file()
    for split, n in (("training", 2), ("test", 1)):
        labels = read_scanobjectnn(tmp_path / "out", split)["label"]
        assert {label: int((labels == label).sum()) for label in np.unique(labels)} == {4: 3 * n, 9: 3 * n}
    names = (tmp_path / "out" / "shape_names.txt").read_text().split("\n")
    assert (names[4], names[9], len(list(filter(None, names)))) == ("chair", "table", 15)
    run(f"verify out {meshes}")


def test_modelnet_o_has_all_clouds_of_an_object_in_one_frame(run: Run, meshes: Path, tmp_path: Path) -> None:
    run(f"generate {meshes} --out out {SMALL} --format modelnet-o")
    run(f"generate {meshes} --out own {SMALL} --format modelnet-o --scale mesh")
    names = [f"chair/test/chair_0003_{number:03d}.xyz" for number in (1, 2, 3)]
    clouds, own = (np.concatenate([np.loadtxt(tmp_path / out / name) for name in names]) for out in ("out", "own"))
    assert off_surface(own, 3 * WEDGE) < 1e-5, "z up"
    assert np.allclose(clouds, similar(own, clouds), atol=1e-5)


@pytest.mark.parametrize("format", ["scanobjectnn", "modelnet40-c", "modelnet-o"])
def test_meshes_of_no_listed_class_are_refused(run: Run, meshes: Path, tmp_path: Path, format: str) -> None:
    outcome = run(f"generate {meshes} --out out {SMALL} --format {format} --classes gadget", code=2, says=format)
    assert "got gadget" in outcome.err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("between", ["packed", "npz"])
def test_a_converted_dataset_counts_and_leaves_out_alike(run: Run, meshes: Path, tmp_path: Path, between: str) -> None:
    run(f"generate {meshes} --out all {SMALL} --format {between}")
    said = "no class gadget, xbox: 6 of 12 meshes are left out"
    run("convert all --format scanobjectnn --out theirs", says=said)
    labels = read_scanobjectnn(tmp_path / "theirs", "training")["label"]
    assert {label: int((labels == label).sum()) for label in np.unique(labels)} == {4: 6, 9: 6}
    run(f"verify theirs {meshes}")
    counts = json.loads((tmp_path / "theirs" / "manifest.json").read_text())["counts"]
    assert (counts["clouds"], counts["clouds_by_split"]) == (18, {"train": 12, "test": 6})
    assert counts["meshes"] == 6


@pytest.mark.parametrize("keep", ["box", "all"])
def test_points_of_the_background_have_the_mask_minus_one(run: Run, tmp_path: Path, keep: str) -> None:
    """A chair-sized wedge on the ground: what lies on the ground is the background. y is up."""
    write_off(tmp_path / "meshes" / "chair" / "train" / "chair_0001.off", WEDGE, FACES)
    scanned = f"--sensor pinhole:width=120,height=90,fov=60 --scene ground --keep {keep} --size 1 --range 3"
    made = "--views ring:2@30 --scale mesh --sample-size 2000 --workers 1 --format scanobjectnn"
    run(f"generate meshes {scanned} {made} --out out")
    found = read_scanobjectnn(tmp_path / "out", "training")
    assert set(np.unique(found["mask"])) == {-1, 0}
    on_ground = np.abs(found["data"][:, :, 1] - found["data"][:, :, 1].min()) < 1e-6
    assert 0.01 < on_ground.mean() < 0.99
    assert (found["mask"] == np.where(on_ground, -1, 0)).all()


def test_modelnet40_c_has_the_originals_frame_and_scale(run: Run, tmp_path: Path) -> None:
    """jiachens/ModelNet40-C, data/generate_c.py: (-x, z, y); each cloud's box is centred, its longest side 2."""
    write_off(tmp_path / "meshes" / "chair" / "test" / "chair_0001.off", WEDGE, FACES)
    levels = {}
    for scale in ("cloud", "object", "mesh"):
        run(f"generate meshes {SMALL} --out {scale} --scale {scale} --format modelnet40-c")
        levels[scale] = [np.load(tmp_path / scale / f"data_occlusion_{level}.npy")[0] for level in (1, 2, 3)]
    assert off_surface(np.concatenate(levels["mesh"]), WEDGE[:, [0, 2, 1]] * [-1, 1, 1]) < 1e-5
    whole, own = np.concatenate(levels["object"]), np.concatenate(levels["mesh"])
    assert np.allclose(whole, similar(own, whole), atol=1e-5)
    assert np.ptp(whole, axis=0).max() / np.ptp(own, axis=0).max() == pytest.approx(2 / 5, rel=0.1)
    for cloud, own in zip(levels["cloud"], levels["mesh"], strict=True):
        low, high = cloud.min(axis=0), cloud.max(axis=0)
        assert np.allclose(low + high, 0, atol=1e-5)
        assert (high - low).max() == pytest.approx(2)
        assert np.allclose(cloud, similar(own, cloud), atol=1e-5)


def test_modelnet40_c_of_a_spinning_sensor_is_its_corruption_lidar(run: Run, tmp_path: Path) -> None:
    write_off(tmp_path / "meshes" / "chair" / "test" / "chair_0001.off", WEDGE, FACES)
    run("generate meshes --preset modelnet40-c-lidar --out out --workers 1")
    assert not list((tmp_path / "out").glob("data_occlusion_*"))
    turned = (WEDGE - WEDGE.max(axis=0) / 2)[:, [0, 2, 1]] * [-1, 1, 1] * 2 / 5
    for level in range(1, 6):
        cloud = np.load(tmp_path / "out" / f"data_lidar_{level}.npy")
        assert cloud.shape == (1, 768, 3)
        assert off_surface(cloud[0], turned) < 1e-5


def test_modelnet40_normal_as_its_loaders_read_it(run: Run, meshes: Path, tmp_path: Path) -> None:
    """A shape's class is its name before the last "_"; columns are x, y, z and the normal, both y up."""
    out = tmp_path / "out"
    run(f"generate {meshes} --out {out} {SMALL} --format modelnet40-normal --with normals --scale mesh")
    names = (out / "modelnet40_shape_names.txt").read_text().splitlines()
    assert (len(names), names[8], names[39]) == (40, "chair", "xbox")
    shapes = {split: (out / f"modelnet40_{split}.txt").read_text().split() for split in ("train", "test")}
    assert {split: len(of) for split, of in shapes.items()} == {"train": 3 * 2 * 3, "test": 3 * 3}
    assert not set(shapes["train"]) & set(shapes["test"])
    turned = WEDGE[:, [0, 2, 1]] * [-1, 1, 1]
    for shape in shapes["test"]:
        label = "_".join(shape.split("_")[:-1])
        assert label in ("chair", "table", "xbox")
        columns = np.loadtxt(out / label / f"{shape}.txt", delimiter=",")
        assert off_surface(columns[:, :3] / 3, turned) < 1e-5
        heights, outwards = heights_over_faces(columns[:, :3] / 3, turned)
        assert np.allclose(columns[:, 3:], outwards[heights.argmax(axis=1)], atol=1e-5)
    run(f"verify {out} {meshes}")
