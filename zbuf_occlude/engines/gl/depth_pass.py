"""Depth pass: the mesh drawn into an atlas of depth tiles, many cameras per draw; and single depth images."""

import ctypes
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.base.arrays import FloatArray, IntArray
from zbuf_occlude.base.errors import GlError
from zbuf_occlude.engines.gl.buffers import Buffers
from zbuf_occlude.engines.gl.context import FLOAT, INT, UINT, GlContext
from zbuf_occlude.engines.gl.shaders import set_uniforms
from zbuf_occlude.engines.gl.tiles import CUBE, EYES_PER_BYTE, TILE, Unit, arrange_tiles, reversed_depth
from zbuf_occlude.geometry.camera import picture_frusta, rigid_matrices
from zbuf_occlude.geometry.hilbert import hilbert_order
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.views import Views

MAX_TILES = 48
"""Maximum tiles of a batch, eight eyes with six cube faces each; their matrices fit into a uniform block on any
driver."""

SOFTWARE_BYTES, HARDWARE_BYTES = 1 << 24, 1 << 28
"""Memory budget of an atlas: small for a CPU, for the sake of its caches; large for a GPU, for full batches. The tiles
of a single eye may exceed it."""

NO_FACE = -1

# names of the OpenGL registry
_TEXTURE_2D, _TEXTURE0, _NEAREST = 0x0DE1, 0x84C0, 0x2600
_MIN_FILTER, _MAG_FILTER = 0x2801, 0x2800
_WRAP_S, _WRAP_T, _CLAMP_TO_EDGE = 0x2802, 0x2803, 0x812F
_DEPTH_COMPONENT32F, _DEPTH_COMPONENT = 0x8CAC, 0x1902
_FRAMEBUFFER, _DEPTH_ATTACHMENT, _COLOR_ATTACHMENT0 = 0x8D40, 0x8D00, 0x8CE0
_DEPTH, _COLOR, _NONE = 0x1801, 0x1800, 0
_RED_INTEGER, _INTS32, _FLOATS32 = 0x8D94, 0x1404, 0x1406
_SCISSOR_TEST, _CLIP_DISTANCES = 0x0C11, (0x3000, 0x3001, 0x3002, 0x3003)
_LOWER_LEFT, _NEGATIVE_ONE_TO_ONE, _ZERO_TO_ONE = 0x8CA1, 0x935E, 0x935F


@dataclass(frozen=True)
class MeshArrays:
    """Arrays of a mesh to be drawn, in the order of a space-filling curve so that tiles stay in caches."""

    positions: FloatArray  # (v, 3) unit space; only vertices in use
    faces: IntArray  # (f, 3) in drawing order
    ranks: IntArray  # (f,) position of each of the mesh's faces in drawing order
    normals: NDArray[np.float32]  # (f, 3) unit normals of the mesh's faces; 0 for a face without area


def arrange_mesh(mesh: Mesh, unit: Unit) -> MeshArrays:
    """Arrange a mesh for drawing."""
    used = np.zeros(len(mesh.vertices), dtype=bool)
    used[mesh.faces] = True
    indices = np.cumsum(used, dtype=np.int32) - np.int32(1)  # of each vertex among those in use
    order = hilbert_order(mesh.corners.mean(axis=1))
    ranks = np.empty(len(order), dtype=np.int32)
    ranks[order] = np.arange(len(order))
    lengths = np.linalg.norm(mesh.face_normals, axis=1, keepdims=True)
    normals = np.divide(mesh.face_normals, lengths, out=np.zeros_like(mesh.face_normals), where=lengths > 0.0)
    return MeshArrays(
        positions=unit.to(mesh.vertices[used]),
        faces=indices[mesh.faces[order]],
        ranks=ranks,
        normals=normals.astype(np.float32),
    )


def mesh_buffers(gl: GlContext, mesh: MeshArrays) -> Buffers:
    """Upload a mesh to the GPU: `vertices` and `indices` for drawing, `corners` (f, 3, 4) for tests in shaders.

    Takes 12 bytes per vertex and 72 bytes per face. A flat shader input has the value of a face's last vertex, so each
    face gets a last vertex of its own: the first f vertices, in drawing order.
    """
    positions, n_faces = mesh.positions.astype(np.float32), len(mesh.faces)
    corners = np.zeros((n_faces, 3, 4), dtype=np.float32)
    corners[:, :, :3] = positions[mesh.faces]
    vertices = np.concatenate([corners[:, 2, :3], positions])
    indices = mesh.faces + np.int32(n_faces)
    indices[:, 2] = np.arange(n_faces)
    return Buffers(gl, vertices=vertices, indices=indices, corners=corners)


class Atlas:
    """Depth buffer of square tiles, with the id of the nearest face beside each depth if `faces` is True.

    Depth is reversed (`tiles.Pictures`), in 32-bit floats. moderngl offers neither such textures nor reversed depth, so
    this class calls OpenGL directly. Takes 4 bytes per pixel, 8 with faces.
    """

    def __init__(self, gl: GlContext, resolution: int, n_tiles: int, *, faces: bool) -> None:
        self.resolution, self.n_tiles, self.faces = resolution, n_tiles, faces
        largest = int(gl.info["GL_MAX_TEXTURE_SIZE"]) // resolution
        # as few columns as possible: pixels that are near in a tile are then near in memory
        self.columns = -(-n_tiles // max(largest, 1))
        rows = -(-n_tiles // self.columns)
        if max(self.columns, rows) > largest:
            raise GlError(f"{n_tiles} tiles of {resolution} pixels do not fit into a texture of {gl.renderer}.")
        self.size = (self.columns * resolution, rows * resolution)
        self._gl, self._call = gl, gl.call
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
        width, height = self.size
        self._gl.check(f"a depth atlas of {width} x {height} pixels must fit into memory", "Take a lower resolution.")

    def _bind(self, unit: int, texture: Any) -> None:
        self._call.active_texture(unit)
        self._call.bind_texture(_TEXTURE_2D, texture)

    def draw(self, n_tiles: int, render: Callable[[], None], *, clip: bool) -> None:
        """Clear the first tiles and call `render` to draw into them; `clip`: the shader writes four clip distances."""
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
        """Bind the depths and, if any, the face ids to texture units."""
        self._bind(_TEXTURE0 + depths, self._depth)
        if self.faces:
            self._ids.use(faces)

    def read(self, tile: int) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
        """Read back depths and face ids of a tile, (resolution, resolution) each, the lowest row first."""
        side, call = self.resolution, self._call
        depths, ids = np.empty((side, side), np.float32), np.full((side, side), NO_FACE, np.int32)
        row, column = (side * index for index in divmod(tile, self.columns))
        call.bind_framebuffer(_FRAMEBUFFER, self._framebuffer)
        call.read_pixels(column, row, side, side, _DEPTH_COMPONENT, _FLOATS32, depths.ctypes.data)
        if self.faces:
            call.read_pixels(column, row, side, side, _RED_INTEGER, _INTS32, ids.ctypes.data)
        call.bind_framebuffer(_FRAMEBUFFER, 0)
        self._gl.check()
        return depths, ids

    def release(self) -> None:
        """Free the memory; calling it again does nothing."""
        self._call.delete_framebuffers(1, ctypes.byref(self._framebuffer))  # OpenGL ignores 0
        self._call.delete_textures(1, ctypes.byref(self._depth))
        self._depth, self._framebuffer = UINT(0), UINT(0)
        if self._ids is not None:
            self._ids.release()
            self._ids = None


class DepthPass:
    """Pass that draws a mesh (`mesh_buffers`, owned by the caller) for many cameras at once, 1 or `CUBE` per eye.

    With `ids` the atlas keeps the nearest face beside the depth.
    """

    def __init__(self, gl: GlContext, buffers: Buffers, resolution: int, *, ids: bool, tiles_per_eye: int) -> None:
        budget = (SOFTWARE_BYTES if gl.is_software else HARDWARE_BYTES) // (resolution**2 * (8 if ids else 4))
        eyes = int(np.clip(budget, tiles_per_eye, MAX_TILES)) // tiles_per_eye
        self.n_eyes = eyes // EYES_PER_BYTE * EYES_PER_BYTE if eyes > EYES_PER_BYTE else eyes
        """Number of eyes of a batch."""
        self._program = gl.program(
            "depth.vert", "depth.frag", TILES=MAX_TILES, FACES=int(ids), CUBE=int(tiles_per_eye == CUBE)
        )
        self.atlas = Atlas(gl, resolution, self.n_eyes * tiles_per_eye, faces=ids)
        self._tiles_per_eye = tiles_per_eye
        self._drawn: Any = None
        try:
            self._drawn = buffers.vertex_array(self._program, "vertices", "indices")
        except BaseException:
            self.release()
            raise

    def draw(self, n_tiles: int) -> None:
        """Draw the mesh into the first tiles, with the matrices bound to uniform block 0."""
        width, height = self.atlas.size
        set_uniforms(self._program, to_ndc=(2.0 / width, 2.0 / height), side=float(self.atlas.resolution))
        self.atlas.draw(n_tiles, lambda: self._drawn.render(instances=n_tiles), clip=self._tiles_per_eye == CUBE)

    def release(self) -> None:
        """Free the GPU's memory; calling it again does nothing."""
        if self._drawn is not None:
            self._drawn.release()
        self.atlas.release()


def render_depth(gl: GlContext, mesh: Mesh, view: Views, size: int) -> FloatArray:
    """Render the depth image of a mesh from one camera.

    Parameters
    ----------
    gl : GlContext
    mesh : Mesh
    view : Views
        One view, distance in world units. The picture is its field of view, or fitted to the mesh.
    size : int
        Pixels along a side. Pixels are square; a picture that is not square is centred in the image.

    Returns
    -------
    (size, size) float64
        Eye depth (along the camera's axis) at the pixels' centres, world units, the highest row first; infinite for the
        background.

    Raises
    ------
    ArgumentError
        The eye is within the mesh's bounding box, or so near that no single picture holds the mesh.
    """
    gl.make_current()
    unit = Unit.from_box(mesh.centre, mesh.diagonal)
    arrays = arrange_mesh(mesh, unit)
    views = rigid_matrices(view.poses[:, :3, :3], unit.to(view.eyes))
    cameras = reversed_depth(views, picture_frusta(views, arrays.positions, view.fov_bounds))
    with mesh_buffers(gl, arrays) as mesh_on_gpu:
        depth_pass = DepthPass(gl, mesh_on_gpu, size, ids=False, tiles_per_eye=1)
        try:
            tiles = np.zeros(MAX_TILES, dtype=TILE)
            tiles[:1] = arrange_tiles(cameras, size, depth_pass.atlas.columns, 1)
            with Buffers(gl, tiles=tiles) as buffers:
                buffers.bind_uniforms("tiles", 0, offset=0, size=tiles.nbytes)
                depth_pass.draw(1)
                depths = depth_pass.atlas.read(0)[0].astype(np.float64)
        finally:
            depth_pass.release()
    gl.check()
    near, far = cameras.frusta.near[0], cameras.frusta.far[0]
    eye_depth = cameras.gains[0] / (depths + near / (far - near))
    return np.asarray(np.where(depths > 0.0, eye_depth / unit.scale, np.inf)[::-1])
