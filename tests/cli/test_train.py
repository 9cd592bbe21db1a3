"""train and evaluate: from a dataset to a model and its scores; one-line errors."""

import json
from pathlib import Path

import numpy as np
import pytest

from tests.cli.conftest import Run, write_off
from tests.scenes import box
from tests.test_light_import import run as run_program

pytest.importorskip("torch", reason="torch is not installed: pip install 'zbuf-occlude[learn]'")

SMALL = "--views fibonacci:6 --points 200 --sample-size 48 --method oracle --workers 1"
QUICK = "--epochs 2 --batch-size 8 --device cpu"


def test_from_a_dataset_to_figures(run: Run, modelnet: Path, tmp_path: Path) -> None:
    model = tmp_path / "model"
    run(f"generate {modelnet} {SMALL} --out clouds")
    # of four objects to train on one is held out, with its six clouds
    trained = run(f"train clouds {QUICK} --out model", says="18 clouds to train on, 6 to validate with")
    history = json.loads((model / "history.json").read_text())
    assert len(history["history"]) == 2
    best = history["best"]
    share = f"{best['validation_accuracy']:.1%} of the validation after epoch {best['number']} of 2"
    assert f"voxnet, 916,834 parameters, 2 classes: {share}" in trained.out
    assert run(f"train clouds {QUICK} --out model").out == trained.out
    tested = run("evaluate model clouds --out figures --device cpu")
    document = json.loads((tmp_path / "figures" / "evaluation.json").read_text())
    assert np.sum(document["confusion"], axis=1).tolist() == [12, 12]
    low, high = (100 * bound for bound in document["scores"]["accuracy"][1:])
    assert f"accuracy {document['accuracy']:.1%} ({low:.1f}-{high:.1f}) of 24 clouds" in tested.out
    assert [line.split()[:2] for line in tested.out.splitlines()[1:3]] == [["ball", "12"], ["brick", "12"]]
    assert (tmp_path / "figures" / "evaluation.png").read_bytes()[1:4] == b"PNG"
    run(f"train clouds {QUICK} --seed 1 --out model", code=1, says="must be empty or hold this same training")


def test_points_and_several_folders(run: Run, modelnet: Path, tmp_path: Path) -> None:
    run(f"generate {modelnet} {SMALL} --out one")
    run(f"generate {modelnet} {SMALL} --format packed --out two")
    said = "36 clouds to train on, 12 to validate with"
    run(f"train one two {QUICK} --epochs 1 --points 20 --no-rotate --out model", says=said)
    config = json.loads((tmp_path / "model" / "history.json").read_text())["config"]
    assert (config["n_points"], config["rotate"], config["jitter"]) == (20, False, True)
    assert "of 48 clouds" in run("evaluate model one two --device cpu").out
    run(f"generate {modelnet} {SMALL} --sample-size 19 --out small")
    said = "must have at least the 20 points that the model was trained with; those of DIR have 19"
    run("evaluate model small --device cpu", code=1, says=said)


def check_that_no_shared_class_is_said(run: Run, *labels: str) -> None:
    outcome = run(f"train clouds {QUICK} --out model", code=1, says="must share a class")
    assert not Path("model").exists()
    for word in (*labels, "--limit"):
        assert word in outcome.err


def test_splits_that_share_no_class_are_refused(run: Run) -> None:
    run(f"generate --limit 6 {SMALL} --out clouds")
    check_that_no_shared_class_is_said(run, "airplane", "bed")


def test_a_test_split_of_other_classes_is_refused(run: Run, modelnet: Path) -> None:
    """Validation is held out of train and shares its classes; the test split does not."""
    for label in ("ball", "brick"):
        (modelnet / f"{label}s").mkdir()
        (modelnet / label / "test").rename(modelnet / f"{label}s" / "test")
    run(f"generate {modelnet} {SMALL} --out clouds")
    check_that_no_shared_class_is_said(run, "ball", "balls")


def test_a_class_that_is_tested_and_not_trained_is_said(run: Run, modelnet: Path, tmp_path: Path) -> None:
    """One of three classes has no training object; the others have three each."""
    for name in ("cube", "ball", "brick"):
        for number in (2, 3):
            source = modelnet / ("ball" if name == "ball" else "brick") / "train"
            target = modelnet / name / ("val" if name == "cube" else "train") / f"{name}_{number}.off"
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(next(source.iterdir()).read_bytes())
    (modelnet / "ball" / "val").mkdir()
    (modelnet / "ball" / "train" / "ball_3.off").rename(modelnet / "ball" / "val" / "ball_3.off")
    run(f"generate {modelnet} {SMALL} --out clouds")
    said = "warning: val has classes without training clouds: cube"
    assert "warning: test" not in run(f"train clouds {QUICK} --out model", says=said).err


def test_what_is_wrong_is_one_line(run: Run, modelnet: Path) -> None:
    run(f"generate {modelnet} {SMALL} --out clouds")
    for line, code, said in (
        ("train meshes --out model", 1, "must hold a dataset"),
        ("train clouds --out model --device tpu", 2, "device must be auto, cpu, cuda or cuda:N; got 'tpu'"),
        ("train clouds --out model --points 49 --device cpu", 2, "n_points must be at most 48"),
        ("train clouds --out model --learning-rate -1", 2, "learning_rate must be a positive number"),
        ("train --out model", 2, "Missing argument 'DIR...'"),
        (f"train clouds --out model --seed {10**30} --device cpu", 2, "seed must be at most 9,223,"),
        ("train clouds --out clouds/manifest.json", 2, "manifest.json' is a file."),
        ("evaluate model clouds --out clouds/manifest.json", 2, "manifest.json' is a file."),
        ("evaluate model clouds", 1, "must hold a trained model; it has no model.pt"),
    ):
        run(line, code=code, says=said)
    run(f"train clouds {QUICK} --epochs 1 --out model")
    (modelnet / "brick").rename(modelnet / "wall")
    run(f"generate {modelnet} {SMALL} --out others")
    said = "must have the classes of the model, ball, brick; they have ball, wall"
    run("evaluate model others --device cpu", code=1, says=said)


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


def test_the_number_of_points_is_that_of_the_training(
    run: Run, modelnet: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without --points too: others would be other clouds than the network knows."""
    import zbuf_occlude as zo
    from zbuf_occlude.studies.learn import evaluation, training

    run(f"generate {modelnet} {SMALL} --out clouds")
    run(f"generate {modelnet} {SMALL} --sample-size 60 --out larger")
    run(f"train clouds {QUICK} --epochs 1 --model pointnet --out model")
    sizes = []
    predict = evaluation.predict
    for module in (training, __import__("zbuf_occlude.studies.learn.breakdown", fromlist=["predict"])):
        monkeypatch.setattr(module, "predict", lambda model, each: sizes.append(each.n_points) or predict(model, each))
    run("evaluate model larger --device cpu")
    zo.load_classifier("model").predict(np.random.default_rng(0).normal(size=(700, 3)))
    assert sizes == [48, 48]


def test_objects_in_train_of_one_and_test_of_another_are_said(run: Run, tmp_path: Path) -> None:
    ball = box()
    for label in ("ball", "brick"):
        for number in range(12):
            write_off(tmp_path / "plain" / label / f"{number}.off", ball.vertices, ball.faces)
    for seed in (1, 2):
        run(f"generate plain {SMALL} --split 0.5,0,0.5 --seed {seed} --out clouds{seed}")
    plans = [json.loads((tmp_path / f"clouds{seed}/plan.json").read_text())["meshes"] for seed in (1, 2)]
    parts = [{split: {key for key, _, at, *_ in plan if at == split} for split in ("train", "test")} for plan in plans]
    shared = (parts[0]["test"] & parts[1]["train"]) | (parts[1]["test"] & parts[0]["train"])
    n = len(parts[0]["test"] | parts[1]["test"])
    run(f"train clouds1 clouds2 {QUICK} --epochs 1 --out model", says=f"warning: {len(shared)} of {n} objects of test")
    assert "warning" not in run(f"train clouds1 {QUICK} --epochs 1 --out alone").err
