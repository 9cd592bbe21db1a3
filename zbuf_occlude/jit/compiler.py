"""numba's decorators, and the folder that compiled code is kept in: one for each state of the sources.

numba takes 0.3 s to import: functions are declared without it and compiled, or loaded, when they are first called.
"""

import hashlib
import importlib.util
import logging
import os
import shutil
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache, cached_property, update_wrapper
from pathlib import Path
from typing import Any

PACKAGE = Path(__file__).parents[1]
CACHE_KEY_FOLDERS = ("", "exact", "geometry", "gl", "jit", "meshes", "object_space", "visibility")
"""Folders of the package from which compiled functions take functions and constants of other files."""

_LOG = logging.getLogger(__name__)
_lock = threading.Lock()


class Kernel:
    """A function that numba compiles when it is first called, or named in another that is."""

    def __init__(self, function: Callable[..., Any], options: dict[str, Any]) -> None:
        update_wrapper(self, function)
        self._function, self._options = function, options
        self._dispatcher: Any = None

    def _declared(self) -> Any:
        """Return numba's own function."""
        if self._dispatcher is None:
            import numba  # late: see above

            _listen()
            _define_externals()
            folder = cache_folder() if self._options.get("cache") else None
            with _lock, _caching_in(folder):
                options = {**self._options, "cache": folder is not None}
                self._dispatcher = self._dispatcher or numba.njit(**options)(self._function)
        return self._dispatcher

    def __call__(self, *arguments: Any) -> Any:
        """Call the compiled function."""
        return self._declared()(*arguments)

    def __getattr__(self, name: str) -> Any:
        """Return an attribute of the compiled function, which is what numba sees in functions that call this one."""
        if name.startswith("__"):
            raise AttributeError(name)
        return getattr(self._declared(), name)


class External:
    """A function of numbers that compiled functions call by its symbol, so that it is compiled once.

    numba optimises any other function anew within each of its callers, at every level of them. For one that is large
    and seldom called, that takes most of the time of compiling.
    """

    def __init__(self, function: Callable[..., Any], signature: str) -> None:
        update_wrapper(self, function)  # type: ignore[arg-type]  # it cannot be called in Python
        self._function, self._signature = function, signature
        _undefined.append(self)

    @cached_property
    def _numba_type_(self) -> Any:
        """The function as numba types it, compiled or read from the cache; its symbol has its address."""
        import numba  # late: see above
        from llvmlite import binding

        folder = cache_folder()
        with _caching_in(folder):
            self._compiled = numba.cfunc(self._signature, cache=folder is not None)(self._function)
        symbol = f"{self._function.__module__}.{self._function.__name__}"
        binding.add_symbol(symbol, self._compiled.address)
        return numba.types.ExternalFunction(symbol, self._compiled._sig)


def external(signature: str) -> Callable[[Callable[..., Any]], Any]:
    """Return a decorator of functions with a signature of numba's, of float64 and int64 alone."""
    return lambda function: External(function, signature)


_undefined: list[External] = []
_is_defining = False


def _define_externals() -> None:
    """Define the external functions of all modules so far: compiled code in the cache does not say which it calls."""
    global _is_defining
    if not _undefined:
        return
    from numba.core.compiler_lock import global_compiler_lock  # late: see above

    with global_compiler_lock:  # other threads wait here until the symbols are there
        if _is_defining:  # this thread compiles one, which asks for those that it calls
            return
        _is_defining = True
        try:
            while _undefined:
                each = _undefined[0]  # one calls those before it alone
                _ = each._numba_type_
                _undefined.remove(each)
        finally:
            _is_defining = False


@contextmanager
def _caching_in(folder: Path | None) -> Iterator[None]:
    """Let numba keep what is declared within the block in a folder; functions of others keep theirs."""
    import numba  # late: see above

    before, numba.config.CACHE_DIR = numba.config.CACHE_DIR, str(folder)
    try:
        yield
    finally:
        numba.config.CACHE_DIR = before


def njit(**options: Any) -> Callable[[Callable[..., Any]], Kernel]:
    """Return `numba.njit` with these options, applied when the function is needed.

    By default references to arrays are not counted (``_nrt=False``): each row that a loop looks at, ``vertices[i]``,
    would be counted there and back, 3 % of a dataset's time. A function that allocates needs ``_nrt=True``.
    """
    return lambda function: Kernel(function, {"_nrt": False, **options})


device_function = njit(no_cpython_wrapper=True, no_cfunc_wrapper=True)
"""Decorator of a function that only compiled functions call. Without its wrappers compiling takes 10 % less."""
always_inline = njit(forceinline=True, no_cpython_wrapper=True, no_cfunc_wrapper=True)
"""The same, for what LLVM copies into its callers."""
inline_ir = njit(inline="always", no_cpython_wrapper=True, no_cfunc_wrapper=True)
"""The same, for what has one caller, which takes it in before types are inferred: inner functions are optimised anew
with each outer one. The caller's options become its own, so the caller must not count references either."""


@cache
def cache_folder() -> Path | None:
    """Return the folder of the code that was compiled of these sources, for this processor.

    A subfolder of NUMBA_CACHE_DIR where that is set; else of the package's own ``__pycache__``, of ``~/.cache``, or of
    a private temporary folder, whichever can be written. A new folder takes the place of those of other sources. None
    where nothing can be written: each process then compiles for itself.
    """
    of_place, of_sources = _names()
    for base in _bases():
        folder = base / f"{of_place}-{of_sources}"
        with suppress(OSError):
            is_new = not folder.exists()
            folder.mkdir(parents=True, exist_ok=True)
            tempfile.TemporaryFile(dir=folder).close()
            if is_new:  # said, and others removed, only where this is the folder: not of each that may not be written
                for other in set(base.glob(f"{of_place}-*")) - {folder}:
                    shutil.rmtree(other, ignore_errors=True)
                _say_once(kept=True)
            return folder
    return None


def announce() -> None:
    """Say, once in a process, that compiling takes a while."""
    _say_once(kept=cache_folder() is not None)


@cache
def _say_once(*, kept: bool) -> None:
    if kept:
        _LOG.warning("compiling, once: a minute or so of processor time; the next run begins at once")
    else:
        _LOG.warning(
            "compiling, in each run: a minute or so of processor time, as no folder for what is compiled can be "
            "written. Let NUMBA_CACHE_DIR name one."
        )


_listeners: set[Callable[[], None]] = set()


def on_compiled(listener: Callable[[], None]) -> None:
    """Call a function after each function that is compiled in this process; none is where all are in the cache."""
    _listeners.add(listener)


@cache
def _listen() -> None:
    """Have numba tell `_listeners` what it compiles."""
    from numba.core import event  # late: see above

    class Compiled(event.Listener):  # type: ignore[misc]  # numba has no types
        def on_start(self, event: Any) -> None:
            """Do nothing: what begins is not done."""

        def on_end(self, event: Any) -> None:
            """Tell of one more."""
            for listener in _listeners:
                listener()

    event.register("numba:compile", Compiled())


def compiled_before(job: str) -> bool:
    """Return whether all that a job calls is compiled, as `note_compiled` noted; makes no folder.

    Only the folder that `cache_folder` takes counts: code elsewhere, where nothing can be written, is not used.
    """
    name = "-".join(_names())
    for base in _bases():
        there = next(place for place in (base / name, base, *base.parents) if os.path.exists(place))
        if there.is_dir() and os.access(there, os.W_OK | os.X_OK):
            return os.path.exists(base / name / f"{job}.compiled")  # False where Path.exists would raise
    return False


def note_compiled(job: str) -> None:
    """Note that all that a job calls is compiled."""
    if folder := cache_folder():
        with suppress(OSError):
            (folder / f"{job}.compiled").touch()


@cache
def _names() -> tuple[str, str]:
    """Return the parts of the folder's name: for this package, Python and processor; for these sources."""
    place = _digest(str(PACKAGE), sys.implementation.cache_tag, _processor())
    return f"zbuf_occlude-{place}", _digest(*_sources())


def _bases() -> Iterator[Path]:
    """Yield the folders in which the cache may lie."""
    if given := os.environ.get("NUMBA_CACHE_DIR"):
        yield Path(given)
    yield PACKAGE / "__pycache__"
    for home in (os.environ.get("XDG_CACHE_HOME", ""), os.path.expanduser("~/.cache")):
        if os.path.isabs(home):  # else it would be made wherever a person is: "~" stays for a user without a home
            yield Path(home, "zbuf_occlude")
            break
    if hasattr(os, "getuid"):
        private = Path(tempfile.gettempdir(), f"zbuf_occlude-{os.getuid()}")
        with suppress(OSError):
            private.mkdir(mode=0o700, exist_ok=True)
            status = private.lstat()
            if status.st_uid == os.getuid() and status.st_mode & 0o077 == 0:  # nobody else put code there
                yield private


def _sources() -> Iterator[bytes]:
    """Yield what compiled code depends on: the sources of `CACHE_KEY_FOLDERS`, and when numba was installed."""
    numba = importlib.util.find_spec("numba")
    if numba is not None and numba.origin:
        # its real place: an environment may be reached by a link, too
        yield f"{os.path.realpath(numba.origin)} {os.stat(numba.origin).st_mtime_ns}".encode()
    for room in CACHE_KEY_FOLDERS:
        for source in sorted((PACKAGE / room).glob("*.py")):
            yield source.name.encode(errors="surrogateescape")
            yield source.read_bytes()


def _processor() -> str:
    """Return what Linux says of the processor that is the same for all of its kind."""
    told = ("vendor_id", "cpu family", "model\t", "flags", "CPU ", "Features", "cpu\t", "isa")
    with suppress(OSError), open("/proc/cpuinfo") as file:
        return "".join(line for line in file.read(8192).partition("\n\n")[0].splitlines(True) if line.startswith(told))
    import platform  # late: nothing else needs it

    return platform.processor()


def _digest(*parts: str | bytes | None) -> str:
    found = hashlib.sha1()
    for part in parts:
        found.update(b"%b\0" % (part if isinstance(part, bytes) else str(part).encode(errors="surrogateescape")))
    return found.hexdigest()[:12]


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
