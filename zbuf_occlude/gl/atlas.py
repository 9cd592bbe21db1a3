"""The depth atlas: one big depth buffer, cut into square tiles, with the id of the nearest face beside each depth."""

import ctypes
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.errors import GlError
from zbuf_occlude.gl.calls import FLOAT, INT, UINT
from zbuf_occlude.gl.context import GlContext

NO_FACE = -1

# names of the OpenGL registry
_TEXTURE_2D, _TEXTURE0, _NEAREST = 0x0DE1, 0x84C0, 0x2600
_MIN_FILTER, _MAG_FILTER = 0x2801, 0x2800
_WRAP_S, _WRAP_T, _CLAMP_TO_EDGE = 0x2802, 0x2803, 0x812F
_DEPTH_COMPONENT32F, _DEPTH_COMPONENT = 0x8CAC, 0x1902
_FRAMEBUFFER, _DEPTH_ATTACHMENT, _COLOR_ATTACHMENT0, _COMPLETE = 0x8D40, 0x8D00, 0x8CE0, 0x8CD5
_DEPTH, _COLOR, _NONE = 0x1801, 0x1800, 0
_RED_INTEGER, _INTS32, _FLOATS32 = 0x8D94, 0x1404, 0x1406
_SCISSOR_TEST, _CLIP_DISTANCES = 0x0C11, (0x3000, 0x3001, 0x3002, 0x3003)
_LOWER_LEFT, _NEGATIVE_ONE_TO_ONE, _ZERO_TO_ONE = 0x8CA1, 0x935E, 0x935F


class Atlas:
    """Tiles to draw into, and to read in shaders.

    Parameters
    ----------
    gl : GlContext
    resolution : int
        Pixels along a tile's side.
    n_tiles : int
    faces : bool
        Whether face ids are kept beside the depths.

    Raises
    ------
    GlError
        The driver has no memory left, or cannot do it.

    Notes
    -----
    moderngl knows depth textures of 24 bits only and no reversed depth, so the few calls that this takes are OpenGL's
    own. Depth is reversed (`tiles.Pictures`) and in 32-bit floats. Takes 4 bytes per pixel, 8 with faces.
    """

    def __init__(self, gl: GlContext, resolution: int, n_tiles: int, *, faces: bool) -> None:
        self.resolution, self.n_tiles, self.faces = resolution, n_tiles, faces
        largest = int(gl.info["GL_MAX_TEXTURE_SIZE"]) // resolution
        # as narrow as it may be: what is near in a tile is then near in memory
        self.columns = -(-n_tiles // max(largest, 1))
        rows = -(-n_tiles // self.columns)
        if max(self.columns, rows) > largest:
            raise GlError(
                f"{n_tiles} tiles of {resolution} pixels must fit into a texture of {gl.renderer}; they do not."
            )
        self.size = (self.columns * resolution, rows * resolution)
        self._gl = gl
        self._call = gl.call
        gl.check()
        self._depth, self._framebuffer = UINT(0), UINT(0)
        self._ids: Any = None
        try:
            self._make()
        except BaseException:
            self.release()
            raise

    def _make(self) -> None:
        call = self._call
        call.gen_textures(1, ctypes.byref(self._depth))
        self._bind(_TEXTURE0, self._depth)
        call.tex_storage(_TEXTURE_2D, 1, _DEPTH_COMPONENT32F, *self.size)
        for parameter in (_MIN_FILTER, _MAG_FILTER):
            call.tex_parameter(_TEXTURE_2D, parameter, _NEAREST)
        for parameter in (_WRAP_S, _WRAP_T):
            call.tex_parameter(_TEXTURE_2D, parameter, _CLAMP_TO_EDGE)
        call.gen_framebuffers(1, ctypes.byref(self._framebuffer))
        call.bind_framebuffer(_FRAMEBUFFER, self._framebuffer)
        call.framebuffer_texture(_FRAMEBUFFER, _DEPTH_ATTACHMENT, self._depth, 0)
        drawn = _NONE
        if self.faces:
            self._ids = self._gl.ctx.texture(self.size, 1, dtype="i4")
            self._ids.filter = (_NEAREST, _NEAREST)
            self._ids.repeat_x = self._ids.repeat_y = False
            call.framebuffer_texture(_FRAMEBUFFER, _COLOR_ATTACHMENT0, self._ids.glo, 0)
            drawn = _COLOR_ATTACHMENT0
        call.draw_buffers(1, (UINT * 1)(drawn))
        call.bind_framebuffer(_FRAMEBUFFER, 0)
        error = self._gl.ctx.error
        if error != "GL_NO_ERROR":
            self._gl.ctx.clear_errors()
            raise GlError(
                f"a depth atlas of {self.size[0]} x {self.size[1]} pixels must fit into {self._gl.renderer}'s memory; "
                f"it reports {error}. Take a lower resolution."
            )

    def _bind(self, unit: int, texture: Any) -> None:
        self._call.active_texture(unit)
        self._call.bind_texture(_TEXTURE_2D, texture)

    def draw(self, n_tiles: int, render: Callable[[], None], *, clip: bool) -> None:
        """Clear the first tiles and draw into them.

        Parameters
        ----------
        n_tiles : int
        render : callable
            Draws triangles, which are seen from both sides.
        clip : bool
            Whether the shader writes four clip distances, the tile's sides.
        """
        call, ctx = self._call, self._gl.ctx
        rows = -(-n_tiles // self.columns)
        call.bind_framebuffer(_FRAMEBUFFER, self._framebuffer)
        call.viewport(0, 0, *self.size)
        call.scissor(0, 0, min(n_tiles, self.columns) * self.resolution, rows * self.resolution)
        call.clip_control(_LOWER_LEFT, _ZERO_TO_ONE)
        ctx.enable_only(ctx.DEPTH_TEST)
        ctx.depth_func = ">"
        switches = [_SCISSOR_TEST, *(_CLIP_DISTANCES if clip else ())]
        for switch in switches:
            ctx.enable_direct(switch)
        try:
            call.clear_floats(_DEPTH, 0, (FLOAT * 1)(0.0))
            if self.faces:
                call.clear_ints(_COLOR, 0, (INT * 4)(NO_FACE, 0, 0, 0))
            render()
        finally:
            for switch in switches:
                ctx.disable_direct(switch)
            ctx.depth_func = "<"
            ctx.enable_only(ctx.NOTHING)
            call.clip_control(_LOWER_LEFT, _NEGATIVE_ONE_TO_ONE)
            call.bind_framebuffer(_FRAMEBUFFER, 0)

    def use(self, *, depths: int, faces: int) -> None:
        """Bind the depths, and the face ids where they are kept, to texture units."""
        self._bind(_TEXTURE0 + depths, self._depth)
        if self.faces:
            self._ids.use(faces)

    def read(self, tile: int) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
        """Read a tile back: depths and face ids, (resolution, resolution) each, the lowest row first.

        For images and tests. Without faces the ids are all `NO_FACE`. Raises GlError when OpenGL reports an error.
        """
        side, call = self.resolution, self._call
        depths, ids = np.empty((side, side), np.float32), np.full((side, side), NO_FACE, np.int32)
        row, column = (side * place for place in divmod(tile, self.columns))
        call.bind_framebuffer(_FRAMEBUFFER, self._framebuffer)
        call.read_pixels(column, row, side, side, _DEPTH_COMPONENT, _FLOATS32, depths.ctypes.data)
        if self.faces:
            call.read_pixels(column, row, side, side, _RED_INTEGER, _INTS32, ids.ctypes.data)
        call.bind_framebuffer(_FRAMEBUFFER, 0)
        self._gl.check()
        return depths, ids

    def release(self) -> None:
        """Give the memory back; calling it again does nothing."""
        if self._framebuffer.value:
            self._call.delete_framebuffers(1, ctypes.byref(self._framebuffer))
            self._framebuffer = UINT(0)
        if self._depth.value:
            self._call.delete_textures(1, ctypes.byref(self._depth))
            self._depth = UINT(0)
        if self._ids is not None:
            self._ids.release()
            self._ids = None
