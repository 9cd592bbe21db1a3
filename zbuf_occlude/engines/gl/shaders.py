"""Shaders: GLSL files of shaders/, with includes and checked template constants, compiled into programs."""

import re
from functools import cache
from pathlib import Path
from string import Template
from typing import Any

from zbuf_occlude.base.errors import GlError

STAGES = {
    ".vert": "vertex_shader",
    ".frag": "fragment_shader",
    ".geom": "geometry_shader",
    ".comp": "compute_shader",
}
"""Stage of a shader file, by suffix."""

_INCLUDE = re.compile(r'^[ \t]*#include[ \t]+"([\w./-]+)"[ \t]*$', re.MULTILINE)


@cache
def shader_folder() -> Path:
    """Return the folder of the GLSL files: inside an installed wheel, or at the top level of a checkout."""
    package = Path(__file__).resolve().parents[2]
    for folder in (package / "_shaders", package.parent / "shaders"):
        if folder.is_dir():
            return folder
    raise GlError(f"The folder shaders is missing beside {package}. Install the package again.")


def compile_program(ctx: Any, *names: str, **constants: object) -> Any:
    """Compile shader files into one program.

    Parameters
    ----------
    ctx : moderngl.Context
    *names : str
        Files of ``shaders/``; the suffix of each gives its stage. A ``.comp`` must be the only file.
    **constants : object
        Values of the ``$CONSTANTS``; each must be used by at least one of the files.

    Returns
    -------
    moderngl.Program or moderngl.ComputeShader
        The caller must release it.

    Raises
    ------
    GlError
        As `shader_texts`, or the driver's compiler rejects the text; the message quotes it.
    """
    sources = {STAGES[Path(name).suffix]: text for name, text in shader_texts(*names, **constants).items()}
    try:
        if "compute_shader" in sources:
            return ctx.compute_shader(sources["compute_shader"])
        return ctx.program(**sources)
    except Exception as error:  # moderngl raises bare Exception
        raise GlError(f"{', '.join(names)} cannot be compiled: {error}") from None


def shader_texts(*names: str, **constants: object) -> dict[str, str]:
    """Return the texts of files of ``shaders/`` by name, with includes inserted and each ``$CONSTANT`` replaced.

    ``#include "file.glsl"`` inserts a file of ``shaders/include`` once. Raises GlError for a file that does not exist,
    a constant without a value, or a value that none of the files uses.
    """
    templates = {name: Template(_with_includes(name)) for name in names}
    used = {word for template in templates.values() for word in template.get_identifiers()}
    files = ", ".join(names)
    if missing := sorted(used - set(constants)):
        given = ", ".join(sorted(constants)) or "none"
        raise GlError(f"{files} must be given a value for {', '.join(missing)}; got {given}.")
    if unknown := sorted(set(constants) - used):
        known = ", ".join(sorted(used)) or "no constants"
        raise GlError(f"{files} must be given only {known}; got {', '.join(unknown)}.")
    values = {key: str(value).lower() if isinstance(value, bool) else value for key, value in constants.items()}
    return {name: template.substitute(values) for name, template in templates.items()}


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
        raise GlError(f"shaders/{file}, which {wanted_by} needs, does not exist. Is it misspelt?") from None


def set_uniforms(program: Any, **values: Any) -> None:
    """Set uniforms, except those that the compiler removed as unused; do nothing if the program is None."""
    for name, value in values.items():
        if program is not None and name in program:
            program[name].value = value
