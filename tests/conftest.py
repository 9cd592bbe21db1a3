"""Fixtures of the whole suite: the one OpenGL context of the test process; the order of the files."""

import gc
import os
import shutil
import signal
import sys
import tempfile
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, settings

from tests import skips
from tests.needs import lacking, need
from zbuf_occlude.base.cores import n_cores
from zbuf_occlude.engines.gl.context import ENVIRONMENT, GlContext

GL = pytest.StashKey[GlContext]()

os.environ["OMP_NUM_THREADS"] = "1"
"""For torch and BLAS, here and in children, before they are imported: there are as many test processes as cores, and
threads of OpenMP wait actively for one that has none. torch's sums depend on their number in the last bits."""

os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False
"""Some 300 processes import the package: a quarter of a second of each where nothing keeps its modules compiled, and
asserts rewritten take each test process ten. numba's functions are kept beside them anyway."""

gc.set_threshold(50_000, 20, 20)
"""What is imported and compiled stays: a tenth of these processes' time went to looking through it for garbage."""

# a busy machine is no failure, and neither is a draw of its own: every machine tries the same examples
settings.register_profile("everywhere", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("everywhere")


FIRST = (
    "visibility/test_contract.py", "studies/paper/test_study.py", "datasets/workers/test_local.py",
    "studies/learn/test_training.py", "net/test_datasets.py", "datasets/test_generate.py",
    "visibility/test_pyrender.py", "visibility/test_exact_gl.py", "visibility/test_gl_threads.py",
    "drawing/test_viewer.py",
    "cli/test_scans_in_pairs.py", "sensors/test_scenes.py", "examples/test_examples.py",
    "studies/paper/test_figures.py", "studies/compare/test_comparison_report.py", "datasets/torch/test_occlusion.py",
    "base/jit/test_compiler.py", "visibility/test_first_hits.py", "studies/paper/test_realism.py",
    "base/test_extras.py", "cli/test_meshes_put_back.py", "studies/learn/test_networks.py",
    "visibility/test_depth_buffer.py", "datasets/test_export.py", "visibility/test_other_renderers.py",
    "cli/test_experiment.py", "datasets/test_attributes.py",
)  # fmt: skip
"""Files whose tests wait, or work for more than some five seconds: begun before the others, so that no process has a
long one left when the others are done. A file is one process's, as are its fixtures."""


SYSTEMS = os.environ.setdefault("PYTEST_DEBUG_TEMPROOT", tempfile.gettempdir())
"""The system's temporary folder, for pytest's own folders, of which it keeps three; of a suite within a test too."""
OURS = "" if os.environ.get("PYTEST_XDIST_WORKER") else tempfile.mkdtemp(prefix="zo-", dir=SYSTEMS)
"""Where libraries leave temporary files, until the end; its name is short, as Ray puts sockets there."""
if OURS:
    os.environ["TMPDIR"] = tempfile.tempdir = OURS


def pytest_addoption(pluginmanager: pytest.PytestPluginManager) -> None:
    """Add the hooks of skips.py before the command line is read, which has an option of theirs."""
    pluginmanager.register(skips)


def pytest_configure(config: pytest.Config) -> None:
    """Let interrupts be heard, and remove the temporary folder at the end."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # begun in the background; what tests interrupt must hear it
        signal.signal(signal.SIGINT, signal.default_int_handler)
    if OURS:
        config.add_cleanup(partial(shutil.rmtree, OURS, ignore_errors=True))


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Order the files, and mark: who asks for the fixture `gl` has the marker `gl`, and the other way round."""
    place = {Path(__file__).parent / name: i for i, name in enumerate(FIRST)}
    items.sort(key=lambda item: place.get(item.path, len(FIRST)))
    for item in items:
        names = getattr(item, "fixturenames", [])
        if "gl" in names:
            item.add_marker(pytest.mark.gl)
        elif item.get_closest_marker("gl"):
            item.fixturenames = ["gl", *names]  # type: ignore[attr-defined]  # a list of its own: siblings share theirs


@pytest.fixture(scope="session", autouse=True)
def no_waiting_for_the_disk() -> Iterator[None]:
    """What tests write need not outlast a power cut; so nothing waits for it here.

    A disk takes milliseconds to keep a file: most of the time of the tests of kills, without this.
    """
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(os, "fsync", lambda file: None)
        yield


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers() -> int:
    """One process more than cores, as some tests wait, for hanging workers or for another's compiling."""
    return n_cores() + 1


@pytest.fixture
def no_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Draw no contact sheets, only a file of that name: a fifth of the time of tests that finish many datasets."""

    def write(path: Path, source: object) -> bool:
        path.write_bytes(b"")
        return True

    monkeypatch.setattr("zbuf_occlude.datasets.export.write_contact_sheet", write)


@pytest.fixture(scope="session")
def gl(request: pytest.FixtureRequest) -> Iterator[GlContext]:
    """The session's only GL context, of the backend that ZBUF_OCCLUDE_GL names or the first that works.

    Skips, with the reason, only when no backend was named and none works: a named one must work.
    """
    if not os.environ.get(ENVIRONMENT) and lacking("osmesa"):
        need("egl")
    context = GlContext.open()
    request.session.stash[GL] = context
    yield context
    context.close()


@pytest.fixture(autouse=True)
def no_gl_error(request: pytest.FixtureRequest) -> Iterator[None]:
    """No test finds or leaves an OpenGL error, nor another context current than the session's."""
    context = request.session.stash.get(GL, None)
    if context is not None:
        context.make_current()
        context.check()
    yield
    context = request.session.stash.get(GL, None)
    if context is not None:
        context.make_current()
        context.check()


@pytest.fixture
def lock(monkeypatch: pytest.MonkeyPatch) -> Callable[[Path], None]:
    """Return a function that makes a folder unreadable in this process, for root too."""
    scandir = os.scandir

    def refuse_in(folder: Path) -> None:
        def scan(path: Any) -> Any:
            if path == str(folder) or path == folder:
                raise PermissionError(13, "Permission denied", str(folder))
            return scandir(path)

        monkeypatch.setattr(os, "scandir", scan)

    return refuse_in
