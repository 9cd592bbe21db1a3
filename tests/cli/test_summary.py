"""What `generate` says at the end: how wrong the data are, where they are worst, and what would help."""

import json
import subprocess
import sys
import time
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

from tests.cli.conftest import Run, write_off
from tests.scenes import SQUARE, stacked
from zbuf_occlude.cli.messages import format_error_rates
from zbuf_occlude.cli.shell import progress_bar
from zbuf_occlude.datasets.counts import QualityCounts, WorstView


def test_counts_add_up_and_keep_the_worst() -> None:
    one = QualityCounts(
        n_checked=64, false_visible=1, n_views_checked=4, n_bad_views=1, worst=WorstView(0.2, "a", 0, 3)
    )
    other = QualityCounts(n_checked=64, false_hidden=2, n_views_checked=4, worst=WorstView(0.01, "b", 1, 2))
    total = sum([QualityCounts(faces_dropped={"duplicate": 2}), other, one], QualityCounts())
    assert total == QualityCounts.from_dict(json.loads(json.dumps(asdict(total))))
    error = total.error
    assert error["worst_view"] == {"share": 0.2, "mesh": "a", "variation": 0, "view": 3}
    assert (error["bad_views"], error["false_visible"], error["false_hidden"]) == (1 / 8, 1 / 128, 2 / 128)
    assert total.faces_dropped == {"duplicate": 2}


@pytest.mark.parametrize(("share", "warned"), [(0.05, False), (0.06, True)])
def test_the_worst_view_is_a_warning_under_a_good_mean(share: float, warned: bool) -> None:
    counts = QualityCounts(n_checked=10**6, false_visible=900, n_views_checked=100, n_bad_views=3)
    text = format_error_rates((counts + QualityCounts(worst=WorstView(share, "chair", 0, 7))).error, False)
    warning = (
        "warning: 6% of the points checked in view 7 of chair are wrong, and more than 1 % in 3.0% of the views checked"
    )
    assert (warning in text, "--method exact" in text) == (warned, warned)


def test_what_was_not_checked_has_no_error() -> None:
    """Clouds of which none was checked are not called complete, nor right."""
    assert "nothing was removed" in format_error_rates(QualityCounts().error, True)
    said = format_error_rates(QualityCounts(n_clouds=3).error, False)
    assert said.startswith("warning: ")
    assert "not known" in said
    assert "%" not in said


def test_a_bar_in_a_file_is_seldom_drawn_again(capsys: pytest.CaptureFixture[str]) -> None:
    """It has the first progress, and the last."""
    with progress_bar(100_000, "clouds", "generate") as bar:
        time.sleep(0.01)
        for _ in range(500):
            bar.update(1)
    drawn = capsys.readouterr().err.split("\r")
    assert 2 <= len(drawn) <= 6
    assert "500/100000" in drawn[-1]


def test_stacked_sheets_are_warned_of(run: Run, tmp_path: Path) -> None:
    """Thin sheets, nearer to each other than a coarse grid can tell, in a method that tells no more."""
    sheets = stacked(*(SQUARE + np.array([0, 0, 0.002 * sheet]) for sheet in range(8)))
    write_off(tmp_path / "stack.off", sheets.vertices, sheets.faces)
    line = "generate stack.off --views ring:4@60 --points 500 --sample-size 64 --workers 1"
    outcome = run(f"{line} --method occupancy_grid --out grid")
    assert "warning: " in outcome.out
    assert " of stack.off are wrong" in outcome.out
    error = json.loads((tmp_path / "grid" / "manifest.json").read_text())["error"]
    assert error["worst_view"]["share"] > 0.05
    assert error["bad_views"] > 0
    assert "warning" not in run(f"{line} --method exact --out exact").out


def test_modules_of_the_current_folder_are_not_run(tmp_path: Path) -> None:
    """In a process of its own, whose interpreter starts in the folder."""
    for name in ("zbuf_occlude", "pickle", "random"):
        (tmp_path / f"{name}.py").write_text(f"open({str(tmp_path / ('ran_' + name))!r}, 'w').close()\n")
    generate = "generate --limit 1 --method oracle --views ring:1@0 --points 50 --sample-size 8 --workers 2 --out out"
    for line in (generate, "doctor"):
        command = [sys.executable, "-P", "-m", "zbuf_occlude", *line.split()]
        child = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert child.returncode == 0, child.stderr
    assert not list(tmp_path.glob("ran_*"))


def test_clouds_that_the_layout_has_no_place_for_are_told_apart(run: Run, tmp_path: Path) -> None:
    sampled = "--limit 2 --points 16384 --views random:8 --sample-size 8 --method exact --workers 1"
    outcome = run(f"generate {sampled} --format pcn --out out")
    n_partial = len(list(tmp_path.glob("out/*/partial/*/*/*.pcd")))
    assert n_partial < 16
    assert outcome.out.startswith(f"{n_partial} clouds (16 made; pcn has no place for the others) of 2 meshes, ")
    assert json.loads((tmp_path / "out" / "manifest.json").read_text())["counts"]["clouds"] == n_partial
    assert f"clouds      {n_partial}\n" in run("status out").out
