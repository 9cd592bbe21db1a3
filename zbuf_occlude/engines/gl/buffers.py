"""Storage buffers within the driver's limits; larger arrays are split into parts."""

import ctypes
from typing import Any, Self

import numpy as np

from zbuf_occlude.base.errors import GlError
from zbuf_occlude.engines.gl.context import UINT, GlContext

MAX_ANSWER_BYTES = 1 << 27
"""Maximum bytes of a buffer for answers: shaders of llvmpipe and of older drivers see no more of a buffer."""

# names of the OpenGL registry
_COPY_READ, _COPY_WRITE, _STREAM_READ = 0x8F36, 0x8F37, 0x88E1
_R32UI, _RED_INTEGER, _UNSIGNED_INT = 0x8236, 0x8D94, 0x1405
_UPDATE_BARRIER = 0x0200


def block_limit(gl: GlContext) -> int:
    """Return the maximum bytes of a storage buffer that a shader can access (GL_MAX_SHADER_STORAGE_BLOCK_SIZE)."""
    return int(gl.info["GL_MAX_SHADER_STORAGE_BLOCK_SIZE"])


def answer_limit(gl: GlContext) -> int:
    """Return the maximum bytes of one buffer for answers: the lesser of `MAX_ANSWER_BYTES` and the block limit."""
    return min(MAX_ANSWER_BYTES, block_limit(gl))


def parts(n_items: int, largest: int) -> list[slice]:
    """Split n_items into the fewest slices of at most `largest`, all but the last of equal length."""
    n_parts = -(-n_items // largest)
    length = -(-n_items // n_parts)
    return [slice(start, min(start + length, n_items)) for start in range(0, n_items, length)]


class Buffers:
    """Set of storage buffers that are released together, given by name and contents, or name and size in bytes.

    Raises GlError if one cannot be made or exceeds the block limit. Reading goes through a temporary buffer: some
    drivers move a storage buffer that is mapped to the host's memory, where shaders are slow.
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
                    raise GlError(f"The driver cannot make {name} of {n_bytes} bytes: {error}") from None
                # only this check detects that the driver is out of memory
                gl.check(f"{name} of {n_bytes} bytes must fit into memory", "Ask about fewer points or eyes at once.")
        except BaseException:
            self.release()
            raise

    def bind(self, **bindings: int) -> None:
        """Bind each named buffer to its binding point."""
        for name, binding in bindings.items():
            self._buffers[name].bind_to_storage_buffer(binding)

    def bind_uniforms(self, name: str, binding: int, *, offset: int, size: int) -> None:
        """Bind a range of a buffer to a uniform block's binding point; offsets must be multiples of 256."""
        self._buffers[name].bind_to_uniform_block(binding, offset=offset, size=size)

    def clear(self, name: str, n_bytes: int | None = None) -> None:
        """Set a buffer's bytes, or its first `n_bytes` (a multiple of 4), to zero, on the GPU."""
        call, buffer = self._gl.call, self._buffers[name]
        call.bind_buffer(_COPY_WRITE, buffer.glo)
        n_bytes = buffer.size if n_bytes is None else n_bytes
        call.clear_part(_COPY_WRITE, _R32UI, 0, n_bytes, _RED_INTEGER, _UNSIGNED_INT, None)
        call.bind_buffer(_COPY_WRITE, 0)

    def read_into(self, name: str, array: np.ndarray[Any, Any], offset: int = 0) -> None:
        """Fill `array` from a buffer, from a byte offset on, after all earlier commands are done."""
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
        """Return a vertex array that draws triangles of positions (v, 3) float32; release it before the buffers."""
        bound = self._buffers[vertices]
        content = [(bound, "3f", "in_position")]
        return bound.ctx.vertex_array(program, content, index_buffer=self._buffers[indices])

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.release()

    def release(self) -> None:
        """Free the memory; calling it again does nothing."""
        while self._buffers:
            self._buffers.popitem()[1].release()
