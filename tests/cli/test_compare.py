"""`compare`, `report` and `figure` from the command line."""

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.cli.conftest import Run, write_off
from tests.scenes import box, two_plates
from zbuf_occlude.paper.presets import preset

QUICK = ("--points", 200, "--seconds", 2, "--views", "ring:3@30", "--method", "oracle", "--method")


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


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--method", "crystal_ball"), "method must be one of"),
        (("--method", "occupancy_grid:"), "--method must be NAME or NAME:KEY=VALUE"),
        (("--method", "occupancy_grid:cells=3"), "got 'cells'"),
        (("--method", "occupancy_grid:n"), "KEY=VALUE; got 'n'"),
        (("--method", "oracle", "--views", "nowhere"), "views must be"),
    ],
)
def test_what_is_refused(run: Run, folder: Path, tmp_path: Path, arguments: tuple[str, ...], message: str) -> None:
    outcome = run("compare", folder, "--out", tmp_path / "out", *arguments)
    assert outcome.code == 2
    assert outcome.err.startswith("error: ")
    assert message in outcome.err
    assert not (tmp_path / "out").exists()


def test_report_of_an_empty_folder(run: Run, tmp_path: Path) -> None:
    outcome = run("report", tmp_path)
    assert outcome.code == 1
    assert "must hold a comparison's rows.jsonl" in outcome.err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--preset", "table1a", "--method", "exact"), "--method must go with MESH_OR_DIR; table1a alone has"),
        (("--preset", "scaling", "--points", "9", "--views", "ring:3@0", "--limit", "2"), "--views, --points, --limit"),
        (("--modelnet", "."), "--modelnet must go with --preset table1a or table1b"),
        (("--preset", "scaling", "--modelnet", "."), "--modelnet must go with --preset table1a or table1b"),
    ],
)
def test_options_that_nothing_would_look_at_are_refused(
    run: Run, tmp_path: Path, arguments: tuple[str, ...], message: str
) -> None:
    outcome = run("compare", "--out", tmp_path / "out", *arguments)
    assert (outcome.code, message in outcome.err) == (2, True), outcome
    assert not (tmp_path / "out").exists()


def test_seconds_are_the_presets_too() -> None:
    assert {case.budget for case in preset("table1b", root=None, seed=0)} == {30.0}
    assert {case.budget for case in preset("table1b", root=None, seed=0, budget=0.5)} == {0.5}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("fig4", "--method", "embree"), "fig4 (division of large faces) does not use --method. Leave it out."),
        (("fig9", "thing.off", "--set", "a=1"), "fig9 (objects made by formulas) does not use --set, MESH."),
        (("fig10", "--sydney", "."), "fig10 (clouds at four azimuths) does not use --sydney."),
        (("fig10", "--up", "y"), "fig10 (clouds at four azimuths) does not use --up."),
    ],
)
def test_figures_refuse_what_they_do_not_use(
    run: Run, tmp_path: Path, arguments: tuple[str, ...], message: str
) -> None:
    outcome = run("figure", *arguments, "--out", tmp_path / "a.png")
    assert (outcome.code, message in outcome.err) == (2, True), outcome


def test_figure(run: Run, folder: Path, tmp_path: Path) -> None:
    png = tmp_path / "four.png"
    outcome = run("figure", "fig4", folder / "thing_2.off", "--out", png)
    assert outcome.code == 0, outcome.err
    assert outcome.out == f"fig4 of thing_2: {png}\n"
    assert np.asarray(Image.open(png).convert("L")).min() < 128
    assert "--out must end in .png" in run("figure", "fig4", "--out", tmp_path / "four.tiff").err
