"""What Linux has and other systems lack is asked for, not assumed."""

import ast
import os
import signal
from pathlib import Path

import pytest

from zbuf_occlude.farm import worker
from zbuf_occlude.limits import Limits
from zbuf_occlude.versions import n_cores

PACKAGE = Path(worker.__file__).parents[1]


def test_a_worker_elsewhere_asks_no_kernel_to_kill_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.platform", "win32")
    monkeypatch.setattr("ctypes.CDLL", lambda *a, **k: pytest.fail("prctl is Linux's"))
    worker.die_with_parent(-1)


def test_cores_where_the_system_does_not_say(monkeypatch: pytest.MonkeyPatch) -> None:
    assert 1 <= n_cores() <= (os.cpu_count() or 1)
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
