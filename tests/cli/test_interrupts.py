"""Ctrl-C at any time, SIGTERM and SIGHUP: one line is printed, and no file is left."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(os.name != "posix", reason="Windows has no such signals")

LONG = ("generate", "--method=oracle", "--views=paper100", "--points=50000", "--workers=1")
BRIEF = ("generate", "--limit=1", "--method=oracle", "--views=ring:1@0", "--points=50", "--sample-size=8")


def heard() -> None:
    """Reset all signals in a child, in case the tests run in the background of a shell."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_DFL)


@pytest.mark.parametrize("by", ["module", "script"])
def test_ctrl_c_while_the_command_line_is_imported_is_no_traceback(tmp_path: Path, by: str) -> None:
    """Interrupt during the import of click."""
    (tmp_path / "click.py").write_text("import os, signal; os.kill(os.getpid(), signal.SIGINT)\n")
    script = tmp_path / "zbuf-occlude"
    script.write_text("from zbuf_occlude.__main__ import main; main()\n")
    ended = subprocess.run(
        [sys.executable, *(["-m", "zbuf_occlude"] if by == "module" else [str(script)]), "methods"],
        env={**os.environ, "PYTHONPATH": str(tmp_path)},
        preexec_fn=heard,
        capture_output=True,
        text=True,
        check=False,
    )
    assert (ended.returncode, ended.stdout, ended.stderr) == (-signal.SIGINT, "", "")


def test_who_imports_the_package_keeps_pythons_interrupts() -> None:
    program = "import signal, zbuf_occlude; assert signal.getsignal(signal.SIGINT) is signal.default_int_handler"
    subprocess.run([sys.executable, "-c", program, "zbuf_occlude"], preexec_fn=heard, check=True)


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_what_asks_a_run_to_end_is_an_interrupt(tmp_path: Path, name: str) -> None:
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    with subprocess.Popen(
        [sys.executable, "-m", "zbuf_occlude", *LONG, "--out", str(tmp_path / "out")],
        env={**os.environ, "TMPDIR": str(temporary)},
        preexec_fn=heard,
        stderr=subprocess.PIPE,
        text=True,
    ) as run:
        assert run.stderr is not None
        said = ""
        while "clouds/s" not in said:  # the bar: workers are at it
            said += run.stderr.read(1)
        run.send_signal(getattr(signal, name))
        said += run.stderr.read()
    assert run.returncode == 130
    assert said.endswith("error: interrupted; what was finished is kept, and the same command resumes.\n")
    assert "Traceback" not in said
    assert list(temporary.iterdir()) == []


@pytest.mark.parametrize(("command", "resumes"), [("generate", True), ("drive", False), ("view", False)])
def test_only_commands_that_resume_say_so(command: str, resumes: bool) -> None:
    program = (
        "from zbuf_occlude import __main__ as program\n"
        "def interrupted(**options): raise KeyboardInterrupt\n"
        "program.group.main = interrupted\n"
        "program.main()\n"
    )
    ended = subprocess.run([sys.executable, "-c", program, command], capture_output=True, text=True, check=False)
    assert ended.returncode == 130
    assert ("resumes" in ended.stderr) == resumes
    assert ("begins anew" in ended.stderr) != resumes


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
@pytest.mark.parametrize("command", ["methods", "no-such-command"])
def test_a_signal_while_python_exits_is_no_traceback(name: str, command: str) -> None:
    program = (
        "import atexit, os, signal\n"
        "from zbuf_occlude.__main__ import main\n"
        f"atexit.register(lambda: os.kill(os.getpid(), signal.{name}))\n"
        "main()\n"
    )
    ended = subprocess.run(
        [sys.executable, "-c", program, command], preexec_fn=heard, capture_output=True, text=True, check=False
    )
    assert ended.returncode == -getattr(signal, name)
    assert "Traceback" not in ended.stderr
    assert "KeyboardInterrupt" not in ended.stderr


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_a_signal_in_a_destructor_is_not_lost(name: str) -> None:
    """Jobs in the background ignore SIGINT alone."""
    program = (
        "import os, signal, time\n"
        f"signal.signal(signal.SIGINT, signal.SIG_{'DFL' if name == 'SIGINT' else 'IGN'})\n"
        "from zbuf_occlude import __main__ as program\n"
        "class Slow:\n"
        f"    def __del__(self): os.kill(os.getpid(), signal.{name})\n"
        "def command(**options):\n"
        "    Slow()\n"
        "    time.sleep(60)\n"
        "program.group.main = command\n"
        "program.main()\n"
    )
    ended = subprocess.run(
        [sys.executable, "-c", program, "generate"],
        preexec_fn=heard,
        capture_output=True,
        text=True,
        timeout=30,
        check=False,
    )
    assert ended.returncode == 130
    assert ended.stderr == "error: interrupted; what was finished is kept, and the same command resumes.\n"


def test_nohup_is_heeded(tmp_path: Path) -> None:
    """A program started with nohup is not interrupted when its terminal is closed."""
    with subprocess.Popen(
        [sys.executable, "-m", "zbuf_occlude", *BRIEF, "--out", str(tmp_path / "out")],
        preexec_fn=lambda: signal.signal(signal.SIGHUP, signal.SIG_IGN) and None,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    ) as run:
        assert run.stderr is not None
        run.stderr.read(1)
        run.send_signal(signal.SIGHUP)
        run.stderr.read()
    assert run.returncode == 0
