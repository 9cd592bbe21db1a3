"""Kernels with threads: all by one mechanism, with the same answers in a process forked from one that has used them."""

import os
import re
import subprocess
import sys
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

import zbuf_occlude as zo
from tests.scenes import sphere
from zbuf_occlude.jit import pool

FORK = """
import multiprocessing, sys
from tests.jit.test_pool import answer
from zbuf_occlude.jit import pool
for method in sys.argv[1:]:
    pool._pool = None
    before = answer(method)
    assert pool._pool is not None, method
    with multiprocessing.get_context("fork").Pool(1) as process:
        after = process.apply_async(answer, [method]).get(timeout=240)
    assert (before == after).all(), method
"""


def answer(method: str) -> np.ndarray:
    mesh = sphere(12)
    points = zo.sample_surface(mesh, n_points=500, seed=0)
    with zo.prepare(mesh, method) as occluder:
        mask = occluder.visible(points, zo.views.paper100().eyes[:9])
    assert 0.2 < mask.mean() < 0.5
    return mask


def test_a_fork_of_a_process_that_has_used_threads_answers_the_same() -> None:
    root, methods = Path(__file__).parents[2], ["exact", "oracle", "exact_hsr", "occupancy_grid"]
    environment = {**os.environ, "NUMBA_NUM_THREADS": "2"}
    child = subprocess.run(
        [sys.executable, "-c", FORK, *methods], cwd=root, env=environment, capture_output=True, text=True, timeout=300
    )
    assert child.returncode == 0, child.stderr


def child(program: str) -> str:
    root = Path(__file__).parents[2]
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "4"}
    line = [
        sys.executable,
        "-c",
        f"from zbuf_occlude.jit import pool\nfrom tests.jit.test_pool import answer\n{program}",
    ]
    ended = subprocess.run(line, cwd=root, env=environment, capture_output=True, text=True, timeout=300)
    assert ended.returncode == 0, ended.stderr
    return ended.stdout


def test_the_number_of_threads_of_others_is_theirs() -> None:
    """numba, asked for its number first, starts threads of OpenMP's and gives torch as many as there are cores."""
    pytest.importorskip("torch", reason="torch is not installed: pip install 'zbuf-occlude[learn]'")
    said = child("import torch\nanswer('exact'), answer('oracle')\nprint(pool.n_threads(), torch.get_num_threads())")
    assert said == "4 1\n"


def test_who_says_how_many_threads_is_heeded() -> None:
    program = "import numba\nnumba.set_num_threads({numba})\n{ours}\nprint(pool.n_threads())"
    assert child(program.format(numba=3, ours="")) == "3\n"
    assert child(program.format(numba=3, ours="pool.use_threads(2)")) == "2\n"
    assert child(program.format(numba=3, ours="pool.use_threads(4)")) == "3\n"
    assert child("pool.use_threads(2)\nprint(pool.n_threads())") == "2\n"


def test_numbas_own_threads_are_used_nowhere() -> None:
    """They wait actively, and GNU OpenMP's end a process that was forked from one that had used them."""
    package = Path(zo.__file__).parent
    for path in package.rglob("*.py"):
        assert not re.search(r"\bprange\b|parallel=True", path.read_text()), path


@pytest.mark.parametrize(("n", "size"), [(0, 4), (1, 4), (4, 4), (10, 4), (3, 1)])
def test_blocks_are_taken_until_none_is_left(n: int, size: int) -> None:
    tasks, taken = np.zeros(1, dtype=np.int64), []
    for _ in range(pool.n_blocks(n, size) + 2):
        first, last = pool.take_block(tasks, n, size)
        taken += range(first, last)
    assert taken == list(range(n))


@pytest.mark.parametrize(("n", "size"), [(0, 4), (1, 4), (4, 4), (10, 4), (23, 3)])
@pytest.mark.parametrize("turns", ["000000000", "111111111", "010101010", "011100101"])
def test_blocks_from_both_ends_are_all_blocks_once(n: int, size: int, turns: str) -> None:
    tasks, taken = np.zeros(pool.N_COUNTERS, dtype=np.int64), ([], [])
    for end in map(int, turns):
        first, last = pool.take_block_from(tasks, end, n, size)
        assert first % size == 0 or first == last
        taken[end].extend(range(first, last))
    front, back = taken
    assert sorted(front + back) == list(range(n))
    assert front == list(range(len(front)))  # so threads meet once


def test_threads_take_from_either_end_in_turns() -> None:
    tasks = np.zeros(pool.N_COUNTERS, dtype=np.int64)
    assert [pool.take_end(tasks) for _ in range(4)] == [0, 1, 0, 1]


def test_two_threads_ask_one_occluder_and_two_at_the_same_time() -> None:
    mesh = sphere(24)
    points, eyes = zo.sample_surface(mesh, n_points=5000, seed=0), zo.views.paper100().eyes[:40]
    with zo.prepare(mesh, "exact") as one, zo.prepare(sphere(24), "exact") as other, ThreadPoolExecutor(4) as four:
        expected = one.visible(points, eyes)
        asked = [four.submit(occluder.visible, points, eyes) for occluder in (one, other, one, other) for _ in range(3)]
        assert all(np.array_equal(answer.result(), expected) for answer in asked)


def test_a_helper_that_never_begins_is_not_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    class Busy:
        def submit(self, *_: object) -> Future[None]:
            return Future()  # pending for ever

    monkeypatch.setattr(pool, "_helpers", Busy)
    monkeypatch.setattr(pool, "n_threads", lambda: 8)
    assert answer("exact").any()
