"""Module that Python's fork server imports first: it keeps silent where the end of the coordinator is no error."""

import pickle
import sys
from typing import Any


def report(kind: type[BaseException], *more: Any) -> None:
    """Report an error by which a process failed to start, unless its coordinator was killed before all was sent."""
    if not issubclass(kind, (EOFError, pickle.UnpicklingError)):
        sys.__excepthook__(kind, *more)


sys.excepthook = report
