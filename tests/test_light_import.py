"""Importing the package, and listing its methods, loads nothing heavy; the main job needs nothing optional."""

import ast
import sys
from pathlib import Path

import pytest

import zbuf_occlude
from tests.processes import run_program

HEAVY = (
    *("moderngl", "glcontext", "OpenGL", "pyrender", "torch", "open3d", "ray", "embreex", "matplotlib", "webdataset"),
    *("trimesh", "h5py", "PIL", "OpenEXR", "click", "tqdm", "viser", "warp"),
)
OPTIONAL = (
    *("matplotlib", "PIL", "trimesh", "OpenEXR", "pyrender", "OpenGL", "embreex", "open3d", "ray", "torch"),
    *("viser", "webdataset", "warp"),
)
"""What `pip install zbuf-occlude` without extras does not bring."""

LIST_METHODS = "import zbuf_occlude as zo; [(m.name, m.summary, m.exact, m.needs_gl, m.extra) for m in zo.METHODS]"
ASK_WHAT_IS_MISSING = "import zbuf_occlude as zo; [m.missing() for m in zo.METHODS]"
SAMPLE = (
    "import zbuf_occlude as zo; mesh = zo.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]).normalized();"
    "zo.sample_surface(mesh, n_points=10); zo.views.paper100().eyes"
)

BLOCKED = (
    "import sys\n"
    f"heavy = {OPTIONAL!r}\n"
    "class Refuse:\n"
    "    def find_spec(self, name, path=None, target=None):\n"
    "        if name.partition('.')[0] in heavy:\n"
    "            raise ModuleNotFoundError(f'No module named {name!r}', name=name)\n"
    "sys.meta_path.insert(0, Refuse())\n"
    "import importlib.util\n"
    "find = importlib.util.find_spec\n"
    "importlib.util.find_spec = lambda name, package=None: None if name in heavy else find(name, package)\n"
)


def run(program: str) -> str:
    child = run_program(program)
    assert child.returncode == 0, child.stderr
    return child.stdout.strip()


def heavy_after(program: str) -> list[str]:
    """Which of the heavy packages a fresh interpreter has loaded after running a program."""
    report = f"\nimport sys; sys.stdout.write(' '.join(p for p in {HEAVY!r} if p in sys.modules))"
    return run(program + report).split()


def test_import_loads_no_dependency_at_all() -> None:
    program = "import sys; before = set(sys.modules); import zbuf_occlude\n"
    report = "sys.stdout.write(' '.join(sorted({n.partition('.')[0] for n in set(sys.modules) - before})))"
    loaded = run(program + report).split()
    assert "zbuf_occlude" in loaded
    assert set(loaded) <= {"zbuf_occlude", *sys.stdlib_module_names}


def test_the_names_of_the_face_are_the_same_in_its_three_places() -> None:
    tree = ast.parse(Path(zbuf_occlude.__file__).read_text())
    (shown,) = [node for node in tree.body if isinstance(node, ast.If)]
    static: dict[str, tuple[str, ...]] = {}
    for node in shown.body:
        assert isinstance(node, ast.ImportFrom)
        assert node.module
        names = tuple(alias.name for alias in node.names)
        static[node.module.removeprefix("zbuf_occlude").removeprefix(".")] = names
    modules = static.pop("")
    assert static == zbuf_occlude._HOMES
    assert sorted([*modules, *(name for names in static.values() for name in names)]) == sorted(zbuf_occlude.__all__)
    for name in zbuf_occlude.__all__:
        assert getattr(zbuf_occlude, name) is not None
    assert set(zbuf_occlude.__all__) <= set(dir(zbuf_occlude))
    with pytest.raises(AttributeError, match="has no attribute 'prepared'"):
        _ = zbuf_occlude.prepared


@pytest.mark.parametrize("program", ["import zbuf_occlude", LIST_METHODS, ASK_WHAT_IS_MISSING, SAMPLE])
def test_nothing_heavy_is_loaded(program: str) -> None:
    assert heavy_after(program) == []


def test_a_command_that_has_workers_compute_leaves_numba_to_them() -> None:
    program = (
        "import sys, zbuf_occlude.cli.generate\n"
        "from zbuf_occlude.visibility import find_method\n"
        "assert 'contact' in find_method('exact').options()\n"
        "sys.stdout.write(str('numba' in sys.modules))"
    )
    assert run(program) == "False"


def test_help_loads_nothing_heavy_but_click() -> None:
    program = "import sys; sys.argv = ['zbuf-occlude', '--help']\nfrom zbuf_occlude.__main__ import main\n"
    assert heavy_after(program + "try:\n    main()\nexcept SystemExit: pass")[-1:] == ["click"]


def cli(*arguments: object) -> str:
    """A program that runs the command line in an interpreter without optional packages, and fails as it does."""
    line = ["zbuf-occlude", *map(str, arguments)]
    return f"{BLOCKED}sys.argv = {line!r}\nfrom zbuf_occlude.__main__ import main\nmain()"


def test_the_main_job_needs_nothing_optional(tmp_path: Path) -> None:
    out = tmp_path / "out"
    said = run(cli("generate", "--limit", 1, "--views", "ring:2@20", "--method", "exact", "--workers", 1, "--out", out))
    assert "picture   none: that needs Pillow, pip install 'zbuf-occlude[report]'" in said
    assert (out / "manifest.json").exists()


def test_a_command_that_draws_says_what_it_needs(tmp_path: Path) -> None:
    program = cli("figure", "fig9", "--out", tmp_path / "a.png")
    child = run_program(program)
    assert child.returncode == 1
    assert child.stderr == "error: this needs the package matplotlib; install it: pip install 'zbuf-occlude[report]'\n"


def test_this_test_can_fail() -> None:
    assert "moderngl" in heavy_after("import zbuf_occlude, zbuf_occlude.engines.gl.context")


@pytest.mark.parametrize("program", ["import zbuf_occlude", LIST_METHODS, SAMPLE])
def test_nothing_heavy_is_needed(program: str) -> None:
    run(BLOCKED + program)


def test_blocking_blocks() -> None:
    found = run(BLOCKED + "try:\n    import pyrender\nexcept ModuleNotFoundError as e:\n    sys.stdout.write(e.name)")
    assert found == "pyrender"
