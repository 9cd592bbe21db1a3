"""Kernels with threads: all by one mechanism, with the same answers in a process forked from one that has used them."""

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

import zbuf_occlude as zo
from tests.scenes import sphere
from zbuf_occlude.base.jit import threads

FORK = """
import multiprocessing, sys, threading
from tests.base.jit.test_threads import answer
for method in sys.argv[1:]:
    before = answer(method)
    assert threading.active_count() > 1, "threads were used"
    with multiprocessing.get_context("fork").Pool(1) as process:
        after = process.apply_async(answer, [method]).get(timeout=240)
    assert (before == after).all(), method
"""


def answer(method: str) -> np.ndarray:
    mesh = sphere(12)
    points = zo.sample_surface(mesh, n_points=1200, seed=0)  # x 9 eyes: enough for threads to wake
    with zo.prepare(mesh, method) as occluder:
        mask = occluder.visible(points, zo.views.paper100().eyes[:9])
    assert 0.2 < mask.mean() < 0.5
    return mask


def run(program: str, *arguments: str, **environment: str) -> str:
    child = subprocess.run(
        [sys.executable, "-c", program, *arguments],
        cwd=Path(__file__).parents[3],
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert child.returncode == 0, child.stderr
    return child.stdout


def test_a_fork_of_a_process_that_has_used_threads_answers_the_same() -> None:
    run(FORK, "exact", "oracle", "exact_hsr", "occupancy_grid", NUMBA_NUM_THREADS="2")


def test_the_number_of_threads_is_the_callers_and_that_of_others_is_theirs() -> None:
    """numba, asked for its number first, starts threads of OpenMP's and gives torch as many as there are cores."""
    pytest.importorskip("torch", reason="torch is not installed: pip install 'zbuf-occlude[learn]'")
    program = (
        "import torch\nfrom tests.base.jit.test_threads import answer\nfrom zbuf_occlude.base.jit.threads import *\n"
        "answer('exact'), answer('oracle')\nprint(n_threads(), torch.get_num_threads())\n"
        "use_threads(2)\nprint(n_threads())\n"
        "use_threads(9)\nprint(n_threads())\n"
    )
    assert run(program, OMP_NUM_THREADS="1", NUMBA_NUM_THREADS="4").split() == ["4", "1", "2", "4"]


@pytest.mark.parametrize(("n", "size"), [(0, 4), (1, 4), (4, 4), (10, 4), (3, 1)])
def test_blocks_are_taken_until_none_is_left(n: int, size: int) -> None:
    tasks, taken = np.zeros(1, dtype=np.int64), []
    for _ in range(threads.n_blocks(n, size) + 2):
        first, last = threads.take_block(tasks, n, size)
        taken += range(first, last)
    assert taken == list(range(n))


@pytest.mark.parametrize(("n", "size"), [(0, 4), (1, 4), (4, 4), (10, 4), (23, 3)])
@pytest.mark.parametrize("turns", ["000000000", "111111111", "010101010", "011100101"])
def test_blocks_from_both_ends_are_all_blocks_once(n: int, size: int, turns: str) -> None:
    tasks, taken = np.zeros(threads.N_COUNTERS, dtype=np.int64), ([], [])
    for end in map(int, turns):
        first, last = threads.take_block_from(tasks, end, n, size)
        assert first % size == 0 or first == last
        taken[end].extend(range(first, last))
    front, back = taken
    assert sorted(front + back) == list(range(n))
    assert front == list(range(len(front)))  # so threads meet once


def test_two_threads_ask_one_occluder_and_two_at_the_same_time() -> None:
    mesh = sphere(24)
    points, eyes = zo.sample_surface(mesh, n_points=5000, seed=0), zo.views.paper100().eyes[:40]
    with zo.prepare(mesh, "exact") as one, zo.prepare(sphere(24), "exact") as other, ThreadPoolExecutor(4) as four:
        expected = one.visible(points, eyes)
        asked = [four.submit(occluder.visible, points, eyes) for occluder in (one, other, one, other) for _ in range(3)]
        assert all(np.array_equal(answer.result(), expected) for answer in asked)
