"""Run the command line in this process, as its entry point does."""

import os
import shlex
import signal
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest

from zbuf_occlude.__main__ import main
from zbuf_occlude.base.limits import Limits
from zbuf_occlude.datasets.workers import Done, Task, run_here
from zbuf_occlude.datasets.workers.local import run_local


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder shared by the tests of a module."""
    return tmp_path_factory.mktemp("kept")


@dataclass(frozen=True)
class Outcome:
    """Result of a command."""

    out: str
    err: str


Run = Callable[..., Outcome]


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], tmp_path: Path) -> Iterator[Run]:
    """Yield a function that runs ``zbuf-occlude`` in `tmp_path`; changes of the environment are undone.

    `line` is split as by a shell, the other arguments are taken as they are. `code` must be the exit code, and standard
    error must have the words `says`.
    """
    monkeypatch.chdir(tmp_path)

    def call(line: str, *arguments: object, code: int = 0, says: str = "") -> Outcome:
        monkeypatch.setattr("sys.argv", ["zbuf-occlude", *shlex.split(line), *map(str, arguments)])
        capfd.readouterr()
        with pytest.raises(SystemExit) as leaving:
            main()
        signal.signal(signal.SIGINT, signal.default_int_handler)  # Ctrl-C ends pytest as it did before
        outcome = Outcome(*capfd.readouterr())
        assert (leaving.value.code or 0) == code, outcome
        assert says in outcome.err
        assert "Traceback" not in outcome.err
        return outcome

    with patch.dict(os.environ):
        yield call


@pytest.fixture(autouse=True)
def one_worker_is_this_process(monkeypatch: pytest.MonkeyPatch, no_pictures: None) -> None:
    """Run with `--workers 1`, which starts no process; tests of workers use two."""

    def run(task: Task, jobs: list[Any], done: Done, *, n_workers: int, limits: Limits) -> None:
        if n_workers == 1:
            run_here(task, jobs, done)
        else:
            run_local(task, jobs, done, n_workers=n_workers, limits=limits)

    monkeypatch.setattr("zbuf_occlude.cli.shared_options.run_local", run)


@pytest.fixture(autouse=True)
def brief_estimates(monkeypatch: pytest.MonkeyPatch) -> None:
    """Limit `--dry-run` to one mesh; tests/datasets/test_estimate.py tests the full estimate."""
    monkeypatch.setattr("zbuf_occlude.datasets.rehearsal.MIN_MESHES", 1)
    monkeypatch.setattr("zbuf_occlude.datasets.rehearsal.SECONDS", 0.0)


def write_off(path: Path, vertices: np.ndarray, faces: np.ndarray) -> Path:
    """Write a mesh as OFF; folders above it are created."""
    path.parent.mkdir(parents=True, exist_ok=True)
    lines = ["OFF", f"{len(vertices)} {len(faces)} 0"]
    lines += [" ".join(map(repr, map(float, v))) for v in vertices]
    lines += ["3 " + " ".join(map(str, f)) for f in faces]
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.fixture
def modelnet(tmp_path: Path) -> Path:
    """A small folder in ModelNet's layout: two classes, train and test, two objects each."""
    from trimesh.creation import box, icosphere

    root = tmp_path / "meshes"
    for number in range(2):
        for split in ("train", "test"):
            ball, brick = icosphere(subdivisions=2, radius=3 + number), box((1, 2 + number, 5))
            write_off(root / "ball" / split / f"ball_{number}.off", ball.vertices, ball.faces)
            write_off(root / "brick" / split / f"brick_{number}.off", brick.vertices, brick.faces)
    return root


@pytest.fixture
def furniture(modelnet: Path) -> Path:
    """The same meshes as chairs and tables, classes of all published lists."""
    (modelnet / "ball").rename(modelnet / "chair")
    (modelnet / "brick").rename(modelnet / "table")
    return modelnet
