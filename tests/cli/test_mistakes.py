"""Mistyped words: one line names each, says what there is and which was meant; and pages of help."""

import re
from pathlib import Path

import pytest

from tests.cli.conftest import Run
from zbuf_occlude.cli import COMMANDS


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("genrate", "No such command 'genrate'. Did you mean 'generate'?"),
        ("paper tabel2", "No such command 'tabel2'. Did you mean 'table2'?"),
        ("generate --overwrit", "No such option '--overwrit'"),
        ("generate --method exakt", "got 'exakt'. Did you mean 'exact'?"),
        ("generate --method 'depth buffer'", "Did you mean 'depth_buffer'?"),
        ("generate --format hdf", "got 'hdf'. Did you mean 'hdf5'?"),
        ("generate --preset modelnet40c-lidar", "Did you mean 'modelnet40-c-lidar'?"),
        ("generate --sensor hdl64e", "got 'hdl64e'. Did you mean 'hdl-64e'?"),
        ("generate --sensor vlp-16 --set-sensor colums=9", "got 'colums'. Did you mean 'columns'?"),
        ("generate --sensor vlp-16 --scene streat", "got 'streat'. Did you mean 'street'?"),
        ("sensors VLP16", "got 'VLP16'. Did you mean 'vlp-16'?"),
        ("generate --method exact --set contakt=1", "got 'contakt'. Did you mean 'contact'?"),
        ("generate --set resolution 1024", "got 'resolution'. In one word: --set resolution=VALUE."),
        ("generate --sensor vlp-16 --set-sensor columns 9", "--set-sensor must be given KEY=VALUE; got 'columns'."),
        ("generate --method exact --views rng:8@30", "got 'rng:8@30'. There is no 'rng'. Did you mean 'ring'?"),
        ("generate --method exact --views ring:8", "After ring: must come N@EL; got '8'."),
        ("generate --method exact --views paper100:3", "paper100 takes nothing after it."),
        ("visible '' --azimuth 0 --elevation 0 --out a.ply", "it must be the name of a file or folder; it is empty"),
        ("depth '' --azimuth 0 --elevation 0 --out a.png", "it must be the name of a file or folder; it is empty"),
        ("scan '' --out a.ply", "it must be the name of a file or folder; it is empty"),
    ],
)
def test_a_mistake_is_one_line_that_says_what_was_meant(run: Run, line: str, said: str) -> None:
    words = [word.strip("'") for word in re.findall(r"'[^']*'|\S+", line)]
    outcome = run(*words)
    assert (outcome.code, outcome.out) == (2, "")
    *before, last = outcome.err.splitlines()
    assert last.startswith("error: ")
    assert said in last
    assert not any(each.startswith(("error", "Error", "Usage", "Traceback")) for each in before)


def test_no_bar_begins_before_the_folder_is_refused(run: Run) -> None:
    said = run(
        "generate", "--limit", 1, "--views", "ring:1@0", "--method", "exact", "--workers", 1, "--out", "/proc/foo"
    )
    assert said.code == 1
    assert said.err.splitlines()[-1].startswith("error: ")
    assert "generate:" not in said.err


@pytest.mark.parametrize("name", COMMANDS)
def test_every_option_has_its_line_and_many_come_in_panels(
    run: Run, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "118")
    page = run(name, "--help").out
    rows = re.findall(r"^  (?:-\w, )?--[\w-]+.*$", page, re.MULTILINE)
    if len(rows) >= 10:
        panels = re.findall(r"^(\w+):$", page.partition("\nOptions:\n")[2], re.MULTILINE)
        assert {"Output", "Execution"} <= set(panels)
        assert len(panels) >= 3
    assert "INTEGER" not in page
    assert "x>=" not in page


def test_sizes_and_times_are_in_units_of_people(run: Run, modelnet: Path) -> None:
    outcome = run("generate", modelnet, "--method", "exact", "--views", "ring:2@20", "--points", 200, "--dry-run")
    assert re.search(r"^about \S+ [kM]?B on disk; at most \S+ [kMG]?B while it works$", outcome.out, re.MULTILINE)
    assert re.search(r"^about \S+ (seconds|minutes) on one processor core, give or take ", outcome.out, re.MULTILINE)
    assert re.search(r"\(\S+ [kMGT]B free\)$", outcome.out, re.MULTILINE)
