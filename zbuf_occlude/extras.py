"""Optional packages: imported when they are used; where they are missing or broken, one line says what would help."""

import re
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from ctypes import CDLL
from importlib.util import find_spec
from traceback import walk_tb

from zbuf_occlude.errors import OccludeError, UnavailableError

EXTRAS = {
    "DracoPy": "draco",
    "OpenEXR": "exr",
    "PIL": "report",
    "embreex": "embree",
    "jinja2": "report",
    "matplotlib": "report",
    "open3d": "open3d",
    "pyarrow": "parquet",
    "pyrender": "pyrender",
    "ray": "ray",
    "scipy": "bop",
    "torch": "learn",
    "warp": "warp",
}
"""Package to the extra that brings it."""

DEBIAN = {
    "libEGL.so.1": "libegl1 libgl1-mesa-dri",
    "libGL.so.1": "libgl1",
    "libX11.so.6": "libx11-6",
    "libXrender.so.1": "libxrender1",
    "libgomp.so.1": "libgomp1",
    "libusb-1.0.so.0": "libusb-1.0-0",
}
"""Libraries that the packages link to and do not bring, and Debian's packages of them."""

_NO_LIBRARY = re.compile(r'(lib[^\s:/]*\.so[.\d]*): cannot open shared object file|Library "(\w+)" not found')
"""What the loader says, and what pyglet does, on which pyrender is built."""
_PATIENCE = 120.0  # seconds


def missing(package: str, *libraries: str) -> str:
    """Return a message that a package, or on Linux a library that it needs, is not installed; "" where all are."""
    if find_spec(package) is None:
        return f"needs the package {package}; install it: pip install 'zbuf-occlude[{EXTRAS[package]}]'"
    lacking = [library for library in libraries if sys.platform == "linux" and not _loads(library)]
    if not lacking:
        return ""
    return f"needs {', '.join(lacking)} for {package}; {_cure(lacking)}"


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
    """Import, within the block, an optional package or a module of this package that needs it.

    Parameters
    ----------
    package : str
        A key of `EXTRAS`.
    what : str
        What needs it, the subject of the message.

    Raises
    ------
    UnavailableError
        The package is missing or cannot be imported; the message names the library that is missing, if one is, and the
        command that helps.
    """
    try:
        yield
    except OccludeError:
        raise
    except Exception as error:  # broken packages raise anything while they are imported
        raise UnavailableError(f"{what} {reason(package, error)}") from None


def reason(package: str, error: Exception) -> str:
    """Return a message: why a package could not be imported, and what helps."""
    if lacking := missing(package):
        return lacking
    from importlib.metadata import packages_distributions  # late: it takes a while, and is seldom asked

    said = " ".join(f"{type(error).__name__}: {error}".split())
    fix = f"install it again: pip install --force-reinstall {packages_distributions().get(package, [package])[0]}"
    if found := _NO_LIBRARY.search(said):
        name = found[1] or f"lib{found[2]}.so"
        library = next((each for each in DEBIAN if found[2] and each.startswith(name)), name)
        said = f"the library {library} is missing"
        if library in DEBIAN:
            fix = _cure([library])
    elif isinstance(error, ModuleNotFoundError) and error.name and error.name.partition(".")[0] != package:
        fix = f"install that too: pip install {error.name.partition('.')[0]}"
    return f"needs the package {package}; it is installed, and its import fails: {said.removesuffix('.')}; {fix}"


def culprit(error: ImportError) -> str:
    """Return which of the optional packages an import failed in; "" for none."""
    names = [error.name or "", *(frame.f_globals.get("__name__", "") for frame, _ in walk_tb(error.__traceback__))]
    return next((root for name in names if (root := name.partition(".")[0]) in EXTRAS), "")


def tried(package: str, module: str) -> str:
    """Return a message: why a package, or the module that needs it, cannot be imported; "" where both can.

    They are imported in a process of its own.
    """
    program = f"from zbuf_occlude.extras import importing\nwith importing({package!r}, ''): import {package}, {module}"
    command = [sys.executable, "-P", "-c", program]
    try:
        child = subprocess.run(command, capture_output=True, text=True, timeout=_PATIENCE, check=False)
    except subprocess.TimeoutExpired:
        return f"needs the package {package}; its import did not end in {_PATIENCE:g} seconds"
    if child.returncode == 0:
        return ""
    last_line = (child.stderr.strip().splitlines() or [f"the process ended with code {child.returncode}"])[-1]
    return last_line.removeprefix(f"{UnavailableError.__module__}.{UnavailableError.__name__}:").strip()
