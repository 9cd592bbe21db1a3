"""Kernels whose loops numba spreads over threads, and that live through a fork."""

import os
from collections.abc import Callable
from contextlib import suppress
from types import FunctionType
from typing import Any

import numba
from numba import njit


class threaded:  # noqa: N801  (a decorator, like njit)
    """Compile a function with ``parallel=True``; where it is called in a forked process, a serial twin too.

    numba's threads on Linux are GNU OpenMP's, which ends a process that was forked from one that had used them, as the
    workers of PyTorch's DataLoader are. There the twin answers. (With one thread both take the same time.)

    Only Python can call it, not another compiled function.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        self.__doc__, self.__wrapped__ = function.__doc__, function
        self._parallel = njit(parallel=True, cache=True)(function)
        self._serial: Any = None

    def __call__(self, *arguments: Any) -> Any:
        """Answer by one of the two."""
        if not _forked:
            return self._parallel(*arguments)
        if self._serial is None:
            self._serial = njit(cache=True)(_renamed(self.__wrapped__))
        return self._serial(*arguments)


def _renamed(function: Any) -> FunctionType:
    """The same function by another name, as numba's cache on disk tells functions apart by name and line alone."""
    name = f"{function.__name__}_serial"
    twin = FunctionType(function.__code__, function.__globals__, name, function.__defaults__)
    twin.__qualname__, twin.__module__, twin.__annotations__ = name, function.__module__, function.__annotations__
    return twin


_forked = False
"""Whether this process, or one that it descends from, was forked from one that had used GNU OpenMP through numba."""


def _notice_fork() -> None:
    global _forked
    with suppress(ValueError):  # no kernel has run
        _forked = _forked or numba.threading_layer() == "omp"


os.register_at_fork(after_in_child=_notice_fork)
