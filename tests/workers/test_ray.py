"""The Ray engine: ray_cluster.py's tests, run in a process of their own as it says there; and Ray that is missing."""

import subprocess
import sys
from functools import partial
from importlib.util import find_spec
from pathlib import Path

import pytest

from tests.workers.test_local import AMPLE, ball, plan_of
from zbuf_occlude import UnavailableError
from zbuf_occlude.dataset.generate import Making
from zbuf_occlude.workers import ray as engine

ROOT, CLUSTER = Path(__file__).parents[2], Path(__file__).with_name("ray_cluster.py")
TESTS = (
    "test_no_cluster_at_the_address",
    "test_a_cluster_is_started_where_none_is_named",
    "test_files_are_written_and_verified_by_a_cluster",
    "test_two_nodes_one_killed_in_mid_run",
)


@pytest.fixture(scope="module")
def outcome(tmp_path_factory: pytest.TempPathFactory) -> str:
    """What pytest says of them, all run in one process; to a file, for Ray's servers hold a pipe for minutes."""
    if find_spec("ray") is None:
        pytest.skip("the extra ray is not installed")
    command = [sys.executable, "-m", "pytest", "-n", "0", "-vv", "-p", "no:cacheprovider", str(CLUSTER)]
    said = tmp_path_factory.mktemp("ray") / "said.txt"
    with said.open("w") as file:
        subprocess.run(command, cwd=ROOT, stdout=file, stderr=subprocess.STDOUT, timeout=500, check=False)
    return said.read_text()


@pytest.mark.long
@pytest.mark.parametrize("name", TESTS)
def test_on_a_cluster(outcome: str, name: str) -> None:
    assert f"{name} PASSED" in outcome, outcome


@pytest.mark.long
def test_all_of_them_were_run(outcome: str) -> None:
    assert f"{len(TESTS)} passed in " in outcome, outcome


def test_the_extra_is_named_when_ray_is_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "ray", None)
    run = partial(engine.run_ray, Making(plan_of(ball), tmp_path, False), [0], lambda *_: (), n_workers=1, limits=AMPLE)
    with pytest.raises(UnavailableError, match=r"pip install 'zbuf-occlude\[ray\]'"):
        run()
