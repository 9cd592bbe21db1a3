"""Compilation of the largest kernels in a second process, so that the first answer comes sooner."""

import atexit
import multiprocessing
import os
import sys
import threading
from collections.abc import Callable
from contextlib import suppress

from zbuf_occlude.base.child import Child
from zbuf_occlude.base.jit.compiler import compiled_before, note_compiled
from zbuf_occlude.base.provenance import n_cores


class Precompiler:
    """Call of a function in a second process, which compiles into the cache what this process needs last.

    Parameters
    ----------
    function : callable
        Function of an importable module, without parameters.
    """

    def __init__(self, function: Callable[[], None]) -> None:
        self._function = function
        self._child: Child | None = None
        self._process = 0  # id of the process that started the child; a process forked from it has no child
        self._lock = threading.Lock()

    def launch(self) -> None:
        """Start the call, unless it was started or has succeeded before; workers, and a single core, start none."""
        if self._process or n_cores() < 2 or not sys.executable or multiprocessing.parent_process():
            return
        with self._lock:
            if self._process == 0 and not compiled_before(self._function.__name__):
                self._process = os.getpid()
                with suppress(OSError):  # then this process compiles
                    self._child = Child()
                    atexit.register(self._child.kill)  # closing it would wait
                    self._child.start(self._function)

    def wait(self) -> None:
        """Wait until a call that was started has ended; where it failed, this process compiles."""
        if self._process != os.getpid():
            return
        with self._lock:
            child, self._child = self._child, None
            if child is None:
                return
            try:
                with suppress(Exception):  # this process meets it again when it compiles, and reports it
                    child.answer()
                    note_compiled(self._function.__name__)
            finally:
                atexit.unregister(child.kill)
                child.kill()
