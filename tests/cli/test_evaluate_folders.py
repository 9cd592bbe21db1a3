"""evaluate, train and crop on real clouds: folders by class, tables of boxes, several datasets, one cloud in Python."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from tests.cli.conftest import Run

pytest.importorskip("torch", reason="torch is not installed: pip install 'zbuf-occlude[learn]'")

import zbuf_occlude as zo
from zbuf_occlude.base.point_files import write_ply

QUICK = "--epochs 8 --patience 8 --batch-size 8 --model pointnet --points 32 --device cpu --no-rotate"
RNG = np.random.default_rng(2)


def blob(tall: bool, n: int) -> np.ndarray:
    """Return a tall or a flat cloud somewhere."""
    return RNG.uniform(-1, 1, (n, 3)) * ([0.3, 0.3, 1.0] if tall else [1.0, 1.0, 0.2]) + RNG.uniform(3, 9, 3)


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Clouds of unequal size by class: in PLY to train on; in other formats, of which some are called wrongly."""
    root = tmp_path_factory.mktemp("clouds")
    for number in range(16):
        for name in ("flat", "tall"):
            folder = root / "given" / name
            folder.mkdir(parents=True, exist_ok=True)
            write_ply(folder / f"{number}.ply", blob(name == "tall", 20 + 5 * number))
    for number in range(9):
        for name in ("flat", "tall"):
            folder = root / "tested" / name
            folder.mkdir(parents=True, exist_ok=True)
            points = blob((name == "tall") != (number % 3 == 0), 25 + number)  # every third is called wrongly
            if number % 2:
                np.save(folder / f"{number}.npy", points)
            else:
                write_ply(folder / f"{number}.ply", points)
    return root


def test_figures_are_those_of_a_count_by_hand(run: Run, root: Path, tmp_path: Path) -> None:
    run(f"train {root}/given {QUICK} --out model", says="29 clouds to train on, 3 to validate with")
    outcome = run(f"evaluate model {root}/tested --out figures --device cpu")
    model = zo.load_classifier("model", "cpu")
    classes = ("flat", "tall")
    counts = np.zeros((2, 2), int)
    for file in sorted((root / "tested").glob("*/*")):
        points = np.load(file) if file.suffix == ".npy" else read_doubles(file)
        counts[classes.index(file.parent.name), classes.index(model.predict(points))] += 1
    document = json.loads((tmp_path / "figures/evaluation.json").read_text())
    assert document["confusion"] == counts.tolist()
    assert counts.sum() == 18
    assert np.trace(counts) == 12, "those that are called right: the clouds are easy"
    recall = np.diag(counts) / counts.sum(axis=1)
    f1 = [2 * counts[i, i] / (counts[i].sum() + counts[:, i].sum()) for i in range(2)]
    assert [document["scores"][name][0] for name in ("accuracy", "recall", "f1")] == pytest.approx(
        [12 / 18, recall.mean(), np.mean(f1)]
    )
    low, high = document["scores"]["accuracy"][1:]
    assert low < 12 / 18 < high
    assert "accuracy 66.7% (" in outcome.out
    assert "over 18 sweeps or objects" in outcome.out
    assert (tmp_path / "figures/evaluation.png").read_bytes()[1:4] == b"PNG"


def read_doubles(path: Path) -> np.ndarray:
    """Return the vertices of a binary PLY of doubles, without the product's reader."""
    return np.frombuffer(path.read_bytes().partition(b"end_header\n")[2], "<f8").reshape(-1, 3)


def test_one_cloud_in_python(root: Path, tmp_path: Path) -> None:
    from zbuf_occlude.studies.learn.data import load_datasets
    from zbuf_occlude.studies.learn.training import TrainConfig, hold_out, train

    clouds = load_datasets([root / "given"], "train", 32)
    config = TrainConfig("pointnet", epochs=8, batch_size=8, n_points=32, rotate=False, device="cpu")
    train(config, *hold_out(clouds, 0.1, 0), tmp_path)
    model = zo.load_classifier(tmp_path, "cpu")
    cloud = blob(True, 500)
    shares = model.probabilities(cloud)
    assert list(shares) == ["flat", "tall"]
    assert sum(shares.values()) == pytest.approx(1.0, abs=1e-6)
    assert model.predict(cloud) == "tall" == max(shares, key=lambda name: shares[name])
    assert model.predict(1000.0 * cloud) == "tall", "in any unit"
    far = model.probabilities(cloud + np.array([5e5, 5.4e6, 100.0]))
    assert far == pytest.approx(shares, abs=1e-4), "georeferenced"
    with pytest.raises(zo.ArgumentError, match="folder must be a path; got None"):
        zo.load_classifier(None)  # type: ignore[arg-type]
    with pytest.raises(zo.ArgumentError, match="points must be"):
        model.predict(np.zeros((0, 3)))
    with pytest.raises(zo.ArgumentError, match="points must be finite"):
        model.predict([[np.nan, 0, 0]])


def test_classes_of_several_datasets_are_joined_by_name(run: Run, root: Path, tmp_path: Path) -> None:
    for number in range(8):
        for name in ("tall", "cube"):
            (tmp_path / "more" / name).mkdir(parents=True, exist_ok=True)
            np.save(tmp_path / "more" / name / f"{number}.npy", RNG.uniform(-1, 1, (40, 3)))
    run(f"train {root}/given more {QUICK} --epochs 1 --out model")
    assert zo.load_classifier("model", "cpu").classes == ("cube", "flat", "tall")
    assert "of 18 clouds" in run(f"evaluate model {root}/tested --device cpu").out, "fewer classes than the model"
    said = run(f"evaluate model more {tmp_path}/more --device cpu", code=1, says="must be different folders").err
    assert "more is given 2 times" in said
    (tmp_path / "more" / "tall").rename(tmp_path / "more" / "Tall")
    said = run(f"train {root}/given more {QUICK} --out other", code=1, says="datasets must share a class").err
    assert "more has Tall, cube, the others have flat, tall" in said
    said = run("evaluate model more --device cpu", code=1, says="must have the classes of the model").err
    assert "cube, flat, tall; they have Tall, cube" in said


def test_splits_of_folders(run: Run, root: Path, tmp_path: Path) -> None:
    (tmp_path / "split").mkdir()
    (tmp_path / "split" / "train").symlink_to(root / "given")
    (tmp_path / "split" / "test").symlink_to(root / "tested")
    run(f"train split {QUICK} --epochs 1 --out model", says="29 clouds to train on")
    assert "of 18 clouds" in run("evaluate model split --device cpu").out
    run("evaluate model split --split val --device cpu", code=1, says="it has train, test")
    (tmp_path / "deep" / "a" / "b").mkdir(parents=True)
    np.save(tmp_path / "deep" / "a" / "b" / "c.npy", np.ones((3, 3)))
    run("evaluate model deep --device cpu", code=1, says="must lie in CLASS or in SPLIT/CLASS")


def test_crops_are_tested_by_range_and_over_sweeps(run: Run, root: Path, tmp_path: Path) -> None:
    rows = []
    for number in range(6):
        clouds = []
        for place, label in ((8.0, "Flat"), (25.0, "Tall"), (45.0, "Rock")):
            points = RNG.uniform(-1, 1, (30, 3)) * ([0.3, 0.3, 1] if label == "Tall" else [1, 1, 0.2])
            clouds.append(points + np.array([place, 0.0, 0.0]))
            rows.append([f"{number}.npy", label, place, 0, 0, 2, 2, 2 + number / 10])
        np.save(tmp_path / f"{number}.npy", np.concatenate(clouds))
    with (tmp_path / "boxes.csv").open("w", newline="") as file:
        csv.writer(file).writerows([["file", "label", "x", "y", "z", "length", "width", "height"], *rows])
    line = "crop boxes.csv --classes flat=Flat,tall=Tall --ground none --out crops"
    outcome = run(line)
    words = [row.split() for row in outcome.out.splitlines()]
    assert words[0] == ["class", "0-10", "m", "20-30", "m", "all"]
    assert words[1:4] == [["flat", "6", "0", "6"], ["tall", "0", "6", "6"], ["2", "classes", "6", "6", "12"]]
    assert "12 crops of 6 sweeps (box table)" in outcome.out
    assert "left out: 6 of other labels" in outcome.out
    run(line, code=1, says="must be an empty folder")
    said = run(f"{line}2 --least-points 99", code=1, says="none is left").err
    assert "12 with fewer than 99 points, 6 of other labels" in said
    said = run("crop boxes.csv --classes flat=Flat,rock=Rok --ground none --out crops3").err
    assert "class rock has no box" in said
    run(f"train {root}/given crops {QUICK} --out model")
    tested = run("evaluate model crops --device cpu --out figures").out
    document = json.loads((tmp_path / "figures/evaluation.json").read_text())
    assert document["n_groups"] == 6, "two crops of each sweep"
    assert [(row["from"], row["to"], row["n_clouds"]) for row in document["by_range"]] == [(0, 10, 6), (20, 30, 6)]
    assert "0-10       6" in tested


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ("--classes car=Car,car=Van", "each class once"),
        ("--classes car=", "must have a name and labels"),
        ("--ground flat", "--ground must be fit, none or a number"),
        ("--range far", "--range must be a number, or two"),
        ("--range 30..5", "range must be metres A..B"),
        ("--frame world", "must be one of object, sensor"),
    ],
)
def test_mistaken_options(run: Run, tmp_path: Path, options: str, words: str) -> None:
    (tmp_path / "boxes.csv").write_text("file,label,x,y,z,length,width,height\na.npy,Car,1,2,3,4,2,1.5\n")
    run(f"crop boxes.csv {options} --out crops", code=2, says=words)


def test_a_damaged_cloud_is_named_and_the_others_are_cropped(run: Run, tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", RNG.uniform(0, 1, (40, 3)))
    (tmp_path / "b.npy").write_bytes(b"no")
    rows = "".join(f"{name}.npy,Car,.5,.5,.5,1,1,1\n" for name in "ab")
    (tmp_path / "boxes.csv").write_text(f"file,label,x,y,z,length,width,height\n{rows}")
    outcome = run("crop boxes.csv --ground none --out crops", code=3, says="1 sweep could not be read")
    assert "b.npy: cannot read the points" in outcome.err
    assert "1 crop of 1 sweep" in outcome.out


def test_places_that_are_no_source(run: Run, tmp_path: Path) -> None:
    run("crop nowhere --out crops", code=1, says="nowhere does not exist")
    (tmp_path / "empty").mkdir()
    run("crop empty --out crops", code=1, says="one of these layouts: KITTI")
    run("evaluate empty empty --device cpu", code=1, says="must hold a trained model")
