"""Default method and messages on a machine without OpenGL, or without OpenGL on its GPU."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.cli.conftest import Run
from zbuf_occlude.engines.gl import devices
from zbuf_occlude.engines.gl.probe import Probe
from zbuf_occlude.meshes.shapes import solids

TRIANGLE = "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
WHY = "no OpenGL context opens here"
CURE = "apt-get install"
"""Hint on OpenGL that only `doctor` prints; here `exact` suffices."""

MASKED = """
empty=$(mktemp)
find -L /usr/lib /usr/local/lib /lib -name 'libEGL*' -o -name 'libGL*' -o -name 'libOSMesa*' -o -name 'libOpenGL*' \\
    2>/dev/null | sort -u | while read -r file; do mount --bind "$empty" "$file" 2>/dev/null; done
exec "$@"
"""
"""Runs a command where every library of OpenGL is an empty file; in a mount namespace of its own."""


@pytest.fixture
def without_gl(monkeypatch: pytest.MonkeyPatch) -> None:
    """Hide all libraries of OpenGL from this process."""
    monkeypatch.delenv("ZBUF_OCCLUDE_GL", raising=False)
    monkeypatch.delenv("GLCONTEXT_DEVICE_INDEX", raising=False)
    monkeypatch.setattr("zbuf_occlude.engines.gl.context.find_library", lambda name: "libEGL_is_not_here.so")
    monkeypatch.setattr("zbuf_occlude.engines.gl.osmesa._SONAMES", ("libOSMesa_is_not_here.so",))


@pytest.fixture
def mesh(tmp_path: Path) -> Path:
    path = tmp_path / "triangle.off"
    path.write_text(TRIANGLE)
    return path


@pytest.mark.usefixtures("without_gl")
def test_generate_takes_exact_and_says_so_first_last_and_in_the_manifest(run: Run, mesh: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    result = run(f"generate {mesh} --views ring:2@30 --points 100 --workers 1 --out {out}")
    assert result.err.splitlines()[0] == f"method exact, because {WHY}"
    assert f"because {WHY}" in result.out.splitlines()
    assert CURE not in result.out + result.err
    manifest = json.loads((out / "manifest.json").read_text())
    assert (manifest["options"]["method"], manifest["options"]["reason"]) == ("exact", WHY)
    assert manifest["renderer"] == "none"


@pytest.mark.usefixtures("without_gl")
def test_visible_takes_exact_and_says_so(run: Run, mesh: Path, tmp_path: Path) -> None:
    result = run(f"visible {mesh} --azimuth 30 --elevation 20 --out cloud.ply")
    assert result.err.splitlines()[0] == f"method exact, because {WHY}"
    assert "by exact: " in result.out
    assert result.out.splitlines()[0].endswith(WHY)
    assert CURE not in result.out + result.err


@pytest.mark.parametrize(("broken", "code"), [("", 0), ("needs the package numba; its import fails", 1)])
def test_doctor_says_once_that_exact_is_complete(
    run: Run, monkeypatch: pytest.MonkeyPatch, broken: str, code: int
) -> None:
    rows = (Probe("egl", None, works=False, reason="libEGL is not here"), Probe("osmesa", None, works=False, reason=""))
    monkeypatch.setattr("zbuf_occlude.cli.lists.probe_all", lambda: rows)
    monkeypatch.setattr("zbuf_occlude.cli.lists.reason_missing", lambda method: "")
    monkeypatch.setattr("zbuf_occlude.cli.lists.tried", lambda package, module: broken)
    page = run("doctor", code=code).out
    last = page.splitlines()[-1]
    if broken:
        assert "cannot run" in last
        assert broken in last
    else:
        assert page.count("exact is complete") == page.count(CURE) == 1
        assert "exact is complete" in last


@pytest.mark.usefixtures("without_gl")
@pytest.mark.parametrize("named", ["--method depth_buffer", "--set resolution=64", "--require-gpu"])
def test_who_names_the_depth_buffer_or_a_gpu_is_refused(run: Run, named: str, mesh: Path, tmp_path: Path) -> None:
    run(f"generate {mesh} {named} --out out", code=1, says="No OpenGL 4.3 core context opens")
    assert not (tmp_path / "out").exists()


@pytest.mark.usefixtures("without_gl")
def test_on_the_fly_clouds_need_no_opengl() -> None:
    torch_dataset = pytest.importorskip("zbuf_occlude.datasets.torch", reason="PyTorch is not installed")
    occlude = torch_dataset.OnTheFlyOcclusion(64)
    assert occlude.method == "exact"
    assert occlude(solids.icosphere(1)).shape == (64, 3)


@pytest.mark.long
def test_both_commands_of_the_readme_with_all_libraries_masked(mesh: Path, tmp_path: Path) -> None:
    unshare = ["unshare", "--map-root-user", "--mount", "bash", "-c", MASKED, "masked"]
    if shutil.which("unshare") is None or subprocess.run([*unshare, "true"], capture_output=True).returncode:
        pytest.skip("this machine may not make mount namespaces")
    command = [*unshare, sys.executable, "-m", "zbuf_occlude"]
    unnamed = {name: value for name, value in os.environ.items() if name != "ZBUF_OCCLUDE_GL"}
    for arguments in (
        ["generate", "--limit", "2", "--views", "ring:2@30", "--points", "500", "--out", str(tmp_path / "out")],
        ["visible", str(mesh), "--azimuth", "30", "--elevation", "20", "--out", str(tmp_path / "cloud.ply")],
    ):
        child = subprocess.run([*command, *arguments], capture_output=True, text=True, env=unnamed)
        assert child.returncode == 0, child.stderr
        assert child.stderr.splitlines()[0] == f"method exact, because {WHY}"
        assert "by exact\n" in child.stdout or "by exact: " in child.stdout


@pytest.mark.gl
@pytest.mark.usefixtures("gl")
def test_a_run_that_fell_to_software_says_so_first_and_in_the_manifest(
    run: Run, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "nvidiactl").touch()
    monkeypatch.setattr(devices, "NVIDIA", tmp_path / "nvidiactl")
    monkeypatch.setattr(devices, "find_gl_problem", lambda: devices.GlProblem("it is hidden.", "show it"))
    out = tmp_path / "out"
    result = run(f"generate --limit 1 --views ring:2@30 --points 200 --workers 1 --out {out}")
    if "llvmpipe" not in result.out:
        pytest.skip("this machine may have a GPU")
    assert result.err.splitlines()[0].startswith("warning: OpenGL runs in software (llvmpipe")
    assert json.loads((out / "manifest.json").read_text())["renderer_remark"] in result.err.splitlines()[0]
    assert "it is hidden. Fix: show it" in result.out
