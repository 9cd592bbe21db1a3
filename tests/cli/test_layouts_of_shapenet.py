"""Layouts made of ShapeNet, from the command line to their files: up axis, lists, the files of older loaders."""

import json
from pathlib import Path

import h5py
import numpy as np
import pytest

from tests.cli.conftest import Run, write_off
from tests.cli.test_published_layouts import FACES, WEDGE, off_surface

SYNSET, MODEL = "03001627", "1a6f615e8b1b5ae4dbbc9440457e303e"
MODELS = {split: MODEL[:-1] + str(number) for number, split in enumerate(("train", "val", "test"))}
NPY = "shapenet_pc/{synset}-{model}.npy"
LAYOUTS = {
    "pcn": (8, "{split}/partial/{synset}/{model}/*.pcd", "{split}/complete/{synset}/{model}.pcd"),
    "completion3d": (1, "{split}/partial/{synset}/{model}.h5", "{split}/gt/{synset}/{model}.h5"),
    "mvp": (26, "MVP_{Split}_CP.h5", "MVP_{Split}_CP.h5"),
    "projected-shapenet": (16, "projected_partial_noise/{synset}/{model}/models/*.pcd", NPY),
    "shapenet55": (1, NPY, NPY),
}
"""Views of an object, and where its partial and complete clouds are."""
Y_UP = WEDGE[:, [0, 2, 1]] * [1, 1, -1]
"""The wedge as files with y up have it."""


def read_points(path: Path, key: str) -> np.ndarray:
    """Read all points (n, 3) of a cloud's file."""
    if path.suffix == ".h5":
        with h5py.File(path) as h5:
            return np.asarray(h5[key if key in h5 else "data"][()]).reshape(-1, 3)
    if path.suffix == ".npy":
        return np.asarray(np.load(path))
    return np.frombuffer(path.read_bytes().partition(b"DATA binary\n")[2], "<f4").reshape(-1, 3)


def read_pair(root: Path, layout: str, split: str) -> list[np.ndarray]:
    """Read all partial clouds of a split's object, and its complete one."""
    _, *patterns = LAYOUTS[layout]
    words = {"split": split, "Split": split.capitalize(), "synset": SYNSET, "model": MODELS[split]}
    keys = ("incomplete_pcds", "complete_pcds")
    found = [sorted(root.glob(pattern.format(**words))) for pattern in patterns]
    assert all(found)
    return [np.concatenate([read_points(path, key) for path in paths]) for paths, key in zip(found, keys, strict=True)]


@pytest.fixture
def shapenet(tmp_path: Path) -> Path:
    """ShapeNet's folders: one object for each split, y up."""
    root = tmp_path / "ShapeNetCore.v2"
    for model in MODELS.values():
        path = root / SYNSET / model / "models" / "model_normalized.obj"
        path.parent.mkdir(parents=True)
        lines = [*(f"v {x} {y} {z}" for x, y, z in Y_UP), *(f"f {a + 1} {b + 1} {c + 1}" for a, b, c in FACES)]
        path.write_text("\n".join(lines) + "\n")
    index = {"taxonomy_id": SYNSET, "taxonomy_name": "chair", **{split: [model] for split, model in MODELS.items()}}
    (root / "PCN.json").write_text(json.dumps([index]))
    return root


def generated(run: Run, meshes: Path, out: Path, layout: str, options: str = "") -> Path:
    """Make a dataset of cameras that look down on the object, steeply."""
    views = f"--views ring:{LAYOUTS[layout][0]}@60 --scale mesh --method exact --workers 1"
    run(f"generate {meshes} --out {out} --format {layout} {views} {options}")
    return out


@pytest.mark.parametrize("layout", LAYOUTS)
def test_files_with_y_up_stay_y_up_and_cameras_stand_about_the_vertical(
    run: Run, shapenet: Path, tmp_path: Path, layout: str
) -> None:
    root = generated(run, shapenet, tmp_path / "out", layout)
    for split in ("train", "test"):
        partial, complete = read_pair(root, layout, split)
        assert off_surface(partial, Y_UP) < 1e-3
        assert off_surface(complete, Y_UP) < 1e-3
        assert (complete[:, 1] < 1e-3).mean() > 0.05, "the complete cloud has the underside"
        if layout != "shapenet55":
            assert (partial[:, 1] < 1e-3).mean() < 0.01, "cameras above do not see it"
    manifest = json.loads((root / "manifest.json").read_text())
    assert (manifest["up"], manifest["axes"]) == ("y", ["x", "z", "-y"])
    run(f"verify {root} {shapenet}")


@pytest.mark.parametrize("layout", LAYOUTS)
def test_files_with_z_up_come_out_y_up_unless_z_is_asked_for(run: Run, tmp_path: Path, layout: str) -> None:
    for split, model in MODELS.items():
        write_off(tmp_path / "meshes" / "chair" / split / f"{model}.off", WEDGE, FACES)
    for frame, wanted, up in ("", Y_UP, "y"), ("--frame z-up", WEDGE, "z"):
        root = generated(run, tmp_path / "meshes", tmp_path / f"{up}-up", layout, frame)
        files = [path for path in root.rglob("*") if path.suffix in (".pcd", ".npy") and "clouds_" not in path.name]
        files += [path for path in root.rglob("*.h5") if not path.name.startswith("mvp_")]
        assert all(off_surface(read_points(path, "complete_pcds"), wanted) < 1e-3 for path in files)
        assert json.loads((root / "manifest.json").read_text())["up"] == up


def test_clouds_converted_from_packed_are_y_up_too(run: Run, shapenet: Path, tmp_path: Path) -> None:
    for number, (frame, wanted) in enumerate((("", Y_UP), ("--frame z-up", WEDGE))):
        root = tmp_path / f"pcn{number}"
        views = "--views ring:8@60 --scale mesh --method exact --workers 1"
        run(f"generate {shapenet} --out packed{number} --format packed {views} {frame}")
        run(f"convert packed{number} --format pcn --out {root}")
        assert all(off_surface(cloud, wanted) < 1e-3 for cloud in read_pair(root, "pcn", "train"))


def test_normals_turn_along(run: Run, shapenet: Path, tmp_path: Path) -> None:
    root = generated(run, shapenet, tmp_path / "out", "pcn", "--with normals")
    body = (root / f"train/complete/{SYNSET}/{MODELS['train']}.pcd").read_bytes().partition(b"DATA binary\n")[2]
    table = np.frombuffer(body, "<f4").reshape(-1, 6)
    below = table[table[:, 1] < 1e-6]
    assert np.allclose(below[:, 3:], [0, -1, 0], atol=0.01)


def test_completion3d_names_its_categories(run: Run, shapenet: Path, tmp_path: Path) -> None:
    """The loader of lynetcha/completion3d splits each line at white space: NAME SYNSET."""
    root = generated(run, shapenet, tmp_path / "out", "completion3d")
    assert (root / "synsetoffset2category.txt").read_text().split() == ["chair", SYNSET]


def test_mvp_is_read_by_older_names_and_counts_its_sixteen_classes(run: Run, shapenet: Path, tmp_path: Path) -> None:
    root = generated(run, shapenet, tmp_path / "out", "mvp")
    for split in ("train", "test"):
        with (
            h5py.File(root / f"MVP_{split.capitalize()}_CP.h5") as new,
            h5py.File(root / f"mvp_{split}_input.h5") as old,
            h5py.File(root / f"mvp_{split}_gt_2048pts.h5") as complete,
        ):
            assert (new["labels"][()] == 3).all(), "chair is the fourth of its names"
            assert np.array_equal(old["labels"][()], new["labels"][()])
            assert np.array_equal(old["incomplete_pcds"][()], new["incomplete_pcds"][()])
            assert np.array_equal(complete["complete_pcds"][()], new["complete_pcds"][()])
            assert old["novel_incomplete_pcds"].shape == complete["novel_complete_pcds"].shape == (0, 2048, 3)
            assert old["novel_labels"].shape == (0,)
