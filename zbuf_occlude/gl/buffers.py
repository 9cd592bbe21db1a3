"""Storage buffers within the driver's limits: what does not fit into one block is split into parts."""

import ctypes
from typing import Any, Self

import numpy as np

from zbuf_occlude.errors import GlError
from zbuf_occlude.gl.context import UINT, GlContext

LARGEST = 1 << 27
"""Bytes of a buffer that shaders write answers into, at most: what llvmpipe and older drivers show of one."""

# names of the OpenGL registry
_COPY_READ, _COPY_WRITE, _STREAM_READ = 0x8F36, 0x8F37, 0x88E1
_R32UI, _RED_INTEGER, _UNSIGNED_INT = 0x8236, 0x8D94, 0x1405
_UPDATE_BARRIER = 0x0200


def block_limit(gl: GlContext) -> int:
    """Return the most bytes that a shader may see of one storage buffer (GL_MAX_SHADER_STORAGE_BLOCK_SIZE)."""
    return int(gl.info["GL_MAX_SHADER_STORAGE_BLOCK_SIZE"])


def answer_limit(gl: GlContext) -> int:
    """Return the most bytes that one buffer of answers may take: `LARGEST`, or the block limit where that is less."""
    return min(LARGEST, block_limit(gl))


def parts(n_items: int, largest: int) -> list[slice]:
    """Split n_items into the fewest slices of at most `largest`, all but the last of one length."""
    n_parts = -(-n_items // largest)
    length = -(-n_items // n_parts)
    return [slice(start, min(start + length, n_items)) for start in range(0, n_items, length)]


class Buffers:
    """A handful of storage buffers that live and die together: name and contents of each, or its size in bytes.

    Raises GlError where one cannot be made, or is larger than a block may be. What is read is first copied to a buffer
    of its own: a driver that sees a storage buffer mapped moves it to the host's memory, where shaders are slow.
    """

    def __init__(self, gl: GlContext, **contents: np.ndarray[Any, Any] | int) -> None:
        self._gl = gl
        self._buffers: dict[str, Any] = {}
        limit = block_limit(gl)
        try:
            for name, array in contents.items():
                n_bytes = array if isinstance(array, int) else array.nbytes
                if n_bytes > limit:
                    raise GlError(f"{name} must fit into a storage block of {limit} bytes; it has {n_bytes}.")
                try:
                    if isinstance(array, int):
                        self._buffers[name] = gl.ctx.buffer(reserve=array)
                    else:
                        self._buffers[name] = gl.ctx.buffer(np.ascontiguousarray(array))
                except Exception as error:  # moderngl raises bare Exception
                    raise GlError(f"{name} of {n_bytes} bytes must be made; the driver says: {error}") from None
                # a driver without memory says so here or never
                gl.check(f"{name} of {n_bytes} bytes must fit into memory", "Ask about fewer points or eyes at once.")
        except BaseException:
            self.release()
            raise

    def bind(self, **bindings: int) -> None:
        """Bind each named buffer to its binding point."""
        for name, binding in bindings.items():
            self._buffers[name].bind_to_storage_buffer(binding)

    def bind_uniforms(self, name: str, binding: int, *, offset: int, size: int) -> None:
        """Bind a range of a buffer to a uniform block's binding point; drivers want offsets in multiples of 256."""
        self._buffers[name].bind_to_uniform_block(binding, offset=offset, size=size)

    def clear(self, name: str, n_bytes: int | None = None) -> None:
        """Set a buffer's bytes, or its first `n_bytes` (a multiple of 4), to zero, on the GPU."""
        call, buffer = self._gl.call, self._buffers[name]
        call.bind_buffer(_COPY_WRITE, buffer.glo)
        n_bytes = buffer.size if n_bytes is None else n_bytes
        call.clear_part(_COPY_WRITE, _R32UI, 0, n_bytes, _RED_INTEGER, _UNSIGNED_INT, None)
        call.bind_buffer(_COPY_WRITE, 0)

    def read_into(self, name: str, array: np.ndarray[Any, Any], offset: int = 0) -> None:
        """Read all of `array` from a buffer, from a byte offset, when all that was asked before is done."""
        call = self._gl.call
        there = UINT(0)
        self._gl.ctx.memory_barrier(_UPDATE_BARRIER)
        call.gen_buffers(1, ctypes.byref(there))
        try:
            call.bind_buffer(_COPY_READ, self._buffers[name].glo)
            call.bind_buffer(_COPY_WRITE, there)
            call.buffer_data(_COPY_WRITE, array.nbytes, None, _STREAM_READ)
            call.copy_part(_COPY_READ, _COPY_WRITE, offset, 0, array.nbytes)
            self._gl.wait()
            call.get_part(_COPY_WRITE, 0, array.nbytes, array.ctypes.data)
        finally:
            call.bind_buffer(_COPY_READ, 0)
            call.bind_buffer(_COPY_WRITE, 0)
            call.delete_buffers(1, ctypes.byref(there))
        self._gl.check()

    def vertex_array(self, program: Any, vertices: str, indices: str) -> Any:
        """Return a vertex array that draws triangles of positions (v, 3) float32; the caller releases it first."""
        bound = self._buffers[vertices]
        content = [(bound, "3f", "in_position")]
        return bound.ctx.vertex_array(program, content, index_buffer=self._buffers[indices])

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.release()

    def release(self) -> None:
        """Give the memory back; calling it again does nothing."""
        while self._buffers:
            self._buffers.popitem()[1].release()
