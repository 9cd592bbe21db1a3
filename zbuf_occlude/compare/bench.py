"""The bench: a process of its own in which subjects run, so that a crash or a hang costs one row and nothing more."""

import multiprocessing
import signal
from multiprocessing.connection import Connection
from types import TracebackType
from typing import Any, NamedTuple, Self

from zbuf_occlude.compare.measure import Measurement, measure, warm
from zbuf_occlude.compare.question import Question
from zbuf_occlude.errors import OccludeError
from zbuf_occlude.visibility import find_method

WARM_SECONDS = 900.0
"""What a method may take on a cube: mostly compiling, on a busy machine with nothing compiled."""


class SubjectFailed(Exception):  # noqa: N818  (not an error of ours: a result, and a row)
    """A subject raised, died or took too long; the message is the reason."""


class _Warm(NamedTuple):
    """Asks the process to run a method on a cube."""

    method: str
    options: dict[str, Any]


class _Measure(NamedTuple):
    """Asks it to measure a method on the question that was sent last."""

    method: str
    options: dict[str, Any]
    budget: float


class Bench:
    """Runs measurements in one spawned process, which is replaced when it dies or hangs.

    Parameters
    ----------
    limit : float
        Seconds after which a measurement is given up; compiling, which is done once, does not count.

    Notes
    -----
    One measurement at a time: nothing else of ours runs meanwhile. The process is spawned, never forked, and owns the
    only GL context.
    """

    def __init__(self, limit: float) -> None:
        self._limit = limit
        self._process: Any = None
        self._pipe: Connection | None = None
        self._question: Question | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """End the process."""
        if self._process is not None:
            assert self._pipe is not None
            self._pipe.close()  # the process ends when it reads the end of the pipe
            self._process.join(5.0)
            if self._process.is_alive():
                self._process.kill()
                self._process.join()
            self._process = self._pipe = self._question = None

    def measure(self, question: Question, method: str, options: dict[str, Any], budget: float) -> Measurement:
        """Measure a method on a question; `budget` as in `zbuf_occlude.compare.measure.measure`.

        Raises
        ------
        SubjectFailed
            With the reason.
        """
        pipe = self._open()
        pipe.send(_Warm(method, options))
        self._answer(pipe, WARM_SECONDS, "to warm up ")
        if question is not self._question:
            pipe.send(question)
            self._question = question
        pipe.send(_Measure(method, options, budget))
        measurement = self._answer(pipe, self._limit)
        assert measurement is not None
        return measurement

    def _answer(self, pipe: Connection, limit: float, what: str = "") -> Measurement | None:
        """Wait for the process's answer."""
        try:
            if not pipe.poll(limit):
                self._kill()
                raise SubjectFailed(f"took more than {limit:g} s {what}and was given up")
            answer: Measurement | str | None = pipe.recv()
        except (EOFError, ConnectionResetError):
            self._process.join()
            code = self._process.exitcode
            self._kill()
            raise SubjectFailed(_death(code)) from None
        if isinstance(answer, str):
            raise SubjectFailed(answer)
        return answer

    def _open(self) -> Connection:
        if self._pipe is None:
            context = multiprocessing.get_context("spawn")
            self._pipe, theirs = context.Pipe()
            self._process = context.Process(target=serve, args=(theirs,), name="zbuf-occlude bench")
            self._process.start()
            theirs.close()
        return self._pipe

    def _kill(self) -> None:
        self._process.kill()
        self.close()


def serve(pipe: Connection) -> None:
    """Answer measurements until the pipe ends; the main function of the bench's process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the command decides when to stop
    question: Question | None = None
    gl: Any = None
    try:
        while True:
            message = pipe.recv()
            if isinstance(message, Question):
                question = message
                continue
            try:
                if find_method(message.method).needs_gl and gl is None:
                    from zbuf_occlude.gl.context import GlContext  # late: only these methods touch GL

                    gl = GlContext.open()
                if isinstance(message, _Warm):
                    warm(message.method, message.options, gl)
                    pipe.send(None)
                else:
                    assert question is not None
                    pipe.send(measure(question, message.method, message.options, message.budget, gl))
            except OccludeError as error:
                pipe.send(str(error))
            except Exception as error:  # a subject may fail in any way; that is a row
                pipe.send(f"{type(error).__name__}: {error}")
    except EOFError:
        pass
    finally:
        if gl is not None:
            gl.close()


def _death(code: int | None) -> str:
    if code is not None and code < 0:
        return f"its process was killed by {signal.Signals(-code).name}"
    return f"its process ended with exit code {code}"
