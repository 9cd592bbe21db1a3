"""The mesh drawn into a depth atlas: many cameras a draw."""

from typing import Any

import numpy as np

from zbuf_occlude.arrays import FloatArray, IntArray
from zbuf_occlude.gl.atlas import Atlas
from zbuf_occlude.gl.buffers import Buffers
from zbuf_occlude.gl.context import GlContext
from zbuf_occlude.gl.point_data import GROUP
from zbuf_occlude.gl.point_pass import set_uniforms
from zbuf_occlude.gl.tiles import CUBE

MOST_TILES = 48
"""Of a batch: eight eyes with six cube faces each; their matrices fit into a uniform block on any driver."""

SOFTWARE_BYTES, HARDWARE_BYTES = 1 << 24, 1 << 28
"""What an atlas may take: caches, and memory touched first, matter to a CPU; full batches to a GPU. One eye's tiles may
exceed it."""


class DepthPass:
    """A mesh on the GPU, and the atlas it is drawn into.

    Parameters
    ----------
    gl : GlContext
    buffers : Buffers
        The mesh (`mesh_buffers`), which stays the caller's.
    resolution : int
        Pixels along a tile's side.
    ids : bool
        Whether the atlas keeps the id of the nearest face beside the depth.
    tiles_per_eye : int
        1, or `CUBE`.

    Notes
    -----
    GPU memory: `SOFTWARE_BYTES` or `HARDWARE_BYTES`, or what one eye takes: 4 bytes per pixel, 8 with ids.
    """

    def __init__(
        self,
        gl: GlContext,
        buffers: Buffers,
        resolution: int,
        *,
        ids: bool,
        tiles_per_eye: int,
    ) -> None:
        self._gl = gl
        budget = (SOFTWARE_BYTES if gl.is_software else HARDWARE_BYTES) // (resolution**2 * (8 if ids else 4))
        eyes = int(np.clip(budget, tiles_per_eye, MOST_TILES)) // tiles_per_eye
        self.n_eyes = eyes // GROUP * GROUP if eyes > GROUP else eyes
        """Eyes of a batch."""
        self._program = gl.program(
            "depth.vert", "depth.frag", TILES=MOST_TILES, FACES=int(ids), CUBE=int(tiles_per_eye == CUBE)
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
        """Draw the mesh into the first tiles, by the matrices bound to uniform block 0."""
        width, height = self.atlas.size
        set_uniforms(self._program, to_ndc=(2.0 / width, 2.0 / height), side=float(self.atlas.resolution))
        self.atlas.draw(n_tiles, lambda: self._drawn.render(instances=n_tiles), clip=self._tiles_per_eye == CUBE)

    def release(self) -> None:
        """Give the GPU's memory back; calling it again does nothing."""
        if self._drawn is not None:
            self._drawn.release()
        self.atlas.release()


def mesh_buffers(gl: GlContext, positions: FloatArray, faces: IntArray) -> Buffers:
    """Put a mesh on the GPU: `vertices` and `indices` to draw, `corners` (f, 3, 4) for shaders to test.

    Takes 12 bytes per vertex and 72 bytes per face. A flat shader input takes the value of a face's last vertex, so
    each face gets one of its own: the first f vertices, in the faces' order.
    """
    positions = positions.astype(np.float32)
    corners = np.zeros((len(faces), 3, 4), dtype=np.float32)
    corners[:, :, :3] = positions[faces]
    vertices = np.concatenate([corners[:, 2, :3], positions])
    indices = faces.astype(np.int32) + np.int32(len(faces))
    indices[:, 2] = np.arange(len(faces))
    return Buffers(gl, vertices=vertices, indices=indices, corners=corners)
