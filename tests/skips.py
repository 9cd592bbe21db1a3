"""Hooks of pytest, used by conftest.py: what is not run, why, and how it is run once what it needs is there."""

import os
from collections.abc import Generator
from typing import Any

import pytest

from tests.needs import need

LEFT_OUT = pytest.StashKey[list[str]]()
SKIPPED = pytest.StashKey[set[str]]()
LAST = "zbuf_occlude/skipped"
"""Where pytest's cache keeps the ids of the tests and files that the last run skipped."""

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


def pytest_addoption(parser: pytest.Parser) -> None:
    """Take the option for what was skipped."""
    parser.addoption(
        "--skipped", action="store_true", help="run what the last run skipped: after something was installed"
    )


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Keep what was skipped, where only that is asked for; a file that was skipped is all of its tests."""
    if not config.getoption("skipped"):
        return
    if (cache := getattr(config, "cache", None)) is None:
        raise pytest.UsageError("--skipped must have pytest's cache; it is off. Leave out -p no:cacheprovider.")
    last = set(cache.get(LAST, []))
    kept = [item for item in items if item.nodeid in last or item.nodeid.partition("::")[0] in last]
    config.hook.pytest_deselected(items=[item for item in items if item not in kept])
    items[:] = kept


def pytest_deselected(items: list[pytest.Item]) -> None:
    """Remember the long tests that are not run, for the summary."""
    for item in items:
        if item.get_closest_marker("long"):
            item.config.stash.setdefault(LEFT_OUT, []).append(item.nodeid)


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip, before its fixtures are made, a test whose marker `needs` names something that cannot be loaded."""
    for marker in item.iter_markers("needs"):
        need(*marker.args)


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Keep what was skipped; a process of pytest-xdist hands on what was left out instead, for the summary."""
    config = session.config
    if hasattr(config, "workeroutput"):
        config.workeroutput["left out"] = config.stash.get(LEFT_OUT, [])
    elif cache := getattr(config, "cache", None):  # not there with -p no:cacheprovider
        cache.set(LAST, sorted(config.stash.get(SKIPPED, set())))


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node: Any) -> None:
    """Take that from there; each process has collected the same."""
    node.config.stash[LEFT_OUT] = getattr(node, "workeroutput", {}).get("left out", [])


def pytest_terminal_summary(terminalreporter: Any, config: pytest.Config) -> None:
    """Say what was left out, besides what was skipped."""
    if names := config.stash.get(LEFT_OUT, []):
        terminalreporter.write_line(f"LEFT OUT [{len(names)}] long; .ci/run has them: python -m pytest -m long")
        for name in names:
            terminalreporter.write_line(f"  {name}")


class Skipped:
    """Remembers what is skipped, in the process that hears of all tests."""

    def __init__(self, config: pytest.Config) -> None:
        self._ids = config.stash.setdefault(SKIPPED, set())

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Remember a test."""
        self._note(report)

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        """Remember a whole file."""
        self._note(report)

    def _note(self, report: pytest.TestReport | pytest.CollectReport) -> None:
        if report.skipped and isinstance(report.longrepr, tuple):
            self._ids.add(report.nodeid)


def pytest_configure(config: pytest.Config) -> None:
    """Remember skips from now on."""
    config.pluginmanager.register(Skipped(config))


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
