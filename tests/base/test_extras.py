"""Optional packages that are missing, or present but broken: one line with the package, the library and what helps."""

import json
import os
from pathlib import Path
from typing import Any

import pytest

import zbuf_occlude as zo
from tests.processes import python, run_program
from zbuf_occlude.base.errors import UnavailableError
from zbuf_occlude.base.extras import importing, reason
from zbuf_occlude.datasets.plan import DatasetConfig

NO_LIBRARY = "libnowhere.so.3: cannot open shared object file: No such file or directory"
BROKEN = {
    # package: its module that fails, how, and words of the message
    "open3d": ("__init__", "import ctypes; ctypes.CDLL('libnowhere.so.3')", "library libnowhere.so.3"),
    "embreex": ("mesh_construction", f"raise ImportError({NO_LIBRARY!r})", "library libnowhere.so.3"),
    "pyrender": ("__init__", f"raise ImportError({NO_LIBRARY.replace('nowhere.so.3', 'GL.so.1')!r})", "install libgl1"),
    "warp": ("__init__", "import ctypes; ctypes.CDLL('libnowhere.so.3')", "library libnowhere.so.3"),
    "torch": ("__init__", "raise AttributeError('numpy has no such thing\\nany more')", "no such thing any more"),
    "ray": ("__init__", "import needed_by_ray", "pip install needed_by_ray"),
    "matplotlib": ("__init__", f"raise ImportError({NO_LIBRARY!r})", "library libnowhere.so.3"),
}
LIBRARIES = pytest.mark.needs("open3d", "pyrender")
"""Where those of the system that packages need are missing too, they are what is named."""
METHODS = [(m.name, m.requires) for m in zo.METHODS if m.requires]
MESH = "zo.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 1, 2], [0, 1, 3]])"


@pytest.fixture
def broken(tmp_path: Path) -> dict[str, str]:
    """An environment in which each of the packages is broken."""
    for package, (module, code, _) in BROKEN.items():
        (tmp_path / package).mkdir()
        (tmp_path / package / "__init__.py").touch()
        (tmp_path / package / f"{module}.py").write_text(code + "\n")
    paths = [str(tmp_path), str(Path(zo.__file__).parents[1])]
    return {"PYTHONPATH": os.pathsep.join(paths)}


def assert_one_line(said: str, package: str) -> None:
    assert len(said.splitlines()) == 1, said
    assert f"needs the package {package}; it is installed, and its import fails" in said
    assert BROKEN[package][2] in said


def refusals(environment: dict[str, str], programs: list[str]) -> list[str]:
    """What each of these programs is refused with, all of them in one process."""
    code = (
        "import sys, zbuf_occlude as zo\n"
        f"for program in {programs!r}:\n"
        "    try:\n"
        "        exec(program)\n"
        "    except zo.UnavailableError as error:\n"
        "        print(error)\n"
    )
    done = run_program(code, **environment)
    assert len(done.stdout.splitlines()) == len(programs), done.stdout + done.stderr
    return done.stdout.splitlines()


@LIBRARIES
def test_a_method_of_a_broken_package(broken: dict[str, str]) -> None:
    said = refusals(broken, [f"zo.prepare({MESH}, {method!r})" for method, _ in METHODS])
    for line, (_, package) in zip(said, METHODS, strict=True):
        assert_one_line(line, package)


@pytest.mark.parametrize(
    ("package", "arguments"),
    [
        pytest.param(
            "open3d",
            "visible {mesh} --azimuth 9 --elevation 9 --method hidden_point_removal --out {out}.ply",
            marks=LIBRARIES,
        ),
        ("embreex", "generate {mesh} --method embree --limit 1 --out {out}"),
        ("torch", "train {out} --out {out}"),
        ("matplotlib", "figure fig7 {mesh} --out {out}.png"),
    ],
)
def test_a_command_that_needs_a_broken_package(
    broken: dict[str, str], package: str, arguments: str, tmp_path: Path
) -> None:
    (tmp_path / "corner.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\n")
    words = arguments.format(mesh=tmp_path / "corner.obj", out=tmp_path / "out").split()
    child = python("-m", "zbuf_occlude", *words, **broken)
    assert child.returncode == 1
    errors = [line for line in child.stderr.splitlines() if line.startswith("error: ")]
    assert_one_line("\n".join(errors), package)
    assert "Traceback" not in child.stderr


@LIBRARIES
def test_doctor_tries_packages(broken: dict[str, str]) -> None:
    child = python("-m", "zbuf_occlude", "doctor", "--json", **broken)
    said = json.loads(child.stdout)["methods"]
    for method, package in METHODS:
        assert_one_line(said[method], package)
    assert said["exact"] == ""


EMPTY = [
    ("open3d", f"zo.prepare({MESH}, 'hidden_point_removal')"),
    ("open3d", f"{MESH}.to_open3d()"),
    ("open3d", f"zo.occlude({MESH}, azimuth=9, elevation=9, n_points=9).to_open3d()"),
    ("embreex", f"zo.prepare({MESH}, 'embree')"),
    ("pyrender", f"zo.prepare({MESH}, 'pyrender')"),
    ("ray", "from zbuf_occlude.datasets.workers.ray import run_ray; run_ray(0, [], 0, n_workers=1, limits=0)"),
    ("torch", "zo.torch"),
    ("torch", "from zbuf_occlude.studies.learn.models import require_torch; require_torch()"),
]


@LIBRARIES
def test_an_empty_package(tmp_path: Path) -> None:
    for package, _ in EMPTY:
        (tmp_path / package).mkdir(exist_ok=True)
        (tmp_path / package / "__init__.py").touch()
    environment = {"PYTHONPATH": os.pathsep.join([str(tmp_path), str(Path(zo.__file__).parents[1])])}
    for line, (package, _) in zip(refusals(environment, [program for _, program in EMPTY]), EMPTY, strict=True):
        assert f"needs the package {package}; it is installed, and its import fails" in line


@pytest.mark.parametrize(
    ("package", "program"),
    [
        ("torch", "import zbuf_occlude.datasets.torch"),
        ("ray", "from zbuf_occlude.datasets.workers.ray import run_ray; run_ray(0, [], 0, n_workers=1, limits=0)"),
    ],
)
def test_a_module_that_needs_a_package(broken: dict[str, str], package: str, program: str) -> None:
    assert_one_line(run_program(program, **broken).stderr.splitlines()[-1], package)
    child = run_program(f"import sys; sys.modules[{package!r}] = None; {program}", **broken)
    extra = {"torch": "learn"}.get(package, package)
    assert child.stderr.splitlines()[-1].endswith(
        f"needs the package {package}; install it: pip install 'zbuf-occlude[{extra}]'"
    )


def test_what_this_package_raises_while_another_is_imported_stays_as_it_is() -> None:
    with pytest.raises(UnavailableError, match=r"^as it is$"), importing("numpy", "it"):
        raise UnavailableError("as it is")


@pytest.mark.parametrize(
    ("said", "cure"),
    [
        ('Library "GL" not found.', "libGL.so.1 is missing; on Debian: apt-get install libgl1"),
        ('Library "Xrender" not found.', "libXrender.so.1 is missing; on Debian: apt-get install libxrender1"),
        ('Library "Xnowhere" not found.', "libXnowhere.so is missing; install it again"),
        ("libX11.so.6: cannot open shared object file", "libX11.so.6 is missing; on Debian: apt-get install libx11-6"),
        ("libno.so.7: cannot open shared object file", "libno.so.7 is missing; install it again"),
    ],
)
def test_what_is_said_of_a_missing_library_comes_with_the_command(said: str, cure: str) -> None:
    """As pyglet words it, which pyrender imports, and the loader; installing the package again would change nothing."""
    assert cure in reason("numpy", ImportError(said))


@pytest.mark.parametrize(
    ("package", "options", "extra"),
    [("PIL", {"attributes": ["colors"]}, "report")],
)
def test_recipes_name_the_extra_as_all_others_do(
    monkeypatch: pytest.MonkeyPatch, package: str, options: dict[str, Any], extra: str
) -> None:
    monkeypatch.setattr("zbuf_occlude.base.extras.find_spec", lambda name: None)
    said = rf"needs the package {package}; install it: pip install 'zbuf-occlude\[{extra}\]'"
    with pytest.raises(UnavailableError, match=said):
        DatasetConfig(**options)
