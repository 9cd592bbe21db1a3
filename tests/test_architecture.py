"""The house: imports keep the contracts of pyproject.toml, and no file is too long."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
LINT = "from importlinter.cli import lint_imports_command; lint_imports_command()"
BREACHES = {
    # a line of each breaks one contract
    "base/arrays": "def late():\n    import zbuf_occlude.geometry.mesh",
    "base/errors": "import zbuf_occlude.base.documents",
    "datasets/plan": "from zbuf_occlude.visibility.methods.exact import prepare",
    "engines/exact/bvh": "import zbuf_occlude.engines.warp",
    "engines/object_space/planes": "import zbuf_occlude.geometry.predicates",
    "geometry/mesh": "from zbuf_occlude import Mesh",
    "sensors/scenes/scene": "import zbuf_occlude.sensors.sensor",
    "studies/compare/cases": "import zbuf_occlude.studies.learn.data",
    "visibility/methods/embree": "from zbuf_occlude.visibility import METHODS",
    "visibility/methods/exact": "import zbuf_occlude.visibility.methods.embree",
    "visibility/methods/exact_gl": "import moderngl",
}


def lint(folder: Path) -> str:
    """Return what import-linter says of the package in a folder, by the contracts there."""
    line = [sys.executable, "-c", LINT, "--no-cache", "--no-logo"]
    done = subprocess.run(line, cwd=folder, capture_output=True, text=True, check=False)
    return done.stdout + done.stderr


def test_imports_keep_the_contracts() -> None:
    said = lint(ROOT)
    assert re.search(r"Contracts: \d+ kept, 0 broken\.", said), said


def test_every_contract_can_be_broken(tmp_path: Path) -> None:
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    shutil.copytree(ROOT / "zbuf_occlude", tmp_path / "zbuf_occlude", ignore=shutil.ignore_patterns("__pycache__"))
    for module, breach in BREACHES.items():
        with (tmp_path / "zbuf_occlude" / f"{module}.py").open("a") as file:
            file.write(f"\n{breach}\n")
    said = lint(tmp_path)
    assert f"Contracts: 0 kept, {len(BREACHES)} broken." in said, said


@pytest.mark.parametrize("folder", ["zbuf_occlude", "tests", "benchmarks"])
def test_a_file_is_one_thing(folder: str) -> None:
    lines = {path: len(path.read_text().splitlines()) for path in (ROOT / folder).rglob("*.py")}
    assert {path: n_lines for path, n_lines in lines.items() if n_lines > 800} == {}
