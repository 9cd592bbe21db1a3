"""What Linux has and other systems lack is asked for, not assumed."""

import ast
import os
import signal
import sys
from pathlib import Path

import pytest

import zbuf_occlude
from tests.processes import python, run_program
from zbuf_occlude.base.cores import n_cores
from zbuf_occlude.base.limits import Limits

PACKAGE = Path(zbuf_occlude.__file__).parent


def test_cores_where_the_system_does_not_say(monkeypatch: pytest.MonkeyPatch) -> None:
    assert 1 <= n_cores() <= (os.cpu_count() or 1)
    monkeypatch.setattr("zbuf_occlude.base.cores.n_by_quota", lambda: None)
    monkeypatch.delattr(os, "sched_getaffinity", raising=False)
    assert n_cores() == os.cpu_count()


def test_limits_where_there_is_no_alarm(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(signal, "SIGALRM", raising=False)
    with Limits().watch():
        pass


@pytest.mark.parametrize("path", sorted(PACKAGE.rglob("*.py")), ids=lambda path: str(path.relative_to(PACKAGE)))
def test_modules_that_only_unix_has_are_not_imported(path: Path) -> None:
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
        names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
        assert not {"fcntl", "resource", "pwd", "grp", "termios"} & {name.partition(".")[0] for name in names}


ON_LINUX = pytest.mark.skipif(sys.platform != "linux", reason="other systems are imitated on Linux")
AS_THERE = Path(__file__).parent / "other_systems"
JOB = ["generate", "--limit", "6", "--views", "ring:4@20", "--points", "400"]
JOB += ["--sample-size", "64", "--method", "exact"]


def command(folder: Path, *words: str, **variables: str) -> str:
    """Run zbuf-occlude in a process of its own, in a folder and with these variables; return what it says."""
    run = python("-m", "zbuf_occlude", *words, cwd=folder, **variables)
    assert run.returncode == 0, run.stdout + run.stderr
    return run.stdout + run.stderr


@pytest.fixture(scope="module")
def made_here(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("here")
    command(folder, *JOB, "--workers", "1", "--out", "out")
    return folder / "out"


@ON_LINUX
@pytest.mark.parametrize("system", [pytest.param("darwin", marks=pytest.mark.long), "win32"])
def test_the_whole_job_without_what_only_linux_has(system: str, made_here: Path, tmp_path: Path) -> None:
    """Workers are spawned; nothing of Unix, no /proc, and (Windows) no change to open files is asked for."""
    as_there = {"PYTHONPATH": str(AS_THERE), "AS_ON": system}
    command(tmp_path, *JOB, "--workers", "2", "--out", "out", **as_there)
    files = sorted(path.name for path in made_here.glob("*.h5"))
    assert len(files) == 3
    for name in files:
        assert (tmp_path / "out" / name).read_bytes() == (made_here / name).read_bytes()
    assert "the dataset is what its manifest says" in command(tmp_path, "verify", "out", **as_there)


@ON_LINUX
def test_what_imitates_windows_bites(tmp_path: Path) -> None:
    """Without it the test above would hold of anything."""
    (tmp_path / "zbuf_occlude").mkdir()
    (tmp_path / "zbuf_occlude" / "__init__.py").write_text(
        "import os, signal, sys\n"
        "assert sys.platform == 'win32' and not hasattr(os, 'register_at_fork') and not hasattr(signal, 'SIGKILL')\n"
        "file = open('held', 'w')\n"
        "for wrong in (lambda: os.unlink('held'), lambda: exec('import fcntl'), lambda: open('/proc/self/stat')):\n"
        "    try:\n"
        "        wrong()\n"
        "    except (OSError, ModuleNotFoundError):\n"
        "        continue\n"
        "    raise SystemExit('not refused')\n"
        "print('refused')\n"
    )
    paths = f"{AS_THERE}{os.pathsep}{tmp_path}"
    run = run_program("import zbuf_occlude", cwd=tmp_path, PYTHONPATH=paths, AS_ON="win32")
    assert run.stdout == "refused\n", run.stderr
