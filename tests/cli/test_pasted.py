"""The Python examples of README and quickstart run on the shapes that their commands write."""

import re
import shlex
from pathlib import Path

import pytest
import trimesh

from tests.cli.conftest import Run

ROOT = Path(__file__).parents[2]
DATASET = "generate --limit 16 --views ring:3@25 --method exact --out occluded"


@pytest.mark.parametrize("page", ["README.md", "docs/quickstart.md"])
def test_python_lines_run_as_pasted(run: Run, tmp_path: Path, page: str) -> None:
    text = (ROOT / page).read_text(encoding="utf-8")
    written = re.findall(r"zbuf-occlude (shapes \w+ --out \w+\.off)", text)
    assert written
    for line in written:
        run(line)
    if DATASET in text:
        run(f"{DATASET} --workers 1")
    names: dict[str, object] = {}
    blocks = re.findall(r"^```python\n(.*?)^```$", text, re.DOTALL | re.MULTILINE)
    assert blocks
    for block in blocks:
        exec(compile(block, page, "exec"), names)  # what a person does
    assert len(names["cloud"]) == 2048  # type: ignore[arg-type]


def test_commands_for_own_files_run_as_pasted(run: Run, tmp_path: Path) -> None:
    """A chair with y up, and a part in millimetres."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    lines = re.findall(r"^zbuf-occlude ((?:visible|scan) .*--(?:up|unit) .*?)(?: +#.*)?$", text, re.MULTILINE)
    assert len(lines) == 2
    run("shapes chair --up y --out chair.obj")
    run("shapes bottle --out part.stl")
    part = trimesh.load_mesh(tmp_path / "part.stl")
    part.apply_scale(1000.0)
    part.export(tmp_path / "part.stl")
    for line in lines:
        outcome = run(line)
        assert "warning: the mesh" not in outcome.err
        assert int(outcome.out.split()[0]) > 500
        assert (tmp_path / shlex.split(line)[-1]).is_file()
