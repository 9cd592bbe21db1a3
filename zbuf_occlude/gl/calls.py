"""OpenGL's own functions where moderngl has none, or none that does what is meant; loaded once per context."""

import ctypes
from collections.abc import Callable
from typing import Any

UINT, INT, FLOAT, SIZE = ctypes.c_uint, ctypes.c_int, ctypes.c_float, ctypes.c_ssize_t
UINTS, INTS, FLOATS = ctypes.POINTER(UINT), ctypes.POINTER(INT), ctypes.POINTER(FLOAT)
_POINTER, _TIME = ctypes.c_void_p, ctypes.c_uint64

Load = Callable[..., Callable[..., Any]]
"""Name, ctypes of the arguments, `returns=` that of the result."""


class Calls:
    """The functions that this package calls, by the names of their C interface without its prefix and suffixes."""

    def __init__(self, load: Load) -> None:
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
        self.clear_buffer = load("glClearBufferData", UINT, UINT, UINT, UINT, _POINTER)
        self.clear_part = load("glClearBufferSubData", UINT, UINT, SIZE, SIZE, UINT, UINT, _POINTER)
        self.copy_part = load("glCopyBufferSubData", UINT, UINT, SIZE, SIZE, SIZE)
        self.get_part = load("glGetBufferSubData", UINT, SIZE, SIZE, _POINTER)
        self.fence = load("glFenceSync", UINT, UINT, returns=_POINTER)
        self.wait = load("glClientWaitSync", _POINTER, UINT, _TIME, returns=UINT)
        self.delete_fence = load("glDeleteSync", _POINTER)
