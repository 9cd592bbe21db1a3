"""A child process that calls functions for its parent; its crash or timeout is an exception there and nothing more."""

import multiprocessing
import os
import pickle
import signal
import threading
from collections.abc import Callable
from contextlib import suppress
from multiprocessing.connection import Connection, wait
from typing import Any

PATIENCE = 5.0


class ChildFailed(Exception):  # noqa: N818  (the caller turns it into a result or an error of ours)
    """The child crashed or timed out; the message is the reason."""


class Child:
    """A spawned process that calls one function after the other; `begin` is called first there.

    It ignores SIGINT, and ends when its parent is gone. Its messages to the parent are pairs of a kind (`progress`,
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
        """Have a function called; `answer` returns its result."""
        with suppress(BrokenPipeError, ConnectionResetError):  # `answer` says how it crashed
            self.pipe.send((function, args))

    def answer(self, timeout: float | None = None) -> Any:
        """Return the result of the function that was started, or raise what it raised.

        Raises ChildFailed where the child crashed, or was killed after `timeout` seconds without a message.
        """
        while self.pipe.poll(timeout):
            if self.finished():
                return self.result
        self.kill()
        raise ChildFailed(f"timed out after {timeout:g} s")

    def finished(self, progress: Callable[..., None] = lambda *values: None) -> bool:
        """Receive a message: whether it was the last of a function, whose result is then in `result`.

        Otherwise `progress` is called with what the function passed to `report_progress`. Raises as `answer`.
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
        """End the process when its function returns; at the latest `PATIENCE` seconds later."""
        self.pipe.close()
        self._process.join(PATIENCE)
        self.kill()

    def kill(self) -> None:
        """End the process at once."""
        self.pipe.close()
        self._process.kill()
        self._process.join()


_pipe: Any = None
"""In a child, the connection to its parent."""


def report_progress(*values: Any) -> None:
    """In a child: report progress to the parent."""
    _pipe.send(("progress", values))


def _serve(pipe: Connection, begin: Callable[[], None] | None) -> None:
    """Call functions until the pipe ends; the main function of the child."""
    global _pipe
    _pipe = pipe
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent decides what an interrupt means
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
            except Exception:  # not every exception can be pickled
                pipe.send(("raised", RuntimeError(f"{type(error).__name__}: {error}")))
