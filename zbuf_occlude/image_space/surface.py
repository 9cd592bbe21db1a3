"""The mesh's surface as the kernels follow it: which faces lie beside each other, and at which edges it may fold."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.arrays import FloatArray, IntArray
from zbuf_occlude.image_space.backs import Solids
from zbuf_occlude.image_space.scene import Float32, Scene, masks
from zbuf_occlude.solids.buried import WHOLE


class Surface(NamedTuple):
    """Faces are named by their rows, 16 x cluster + lane.

    Parameters
    ----------
    outer, inner : (m,) int64
        Masks of the clusters' faces whose normal looks to one and to the other side of their surface; to neither where
        it has one side only, or the face is `Scene.weak`. Outer is outside where the surface bounds a solid.
    solid : (m,) int64
        Masks of the faces that bound solids.
    buried : (m,) int64
        Masks of the faces inside other solids.
    clear, fenced : (m,) int64
        Masks of those that are not, and that visibility may be followed over, without and with barriers; see `regions`.
    barrier_starts : (16 m + 1,) int32
        Those of a row are the barriers from one number here to the next.
    barriers : (b, 7) float32
        Both ends and the radius of each, scene space.
    vertices : (16 m, 3) int32
        Numbers of the positions of the faces' corners, less than `n_vertices`.
    n_vertices : int
    neighbours : (16 m, 3) int32
        The faces across the edges that exactly two share; -1 where there is none.
    edges : (n, 2) int32
        The edges of the faces that block anything, but for those of buried ones alone: the two that share it, -1 for
        the second where not exactly two do.
    edge_vertices : (n, 2) int32
        Numbers of their ends, as in `vertices`.
    ends : (n, 2, 3) float32
        Where the edges begin and end, scene space.
    records : (16 m, 20) float64
        As in `Solids`.
    """

    outer: NDArray[np.int64]
    inner: NDArray[np.int64]
    solid: NDArray[np.int64]
    buried: NDArray[np.int64]
    clear: NDArray[np.int64]
    fenced: NDArray[np.int64]
    barrier_starts: IntArray
    barriers: Float32
    vertices: IntArray
    n_vertices: int
    neighbours: IntArray
    edges: IntArray
    edge_vertices: IntArray
    ends: Float32
    records: FloatArray


def no_surface(scene: Scene) -> Surface:
    """Return what is known before solids are looked for: nothing."""
    none, no_rows = np.zeros(len(scene.used), dtype=np.int64), np.zeros((0, 3), dtype=np.int32)
    return Surface(
        none,
        none,
        none,
        none,
        none,
        none,
        np.zeros(1, dtype=np.int32),
        np.zeros((0, 7), dtype=np.float32),
        no_rows,
        0,
        no_rows,
        np.zeros((0, 2), dtype=np.int32),
        np.zeros((0, 2), dtype=np.int32),
        np.zeros((0, 2, 3), dtype=np.float32),
        np.zeros((0, 20)),
    )


def make_surface(scene: Scene, rows: IntArray, solids: Solids) -> Surface:
    """Bring what is known of a mesh's surface into the scene's order; `rows` (f + 1,) leads from a face to its row."""
    there, strong = scene.face_ids >= 0, ~scene.weak
    sides = np.where(there, solids.sides[scene.face_ids], 0)
    n_barriers = np.where(there, np.diff(solids.barrier_starts)[scene.face_ids], 0)
    barriers = _in_order(scene, solids, n_barriers)
    of_row = scene.face_ids.reshape(-1)
    across = np.where(solids.twins >= 0, rows[solids.twins // 3], -1).reshape(-1, 3)
    # of each pair of half-edges one, and all whose twin is none, or of a face that blocks nothing and so has no row
    half = np.flatnonzero((solids.twins < np.arange(len(solids.twins))) | (across.reshape(-1) < 0))
    half = half[rows[half // 3] >= 0]
    buried = solids.buried == WHOLE
    beside = solids.twins[half] // 3
    half = half[~(buried[half // 3] & ((solids.twins[half] < 0) | buried[beside]))]
    corners = (scene.world_corners - scene.centre) * scene.scale
    return Surface(
        masks(sides > 0) & strong,
        masks(sides < 0) & strong,
        masks(there & (solids.outward[scene.face_ids] != 0)),
        masks(there & buried[scene.face_ids]),
        masks(there & solids.clear[scene.face_ids] & ~buried[scene.face_ids]) & strong,
        masks(n_barriers > 0) & strong,
        np.concatenate([[0], np.cumsum(n_barriers)]).astype(np.int32),
        barriers,
        solids.vertices[of_row],
        int(solids.vertices.max()) + 1,
        np.where(there.reshape(-1, 1), across[of_row], -1).astype(np.int32),
        np.stack([rows[half // 3], across.reshape(-1)[half]], axis=1).astype(np.int32),
        np.stack([solids.vertices[half // 3, half % 3], solids.vertices[half // 3, (half + 1) % 3]], axis=1),
        np.stack([corners[half // 3, half % 3], corners[half // 3, (half + 1) % 3]], axis=1).astype(np.float32),
        solids.records[of_row],
    )


def _in_order(scene: Scene, solids: Solids, counts: NDArray[np.int64]) -> Float32:
    """The barriers, row after row, of which each has so many."""
    counts = counts.reshape(-1)
    first = np.repeat(solids.barrier_starts[scene.face_ids.reshape(-1)] - (np.cumsum(counts) - counts), counts)
    which = first + np.arange(counts.sum())
    unit = 2.0  # a diagonal, in scene units
    ends = unit * solids.barrier_ends[which].reshape(-1, 6)
    return np.concatenate([ends, unit * solids.barrier_radii[which, None]], axis=1).astype(np.float32)
