"""`generate --format`, `generate --preset`, `convert`: from the command line to the files."""

import json
from pathlib import Path

import pytest

from tests.cli.conftest import Run
from zbuf_occlude.dataset.source import open_dataset

SMALL = ("--method", "oracle", "--views", "ring:4@30", "--points", 300, "--sample-size", 32, "--workers", 1)


@pytest.mark.parametrize(
    ("format", "file"),
    [
        ("hdf5", "ply_data_train0.h5"),
        ("packed", "packed-000000.zip"),
        ("webdataset", "train-000000.tar"),
        ("npz", "test-000000.npz"),
        ("ply", "ply/test/table/*.ply"),
        ("huggingface", "data/test-000000.parquet"),
        ("scanobjectnn", "training_objectdataset_augmentedrot_scale75.h5"),
        ("modelnet40-c", "data_occlusion_4.npy"),
        ("modelnet-o", "table/test/brick_1_004.xyz"),
    ],
)
def test_every_format_from_the_command_line(run: Run, furniture: Path, tmp_path: Path, format: str, file: str) -> None:
    out, modelnet = tmp_path / "out", furniture
    outcome = run("generate", modelnet, "--out", out, *SMALL, "--format", format)
    assert outcome.code == 0, outcome.err
    assert list(out.glob(file))
    assert not {path.name for path in out.iterdir()} & {"work", "stored"}
    document = json.loads((out / "manifest.json").read_text())
    assert document["format"] == format
    assert document["counts"]["clouds_by_split"] == {"train": 16, "test": 16}
    if format in ("hdf5", "packed", "webdataset", "npz"):
        assert open_dataset(out).n_clouds == {"train": 16, "test": 16}
    assert run("generate", modelnet, "--out", out, *SMALL, "--format", format).out == outcome.out
    outcome = run("generate", modelnet, "--out", out, *SMALL, "--format", format, "--seed", 1, "--overwrite")
    assert outcome.code == 0, outcome.err
    kept = {path.name for path in out.rglob("*") if path.is_file()}
    assert run("generate", modelnet, "--out", out, *SMALL, "--format", "npz", "--overwrite").code == 0
    left = {path.name for path in out.rglob("*") if path.is_file()}
    assert {n for n in left & kept if n.endswith((".h5", ".zip", ".tar", ".ply", "_files.txt"))} == set()


def test_another_format_in_the_folder_is_an_error(run: Run, modelnet: Path, tmp_path: Path) -> None:
    run("generate", modelnet, "--out", tmp_path / "out", *SMALL, "--format", "packed")
    outcome = run("generate", modelnet, "--out", tmp_path / "out", *SMALL)
    assert outcome.code == 1
    assert "must be empty or hold this same plan" in outcome.err


def test_convert(run: Run, modelnet: Path, tmp_path: Path) -> None:
    run("generate", modelnet, "--out", tmp_path / "packed", *SMALL, "--format", "packed")
    outcome = run("convert", tmp_path / "packed", "--format", "webdataset", "--out", tmp_path / "tars")
    assert outcome.code == 0, outcome.err
    assert "32 clouds (" in outcome.out
    assert "convert: 100%" in outcome.err
    assert run("convert", tmp_path / "tars", "--format", "hdf5", "--out", tmp_path / "h5").code == 0
    assert (tmp_path / "h5" / "train_files.txt").read_text() == "ply_data_train0.h5\n"
    outcome = run("convert", tmp_path / "h5", "--format", "packed", "--out", tmp_path / "back")
    assert outcome.code == 1
    assert outcome.err.startswith("error: a packed dataset must be made of all points of its objects"), "no bar first"
    outcome = run("convert", tmp_path / "tars", "--format", "npz", "--out", tmp_path / "h5")
    assert outcome.code == 1
    assert "must be empty or hold this same plan" in outcome.err
    assert run("convert", tmp_path / "meshes", "--format", "npz", "--out", tmp_path / "x").code == 1


@pytest.mark.parametrize("preset", ["paper-modelnet40", "paper-modelnet8"])
def test_presets_plan_the_papers_numbers(run: Run, tmp_path: Path, preset: str) -> None:
    outcome = run("generate", "--preset", preset, "--dry-run", "--out", tmp_path / "out")
    assert outcome.code == 0, outcome.err
    if preset == "paper-modelnet40":
        assert "200 meshes x 100 views x 10 variations = 200000 clouds" in outcome.out
    else:
        assert "600 meshes x 25 views x 1 variation = 15000 clouds of 12000 points" in outcome.out
        assert "600 meshes x 1 view x 1 variation = 600 clouds" in outcome.out
        assert f"into {tmp_path / 'out' / 'original'}" in outcome.out
    assert not (tmp_path / "out").exists()


def test_a_presets_sensor_can_be_left_out(run: Run, tmp_path: Path) -> None:
    common = ("generate", "--preset", "pcn", "--limit", 1, "--sensor", "surface", "--method", "exact", "--dry-run")
    common += ("--out", tmp_path / "out")
    plain = run(*common)
    assert plain.code == 0, plain.err
    asked = run(*common, "--size", 2)
    assert (asked.code, "--size needs a sensor" in asked.err) == (2, True)


def test_options_given_override_the_preset(run: Run, tmp_path: Path) -> None:
    common = ("generate", "--preset", "paper-modelnet40", "--dry-run", "--out", tmp_path)
    assert "by occupancy_grid" in run(*common, "--method", "occupancy_grid", "--set", "n=32").out
    assert "200 meshes x 100 views x 2 variations" in run(*common, "--variations", 2).out
    plain, dense = run(*common), run(*common, "--density", 500)
    assert (plain.code, dense.code) == (0, 0)
    assert plain.out.splitlines()[-1] != dense.out.splitlines()[-1]
    assert run(*common, "--density", 500, "--points", 7).code == 2


def test_the_originals_are_complete_clouds_beside_the_occluded(run: Run, tmp_path: Path) -> None:
    out = tmp_path / "out"
    arguments = ("--limit", 4, "--points", 500, "--sample-size", 100, "--views", "ring:2@0", "--workers", 1)
    arguments = ("generate", "--preset", "paper-modelnet8", "--out", out, *arguments, "--method", "oracle")
    first = run(*arguments, "--shard", "0/2")
    assert first.code == 0, first.err
    assert first.out.count(f"zbuf-occlude merge {out}\n") == 2
    assert run("status", out).out.count("not complete") == 2
    outcome = run("merge", out)
    assert outcome.code == 0, outcome.err
    assert "nothing was removed, so nothing was measured" in outcome.out
    original = open_dataset(out / "original")
    records = original.take(original.order["train"])
    assert (records["n_visible"] == 500).all()
    assert (records["visible_fraction"] == 1).all()
    assert (open_dataset(out).take(open_dataset(out).order["train"])["visible_fraction"] < 0.9).all()
    assert sum(open_dataset(out).n_clouds.values()) == 8
    assert run(*arguments).out == outcome.out
    report = json.loads(run("status", out, "--json").out)
    assert [each["complete"] for each in (report, *report["others"])] == [True, True]
    verdict = run("verify", out, "--samples", 2)
    assert verdict.code == 0, verdict.err
    assert verdict.out.count("the dataset is what its manifest says") == 2
    assert "complete clouds: nothing to ask of the oracle" in verdict.out


@pytest.mark.parametrize("place", ["itself", "another that was generated"])
def test_a_conversion_into_a_dataset_that_was_generated(run: Run, modelnet: Path, tmp_path: Path, place: str) -> None:
    run("generate", modelnet, "--out", tmp_path / "a", *SMALL)
    out, format = (tmp_path / "a", "hdf5") if place == "itself" else (tmp_path / "b", "npz")
    run("generate", modelnet, "--out", out, *SMALL, "--format", format)
    outcome = run("convert", tmp_path / "a", "--format", format, "--out", out)
    assert outcome.code == 1
    assert "must be empty or hold this same conversion" in outcome.err
    assert run("verify", out).code == 0


def test_a_conversion_that_was_killed_resumes(
    run: Run, modelnet: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "b"
    run("generate", modelnet, "--out", tmp_path / "a", *SMALL, "--format", "packed")

    def interrupt(*arguments: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr("zbuf_occlude.dataset.export.write_names", interrupt)
        assert run("convert", tmp_path / "a", "--format", "npz", "--out", out).code == 130
    written = {path: path.stat().st_mtime_ns for path in out.glob("*.npz")}
    assert len(written) == 2
    assert run("convert", tmp_path / "a", "--format", "npz", "--out", out).code == 0
    assert {path: path.stat().st_mtime_ns for path in out.glob("*.npz")} == written
    assert run("verify", out).code == 0
