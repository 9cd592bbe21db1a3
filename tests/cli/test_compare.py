"""`compare`, `report` and `figure` from the command line."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.cli.conftest import Run, write_off
from tests.scenes import box, two_plates
from zbuf_occlude.paper.tables import CASES

QUICK = ("--points", 200, "--seconds", 0.3, "--views", "ring:3@30", "--method", "oracle", "--method")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two meshes of one class, and a broken file."""
    meshes = tmp_path_factory.mktemp("meshes") / "thing"
    for name, mesh in (("thing_1", two_plates()), ("thing_2", box())):
        write_off(meshes / f"{name}.off", mesh.vertices, mesh.faces)
    return meshes


def test_compare_then_report(run: Run, folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    outcome = run("compare", folder, "--out", out, *QUICK, "occupancy_grid:n=8,n_samples=3000")
    assert outcome.code == 0, outcome.err
    assert "4 rows made, 0 found, 0 failed" in outcome.out
    assert "occupancy_grid:n=8,n_samples=3000" in outcome.out
    assert "compare: 100%" in outcome.err
    rows = [json.loads(line) for line in (out / "rows.jsonl").read_text().splitlines()]
    assert [row["case"] for row in rows] == ["thing_1", "thing_1", "thing_2", "thing_2"]
    assert rows[1]["options"] == {"n": 8, "n_samples": 3000}
    assert rows[0]["judged"]["n_views"] == 3

    again = run("compare", folder, "--out", out, *QUICK, "occupancy_grid:n=8,n_samples=3000")
    assert "0 rows made, 4 found, 0 failed" in again.out

    (out / "report.html").unlink()
    outcome = run("report", out)
    assert outcome.code == 0, outcome.err
    assert str(out / "report.html") in outcome.out
    assert (out / "report.html").exists()


def test_a_broken_mesh_is_a_row_and_exit_code_3(run: Run, folder: Path, tmp_path: Path) -> None:
    (tmp_path / "broken.off").write_text("OFF\n1 1 0\n")
    outcome = run(
        "compare", tmp_path / "broken.off", folder / "thing_2.off", "--out", tmp_path / "out", *QUICK, "embree"
    )
    assert outcome.code == 3
    assert "2 rows made, 0 found, 2 failed" in outcome.out
    assert "broken.off" in (tmp_path / "out" / "report.md").read_text()


def test_figure(run: Run, folder: Path, tmp_path: Path) -> None:
    png = tmp_path / "four.png"
    outcome = run("paper", "fig4", folder / "thing_2.off", "--out", png)
    assert outcome.code == 0, outcome.err
    assert outcome.out == f"fig4 of thing_2: {png}\n"
    assert np.asarray(Image.open(png).convert("L")).min() < 128
    old = run("figure", "fig4", "--out", tmp_path / "four.tiff").err.splitlines()
    assert "`zbuf-occlude figure fig4` is now `zbuf-occlude paper fig4`" in old[0]
    assert "--out must end in .png" in old[-1]
    assert "No such option" in run("paper", "fig4", "--method", "embree", "--out", png).err


def test_the_papers_commands_are_listed_without_what_they_import(run: Run) -> None:
    listed = run("paper", "--help").out
    for name in ("table1a", "table1b", "table2", "table3", "elevation", "augmentation", "realism", "fig4", "fig12"):
        assert f"\n  {name} " in listed
        assert run("paper", name, "--help").code == 0


def test_table_1_by_its_own_name_and_by_its_old_one(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    few = [replace(case, subjects=case.subjects[:1]) for case in CASES["table1b"](None, 0)][:1]
    monkeypatch.setitem(CASES, "table1b", lambda root, seed, budget: [replace(case, budget=budget) for case in few])
    made = run("paper", "table1b", "--seconds", 0.2, "--judge-points", 50, "--out", tmp_path / "out")
    assert made.code == 0, made.err
    assert "1 rows made, 0 found, 0 failed" in made.out
    again = run("compare", "--preset", "table1b", "--seconds", 0.2, "--judge-points", 50, "--out", tmp_path / "out")
    assert "0 rows made, 1 found, 0 failed" in again.out
    assert again.err.startswith("note: `zbuf-occlude compare --preset table1b` is now `zbuf-occlude paper table1b`")
