"""Fixtures of the whole suite: the one OpenGL context of the test process."""

import os
from collections.abc import Iterator

import pytest

from zbuf_occlude.errors import GlError
from zbuf_occlude.gl.context import ENVIRONMENT, GlContext

GL = pytest.StashKey[GlContext]()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """A test that asks for the fixture `gl` has the marker `gl`."""
    for item in items:
        if "gl" in getattr(item, "fixturenames", ()):
            item.add_marker(pytest.mark.gl)


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
