"""`compare`, `report` and `figure` from the command line."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.cli.conftest import Run, write_off
from tests.scenes import box, two_plates
from zbuf_occlude.studies.paper.tables import CASES

QUICK = "--points 200 --seconds 0.3 --views ring:3@30 --method oracle --method"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two meshes of one class."""
    meshes = tmp_path_factory.mktemp("meshes") / "thing"
    for name, mesh in (("thing_1", two_plates()), ("thing_2", box())):
        write_off(meshes / f"{name}.off", mesh.vertices, mesh.faces)
    return meshes


def test_compare_then_report(run: Run, folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    line = f"compare {folder} --out {out} {QUICK} occupancy_grid:n=8,n_samples=3000"
    outcome = run(line, says="compare: 100%")
    assert "4 rows made, 0 found, 0 failed" in outcome.out
    assert "occupancy_grid:n=8,n_samples=3000" in outcome.out
    rows = [json.loads(line) for line in (out / "rows.jsonl").read_text().splitlines()]
    assert [row["case"] for row in rows] == ["thing_1", "thing_1", "thing_2", "thing_2"]
    assert rows[1]["options"] == {"n": 8, "n_samples": 3000}
    assert rows[0]["judged"]["n_views"] == 3

    again = run(line)
    assert "0 rows made, 4 found, 0 failed" in again.out

    (out / "report.html").unlink()
    outcome = run(f"report {out}")
    assert str(out / "report.html") in outcome.out
    assert (out / "report.html").exists()


def test_a_broken_mesh_is_a_row_and_exit_code_3(run: Run, folder: Path, tmp_path: Path) -> None:
    (tmp_path / "broken.off").write_text("OFF\n1 1 0\n")
    outcome = run(f"compare broken.off {folder}/thing_2.off --out out {QUICK} embree", code=3)
    assert "2 rows made, 0 found, 2 failed" in outcome.out
    assert "broken.off" in (tmp_path / "out" / "report.md").read_text()


def test_figure(run: Run, folder: Path, tmp_path: Path) -> None:
    png = tmp_path / "four.png"
    outcome = run(f"paper fig4 {folder}/thing_2.off --out {png}")
    assert outcome.out == f"fig4 of thing_2: {png}\n"
    assert np.asarray(Image.open(png).convert("L")).min() < 128
    run(f"figure fig4 --out {png}", says="`zbuf-occlude figure fig4` is now `zbuf-occlude paper fig4`")


def test_the_papers_commands_are_listed_without_what_they_import(run: Run) -> None:
    listed = run("paper --help").out
    for name in ("table1a", "table1b", "table2", "table3", "elevation", "augmentation", "realism", "fig4", "fig12"):
        assert f"\n  {name} " in listed
        run("paper", name, "--help")


def test_table_1_by_its_own_name_and_by_its_old_one(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    few = [replace(case, subjects=case.subjects[:1]) for case in CASES["table1b"](None, 0)][:1]
    monkeypatch.setitem(CASES, "table1b", lambda root, seed, budget: [replace(case, budget=budget) for case in few])
    made = run("paper table1b --seconds 0.2 --judge-points 50 --out out")
    assert "1 rows made, 0 found, 0 failed" in made.out
    again = run("compare --preset table1b --seconds 0.2 --judge-points 50 --out out")
    assert "0 rows made, 1 found, 0 failed" in again.out
    assert again.err.startswith("note: `zbuf-occlude compare --preset table1b` is now `zbuf-occlude paper table1b`")
