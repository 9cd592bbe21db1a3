"""What the depth buffer needs of a mesh, as arrays: faces in the order of drawing."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.arrays import FloatArray, IntArray
from zbuf_occlude.geometry.hilbert import hilbert_order
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.gl.exact_data import Unit


@dataclass(frozen=True)
class MeshArrays:
    """A mesh to be drawn.

    Attributes
    ----------
    positions : (v, 3) float64
        Unit space; only vertices in use.
    faces : (f, 3) int32
        In the order of drawing, which is along a space-filling curve so that tiles stay in caches; indices into
        `positions`.
    places : (f,) int32
        Where each of the mesh's faces is in the order of drawing.
    normals : (f, 3) float32
        Of the mesh's faces, unit length; 0 where a face has no area.
    """

    positions: FloatArray
    faces: IntArray
    places: IntArray
    normals: NDArray[np.float32]


def arrange_mesh(mesh: Mesh, unit: Unit) -> MeshArrays:
    """Arrange a mesh for drawing."""
    used = np.zeros(len(mesh.vertices), dtype=bool)
    used[mesh.faces] = True
    indices = np.cumsum(used, dtype=np.int32) - np.int32(1)  # of the vertices in use, in their order
    order = hilbert_order(mesh.corners.mean(axis=1))
    places = np.empty(len(order), dtype=np.int32)
    places[order] = np.arange(len(order))
    lengths = np.linalg.norm(mesh.face_normals, axis=1, keepdims=True)
    normals = np.divide(mesh.face_normals, lengths, out=np.zeros_like(mesh.face_normals), where=lengths > 0.0)
    return MeshArrays(
        positions=unit.to(mesh.vertices[used]),
        faces=indices[mesh.faces[order]],
        places=places,
        normals=normals.astype(np.float32),
    )
