"""The examples run as they stand, and do what they say."""

import json
import runpy
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from zbuf_occlude import METHODS
from zbuf_occlude.meshes.load import load_cloud

EXAMPLES = Path(__file__).parents[2] / "examples"
MIN_LINES, MAX_LINES = 20, 60
"""Lines of a script that is short enough to be copied."""


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capfd: pytest.CaptureFixture[str]):
    """Return a function that runs an example in an empty folder and returns what it says."""
    monkeypatch.chdir(tmp_path)

    def call(name: str, *arguments: str) -> str:
        monkeypatch.setattr("sys.argv", [name, *arguments])
        runpy.run_path(str(EXAMPLES / name), run_name="__main__")
        return capfd.readouterr().out

    return call


def test_one_cloud(run, tmp_path: Path) -> None:
    said = run("one_cloud.py")
    cloud = load_cloud(tmp_path / "cloud.ply")
    assert cloud is not None
    assert said == f"{len(cloud)} of 20000 points of chair_0000 are visible\n"
    assert (tmp_path / "picture.png").stat().st_size > 10_000


def test_dataset_and_training(run, tmp_path: Path) -> None:
    pytest.importorskip("torch", reason="torch is not installed: pip install 'zbuf-occlude[learn]'")
    said = run("dataset_and_training.py", "--limit", "24", "--workers", "1")
    losses = [float(line.split("loss ")[1].split(",")[0]) for line in said.splitlines() if "loss" in line]
    assert len(losses) == 4
    assert losses[-1] < losses[0]


@pytest.mark.parametrize("name", ["dataset_and_training.py", "on_the_fly.py"])
def test_what_needs_torch_says_so_in_a_line(run, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(SystemExit, match=r"needs PyTorch: pip install 'zbuf-occlude\[learn\]'"):
        run(name)
    assert "Needs PyTorch" in (EXAMPLES / name).read_text()


def test_on_the_fly(run) -> None:
    pytest.importorskip("torch", reason="torch is not installed: pip install 'zbuf-occlude[learn]'")
    assert run("on_the_fly.py").count("clouds (8, 1024, 3)") == 5


@pytest.mark.gl
def test_compare_methods(run) -> None:
    lines = run("compare_methods.py").splitlines()
    assert [line.split()[0] for line in lines[2:]] == [method.name for method in METHODS]
    wrong = {line.split()[0]: line.split()[1] for line in lines[2:]}
    assert {wrong["exact"], wrong["oracle"], wrong["exact_hsr"]} == {"0.00%"}


def test_completion_pairs(run, tmp_path: Path) -> None:
    assert run("completion_pairs.py") == "48 pairs of 8 meshes: pairs.npz\n"
    with np.load(tmp_path / "pairs.npz") as pairs:
        partial, complete = pairs["partial"], pairs["complete"]
    assert (partial.shape, complete.shape) == ((48, 1024, 3), (48, 4096, 3))
    assert np.ptp(complete, axis=1).max(axis=1) == pytest.approx(np.ones(48), abs=0.02)
    gap = np.linalg.norm(partial[0][:, None] - complete[0][None], axis=2).min(axis=1)
    assert gap.max() < 0.1, "the partial cloud lies on the complete one"


def test_your_own_method(run) -> None:
    ball, *others = run("your_own_method.py").splitlines()
    assert "shown though hidden   0.0%, hidden though visible   0.0%" in ball
    assert all("hidden   0.0%" not in line for line in others)


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.py")), ids=lambda path: path.name)
def test_an_example_can_be_copied_in_one_look(path: Path) -> None:
    lines = path.read_text(encoding="utf-8").splitlines()
    assert MIN_LINES <= len(lines) <= MAX_LINES
    assert f"python {path.name}" in lines[0]
    assert f"test_{path.stem}" in globals(), "each example has a test of what it does"


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.ipynb")), ids=lambda path: path.name)
def test_notebooks(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The cells one after the other, as a kernel runs them; of IPython they take `Image` alone."""
    pictures: list[bytes] = []
    for name, said in (("IPython", {"version_info": (9, 0)}), ("IPython.display", {"Image": pictures.append})):
        module = ModuleType(name)
        vars(module).update(said)
        monkeypatch.setitem(sys.modules, name, module)
    cells = [cell for cell in json.loads(path.read_text(encoding="utf-8"))["cells"] if cell["cell_type"] == "code"]
    assert len(cells) >= 3
    names: dict[str, object] = {}
    for cell in cells:
        exec("".join(cell["source"]), names)
    assert [picture[:4] for picture in pictures] == [b"\x89PNG"]
    assert len(pictures[0]) > 10_000, "something is drawn"
