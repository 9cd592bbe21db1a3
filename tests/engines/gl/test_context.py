"""GlContext: opening, choosing, naming what is missing, releasing. Each backend in a process of its own."""

import pytest

from tests.needs import need
from tests.processes import run_program
from zbuf_occlude.base.errors import GlError, OptionError
from zbuf_occlude.engines.gl.context import BACKENDS, GlContext

ROUND_TRIP = """
    from zbuf_occlude.engines.gl.context import GlContext
    with GlContext.open({backend!r}) as gl:
        buffer = gl.ctx.buffer(bytes(range(16)))
        assert buffer.read() == bytes(range(16))
        buffer.release()
        gl.check()
        print(gl.backend, gl.is_software, gl.ctx.version_code >= 430, gl.renderer)
    gl.close()
"""

INTERRUPTED = """
    import signal, sys
    from zbuf_occlude.engines.gl import context
    n_lines = last = total = 0
    def trace(frame, event, argument):
        global n_lines
        if frame.f_code.co_filename == context.__file__:
            n_lines += event == "line"
            if event == "line" and n_lines == last:
                signal.raise_signal(signal.SIGINT)
            return trace
    ignored = []
    sys.unraisablehook = lambda lost: ignored.append(lost.exc_value)
    while last <= total:  # interrupt one line after another; before that, none
        n_lines = n_caught = 0
        ignored.clear()
        sys.settrace(trace)
        try:
            context.GlContext.open({backend!r}).close()
        except KeyboardInterrupt:
            n_caught = 1
        sys.settrace(None)
        assert all(isinstance(error, KeyboardInterrupt) for error in ignored), (last, ignored)  # the destructor's
        assert n_caught + len(ignored) == (last > 0), (last, n_caught, ignored)
        last, total = last + 1, total or n_lines
    assert total > 50, total
"""
"""Program that interrupts the opening and closing of a context at each of its lines."""


@pytest.fixture(scope="module", params=BACKENDS)
def working(request: pytest.FixtureRequest) -> str:
    """A backend that works here."""
    need(request.param)
    return str(request.param)


@pytest.fixture(autouse=True)
def no_settings(monkeypatch: pytest.MonkeyPatch) -> None:
    """Programs find no settings of OpenGL but those given."""
    for name in ("ZBUF_OCCLUDE_GL", "GLCONTEXT_DEVICE_INDEX"):
        monkeypatch.delenv(name, raising=False)


@pytest.mark.gl
def test_opens_works_and_closes(working: str) -> None:
    child = run_program(ROUND_TRIP.format(backend=working))
    assert child.returncode == 0, child.stderr
    backend, _, recent, renderer = child.stdout.split(maxsplit=3)
    assert (backend, recent) == (working, "True")
    assert renderer.strip()


@pytest.mark.gl
def test_environment_names_the_backend(working: str) -> None:
    child = run_program(ROUND_TRIP.format(backend=None), ZBUF_OCCLUDE_GL=working)
    assert child.stdout.startswith(working), child.stderr


@pytest.mark.gl
def test_many_contexts_one_after_another_do_not_pile_up(working: str) -> None:
    child = run_program(f"""
        import os, resource
        from zbuf_occlude.engines.gl.context import GlContext
        def open_and_close(times):
            for _ in range(times):
                with GlContext.open({working!r}) as gl:
                    gl.ctx.buffer(reserve=1 << 20)
        open_and_close(10)
        before = len(os.listdir("/proc/self/fd")), len(os.listdir("/proc/self/task"))
        size = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        open_and_close(60)
        assert (len(os.listdir("/proc/self/fd")), len(os.listdir("/proc/self/task"))) == before
        grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - size
        assert grown < 30 * 1024, f"60 contexts with 1 MiB each left {{grown}} KiB"
    """)
    assert child.returncode == 0, child.stderr


@pytest.mark.gl
def test_two_contexts_take_turns(working: str) -> None:
    child = run_program(f"""
        from zbuf_occlude.engines.gl.context import GlContext
        one, two = GlContext.open({working!r}), GlContext.open({working!r})
        one.make_current()
        kept = one.ctx.buffer(b"one.")
        two.make_current()
        two.ctx.buffer(b"two.")
        two.close()
        one.make_current()
        assert kept.read() == b"one."
        one.check()
        one.close()
    """)
    assert child.returncode == 0, child.stderr


@pytest.mark.gl
def test_an_interrupt_while_a_context_opens_or_closes_leaves_no_half_of_it(working: str) -> None:
    ended = run_program(INTERRUPTED.format(backend=working))
    assert (ended.returncode, ended.stderr) == (0, "")


def test_importing_touches_no_gl() -> None:
    child = run_program("""
        import sys
        import zbuf_occlude
        assert "moderngl" not in sys.modules and "glcontext" not in sys.modules
        import zbuf_occlude.engines.gl.context, zbuf_occlude.engines.gl.shaders, zbuf_occlude.engines.gl.probe
        assert "glcontext" not in sys.modules or "glcontext.egl" not in sys.modules
        maps = open("/proc/self/maps").read()
        assert "libEGL" not in maps and "OSMesa" not in maps
    """)
    assert child.returncode == 0, child.stderr


def test_gl_errors_are_raised_and_cleared(gl: GlContext) -> None:
    gl.ctx.enable_direct(0xFFFF)
    with pytest.raises(GlError, match=r"OpenGL must report no error; .* reports GL_INVALID_ENUM"):
        gl.check()
    gl.check()


def test_a_closed_context_refuses(working: str) -> None:
    child = run_program(f"""
        from zbuf_occlude.engines.gl.context import GlContext
        gl = GlContext.open({working!r})
        gl.close()
        print(gl)
        gl.make_current()
    """)
    assert "closed" in child.stdout
    assert "This GlContext is closed" in child.stderr


@pytest.mark.parametrize(
    ("arguments", "environment", "message"),
    [
        (("vulkan",), {}, "the GL backend must be one of egl, osmesa; got 'vulkan'."),
        ((), {"ZBUF_OCCLUDE_GL": "glx"}, "ZBUF_OCCLUDE_GL must be egl, egl:N or osmesa; got 'glx'."),
        ((), {"ZBUF_OCCLUDE_GL": "osmesa:1"}, "ZBUF_OCCLUDE_GL must be egl, egl:N or osmesa; got 'osmesa:1'."),
        ((), {"GLCONTEXT_DEVICE_INDEX": "two"}, "GLCONTEXT_DEVICE_INDEX must be an int from 0; got 'two'."),
        (("osmesa", 0), {}, "device_index must be left out with osmesa, which has no devices; got 0."),
        (("egl", -1), {}, "device_index must be an int from 0; got -1."),
        (("egl", "0"), {}, "device_index must be an int from 0; got '0'."),
    ],
)
def test_wrong_settings(
    arguments: tuple[object, ...], environment: dict[str, str], message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    with pytest.raises(OptionError) as caught:
        GlContext.open(*arguments)
    assert str(caught.value) == message


@pytest.mark.needs("egl")
def test_a_device_that_is_not_there() -> None:
    child = run_program("from zbuf_occlude.engines.gl.context import GlContext; GlContext.open('egl', 4321)")
    assert "GlError: No OpenGL 4.3 core context opens. Tried egl: requested device index 4321" in child.stderr
    assert "apt-get" not in child.stderr  # no package helps


@pytest.mark.needs("egl")
def test_an_explicit_device_wins_over_the_environment() -> None:
    assert run_program(ROUND_TRIP.format(backend="egl"), GLCONTEXT_DEVICE_INDEX="4321").returncode == 1
    child = run_program(
        "from zbuf_occlude.engines.gl.context import GlContext; print(GlContext.open(device_index=0))",
        GLCONTEXT_DEVICE_INDEX="4321",
    )
    assert "GlContext(egl:0, " in child.stdout, child.stderr


def test_missing_libraries_name_what_was_tried_and_the_commands(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("zbuf_occlude.engines.gl.context.find_library", lambda name: "libEGL_is_not_here.so")
    monkeypatch.setattr("zbuf_occlude.engines.gl.osmesa._SONAMES", ("libOSMesa_is_not_here.so",))
    with pytest.raises(GlError) as caught:
        GlContext.open()
    assert "Tried egl: " in str(caught.value)
    assert "apt-get install libegl1 libgl1-mesa-dri; osmesa: " in str(caught.value)
    assert str(caught.value).endswith("On Debian: apt-get install libosmesa6")
