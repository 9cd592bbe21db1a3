"""Closed surfaces that turn inside out where they cross themselves: found by looking at them from all around."""

import numpy as np

from zbuf_occlude.arrays import BoolArray, FloatArray
from zbuf_occlude.gl.atlas import NO_FACE
from zbuf_occlude.gl.buffers import Buffers
from zbuf_occlude.gl.context import GlContext
from zbuf_occlude.gl.depth_pass import MOST_TILES, DepthPass
from zbuf_occlude.gl.mesh_data import MeshArrays
from zbuf_occlude.gl.tiles import TILE, arrange_tiles, single_pictures

RESOLUTION = 128

DISTANCE = 4.0
"""Of the eyes; unit space, where the mesh's diagonal is at most 1."""

MOST_PIXELS, MOST_SHARE = 2, 1e-3
"""Pixels and share of a surface's pixels that may show its inside and mean nothing: a pixel's centre on a silhouette
may see either side."""


def directions() -> FloatArray:
    """Return 14 directions, (14, 3): of a cube's faces and corners, turned so that few faces are seen edge on."""
    axes = np.concatenate([np.eye(3), -np.eye(3)])
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) / np.sqrt(3.0)
    a, b, c = 0.1, 0.2, 0.3
    turn = np.array([[0, -c, b], [c, 0, -a], [-b, a, 0]])
    rotation = np.linalg.solve(np.eye(3) + turn, np.eye(3) - turn)  # Cayley's transform
    return np.asarray(np.concatenate([axes, corners]) @ rotation)


def inside_out(gl: GlContext, arrays: MeshArrays, buffers: Buffers) -> BoolArray:
    """Say of which closed surfaces an eye outside sees the inside.

    Parameters
    ----------
    gl : GlContext
    arrays : MeshArrays
    buffers : Buffers
        `depth_pass.mesh_buffers` of it.

    Returns
    -------
    (s,) bool, by the number of the surface; False for those that are not closed.
    """
    eyes = DISTANCE * directions()
    _, pictures = single_pictures(eyes, arrays.positions, RESOLUTION)
    depth_pass = DepthPass(gl, buffers, RESOLUTION, ids=True, tiles_an_eye=1, most_eyes=len(eyes))
    try:
        tiles = np.zeros(MOST_TILES, dtype=TILE)
        tiles[: len(eyes)] = arrange_tiles(pictures, RESOLUTION, depth_pass.atlas.columns, len(eyes))
        with Buffers(gl.ctx, tiles=tiles) as matrices:
            matrices.bind_uniforms("tiles", 0, offset=0, size=tiles.nbytes)
            depth_pass.draw(len(eyes))
            seen = np.stack([depth_pass.atlas.read(i)[1].reshape(-1) for i in range(len(eyes))])
    finally:
        depth_pass.release()
    gl.check()
    eye, pixel = np.nonzero((seen != NO_FACE) & (seen < arrays.n_closed))
    face = seen[eye, pixel]
    a, b, c = arrays.positions[arrays.faces[face].T]
    from_inside = (np.cross(b - a, c - a) * (eyes[eye] - a)).sum(axis=1) < 0.0
    n_surfaces = int(arrays.surfaces.max()) + 1
    pixels = np.bincount(arrays.surfaces[face], minlength=n_surfaces)
    wrong = np.bincount(arrays.surfaces[face[from_inside]], minlength=n_surfaces)
    return np.asarray(wrong > MOST_PIXELS + MOST_SHARE * pixels)
