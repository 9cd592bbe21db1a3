"""The commands in the documents and the help are accepted."""

import re
from pathlib import Path

import pytest

from tests.cli.conftest import Run, write_off
from tests.scenes import box

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")), ROOT / "zbuf_occlude" / "cli" / "generate.py"]
NOT_HERE = re.compile(r"--labels|--engine|--shard|scene\.json|\.zip|--preset|OUT|ARGUMENTS")
"""Commands that need other files or a cluster, or have tests of their own."""


def recipes() -> list[str]:
    """Commands `generate` in the pages with a collection or the built-in shapes."""
    lines = [line.split(" #")[0].strip() for page in PAGES for line in page.read_text().splitlines()]
    found = {line for line in lines if line.startswith("zbuf-occlude generate ")}
    return sorted(line for line in found if not NOT_HERE.search(line))


def test_there_are_recipes() -> None:
    assert len(recipes()) >= 6


@pytest.mark.parametrize(
    "recipe", [pytest.param(line, marks=[pytest.mark.needs("open3d")] * ("voxels" in line)) for line in recipes()]
)
def test_a_recipe_is_accepted(run: Run, tmp_path: Path, recipe: str) -> None:
    """The folder in the command is replaced by one of two classes; the first two meshes are used; files are brief."""
    words = recipe.split()[2:]
    if named := re.search(r"--config (\S+)", recipe):
        (tmp_path / named[1]).parent.mkdir(exist_ok=True)
        (tmp_path / named[1]).write_text('{"fingerprint": "0", "command": {"views": "ring:2@20"}}')
    if not words[0].startswith("-"):
        for label in ("chair", "airplane"):
            write_off(tmp_path / "meshes" / label / "train" / "one.off", box().vertices, box().faces)
        words[0] = "meshes"
    if re.search("--format (frames|bop|pairs|kitti)|--sensor", recipe):  # a view takes a second; the last of two counts
        words += ["--views", "ring:2@20"]
    run(f"generate {' '.join(words)} --out out --limit 2 --dry-run")
