"""Fixtures of the whole suite: the one OpenGL context of the test process; and skips that must not happen."""

import os
from collections.abc import Callable, Generator, Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings

from zbuf_occlude.errors import GlError
from zbuf_occlude.gl.context import ENVIRONMENT, GlContext

GL = pytest.StashKey[GlContext]()

settings.register_profile("unhurried", settings(), deadline=None)  # a busy machine is no failure
settings.load_profile("unhurried")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """A test that asks for the fixture `gl` has the marker `gl`."""
    for item in items:
        if "gl" in getattr(item, "fixturenames", ()):
            item.add_marker(pytest.mark.gl)


NO_SKIP = "ZBUF_OCCLUDE_NO_SKIP"
"""With this variable set, as in continuous integration, a test that is skipped for lack of software fails."""
FINE = (
    "ZBUF_OCCLUDE_DATA",
    "root may read everything",
    "this machine may have a GPU",
    "this machine may not make",
    "no CUDA device here",
)
"""A reason that holds one of these is fine there too: data that may not be handed on, facts of the machine."""


def _refused(report: pytest.TestReport | pytest.CollectReport) -> None:
    if not (os.environ.get(NO_SKIP) and report.skipped and isinstance(report.longrepr, tuple)):
        return
    reason = str(report.longrepr[2])
    if not any(words in reason for words in FINE):
        report.outcome = "failed"
        report.longrepr = f"nothing may be skipped here ({NO_SKIP} is set), but this was: {reason}"


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport() -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Turn a test's skip into a failure where skips are refused."""
    report = yield
    _refused(report)
    return report


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report() -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
    """Turn a whole module's skip into a failure where skips are refused."""
    report = yield
    _refused(report)
    return report


@pytest.fixture(scope="session")
def gl(request: pytest.FixtureRequest) -> Iterator[GlContext]:
    """The session's only GL context, of the backend that ZBUF_OCCLUDE_GL names or the first that works.

    Skips, with the reason, only when no backend was named and none works: a named one must work.
    """
    try:
        context = GlContext.open()
    except GlError as error:
        if os.environ.get(ENVIRONMENT):
            raise
        pytest.skip(f"no OpenGL here: {error}")
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
