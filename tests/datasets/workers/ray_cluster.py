"""The Ray engine on a real cluster of two nodes on this machine, one of which is killed in mid-run.

Run by test_ray.py, in a process that ends with it: one that has used Ray keeps Ray's handler of forks, which reads the
stack of a thread that has ended, so that children forked later (those of PyTorch's loaders, say) die of it.
"""

import os
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import pytest
import ray

from tests.datasets.test_generate import collection, files
from tests.datasets.workers.test_local import AMPLE, ball, plan_of
from zbuf_occlude import UnavailableError
from zbuf_occlude.datasets.generate import GenerateTask, generate
from zbuf_occlude.datasets.plan import DatasetConfig, Plan
from zbuf_occlude.datasets.verify import verify
from zbuf_occlude.datasets.workers import ray as engine


def none(job: object, result: object) -> tuple[int, ...]:
    """Nothing follows."""
    return ()


@pytest.fixture(scope="module", autouse=True)
def importable_in_actors() -> Iterator[None]:
    """The plan's load functions are in this folder's modules; actors must find them."""
    root = str(Path(__file__).parents[3])
    with pytest.MonkeyPatch.context() as patched:
        patched.setenv("PYTHONPATH", os.pathsep.join([root, os.environ.get("PYTHONPATH", "")]))
        patched.setenv("RAY_USAGE_STATS_ENABLED", "0")
        yield


@dataclass
class Nodes:
    """A running cluster, and its second node."""

    cluster: Any
    second: Any


@pytest.fixture(scope="module")
def nodes(importable_in_actors: None) -> Iterator[Nodes]:
    """Two nodes of one CPU, started once: that takes seven seconds. A lost one is missed after two, not fifteen."""
    from ray.cluster_utils import Cluster

    patience = {"health_check_period_ms": 500, "health_check_failure_threshold": 3}
    cluster = Cluster(
        initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False, "_system_config": patience}
    )
    try:
        yield Nodes(cluster, cluster.add_node(num_cpus=1))
    finally:
        cluster.shutdown()


def test_files_are_written_and_verified_by_a_cluster(tmp_path: Path, nodes: Nodes) -> None:
    plan = Plan(collection(50), DatasetConfig(method="oracle", views="fibonacci:250", n_points=32, sample_size=2))
    generate(plan, tmp_path / "whole")
    run = partial(engine.run_ray, n_workers=2, limits=AMPLE, address=nodes.cluster.address)
    manifest = generate(plan, tmp_path / "out", run=run)
    assert not ray.is_initialized()
    assert manifest["counts"]["clouds"] == plan.n_clouds
    assert files(tmp_path / "out") == files(tmp_path / "whole")
    assert verify(tmp_path / "out", None, run=run).faults == []


def test_two_nodes_one_killed_in_mid_run(tmp_path: Path, nodes: Nodes) -> None:
    plan, killed = plan_of(*[ball] * 40), threading.Event()
    n_after = n_made = 0

    def progress(clouds: int) -> None:
        nonlocal n_after, n_made
        n_made, n_after = n_made + 1, n_after + killed.is_set()
        if n_made == 6:
            nodes.cluster.remove_node(nodes.second, allow_graceful=False)
            killed.set()

    try:
        ray.init(address=nodes.cluster.address, log_to_driver=False)
        assert len([node for node in ray.nodes() if node["Alive"]]) == 2
        run = partial(engine.run_ray, n_workers=2, limits=AMPLE)
        assert generate(plan, tmp_path / "out", run=run, progress=progress)["failures"] == {}
        deadline = time.monotonic() + 60
        while sum(node["Alive"] for node in ray.nodes()) != 1:
            assert time.monotonic() < deadline, "the killed node is still counted as alive"
            threading.Event().wait(0.1)
    finally:
        ray.shutdown()
    assert n_after, "the node was killed after the run"
    generate(plan, tmp_path / "alone")
    assert files(tmp_path / "out") == files(tmp_path / "alone")


def test_no_cluster_at_the_address(tmp_path: Path) -> None:
    with pytest.raises(UnavailableError, match=r"a Ray cluster must answer at 127\.0\.0\.1:1: .*refused"):
        engine.run_ray(
            GenerateTask(plan_of(ball), tmp_path), [0], none, n_workers=1, limits=AMPLE, address="127.0.0.1:1"
        )
    assert not ray.is_initialized()
