"""A child process that calls functions for its parent; a crash or timeout raises an exception in the parent."""

import multiprocessing
import os
import pickle
import signal
import threading
from collections.abc import Callable
from contextlib import suppress
from multiprocessing.connection import Connection, wait
from typing import Any

CLOSE_SECONDS = 5.0
"""Seconds that `Child.close` waits for the function that runs."""


class ChildFailed(Exception):  # noqa: N818  (internal: callers convert it)
    """The child crashed or timed out; the message is the reason."""


class Child:
    """A spawned process that calls `begin` and then one function after the other.

    The process ignores SIGINT and ends with its parent. Its messages to the parent are pairs of a kind (`progress`,
    `returned` or `raised`) and a value.
    """

    def __init__(self, begin: Callable[[], None] | None = None) -> None:
        context = multiprocessing.get_context("spawn")
        self.pipe, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(theirs, begin))
        self._process.start()
        self.result: Any = None
        theirs.close()

    def start(self, function: Callable[..., Any], *args: Any) -> None:
        """Start a call of a function in the child; `answer` returns its result."""
        with suppress(BrokenPipeError, ConnectionResetError):  # `answer` raises the reason
            self.pipe.send((function, args))

    def answer(self, timeout: float | None = None) -> Any:
        """Return the result of the started function, or raise the exception that it raised.

        Raises ChildFailed where the child crashed, or sent no message for `timeout` seconds; the child is then killed.
        """
        while self.pipe.poll(timeout):
            if self.finished():
                return self.result
        self.kill()
        raise ChildFailed(f"timed out after {timeout:g} s")

    def finished(self, progress: Callable[..., None] = lambda *values: None) -> bool:
        """Receive a message; return whether the function has returned, with its result in `result`.

        For a progress message, `progress` is called with the arguments of `report_progress`. Raises as `answer` does.
        """
        try:
            kind, value = self.pipe.recv()
        except (EOFError, ConnectionResetError):
            self._process.join()
            code = self._process.exitcode or 0
            how = f"was killed by {signal.Signals(-code).name}" if code < 0 else f"ended with exit code {code}"
            raise ChildFailed(f"its process {how}") from None
        if kind == "raised":
            raise value
        if kind == "returned":
            self.result = value
        else:
            progress(*value)
        return bool(kind == "returned")

    def close(self) -> None:
        """Wait at most `CLOSE_SECONDS` for the function that runs, then end the process."""
        self.pipe.close()
        self._process.join(CLOSE_SECONDS)
        self.kill()

    def kill(self) -> None:
        """Kill the process."""
        self.pipe.close()
        self._process.kill()
        self._process.join()


_pipe: Any = None
"""Connection of a child to its parent; None elsewhere."""


def report_progress(*values: Any) -> None:
    """Report progress from a child to its parent."""
    _pipe.send(("progress", values))


def _serve(pipe: Connection, begin: Callable[[], None] | None) -> None:
    """Call functions until the pipe is closed; the main function of the child."""
    global _pipe
    _pipe = pipe
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent handles interrupts
    parent = multiprocessing.parent_process()
    assert parent is not None
    threading.Thread(target=lambda: (wait([parent.sentinel]), os._exit(1)), daemon=True).start()
    if begin is not None:
        begin()
    while True:
        try:
            function, args = pipe.recv()
        except EOFError:
            return
        try:
            pipe.send(("returned", function(*args)))
        except Exception as error:
            try:
                pipe.send(("raised", pickle.loads(pickle.dumps(error))))
            except Exception:  # an exception that cannot be pickled
                pipe.send(("raised", RuntimeError(f"{type(error).__name__}: {error}")))
