"""Module that Python's fork server imports first: it reports errors, and loads numba for all workers at once."""

import os
import pickle
import sys
from typing import Any


def report(kind: type[BaseException], *more: Any) -> None:
    """Report an error by which a process failed to start, unless its coordinator was killed before all was sent."""
    if not issubclass(kind, (EOFError, pickle.UnpicklingError)):
        sys.__excepthook__(kind, *more)


def end_without(coordinator: int) -> None:
    """End this process where its coordinator has ended, as after a usage error, whose output it would keep open."""
    if os.getppid() != coordinator:
        os._exit(0)


sys.excepthook, parent = report, os.getppid()

from numba.core.registry import cpu_target  # noqa: E402  (its errors are reported as above)

end_without(parent)
cpu_target.target_context.refresh()  # each worker would, before its first compiled function: 0.3 s
end_without(parent)
