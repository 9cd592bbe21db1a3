"""Compilation in a second process."""

import multiprocessing
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import zbuf_occlude as zo
from tests.processes import python
from tests.scenes import box
from zbuf_occlude.engines.exact import bvh, precompiler, rays, search
from zbuf_occlude.engines.exact.precompiler import Precompiler

CALLS = "ZBUF_OCCLUDE_TEST_CALLS"
"""Variable of the environment with the folder in which a called function leaves a file."""
PATIENCE = 60.0


def note_process() -> None:
    """Write the number of this process."""
    Path(os.environ[CALLS], "process").write_text(str(os.getpid()))


def do_nothing() -> None:
    """Return."""


def crash() -> None:
    """End the process without a word."""
    note_process()
    os._exit(3)


def fail() -> None:
    """Raise what a full disk raises."""
    note_process()
    raise OSError(28, "No space left on device")


def raising(**environment: str) -> None:
    """Raise what a process raises that cannot be started."""
    raise OSError(24, "Too many open files")


@pytest.fixture
def kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder for compiled code, of this test alone, on a machine of two cores."""
    monkeypatch.setenv(CALLS, str(tmp_path))
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(precompiler, "n_cores", lambda: 2)
    return tmp_path


def wait_for(pattern: str, folder: Path) -> list[Path]:
    """Wait until a file is there."""
    end = time.monotonic() + PATIENCE
    while not (found := list(folder.glob(pattern))):
        assert time.monotonic() < end, pattern
        time.sleep(0.05)
    return found


def test_questions_of_nothing_compile_for_the_arguments_of_all_others() -> None:
    for compile_it in (search.compile_search, rays.compile_first_hits, rays.compile_scattered_rays, bvh.compile_build):
        compile_it()
    kernels = search._search_views, rays._cast_blocks, rays.cast_singles, bvh._grow_nodes, bvh._fill_runs
    compiled = [set(kernel.signatures) for kernel in kernels]
    zo.occlude(box(), azimuth=30, elevation=20, n_points=500, method="exact")
    for sensor in ("vlp-16", "hdl-64e"):
        zo.scan(box(), sensor, range=3, size=1.0, method="exact")
    zo.depth_image(box(), azimuth=30, elevation=20, resolution=64, method="exact")
    with zo.prepare(box(), "exact") as occluder:
        occluder.visible(zo.sample_surface(box(), n_points=500), zo.views.fibonacci(3))
    assert [set(kernel.signatures) for kernel in kernels] == compiled


def test_the_call_is_in_another_process_and_is_noted_once_it_has_ended(kept: Path) -> None:
    compiling = Precompiler()
    compiling.launch(note_process, do_nothing)
    compiling.launch(crash)  # one is enough
    wait_for("*/note_process+do_nothing.compiled", kept)
    assert int((kept / "process").read_text()) != os.getpid()
    (kept / "process").unlink()
    Precompiler().launch(note_process, do_nothing)
    time.sleep(0.2)
    assert not (kept / "process").exists()


@pytest.mark.parametrize("function", [crash, fail])
def test_a_call_that_fails_is_no_error_and_is_not_taken_for_compiled(kept: Path, function: Callable[[], None]) -> None:
    Precompiler().launch(function)
    wait_for("process", kept)
    time.sleep(0.2)
    assert not list(kept.glob("*/*.compiled"))


@pytest.mark.parametrize(
    ("owner", "name", "value"),
    [
        (precompiler, "compiled_before", lambda name: True),
        (precompiler, "n_cores", lambda: 1),
        (sys, "executable", ""),
        (multiprocessing, "parent_process", lambda: "a coordinator"),
        (precompiler, "Child", raising),
    ],
)
def test_there_is_none_where_it_gains_nothing_or_cannot_be(
    kept: Path, monkeypatch: pytest.MonkeyPatch, owner: Any, name: str, value: object
) -> None:
    monkeypatch.setattr(owner, name, value)
    made: list[object] = []
    monkeypatch.setattr(precompiler.atexit, "register", made.append)
    Precompiler().launch(note_process)
    assert not made


@pytest.mark.long
@pytest.mark.parametrize(
    ("kernel", "call"),
    [
        ("search._search_views", "zo.occlude(mesh, azimuth=30, elevation=20, n_points=500, method='exact')"),
        ("rays._cast_blocks", "zo.scan(mesh, 'vlp-16', range=3, method='exact')"),
        ("rays.cast_singles", "zo.scan(mesh, 'hdl-64e', range=3, method='exact')"),
    ],
    ids=["points", "rays", "scattered rays"],
)
def test_with_an_empty_cache_the_kernel_is_read_from_it(tmp_path: Path, kernel: str, call: str) -> None:
    program = (
        "import zbuf_occlude as zo\n"
        "from zbuf_occlude.engines.exact import rays, search\n"
        "mesh = zo.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 1, 2], [0, 1, 3]])\n"
        f"{call}\n"
        f"stats = {kernel}.stats\n"
        "print(sum(stats.cache_hits.values()), sum(stats.cache_misses.values()))"
    )
    child = python("-c", program, NUMBA_CACHE_DIR=str(tmp_path))
    assert child.stdout.split() == (["1", "0"] if precompiler.n_cores() > 1 else ["0", "1"])
