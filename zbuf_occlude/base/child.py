"""A child process that calls functions for its parent; a crash or a timeout there is an exception in the parent."""

import os
import pickle
import signal
import subprocess
import sys
import tempfile
import threading
import weakref
from collections.abc import Callable
from contextlib import suppress
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path
from queue import SimpleQueue
from typing import IO, Any

CLOSE_SECONDS = 5.0
"""Seconds that a child has to end before it is killed."""


class ChildFailed(Exception):  # noqa: N818  (internal: callers convert it)
    """The child crashed or timed out; the message is a verb phrase with the reason."""


class Child:
    """A new Python process that calls one function after the other, each of an importable module.

    The process runs a command, so that a script that needs one needs no main guard. It ignores SIGINT, ends with its
    parent, and prints into a file. Its messages to the parent are pairs of a kind (`progress`, `returned` or `raised`)
    and a value.

    Parameters
    ----------
    environment : str
        Variables besides those of this process, or in their place.
    """

    def __init__(self, **environment: str) -> None:
        paths = [str(Path(__file__).parents[2]), *map(os.path.abspath, sys.path)]
        self.pipe, theirs = Pipe()
        self._log = tempfile.TemporaryFile()  # noqa: SIM115  (closed by `_end`)
        with theirs:
            self.process = subprocess.Popen(
                [sys.executable, "-P", "-c", f"from {__name__} import serve; serve({theirs.fileno()})"],
                pass_fds=[theirs.fileno()],
                env={**os.environ, "PYTHONPATH": os.pathsep.join(paths), **environment},
                stdin=subprocess.DEVNULL,
                stdout=self._log,
                stderr=self._log,
            )
        self.result: Any = None
        self.close = weakref.finalize(self, _end, self.process, self.pipe, self._log)
        """Function that ends the process. It is called, too, when the object is collected and when Python ends."""

    def start(self, function: Callable[..., Any], *args: Any) -> None:
        """Start a call of a function in the child; `answer` returns its result."""
        with suppress(OSError):  # `answer` raises the reason
            self.pipe.send((function, args))

    def answer(self, timeout: float | None = None) -> Any:
        """Return the result of the started function, or raise the exception that it raised.

        Raises ChildFailed where the child crashed, or sent no message for `timeout` seconds; the child is then killed.
        """
        if not self.close.alive:
            raise ChildFailed("was ended by an earlier error")
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
            code = self.process.wait()
            how = f"was killed by {signal.Signals(-code).name}" if code < 0 else f"ended with exit code {code}"
            self._log.seek(0)
            lines = self._log.read().decode(errors="replace").strip().splitlines()
            self.close()
            raise ChildFailed(": ".join([how, *lines[-1:]])) from None
        if kind == "raised":
            raise value
        if kind == "returned":
            self.result = value
        else:
            progress(*value)
        return bool(kind == "returned")

    def kill(self) -> None:
        """Kill the process."""
        self.process.kill()
        self.close()


def call_in_child(function: Callable[..., Any], *args: Any, timeout: float) -> Any:
    """Call a function in a child of its own; return its result, or raise as `Child.answer` does."""
    child = Child()
    try:
        child.start(function, *args)
        return child.answer(timeout)
    finally:
        child.kill()


def _end(process: "subprocess.Popen[bytes]", pipe: Connection, log: IO[bytes]) -> None:
    pipe.close()  # this ends the process
    try:
        process.wait(CLOSE_SECONDS)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
    log.close()


_pipe: Any = None
"""Connection of a child to its parent; None elsewhere."""


def report_progress(*values: Any) -> None:
    """Report progress from a child to its parent."""
    _pipe.send(("progress", values))


def serve(descriptor: int) -> None:
    """Call functions in this thread until the pipe ends, and the process with it; the main function of the child."""
    global _pipe
    _pipe = Connection(descriptor)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent handles interrupts
    calls = SimpleQueue[bytes]()
    threading.Thread(target=_receive, args=(calls,), daemon=True).start()
    while True:
        try:
            function, args = pickle.loads(calls.get())
            _pipe.send(("returned", function(*args)))
        except Exception as error:
            try:
                _pipe.send(("raised", pickle.loads(pickle.dumps(error))))
            except Exception:  # an exception that cannot be pickled
                _pipe.send(("raised", RuntimeError(f"{type(error).__name__}: {error}")))


def _receive(calls: "SimpleQueue[bytes]") -> None:
    """Take calls from the pipe; end the process when the pipe ends, whatever it is at."""
    with suppress(EOFError, OSError):
        while True:
            calls.put(_pipe.recv_bytes())
    os._exit(0)
