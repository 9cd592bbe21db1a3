"""Limits of the time and memory of one mesh, beyond which its worker is killed."""

import os
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from zbuf_occlude.base.errors import MeshError, OptionError

LOOK = 0.5
"""Seconds between two checks of time and memory."""


@dataclass(frozen=True)
class Limits:
    """Limits of one mesh; a mesh that exceeds them is a failure.

    Parameters
    ----------
    seconds : float
        Wall-clock time for one mesh, all its views and variations.
    gigabytes : float
        Resident memory by which the process grows while it is at the mesh.
    """

    seconds: float = 600.0
    gigabytes: float = 8.0

    def __post_init__(self) -> None:
        for what, value in (("seconds", self.seconds), ("gigabytes", self.gigabytes)):
            if not value > 0:
                raise OptionError(f"the {what} that a mesh may take must be positive; got {value}.")

    def exceeded(self, seconds: float, gigabytes: float) -> str:
        """Return the limit that a mesh exceeds which has taken this much more memory; "" for none."""
        if seconds > self.seconds:
            return f"mesh timed out after {self.seconds:g} s"
        if gigabytes > self.gigabytes:
            return f"mesh exceeded {self.gigabytes:g} GB of memory"
        return ""

    @contextmanager
    def watch(self) -> Iterator[None]:
        """Apply these limits to the work on a mesh in this process, within the block.

        Raises
        ------
        MeshError
            It took more. A single call into compiled code is not interrupted: the error comes when it returns.

        Notes
        -----
        For the main thread of a process, which alone hears signals; in another, and where somebody else uses the alarm,
        nothing is watched. Workers need none of it: the pool kills them (`zbuf_occlude.datasets.workers.pool`).
        """
        alarm = getattr(signal, "SIGALRM", None)  # Windows has none
        free = alarm is not None and signal.getsignal(alarm) in (signal.SIG_DFL, signal.SIG_IGN)
        if threading.current_thread() is not threading.main_thread() or not free:
            yield
            return
        began, before_it = time.monotonic(), resident_gigabytes(os.getpid())

        def look(number: int, frame: Any) -> None:
            grown = resident_gigabytes(os.getpid()) - before_it
            if excess := self.exceeded(time.monotonic() - began, grown):
                raise MeshError(f"{excess}. Simplify it.")

        before = signal.signal(signal.SIGALRM, look)
        signal.setitimer(signal.ITIMER_REAL, LOOK, LOOK)
        try:
            yield
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0)
            signal.signal(signal.SIGALRM, before)


def address_space() -> int | None:
    """Return the number of bytes that this process may address (``ulimit -v``); None for no limit."""
    try:
        resource = import_module("resource")
    except ImportError:  # only Unix has it
        return None
    allowed: int = resource.getrlimit(resource.RLIMIT_AS)[0]
    return None if allowed == resource.RLIM_INFINITY else allowed


def memory_allowed() -> str:
    """Return the memory available to this process, and its limit, in words."""
    if (allowed := address_space()) is not None:
        return f"the {allowed / 1e9:.1f} GB that this process may address (ulimit -v)"
    return "this machine's memory"


def resident_gigabytes(pid: int) -> float:
    """Read the resident memory of a process from /proc; 0 when it has just ended."""
    try:
        pages = int(Path(f"/proc/{pid}/statm").read_text(encoding="utf-8").split()[1])
    except (OSError, IndexError):
        return 0.0
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e9
