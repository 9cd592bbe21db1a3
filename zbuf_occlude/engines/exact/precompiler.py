"""Compilation in a second process of what this process needs last, so that the first answer comes sooner."""

import atexit
import multiprocessing
import os
import sys
from collections.abc import Callable, Iterable
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

    def launch(self, *functions: Callable[[], None]) -> None:
        """Call functions of importable modules, which compile, and call no external function.

        They are called once, and not where they have ended before; workers, and a single core, start no process.
        """
        if self._process or n_cores() < 2 or not sys.executable or multiprocessing.parent_process():
            return
        if not compiled_before(_name(functions)):
            self._process = os.getpid()
            with suppress(OSError):  # then this process compiles all
                child = Child()
                atexit.register(child.kill)  # closing it would wait
                child.start(_compile, *functions)


def _compile(*functions: Callable[[], None]) -> None:
    """Call the functions in the second process."""
    leave_out_externals()
    for function in functions:
        function()
    note_compiled(_name(functions))


def _name(functions: Iterable[Callable[[], None]]) -> str:
    return "+".join(function.__name__ for function in functions)


PRECOMPILER = Precompiler()
