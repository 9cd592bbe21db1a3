"""Kernels with threads: tasks that several threads take in turn, and loops that numba spreads over them."""

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from types import FunctionType
from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic

shared = njit(nogil=True, cache=True)
"""Decorator of a kernel whose tasks several threads take: ``kernel(tasks, ...)`` calls `take` until none is left."""


@intrinsic
def take(typing_context, tasks):
    """Return the number of the next task: 0, 1, 2, ... over all threads that take from these `tasks`."""

    def codegen(context, builder, signature, arguments):
        counter = context.make_array(signature.args[0])(context, builder, arguments[0]).data
        return builder.atomic_rmw("add", counter, ir.Constant(ir.IntType(64), 1), "monotonic")

    return types.int64(tasks), codegen


def n_threads() -> int:
    """Return how many threads a call may use."""
    return 1 if _alone else numba.get_num_threads()


_alone = False


@contextmanager
def alone() -> Iterator[None]:
    """Start no thread within the block, so that the process may be forked after it."""
    global _alone
    _alone = True
    try:
        yield
    finally:
        _alone = False


def together(kernel: Callable[..., None], n_tasks: int, *arguments: Any) -> None:
    """Run a `shared` kernel on this thread, and on others as far as they are free.

    Parameters
    ----------
    kernel, arguments : callable, and what it is called with
        The kernel takes tasks first; it may be called with no task left.
    n_tasks : int
        How many it has; as many threads are of use, up to `n_threads`.

    Notes
    -----
    Others sleep until they are called, and one that has not begun when the work is done is not waited for: on a busy
    machine this thread does it all. Several threads may ask at the same time, and a forked process gets helpers of its
    own.
    """
    tasks = np.zeros(1, dtype=np.int64)
    n_helpers = min(n_threads(), n_tasks) - 1
    helpers = [_helpers().submit(kernel, tasks, *arguments) for _ in range(n_helpers)]
    kernel(tasks, *arguments)
    for helper in helpers:
        if not helper.cancel():
            helper.result()


_pool: ThreadPoolExecutor | None = None


def _helpers() -> ThreadPoolExecutor:
    """The threads of this process that help."""
    global _pool
    if _pool is None:
        _pool = ThreadPoolExecutor(max(1, numba.config.NUMBA_NUM_THREADS - 1), "zbuf_occlude")
    return _pool


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
    global _forked, _pool
    _pool = None  # its threads have stayed behind
    with suppress(ValueError):  # no kernel has run
        _forked = _forked or numba.threading_layer() == "omp"


os.register_at_fork(after_in_child=_notice_fork)
