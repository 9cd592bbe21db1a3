"""Multithreaded kernels: threads take tasks from a shared counter."""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from zbuf_occlude.base.cores import n_by_quota
from zbuf_occlude.base.jit.compiler import njit

parallel_kernel = njit(nogil=True, cache=True)
"""Decorator of a kernel that several threads run: ``kernel(tasks, ...)`` calls `next_task` or `take_block` until no
task is left. It allocates nothing, and references to its arrays are not counted."""
allocating_kernel = njit(nogil=True, cache=True, _nrt=True)
"""Decorator of a parallel kernel that allocates its thread's working memory."""

N_COUNTERS = 4
"""Number of counters in `tasks`: tasks taken, threads assigned to an end, blocks taken from the front, and from the
back."""


@intrinsic
def next_task(typing_context, tasks):
    """Return the index of the next task: 0, 1, 2, ... over all threads that share `tasks`."""

    def codegen(context, builder, signature, arguments):
        counter = context.make_array(signature.args[0])(context, builder, arguments[0]).data
        return builder.atomic_rmw("add", counter, ir.Constant(ir.IntType(64), 1), "monotonic")

    return types.int64(tasks), codegen


@njit()
def take_block(tasks, n, size):
    """Return start and end of the next block of `size` of n items; they are equal when none is left."""
    first = min(next_task(tasks) * size, n)
    return first, min(first + size, n)


@njit()
def take_end(tasks):
    """Return the end from which this thread takes blocks with `take_block_from`: 0, the front, or 1, the back."""
    return next_task(tasks[1:]) & 1


@njit()
def take_block_from(tasks, end, n, size):
    """Return a block as `take_block` does, from the front or the back of the remaining items.

    Neighbouring blocks then mostly go to the same thread, which pays if they have much in common.
    """
    if next_task(tasks) * size >= n:
        return n, n
    block = next_task(tasks[2 + end :])
    if end:
        block = (n - 1) // size - block
    return block * size, min((block + 1) * size, n)


def n_blocks(n: int, size: int) -> int:
    """Return the number of blocks of `size` that hold n items."""
    return -(-n // size)


_most = 0


def use_threads(n: int) -> None:
    """Limit calls in this process to n threads, at least one; forked children inherit the limit."""
    global _most
    _most = max(1, n)


def n_threads() -> int:
    """Return the number of threads a call may use: the limit of `use_threads`, at most NUMBA_NUM_THREADS.

    Without that variable it is the number of cores that the process may use. `numba.set_num_threads` has no effect
    here: asking numba for its value starts numba's own threads and, with OpenMP, changes torch's number of threads.
    """
    return min(_most, _max_threads()) if _most else _max_threads()


def _max_threads() -> int:
    most: int = numba.config.NUMBA_NUM_THREADS  # of the process when it began: OpenMP binds its threads later
    return most if os.environ.get("NUMBA_NUM_THREADS") else min(most, n_by_quota() or most)


def parallel_for(
    kernel: Callable[..., None], n_tasks: int, *arguments: Any, own: Callable[[], Any] | None = None
) -> None:
    """Run a `parallel_kernel` on this thread, and on free helper threads.

    Parameters
    ----------
    kernel, arguments : callable and its arguments
        The kernel's first argument is `tasks`; it may be called with no task left.
    n_tasks : int
        Number of tasks, an upper bound on the number of threads, as is `n_threads`.
    own : callable, optional
        Function that makes each thread's working memory, the kernel's last argument.

    Notes
    -----
    Helpers sleep between calls. A helper that has not started when the work ends is not waited for, so on a busy
    machine this thread does all the work. Several threads may call this at the same time, and a forked process gets its
    own helpers.
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
    """Return the pool of this process's helper threads."""
    global _pool
    if _pool is None:
        _pool = ThreadPoolExecutor(max(1, _max_threads() - 1), "zbuf_occlude")
    return _pool


def _forget_helpers() -> None:
    """Forget the parent's threads in a forked process, which does not have them."""
    global _pool
    _pool = None


if hasattr(os, "register_at_fork"):  # Windows never forks
    os.register_at_fork(after_in_child=_forget_helpers)
