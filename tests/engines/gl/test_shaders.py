"""Shader files: includes, constants, and errors that name the file."""

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from zbuf_occlude.base.errors import GlError
from zbuf_occlude.engines.gl import shaders
from zbuf_occlude.engines.gl.context import GlContext

Write = Callable[[str, str], None]


@pytest.fixture
def write(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Write]:
    """Write a shader file into a folder that stands in for shaders/."""
    (tmp_path / "include").mkdir()
    monkeypatch.setattr(shaders, "shader_folder", lambda: tmp_path)
    shaders._with_includes.cache_clear()
    yield lambda name, text: (tmp_path / name).write_text(text) and None
    shaders._with_includes.cache_clear()


def test_includes_come_in_once_and_in_order(write: Write) -> None:
    write("include/a.glsl", "A")
    write("include/b.glsl", '#include "a.glsl"\nB')
    write("x.comp", '#version 430\n#include "b.glsl"\n#include "a.glsl"\nX')
    assert shaders.shader_texts("x.comp")["x.comp"].split() == ["#version", "430", "A", "B", "X"]


def test_constants_are_filled_in(write: Write) -> None:
    write("x.comp", "$N $F $B")
    assert shaders.shader_texts("x.comp", N=3, F=0.5, B=True)["x.comp"] == "3 0.5 true"


@pytest.mark.parametrize(
    ("text", "constants", "message"),
    [
        ("$SIZE", {"SIZ": 3}, "x.comp .* SIZE; got SIZ"),
        ("$SIZE", {"SIZE": 1, "SIZES": 3}, "x.comp .* only SIZE; got SIZES"),
        ("", {"SIZE": 1}, "x.comp .* no constants; got SIZE"),
        ('#include "no.glsl"', {}, "shaders/include/no.glsl, which x.comp needs, does not exist"),
    ],
)
def test_misspelt_names_are_errors(write: Write, text: str, constants: dict[str, int], message: str) -> None:
    write("x.comp", text)
    with pytest.raises(GlError, match=message):
        shaders.shader_texts("x.comp", **constants)
    with pytest.raises(GlError, match=r"shaders/none\.vert, which the program needs, does not exist"):
        shaders.shader_texts("none.vert")


def test_a_text_that_does_not_compile_names_its_file(write: Write, gl: GlContext) -> None:
    write("broken.comp", "#version 430\nlayout(local_size_x = 1) in;\nvoid main() { undeclared = 1; }\n")
    with pytest.raises(GlError, match=r"broken\.comp cannot be compiled: [\s\S]*undeclared"):
        shaders.compile_program(gl.ctx, "broken.comp")


def test_every_shader_opens_with_a_header_and_lies_in_the_folder() -> None:
    files = [path for path in shaders.shader_folder().rglob("*") if path.is_file()]
    assert files
    for path in files:
        assert path.suffix in {*shaders.STAGES, ".glsl"}, path
        assert path.read_text().startswith("// "), path
