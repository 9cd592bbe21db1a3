"""Mistyped words: one line names each, says what there is and which was meant; and pages of help."""

import re
import shlex
from pathlib import Path

import numpy as np
import pytest

from tests.cli.conftest import Run, write_off
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
    outcome = run(*shlex.split(line))
    assert (outcome.code, outcome.out) == (2, "")
    *before, last = outcome.err.splitlines()
    assert last.startswith("error: ")
    assert said in last
    assert not any(each.startswith(("error", "Error", "Usage", "Traceback")) for each in before)


SHARES = ("3", "2/2", "-1/2", "a/b", "0/0")
OF_A_CAMERA = "--azimuth 0 --elevation 9 --out a.ply"


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("generate a.off --method oracle --set contact=5", "contact must lie in [0, 1)"),
        ("generate a.off --method oracle --density=-1", "density must be positive; got -1"),
        ("generate a.off --method oracle --points 7 --density 2", "exclude each other"),
        *((f"generate a.off --method oracle --shard={share}", f"0 <= I < N; got {share!r}") for share in SHARES),
        ("generate a.off --out ''", "it must be the name of a folder; it is empty. For this folder, write a dot."),
        ("generate '' --out o", "it must be the name of a file or folder; it is empty. For this folder, write a dot."),
        ("compare '' --out o", "it must be the name of a file or folder; it is empty"),
        ("verify . ''", "it must be the name of a file or folder; it is empty"),
        (f"visible a.off {OF_A_CAMERA} --azimuth nan", "nan is not a finite number"),
        (f"visible a.off {OF_A_CAMERA} --elevation nan", "--elevation"),
        (f"visible a.off {OF_A_CAMERA} --distance nan", "--distance"),
        (f"visible a.off {OF_A_CAMERA} --method auto", "it is for `generate` only. Name a method here"),
        (
            "visible a.off --azimuth 0 --elevation 9 --out no/a.ply",
            "--out must be in a folder that there is; 'no' is none.",
        ),
        ("depth a.off --azimuth 0 --elevation 9 --out a.jpg", "--out must end in .png, .npy, .exr"),
        ("compare a.off --out o --method auto", "it is for `generate` only. Name a method here"),
        ("compare a.off --out o --method crystal_ball", "method must be one of"),
        ("compare a.off --out o --method occupancy_grid:", "--method must be NAME or NAME:KEY=VALUE"),
        ("compare a.off --out o --method occupancy_grid:cells=3", "got 'cells'"),
        ("compare a.off --out o --method occupancy_grid:n", "KEY=VALUE; got 'n'"),
        ("compare a.off --out o --method oracle --views nowhere", "views must be"),
        ("compare --out o --preset table1a --method exact", "--method must go with MESH_OR_DIR; table1a alone has"),
        ("compare --out o --preset scaling --points 9 --limit 2", "--points, --limit must go with MESH_OR_DIR"),
        ("compare --out o --modelnet .", "--modelnet must go with --preset table1a or table1b"),
        ("compare --out o --preset scaling --modelnet .", "--modelnet must go with --preset table1a or table1b"),
        ("figure fig4 --method embree --out a.png", "fig4 does not use --method. Leave it out."),
        ("figure fig9 a.off --set a=1 --out a.png", "fig9 does not use"),
        ("figure fig10 --sydney . --out a.png", "fig10 does not use --sydney."),
        ("figure fig10 --up y --out a.png", "a built-in shape does not use --up."),
        ("sensors --picture a.png", "--picture shows one sensor's rays; name the sensor."),
        ("sensors vlp-16 --picture a.gif", "must end in .png; got 'a.gif'"),
        ("sensors none.yaml", "a file must be readable"),
        ("scan a.off --azimuth nan --out a.ply", "nan is not a finite number"),
        ("scan a.off --elevation inf --out a.ply", "inf is not"),
        ("scan a.off --scene ground --elevation 40 --out a.ply", "--elevation must go without a ground"),
        ("scan a.off --set-sensor lasers=3 --out a.ply", "lasers of a sensor must be rows of 2 numbers"),
    ],
)
def test_what_is_refused_leaves_nothing(run: Run, tmp_path: Path, line: str, said: str) -> None:
    write_off(tmp_path / "a.off", np.eye(3), np.array([[0, 1, 2]]))
    outcome = run(*shlex.split(line))
    assert (outcome.code, outcome.out) == (2, "")
    assert said in outcome.err.splitlines()[-1]
    assert [path.name for path in tmp_path.iterdir()] == ["a.off"]


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("generate nowhere --method oracle --out o", "there is no such file or folder"),
        ("report .", "must hold a comparison's rows.jsonl"),
        ("show .", "it has no plan.json"),
        ("status .", "must hold a dataset; it has no plan.json"),
        ("merge .", "must hold a dataset; it has no plan.json"),
        (f"visible a.off --method oracle --points {10**26} {OF_A_CAMERA}", "n_points must be at most 2^31 - 1"),
    ],
)
def test_what_cannot_be_done_is_one_line(run: Run, tmp_path: Path, line: str, said: str) -> None:
    write_off(tmp_path / "a.off", np.eye(3), np.array([[0, 1, 2]]))
    outcome = run(*shlex.split(line))
    assert (outcome.code, outcome.out) == (1, "")
    assert outcome.err.splitlines()[-1].startswith("error: ")
    assert said in outcome.err


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
