"""What the depth buffer needs of a mesh, as arrays: faces in the order of drawing, those of solids first."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.arrays import BoolArray, FloatArray, IntArray
from zbuf_occlude.gl.exact_data import Unit
from zbuf_occlude.hilbert import hilbert_order
from zbuf_occlude.mesh import Mesh
from zbuf_occlude.solids.closed import ClosedSurfaces


@dataclass(frozen=True)
class MeshArrays:
    """A mesh to be drawn.

    Attributes
    ----------
    positions : (v, 3) float64
        Unit space; only vertices in use.
    faces : (f, 3) int32
        In the order of drawing, indices into `positions`: those of closed surfaces first, wound counterclockwise as
        seen from outside, then the others; each part along a space-filling curve, so that tiles stay in caches.
    n_closed : int
        How many come first.
    places : (f,) int32
        Where each of the mesh's faces is in the order of drawing.
    normals : (f, 3) float32
        Of the mesh's faces, unit length; outwards where the surface is closed.
    closed : (f,) bool
        Of the mesh's faces, whether the surface is closed.
    """

    positions: FloatArray
    faces: IntArray
    n_closed: int
    places: IntArray
    normals: NDArray[np.float32]
    closed: BoolArray


def arrange_mesh(mesh: Mesh, unit: Unit, surfaces: ClosedSurfaces) -> MeshArrays:
    """Arrange a mesh; its closed surfaces tell which faces may be left out when they are turned away."""
    used, indices = np.unique(mesh.faces, return_inverse=True)
    inwards = surfaces.outward < 0
    faces = indices.reshape(-1, 3).astype(np.int32)
    faces[inwards] = faces[inwards][:, [1, 0, 2]]
    closed = surfaces.outward != 0
    order = hilbert_order(mesh.corners.mean(axis=1))
    order = np.concatenate([order[closed[order]], order[~closed[order]]])
    places = np.empty(len(order), dtype=np.int32)
    places[order] = np.arange(len(order))
    lengths = np.linalg.norm(mesh.face_normals, axis=1, keepdims=True)
    normals = np.divide(mesh.face_normals, lengths, out=np.zeros_like(mesh.face_normals), where=lengths > 0.0)
    normals[inwards] *= -1.0
    return MeshArrays(
        positions=unit.to(mesh.vertices[used]),
        faces=faces[order],
        n_closed=int(closed.sum()),
        places=places,
        normals=normals.astype(np.float32),
        closed=closed,
    )
