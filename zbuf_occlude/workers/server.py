"""The process that workers on this machine are forked from; light to import, for it is started before all else."""

import os
import signal
import sys
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from multiprocessing import forkserver, resource_tracker

LONGEST_TEMPORARY_FOLDER = 70
"""Bytes; in a folder of a longer name a process has no address for others to reach it by."""

ENVIRONMENT = {
    "OPENBLAS_NUM_THREADS": "1",  # no thread may run where processes are forked
    "MALLOC_MMAP_THRESHOLD_": str(32 * 2**20),  # arrays up to this go where others have been before:
    "MALLOC_TRIM_THRESHOLD_": str(256 * 2**20),  # pages that are new to a process take time, on virtual machines most
}
"""What the server is started with, and the workers' memory is kept by."""


def start_server() -> None:
    """Start the process that workers are forked from, if there is none, and return at once.

    It is spawned, and imports `zbuf_occlude.workers.warm`, so that workers need not. It has no threads and no OpenGL,
    which would not survive a fork, and ends with this process. Where another library has started Python's fork server
    before, workers import for themselves.
    """
    if forks():
        forkserver.set_forkserver_preload(["zbuf_occlude.workers.warm"])
        resource_tracker.ensure_running()  # the server would start it, and it lets interrupts through again
        with _environment(ENVIRONMENT), _no_interrupts():
            forkserver.ensure_running()


def forks() -> bool:
    """Whether workers are forked; outside Linux what systems bring along does not survive that."""
    return sys.platform == "linux" and len(os.fsencode(tempfile.gettempdir())) <= LONGEST_TEMPORARY_FOLDER


@contextmanager
def _no_interrupts() -> Iterator[None]:
    """Start children that no interrupt reaches, until they let it (`zbuf_occlude.workers.warm`)."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def _environment(variables: Mapping[str, str]) -> Iterator[None]:
    """Start children with these variables."""
    before = {name: os.environ.get(name) for name in variables}
    os.environ.update(variables)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
