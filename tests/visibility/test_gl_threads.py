"""Threads and forks: every method that renders is right in them, or says why it cannot be asked there."""

import gc
import os
import sys
from concurrent.futures import ThreadPoolExecutor

import pytest

import zbuf_occlude as zo
from tests.processes import run_program
from zbuf_occlude.base.errors import GlError
from zbuf_occlude.engines.gl.context import GlContext
from zbuf_occlude.meshes import shapes

MESH = shapes.make("chair", 3).normalized()
POINTS = zo.sample_surface(MESH, n_points=500, seed=1)
EYES = zo.views.fibonacci(3).eyes
OF_A_CONTEXT = ("depth_buffer", "exact_gl")


def ask(name: str) -> str:
    """Prepare, ask and close as README does; the renderer."""
    with zo.prepare(MESH, name) as occluder:
        assert occluder.visible(POINTS, EYES).any()
        return occluder.renderer


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

    def agrees(_: int) -> bool:
        with zo.prepare(MESH, name) as mine:
            return all((mine.visible(POINTS, EYES) == truth).all() for _ in range(5))

    with ThreadPoolExecutor(2) as both:
        assert list(both.map(agrees, range(2))) == [True, True]


@pytest.mark.gl
@pytest.mark.usefixtures("gl")
@pytest.mark.parametrize("name", OF_A_CONTEXT)
def test_meshes_without_a_context_share_one_and_lose_no_memory(name: str) -> None:
    """moderngl loses 900 small objects, 40 kB, with each context."""
    renderers = [ask(name) for _ in range(3)]
    gc.collect()
    before = sys.getallocatedblocks()
    renderers += [ask(name) for _ in range(10)]
    gc.collect()
    assert (sys.getallocatedblocks() - before) / 10 < 50
    assert len(set(renderers)) == 1


@pytest.mark.gl
@pytest.mark.usefixtures("gl")
def test_a_thread_s_context_ends_with_it() -> None:
    """9 MB of each were kept. The allocator's arenas grow once, at any time."""
    child = run_program("""
        import os, threading
        from tests.visibility.test_gl_threads import ask
        from zbuf_occlude.base.limits import resident_gigabytes
        def in_threads(times):
            for _ in range(times):
                thread = threading.Thread(target=ask, args=["depth_buffer"])
                thread.start()
                thread.join()
            return resident_gigabytes(os.getpid())
        sizes = [in_threads(times) for times in (4, 9, 9)]
        grown = min(sizes[1] - sizes[0], sizes[2] - sizes[1])
        assert grown < 0.04, f"9 threads left {1000 * grown:.0f} MB"
    """)
    assert child.returncode == 0, child.stderr


@pytest.mark.gl
@pytest.mark.usefixtures("gl")
def test_other_settings_open_another_context(monkeypatch: pytest.MonkeyPatch) -> None:
    first = GlContext.of_thread()
    assert GlContext.of_thread() is first
    monkeypatch.setenv("ZBUF_OCCLUDE_GL", first.backend)
    if os.environ.get("GLCONTEXT_DEVICE_INDEX") is None:
        monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "0")
    second = GlContext.of_thread()
    assert second is not first
    assert GlContext.of_thread() is second


@pytest.mark.gl
@pytest.mark.usefixtures("gl")
def test_another_library_may_end_the_display_between_meshes() -> None:
    """As pyrender does when it closes; a mesh that was prepared before is refused in words."""
    child = run_program("""
        import ctypes, ctypes.util
        import zbuf_occlude as zo
        from zbuf_occlude.engines.gl.context import GlContext
        from tests.visibility.test_gl_threads import EYES, MESH, POINTS, ask
        ask("depth_buffer")
        if GlContext.of_thread().backend == "egl":
            egl = ctypes.CDLL(ctypes.util.find_library("EGL"))
            egl.eglGetCurrentDisplay.restype = ctypes.c_void_p
            egl.eglTerminate.argtypes = [ctypes.c_void_p]
            occluder = zo.prepare(MESH)
            egl.eglMakeCurrent.argtypes = [ctypes.c_void_p] * 4
            display = egl.eglGetCurrentDisplay()
            egl.eglMakeCurrent(display, None, None, None)
            egl.eglTerminate(display)
            try:
                occluder.visible(POINTS, EYES)
            except zo.GlError as error:
                assert "another library" in str(error) and "prepare the mesh again" in str(error)
            else:
                raise AssertionError
            ask("depth_buffer")
    """)
    assert child.returncode == 0, child.stderr


@pytest.mark.gl
@pytest.mark.needs("pyrender")
@pytest.mark.usefixtures("gl")
def test_two_threads_on_one_pyrender_take_turns() -> None:
    with zo.prepare(MESH, "pyrender") as occluder, ThreadPoolExecutor(2) as both:
        truth = occluder.visible(POINTS, EYES)
        answers = list(both.map(lambda _: (occluder.visible(POINTS, EYES) == truth).all(), range(6)))
    assert answers == [True] * 6


@pytest.mark.gl
@pytest.mark.usefixtures("gl")
@pytest.mark.parametrize("name", [*OF_A_CONTEXT, pytest.param("pyrender", marks=pytest.mark.needs("pyrender"))])
def test_a_forked_child_is_refused_and_the_parent_goes_on(name: str) -> None:
    child = run_program(FORK, name)
    assert child.returncode == 0, child.stderr


FORK = """
    import os, sys
    from tests.visibility.test_gl_threads import EYES, MESH, POINTS
    import zbuf_occlude as zo
    with zo.prepare(MESH, sys.argv[1]) as occluder:
        before = occluder.visible(POINTS, EYES)
        pid = os.fork()
        if pid == 0:
            questions = [lambda: occluder.visible(POINTS, EYES)]
            if sys.argv[1] != "pyrender":  # whose process is another each time
                questions.append(lambda: zo.prepare(MESH, sys.argv[1]))
            for question in questions:
                try:
                    question()
                except zo.OccludeError as error:
                    if "Spawn workers instead of forking them" not in str(error):
                        os._exit(1)
                else:
                    os._exit(2)
            os._exit(0)
        assert os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) == 0
        assert (occluder.visible(POINTS, EYES) == before).all()
"""
