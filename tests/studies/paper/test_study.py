"""A small study: both experiments, interrupted and resumed, scans added later; and folders that are refused."""

import itertools
import json
import os
import signal
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="torch is not installed: pip install 'zbuf-occlude[learn]'")

from tests.studies.paper import light  # noqa: E402
from tests.studies.paper.hand_made import TINY, write_sydney  # noqa: E402
from zbuf_occlude.base.errors import DatasetError, MeshError, OptionError, UnavailableError  # noqa: E402
from zbuf_occlude.datasets.plan import DatasetConfig, Plan  # noqa: E402
from zbuf_occlude.meshes import MeshCollection, shapes  # noqa: E402
from zbuf_occlude.studies.learn.data import CloudSet  # noqa: E402
from zbuf_occlude.studies.learn.training import CHECKPOINT, load_trained  # noqa: E402
from zbuf_occlude.studies.paper import augmentation  # noqa: E402
from zbuf_occlude.studies.paper import study as study_module  # noqa: E402
from zbuf_occlude.studies.paper.augmentation import Augmentation  # noqa: E402
from zbuf_occlude.studies.paper.design import (  # noqa: E402
    AUGMENTATION,
    CLOUDS,
    ELEVATION,
    EPOCHS,
    FULL,
    HSR,
    MAIN,
    TEST_ELEVATIONS,
    TRAIN_ELEVATIONS,
    Progress,
)
from zbuf_occlude.studies.paper.elevation import Elevation  # noqa: E402
from zbuf_occlude.studies.paper.experiments import MODELNET10, Experiment, MakeOptions, find_objects  # noqa: E402
from zbuf_occlude.studies.paper.figures import degrees  # noqa: E402
from zbuf_occlude.studies.paper.real_scans import CLASSES  # noqa: E402
from zbuf_occlude.studies.paper.results import FOLDER, Result, Trial, read_results, read_study  # noqa: E402
from zbuf_occlude.studies.paper.study import CLASSIFIERS, run_study, run_trials  # noqa: E402
from zbuf_occlude.studies.paper.study_report import write_study  # noqa: E402


class Stop(Exception):  # noqa: N818  (no error: an end)
    """Exception that stands for the end of the process."""


class Heard(Progress):
    """Recorder of progress; it stops after a number of reports or clouds."""

    def __init__(self, n_reports: int = 10**9, n_clouds: int = 10**9) -> None:
        self.n_reports, self.n_clouds = n_reports, n_clouds
        self.planned, self.made, self.trials = 0, 0, list[tuple[str, float]]()

    def set_totals(self, n_clouds: int, n_trials: int) -> None:
        self.planned = n_clouds

    def add_clouds(self, n: int) -> None:
        self.made += n
        if self.made >= self.n_clouds:
            raise Stop

    def update_trial(self, key: str, share: float) -> None:
        self.trials.append((key, share))
        if len(self.trials) == self.n_reports:
            raise Stop


@pytest.fixture(scope="module", autouse=True)
def light_networks() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        light.put_in_place(patch)
        yield


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished study that was interrupted three times: in its clouds and in two trainings."""
    out = tmp_path_factory.mktemp("studies") / "study"
    for stop in (Heard(n_clouds=30), Heard(6), Heard(20)):
        with pytest.raises(Stop):
            run_study(out, TINY, progress=stop, workers=1)
    done = {path: path.stat().st_mtime_ns for path in (out / FOLDER).iterdir()}
    assert done, "what was finished before the stop is kept"
    run_study(out, TINY, workers=1)
    assert all(path.stat().st_mtime_ns == time for path, time in done.items()), "and not made again"
    heard = Heard()
    assert run_study(out, TINY, progress=heard, workers=1).n_now == 0, "nothing is done twice"
    assert heard.made == heard.planned, "the bar of the clouds reaches its end"
    return out


def test_every_classifier_is_there(folder: Path) -> None:
    results = read_results(folder)
    counts = {name: sum(r.experiment == name for r in results) for name in (AUGMENTATION, HSR, ELEVATION)}
    assert counts == {AUGMENTATION: 6, HSR: 2 * (2 - len(read_study(folder)["missing_methods"])), ELEVATION: 2}
    assert set(read_study(folder)["missing_methods"]) <= {"depth_buffer"}, "for lack of GL, and nothing else"
    for result in results:
        if result.experiment == ELEVATION:
            assert set(result.tests) == {str(e) for e in TEST_ELEVATIONS}
            assert all(
                test.counts.sum() == (40 if result.matches(split="elevations") else 8) for test in result.tests.values()
            )
        else:
            assert result.tests["original"].counts.sum(axis=1).tolist() == [1] * 8
            assert result.tests["generated"].counts.sum(axis=1).tolist() == [2] * 8
            assert result.tests["original"].truth == shapes.CLASSES
    sizes = {
        result.facts["set"]: result.document["n_training"] for result in results if result.experiment == AUGMENTATION
    }
    assert sizes == {1: 32, 2: 16, 3: 48}


@pytest.mark.long
def test_stopped_or_not_in_one_process_or_two_the_results_are_the_same(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An uninterrupted study in two processes equals the interrupted one."""
    monkeypatch.setattr(augmentation, "METHODS", (MAIN,))  # no time for the others
    monkeypatch.setattr("os.sched_getaffinity", lambda process: {0, 1})  # a thread each
    heard = Heard()
    assert run_study(tmp_path / "other", TINY, experiments=[AUGMENTATION], workers=2, progress=heard) == (6, 6, 6)
    whole = read_results(tmp_path / "other")
    assert len(whole) == 6
    finished = {path.stem for path in (tmp_path / "other" / FOLDER).iterdir()}
    assert {key for key, share in heard.trials if share == 1.0} == finished
    assert any(0.0 < share < 1.0 for _, share in heard.trials), "workers tell how far they are"
    mine = {json.dumps(result.facts): result for result in read_results(folder) if result.experiment == AUGMENTATION}
    for result in whole:
        other = mine[json.dumps(result.facts)]
        assert set(result.tests) == {"original", "generated"} <= set(other.tests)
        for name, test in result.tests.items():
            assert (test.counts == other.tests[name].counts).all()
        assert result.document["validation_accuracy"] == other.document["validation_accuracy"]


def test_scans_given_later_are_a_test_more(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(0)
    noise = {f"{label}.{number}.1": rng.normal(size=(20, 3)) for label in CLASSES for number in range(4)}
    root = write_sydney(tmp_path / "scans", noise)
    before = {result.document["seconds"] for result in read_results(folder)}
    monkeypatch.setattr("zbuf_occlude.studies.learn.training._Run", None)  # training anything would fail
    work = run_study(folder, TINY, experiments=[AUGMENTATION], scans=root, workers=1)
    results: list[Result] = [result for result in read_results(folder) if result.experiment != ELEVATION]
    assert work == (len(results),) * 3
    assert all(result.tests["scans"].counts.sum(axis=1).tolist() == [4] * 14 for result in results)
    assert all(result.tests["scans"].predicted == shapes.CLASSES for result in results)
    assert {result.document["seconds"] for result in read_results(folder)} == before
    write_study(folder)
    text = (folder / "study.md").read_text()
    assert "Test 3 has 56 clouds" in text
    assert "Real scans: -z of the files is up, assumed" in text, "these are noise"
    assert "](scans.png)" in text
    with pytest.raises(
        DatasetError, match=r"The up axis of the scans .* has changed \(-z of the files is up.*now it is z"
    ):
        run_study(folder, TINY, experiments=[AUGMENTATION], scans=root, scans_up="z", workers=1)


def kill_oneself() -> CloudSet:
    """Kill this process, as a machine without memory does."""
    os.kill(os.getpid(), signal.SIGKILL)
    raise AssertionError


def complain() -> CloudSet:
    """Raise as a damaged dataset does."""
    raise DatasetError("it is not there")


@pytest.mark.parametrize(
    ("end", "error", "message"),
    [
        (kill_oneself, UnavailableError, "A worker of the training failed: its process was killed"),
        (complain, DatasetError, "it is not there"),
    ],
)
def test_a_worker_that_is_killed_or_fails_ends_the_command_in_one_line(
    end: Callable[[], CloudSet],
    error: type[Exception],
    message: str,
    tmp_path: Path,
) -> None:
    trial = Trial(AUGMENTATION, {"model": "voxnet", "seed": 0}, end, end, {"original": end}, abs)
    with pytest.raises(error, match=message):
        run_trials([trial, replace(trial, facts={"model": "voxnet", "seed": 1})], TINY, tmp_path, Progress(), workers=2)


def test_a_study_in_parts_on_several_machines_equals_a_whole_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The clock goes on by a minute where it is read: at the end of a shard, and of an epoch."""
    monkeypatch.setattr(augmentation, "METHODS", (MAIN,))
    size = replace(TINY, seeds=(0,), passes=96)
    whole, parts = tmp_path / "whole", tmp_path / "machine 0"
    assert run_study(whole, size, experiments=[AUGMENTATION], workers=1) == (3, 3, 3)
    ticks = itertools.count()
    monkeypatch.setattr(study_module, "monotonic", lambda: 60.0 * next(ticks))
    work, stopped = [run_study(parts, size, experiments=[AUGMENTATION], workers=1, minutes=2)], set[Path]()
    assert not (parts / FOLDER).exists(), "the first part ends within the clouds"
    while work[-1].n_done < work[-1].n_planned:
        parts = parts.rename(tmp_path / f"machine {len(work)}")
        work.append(run_study(parts, size, experiments=[AUGMENTATION], workers=1, minutes=5))
        stopped |= {path.relative_to(parts) for path in parts.rglob(CHECKPOINT)}
        assert len(work) < 20
    assert [each.n_done for each in work] == list(itertools.accumulate(each.n_now for each in work))
    assert work[-1].n_done == 3
    assert stopped, "a training was continued"
    for one, other in zip(read_results(whole), read_results(parts), strict=True):
        changing = {"seconds": 0.0}
        assert one.document | changing == other.document | changing
    for folder in (whole / CLASSIFIERS).iterdir():
        one, other = (load_trained(root / CLASSIFIERS / folder.name) for root in (whole, parts))
        assert one.history == other.history
        weights = other.model.state_dict()
        assert all(torch.equal(value, weights[name]) for name, value in one.model.state_dict().items())


def test_each_call_does_some_work_however_short_its_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(augmentation, "METHODS", (MAIN,))
    size, n_calls = replace(TINY, seeds=(0,), passes=2), 0
    while (work := run_study(tmp_path, size, experiments=[AUGMENTATION], workers=1, minutes=1e-6)).n_done < 3:
        n_calls += 1
        assert n_calls < 60
    assert n_calls > 3
    assert work.n_planned == 3


def flat_and_tall() -> CloudSet:
    """Return sixteen random boxes, flat and tall in turn."""
    labels = np.arange(16) % 2
    sides = np.where(labels[:, None, None] == 0, [1.0, 0.8, 0.1], [0.3, 0.2, 1.0])
    points = np.random.default_rng(0).random((16, 32, 3)) * sides
    return CloudSet(points, labels, ("flat", "tall"), np.arange(16), np.full(16, np.nan))


def test_workers_stop_at_the_end_of_an_epoch(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In this process it is still time, in the workers no more."""
    facts = {"model": "voxnet", "set": 1, "points": 32, "budget": CLOUDS}
    clouds = (flat_and_tall, flat_and_tall, {"original": flat_and_tall})
    trials = [Trial(AUGMENTATION, facts | {"seed": seed}, *clouds, abs) for seed in (0, 1, 2)]
    monkeypatch.setattr(study_module, "monotonic", iter([-1.0, 1.0]).__next__)
    heard = Heard()
    assert run_trials(trials, TINY, tmp_path, heard, workers=2, until=0.0) == 0
    assert {path.parent.name for path in tmp_path.rglob(CHECKPOINT)} == {trial.key for trial in trials[:2]}
    assert max(share for _, share in heard.trials) == pytest.approx(0.95 / 16), "one of 16 epochs"
    monkeypatch.undo()
    assert run_trials(trials[:1], TINY, tmp_path, Progress()) == 1
    (result,) = read_results(tmp_path)
    assert result.document["config"]["epochs"] == 16


@pytest.mark.parametrize(("gigabytes", "n_workers"), [(78, 4), (20, 1), (8, 1), (400, 16)])
def test_as_many_train_on_a_gpu_as_its_memory_and_the_cores_allow(
    monkeypatch: pytest.MonkeyPatch, gigabytes: int, n_workers: int
) -> None:
    monkeypatch.setattr(study_module, "n_cores", lambda: 16)
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.cuda, "mem_get_info", lambda: (gigabytes << 30, 500 << 30))
    assert study_module._n_workers() == n_workers


def test_a_budget_given_later_is_more_classifiers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(augmentation, "METHODS", (MAIN,))
    size = replace(TINY, seeds=(0,), passes=48, epochs=2)
    again = tmp_path / "budgets"
    assert run_study(again, size, experiments=[AUGMENTATION], workers=1) == (3, 3, 3)
    assert run_study(again, size, experiments=[AUGMENTATION], budgets=(CLOUDS, EPOCHS), workers=1) == (3, 6, 6)
    rows = {(row.facts["set"], row.facts["budget"]): row.document for row in read_results(again)}
    n_training = {1: 32, 2: 16, 3: 48}
    assert {key: row["config"]["epochs"] for key, row in rows.items()} == {
        **{(s, CLOUDS): max(1, round(size.passes / n)) for s, n in n_training.items()},
        **dict.fromkeys(((s, EPOCHS) for s in n_training), size.epochs),
    }


def test_a_folder_of_another_study_is_refused(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(
        DatasetError, match=r"must be empty or hold this same study \(other, built-in.*another \(tiny, .*other name, e"
    ):
        run_study(folder, replace(TINY, name="other", epochs=2))
    (tmp_path / "thesis.txt").write_text("mine")
    with pytest.raises(DatasetError, match="must be empty or hold a study; it has other files"):
        run_study(tmp_path, TINY)
    with pytest.raises(OptionError, match="minutes must be positive; got nan"):
        run_study(tmp_path / "new", TINY, minutes=float("nan"))
    with pytest.raises(DatasetError, match="must be the Sydney Urban Objects dataset"):
        run_study(tmp_path / "new", TINY, scans=tmp_path)
    with pytest.raises(MeshError, match="must be ModelNet40's folder"):
        run_study(tmp_path / "new", TINY, modelnet=tmp_path / "nowhere")
    assert not (tmp_path / "new").exists(), "refused before anything was made"


# ---- who is in which set ------------------------------------------------------------------------------------------


def test_elevation_sets(folder: Path) -> None:
    clouds = Elevation(shapes.collection(), TINY, folder)
    for split_by in ("elevations", "objects"):
        training, validation = clouds.training(split_by), clouds.validation(split_by)
        for part in (training, validation):
            assert set(degrees(part.elevations)) <= set(TRAIN_ELEVATIONS)
        for elevation in (-80, 0, 10):
            test = clouds.test(split_by, elevation)
            assert set(degrees(test.elevations)) == {elevation}
            shared = set(test.group_ids) & set(training.group_ids)
            assert bool(shared) == (split_by == "elevations")
        assert (set(training.group_ids) & set(validation.group_ids) == set()) == (split_by == "objects")
    n_clouds = len(clouds.training("elevations")) + len(clouds.validation("elevations"))
    (manifest,) = (json.loads(path.read_text()) for path in folder.glob("clouds/elevation/manifest.json"))
    n_blank = sum(blank["n_views"] for blank in manifest["blank_views"].values())
    assert manifest["counts"]["clouds"] + n_blank == clouds.max_clouds
    assert 40 * 8 - n_blank <= n_clouds <= 40 * 8
    assert len(set(clouds.training("objects").group_ids)) == 24


def test_the_full_study_has_the_papers_numbers(tmp_path: Path) -> None:
    elevation = Elevation(shapes.collection(), FULL, tmp_path)
    assert elevation.max_clouds == 200_000
    augmentation = Augmentation(shapes.collection(), FULL, tmp_path)
    plan = augmentation.plan_of(MAIN)
    assert plan.n_clouds == 15_000
    splits = [entry.split for entry in plan.meshes]
    assert [25 * splits.count(split) for split in ("train", "val", "test")] == [8_000, 2_000, 5_000]
    assert {trial.facts["points"] for trial in augmentation.trials()} == {12_000, 1_024}
    assert len(elevation.meshes) == 200


def write_modelnet(root: Path, labels: tuple[str, ...], n_train: int, n: int) -> None:
    """Write empty meshes with ModelNet's names."""
    for label in labels:
        for number in range(1, n + 1):
            folder = root / label / ("train" if number <= n_train else "test")
            folder.mkdir(parents=True, exist_ok=True)
            (folder / f"{label}_{number:04d}.off").write_text("OFF")


def test_of_modelnet40_the_same_objects_are_chosen_each_time(tmp_path: Path) -> None:
    """The selection has 40, 10 and 25 of each of the eight classes; no mesh is loaded."""
    write_modelnet(tmp_path, (*shapes.CLASSES, "bathtub"), 60, 85)
    one, other = (Augmentation(find_objects(tmp_path), FULL, tmp_path).meshes for _ in range(2))
    assert [(entry.key, entry.split) for entry in one] == [(entry.key, entry.split) for entry in other]
    counts = Counter((entry.label, entry.split) for entry in one)
    wanted = {"train": 40, "val": 10, "test": 25}
    assert counts == {(label, split): n for label in shapes.CLASSES for split, n in wanted.items()}
    assert {entry.key for entry in one if entry.split == "test"} >= {"car/test/car_0061.off", "lamp/test/lamp_0085.off"}
    few = Augmentation(find_objects(tmp_path), TINY, tmp_path).meshes
    assert {entry.key for entry in few} <= {entry.key for entry in one}


def test_of_modelnet10_elevation_takes_twenty_of_each_and_augmentation_refuses(tmp_path: Path) -> None:
    write_modelnet(tmp_path / "meshes", MODELNET10, 30, 40)
    for experiments in ([AUGMENTATION], [ELEVATION, AUGMENTATION]):
        with pytest.raises(MeshError, match=r"has no airplane, bookshelf, bottle, car, lamp\. ModelNet10 suffices for"):
            run_study(tmp_path / "study", FULL, experiments=experiments, modelnet=tmp_path / "meshes")
    assert not (tmp_path / "study").exists()
    with pytest.raises(DatasetError, match="none of 200 did"):  # these meshes are empty; what it would be is written
        run_study(tmp_path / "study", FULL, experiments=[ELEVATION], modelnet=tmp_path / "meshes")
    assert read_study(tmp_path / "study")["objects"] == f"ModelNet10 ({', '.join(MODELNET10)})"
    plan = Elevation(find_objects(tmp_path / "meshes", any_ten=True), FULL, tmp_path).plans()[ELEVATION]
    counts = Counter((entry.label, entry.split) for entry in plan.meshes)
    wanted = {"train": 12, "val": 4, "test": 4}
    assert counts == {(label, split): n for label in MODELNET10 for split, n in wanted.items()}


def test_what_augmentation_takes(tmp_path: Path) -> None:
    views = Augmentation(shapes.collection(), replace(TINY, views=5), tmp_path).plan_of(MAIN).views
    assert degrees(views.elevation).tolist() == [-80, -40, 0, 40, 80]
    assert sorted(degrees(views.azimuth) % 360) == [0, 72, 144, 216, 288]
    with pytest.raises(OptionError, match="must find 75 meshes of each of airplane"):
        Augmentation(shapes.collection(n_members=60), TINY, tmp_path)


def test_what_is_missing_of_modelnet_is_said(tmp_path: Path) -> None:
    assert len(find_objects()) == 600, "the built-in ones"
    with pytest.raises(MeshError, match=r"there is no folder .*nowhere. ModelNet40 is at https://modelnet"):
        find_objects(tmp_path / "nowhere")
    write_modelnet(tmp_path, ("bathtub", "bed", "chair", "table"), 1, 1)
    for any_ten in (False, True):
        with pytest.raises(MeshError, match=r"has no airplane, bookshelf, bottle, car, lamp\. ModelNet40 is at"):
            find_objects(tmp_path, any_ten=any_ten)


def test_a_class_without_a_mesh_is_no_dataset_to_train_on(tmp_path: Path) -> None:
    class Two(Experiment):
        def plans(self) -> dict[str, Plan]:
            config = DatasetConfig(method="oracle", views="ring:2@30", n_points=50, sample_size=8)
            return {"two": Plan(MeshCollection.from_paths(tmp_path / "meshes"), config, "hdf5")}

        def trials(self) -> list[Trial]:
            return []

    write_modelnet(tmp_path / "meshes", ("bed", "car"), 2, 2)
    whole = "OFF\n4 2 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 1 2\n3 0 1 3\n"
    for number in (1, 2):
        (tmp_path / "meshes" / "bed" / "train" / f"bed_000{number}.off").write_text(whole)
    with pytest.raises(MeshError, match=r"No mesh of class car can be used.*car_0001\.off.*'noth"):
        Two(TINY, tmp_path / "one").make_datasets(MakeOptions(lambda n: None))
    (tmp_path / "meshes" / "car" / "train" / "car_0002.off").write_text(whole)
    failures = Two(TINY, tmp_path / "other").make_datasets(MakeOptions(lambda n: None))
    assert [key.split("/")[-1] for key in failures] == ["car_0001.off"]
