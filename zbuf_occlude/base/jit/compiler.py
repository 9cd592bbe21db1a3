"""Decorators of compiled functions, and the folder of compiled code: one for each state of the sources.

numba takes 0.3 s to import. Functions are therefore declared without it, and compiled or loaded at their first call.
"""

import gc
import hashlib
import importlib.util
import inspect
import logging
import os
import shutil
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache, cached_property, update_wrapper
from importlib import import_module
from pathlib import Path
from types import CodeType, ModuleType
from typing import IO, Any

from zbuf_occlude.base.interrupts import held

PACKAGE = Path(__file__).parents[2]
CACHE_KEY_FOLDERS = (
    "base", "base/jit", "engines/exact", "engines/gl", "engines/object_space", "geometry", "meshes", "visibility",
    "visibility/methods",
)  # fmt: skip
"""Folders of the package whose functions and constants compiled functions of other files use."""

PATIENCE = 60.0
"""Seconds to wait for another process that compiles the same function; it may hang."""

POLL = 0.02
"""Seconds between two attempts to take its lock."""

MAX_LOST = 20
"""Maximum functions that a call compiles although they cannot be kept, as on a full disk."""

_LOG = logging.getLogger(__name__)
_lock = threading.RLock()
"""Lock of numba's setting of the cache folder. A thread that holds it too takes numba's compiler lock first."""


class Kernel:
    """Function that numba compiles when it, or a compiled function that names it, is first called."""

    def __init__(self, function: Callable[..., Any], options: dict[str, Any]) -> None:
        update_wrapper(self, function)
        self._function, self._options = function, options
        self._dispatcher: Any = None
        self._is_compiled = False
        self._is_lost = False  # True once compiled code could not be kept

    def _declared(self) -> Any:
        """Return numba's dispatcher."""
        if self._dispatcher is None:
            import numba  # late: it takes 0.3 s

            _listen()
            _define_externals(self._function)
            folder = cache_folder() if self._options.get("cache") else None
            with _lock, _caching_in(folder):
                options = {**self._options, "cache": folder is not None}
                self._dispatcher = self._dispatcher or numba.njit(**options)(self._function)
        return self._dispatcher

    def __call__(self, *arguments: Any) -> Any:
        """Call the compiled function."""
        dispatcher = self._declared()
        if not self._is_compiled:
            import numba  # late: it takes 0.3 s

            with suppress(OSError), _compiling(self._function if self._options.get("cache") else None):
                self._retry(lambda: dispatcher.compile(tuple(map(numba.typeof, arguments))))
                if self._is_lost:
                    raise OSError("it must not be marked as compiled")
            self._is_compiled = True
        return self._retry(lambda: dispatcher(*arguments))

    def _retry(self, compiles: Callable[[], Any]) -> Any:
        """Call what may compile, again after each function that numba has compiled but cannot keep."""
        for _ in range(MAX_LOST):
            with suppress(OSError):
                return compiles()
            self._is_lost = True
        return compiles()

    @property
    def is_kept(self) -> bool:
        """True once compiled code of the function is in the cache."""
        folder = _existing_folder()
        return folder is not None and _is_marked(folder / _lock_name(self._function))

    def __getattr__(self, name: str) -> Any:
        """Return an attribute of numba's dispatcher, which numba uses where compiled functions call this one."""
        if name.startswith("__"):
            raise AttributeError(name)
        return getattr(self._declared(), name)


class External:
    """Function of numbers that compiled functions call by its symbol, so that it is compiled once.

    numba optimises any other function again within each of its callers, at every level of them. For a large function
    that is seldom called, that takes most of the time of compiling.
    """

    def __init__(self, function: Callable[..., Any], signature: str) -> None:
        update_wrapper(self, function)  # type: ignore[arg-type]  # it cannot be called in Python
        self._function, self._signature = function, signature

    @cached_property
    def _numba_type_(self) -> Any:
        """Type of the function, once it is compiled or read from the cache and its symbol has its address."""
        import numba  # late: it takes 0.3 s
        from llvmlite import binding

        symbol, address = f"{self._function.__module__}.{self._function.__name__}", _NOWHERE
        if not _only_compiles:
            _define_externals(self._function)
            folder, self._compiled = cache_folder(), None
            with suppress(OSError), _compiling(self._function), _lock, _caching_in(folder):
                self._compiled = numba.cfunc(self._signature, cache=folder is not None)(self._function)
            if self._compiled is None:  # it cannot be kept
                self._compiled = numba.cfunc(self._signature)(self._function)
            address = self._compiled.address
        binding.add_symbol(symbol, address)
        arguments, result = numba.core.sigutils.normalize_signature(self._signature)
        return numba.types.ExternalFunction(symbol, result(*arguments))


def external(signature: str) -> Callable[[Callable[..., Any]], Any]:
    """Return a decorator of functions with a signature of numba's, of float64 and int64 alone."""
    return lambda function: External(function, signature)


_only_compiles = False
_NOWHERE = 1
"""Address of external functions in a process that calls none."""


def leave_out_externals() -> None:
    """Leave external functions uncompiled; this process must then run no function that calls one."""
    global _only_compiles
    _only_compiles = True


def _define_externals(function: Callable[..., Any]) -> None:
    """Define the external functions that a function calls: compiled code in the cache does not say which they are."""
    if not (called := _externals_of(function)):
        return
    from numba.core.compiler_lock import global_compiler_lock  # late: it takes 0.3 s

    with global_compiler_lock:  # other threads wait here until the symbols are there
        for each in called:
            _ = each._numba_type_


def _externals_of(function: Callable[..., Any]) -> list[External]:
    """Return the external functions that a function calls, itself or through compiled ones that are not external."""
    found: list[External] = []
    seen, callers = {function}, [function]
    while callers:
        for named in _values_named_in(callers.pop()):
            if isinstance(named, External | Kernel) and named._function not in seen:
                seen.add(named._function)
                if isinstance(named, External):
                    found.append(named)
                else:
                    callers.append(named._function)
    return found


def _values_named_in(function: Callable[..., Any]) -> list[Any]:
    """Return the values of all names in a function and those nested in it, and the attributes of modules among them."""
    names: list[str] = []
    codes = [function.__code__]
    while codes:
        code = codes.pop()
        names += code.co_names
        codes += [constant for constant in code.co_consts if isinstance(constant, CodeType)]
    known = {**function.__globals__, **inspect.getclosurevars(function).nonlocals}
    values = [known[name] for name in names + list(function.__code__.co_freevars) if name in known]
    modules = [value for value in values if isinstance(value, ModuleType)]
    return values + [getattr(module, name) for module in modules for name in names if name in vars(module)]


@contextmanager
def _compiling(cached: Callable[..., Any] | None) -> Iterator[None]:
    """Compile within the block; a cached function alone, so that another process that needs it then loads it.

    Loading takes milliseconds, in callbacks of LLVM that would swallow an interrupt. Numba leaves little garbage in
    cycles, and looking for it would take a tenth of the time.
    """
    lock = _lock_of(cached) if cached else None
    with lock or held(), _no_collection:
        yield
        if lock:
            lock.write(b"compiled")


class _NoCollection:
    """Context in which garbage is not collected, until the last thread leaves it."""

    def __init__(self) -> None:
        self._lock, self._n_within, self._collects = threading.Lock(), 0, False

    def __enter__(self) -> None:
        with self._lock:
            if self._n_within == 0:
                self._collects = gc.isenabled()
                gc.disable()
            self._n_within += 1

    def __exit__(self, *error: object) -> None:
        with self._lock:
            self._n_within -= 1
            if self._n_within == 0 and self._collects:
                gc.enable()


_no_collection = _NoCollection()


def _lock_of(function: Callable[..., Any]) -> IO[bytes] | None:
    """Return the file of a function in the cache's folder, locked until it is closed; None once it is compiled.

    It is not locked where another process has held it for `PATIENCE`, nor on systems without locks.
    """
    if (folder := cache_folder()) is None:
        return None
    path = folder / _lock_name(function)
    try:
        if _is_marked(path):
            return None
        file = open(path, "ab", buffering=0)  # noqa: SIM115
        fcntl = import_module("fcntl")
    except ModuleNotFoundError:  # only Unix has it
        return file
    except OSError:
        return None
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            time.sleep(POLL)
        except OSError:
            break
        else:
            break
    return file


def _lock_name(function: Callable[..., Any]) -> str:
    return f"{_digest(function.__module__, function.__qualname__)}.lock"


def _is_marked(path: Path) -> bool:
    """Return whether the file of a function has content, which it gets once the function is compiled."""
    return os.path.exists(path) and os.path.getsize(path) > 0


@contextmanager
def _caching_in(folder: Path | None) -> Iterator[None]:
    """Have numba read and keep what is declared within the block in a folder; other packages keep theirs."""
    import numba  # late: it takes 0.3 s

    before, numba.config.CACHE_DIR = numba.config.CACHE_DIR, str(folder)
    try:
        yield
    finally:
        numba.config.CACHE_DIR = before


def njit(**options: Any) -> Callable[[Callable[..., Any]], Kernel]:
    """Return a decorator that applies `numba.njit` with these options when the function is first needed.

    By default references to arrays are not counted (``_nrt=False``): counting them for each row ``vertices[i]`` of a
    loop takes 3 % of a dataset's time. A function that allocates needs ``_nrt=True``. No function gets an entry for C.
    """
    return lambda function: Kernel(function, {"_nrt": False, "no_cfunc_wrapper": True, **options})


device_function = njit(no_cpython_wrapper=True)
"""Decorator of a function that only compiled functions call. Without wrappers, compiling takes 10 % less time."""
always_inline = njit(forceinline=True, no_cpython_wrapper=True)
"""Decorator of a device function that LLVM copies into its callers."""
inline_ir = njit(inline="always", no_cpython_wrapper=True)
"""Decorator of a device function with one caller, into which numba copies it before type inference, so that nested
functions are optimised once. The caller's options apply to it, so the caller must not count references either."""


@cache
def cache_folder() -> Path | None:
    """Return the folder of code compiled from these sources; None if no folder can be written.

    It is a subfolder of NUMBA_CACHE_DIR if that is set. Otherwise it is in the package's ``__pycache__``, in
    ``~/.cache``, or in a private temporary folder: the first that can be written. A new folder replaces those of other
    sources. Without a folder each process compiles for itself.
    """
    of_place, of_sources = _names()
    for base in _bases():
        folder = base / f"{of_place}-{of_sources}"
        with suppress(OSError):
            is_new = not folder.exists()
            folder.mkdir(parents=True, exist_ok=True)
            tempfile.TemporaryFile(dir=folder).close()
            if is_new:  # only once the folder is known to be writable
                for other in set(base.glob(f"{of_place}-*")) - {folder}:
                    shutil.rmtree(other, ignore_errors=True)
                _say_once(kept=True)
            return folder
    return None


def announce() -> None:
    """Log, once per process, that compiling takes a while."""
    _say_once(kept=cache_folder() is not None)


@cache
def _say_once(*, kept: bool) -> None:
    if kept:
        _LOG.warning("compiling, once: a minute or so of processor time; the next run begins at once")
    else:
        _LOG.warning(
            "compiling, in each run: a minute or so of processor time, because no folder for compiled code can be "
            "written. Let NUMBA_CACHE_DIR name one."
        )


_listeners: set[Callable[[], None]] = set()


def on_compiled(listener: Callable[[], None]) -> None:
    """Register a listener that is called after each compilation in this process; loading from the cache is none."""
    _listeners.add(listener)


@cache
def _listen() -> None:
    """Make numba call `_listeners` after each compilation."""
    from numba.core import event  # late: numba takes 0.3 s to import

    class Compiled(event.Listener):  # type: ignore[misc]  # numba has no types
        def on_start(self, event: Any) -> None:
            """Do nothing when a compilation starts."""

        def on_end(self, event: Any) -> None:
            """Call the listeners when a compilation ends."""
            for listener in _listeners:
                listener()

    event.register("numba:compile", Compiled())


def compiled_before(job: str) -> bool:
    """Return whether `note_compiled` has recorded that all functions of a job are compiled; makes no folder."""
    folder = _existing_folder()
    return folder is not None and os.path.exists(folder / f"{job}.compiled")  # False where Path.exists would raise


def _existing_folder() -> Path | None:
    """Return the folder that `cache_folder` would return, if it exists: compiled code in another is not used."""
    name = "-".join(_names())
    for base in _bases():
        there = next(folder for folder in (base / name, base, *base.parents) if os.path.exists(folder))
        if there.is_dir() and os.access(there, os.W_OK | os.X_OK):
            return there if there == base / name else None
    return None


def note_compiled(job: str) -> None:
    """Record that all functions of a job are compiled."""
    if folder := cache_folder():
        with suppress(OSError):
            (folder / f"{job}.compiled").touch()


@cache
def _names() -> tuple[str, str]:
    """Return the parts of the folder's name: a digest of package and Python, and one of the sources.

    Code for several processors can be in one folder: numba keeps them apart.
    """
    installation = _digest(str(PACKAGE), sys.implementation.cache_tag)
    return f"zbuf_occlude-{installation}", _digest(*_sources())


def _bases() -> Iterator[Path]:
    """Yield the folders that may hold the cache, in order of preference."""
    if given := os.environ.get("NUMBA_CACHE_DIR"):
        yield Path(given)
    yield PACKAGE / "__pycache__"
    for home in (os.environ.get("XDG_CACHE_HOME", ""), os.path.expanduser("~/.cache")):
        if os.path.isabs(home):  # "~" is not expanded for a user without a home
            yield Path(home, "zbuf_occlude")
            break
    if hasattr(os, "getuid"):
        private = Path(tempfile.gettempdir(), f"zbuf_occlude-{os.getuid()}")
        with suppress(OSError):
            private.mkdir(mode=0o700, exist_ok=True)
            status = private.lstat()
            if status.st_uid == os.getuid() and status.st_mode & 0o077 == 0:  # no other user can have put code there
                yield private


def _sources() -> Iterator[bytes]:
    """Yield the inputs of compiled code: the sources of `CACHE_KEY_FOLDERS`, and numba's time of installation."""
    numba = importlib.util.find_spec("numba")
    if numba is not None and numba.origin:
        # the real path: an environment may be reached through a link
        yield f"{os.path.realpath(numba.origin)} {os.stat(numba.origin).st_mtime_ns}".encode()
    for room in CACHE_KEY_FOLDERS:
        for source in sorted((PACKAGE / room).glob("*.py")):
            yield source.name.encode(errors="surrogateescape")
            yield source.read_bytes()


def _digest(*parts: str | bytes | None) -> str:
    found = hashlib.sha1()
    for part in parts:
        found.update(b"%b\0" % (part if isinstance(part, bytes) else str(part).encode(errors="surrogateescape")))
    return found.hexdigest()[:12]
