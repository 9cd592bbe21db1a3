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

from tests.dataset.shards import make_shards
from tests.workers.test_local import AMPLE, ball, contents, failures, plan_of
from tests.workers.test_merge import collection, files
from zbuf_occlude import UnavailableError
from zbuf_occlude.dataset.claim import claim
from zbuf_occlude.dataset.generate import generate, merge
from zbuf_occlude.dataset.jobs import Making
from zbuf_occlude.dataset.parts import n_parts
from zbuf_occlude.dataset.plan import Plan, Recipe
from zbuf_occlude.dataset.verify import verify
from zbuf_occlude.workers import ray as engine


def none(job: int, result: object) -> tuple[int, ...]:
    """Nothing follows."""
    return ()


@pytest.fixture(scope="module", autouse=True)
def importable_in_actors() -> Iterator[None]:
    """The plan's load functions are in this folder's modules; actors must find them."""
    root = str(Path(__file__).parents[2])
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


def test_a_cluster_is_started_where_none_is_named(tmp_path: Path) -> None:
    plan, finished = plan_of(ball), list[int]()

    def done(shard: int, result: object) -> tuple[int, ...]:
        finished.append(shard)
        return ()

    engine.run_jobs(Making(plan, tmp_path, False), [0], done, n_workers=1, limits=AMPLE)
    assert not ray.is_initialized()
    assert finished == [0]
    assert failures(plan, tmp_path) == {}


def test_files_are_written_and_read_by_a_cluster(tmp_path: Path, nodes: Nodes) -> None:
    plan = Plan(collection(50), Recipe(method="oracle", views="fibonacci:250", n_points=32, sample_size=2))
    generate(plan, tmp_path / "whole")
    out, parts = tmp_path / "out", list[int]()
    claim(plan, out)
    make_shards(plan, out)
    run = partial(engine.run_jobs, n_workers=2, limits=AMPLE, address=nodes.cluster.address)
    manifest = merge(plan, out, run=run, progress=parts.append)
    assert not ray.is_initialized()
    assert len(parts) == n_parts(plan) == 7
    assert manifest["counts"]["clouds"] == plan.n_clouds
    assert files(out) == files(tmp_path / "whole")
    assert verify(out, None, run=run).faults == []


def test_two_nodes_one_killed_in_mid_run(tmp_path: Path, nodes: Nodes) -> None:
    plan = plan_of(*[ball] * 40)
    out, alone = tmp_path / "out", tmp_path / "alone"
    out.mkdir()
    alone.mkdir()
    finished: list[tuple[int, bool]] = []
    killed = threading.Event()

    def done(shard: int, result: object) -> tuple[int, ...]:
        finished.append((shard, killed.is_set()))
        if len(finished) == 6:
            nodes.cluster.remove_node(nodes.second, allow_graceful=False)
            killed.set()
        return ()

    try:
        ray.init(address=nodes.cluster.address, log_to_driver=False)
        assert len([node for node in ray.nodes() if node["Alive"]]) == 2
        engine.run_jobs(Making(plan, out, False), list(range(len(plan.shards))), done, n_workers=2, limits=AMPLE)
        deadline = time.monotonic() + 60
        while sum(node["Alive"] for node in ray.nodes()) != 1:
            assert time.monotonic() < deadline, "the killed node is still counted as alive"
            threading.Event().wait(0.1)
    finally:
        ray.shutdown()
    assert sorted(shard for shard, _ in finished) == list(range(len(plan.shards)))
    assert any(after for _, after in finished), "the node was killed after the run"
    assert failures(plan, out) == {}
    make_shards(plan, alone)
    assert contents(plan, out) == contents(plan, alone)


def test_no_cluster_at_the_address(tmp_path: Path) -> None:
    with pytest.raises(UnavailableError, match=r"a Ray cluster must answer at 127\.0\.0\.1:1: .*refused"):
        engine.run_jobs(
            Making(plan_of(ball), tmp_path, False), [0], none, n_workers=1, limits=AMPLE, address="127.0.0.1:1"
        )
    assert not ray.is_initialized()
