"""Storage buffers within the driver's limits: what does not fit into one block is split into parts."""

from typing import Any, Self

import numpy as np

from zbuf_occlude.errors import GlError


def block_limit(ctx: Any) -> int:
    """Return the most bytes that a shader may see of one storage buffer (GL_MAX_SHADER_STORAGE_BLOCK_SIZE)."""
    return int(ctx.info["GL_MAX_SHADER_STORAGE_BLOCK_SIZE"])


def parts(n_items: int, largest: int) -> list[slice]:
    """Split n_items into the fewest slices of at most `largest`, all but the last of one length."""
    n_parts = -(-n_items // largest)
    length = -(-n_items // n_parts)
    return [slice(start, min(start + length, n_items)) for start in range(0, n_items, length)]


class Buffers:
    """A handful of storage buffers that live and die together.

    Parameters
    ----------
    ctx : moderngl.Context
    **contents : ndarray or int
        Name and contents of each, or its size in bytes where there are none yet.

    Raises
    ------
    GlError
        A buffer could not be made, or is larger than a block may be.
    """

    def __init__(self, ctx: Any, **contents: np.ndarray[Any, Any] | int) -> None:
        sizes = {name: array if isinstance(array, int) else array.nbytes for name, array in contents.items()}
        self._buffers: dict[str, Any] = {}
        limit = block_limit(ctx)
        try:
            for name, array in contents.items():
                if sizes[name] > limit:
                    raise GlError(f"{name} must fit into a storage block of {limit} bytes; it has {sizes[name]}.")
                reserved = isinstance(array, int)
                made = ctx.buffer(reserve=array) if reserved else ctx.buffer(np.ascontiguousarray(array))
                self._buffers[name] = made
        except Exception as error:  # moderngl raises bare Exception when the driver has no memory left
            self.release()
            if isinstance(error, GlError):
                raise
            raise GlError(f"buffers of {sizes} bytes must be made; the driver says: {error}") from None

    def bind(self, **bindings: int) -> None:
        """Bind each named buffer to its binding point."""
        for name, binding in bindings.items():
            self._buffers[name].bind_to_storage_buffer(binding)

    def bind_uniforms(self, name: str, binding: int, *, offset: int, size: int) -> None:
        """Bind a range of a buffer to a uniform block's binding point; drivers want offsets in multiples of 256."""
        self._buffers[name].bind_to_uniform_block(binding, offset=offset, size=size)

    def clear(self, name: str) -> None:
        """Set a buffer's bytes to zero, on the GPU."""
        self._buffers[name].clear()

    def write(self, name: str, array: np.ndarray[Any, Any]) -> None:
        """Write `array` to a buffer's beginning."""
        self._buffers[name].write(array)

    def read_into(self, name: str, array: np.ndarray[Any, Any], offset: int = 0) -> None:
        """Read all of `array` from a buffer, from a byte offset."""
        self._buffers[name].read_into(array, array.nbytes, offset=offset)

    def vertex_array(self, program: Any, vertices: str, indices: str) -> Any:
        """Return a vertex array that draws triangles of positions (v, 3) float32, the input `in_position`.

        It is the caller's, who releases it before the buffers.
        """
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
