"""Functions that are compiled when they are called: by Python, or by others that are compiled."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from numba import njit as njit_of_numba
from numba.core import entrypoints
from numba.core.caching import Cache
from numba.core.dispatcher import Dispatcher

from zbuf_occlude.kernels import load_only, njit


@njit(inline="always")
def twice(number):
    """Two of it."""
    return number + number


@njit()
def four_times(number):
    return twice(twice(number))


@njit_of_numba
def eight_times(number):
    return twice(four_times(number))


def test_kernels_call_kernels_and_numbas_own_call_them() -> None:
    assert eight_times(3) == 24
    assert four_times(3.5) == 14.0
    assert len(four_times.signatures) == 2  # one for whole numbers, compiled with `eight_times`, one for others


def test_a_kernel_is_compiled_with_its_options_and_keeps_its_words() -> None:
    assert isinstance(twice._compiled, Dispatcher)
    assert twice.targetoptions["inline"] == "always"
    assert (twice.__name__, twice.__doc__) == ("twice", "Two of it.")


def test_scipy_is_hidden_within_a_block_and_no_longer() -> None:
    program = (
        "from zbuf_occlude.kernels import without_scipy\n"
        "import sys\n"
        "with without_scipy():\n"
        "    import numba\n"
        "    assert numba.njit(lambda a: a.sum())(numba.np.numpy_support.np.ones(3)) == 3.0\n"
        "    try: import scipy\n"
        "    except ModuleNotFoundError: sys.stdout.write('hidden')\n"
        "assert 'scipy' not in sys.modules\n"
        "import collections as known\n"
        "sys.modules['scipy'] = known\n"
        "with without_scipy(): assert sys.modules['scipy'] is known, 'what somebody uses stays'\n"
        "assert sys.modules['scipy'] is known"
    )
    child = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert (child.stdout, child.returncode) == ("hidden", 0), child.stderr


def test_what_is_not_found_is_compiled_after_load_only_too(tmp_path: Path) -> None:
    """In a first process it is compiled, in a second it is found, without what compiling needs."""
    program = (
        "import sys, numba, numpy as np\n"
        "from zbuf_occlude.kernels import load_only\n"
        "load_only()\n"
        "from zbuf_occlude.cleaning import _fill_degenerate as kernel\n"
        "kernel(np.eye(3), np.array([[0, 1, 2]], np.int32), 0.0, np.empty(1, bool))\n"
        "dispatcher = kernel._compiled\n"
        "found = sum(dispatcher.stats.cache_hits.values())\n"
        "sys.stdout.write(f'{found} {\"numba.np.npyimpl\" in sys.modules}')\n"
    )
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    said = []
    for _ in range(2):
        child = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True)
        assert child.returncode == 0, child.stderr
        said.append(child.stdout)
    assert said == ["0 True", "1 False"]


def test_a_numba_that_is_made_otherwise_loads_as_ever(monkeypatch: pytest.MonkeyPatch) -> None:
    before, was_initialized = Cache.load_overload, entrypoints._already_initialized
    monkeypatch.delattr(Cache, "_load_overload")
    load_only()
    assert Cache.load_overload is before
    assert entrypoints._already_initialized is was_initialized
