"""`paper elevation` and other experiments from the command line: a small study, help, and one-line errors."""

import json
from dataclasses import replace
from itertools import count
from pathlib import Path

import pytest

from tests.cli.conftest import Run
from tests.studies.paper.hand_made import TINY
from zbuf_occlude import Mesh
from zbuf_occlude.base.errors import MeshError
from zbuf_occlude.datasets.presets import two_hundred
from zbuf_occlude.meshes import MeshCollection, shapes


@pytest.fixture
def tiny(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make `--quick` quicker: light networks in this process; tests/studies/paper/test_study.py uses processes."""
    pytest.importorskip("torch", reason="torch is not installed: pip install 'zbuf-occlude[learn]'")
    from tests.studies.paper.light import put_in_place

    put_in_place(monkeypatch)
    monkeypatch.setattr("zbuf_occlude.studies.paper.study.n_cores", lambda: 1)
    monkeypatch.setattr("zbuf_occlude.cli.experiment.QUICK", TINY)
    monkeypatch.setattr("zbuf_occlude.studies.paper.elevation.AREA_OBJECTS", 2)


@pytest.mark.usefixtures("tiny")
def test_elevation(run: Run, tmp_path: Path) -> None:
    out = tmp_path / "study"
    done = run(f"paper elevation --quick --out {out}", says="clouds: 100%")
    assert f"2 classifiers trained or tested now; report: {out / 'study.html'}" in done.out
    assert "classifiers: 100%" in done.err
    assert "VoxNet" in (out / "study.md").read_text()
    assert (out / "elevation.png").stat().st_size > 10_000
    again = run(f"paper elevation --quick --out {out}")
    assert "0 classifiers trained or tested now" in again.out
    full = run(f"paper elevation --out {out}", code=1, says="error: ")
    assert "it holds another (tiny, built-in shapes), with other name, summary, models," in full.err


@pytest.mark.usefixtures("tiny")
def test_a_study_in_parts(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The clock goes on by a minute where it is read; the shards of clouds and a classifier take five."""
    ticks = count()
    monkeypatch.setattr("zbuf_occlude.studies.paper.study.monotonic", lambda: 60.0 * next(ticks))
    line, out = "paper elevation --quick --out study --minutes", tmp_path / "study"
    first = run(f"{line} 1", code=4)
    assert "0 classifiers trained or tested now\n" in first.out
    assert " clouds and 0 of 2 classifiers are done. The same command continues." in first.out
    assert not (out / "study.md").exists()
    second = run(f"{line} 5", code=4)
    assert "1 classifier trained or tested now; report: study/study.html" in second.out
    assert "The time is up: 760 of 760 clouds and 1 of 2 classifiers are done." in second.out
    assert "VoxNet" in (out / "study.md").read_text()
    assert "1 classifier trained or tested now" in run(f"{line} 600").out


@pytest.mark.usefixtures("tiny")
def test_what_is_between_the_sizes(run: Run, tmp_path: Path) -> None:
    out = tmp_path / "study"
    changes = "--objects 5 --seeds 2 --models pointnet --points 40 --epochs 2 --voxels 8"
    done = run(f"paper elevation --quick {changes} --out {out}")
    assert "4 classifiers trained" in done.out
    study = json.loads((out / "study.json").read_text())
    assert study["size"]["name"] == "tiny, pointnet, 2 seeds, 5 objects of a class, 40 points, 2 epochs"
    assert study["objects"] == "built-in shapes as surfaces of 8³ voxels"
    for path in (out / "results").iterdir():
        row = json.loads(path.read_text())
        assert row["facts"]["model"] == "pointnet"
        assert row["config"]["epochs"] == (2 if row["facts"]["split"] == "objects" else 1)
    assert "5 of each class × the paper's" in (out / "study.md").read_text()


@pytest.mark.usefixtures("tiny")
def test_meshes_that_fail_are_named_and_the_exit_code_says_so(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = two_hundred(shapes.collection())[0]
    monkeypatch.setattr(
        "zbuf_occlude.studies.paper.study.find_objects",
        lambda *_, **__: MeshCollection(
            [replace(entry, load=fail) if entry.key == first.key else entry for entry in shapes.collection()]
        ),
    )
    for again in (False, True):
        done = run("paper elevation --quick --out study", code=3)
        assert f"{0 if again else 2} classifiers trained" in done.out
        assert f"1 mesh failed:\n  {first.key}: the file is empty" in done.out
    assert f"1 mesh could not be used: {first.key}." in (tmp_path / "study" / "study.md").read_text()


def fail() -> Mesh:
    """Raise the error of an empty file."""
    raise MeshError("the file is empty")


@pytest.mark.usefixtures("tiny")
@pytest.mark.parametrize(
    ("line", "code", "said"),
    [
        ("augmentation --real .", 2, "No such option"),
        ("realism --sydney .", 2, "No such option"),
        ("realism --quick --real .", 1, "must hold labelled sweeps"),
        ("everything", 2, "No such command 'everything'"),
        ("table3 --quick --out file", 2, "'file' is a file."),
        ("table3 --quick --modelnet study", 1, "there is no folder"),
        ("table3 --quick --modelnet no", 1, "modelnet.cs.princeton.edu"),
        ("table3 --quick --sydney .", 1, "https://www.acfr.usyd.edu.au"),
        ("elevation --budget epochs", 2, "No such option"),
        ("table3 --sydney-up z", 2, "--sydney-up must go with --sydney"),
        ("table3 --epochs 3", 2, "No such option"),
        ("table3 --points many", 2, "it must be N or N,N; got 'many'"),
        ("table3 --minutes 0", 2, "--minutes"),
        ("table3 --minutes nan", 2, "nan is not a finite number"),
        ("table3 --models alexnet", 2, "model must be one of voxnet"),
        ("table3 --quick --objects 41", 2, "objects must lie in 5..40"),
        ("table3 --quick --voxels 1", 2, "voxels must lie in 2..128"),
    ],
)
@pytest.mark.usefixtures("tiny")
def test_what_is_wrong_is_one_line(run: Run, tmp_path: Path, line: str, code: int, said: str) -> None:
    (tmp_path / "file").touch()
    name, _, options = line.partition(" ")
    run(f"paper {name} --out study {options}", code=code, says=said)
    assert not (tmp_path / "study").exists()


@pytest.mark.usefixtures("tiny")
@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("all --objects 41", "paper table3", "objects must lie in 5..40"),
        ("elevation --budget epochs --real .", "paper elevation", "does not use --real, --budget."),
    ],
)
def test_the_old_name_works_and_says_by_what_it_is_replaced(run: Run, old: str, new: str, said: str) -> None:
    first, *_, last = run(f"experiment {old} --out study", code=2).err.splitlines()
    assert first.startswith(f"note: `zbuf-occlude experiment {old.split()[0]}` is now `zbuf-occlude {new}`")
    assert said in last


def test_an_experiment_needs_a_name_and_a_folder(run: Run) -> None:
    run("experiment --out study", code=2, says="Missing argument '{elevation|augmentation|realism|all}'")
    run("paper table3 --quick", code=2, says="Missing option '--out'")
