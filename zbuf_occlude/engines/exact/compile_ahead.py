"""Compilation in a second process: the first answer of a new installation comes a third sooner."""

import atexit
import os
import threading
from collections.abc import Callable
from contextlib import suppress

from zbuf_occlude.base.child import Child, ChildFailed
from zbuf_occlude.base.jit.compiler import began_without_cache
from zbuf_occlude.base.provenance import n_cores


class CompileAhead:
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

    def start(self) -> None:
        """Start the call, once, if this process found an empty cache and may use a second core."""
        with self._lock:
            if self._process == 0 and began_without_cache() and n_cores() > 1:
                self._process, self._child = os.getpid(), Child()
                atexit.register(self._child.kill)  # closing it would wait
                self._child.start(self._function)

    def wait(self) -> None:
        """Wait until a call that was started has ended; where it failed, this process compiles."""
        with self._lock:
            if self._child is not None and self._process == os.getpid():
                with suppress(ChildFailed):
                    self._child.answer()
                atexit.unregister(self._child.kill)
                self._child.kill()
                self._child = None
