"""`paper real`: training sets of road users, tests on the objects of a drive, the report; hand-computed figures."""

import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

torch = pytest.importorskip("torch", reason="torch is not installed: pip install 'zbuf-occlude[learn]'")
pytest.importorskip("pyarrow", reason="pyarrow is not installed: pip install 'zbuf-occlude[parquet]'")

from tests.studies.paper import light  # noqa: E402
from tests.studies.paper.drives import write_kitti  # noqa: E402
from tests.studies.paper.hand_made import TINY  # noqa: E402
from zbuf_occlude.base.errors import DatasetError, OptionError  # noqa: E402
from zbuf_occlude.cli.experiment import experiment_named  # noqa: E402
from zbuf_occlude.datasets.real.crops import crop_objects  # noqa: E402
from zbuf_occlude.studies.learn.evaluation import Confusion  # noqa: E402
from zbuf_occlude.studies.paper.design import FITTED, HELD_OUT, REAL, REAL_OBJECTS, RECIPES, SIMULATED  # noqa: E402
from zbuf_occlude.studies.paper.real_objects import CLASSES, RealObjects  # noqa: E402
from zbuf_occlude.studies.paper.real_report import mean_recall, spearman, table_real  # noqa: E402
from zbuf_occlude.studies.paper.results import read_results, read_study  # noqa: E402
from zbuf_occlude.studies.paper.study import run_study  # noqa: E402
from zbuf_occlude.studies.paper.study_report import write_study  # noqa: E402

SMALL = replace(TINY, seeds=(0,))


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A tiny study of a hand-made sweep: a car, a van, a pedestrian and a truck of 30 to 60 points."""
    out = tmp_path_factory.mktemp("real")
    with pytest.MonkeyPatch.context() as patch:
        light.put_in_place(patch)
        drive = write_kitti(out / "drive")
        assert run_study(out / "study", SMALL, experiments=[REAL], real=drive, workers=1).n_now == len(RECIPES)
        assert run_study(out / "study", SMALL, experiments=[REAL], real=drive, workers=1).n_now == 0, "all is there"
        yield out / "study"


def test_every_training_set_is_tested_on_the_objects_of_the_drive(study: Path) -> None:
    results = read_results(study)
    recipes = {(r.facts["trained_on"], r.facts["azimuths"], r.facts["scale"]) for r in results}
    assert recipes == set(RECIPES)
    for result in results:
        real = result.tests[REAL_OBJECTS]
        assert dict(zip(real.truth, real.counts.sum(axis=1).tolist(), strict=True)) == {
            "car": 1, "cyclist": 0, "pedestrian": 1, "truck": 1, "van": 1,
        }  # fmt: skip
        bands = [test for name, test in result.tests.items() if name.startswith(f"{REAL_OBJECTS} ")]
        assert sum(test.counts for test in bands).tolist() == real.counts.tolist(), "the bands part the objects"
        assert result.tests[SIMULATED].n_clouds > 0
        assert result.tests[HELD_OUT].counts.tolist() == real.counts.tolist(), "sweep 000007 is held out"
        assert result.tests[FITTED].n_clouds == 0
    facts = read_study(study)[REAL]
    assert (sum(facts["objects"].values()), facts["sweeps"]) == (4, 1)


def test_training_sets_hold_what_they_say(study: Path) -> None:
    """Complete clouds have no camera; scans are of 16 points or more; metres stay metres."""
    experiment = RealObjects(SMALL, study, study)
    assert set(experiment.meshes.classes) == set(CLASSES)
    complete = experiment.training("complete", "around", "cloud", "train")
    both = experiment.training("complete+occluded", "around", "cloud", "train")
    assert np.isnan(complete.elevations).all()
    assert len(both) == len(complete) + len(experiment.training("occluded", "around", "cloud", "train"))
    scans = experiment.training("lidar", "drive", "metres", "train")
    assert (np.asarray(scans.n_measured) >= 16).all()
    sides = np.ptp(scans.positions, axis=1).max(axis=1)
    trucks, people = (sides[scans.labels == scans.classes.index(name)] for name in ("truck", "pedestrian"))
    assert trucks.max() > 2.5 > people.max()


def test_sweeps_of_the_fit_are_apart(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two sweeps: the objects of 000004, on which windows were fitted, and those of another."""
    drive = write_kitti(tmp_path / "drive")
    for path in list(drive.rglob("000007.*")):
        (path.with_stem("000004")).write_bytes(path.read_bytes())
    crop_objects(drive, tmp_path / "crops", classes={n: list(each) for n, each in CLASSES.items()}, distinct=0)
    monkeypatch.setattr(RealObjects, "crops", tmp_path / "crops")
    experiment = RealObjects(SMALL, tmp_path, drive)
    fitted, held_out = experiment.tested_by_fit(True), experiment.tested_by_fit(False)
    assert (len(fitted), len(held_out)) == (4, 4)
    assert sorted(fitted.labels) == sorted(held_out.labels)
    (of_fit,), (of_others,) = map(np.unique, (fitted.group_ids, held_out.group_ids))
    assert (of_fit, of_others) == (0, 1), "in the order of the sweeps' names"


def test_command_and_report(study: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("zbuf_occlude.cli.experiment.QUICK", SMALL)
    done = CliRunner().invoke(experiment_named(REAL), [str(study.parent / "drive"), "--quick", "--out", str(study)])
    assert done.exit_code == 0, done.output
    assert "## Trained on generated clouds, tested on real objects" in done.output
    assert "simulated LiDAR scans" in done.output
    assert (study / "objects.png").stat().st_size > 10_000
    page = write_study(study)[1].read_text(encoding="utf-8")
    assert "Objects held out: 1 car, 1 pedestrian, 1 truck, 1 van; fitted: none." in page
    assert "By range" in page


def test_mean_recall_counts_classes_alike() -> None:
    """Two of three cars and the one pedestrian are right; no cyclist is there: (2/3 + 1) / 2."""
    names = ("car", "cyclist", "pedestrian")
    test = Confusion(names, names, np.array([[2, 0, 1], [0, 0, 0], [0, 0, 1]]))
    assert mean_recall(test) == pytest.approx(5 / 6)
    assert mean_recall(test, ["pedestrian", "cyclist"]) == 1.0
    assert np.isnan(mean_recall(test, ["cyclist"]))


def test_rank_correlation() -> None:
    assert spearman(np.array([0.1, 0.2, 0.9]), np.array([5.0, 6.0, 7.0])) == pytest.approx(1.0)
    assert spearman(np.array([1.0, 2.0, 3.0, 4.0]), np.array([2.0, 1.0, 4.0, 3.0])) == pytest.approx(0.6)
    tied = spearman(np.array([1.0, 2.0, 2.0, 3.0]), np.array([1.0, 2.0, 3.0, 4.0]))
    assert tied == pytest.approx(0.9486833), "4.5 / sqrt(4.5 x 5), by hand"
    assert np.isnan(spearman(np.ones(3), np.arange(3.0)))


def test_a_drive_is_needed(tmp_path: Path) -> None:
    with pytest.raises(OptionError, match="labelled sweeps"):
        run_study(tmp_path / "study", SMALL, experiments=[REAL])


def test_table_has_a_row_for_each_model_and_training_set(study: Path) -> None:
    table = table_real(read_results(study), read_study(study)[REAL])
    assert len(table.rows) == len(RECIPES)
    assert "1 car" in table.note


def test_another_drive_and_one_without_objects_are_refused(study: Path, tmp_path: Path) -> None:
    """Else the objects of the first would be tested again, as if they were the second's."""
    with pytest.raises(DatasetError, match=r"study of the drive .*other; its objects are not of those sweeps"):
        run_study(study, SMALL, experiments=[REAL], real=write_kitti(tmp_path / "other"), workers=1)
    moved = shutil.copytree(study.with_name("drive"), tmp_path / "copy")
    assert run_study(study, SMALL, experiments=[REAL], real=moved, workers=1).n_now == 0, "the same one, elsewhere"
    empty = write_kitti(tmp_path / "empty")
    next(empty.rglob("label_2/*.txt")).write_text("DontCare -1 -1 -10 1 2 3 4 -1 -1 -1 -1000 -1000 -1000 -10\n")
    with pytest.raises(DatasetError, match="none is left"):
        run_study(tmp_path / "study", SMALL, experiments=[REAL], real=empty, workers=1)
