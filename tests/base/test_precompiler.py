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
from zbuf_occlude.base import precompiler
from zbuf_occlude.base.jit.compiler import njit
from zbuf_occlude.base.precompiler import Compilation, Precompiler
from zbuf_occlude.engines.exact import bvh, leaves, rays, search

CALLS = "ZBUF_OCCLUDE_TEST_CALLS"
"""Variable of the environment with the folder in which a called function leaves a file."""
PATIENCE = 60.0


def note_process() -> None:
    """Write the number of this process."""
    Path(os.environ[CALLS], "process").write_text(str(os.getpid()))


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


@njit(cache=True)
def double(number):
    """Return twice a number."""
    return number + number


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
    kernels = search._search_views, rays._cast_blocks, rays.cast_singles, bvh._fill_blocks, leaves._divide_runs
    compiled = [set(kernel.signatures) for kernel in kernels]
    zo.occlude(box(), azimuth=30, elevation=20, n_points=500, method="exact")
    for sensor in ("vlp-16", "hdl-64e"):
        zo.scan(box(), sensor, range=3, size=1.0, method="exact")
    zo.depth_image(box(), azimuth=30, elevation=20, resolution=64, method="exact")
    with zo.prepare(box(), "exact") as occluder:
        occluder.visible(zo.sample_surface(box(), n_points=500), zo.views.fibonacci(3))
    assert [set(kernel.signatures) for kernel in kernels] == compiled


def test_the_call_is_in_another_process_which_ends(kept: Path) -> None:
    compiling = Precompiler()
    compiling.launch(Compilation(double, note_process))
    compiling.launch(Compilation(double, crash))  # one is enough
    (path,) = wait_for("process", kept)
    time.sleep(0.1)
    process = int(path.read_text())
    assert process != os.getpid()
    while Path(f"/proc/{process}/stat").read_text().split()[2] != "Z":  # it keeps no memory
        time.sleep(0.05)


def test_what_is_kept_is_not_compiled_again(tmp_path: Path) -> None:
    program = (
        "import os\n"
        "from pathlib import Path\n"
        "from tests.base import test_precompiler as here\n"
        "here.precompiler.n_cores = lambda: 2\n"
        "print(here.double.is_kept, here.double(2), here.double.is_kept)\n"
        "compiling = here.Precompiler()\n"
        "compiling.launch(here.Compilation(here.double, here.note_process))\n"
        "print(compiling._process)\n"
    )
    child = python("-c", program, NUMBA_CACHE_DIR=str(tmp_path), **{CALLS: str(tmp_path)})
    assert child.stdout.split() == ["False", "4", "True", "0"], child.stderr


@pytest.mark.parametrize("function", [crash, fail])
def test_a_call_that_fails_is_no_error(kept: Path, function: Callable[[], None]) -> None:
    Precompiler().launch(Compilation(double, function))
    wait_for("process", kept)


@pytest.mark.parametrize(
    ("owner", "name", "value"),
    [
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
    Precompiler().launch(Compilation(double, note_process))
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
