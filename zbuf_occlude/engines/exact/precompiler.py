"""Compilation in a second process of what this process needs last, so that the first answer comes sooner."""

import atexit
import multiprocessing
import os
import sys
from collections.abc import Callable
from contextlib import suppress

from zbuf_occlude.base.child import Child
from zbuf_occlude.base.jit.compiler import compiled_before, leave_out_externals, note_compiled
from zbuf_occlude.base.provenance import n_cores


class Precompiler:
    """Second process that compiles into the cache, while this one compiles what it needs first.

    Each function is compiled once: a process that needs one at which the other is waits, and loads it.
    """

    def __init__(self) -> None:
        self._process = 0  # id of the process that started the child; a process forked from it has no child

    def launch(self, function: Callable[[], None]) -> None:
        """Call a function of an importable module, without parameters, that compiles, and calls no external function.

        It is not called a second time, nor where it has ended before; workers, and a single core, start no process.
        """
        if self._process or n_cores() < 2 or not sys.executable or multiprocessing.parent_process():
            return
        if not compiled_before(function.__name__):
            self._process = os.getpid()
            with suppress(OSError):  # then this process compiles all
                child = Child()
                atexit.register(child.kill)  # closing it would wait
                child.start(_compile, function)


def _compile(function: Callable[[], None]) -> None:
    """Call the function in the second process."""
    leave_out_externals()
    function()
    note_compiled(function.__name__)


PRECOMPILER = Precompiler()
