"""Threads and forks: every method that renders is right in them, or says why it cannot be asked there."""

import subprocess
import sys
import textwrap
from concurrent.futures import ThreadPoolExecutor

import pytest

import zbuf_occlude as zo
from zbuf_occlude import shapes
from zbuf_occlude.errors import GlError
from zbuf_occlude.gl.context import GlContext

MESH = shapes.make("chair", 3).normalized()
POINTS = zo.sample_surface(MESH, n_points=500, seed=1)
EYES = zo.views.fibonacci(3).eyes
OF_A_CONTEXT = ("depth_buffer", "exact_gl")


@pytest.mark.parametrize("name", OF_A_CONTEXT)
def test_another_thread_is_refused_and_the_first_goes_on(gl: GlContext, name: str) -> None:
    with zo.prepare(MESH, name, gl=gl) as occluder, ThreadPoolExecutor(1) as other:
        before = occluder.visible(POINTS, EYES)
        for question in (lambda: occluder.visible(POINTS, EYES), lambda: zo.prepare(MESH, name, gl=gl), gl.close):
            with pytest.raises(GlError, match="by the thread that opened it; this is another"):
                other.submit(question).result()
        assert (occluder.visible(POINTS, EYES) == before).all()


@pytest.mark.parametrize("name", OF_A_CONTEXT)
def test_two_threads_with_a_context_each_are_right(gl: GlContext, name: str) -> None:
    with zo.prepare(MESH, name, gl=gl) as occluder:
        truth = occluder.visible(POINTS, EYES)

    def ask(_: int) -> bool:
        with zo.prepare(MESH, name) as mine:
            return all((mine.visible(POINTS, EYES) == truth).all() for _ in range(5))

    with ThreadPoolExecutor(2) as both:
        assert list(both.map(ask, range(2))) == [True, True]


@pytest.mark.gl
@pytest.mark.usefixtures("gl")
def test_two_threads_on_one_pyrender_take_turns() -> None:
    with zo.prepare(MESH, "pyrender") as occluder, ThreadPoolExecutor(2) as both:
        truth = occluder.visible(POINTS, EYES)
        answers = list(both.map(lambda _: (occluder.visible(POINTS, EYES) == truth).all(), range(6)))
    assert answers == [True] * 6


@pytest.mark.gl
@pytest.mark.usefixtures("gl")
@pytest.mark.parametrize("name", [*OF_A_CONTEXT, "pyrender"])
def test_a_forked_child_is_refused_and_the_parent_goes_on(name: str) -> None:
    child = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(FORK), name], capture_output=True, text=True, timeout=120
    )
    assert child.returncode == 0, child.stderr


FORK = """
    import os, sys
    from tests.visibility.test_gl_threads import EYES, MESH, POINTS
    import zbuf_occlude as zo
    with zo.prepare(MESH, sys.argv[1]) as occluder:
        before = occluder.visible(POINTS, EYES)
        pid = os.fork()
        if pid == 0:
            try:
                occluder.visible(POINTS, EYES)
            except zo.OccludeError as error:
                os._exit(0 if "Spawn workers instead of forking them" in str(error) else 1)
            os._exit(2)
        assert os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) == 0
        assert (occluder.visible(POINTS, EYES) == before).all()
"""
