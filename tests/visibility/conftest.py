"""What the suites over the table of methods share."""

from collections.abc import Callable

import pytest

import zbuf_occlude as zo
from zbuf_occlude.visibility.interface import Method, VisibilityQuery


@pytest.fixture(scope="module")
def prepare(method: Method, request: pytest.FixtureRequest) -> Callable[..., VisibilityQuery]:
    """`zo.prepare` by a suite's fixture `method`, with the session's GL context where it needs one."""
    shared = {"gl": request.getfixturevalue("gl")} if method.needs_gl else {}
    return lambda mesh, **options: zo.prepare(mesh, method.name, **shared, **options)
