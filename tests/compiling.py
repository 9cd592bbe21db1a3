"""Test processes that share a cache compile each function once: who comes second waits, and loads it."""

import hashlib
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any


@contextmanager
def one_at_a_time() -> Iterator[None]:
    """Hold a file's lock while a function with a cache is compiled; nothing where files have no such locks.

    numba's own lock, of the threads of a process, comes first, and functions before those that they call: so no two
    wait for each other.
    """
    try:
        import fcntl
    except ModuleNotFoundError:
        yield
        return
    from numba.core.caching import NullCache
    from numba.core.compiler_lock import global_compiler_lock
    from numba.core.dispatcher import Dispatcher

    compile_it = Dispatcher.compile

    def locked(self: Any, sig: Any) -> Any:
        if isinstance(self._cache, NullCache):
            return compile_it(self, sig)
        name = hashlib.sha1(f"{self._cache.cache_path} {self.py_func.__qualname__}".encode()).hexdigest()
        with global_compiler_lock, Path(tempfile.gettempdir(), f"zbuf_occlude-compiling-{name}").open("w") as file:
            fcntl.flock(file, fcntl.LOCK_EX)
            return compile_it(self, sig)

    Dispatcher.compile = locked
    try:
        yield
    finally:
        Dispatcher.compile = compile_it
