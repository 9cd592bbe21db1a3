"""Functions that numba compiles, where whoever imports them may never call one: numba takes 0.3 s to import.

In modules that are not imported but to compute, `numba.njit` itself will do.
"""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cached_property, update_wrapper
from typing import Any


class Kernel:
    """A function that is compiled when it is called first, or named in another that is."""

    def __init__(self, function: Callable[..., Any], options: dict[str, Any]) -> None:
        update_wrapper(self, function)
        self._function, self._options = function, options

    @cached_property
    def _compiled(self) -> Any:
        from numba import njit  # late: see above

        return njit(**self._options)(self._function)

    def __call__(self, *arguments: Any) -> Any:
        """Answer by what was compiled."""
        return self._compiled(*arguments)

    def __getattr__(self, name: str) -> Any:
        """Be to numba, in functions that name this one, what it has compiled."""
        if name.startswith("__"):
            raise AttributeError(name)
        return getattr(self._compiled, name)


def njit(**options: Any) -> Callable[[Callable[..., Any]], Kernel]:
    """Compile a function as `numba.njit` does with these options, but not before it is needed.

    References to arrays are not counted: each row that a loop looks at, ``vertices[i]``, would be counted there and
    back, which took a thirtieth of a dataset's time. So nothing may be allocated within, unless `_nrt` is True.
    """
    return lambda function: Kernel(function, {"_nrt": False, **options})


@contextmanager
def without_scipy() -> Iterator[None]:
    """Hide scipy from numba and trimesh within the block, in a process that is all ours.

    Before its first function numba imports scipy, for 0.15 s, to see whether there is BLAS to call; none here calls it.
    trimesh, imported within, stays without it for good: only where nothing of trimesh's that needs it is called.
    """
    hidden = "scipy" not in sys.modules
    if hidden:
        sys.modules["scipy"] = None  # type: ignore[assignment]
    try:
        yield
    finally:
        if hidden:
            del sys.modules["scipy"]


def load_only() -> None:
    """Have numba load compiled functions without all that it needs to compile any, in a process that is all ours.

    Before it looks for its first function numba imports and lists all that it can compile, for 0.1 s. Its compiler does
    that too: what is not found is compiled as ever. And it asks all installed packages whether they extend it.
    """
    from numba.core import entrypoints
    from numba.core.caching import Cache
    from numba.core.runtime import rtsys

    if not (hasattr(Cache, "_load_overload") and hasattr(Cache, "_guard_against_spurious_io_errors")):
        return  # a numba that is made otherwise loads as ever

    def load_overload(self: Any, signature: Any, context: Any) -> Any:
        rtsys.initialize(context)  # what compiled functions themselves call
        with self._guard_against_spurious_io_errors():
            return self._load_overload(signature, context)

    Cache.load_overload, entrypoints._already_initialized = load_overload, True
