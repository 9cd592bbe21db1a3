"""Compilation in a second process of what this process needs last, so that the first answer comes sooner."""

import atexit
import multiprocessing
import os
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from typing import NamedTuple

from zbuf_occlude.base.child import Child
from zbuf_occlude.base.cores import n_cores
from zbuf_occlude.base.jit.compiler import Kernel, cache_folder, leave_out_externals


class Compilation(NamedTuple):
    """Kernel, and a function of an importable module that compiles it and calls no external function."""

    kernel: Kernel
    function: Callable[[], None]


class Precompiler:
    """Second process that compiles into the cache, while this one compiles what it needs first.

    Each function is compiled once: a process waits for one that the other is compiling, and loads it.
    """

    def __init__(self) -> None:
        self._process = 0  # id of the process that started the child; a process forked from it has no child
        self._lock = threading.Lock()

    def launch(self, *compilations: Compilation) -> None:
        """Compile what is not in the cache yet.

        There is one second process at most. There is none in workers, on a single core, or without a cache.
        """
        if self._process or n_cores() < 2 or not sys.executable or multiprocessing.parent_process():
            return
        if cache_folder() is None:
            return
        with self._lock:
            functions = [each.function for each in compilations if not each.kernel.is_kept]
            if functions and not self._process:
                self._process = os.getpid()
                with suppress(OSError):  # then this process compiles all
                    child = Child()
                    atexit.register(child.kill)  # closing it would wait
                    child.start(_call, *functions)


def _call(*functions: Callable[[], None]) -> None:
    """Call functions in the second process, and end it: its memory is of no more use."""
    leave_out_externals()
    for function in functions:
        function()
    os._exit(0)


PRECOMPILER = Precompiler()
