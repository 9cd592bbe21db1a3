"""Kernels with threads: tasks that several threads take in turn."""

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from zbuf_occlude.jit.compiler import njit

parallel_kernel = njit(nogil=True, cache=True)
"""Decorator of a kernel whose tasks several threads take: ``kernel(tasks, ...)`` calls `take` or `take_block` until no
task is left. It allocates nothing, and references to its arrays are not counted."""
shared_with_memory = njit(nogil=True, cache=True, _nrt=True)
"""The same for a kernel that allocates what its thread works with."""

N_COUNTERS = 4
"""Of `tasks`: what is taken, threads that take from an end, what is taken from the front, and from the back."""


@intrinsic
def next_task(typing_context, tasks):
    """Return the number of the next task: 0, 1, 2, ... over all threads that take from these `tasks`."""

    def codegen(context, builder, signature, arguments):
        counter = context.make_array(signature.args[0])(context, builder, arguments[0]).data
        return builder.atomic_rmw("add", counter, ir.Constant(ir.IntType(64), 1), "monotonic")

    return types.int64(tasks), codegen


@njit()
def take_block(tasks, n, size):
    """Return where the next `size` of n things begin and end; the two are equal when none is left."""
    first = min(next_task(tasks) * size, n)
    return first, min(first + size, n)


@njit()
def take_end(tasks):
    """Return which end this thread takes blocks from, for `take_block_from`: 0, the front, or 1, the back, in turns."""
    return next_task(tasks[1:]) & 1


@njit()
def take_block_from(tasks, end, n, size):
    """Take a block as `take_block` does, from the front or the back of the rest.

    For neighbours that have much in common: two threads share but one pair of them.
    """
    if next_task(tasks) * size >= n:
        return n, n
    block = next_task(tasks[2 + end :])
    if end:
        block = (n - 1) // size - block
    return block * size, min((block + 1) * size, n)


def n_blocks(n: int, size: int) -> int:
    """Return how many blocks of `size` n things are, for `parallel_for`."""
    return -(-n // size)


_most = 0


def use_threads(n: int) -> None:
    """Let calls in this process use at most n threads, one at least; children that are forked from it inherit that."""
    global _most
    _most = max(1, n)


@contextmanager
def single_threaded() -> Iterator[None]:
    """Start no thread within the block, so that the process may be forked after it."""
    global _most
    before, _most = _most, 1
    try:
        yield
    finally:
        _most = before


def n_threads() -> int:
    """Return how many threads a call may use: as `use_threads` said, at most NUMBA_NUM_THREADS, or one for each core.

    What `numba.set_num_threads` said does not count: numba, when asked, starts threads of its own, and where they are
    OpenMP's sets the number of torch's.
    """
    most: int = numba.config.NUMBA_NUM_THREADS
    return min(_most, most) if _most else most


def parallel_for(
    kernel: Callable[..., None], n_tasks: int, *arguments: Any, own: Callable[[], Any] | None = None
) -> None:
    """Run a `parallel_kernel` on this thread, and on others as far as they are free.

    Parameters
    ----------
    kernel, arguments : callable, and what it is called with
        The kernel takes tasks first; it may be called with no task left.
    n_tasks : int
        How many it has; as many threads are of use, up to `n_threads`.
    own : callable, optional
        Makes what each thread works with alone, the kernel's last argument.

    Notes
    -----
    Others sleep until they are called, and one that has not begun when the work is done is not waited for: on a busy
    machine this thread does it all. Several threads may ask at the same time, and a forked process gets helpers of its
    own.
    """
    tasks = np.zeros(N_COUNTERS, dtype=np.int64)
    n_helpers = min(n_threads(), n_tasks) - 1

    def work() -> None:
        kernel(tasks, *arguments, *([] if own is None else [own()]))

    helpers = [_helpers().submit(work) for _ in range(n_helpers)]
    work()
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


def _forget_helpers() -> None:
    """Forget, in a forked process, the threads that have stayed behind."""
    global _pool
    _pool = None


if hasattr(os, "register_at_fork"):  # Windows never forks
    os.register_at_fork(after_in_child=_forget_helpers)
