"""Importing the package, and listing its methods, loads nothing heavy and needs nothing optional."""

import subprocess
import sys

import pytest

HEAVY = (
    *("moderngl", "glcontext", "OpenGL", "pyrender", "torch", "open3d", "ray", "embreex", "matplotlib", "webdataset"),
    "trimesh",
)

LIST_METHODS = "import zbuf_occlude as zo; [(m.name, m.summary, m.exact, m.needs_gl, m.extra) for m in zo.METHODS]"
ASK_WHAT_IS_MISSING = "import zbuf_occlude as zo; [m.missing() for m in zo.METHODS]"
SAMPLE = (
    "import zbuf_occlude as zo; mesh = zo.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]).normalized();"
    "zo.sample_surface(mesh, n_points=10); zo.views.paper100().eyes"
)

BLOCKED = (
    "import sys\n"
    f"heavy = {HEAVY!r}\n"
    "class Refuse:\n"
    "    def find_spec(self, name, path=None, target=None):\n"
    "        if name.partition('.')[0] in heavy:\n"
    "            raise ModuleNotFoundError(f'No module named {name!r}', name=name)\n"
    "sys.meta_path.insert(0, Refuse())\n"
)


def run(program: str) -> str:
    child = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=120, check=False)
    assert child.returncode == 0, child.stderr
    return child.stdout.strip()


def heavy_after(program: str) -> list[str]:
    """Which of the heavy packages a fresh interpreter has loaded after running a program."""
    report = f"\nimport sys; sys.stdout.write(' '.join(p for p in {HEAVY!r} if p in sys.modules))"
    return run(program + report).split()


@pytest.mark.parametrize("program", ["import zbuf_occlude", LIST_METHODS, ASK_WHAT_IS_MISSING, SAMPLE])
def test_nothing_heavy_is_loaded(program: str) -> None:
    assert heavy_after(program) == []


def test_this_test_can_fail() -> None:
    assert heavy_after("import zbuf_occlude, zbuf_occlude.gl.context") == ["moderngl"]


@pytest.mark.parametrize("program", ["import zbuf_occlude", LIST_METHODS, SAMPLE])
def test_nothing_heavy_is_needed(program: str) -> None:
    run(BLOCKED + program)


def test_blocking_blocks() -> None:
    found = run(BLOCKED + "try:\n    import moderngl\nexcept ModuleNotFoundError as e:\n    sys.stdout.write(e.name)")
    assert found == "moderngl"
