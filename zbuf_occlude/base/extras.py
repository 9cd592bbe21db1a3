"""Optional packages, imported on use, and messages with the remedy where one is missing or broken."""

import re
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from ctypes import CDLL
from importlib import import_module
from importlib.util import find_spec
from traceback import walk_tb

from zbuf_occlude.base.child import ChildFailed, call_in_child
from zbuf_occlude.base.errors import OccludeError, UnavailableError

EXTRAS = {
    "DracoPy": "draco",
    "OpenEXR": "exr",
    "PIL": "report",
    "embreex": "embree",
    "jinja2": "report",
    "matplotlib": "report",
    "mcap_ros2": "mcap",
    "networkx": "scenes",
    "open3d": "open3d",
    "pyarrow": "parquet",
    "pyrender": "pyrender",
    "ray": "ray",
    "scipy": "bop",
    "torch": "learn",
    "viser": "view",
    "warp": "warp",
}
"""Extra that installs each package."""

DEBIAN = {
    "libEGL.so.1": "libegl1 libgl1-mesa-dri",
    "libGL.so.1": "libgl1",
    "libX11.so.6": "libx11-6",
    "libXrender.so.1": "libxrender1",
    "libgomp.so.1": "libgomp1",
    "libusb-1.0.so.0": "libusb-1.0-0",
}
"""Debian packages of the shared libraries that the optional packages need but do not contain."""

_NO_LIBRARY = re.compile(r'(lib[^\s:/]*\.so[.\d]*): cannot open shared object file|Library "(\w+)" not found')
"""Messages of the dynamic loader and of pyglet (used by pyrender) about a missing library."""
_TIMEOUT = 120.0  # seconds of an import


def missing(package: str, *libraries: str) -> str:
    """Return a message if a package, or on Linux a library that it needs, is not installed; else ""."""
    if find_spec(package) is None:
        return f"needs the package {package}; install it: pip install 'zbuf-occlude[{EXTRAS[package]}]'"
    absent = [library for library in libraries if sys.platform == "linux" and not _loads(library)]
    if not absent:
        return ""
    return f"needs {', '.join(absent)} for {package}; {_cure(absent)}"


def _loads(library: str) -> bool:
    try:
        CDLL(library)
    except OSError:
        return False
    return True


def _cure(libraries: Sequence[str]) -> str:
    return f"on Debian: apt-get install {' '.join(DEBIAN[library] for library in libraries)}"


@contextmanager
def importing(package: str, what: str) -> Iterator[None]:
    """Return a context in which an optional package, or a module that needs it, is imported.

    Parameters
    ----------
    package : str
        A key of `EXTRAS`.
    what : str
        The feature that needs it, the subject of the message.

    Raises
    ------
    UnavailableError
        The package is missing or cannot be imported; the message names a missing library and the command that installs
        it.
    """
    try:
        yield
    except OccludeError:
        raise
    except Exception as error:  # the import of a broken package raises any error
        raise UnavailableError(f"{what} {reason(package, error)}") from None


def reason(package: str, error: Exception) -> str:
    """Return the cause of a package's failed import, and the remedy."""
    if not_installed := missing(package):
        return not_installed
    from importlib.metadata import packages_distributions  # here, because the import is slow and seldom needed

    cause = " ".join(f"{type(error).__name__}: {error}".split())
    fix = f"install it again: pip install --force-reinstall {packages_distributions().get(package, [package])[0]}"
    if found := _NO_LIBRARY.search(cause):
        name = found[1] or f"lib{found[2]}.so"
        library = next((each for each in DEBIAN if found[2] and each.startswith(name)), name)
        cause = f"the library {library} is missing"
        if library in DEBIAN:
            fix = _cure([library])
    elif isinstance(error, ModuleNotFoundError) and error.name and error.name.partition(".")[0] != package:
        fix = f"install that too: pip install {error.name.partition('.')[0]}"
    return f"needs the package {package}; it is installed, and its import fails: {cause.removesuffix('.')}; {fix}"


def culprit(error: ImportError) -> str:
    """Return the optional package in which an import failed; "" for none."""
    names = [error.name or "", *(frame.f_globals.get("__name__", "") for frame, _ in walk_tb(error.__traceback__))]
    return next((root for name in names if (root := name.partition(".")[0]) in EXTRAS), "")


def tried(package: str, module: str) -> str:
    """Return a message if a package, or a module that needs it, cannot be imported by a child process; else ""."""
    try:
        call_in_child(_import, package, module, timeout=_TIMEOUT)
    except UnavailableError as error:
        return str(error).strip()
    except ChildFailed as failure:
        return f"needs the package {package}; a process that imports it {failure}"
    return ""


def _import(package: str, module: str) -> None:
    with importing(package, ""):
        import_module(package)
        import_module(module)
