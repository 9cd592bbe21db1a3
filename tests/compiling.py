"""Test processes that share a cache compile each function once: who comes second waits, and loads it."""

import hashlib
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any


@contextmanager
def one_at_a_time() -> Iterator[None]:
    """Hold a lock in its cache's folder while a function is compiled; nothing where files have no such locks.

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
    held: set[str] = set()

    def locked(self: Any, sig: Any) -> Any:
        with global_compiler_lock:
            code = self.py_func.__code__
            place = f"{code.co_filename} {code.co_firstlineno} {self.py_func.__qualname__}"
            name = f"{self._cache.cache_path}/{hashlib.sha1(place.encode()).hexdigest()}.lock"
            if isinstance(self._cache, NullCache) or name in held:
                return compile_it(self, sig)
            held.add(name)
            try:
                with open(name, "w") as file:
                    fcntl.flock(file, fcntl.LOCK_EX)
                    return compile_it(self, sig)
            finally:
                held.remove(name)

    Dispatcher.compile = locked
    try:
        yield
    finally:
        Dispatcher.compile = compile_it
