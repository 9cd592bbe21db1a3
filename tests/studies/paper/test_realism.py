"""`experiment realism`: four kinds of clouds of the same views, own and matched numbers of points, real objects."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

torch = pytest.importorskip("torch", reason="torch is not installed: pip install 'zbuf-occlude[learn]'")
pytest.importorskip("pyarrow", reason="pyarrow is not installed: pip install 'zbuf-occlude[parquet]'")


from tests.studies.paper import light  # noqa: E402
from tests.studies.paper.drives import write_argoverse, write_kitti  # noqa: E402
from tests.studies.paper.hand_made import TINY, confusion, result  # noqa: E402
from zbuf_occlude.cli.experiment import experiment_command  # noqa: E402
from zbuf_occlude.meshes import shapes  # noqa: E402
from zbuf_occlude.studies.learn.evaluation import Confusion  # noqa: E402
from zbuf_occlude.studies.paper.design import COUNTS, KINDS, MATCHED, OWN, REALISM  # noqa: E402
from zbuf_occlude.studies.paper.realism import Realism, own_and_matched  # noqa: E402
from zbuf_occlude.studies.paper.results import read_results  # noqa: E402
from zbuf_occlude.studies.paper.study import run_study  # noqa: E402
from zbuf_occlude.studies.paper.study_report import cars_found, table_of_clouds, table_realism, write_study  # noqa: E402

FACTS = {
    "objects": 8, "clouds": 20, "points": {"uniform": 256.0, "scans": 120.0, "scenes": 80.5, "two-eyes": 256.0},
    "sensor": "hdl-64e", "metres": 4.5, "range": [6.0, 40.0], "hidden": [0.0, 0.6], "least": 16,
    "two_eyes": {"sensor": "kinect-v1", "metres": 1.0, "range": [1.2, 3.5]},
}  # fmt: skip


SMALL = replace(TINY, seeds=(0,))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A tiny study, tested on real objects of two layouts afterwards."""
    out = tmp_path_factory.mktemp("realism")
    with pytest.MonkeyPatch.context() as patch:
        light.put_in_place(patch)
        assert run_study(out / "study", SMALL, experiments=[REALISM], workers=1).n_now == 8
        assert run_study(out / "study", SMALL, experiments=[REALISM], workers=1).n_now == 0
        for write in (write_kitti, write_argoverse):
            real = write(out / write.__name__)
            assert run_study(out / "study", SMALL, experiments=[REALISM], workers=1, real=real).n_now == 8, (
                "tested on it"
            )
    return out / "study"


def test_command(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("zbuf_occlude.cli.experiment.QUICK", SMALL)
    done = CliRunner().invoke(experiment_command, ["realism", "--quick", "--out", str(folder)])
    assert done.exit_code == 0, done.output
    assert "## What a sensor does to a classifier" in done.output
    assert "0 classifiers trained or tested now" in done.output


def test_every_classifier_is_tested_on_all(folder: Path) -> None:
    results = read_results(folder)
    assert len(results) == 8
    assert {(r.facts["trained_on"], r.facts["counts"]) for r in results} == {(k, c) for k in KINDS for c in COUNTS}
    for each in results:
        assert set(each.tests) == {*KINDS, "real:KITTI", "real:Argoverse 2"}
        assert each.tests["real:KITTI"].counts.sum(axis=1).tolist() == [2, 1]
        sizes = {int(each.tests[kind].counts.sum()) for kind in KINDS}
        assert len(sizes) == 1, "the same views of all kinds"
    write_study(folder)
    text = (folder / "study.md").read_text()
    assert "| VoxNet | their own | uniform clouds |" in text
    assert "| KITTI: cars found | KITTI: others labelled car |" in text
    assert "KITTI: 2 cars and 1 other objects." in text
    assert "Differences from the paper" not in text, "it is not the paper's"


def test_all_kinds_show_the_same_objects_and_matched_as_many_points(folder: Path) -> None:
    clouds = Realism(shapes.collection(), SMALL, folder)
    for split in ("train", "test"):
        sets = {(kind, count): clouds.clouds_of(kind, count, split) for kind in KINDS for count in COUNTS}
        first = sets["uniform", OWN]
        for each in sets.values():
            assert (each.labels == first.labels).all()
            assert (each.group_ids == first.group_ids).all()
            assert np.ptp(each.positions, axis=1).max(axis=1) == pytest.approx(1.0, abs=1e-6)
        numbers = {k: np.array([len(np.unique(p, axis=0)) for p in each.positions]) for k, each in sets.items()}
        least = np.min([numbers[kind, OWN] for kind in KINDS], axis=0)
        for kind in KINDS:
            assert (numbers[kind, MATCHED] == least).all()
        assert (least >= 16).all()


def test_views_without_points_enough_in_one_kind_are_in_none() -> None:
    rng = np.random.default_rng(0)
    sizes = {"a": {(0, 0): 40, (0, 1): 40, (1, 0): 20}, "b": {(0, 0): 17, (0, 1): 15, (2, 0): 90}}
    sets = {k: {key: rng.random((n, 3)).astype(np.float32) for key, n in v.items()} for k, v in sizes.items()}
    found = own_and_matched(sets)
    assert {k: {key: len(p) for key, p in v.items()} for k, v in found[OWN].items()} == {
        "a": {(0, 0): 40},
        "b": {(0, 0): 17},
    }
    assert {k: len(v[0, 0]) for k, v in found[MATCHED].items()} == {"a": 17, "b": 17}
    assert {tuple(p) for p in found[MATCHED]["a"][0, 0]} < {tuple(p) for p in sets["a"][0, 0]}


def test_tables_of_accuracies_and_of_clouds() -> None:
    real = "real:KITTI"
    drive = Confusion(("car", "other"), ("bed", "car"), np.array([[10, 30], [75, 25]]))
    shares = np.array([[0.9, 0.6, 0.5, 0.4], [0.7, 0.8, 0.7, 0.6], [0.6, 0.7, 0.8, 0.5], [0.3, 0.2, 0.4, 0.9]])
    rows = []
    for count, less in ((OWN, 0.0), (MATCHED, 0.1)):
        for kind, right in zip(KINDS, shares - less, strict=True):
            tests = {**dict(zip(KINDS, map(confusion, right), strict=True)), real: drive}
            rows.append(result(REALISM, tests, model="voxnet", trained_on=kind, counts=count))
    table = table_realism(rows, FACTS)
    words = ("uniform clouds", "scans of single objects", "scans in streets", "scans by two eyes")
    assert table.header[3:7] == [f"tested on {w}" for w in words]
    assert table.rows[0] == ["VoxNet", "their own", "uniform clouds", "90.0", "60.0", "50.0", "40.0", "75.0", "25.0"]
    assert table.rows[6] == ["", "", "scans in streets", "50.0", "60.0", "70.0", "40.0", "75.0", "25.0"]
    assert "KITTI: 40 cars and 100 other objects." in table.note
    clouds = table_of_clouds(FACTS)
    assert [row[0] for row in clouds.rows] == list(words)
    assert cars_found(drive) == (0.75, 0.25)
    assert cars_found(Confusion(("car", "other"), ("car",), np.array([[3], [0]]))) == (1.0, None)
