"""Waiting for the end of processes that are not ours to wait for."""

import os
import select


def ended(pid: int, seconds: float = 30.0) -> bool:
    """Whether a process ends within this many seconds; one that nobody reaped has ended too."""
    try:
        descriptor = os.pidfd_open(pid)
    except ProcessLookupError:
        return True
    try:
        return bool(select.select([descriptor], [], [], seconds)[0])
    finally:
        os.close(descriptor)
