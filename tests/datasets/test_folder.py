"""Whose a folder is: nothing that no plan of ours names is ever removed, and no plan is taken for another."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from tests.datasets.test_generate import files
from zbuf_occlude.base.errors import DatasetError
from zbuf_occlude.datasets import folder as claiming
from zbuf_occlude.datasets.folder import claim_folder, locked, partition_files, plan_in, remove
from zbuf_occlude.datasets.formats import FORMATS, find_format
from zbuf_occlude.datasets.generate import generate
from zbuf_occlude.datasets.plan import DATA_VERSION, DatasetConfig, Plan
from zbuf_occlude.datasets.presets import plan_of_originals
from zbuf_occlude.meshes import shapes
from zbuf_occlude.sensors import make
from zbuf_occlude.sensors.scan_config import ScanConfig

CONFIG = DatasetConfig(method="oracle", views="ring:2@30", n_points=50, sample_size=8)
PLAN = Plan(shapes.collection(n_members=1), CONFIG)


@pytest.mark.parametrize("overwrite", [False, True])
@pytest.mark.parametrize("plan", ['{"x": 1}', "no JSON", "[]", '{"fingerprint": "0123456789abcdef", "meshes": []}'])
def test_a_plan_that_is_none_of_ours_makes_nothing_ours(tmp_path: Path, plan: str, overwrite: bool) -> None:
    for name in ("work/weights.tar", "my_files.txt", "train-000.tar", "train-000000.tar", "ply/a/b/scan.ply"):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("years of work")
    (tmp_path / "plan.json").write_text(plan)
    before = files(tmp_path)
    with pytest.raises(DatasetError, match=r"plan\.json must be as it was written"):
        generate(PLAN, tmp_path, overwrite=overwrite)
    assert files(tmp_path) == before


@pytest.mark.parametrize("format", [row.name for row in FORMATS if not row.options])
def test_overwriting_removes_what_the_plan_names_and_stops_at_anything_else(tmp_path: Path, format: str) -> None:
    out, plan = tmp_path / "out", replace(PLAN, format=format, meshes=find_format(format).choose_meshes(PLAN.meshes))
    generate(plan, out)
    assert partition_files(out, plan)[1] == []
    others = (
        "notes.txt",
        "train-9.tar",
        "ply_data_train7.h5",
        "packed-000099.zip",
        "shards/0.npy",
        "ply/train/x.ply",
        "empty/",
    )
    for name in others:
        path = out / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.mkdir() if name.endswith("/") else path.write_text("mine")
        before = files(out)
        with pytest.raises(
            DatasetError, match="must hold nothing but its dataset to be overwritten; it has other files"
        ):
            generate(plan, out, overwrite=True)
        assert files(out) == before
        shutil.rmtree(path) if path.is_dir() else path.unlink()
        for folder in (path.parent, path.parent.parent):
            if out in folder.parents and not any(folder.iterdir()):
                folder.rmdir()
    remove(out)
    assert list(out.iterdir()) == []


@pytest.mark.parametrize("at_work", ["", "original"])
def test_what_another_run_is_at_is_not_removed(tmp_path: Path, at_work: str) -> None:
    """A preset's complete clouds, in a folder of their own, go with the dataset."""
    out, original = tmp_path / "out", tmp_path / "out" / "original"
    generate(PLAN, out)
    generate(plan_of_originals(PLAN), original)
    before = files(out)
    with locked(out / at_work), pytest.raises(DatasetError, match="one run at a time"):
        generate(PLAN, out, overwrite=True)
    assert files(out) == before
    generate(PLAN, out, overwrite=True)
    assert not original.exists()


def test_a_linked_folder_is_not_followed(tmp_path: Path) -> None:
    out, elsewhere = tmp_path / "out", tmp_path / "elsewhere"
    claim_folder(PLAN, out)
    elsewhere.mkdir()
    (elsewhere / "000000.json").write_text("mine")
    (out / "shards").symlink_to(elsewhere)
    with pytest.raises(DatasetError, match="it has other files: shards/"):
        remove(out)
    assert (elsewhere / "000000.json").read_text() == "mine"


def test_files_of_others_in_a_dataset_do_not_hinder_going_on(tmp_path: Path) -> None:
    generate(PLAN, tmp_path, share=(1, 2))
    (tmp_path / "work").mkdir(exist_ok=True)
    (tmp_path / "work" / "notes.txt").write_text("mine")
    generate(PLAN, tmp_path)
    assert (tmp_path / "work" / "notes.txt").read_text() == "mine"
    assert [path.name for path in (tmp_path / "work").iterdir()] == ["notes.txt"]


def test_a_plan_only_just_begun_is_not_taken_over(tmp_path: Path) -> None:
    claim_folder(PLAN, tmp_path)
    other = Plan(PLAN.meshes, replace(CONFIG, seed=7, n_points=60))
    with pytest.raises(DatasetError, match=r"in which n_points was 50, and is 60; seed was 0, and is 7\. Choose"):
        generate(other, tmp_path)
    assert json.loads((tmp_path / "plan.json").read_text())["fingerprint"] == PLAN.fingerprint
    assert generate(other, tmp_path, overwrite=True)["seed"] == 7


def test_the_number_of_a_sensor_that_differs_is_named_alone(tmp_path: Path) -> None:
    scans = [ScanConfig(make("vlp-16", columns=columns), range=(5.0, 9.0), size={"car": 4.0}) for columns in (60, 90)]
    plans = [Plan(PLAN.meshes, replace(CONFIG, scan=scan)) for scan in scans]
    claim_folder(plans[0], tmp_path)
    with pytest.raises(DatasetError, match=r"in which scan\.sensor\.pattern\.columns was 60, and is 90\. Choose"):
        claim_folder(plans[1], tmp_path)


def test_of_two_plans_at_a_time_one_wins(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The other comes between the look at the empty folder and the writing of the plan."""
    other = Plan(PLAN.meshes, replace(CONFIG, seed=7))
    claim_folder(other, tmp_path)
    looks = iter([None])
    monkeypatch.setattr(claiming, "plan_in", lambda out: next(looks, other))
    with pytest.raises(DatasetError, match="seed was 7, and is 0"):
        claim_folder(PLAN, tmp_path)
    claim_folder(other, tmp_path)  # the same plan twice is one run more
    assert json.loads((tmp_path / "plan.json").read_text())["fingerprint"] == other.fingerprint


def test_a_plan_of_another_version_is_read_and_not_gone_on_with(tmp_path: Path) -> None:
    claim_folder(PLAN, tmp_path)
    newer = Plan(PLAN.meshes, CONFIG, version=1000)
    assert plan_in(tmp_path) is not None
    with pytest.raises(DatasetError, match=f"in which data version was {DATA_VERSION}, and is 1000"):
        claim_folder(newer, tmp_path)
