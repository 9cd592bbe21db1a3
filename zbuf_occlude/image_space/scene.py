"""The mesh as the kernels see it: float32 coordinates about its centre, 16 faces a row, boxes in levels of 16."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.arrays import FloatArray, IntArray
from zbuf_occlude.image_space.clusters import WIDTH, make_clusters
from zbuf_occlude.mesh import Mesh

Float32 = NDArray[np.float32]

TOP = 128
"""Levels of nodes are added until the top one has at most so many."""

WEAK = 1e-6
"""A face whose normal is shorter than this times its longest edge squared has no float32 plane: float64 decides it."""


class Scene(NamedTuple):
    """A prepared mesh. Scene space is world space moved and scaled so that the mesh fits into the unit sphere.

    Parameters
    ----------
    centre : (3,) float64, world space
    scale : float
        Scene units per world unit.
    contact : float
        The contact tolerance, scene units.
    corners : (m clusters, 3 corners, 3 axes, 16 faces) float32, scene space
    planes : (m, 4, 16) float32
        Unit normal and offset of each face: ``n . p = offset`` on it.
    used, weak : (m,) int64
        Masks of the rows' faces: which there are, and which have no float32 plane (`WEAK`).
    face_ids : (m, 16) int32
    nodes : (6, total) float32
        Lower and upper corners of the nodes' boxes, level after level, each level padded to a multiple of 16.
        Level 0 are the clusters; node i of a level is the parent of nodes 16 i to 16 i + 15 of the level below.
    level_starts, level_counts : (n_levels,) int64
    world_corners : (f, 3, 3) float64, world space
    world_contact : float
    lower, upper : (m, 3) float64
        Boxes of the clusters, world space.
    """

    centre: FloatArray
    scale: float
    contact: float
    corners: Float32
    planes: Float32
    used: NDArray[np.int64]
    weak: NDArray[np.int64]
    face_ids: IntArray
    nodes: Float32
    level_starts: NDArray[np.int64]
    level_counts: NDArray[np.int64]
    world_corners: FloatArray
    world_contact: float
    lower: FloatArray
    upper: FloatArray


def make_scene(mesh: Mesh, contact: float) -> Scene:
    """Prepare a mesh; `contact` is the contact tolerance in world units.

    Notes
    -----
    O(f log f) time, about 500 bytes a face.
    """
    clusters = make_clusters(mesh)
    centre = mesh.centre
    scale = 2.0 / mesh.diagonal if mesh.diagonal > 0 else 1.0
    used = clusters.face_ids >= 0
    rows = np.where(used, clusters.face_ids, 0)
    corners = (mesh.corners[rows] - centre) * scale  # (m, 16, 3, 3)
    normals, weak = _unit_normals(corners)
    offsets = (normals * corners.mean(axis=2)).sum(axis=-1, keepdims=True)
    nodes, starts, counts = _levels((clusters.lower - centre) * scale, (clusters.upper - centre) * scale)
    return Scene(
        centre,
        scale,
        contact * scale,
        np.ascontiguousarray(np.moveaxis(corners, 1, 3), dtype=np.float32),
        np.ascontiguousarray(np.moveaxis(np.concatenate([normals, offsets], axis=-1), 1, 2), dtype=np.float32),
        masks(used),
        masks(weak & used),
        clusters.face_ids,
        nodes,
        starts,
        counts,
        mesh.corners,
        contact,
        clusters.lower,
        clusters.upper,
    )


def _unit_normals(corners: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Unit normals, and which of them float64 cannot vouch for."""
    a, b, c = (corners[..., i, :] for i in range(3))
    normals = np.cross(b - a, c - a)
    lengths = np.linalg.norm(normals, axis=-1, keepdims=True)
    longest_squared = np.maximum.reduce([((q - p) ** 2).sum(axis=-1) for p, q in ((a, b), (b, c), (c, a))])
    weak = lengths[..., 0] <= WEAK * longest_squared
    return np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0), weak


def masks(bools: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Make masks of the rows of (m, 16) bool."""
    return np.asarray((bools << np.arange(WIDTH)).sum(axis=1), dtype=np.int64)


def _levels(lower: FloatArray, upper: FloatArray) -> tuple[Float32, NDArray[np.int64], NDArray[np.int64]]:
    """Stack the boxes of all levels, rounded outwards to float32."""
    levels, counts = [], []
    while True:
        counts.append(len(lower))
        padding = ((0, -len(lower) % WIDTH), (0, 0))
        lower = np.pad(lower, padding, constant_values=np.inf)
        upper = np.pad(upper, padding, constant_values=-np.inf)
        levels.append(np.concatenate([lower, upper], axis=1).T)
        if counts[-1] <= TOP:
            break
        lower = lower.reshape(-1, WIDTH, 3).min(axis=1)
        upper = upper.reshape(-1, WIDTH, 3).max(axis=1)
    nodes = np.concatenate(levels, axis=1)
    # padding is never reached, only projected
    nodes = np.ascontiguousarray(np.where(np.isfinite(nodes), nodes, 0.0), dtype=np.float32)
    nodes[:3] = np.nextafter(nodes[:3], np.float32(-np.inf))
    nodes[3:] = np.nextafter(nodes[3:], np.float32(np.inf))
    sizes = [level.shape[1] for level in levels]
    return nodes, np.cumsum([0, *sizes[:-1]], dtype=np.int64), np.asarray(counts, dtype=np.int64)
