"""Functions that are compiled when they are called: by Python, or by others that are compiled."""

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from types import FunctionType
from typing import Any

import numpy as np
import pytest
from numba import njit as njit_of_numba
from numba.core import entrypoints
from numba.core.caching import Cache
from numba.core.dispatcher import Dispatcher

from zbuf_occlude.jit.simd import merged
from zbuf_occlude.kernels import load_only, njit

ROOT = Path(__file__).parents[1]


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


def functions_of_modules(pattern: str) -> Iterator[Any]:
    """Yield the functions, compiled or not, of the package's modules in whose text a pattern is found."""
    for path in sorted((ROOT / "zbuf_occlude").rglob("*.py")):
        if re.search(pattern, path.read_text(encoding="utf-8")):
            module = import_module(".".join(path.relative_to(ROOT).with_suffix("").parts))
            for value in vars(module).values():
                if isinstance(python_of(value), FunctionType) and value.__module__ == module.__name__:
                    yield value


def python_of(function: Any) -> Any:
    return getattr(function, "py_func", function)


def names_of(function: Any) -> list[Any]:
    """What a function's body calls by its name."""
    function = python_of(function)
    return [function.__globals__.get(name) for name in function.__code__.co_names]


def counts_references(function: Any) -> bool:
    """Whether what is compiled counts references; without them numba knows no memory of its own."""
    return not (isinstance(function, Dispatcher) and function.targetoptions.get("_nrt") is False)


def is_merged(function: Any) -> bool:
    return not counts_references(function) and function.targetoptions.get("inline") == "always"


def test_merged_functions_have_one_caller_which_counts_no_references() -> None:
    """numba takes them in before it compiles, with their caller's options and not with theirs."""
    of_merged = [function for function in functions_of_modules(r"\bmerged\b") if is_merged(function)]
    assert {function.__name__ for function in of_merged} >= {"_search_tasks", "search_chunks"}
    names = "|".join(function.__name__ for function in of_merged)
    callers = list(functions_of_modules(rf"\b({names})\b"))
    for function in of_merged:
        mine = [caller for caller in callers if any(named is function for named in names_of(caller))]
        assert len(mine) == 1, f"{function.__name__} has {len(mine)} callers"
        assert not counts_references(mine[0]), f"{mine[0].__name__} counts references, in {function.__name__}, too"


@merged
def sum_of_rows(rows: np.ndarray) -> float:
    total = 0.0
    for i in range(len(rows)):
        row = rows[i]
        for j in range(len(row)):
            total += row[j]
    return total


def sum_of(rows: np.ndarray) -> float:
    return sum_of_rows(rows)


@pytest.mark.parametrize("counted", [False, True])
def test_what_is_merged_counts_references_where_its_caller_does(counted: bool) -> None:
    """Which is what the test above is for: each look at a row would be noted down."""
    kernel = njit_of_numba(**({} if counted else {"_nrt": False}))(sum_of)
    assert kernel(np.ones((3, 4))) == 12.0
    assert ("NRT_decref" in kernel.inspect_llvm(kernel.signatures[0])) is counted
    assert counts_references(kernel) is counted


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
        "from zbuf_occlude.geometry.cleaning import _fill_degenerate as kernel\n"
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
