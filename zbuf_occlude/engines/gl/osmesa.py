"""Off-screen OpenGL context of Mesa's software rasteriser through libOSMesa: no display, no driver, no EGL."""

import ctypes
import ctypes.util
from typing import Self

from zbuf_occlude.base.errors import GlError

# GL/osmesa.h
_FORMAT, _PROFILE, _CORE_PROFILE, _MAJOR, _MINOR = 0x22, 0x33, 0x34, 0x36, 0x37
_RGBA, _UNSIGNED_BYTE = 0x1908, 0x1401

_SONAMES = ("libOSMesa.so.8", "libOSMesa.so.6", "libOSMesa.so")
_VERSIONS = ((4, 5), (4, 3))


class OsMesaContext:
    """Native context for `moderngl.create_context(context=...)` on top of libOSMesa; raises GlError on failure.

    The default framebuffer is a single pixel, because all rendering goes to framebuffer objects. A context must not
    be current when it is destroyed, or Mesa writes to freed memory.
    """

    standalone = True

    def __init__(self) -> None:
        self._library = _load()
        self._pixel = (ctypes.c_ubyte * 4)()
        self._handle: int | None = None
        for major, minor in _VERSIONS:
            pairs = (_FORMAT, _RGBA, _PROFILE, _CORE_PROFILE, _MAJOR, major, _MINOR, minor, 0, 0)
            attributes = (ctypes.c_int * len(pairs))(*pairs)
            self._handle = self._library.OSMesaCreateContextAttribs(attributes, None)
            if self._handle:
                break
        else:
            raise GlError("libOSMesa is too old for an OpenGL 4.3 core context.")
        try:
            self._make_current()
        except GlError:
            self.release()
            raise

    def load_opengl_function(self, name: str) -> int:
        """Return the address of an OpenGL function, 0 if there is none of that name."""
        return self._library.OSMesaGetProcAddress(name.encode()) or 0

    load = load_opengl_function

    def __enter__(self) -> Self:
        self._make_current()
        return self

    def __exit__(self, *error: object) -> None:
        """Stay current; moderngl calls this without arguments."""

    def release(self) -> None:
        """Destroy the context; calling it again does nothing."""
        if self._handle:
            if self._library.OSMesaGetCurrentContext() == self._handle:
                self._library.OSMesaMakeCurrent(None, None, 0, 0, 0)
            self._library.OSMesaDestroyContext(self._handle)
            self._handle = None

    def _make_current(self) -> None:
        if not self._handle:
            raise GlError("This OSMesa context is released. Open another.")
        if not self._library.OSMesaMakeCurrent(self._handle, self._pixel, _UNSIGNED_BYTE, 1, 1):
            raise GlError("OSMesaMakeCurrent failed.")


def _load() -> ctypes.CDLL:
    for name in _SONAMES:
        try:
            library = ctypes.CDLL(name)
        except OSError:
            continue
        library.OSMesaCreateContextAttribs.restype = ctypes.c_void_p
        library.OSMesaCreateContextAttribs.argtypes = [ctypes.POINTER(ctypes.c_int), ctypes.c_void_p]
        library.OSMesaMakeCurrent.restype = ctypes.c_ubyte
        library.OSMesaMakeCurrent.argtypes = [ctypes.c_void_p] * 2 + [ctypes.c_uint, ctypes.c_int, ctypes.c_int]
        library.OSMesaGetCurrentContext.restype = ctypes.c_void_p
        library.OSMesaGetProcAddress.restype = ctypes.c_void_p
        library.OSMesaGetProcAddress.argtypes = [ctypes.c_char_p]
        library.OSMesaDestroyContext.restype = None
        library.OSMesaDestroyContext.argtypes = [ctypes.c_void_p]
        return library
    raise GlError(f"None of {', '.join(_SONAMES)} can be loaded.")
