"""Commands `methods`, `doctor` and `sensors`; closed streams, memory limits and a removed current folder."""

import json
import subprocess
import sys
from pathlib import Path

import click
import numpy as np
import pytest
from PIL import Image

from tests.cli.conftest import Run, write_off
from zbuf_occlude import METHODS
from zbuf_occlude.cli import COMMANDS, group
from zbuf_occlude.cli.shell import LONG, PANELS
from zbuf_occlude.engines.gl.probe import Probe
from zbuf_occlude.sensors import SENSORS


def test_standard_streams_may_be_closed(tmp_path: Path) -> None:
    """Closed standard streams, as daemons have: no file may replace them, and progress bars must not fail."""
    options = "--limit 1 --method oracle --views ring:1@0 --points 50 --sample-size 8 --workers 1"
    command = f"exec {sys.executable} -m zbuf_occlude generate {options} --out out <&- >&- 2>&-"
    assert subprocess.run(["sh", "-c", command], cwd=tmp_path, check=False).returncode == 0
    assert (tmp_path / "out" / "manifest.json").is_file()


@pytest.mark.parametrize(
    ("before", "code", "said"),
    [
        ("export NUMBA_NUM_THREADS=0", 2, "NUMBA_NUM_THREADS must be 1 or more; it is 0."),
        ("ulimit -v 200000", 1, "the limit of address space must be at least 786,432 kB; it is 200,000"),
        ('cd "$(mktemp -d)" && rmdir "$PWD"', 1, "The current folder no longer exists."),
    ],
)
def test_a_shell_that_lets_nothing_compiled_run_is_told_in_a_line(before: str, code: int, said: str) -> None:
    command = f"{before}; exec {sys.executable} -m zbuf_occlude generate --limit 1 --dry-run"
    done = subprocess.run(["sh", "-c", command], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (code, "", 1)
    assert done.stderr.startswith(f"error: {said}")


def test_methods_lists_the_table(run: Run) -> None:
    rows = json.loads(run("methods --json").out)
    assert [row["name"] for row in rows] == [method.name for method in METHODS]
    text = run("methods").out
    assert "oracle  [exact, first hits]" in text
    assert "--set contact=1e-05" in text


@pytest.mark.parametrize("name", COMMANDS)
def test_each_option_of_a_long_help_has_a_panel(name: str) -> None:
    command = group.get_command(click.Context(group), name)
    assert command is not None
    shown = [each.name for each in command.params if isinstance(each, click.Option) and not each.hidden]
    if len(shown) >= LONG:
        assert set(shown) <= set(" ".join(PANELS.values()).split())


def test_doctor_says_what_works(run: Run) -> None:
    report = json.loads(run("doctor --json").out)
    backends = {row["backend"] for row in report["gl"]}
    assert backends == {"egl", "osmesa"}
    for row in report["gl"]:
        assert row["renderer"] if row["works"] else row["reason"]
    assert report["methods"]["oracle"] == ""


@pytest.mark.parametrize(("named", "works"), [("", True), ("osmesa", True), ("egl", False), ("egl:0", False)])
def test_doctor_judges_the_backend_that_is_taken(
    run: Run, monkeypatch: pytest.MonkeyPatch, named: str, works: bool
) -> None:
    probes = (
        Probe("egl", 0, works=False, reason="/nowhere not loaded.", fix="unset GLCONTEXT_LINUX_LIBEGL"),
        Probe("osmesa", None, works=True, renderer="llvmpipe", version="4.5", is_software=True),
    )
    monkeypatch.setattr("zbuf_occlude.cli.lists.probe_all", lambda: probes)
    monkeypatch.setattr(
        "zbuf_occlude.cli.lists.reason_missing", lambda method: ""
    )  # tests/base/test_extras.py tries packages
    monkeypatch.setenv("ZBUF_OCCLUDE_GL", named)
    outcome = run("doctor")  # exact can run, whatever OpenGL does
    assert "OpenGL backends" in outcome.out
    assert "egl, device 0: does not work: /nowhere not loaded.\n    fix: unset GLCONTEXT_LINUX_LIBEGL" in outcome.out
    assert ("depth_buffer           ready" in outcome.out) == works
    assert ("which does not work" in outcome.out) != works
    assert f"generate can run: {'depth_buffer' if works else 'exact'}" in outcome.out


@pytest.mark.parametrize("line", ["", "paper"])
def test_a_group_alone_shows_its_help(run: Run, line: str) -> None:
    outcome = run(line)
    assert outcome == run(f"{line} --help")
    assert outcome.out.count("\n") > 20
    assert outcome.err == ""


def test_sensors_lists_the_table(run: Run) -> None:
    out = run("sensors").out
    assert [line.split()[0] for line in out.splitlines()] == list(SENSORS)
    documents = json.loads(run("sensors --json").out)
    assert [document["name"] for document in documents] == list(SENSORS)
    assert all(number["source"] for document in documents for number in document["numbers"].values())


def test_one_sensor_and_its_picture(run: Run, tmp_path: Path) -> None:
    picture = tmp_path / "rays.png"
    outcome = run(f"sensors vlp-32c --picture {picture}")
    assert "57,600 rays, elevations -25.00 to 15.00 degrees" in outcome.out
    assert "columns = 1800    [0.2 degrees at 10 turns a second, maker's manual]" in outcome.out
    with Image.open(picture) as image:
        assert len(image.getcolors(10**7)) > 100


def test_what_files_hold_makes_no_second_line(run: Run, tmp_path: Path) -> None:
    write_off(tmp_path / "a.off", np.eye(3), np.array([[0, 1, 2]]))
    (tmp_path / "s.yaml").write_text('kind: spinning\nlasers: [1]\ncolumns: 9\nname: "a\\nerror: b"\n')
    (tmp_path / "s.json").write_text('{"objects": [{"mesh": "a.off\\nerror: b", "position": [0, 0, 0]}]}')
    (tmp_path / "c.json").write_text(f'[{{"R": [[{"9" * 401}, 0, 0]], "t": [0, 0, 0]}}]')
    for line in (
        "sensors s.yaml",
        "scan a.off --sensor vlp-16 --scene s.json --range 5 --size 1 --out o.ply",
        "visible a.off --method oracle --cameras c.json --out o.ply",
    ):
        outcome = run(line, code=2)
        assert outcome.out == ""
        assert len([words for words in outcome.err.splitlines() if words.startswith("error: ")]) == 1, outcome.err


@pytest.mark.parametrize(
    ("arguments", "completes", "starts"),
    [
        (["generate", "no-such-folder"], False, True),
        (["generate", "--help"], False, False),
        (["generate", "no-such-folder", "--dry-run"], False, False),
        (["generate", "no-such-folder", "--engine", "ray"], False, False),
        (["generate", "no-such-folder", "--engine=ray"], False, False),
        (["generate", "no-such-folder"], True, False),
        (["sensors"], False, False),
    ],
)
def test_the_server_of_workers_starts_where_there_will_be_workers(
    monkeypatch: pytest.MonkeyPatch, arguments: list[str], completes: bool, starts: bool
) -> None:
    started: list[str] = []
    monkeypatch.setattr("zbuf_occlude.datasets.workers.local.start_server", lambda: started.append("server"))
    context = click.Context(group, resilient_parsing=completes)
    name, command, rest = group.resolve_command(context, arguments)
    assert (name, rest) == (arguments[0], arguments[1:])
    assert command is not None
    assert started == ["server"] * starts
