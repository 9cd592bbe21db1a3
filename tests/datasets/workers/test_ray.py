"""The Ray engine: ray_cluster.py's tests, run in a process of their own as it says there; and Ray that is missing."""

import subprocess
import sys
from functools import partial
from importlib.util import find_spec
from pathlib import Path

import pytest

from tests.datasets.workers.test_local import AMPLE, ball, plan_of
from zbuf_occlude import UnavailableError
from zbuf_occlude.datasets.generate import GenerateTask
from zbuf_occlude.datasets.workers import ray as engine

ROOT, CLUSTER = Path(__file__).parents[3], Path(__file__).with_name("ray_cluster.py")


@pytest.mark.long
@pytest.mark.skipif(find_spec("ray") is None, reason="the extra ray is not installed")
def test_on_a_cluster(tmp_path: Path) -> None:
    """Its output goes to a file, for Ray's servers hold a pipe for minutes."""
    command = [sys.executable, "-m", "pytest", "-n", "0", "-vv", "-p", "no:cacheprovider", str(CLUSTER)]
    with (tmp_path / "said.txt").open("w") as file:
        subprocess.run(command, cwd=ROOT, stdout=file, stderr=subprocess.STDOUT, timeout=500, check=False)
    said = (tmp_path / "said.txt").read_text()
    assert "= 3 passed in " in said, said


def test_the_extra_is_named_when_ray_is_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "ray", None)
    run = partial(engine.run_ray, GenerateTask(plan_of(ball), tmp_path), [0], lambda *_: (), n_workers=1, limits=AMPLE)
    with pytest.raises(UnavailableError, match=r"pip install 'zbuf-occlude\[ray\]'"):
        run()
