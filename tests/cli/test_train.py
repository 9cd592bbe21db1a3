"""train and evaluate: from a dataset to a model and its figures; what is wrong is said in one line."""

import json
from pathlib import Path

import numpy as np
import pytest

from tests.cli.conftest import Run
from tests.test_light_import import run as run_program

pytest.importorskip("torch", reason="torch is not installed: pip install 'zbuf-occlude[learn]'")

SMALL = ("--views", "fibonacci:6", "--points", 200, "--sample-size", 48, "--method", "oracle", "--workers", 1)
QUICK = ("--epochs", 2, "--batch-size", 8, "--device", "cpu")


def test_from_a_dataset_to_figures(run: Run, modelnet: Path, tmp_path: Path) -> None:
    dataset, model = tmp_path / "clouds", tmp_path / "model"
    assert run("generate", modelnet, *SMALL, "--out", dataset).code == 0
    trained = run("train", dataset, *QUICK, "--out", model)
    assert trained.code == 0, trained.err
    # of four objects to train on one is held out, with its six clouds
    assert "18 clouds to train on, 6 to validate with" in trained.err
    history = json.loads((model / "history.json").read_text())
    assert len(history["history"]) == 2
    best = history["best"]
    share = f"{best['validation_accuracy']:.1%} of the validation after epoch {best['number']} of 2"
    assert f"voxnet, 916,834 parameters, 2 classes: {share}" in trained.out
    again = run("train", dataset, *QUICK, "--out", model)
    assert (again.code, again.out) == (0, trained.out), "what is done is done"
    tested = run("evaluate", model, dataset, "--out", tmp_path / "figures", "--device", "cpu")
    assert tested.code == 0, tested.err
    document = json.loads((tmp_path / "figures" / "evaluation.json").read_text())
    assert np.sum(document["confusion"], axis=1).tolist() == [12, 12]
    assert f"accuracy {document['accuracy']:.1%} of 24 clouds" in tested.out
    assert [line.split()[:2] for line in tested.out.splitlines()[1:3]] == [["ball", "12"], ["brick", "12"]]
    assert (tmp_path / "figures" / "evaluation.png").read_bytes()[1:4] == b"PNG"
    other = run("train", dataset, *QUICK, "--seed", 1, "--out", model)
    assert other.code == 1
    assert "must be empty or of this same training" in other.err


def test_points_and_several_folders(run: Run, modelnet: Path, tmp_path: Path) -> None:
    one, two, model = tmp_path / "one", tmp_path / "two", tmp_path / "model"
    for out, format in ((one, "hdf5"), (two, "packed")):
        assert run("generate", modelnet, *SMALL, "--format", format, "--out", out).code == 0
    trained = run("train", one, two, *QUICK, "--epochs", 1, "--points", 20, "--no-rotate", "--out", model)
    assert trained.code == 0, trained.err
    assert "36 clouds to train on, 12 to validate with" in trained.err
    config = json.loads((model / "history.json").read_text())["config"]
    assert (config["n_points"], config["rotate"], config["jitter"]) == (20, False, True)
    assert "of 48 clouds" in run("evaluate", model, one, two, "--device", "cpu").out
    assert run("generate", modelnet, *SMALL, "--sample-size", 19, "--out", tmp_path / "small").code == 0
    outcome = run("evaluate", model, tmp_path / "small", "--device", "cpu")
    assert outcome.code == 1
    assert "must have clouds of the 20 points that the model was trained with, at least; theirs have 19" in outcome.err


def test_splits_that_share_no_class_are_refused(run: Run, tmp_path: Path) -> None:
    few, model = tmp_path / "few", tmp_path / "model"
    assert run("generate", "--limit", 6, *SMALL, "--out", few).code == 0
    outcome = run("train", few, *QUICK, "--out", model)
    assert (outcome.code, model.exists()) == (1, False)
    for word in ("error: ", "must share a class", "airplane", "bed", "--limit"):
        assert word in outcome.err
    assert "Traceback" not in outcome.err


def test_a_test_split_of_other_classes_is_refused(run: Run, modelnet: Path, tmp_path: Path) -> None:
    """What validates is held out of train, and shares its classes; the test split does not."""
    for mesh in list(modelnet.rglob("*.off")):
        other = mesh.parent.parent.name + "s"
        target = modelnet / (other if mesh.parent.name == "test" else mesh.parent.parent.name) / mesh.parent.name
        target.mkdir(parents=True, exist_ok=True)
        mesh.rename(target / mesh.name)
    assert run("generate", modelnet, *SMALL, "--out", tmp_path / "clouds").code == 0
    outcome = run("train", tmp_path / "clouds", *QUICK, "--out", tmp_path / "model")
    assert (outcome.code, (tmp_path / "model").exists()) == (1, False)
    for word in ("error: ", "must share a class", "ball", "balls", "--limit"):
        assert word in outcome.err


def test_a_class_that_is_tested_and_not_trained_is_said(run: Run, modelnet: Path, tmp_path: Path) -> None:
    """Of three classes one has no object to train on; of the two others three objects each."""
    for name in ("cube", "ball", "brick"):
        for number in (2, 3):
            source = modelnet / ("ball" if name == "ball" else "brick") / "train"
            target = modelnet / name / ("val" if name == "cube" else "train") / f"{name}_{number}.off"
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(next(source.iterdir()).read_bytes())
    (modelnet / "ball" / "val").mkdir()
    (modelnet / "ball" / "train" / "ball_3.off").rename(modelnet / "ball" / "val" / "ball_3.off")
    assert run("generate", modelnet, *SMALL, "--out", tmp_path / "clouds").code == 0
    outcome = run("train", tmp_path / "clouds", *QUICK, "--out", tmp_path / "model")
    assert outcome.code == 0, outcome.err
    assert "warning: val has classes that are not trained on: cube" in outcome.err
    assert "warning: test" not in outcome.err


def test_what_is_wrong_is_one_line(run: Run, modelnet: Path, tmp_path: Path) -> None:
    out, model = tmp_path / "clouds", tmp_path / "model"
    assert run("generate", modelnet, *SMALL, "--out", out).code == 0
    for arguments, code, message in (
        (("train", tmp_path, "--out", model), 1, "must hold a dataset"),
        (("train", out, "--out", model, "--device", "tpu"), 2, "device must be auto, cpu, cuda or cuda:N; got 'tpu'"),
        (("train", out, "--out", model, "--points", 49, "--device", "cpu"), 2, "n_points must be at most 48"),
        (("train", out, "--out", model, "--learning-rate", -1), 2, "learning_rate must be a positive number"),
        (("train", "--out", model), 2, "Missing argument 'DIR...'"),
        (
            ("train", out, "--out", model, "--seed", 10**30, "--device", "cpu"),
            2,
            "seed must be at most 9,223,",
        ),
        (("train", out, "--out", out / "manifest.json"), 2, "manifest.json' is a file."),
        (("evaluate", model, out, "--out", out / "manifest.json"), 2, "manifest.json' is a file."),
        (("evaluate", model, out), 1, "must hold a trained model; it has no model.pt"),
    ):
        outcome = run(*arguments)
        assert (outcome.code, message in outcome.err) == (code, True), outcome
        assert "Traceback" not in outcome.err
    assert run("train", out, *QUICK, "--epochs", 1, "--out", model).code == 0
    (tmp_path / "meshes" / "brick").rename(tmp_path / "meshes" / "wall")
    assert run("generate", modelnet, *SMALL, "--out", tmp_path / "others").code == 0
    outcome = run("evaluate", model, tmp_path / "others", "--device", "cpu")
    assert outcome.code == 1
    assert "must have the classes of the model, ball, brick; they have ball, wall" in outcome.err


@pytest.mark.parametrize("command", ["train", "evaluate", "paper table3"])
def test_without_torch_help_teaches_and_the_rest_names_the_extra(command: str) -> None:
    start = (
        f"import sys\nsys.modules['torch'] = None\nsys.argv = ['zbuf-occlude', *{command.split()}, *ARGUMENTS]\n"
        "from zbuf_occlude.__main__ import main\n"
    )
    helped = start.replace("*ARGUMENTS", "'--help'") + "main()"
    assert f"Usage: zbuf-occlude {command}" in run_program(helped)
    asked = start.replace("*ARGUMENTS", "'--out', 'c'" if " " in command else "'a', 'b', '--out', 'c'") + (
        "sys.stderr = sys.stdout\n"
        "try:\n    main()\n"
        "except SystemExit as leaving:\n    sys.stdout.write(f'exit {leaving.code}')\n"
    )
    answer = run_program(asked)
    assert "the package torch; install it: pip install 'zbuf-occlude[learn]'" in answer
    assert answer.endswith("exit 1")
    assert len(answer.splitlines()) == 2
