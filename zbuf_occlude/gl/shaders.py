"""Shaders are files: GLSL from shaders/, with includes and checked template constants, compiled into programs."""

import re
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from string import Template
from typing import Any

from zbuf_occlude.errors import GlError

STAGES = {
    ".vert": "vertex_shader",
    ".frag": "fragment_shader",
    ".geom": "geometry_shader",
    ".comp": "compute_shader",
}
"""A file's suffix is its stage."""

_INCLUDE = re.compile(r'^[ \t]*#include[ \t]+"([\w./-]+)"[ \t]*$', re.MULTILINE)


@cache
def shader_folder() -> Path:
    """Return where the GLSL files are: inside an installed wheel, or at the top level of a checkout."""
    package = Path(__file__).resolve().parents[1]
    for folder in (package / "_shaders", package.parent / "shaders"):
        if folder.is_dir():
            return folder
    raise GlError(f"the folder shaders must be beside or inside {package}; it is not. Install the package again.")


def load(name: str, **constants: object) -> str:
    """Return a shader's text: includes in place, every ``$CONSTANT`` replaced.

    Parameters
    ----------
    name : str
        File name in ``shaders/``, e.g. ``"depth.vert"``.
    **constants
        A value for every ``$NAME`` in the text, no more and no fewer.

    Raises
    ------
    GlError
        No such file or include, a constant without a value, or a value without a constant (a misspelt name is both).

    Notes
    -----
    ``#include "file.glsl"`` takes a file from ``shaders/include``, once a shader however often it is asked for.
    """
    text = _with_includes(name)
    used = set(Template(text).get_identifiers())
    _check_constants(name, used, constants)
    return Template(text).substitute({key: _glsl(value) for key, value in constants.items()})


def compile_program(ctx: Any, *names: str, constants: Mapping[str, object] | None = None) -> Any:
    """Compile shader files into one program.

    Parameters
    ----------
    ctx : moderngl.Context
    *names : str
        Files of ``shaders/``; the suffix of each is its stage. A ``.comp`` stands alone.
    constants : mapping, optional
        Values of the ``$CONSTANTS``; each must be used by at least one of the files.

    Returns
    -------
    moderngl.Program or moderngl.ComputeShader
        The caller's, who releases it.

    Raises
    ------
    GlError
        As `load`, or the driver's compiler refuses the text; the message names the files and quotes the compiler.
    """
    constants = constants or {}
    used = {name: set(Template(_with_includes(name)).get_identifiers()) for name in names}
    _check_constants(", ".join(names), set().union(*used.values()), constants)
    sources = {STAGES[Path(name).suffix]: load(name, **{key: constants[key] for key in used[name]}) for name in names}
    try:
        if "compute_shader" in sources:
            return ctx.compute_shader(sources["compute_shader"])
        return ctx.program(**sources)
    except Exception as error:  # moderngl raises bare Exception
        raise GlError(f"{', '.join(names)} must compile; the driver says: {error}") from None


@cache
def _with_includes(name: str) -> str:
    included: set[str] = set()

    def insert(match: re.Match[str]) -> str:
        file = match.group(1)
        if file in included:
            return ""
        included.add(file)
        return _INCLUDE.sub(insert, _read(f"include/{file}", wanted_by=name))

    return _INCLUDE.sub(insert, _read(name, wanted_by="the program"))


def _read(file: str, wanted_by: str) -> str:
    try:
        return (shader_folder() / file).read_text(encoding="utf-8")
    except OSError:
        raise GlError(f"shaders/{file} must exist, {wanted_by} needs it; it does not. Is it misspelt?") from None


def _check_constants(name: str, used: set[str], given: Mapping[str, object]) -> None:
    if missing := sorted(used - set(given)):
        raise GlError(
            f"{name} must be given a value for {', '.join(missing)}; got {', '.join(sorted(given)) or 'none'}."
        )
    if unknown := sorted(set(given) - used):
        raise GlError(
            f"{name} must be given only {', '.join(sorted(used)) or 'no constants'}; got {', '.join(unknown)}."
        )


def _glsl(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    return repr(value) if isinstance(value, float) else str(value)
