"""The local engine: processes on this machine, each with its own GL context and its share of the cores.

On Linux Python's fork server forks them: it has imported the modules that workers need, and has no threads and no
OpenGL, which would not survive a fork. Elsewhere workers are spawned.
"""

import multiprocessing
import os
import pickle
import signal
import sys
import tempfile
import threading
import time
from collections.abc import Mapping
from contextlib import suppress
from multiprocessing import connection, forkserver, resource_tracker
from typing import Any

from zbuf_occlude.base.cores import n_cores
from zbuf_occlude.base.errors import DatasetError
from zbuf_occlude.base.interrupts import held
from zbuf_occlude.base.limits import Limits, resident_gigabytes
from zbuf_occlude.datasets.workers import Done, Task
from zbuf_occlude.datasets.workers.pool import ExitStatus, Message, do_jobs, work

PRELOAD = (
    "zbuf_occlude.datasets.workers.preload",
    "h5py",
    "zbuf_occlude.datasets.shard",
    "zbuf_occlude.datasets.workers.local",
)
"""Modules that the fork server imports before it forks workers."""

THREADS = "OPENBLAS_NUM_THREADS"
"""Variable of the environment with the number of threads that NumPy starts when it is imported."""
SERVERS = 3
"""Number of fork servers in a row that may end before they have started a worker."""
PAUSE = 0.25
"""Seconds after which another is started: one that was killed refuses work shortly before it counts as ended."""

LONGEST_TEMPORARY_FOLDER = 70
"""Maximum bytes of the name of the temporary folder, in which processes have their addresses."""


def run_local(task: Task, jobs: list[Any], done: Done, *, n_workers: int, limits: Limits) -> None:
    """Do jobs in processes on this machine; parameters, errors and promises as in `do_jobs`."""
    devices, pickled = gl_devices(task), pickle.dumps(task, protocol=5)
    do_jobs(
        jobs,
        done,
        start=lambda seat: LocalWorker(pickled, n_workers, devices[seat % len(devices)]),
        wait=_wait,
        n_workers=n_workers,
        limits=limits,
    )


def start_server() -> None:
    """Start the fork server, unless there is one, or workers are spawned."""
    if _start_method() != "forkserver":
        return
    forkserver.set_forkserver_preload(list(PRELOAD))
    resource_tracker.ensure_running()  # the server would start it, and that lets interrupts through again
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # what an interrupt means, the coordinator decides
    threads = os.environ.get(THREADS)
    os.environ[THREADS] = "1"  # no thread may run where processes are forked
    try:
        forkserver.ensure_running()
    finally:
        os.environ.pop(THREADS)
        if threads is not None:
            os.environ[THREADS] = threads
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)


def _start_method() -> str:
    """Return how workers are started; outside Linux system libraries do not survive a fork."""
    short = len(os.fsencode(tempfile.gettempdir())) <= LONGEST_TEMPORARY_FOLDER
    return "forkserver" if sys.platform == "linux" and short else "spawn"


class LocalWorker:
    """A process that runs `work` at the other end of a pipe."""

    def __init__(self, pickled: bytes, n_workers: int, device_index: int | None) -> None:
        context: Any = multiprocessing.get_context(_start_method())
        self.connection, theirs = context.Pipe()
        n_threads = max(1, n_cores() // n_workers)
        # llvmpipe's threads come on top of the one that calls it; with 0 of them that one draws
        environment = {"LP_NUM_THREADS": str(n_threads if n_threads > 1 else 0), **os.environ}
        arguments = (theirs, pickled, device_index, n_threads, environment)
        for attempt in range(SERVERS):
            start_server()
            self.process: Any = context.Process(target=_run_worker, args=arguments, daemon=True)
            try:
                with held():  # the process would read half of what it is to be
                    self.process.start()
                break
            except (EOFError, ConnectionError):
                if attempt == SERVERS - 1:
                    raise DatasetError(
                        f"the process that workers are forked from must live; {SERVERS} in a row ended. Their "
                        "messages, if any, are above. Is there memory enough, and can `import numba` succeed?"
                    ) from None
                time.sleep(PAUSE)
        theirs.close()

    def assign(self, job: Any, lost: dict[int, str]) -> None:
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

    def ending(self) -> ExitStatus | None:
        """Return how the process ended; None while it runs."""
        if self.process.is_alive():
            return None
        code = self.process.exitcode
        reason = f"the worker was killed by signal {-code}" if code < 0 else f"the worker ended with code {code}"
        return ExitStatus(reason, -code in (signal.SIGKILL, signal.SIGTERM))

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


def _wait(workers: list[LocalWorker], seconds: float) -> None:
    connection.wait([handle for w in workers for handle in (w.connection, w.process.sentinel)], timeout=seconds)


def _run_worker(
    pipe: connection.Connection,
    pickled: bytes,
    device_index: int | None,
    n_threads: int,
    environment: Mapping[str, str],
) -> None:
    """Run a worker with the coordinator's environment, not that in which the server was started."""
    from zbuf_occlude.base.jit.threads import use_threads  # late, with numba: the coordinator computes nothing

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the coordinator decides what an interrupt means
    threading.Thread(target=_end_with_coordinator, daemon=True).start()
    os.environ.clear()
    os.environ.update(environment)
    use_threads(n_threads)
    work(pipe, pickle.loads(pickled), device_index)


def _end_with_coordinator() -> None:
    """Wait for the coordinator to end, however it ends, and end this process, whatever it is at."""
    if coordinator := multiprocessing.parent_process():
        coordinator.join()
        os._exit(1)


def gl_devices(task: Task) -> list[int | None]:
    """Return the EGL devices of workers: the hardware ones that open, or None for the first that opens."""
    if not task.needs_gl:
        return [None]
    from zbuf_occlude.engines.gl.context import ENVIRONMENT as CHOICE  # late: only methods that need it touch GL
    from zbuf_occlude.engines.gl.probe import hardware_devices

    if os.environ.get(CHOICE):
        return [None]
    return [*hardware_devices()] or [None]
