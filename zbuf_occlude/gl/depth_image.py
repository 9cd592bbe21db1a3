"""One depth image of a mesh, read back to look at."""

import numpy as np

from zbuf_occlude.arrays import FloatArray
from zbuf_occlude.geometry.camera import picture_frusta, rigid_matrices
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.gl.buffers import Buffers
from zbuf_occlude.gl.context import GlContext
from zbuf_occlude.gl.depth_pass import MOST_TILES, DepthPass, mesh_buffers
from zbuf_occlude.gl.exact_data import Unit
from zbuf_occlude.gl.tiles import TILE, arrange_tiles, reversed_depth
from zbuf_occlude.views import Views


def render_depth(gl: GlContext, mesh: Mesh, view: Views, size: int) -> FloatArray:
    """Render a mesh's depth as one camera sees it.

    Parameters
    ----------
    gl : GlContext
    mesh : Mesh
    view : Views
        One view, distance in world units; its picture is its window, or holds the mesh.
    size : int
        Pixels along a side. Pixels are square; of a picture that is not, its middle is the image's.

    Returns
    -------
    (size, size) float64
        Eye depth (along the camera's axis) at the pixels' centres, world units, the highest row first;
        infinite where nothing is.

    Raises
    ------
    ArgumentError
        The eye is within the mesh's bounding box, or so near that no single picture holds the mesh.
    """
    gl.make_current()
    unit = Unit.of(mesh.centre, mesh.diagonal)
    used, faces = np.unique(mesh.faces, return_inverse=True)
    positions = unit.to(mesh.vertices[used])
    eyes = unit.to(view.eyes)
    views = rigid_matrices(view.poses[:, :3, :3], eyes)
    frusta = picture_frusta(views, positions, view.windows)
    cameras = reversed_depth(views, frusta)
    with mesh_buffers(gl, positions, faces.reshape(-1, 3).astype(np.int32)) as mesh_on_gpu:
        depth_pass = DepthPass(gl, mesh_on_gpu, size, ids=False, tiles_per_eye=1)
        try:
            tiles = np.zeros(MOST_TILES, dtype=TILE)
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
