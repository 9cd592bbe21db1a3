"""Child process: results, errors, crash, timeout and progress; it ends with its parent."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from typing import Any

import pytest

from tests.processes import ended
from zbuf_occlude import OptionError
from zbuf_occlude.base.child import Child, ChildFailed, report_progress


@pytest.fixture
def child() -> Iterator[Child]:
    one = Child()
    yield one
    one.kill()


def ask(child: Child, function: Any, *args: Any, timeout: float | None = None) -> Any:
    child.start(function, *args)
    return child.answer(timeout)


def refuse() -> None:
    raise OptionError("n must be 3; got 4.")


def hold_something_that_cannot_be_sent() -> None:
    raise ValueError(lambda: None)


def count(n: int) -> int:
    for i in range(n):
        report_progress("counted", i)
    return n


def test_one_call_after_the_other_errors_between(child: Child) -> None:
    assert ask(child, divmod, 17, 5) == (3, 2)
    with pytest.raises(OptionError, match="n must be 3"):
        ask(child, refuse)
    with pytest.raises(RuntimeError, match="ValueError: "):
        ask(child, hold_something_that_cannot_be_sent)
    assert ask(child, abs, -1) == 1, "the same process goes on"
    heard: list[tuple[str, int]] = []
    child.start(count, 3)
    while not child.finished(lambda *told: heard.append(told)):
        pass
    assert (heard, child.result) == ([("counted", 0), ("counted", 1), ("counted", 2)], 3)


@pytest.mark.parametrize(
    ("call", "reason"),
    [
        ((os._exit, 3), "ended with exit code 3"),
        ((os.kill, 0, signal.SIGTERM), "killed by SIGTERM"),
        ((time.sleep, 600), "timed out after 0.5 s"),
    ],
)
def test_a_crash_and_a_timeout_are_exceptions(child: Child, call: tuple[Any, ...], reason: str) -> None:
    assert ask(child, abs, -1) == 1
    if call[0] is os.kill:
        call = (os.kill, ask(child, os.getpid), signal.SIGTERM)
    with pytest.raises(ChildFailed, match=reason):
        ask(child, *call, timeout=0.5 if call[0] is time.sleep else 60.0)


PARENT = """
import os, time
from zbuf_occlude.base.child import Child
child = Child()
child.start(os.getpid)
print(child.answer(), flush=True)
child.start(time.sleep, 600)
time.sleep(600)
"""


def test_a_script_needs_no_main_guard_and_the_child_does_not_outlive_it(tmp_path: Any) -> None:
    (tmp_path / "parent.py").write_text(PARENT)
    parent = subprocess.Popen([sys.executable, tmp_path / "parent.py"], stdout=subprocess.PIPE, text=True)
    assert parent.stdout is not None
    pid = int(parent.stdout.readline())
    parent.kill()
    parent.wait()
    assert ended(pid)


def test_what_it_printed_last_is_in_the_error(child: Child) -> None:
    ask(child, os.write, 2, b"no memory\ntoo many pixels\n")
    with pytest.raises(ChildFailed, match="exit code 4: too many pixels"):
        ask(child, os._exit, 4)
    with pytest.raises(ChildFailed, match="by an earlier error"):
        ask(child, abs, -1)
    assert child.process.returncode == 4, "waited for"
