"""Every shader, as it is compiled here or on a GPU, by the reference compiler: as OpenGL's GLSL and as SPIR-V."""

import subprocess
from pathlib import Path

import pytest

from zbuf_occlude.engines.gl.depth_pass import MAX_TILES
from zbuf_occlude.engines.gl.exact_pass import HARDWARE, SOFTWARE, shader_constants
from zbuf_occlude.engines.gl.point_pass import MAX_HIDDEN
from zbuf_occlude.engines.gl.shaders import shader_folder, shader_texts
from zbuf_occlude.engines.gl.tiles import EYES_PER_BYTE

PROGRAMS: list[tuple[str, dict[str, object]]] = [
    *[("exact.comp", shader_constants(shape, True)) for _, shape in (*SOFTWARE, *HARDWARE)],
    *[("depth.vert", {"TILES": MAX_TILES, "CUBE": cube, "FACES": ids}) for cube in (0, 1) for ids in (0, 1)],
    *[("depth.frag", {"FACES": ids}) for ids in (0, 1)],
    *[
        (name, {"TILES": MAX_TILES, "CUBE": cube, "EYES": eyes})
        for name in ("depth_test.comp", "vote.comp")
        for cube in (0, 1)
        for eyes in (1, EYES_PER_BYTE)
    ],
    *[("witness.comp", {"TILES": MAX_TILES, "CUBE": cube, "MAX_HIDDEN": MAX_HIDDEN}) for cube in (0, 1)],
    *[(name, {}) for name in ("candidates.comp", "peak.comp", "probe.comp", "stream.comp")],
]


def checked(*command: object) -> None:
    child = subprocess.run([str(word) for word in command], capture_output=True, text=True, check=False)
    assert child.returncode == 0, child.stdout + child.stderr


def test_no_shader_is_left_out() -> None:
    files = {path.name for path in shader_folder().iterdir() if path.is_file()}
    assert {name for name, _ in PROGRAMS} == files


@pytest.mark.needs("glslang")
@pytest.mark.parametrize(("name", "constants"), PROGRAMS, ids=[f"{i} {name}" for i, (name, _) in enumerate(PROGRAMS)])
def test_it_compiles(name: str, constants: dict[str, object], tmp_path: Path) -> None:
    source = tmp_path / name
    source.write_text(shader_texts(name, **constants)[name])
    checked("glslangValidator", source)
    binary = tmp_path / "shader.spv"
    checked("glslangValidator", "-G", "--aml", "--amb", "-o", binary, source)
    checked("spirv-val", "--target-env", "opengl4.5", binary)


@pytest.mark.needs("glslang")
def test_a_wrong_shader_would_be_found(tmp_path: Path) -> None:
    wrong = tmp_path / "wrong.comp"
    wrong.write_text("#version 430\nlayout(local_size_x = 1) in;\nvoid main() { int whole = 0.5; }\n")
    with pytest.raises(AssertionError, match="cannot convert"):
        checked("glslangValidator", wrong)
