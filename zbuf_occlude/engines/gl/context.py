"""GlContext: headless OpenGL context of a thread, through EGL (any GPU) or OSMesa (Mesa's rasteriser).

The outermost layer (a command, a worker, the test session) opens a context and passes it down; callers that pass none
share one per thread. No context is opened at import. A context made before a fork hangs the children. A library that
calls eglTerminate on the shared display (pyrender) ends every other context of the process.
"""

import ctypes
import os
import sys
import threading
from collections.abc import Callable
from ctypes.util import find_library
from typing import Any, Self

import moderngl

from zbuf_occlude.base.errors import GlError, OptionError
from zbuf_occlude.base.interrupts import held
from zbuf_occlude.engines.gl.devices import FIXES, VISIBLE, default_device, is_software
from zbuf_occlude.engines.gl.osmesa import OsMesaContext
from zbuf_occlude.engines.gl.shaders import compile_program

BACKENDS = ("egl", "osmesa")
"""Backends in the order in which they are tried."""

ENVIRONMENT = "ZBUF_OCCLUDE_GL"
"""Environment variable of the default backend: ``egl``, ``egl:1`` (with a device index) or ``osmesa``."""

REQUIRED = 430
"""Required version, OpenGL 4.3 core: compute shaders and shader storage buffers."""

_LIBRARIES = ("GLCONTEXT_LINUX_LIBEGL", "GLCONTEXT_LINUX_LIBGL")
"""Environment variables of glcontext that name libraries in place of the system's."""

_SETTINGS = (ENVIRONMENT, "GLCONTEXT_DEVICE_INDEX", VISIBLE, *_LIBRARIES)
"""Environment variables that decide which context opens."""

# names of the OpenGL registry
_COMMANDS_COMPLETE, _FLUSH, _TIMEOUT_EXPIRED, _WAIT_FAILED = 0x9117, 0x0001, 0x911B, 0x911D
_PATIENCE = 1_000_000_000  # nanoseconds of one wait

_kept = threading.local()
"""Context that `GlContext.of_thread` opened in this thread, and the settings at that time."""

UINT, INT, FLOAT, SIZE = ctypes.c_uint, ctypes.c_int, ctypes.c_float, ctypes.c_ssize_t
UINTS, INTS, FLOATS = ctypes.POINTER(UINT), ctypes.POINTER(INT), ctypes.POINTER(FLOAT)
_POINTER, _TIME = ctypes.c_void_p, ctypes.c_uint64


class Calls:
    """OpenGL functions that moderngl does not offer; `load` finds them by name and types."""

    def __init__(self, load: Callable[..., Callable[..., Any]]) -> None:
        self.gen_textures = load("glGenTextures", INT, UINTS)
        self.active_texture = load("glActiveTexture", UINT)
        self.bind_texture = load("glBindTexture", UINT, UINT)
        self.tex_storage = load("glTexStorage2D", UINT, INT, UINT, INT, INT)
        self.tex_parameter = load("glTexParameteri", UINT, UINT, INT)
        self.read_pixels = load("glReadPixels", INT, INT, INT, INT, UINT, UINT, _POINTER)
        self.delete_textures = load("glDeleteTextures", INT, UINTS)
        self.gen_framebuffers = load("glGenFramebuffers", INT, UINTS)
        self.bind_framebuffer = load("glBindFramebuffer", UINT, UINT)
        self.framebuffer_texture = load("glFramebufferTexture", UINT, UINT, UINT, INT)
        self.draw_buffers = load("glDrawBuffers", INT, UINTS)
        self.delete_framebuffers = load("glDeleteFramebuffers", INT, UINTS)
        self.viewport = load("glViewport", INT, INT, INT, INT)
        self.scissor = load("glScissor", INT, INT, INT, INT)
        self.clip_control = load("glClipControl", UINT, UINT)
        self.clear_floats = load("glClearBufferfv", UINT, INT, FLOATS)
        self.clear_ints = load("glClearBufferiv", UINT, INT, INTS)
        self.gen_buffers = load("glGenBuffers", INT, UINTS)
        self.bind_buffer = load("glBindBuffer", UINT, UINT)
        self.buffer_data = load("glBufferData", UINT, SIZE, _POINTER, UINT)
        self.delete_buffers = load("glDeleteBuffers", INT, UINTS)
        self.clear_part = load("glClearBufferSubData", UINT, UINT, SIZE, SIZE, UINT, UINT, _POINTER)
        self.copy_part = load("glCopyBufferSubData", UINT, UINT, SIZE, SIZE, SIZE)
        self.get_part = load("glGetBufferSubData", UINT, SIZE, SIZE, _POINTER)
        self.fence = load("glFenceSync", UINT, UINT, returns=_POINTER)
        self.wait = load("glClientWaitSync", _POINTER, UINT, _TIME, returns=UINT)
        self.delete_fence = load("glDeleteSync", _POINTER)


class GlContext:
    """Open OpenGL context. Make one with `GlContext.open`; close it, or use it as a context manager.

    Attributes
    ----------
    backend : str
        ``"egl"`` or ``"osmesa"``.
    device_index : int or None
        Index of the EGL device; None with OSMesa.
    ctx : moderngl.Context

    Notes
    -----
    moderngl 5.13 leaks 40 kB of host memory with each context, so a long run must open few.
    """

    def __init__(self, backend: str, device_index: int | None, native: Any, ctx: Any) -> None:
        self.backend = backend
        self.device_index = device_index
        self.ctx = ctx
        self._native = native
        self._programs: dict[Any, Any] = {}
        self._process, self._thread = os.getpid(), threading.get_ident()
        self._closed = False
        current = native.load_opengl_function("eglGetCurrentContext")  # 0 with OSMesa, which reports failures itself
        self._current = ctypes.CFUNCTYPE(ctypes.c_void_p)(current) if current else lambda: None
        self._handle = self._current()
        self.info: dict[str, Any] = ctx.info
        """Limits and names of the driver; queried once, because older drivers record errors for unknown ones."""
        ctx.clear_errors()
        self.renderer: str = self.info["GL_RENDERER"]
        """GL_RENDERER, e.g. ``NVIDIA H100`` or ``llvmpipe (LLVM 15.0.6, 256 bits)``."""
        self.version: str = self.info["GL_VERSION"]
        """GL_VERSION, e.g. ``4.5 (Core Profile) Mesa 22.3.6``."""
        self.call = Calls(self.function)
        """OpenGL functions that moderngl does not offer."""

    @classmethod
    def open(cls, backend: str | None = None, device_index: int | None = None) -> Self:
        """Open a context and make it current.

        Parameters
        ----------
        backend : {"egl", "osmesa"}, optional
            By default the backend that the environment variable ``ZBUF_OCCLUDE_GL`` names, else the first that works.
        device_index : int, optional
            Index of the EGL device; implies egl. By default that of ``ZBUF_OCCLUDE_GL=egl:N``, else that of
            ``GLCONTEXT_DEVICE_INDEX``, else the first device visible by ``CUDA_VISIBLE_DEVICES``, which EGL itself
            ignores, else 0.

        Returns
        -------
        GlContext

        Raises
        ------
        OptionError
            An unknown backend, or a device index without egl.
        GlError
            No context could be opened; the message names the attempts and the command that would help.
        """
        named, device = _from_environment()
        if backend is None:
            backend = named
        if device_index is None and backend != "osmesa":
            device_index = device
        if backend is not None and backend not in BACKENDS:
            raise OptionError(f"the GL backend must be one of {', '.join(BACKENDS)}; got {backend!r}.")
        if device_index is not None:
            if backend == "osmesa":
                raise OptionError(
                    f"device_index must be left out with osmesa, which has no devices; got {device_index}."
                )
            if isinstance(device_index, bool) or not isinstance(device_index, int) or device_index < 0:
                raise OptionError(f"device_index must be an int from 0; got {device_index!r}.")
            backend = "egl"
        failures = []
        for candidate in BACKENDS if backend is None else (backend,):
            try:
                with held():  # of half a context nobody could free the other half
                    if candidate == "osmesa":
                        return cls("osmesa", None, *_open_osmesa())
                    index = default_device() if device_index is None else device_index
                    return cls("egl", index, *_open_egl(index))
            except GlError as error:
                failures.append(f"{candidate}: {error}")
        raise GlError(f"No OpenGL {REQUIRED / 100:.1f} core context opens. Tried " + "; ".join(failures))

    @classmethod
    def of_thread(cls) -> "GlContext":
        """Return the context that callers in this thread share; it closes when the thread ends.

        It is reopened if the settings have changed or another library ended EGL's display. Raises GlError if none
        opens, or in a process forked from one with a context.
        """
        settings = [os.environ.get(name) for name in _SETTINGS]
        kept, opened_by = getattr(_kept, "context", (None, None))
        if kept is not None and opened_by == settings:
            kept._check_owner()
            if kept._becomes_current():
                return kept
        opened = cls.open()
        _kept.context = opened, settings
        return opened

    @property
    def is_software(self) -> bool:
        """True if a CPU renders (containers without the graphics capability fall back to it silently)."""
        return is_software(self.renderer)

    def make_current(self) -> None:
        """Make this the current context of this thread.

        Raises GlError if it is closed, belongs to another thread or process, or its display was terminated.
        """
        if self._closed:
            raise GlError("This GlContext is closed. Open another: GlContext.open().")
        self._check_owner()
        if not self._becomes_current():
            raise GlError(
                "The EGL display was terminated by another library (such as pyrender). Open another GlContext, and "
                "prepare the mesh again."
            )

    def _becomes_current(self) -> bool:
        # moderngl's own `with ctx` would leave no context current at its end
        self.ctx.__enter__()
        return bool(self._current() == self._handle)

    def _check_owner(self) -> None:
        if os.getpid() != self._process:
            raise GlError(
                f"a GlContext must be used by the process that opened it ({self._process}); this is {os.getpid()}. "
                "Spawn workers instead of forking them, and open a context in each."
            )
        if threading.get_ident() != self._thread:
            raise GlError(
                "a GlContext must be used, and closed, by the thread that opened it; this is another. "
                "Open a context, and prepare the mesh, in each thread."
            )

    def function(self, name: str, *arguments: Any, returns: Any = None) -> Callable[..., Any]:
        """Return an OpenGL function by its C name and the ctypes of its arguments and result, or raise GlError."""
        address = self._native.load_opengl_function(name)
        if not address:
            raise GlError(f"{self.renderer} lacks the function {name}. Is its driver very old?")
        prototype: Callable[[int], Callable[..., Any]] = ctypes.CFUNCTYPE(returns, *arguments)
        return prototype(address)

    def program(self, *names: str, **constants: object) -> Any:
        """Return the program of shader files and constants (`shaders.compile_program`), compiled once per context.

        It belongs to the context. Set all its uniforms before each use, because other queries set their own.
        """
        key = (names, tuple(sorted(constants.items())))
        if key not in self._programs:
            self._programs[key] = compile_program(self.ctx, *names, **constants)
        return self._programs[key]

    def check(self, expected: str = "OpenGL must report no error", remedy: str = "") -> None:
        """Raise GlError if OpenGL has recorded an error since the last check, and clear it. Call it once per batch."""
        error = self.ctx.error
        if error != "GL_NO_ERROR":
            self.ctx.clear_errors()
            raise GlError(f"{expected}; {self.renderer} reports {error}. {remedy}".rstrip())

    def wait(self) -> None:
        """Wait until OpenGL has executed all commands; other Python threads run meanwhile."""
        fence = self.call.fence(_COMMANDS_COMPLETE, 0)
        try:
            while (ended := self.call.wait(fence, _FLUSH, _PATIENCE)) == _TIMEOUT_EXPIRED:
                pass
        finally:
            self.call.delete_fence(fence)
        if ended == _WAIT_FAILED:
            self.check()
            raise GlError(f"Waiting for {self.renderer} to finish its commands failed.")

    def close(self) -> None:
        """Destroy the context and its objects; no effect if called again, or in a forked child."""
        if self._closed:
            return
        if os.getpid() == self._process:
            self._check_owner()
        with held():
            self._closed = True
            if os.getpid() == self._process:
                if self._current() == self._handle:
                    self._native.__exit__()  # a current context would not be destroyed, even at the thread's end
                self.ctx.release()

    def __del__(self) -> None:
        """Close the context when its last reference goes, as at a thread's end; the end of the process closes all."""
        of_here = getattr(self, "_thread", None) == threading.get_ident() and self._process == os.getpid()
        if of_here and not sys.is_finalizing():
            self.close()

    def __enter__(self) -> Self:
        self.make_current()
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def __repr__(self) -> str:
        device = "" if self.device_index is None else f":{self.device_index}"
        return f"GlContext({self.backend}{device}, {self.renderer}{', closed' if self._closed else ''})"


def _from_environment() -> tuple[str | None, int | None]:
    """Return the backend and device index that the environment names, None for each that it does not."""
    value = os.environ.get(ENVIRONMENT, "").strip()
    backend, colon, device = value.partition(":")
    if value and (backend not in BACKENDS or (colon and not (backend == "egl" and device.isdecimal()))):
        raise OptionError(f"{ENVIRONMENT} must be egl, egl:N or osmesa; got {value!r}.")
    device = device or os.environ.get("GLCONTEXT_DEVICE_INDEX", "").strip()
    if device and not device.isdecimal():
        raise OptionError(f"GLCONTEXT_DEVICE_INDEX must be an int from 0; got {device!r}.")
    return backend or None, int(device) if device else None


def egl_fix() -> str:
    """Return the command that may make EGL work: unset variables that name libraries, else install packages."""
    named = [name for name in _LIBRARIES if os.environ.get(name)]
    return f"unset {' '.join(named)}" if named else FIXES["egl"]


def _open_egl(device_index: int) -> tuple[Any, Any]:
    named_egl, named_gl = map(os.environ.get, _LIBRARIES)
    libegl = named_egl or find_library("EGL") or "libEGL.so.1"
    libgl = named_gl or find_library("GL") or find_library("OpenGL") or libegl
    try:
        from glcontext import egl

        # the C module itself: its Python wrapper lets GLCONTEXT_DEVICE_INDEX override an explicit index
        context = egl.create_context(
            mode="standalone", glversion=REQUIRED, libegl=libegl, libgl=libgl, device_index=device_index
        )
        return context, moderngl.create_context(require=REQUIRED, context=context)
    except Exception as error:  # glcontext and moderngl raise bare Exception
        if "requested device index" in str(error):  # "requested device index 7, but found 1 devices"
            raise GlError(f"{error}; count from 0.") from None
        raise GlError(f"device_index {device_index}: {error}. Try: {egl_fix()}") from None


def _open_osmesa() -> tuple[Any, Any]:
    context: Any = None
    try:
        context = OsMesaContext()
        return context, moderngl.create_context(require=REQUIRED, context=context)
    except Exception as error:  # moderngl raises bare Exception
        if context is not None:
            context.release()
        raise GlError(f"{str(error).removesuffix('.')}. On Debian: {FIXES['osmesa']}") from None
