"""Clusters: up to 16 faces that are near each other, and the boxes around them, level over level."""

from dataclasses import dataclass

import numpy as np

from zbuf_occlude.arrays import FloatArray, IntArray
from zbuf_occlude.hilbert import hilbert_order
from zbuf_occlude.mesh import Mesh

WIDTH = 16
"""Faces of a cluster, and children of a node: the lanes of the vectors that test them."""

LARGE = 0.125
"""Faces longer than this fraction of the mesh's longest side are grouped among themselves."""


@dataclass(frozen=True)
class Clusters:
    """The faces of a mesh in groups of `WIDTH`.

    Parameters
    ----------
    face_ids : (m, 16) int32
        Faces of each cluster; -1 where there is none. Faces whose normal is exactly zero are left out: by definition
        (`zbuf_occlude.predicates.blocks`) they block nothing.
    lower, upper : (m, 3) float64
        Box around each cluster, world space.
    """

    face_ids: IntArray
    lower: FloatArray
    upper: FloatArray


def make_clusters(mesh: Mesh) -> Clusters:
    """Group the faces of a mesh: long ones apart, the others in Hilbert order of their centres.

    Notes
    -----
    A long face among short ones would blow up the box of its cluster; in a cluster of its kind it does no harm.
    O(f log f) time, 180 bytes a face.
    """
    corners = mesh.corners
    lower, upper = corners.min(axis=1), corners.max(axis=1)
    long = (upper - lower).max(axis=1) > LARGE * mesh.longest_side
    order = hilbert_order((lower + upper) / 2.0).astype(np.int32)
    blocking = (mesh.face_normals != 0.0).any(axis=1)
    groups = [_rows(order[(blocking & kind)[order]]) for kind in (long, ~long)]
    face_ids = np.concatenate(groups)
    used = face_ids >= 0
    return Clusters(
        face_ids,
        np.where(used[..., None], lower[face_ids], np.inf).min(axis=1),
        np.where(used[..., None], upper[face_ids], -np.inf).max(axis=1),
    )


def _rows(faces: IntArray) -> IntArray:
    """Cut ordered faces into rows of `WIDTH`, the last filled up with -1."""
    rows = np.full((-(-len(faces) // WIDTH), WIDTH), -1, dtype=np.int32)
    rows.reshape(-1)[: len(faces)] = faces
    return rows
