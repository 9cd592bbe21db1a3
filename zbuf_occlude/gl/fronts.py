"""The faces of solids that eyes see from before: where a CPU draws, the others need not even be looked at."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numba import prange
from numpy.typing import NDArray

from zbuf_occlude.arrays import FloatArray, IntArray
from zbuf_occlude.gl.buffers import Buffers, parts
from zbuf_occlude.gl.context import GlContext
from zbuf_occlude.threads import threaded

MOST_BYTES = 1 << 26
"""Of the indices of some eyes' faces. One eye's may exceed it."""

EDGE_ON = 1e-6
"""Faces whose plane the eye is behind by less than this, in diagonals, are kept: OpenGL decides."""


class ClosedFaces(NamedTuple):
    """The first m faces drawn, which need not be drawn where they are turned away.

    Parameters
    ----------
    corners : (m, 3, 3) float64
        Unit space, counterclockwise as seen from outside.
    indices : (m, 3) int32
        Their vertices (`depth_pass.vertices_of`).
    """

    corners: FloatArray
    indices: IntArray


class Fronts:
    """For each eye of a batch the indices of the faces that are not turned away.

    Parameters
    ----------
    gl : GlContext
    mesh : Buffers
        What `depth_pass.mesh_buffers` has made.
    program : moderngl.Program
    closed : ClosedFaces
    most_eyes : int
        Of a batch.

    Notes
    -----
    On a software renderer this saves a sixth of the drawing of 19,000 tiny faces, and next to nothing of a million.
    Up to `MOST_BYTES` on the GPU and as many beside it.
    """

    def __init__(self, gl: GlContext, mesh: Buffers, program: Any, closed: ClosedFaces, most_eyes: int) -> None:
        corners, indices = closed
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        lengths = np.linalg.norm(normals, axis=1, keepdims=True)
        normals = np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0.0)
        self._planes = np.concatenate([normals, (normals * corners[:, 0]).sum(axis=1, keepdims=True)], axis=1)
        self._indices = indices
        self._most = max(1, min(most_eyes, MOST_BYTES // indices.nbytes))
        self._fronts = np.empty((self._most, *indices.shape), dtype=np.int32)
        self._buffers = Buffers(gl.ctx, fronts=self._fronts.nbytes)
        try:
            self._drawn = mesh.vertex_array(program, "vertices", "fronts", self._buffers)
        except BaseException:
            self._buffers.release()
            raise

    def draw(self, eyes: FloatArray, begin: Callable[[int], None]) -> None:
        """Draw what each of the eyes (k, 3), unit space, sees from before; `begin(i)` is called before eye i's."""
        for some in parts(len(eyes), self._most):
            counts = find_fronts(self._planes, self._indices, eyes[some], self._fronts)
            self._buffers.write("fronts", self._fronts[: len(counts)])
            for i, count in enumerate(counts):
                begin(some.start + i)
                if count:
                    self._drawn.render(first=i * self._indices.size, vertices=3 * int(count))

    def release(self) -> None:
        """Give the GPU's memory back; calling it again does nothing."""
        self._drawn.release()
        self._buffers.release()


@threaded
def find_fronts(planes: FloatArray, indices: IntArray, eyes: FloatArray, fronts: IntArray) -> NDArray[np.int64]:
    """List the faces that are not turned away.

    Parameters
    ----------
    planes : (m, 4) float64
        Unit normals and offsets.
    indices : (m, 3) int32
    eyes : (k, 3) float64
    fronts : (at least k, m, 3) int32
        Receives the indices of each eye's faces, in their order.

    Returns
    -------
    (k,) int64
        How many there are.
    """
    counts = np.zeros(len(eyes), dtype=np.int64)
    for k in prange(len(eyes)):
        n = 0
        for face in range(len(planes)):
            a, b, c, offset = planes[face]
            if a * eyes[k, 0] + b * eyes[k, 1] + c * eyes[k, 2] >= offset - EDGE_ON:
                for j in range(3):
                    fronts[k, n, j] = indices[face, j]
                n += 1
        counts[k] = n
    return counts
