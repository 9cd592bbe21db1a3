"""What tests need besides this project: `lacking` tries it, and says what a machine without it should install."""

import os
import subprocess
import sys
import tempfile
from functools import cache
from pathlib import Path

import pytest

from tests.browser import FLAGS, find_browser
from zbuf_occlude.base.extras import EXTRAS

PATIENCE = 120.0
"""Seconds after which a thing that is being loaded is taken for broken."""

_OPENS_GL = "from zbuf_occlude.engines.gl.context import GlContext; GlContext.open({!r}).close()"
_SHADER = "#version 430\nlayout(local_size_x = 1) in;\nvoid main() {}\n"

DEBIAN = {
    "open3d": "libusb-1.0-0 libgl1 libx11-6 libgomp1",
    "pyrender": "libegl1 libgl1-mesa-dri libgl1 libxrender1",
    "egl": "libegl1 libgl1-mesa-dri",
    "osmesa": "libosmesa6",
    "zink": "libegl1 libgl1-mesa-dri mesa-vulkan-drivers",
    "chromium": "chromium",
    "glslang": "glslang-tools spirv-tools",
}
"""Debian's packages of what each thing needs. All of them are in the command that CONTRIBUTING.md names."""

PROGRAMS = {
    "pyrender": "import pyrender; pyrender.OffscreenRenderer(8, 8).delete()",
    "egl": _OPENS_GL.format("egl"),
    "osmesa": _OPENS_GL.format("osmesa"),
    "zink": "from zbuf_occlude.engines.gl.context import GlContext; assert 'zink' in GlContext.open('egl').renderer",
}
"""What is run to load a thing; a Python package that is not named here is imported."""

ENVIRONMENTS = {
    "pyrender": {"PYOPENGL_PLATFORM": "egl"},
    "zink": {"GALLIUM_DRIVER": "zink", "MESA_LOADER_DRIVER_OVERRIDE": "zink", "LIBGL_ALWAYS_SOFTWARE": "1"},
}


@cache
def lacking(thing: str) -> str:
    """Return why a thing cannot be loaded here, and what helps; "" where it can.

    It is loaded in a process of its own, which may crash.

    Parameters
    ----------
    thing : str
        A key of `DEBIAN`, or a Python package; "" can always be loaded.
    """
    if not thing:
        return ""
    with tempfile.TemporaryDirectory() as folder:
        for command in _commands(thing, Path(folder)):
            if found := _failure(command, ENVIRONMENTS.get(thing, {})):
                cure = f"pip install 'zbuf-occlude[{EXTRAS[thing]}]'" if thing in EXTRAS else ""
                if thing in DEBIAN:
                    cure = f"Debian: apt-get install {DEBIAN[thing]}"
                return f"{thing} cannot be loaded here: {found}" + f" ({cure})" * ("apt-get install" not in found)
    return ""


def need(*things: str) -> None:
    """Skip the test that runs, or the module that is imported, with the reason, unless all these can be loaded."""
    for thing in things:
        if reason := lacking(thing):
            pytest.skip(reason, allow_module_level=True)


def _commands(thing: str, folder: Path) -> list[list[str]]:
    if thing == "chromium":
        return [[find_browser() or "chromium", *FLAGS[:2], "--dump-dom", f"--user-data-dir={folder}", "about:blank"]]
    if thing == "glslang":
        (folder / "a.comp").write_text(_SHADER)
        compiled = str(folder / "a.spv")
        return [["glslangValidator", "-G", "-o", compiled, str(folder / "a.comp")], ["spirv-val", compiled]]
    return [[sys.executable, "-c", PROGRAMS.get(thing, f"import {thing}")]]


def _failure(command: list[str], environment: dict[str, str]) -> str:
    """Return the last line of what a command said when it failed; "" when it did not."""
    unnamed = {name: value for name, value in os.environ.items() if name != "ZBUF_OCCLUDE_GL"}
    try:
        child = subprocess.run(
            command, env={**unnamed, **environment}, capture_output=True, text=True, timeout=PATIENCE, check=False
        )
    except FileNotFoundError:
        return f"there is no {command[0]}"
    except subprocess.TimeoutExpired:
        return f"it did not answer in {PATIENCE:g} s"
    if child.returncode == 0:
        return ""
    return (child.stderr.strip().splitlines() or [f"its process ended with code {child.returncode}"])[-1]
