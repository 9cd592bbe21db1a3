"""Kernels with threads: the same answers in a process forked from one that has used them."""

import os
import subprocess
import sys
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

import zbuf_occlude as zo
from tests.scenes import sphere
from zbuf_occlude import threads

FORK = """
import multiprocessing, numba, sys
import zbuf_occlude as zo
from tests.test_threads import answer
before = answer(sys.argv[1])
layer = numba.threading_layer()
with multiprocessing.get_context("fork").Pool(1) as pool:
    after, forked = pool.apply_async(answer, [sys.argv[1], True]).get(timeout=240)
assert (before == after).all()
assert forked == (layer == "omp"), (forked, layer)
"""


def answer(method: str, with_state: bool = False) -> object:
    mesh = sphere(12)
    points = zo.sample_surface(mesh, n_points=500, seed=0)
    with zo.prepare(mesh, method) as occluder:
        mask = occluder.visible(points, zo.views.paper100().eyes[:9])
    assert 0.2 < mask.mean() < 0.5
    return (mask, threads._forked) if with_state else mask


@pytest.mark.parametrize("method", ["exact", "oracle", "exact_hsr", "occupancy_grid"])
def test_a_fork_of_a_process_that_has_used_threads_answers_the_same(method: str) -> None:
    root = Path(__file__).parents[1]
    environment = {**os.environ, "NUMBA_NUM_THREADS": "2"}
    child = subprocess.run(
        [sys.executable, "-c", FORK, method], cwd=root, env=environment, capture_output=True, text=True, timeout=300
    )
    assert child.returncode == 0, child.stderr


def test_the_twin_is_kept_apart_from_its_sibling_in_numbas_cache(monkeypatch: pytest.MonkeyPatch) -> None:
    from zbuf_occlude.visibility.oracle import _nearest

    def hits() -> np.ndarray:
        with zo.prepare(sphere(8), "oracle") as occluder:
            return occluder.first_hits([[3.0, 0.5, 0.2]], [[-1.0, -0.1, 0.0], [-1.0, 0.9, 0.0]]).face_ids

    assert _nearest.__doc__ is not None
    monkeypatch.setattr(threads, "_forked", True)
    forked = hits()
    monkeypatch.undo()
    assert np.array_equal(forked, hits())
    bases = {kernel._cache._impl.filename_base for kernel in (_nearest._parallel, _nearest._serial)}
    assert len(bases) == 2


def test_every_kernel_with_threads_has_a_twin() -> None:
    package = Path(threads.__file__).parent
    sources = {path.name: path.read_text() for path in package.rglob("*.py")}
    assert [name for name, source in sources.items() if "parallel=True" in source] == ["threads.py"]


def test_two_threads_ask_one_occluder_and_two_at_the_same_time() -> None:
    mesh = sphere(24)
    points, eyes = zo.sample_surface(mesh, n_points=5000, seed=0), zo.views.paper100().eyes[:40]
    with zo.prepare(mesh, "exact") as one, zo.prepare(sphere(24), "exact") as other, ThreadPoolExecutor(4) as pool:
        expected = one.visible(points, eyes)
        asked = [pool.submit(occluder.visible, points, eyes) for occluder in (one, other, one, other) for _ in range(3)]
        assert all(np.array_equal(answer.result(), expected) for answer in asked)


def test_a_helper_that_never_begins_is_not_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    class Busy:
        def submit(self, *_: object) -> Future[None]:
            return Future()  # pending for ever

    monkeypatch.setattr(threads, "_helpers", Busy)
    monkeypatch.setattr(threads, "n_threads", lambda: 8)
    assert np.asarray(answer("exact")).any()
