"""`generate --format`, `generate --preset`, `convert`: from the command line to the files."""

import json
from pathlib import Path
from typing import Any

import pytest

from tests.cli.conftest import Run
from zbuf_occlude.cli import generate as generating
from zbuf_occlude.datasets.plan import Plan
from zbuf_occlude.datasets.source import open_dataset

SMALL = "--method oracle --views ring:4@30 --points 300 --sample-size 32 --workers 1"


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
    out, line = tmp_path / "out", f"generate {furniture} --out out {SMALL}"
    outcome = run(f"{line} --format {format}")
    assert list(out.glob(file))
    assert not {path.name for path in out.iterdir()} & {"work", "stored"}
    document = json.loads((out / "manifest.json").read_text())
    assert document["format"] == format
    assert document["counts"]["clouds_by_split"] == {"train": 16, "test": 16}
    if format in ("hdf5", "packed", "webdataset", "npz"):
        assert open_dataset(out).n_clouds == {"train": 16, "test": 16}
    assert run(f"{line} --format {format}").out == outcome.out
    run(f"{line} --format {format} --seed 1 --overwrite")
    kept = {path.name for path in out.rglob("*") if path.is_file()}
    run(f"{line} --format npz --overwrite")
    left = {path.name for path in out.rglob("*") if path.is_file()}
    assert {n for n in left & kept if n.endswith((".h5", ".zip", ".tar", ".ply", "_files.txt"))} == set()


def test_convert(run: Run, modelnet: Path, tmp_path: Path) -> None:
    run(f"generate {modelnet} --out packed {SMALL} --format packed")
    outcome = run("convert packed --format webdataset --out tars", says="convert: 100%")
    assert "32 clouds (" in outcome.out
    run("convert tars --format hdf5 --out h5")
    assert (tmp_path / "h5" / "train_files.txt").read_text() == "ply_data_train0.h5\n"
    before, after = (json.loads((tmp_path / name / "manifest.json").read_text()) for name in ("packed", "h5"))
    assert after["command"] == {**before["command"], "format": "hdf5"}
    run("generate --config h5/manifest.json --workers 1 --out again")
    again = json.loads((tmp_path / "again" / "manifest.json").read_text())
    assert (again["format"], again["files"]) == ("hdf5", after["files"])
    outcome = run("convert h5 --format packed --out back", code=1)
    assert outcome.err.startswith("error: a packed dataset must be made of all points of its objects"), "no bar first"
    run("convert tars --format npz --out h5", code=1, says="must be empty or hold this same plan")
    run("convert meshes --format npz --out x", code=1)


def test_the_command_of_converted_scans_makes_them_again(run: Run, modelnet: Path, tmp_path: Path) -> None:
    """Points of the whole surface are kept in `packed` alone."""
    scans = "--sensor vlp-16 --size 4 --range 5..9 --points 3000 --views ring:2@20 --workers 1"
    run(f"generate {modelnet} {scans} --format packed --out packed")
    run("convert packed --format hdf5 --out theirs")
    run("generate --config theirs/manifest.json --workers 1 --out again")
    theirs, again = (json.loads((tmp_path / name / "manifest.json").read_text()) for name in ("theirs", "again"))
    assert again["options"] == {**theirs["options"], "n_points": again["options"]["n_points"]}  # which scans have not


@pytest.mark.parametrize("format", ["modelnet-o", "epn3d", "shapenet55"])
def test_the_command_of_a_conversion_makes_the_same_again(
    run: Run, furniture: Path, tmp_path: Path, format: str
) -> None:
    """The formats have views, a scale and a number of points of their own."""
    drawn = "--limit 1 --method exact --points 8192 --sample-size 32 --scale cloud --workers 1"
    run(f"generate {furniture} --out packed {drawn} --format packed")
    run(f"convert packed --format {format} --out theirs")
    run("generate --config theirs/manifest.json --workers 1 --out again")
    theirs, again = (json.loads((tmp_path / name / "manifest.json").read_text()) for name in ("theirs", "again"))
    assert again["options"] == theirs["options"]
    assert again["files"] == theirs["files"]


@pytest.mark.parametrize("format", ["kitti", "mvp", "completion3d", "projected-shapenet"])
def test_options_that_a_format_needs_are_those_of_generate(run: Run, furniture: Path, format: str) -> None:
    run(f"generate {furniture} --out packed {SMALL} --limit 1 --format packed")
    run("convert packed --out h5 --format hdf5")
    source = "h5" if format == "kitti" else "packed"
    said = run(f"convert {source} --out theirs --format {format}", code=2).err
    assert "Make it so by `zbuf-occlude generate`: convert keeps what was drawn." in said


def test_presets_plan_the_papers_numbers(run: Run, tmp_path: Path) -> None:
    plan = run("generate --preset paper-modelnet40 --dry-run --out out").out
    assert "200 meshes x 100 views x 10 variations = 200000 clouds" in plan
    plan = run("generate --preset paper-modelnet8 --dry-run --out out").out
    assert "600 meshes x 25 views x 1 variation = 15000 clouds of 12000 points" in plan
    assert "600 meshes x 1 view x 1 variation = 600 clouds" in plan
    assert "into out/original" in plan
    assert not (tmp_path / "out").exists()


def test_a_presets_sensor_can_be_left_out(run: Run) -> None:
    line = "generate --preset pcn --limit 1 --sensor surface --method exact --dry-run"
    run(line)
    run(f"{line} --size 2", code=2, says="--size needs a sensor")


def test_options_given_override_the_preset(run: Run) -> None:
    line = "generate --preset paper-modelnet40 --dry-run"
    assert "by occupancy_grid" in run(f"{line} --method occupancy_grid --set n=32").out
    assert "200 meshes x 100 views x 2 variations" in run(f"{line} --variations 2").out
    plain, dense = run(line), run(f"{line} --density 500")
    assert plain.out.splitlines()[-1] != dense.out.splitlines()[-1]
    run(f"{line} --density 500 --points 7", code=2)


def test_the_originals_are_complete_clouds_beside_the_occluded(run: Run, tmp_path: Path) -> None:
    out = tmp_path / "out"
    line = "generate --preset paper-modelnet8 --limit 4 --points 500 --sample-size 100 --views ring:2@0"
    line += f" --method oracle --workers 1 --out {out}"
    first = run(f"{line} --shard 0/2")
    assert first.out.count(f"zbuf-occlude merge {out}\n") == 2
    assert run(f"status {out}").out.count("not complete") == 2
    run(f"{line} --shard 1/2")
    outcome = run(f"merge {out}")
    assert "nothing was removed, so nothing was measured" in outcome.out
    original = open_dataset(out / "original")
    records = original.take(original.order["train"])
    assert (records["n_visible"] == 500).all()
    assert (records["visible_fraction"] == 1).all()
    assert (open_dataset(out).take(open_dataset(out).order["train"])["visible_fraction"] < 0.9).all()
    assert sum(open_dataset(out).n_clouds.values()) == 8
    assert run(line).out == outcome.out
    report = json.loads(run(f"status {out} --json").out)
    assert [each["complete"] for each in (report, *report["others"])] == [True, True]
    verdict = run(f"verify {out} --samples 2")
    assert verdict.out.count("the dataset is what its manifest says") == 2
    assert "points of complete clouds: on the surface, and all over it" in verdict.out


def test_a_merge_misses_no_originals_that_no_share_began(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Both shares die between the occluded clouds and the complete ones."""
    line = "generate --preset paper-modelnet8 --limit 4 --points 500 --sample-size 100 --views ring:2@0"
    line += " --method oracle --workers 1 --out out --shard"
    made = generating.generate

    def dying(plan: Plan, out: Path, **options: Any) -> Any:
        if out.name == "original":
            raise KeyboardInterrupt
        return made(plan, out, **options)

    with monkeypatch.context() as patched:
        patched.setattr(generating, "generate", dying)
        for share in ("0/2", "1/2"):
            run(f"{line} {share}", code=130)
    run("merge out", code=1, says="out/original must have all")
    for share in ("0/2", "1/2"):
        run(f"{line} {share}")
    run("merge out")
    run("verify out --samples 1")


@pytest.mark.parametrize("begun", ["generate", "convert"])
def test_a_conversion_and_a_run_do_not_go_on_with_each_others_files(
    run: Run, modelnet: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, begun: str
) -> None:
    """The files of one name differ: a packed dataset's positions are rounded."""
    run(f"generate {modelnet} --out a {SMALL} --format packed")
    lines = [f"generate {modelnet} --out b {SMALL} --format npz", "convert a --format npz --out b"]
    first, second = lines if begun == "generate" else lines[::-1]

    def interrupt(*arguments: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        for module in ("generate", "export"):
            patched.setattr(f"zbuf_occlude.datasets.{module}.write_names", interrupt)
        run(first, code=130)
    written = {path: path.stat().st_mtime_ns for path in (tmp_path / "b").glob("*.npz")}
    assert len(written) == 2
    run(second, code=1, says="must be empty or hold this same plan")
    run(first)
    assert {path: path.stat().st_mtime_ns for path in (tmp_path / "b").glob("*.npz")} == written
    run(second, code=1, says="must be empty or hold this same plan")


@pytest.mark.parametrize("place", ["itself", "another that was generated"])
def test_a_conversion_into_a_dataset_that_was_generated(run: Run, modelnet: Path, tmp_path: Path, place: str) -> None:
    run(f"generate {modelnet} --out a {SMALL}")
    out, format = (tmp_path / "a", "hdf5") if place == "itself" else (tmp_path / "b", "npz")
    run(f"generate {modelnet} --out {out} {SMALL} --format {format}")
    run(
        f"convert a --format {format} --out {out}",
        code=1,
        says="in which clouds were made of meshes, and are made of the hdf5",
    )
    run(f"verify {out}")


def test_a_conversion_that_was_killed_resumes(
    run: Run, modelnet: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "b"
    run(f"generate {modelnet} --out a {SMALL} --format packed")

    def interrupt(*arguments: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr("zbuf_occlude.datasets.export.write_names", interrupt)
        run(f"convert a --format npz --out {out}", code=130)
    written = {path: path.stat().st_mtime_ns for path in out.glob("*.npz")}
    assert len(written) == 2
    run(f"convert a --format npz --out {out}")
    assert {path: path.stat().st_mtime_ns for path in out.glob("*.npz")} == written
    run(f"verify {out}")
