"""The local engine: processes on this machine, each with its own GL context and its share of the cores."""

import multiprocessing
import os
import signal
from contextlib import suppress
from multiprocessing import connection
from typing import Any

from zbuf_occlude.errors import DatasetError
from zbuf_occlude.limits import GivenUp, Limits, resident_gigabytes
from zbuf_occlude.workers.pool import Ending, Message, Worker, do_jobs
from zbuf_occlude.workers.sent import Sent
from zbuf_occlude.workers.server import forks, start_server
from zbuf_occlude.workers.task import Done, Task
from zbuf_occlude.workers.worker import serve


def run_jobs(task: Task, jobs: list[Any], done: Done, *, n_workers: int, limits: Limits) -> None:
    """Do jobs in processes on this machine; parameters, errors and promises as in `do_jobs`."""
    start_server()
    devices = gl_devices(task)
    sent = Sent(task)
    do_jobs(
        jobs,
        done,
        start=lambda seat: LocalWorker(sent, n_workers, devices[seat % len(devices)]),
        wait=_wait,
        n_workers=n_workers,
        limits=limits,
    )


SERVERS = 3
"""This many servers in a row may end before they have started a worker."""


class LocalWorker:
    """A process that runs `serve` at the other end of a pipe."""

    def __init__(self, sent: Sent, n_workers: int, device_index: int | None) -> None:
        context: Any = multiprocessing.get_context("forkserver" if forks() else "spawn")
        self.connection, theirs = context.Pipe()
        n_threads = max(1, (os.cpu_count() or 1) // n_workers)
        # llvmpipe's threads come on top of the one that calls it; with 0 of them that one draws
        environment = {"LP_NUM_THREADS": str(n_threads if n_threads > 1 else 0), **os.environ}
        arguments = (theirs, sent, device_index, n_threads, environment)
        for attempt in range(SERVERS):
            start_server()  # it may have been killed
            self.process: Any = context.Process(target=serve, args=arguments, daemon=True)
            try:
                self.process.start()
                break
            except (EOFError, ConnectionError):
                if attempt == SERVERS - 1:
                    raise DatasetError(
                        f"the process that workers are forked from must live; {SERVERS} in a row ended. What they "
                        "said is above, if anything. Is there memory enough, and can `import numba` succeed?"
                    ) from None
        theirs.close()

    def assign(self, job: Any, lost: dict[int, GivenUp]) -> None:
        """Send a request."""
        with suppress(OSError):  # it has died; `ending` will tell
            self.connection.send((job, lost))

    def listen(self) -> list[Message]:
        """Empty the pipe."""
        messages: list[Message] = []
        with suppress(EOFError, OSError):
            while self.connection.poll():
                messages.append(self.connection.recv())
        return messages

    def ending(self) -> Ending | None:
        """Say how the process ended; None while it runs."""
        if self.process.is_alive():
            return None
        code = self.process.exitcode
        reason = f"the worker was killed by signal {-code}" if code < 0 else f"the worker ended with code {code}"
        return Ending(reason, -code in (signal.SIGKILL, signal.SIGTERM))

    def gigabytes(self) -> float:
        """Read the resident memory off /proc."""
        return resident_gigabytes(self.process.pid)

    def kill(self) -> None:
        """Kill the process and reap it."""
        self.process.kill()
        self.process.join()
        self.connection.close()

    def dismiss(self) -> None:
        """Ask the process to leave; kill it when it does not."""
        with suppress(OSError):  # it has gone already
            self.connection.send(None)
        self.process.join(10)
        self.kill()


def _wait(workers: list[Worker], seconds: float) -> None:
    local = [worker for worker in workers if isinstance(worker, LocalWorker)]
    connection.wait([handle for w in local for handle in (w.connection, w.process.sentinel)], timeout=seconds)


def gl_devices(task: Task) -> list[int | None]:
    """The EGL devices over which workers are spread: the hardware ones that open, or None for whatever opens first."""
    if not task.needs_gl:
        return [None]
    from zbuf_occlude.gl.context import ENVIRONMENT  # late: only methods that need it touch GL
    from zbuf_occlude.gl.probe import hardware_devices

    if os.environ.get(ENVIRONMENT):
        return [None]
    return [*hardware_devices()] or [None]
