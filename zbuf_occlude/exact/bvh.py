"""The mesh as the search takes it: float32 coordinates about its centre, 16 faces per row, boxes in levels of 16."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.arrays import FloatArray, IntArray
from zbuf_occlude.exact.clusters import make_clusters
from zbuf_occlude.exact.layout import CLUSTER, ROUNDOFF, UPPER
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.jit.compiler import inner, njit
from zbuf_occlude.jit.pointer import reference
from zbuf_occlude.jit.pool import shared, take, together
from zbuf_occlude.jit.vec3 import cross, dot, minus

Float32 = NDArray[np.float32]

TOP_NODES = 128
"""Levels of nodes are added until the top one has at most this many."""

WEAK_NORMAL = 1e-6
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
    face_ids : (m clusters, 16) int32
        The faces of each cluster, -1 where there is none. A face's *row* is 16 x cluster + its place here.
    rows : (f + 1,) int32
        The row of each face, -1 for those that cannot block; the last one, -1, is that of no face.
    corners : (m, 3 corners, 3 axes, 16 faces) float32, scene space
    planes : (m, 4, 16) float32
        Unit normal and offset of each face: ``n . p = offset`` on it.
    used, weak : (m,) int64
        Masks of the clusters' faces: which there are, and which have no float32 plane (`WEAK_NORMAL`).
    nodes : (6, total) float32
        Boxes of the nodes, level after level, each level padded to a multiple of 16. Level 0 are the clusters; node i
        of a level is the parent of nodes 16 i to 16 i + 15 of the level below.
    level_starts, level_counts : (n_levels,) int64
    world_corners : (f, 3, 3) float64, world space
    world_contact : float
    world_boxes : (m, 6) float64
        Lower and upper corners of the clusters' boxes, world space.
    """

    centre: FloatArray
    scale: float
    contact: float
    face_ids: IntArray
    rows: IntArray
    corners: Float32
    planes: Float32
    used: NDArray[np.int64]
    weak: NDArray[np.int64]
    nodes: Float32
    level_starts: NDArray[np.int64]
    level_counts: NDArray[np.int64]
    world_corners: FloatArray
    world_contact: float
    world_boxes: FloatArray


def make_scene(mesh: Mesh, contact: float) -> Scene:
    """Prepare a mesh; `contact` is the contact tolerance in world units. About 500 bytes per face."""
    scale = 2.0 / mesh.diagonal if mesh.diagonal > 0.0 else 1.0
    face_ids = make_clusters(mesh)
    m = len(face_ids)
    starts, counts = _level_sizes(m)
    scene = Scene(
        centre=np.array(mesh.centre),
        scale=scale,
        contact=contact * scale,
        face_ids=face_ids,
        rows=np.full(len(mesh.faces) + 1, -1, dtype=np.int32),
        corners=np.empty((m, 3, 3, CLUSTER), dtype=np.float32),
        planes=np.empty((m, 4, CLUSTER), dtype=np.float32),
        used=np.empty(m, dtype=np.int64),
        weak=np.empty(m, dtype=np.int64),
        nodes=np.zeros((6, starts[-1] + _padded(counts[-1])), dtype=np.float32),
        level_starts=starts,
        level_counts=counts,
        world_corners=mesh.corners,
        world_contact=contact,
        world_boxes=np.empty((m, 6)),
    )
    together(_fill_clusters, m, scene)
    _stack_levels(scene)
    return scene


def _padded(count: int) -> int:
    return -(-count // CLUSTER) * CLUSTER


def _level_sizes(n_clusters: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Where the levels of nodes start, and how many nodes each has."""
    counts = [n_clusters]
    while counts[-1] > TOP_NODES:
        counts.append(-(-counts[-1] // CLUSTER))
    starts = np.cumsum([0, *map(_padded, counts[:-1])])
    return starts.astype(np.int64), np.asarray(counts, dtype=np.int64)


@shared
def _fill_clusters(tasks, scene):
    """Fill in what a scene has of each cluster, and the rows of its faces."""
    scene_at = reference(scene)
    cluster = take(tasks)
    while cluster < len(scene.face_ids):
        _fill_cluster(scene_at, cluster)
        cluster = take(tasks)


@inner
def _fill_cluster(scene, cluster):
    used, weak = np.int64(0), np.int64(0)
    for lane in range(CLUSTER):
        face = scene.face_ids[cluster, lane]
        if face >= 0:
            used |= np.int64(1) << lane
            scene.rows[face] = cluster * CLUSTER + lane
        else:
            face = scene.face_ids[cluster, 0]  # anything finite
        weak |= np.int64(_fill_face(scene, cluster, lane, scene.world_corners[face])) << lane
    scene.used[cluster], scene.weak[cluster] = used, weak & used
    for axis in range(3):
        lower, upper = np.inf, -np.inf
        for lane in range(CLUSTER):
            face = scene.face_ids[cluster, lane]
            world = scene.world_corners[face if face >= 0 else scene.face_ids[cluster, 0]]
            lower = min(lower, world[0, axis], world[1, axis], world[2, axis])
            upper = max(upper, world[0, axis], world[1, axis], world[2, axis])
        scene.world_boxes[cluster, axis], scene.world_boxes[cluster, UPPER + axis] = lower, upper


@inner
def _fill_face(scene, cluster, lane, world):
    """Fill in a face's corners, unit normal and offset; return whether float64 cannot vouch for the normal."""
    a, b, c = _scene_corner(scene, world[0]), _scene_corner(scene, world[1]), _scene_corner(scene, world[2])
    u, v, w = minus(b, a), minus(c, b), minus(a, c)
    normal = cross(u, minus(c, a))
    length = np.sqrt(dot(normal, normal))
    inverse = 1.0 / length if length > 0.0 else 0.0
    offset = 0.0
    for axis in range(3):
        scene.corners[cluster, 0, axis, lane] = a[axis]
        scene.corners[cluster, 1, axis, lane] = b[axis]
        scene.corners[cluster, 2, axis, lane] = c[axis]
        scene.planes[cluster, axis, lane] = normal[axis] * inverse
        offset += normal[axis] * inverse * (a[axis] + b[axis] + c[axis])
    scene.planes[cluster, 3, lane] = offset / 3.0
    return length <= WEAK_NORMAL * max(dot(u, u), dot(v, v), dot(w, w))


@inner
def _scene_corner(scene, corner):
    return (
        (corner[0] - scene.centre[0]) * scene.scale,
        (corner[1] - scene.centre[1]) * scene.scale,
        (corner[2] - scene.centre[2]) * scene.scale,
    )


@njit(nogil=True, cache=True)
def _stack_levels(scene):
    """Fill in the boxes of all levels, rounded outwards; padding stays zero: it is projected, never reached."""
    outwards = np.float32(2.0) * ROUNDOFF
    for i in range(len(scene.world_boxes)):
        for axis in range(3):
            lower = (scene.world_boxes[i, axis] - scene.centre[axis]) * scene.scale
            upper = (scene.world_boxes[i, UPPER + axis] - scene.centre[axis]) * scene.scale
            scene.nodes[axis, i] = np.float32(lower) - outwards
            scene.nodes[UPPER + axis, i] = np.float32(upper) + outwards
    for level in range(1, len(scene.level_counts)):
        start, below = scene.level_starts[level], scene.level_starts[level - 1]
        for i in range(scene.level_counts[level]):
            first = CLUSTER * i
            last = min(first + CLUSTER, scene.level_counts[level - 1])
            for axis in range(3):
                lower, upper = scene.nodes[axis, below + first], scene.nodes[UPPER + axis, below + first]
                for child in range(below + first + 1, below + last):
                    lower = min(lower, scene.nodes[axis, child])
                    upper = max(upper, scene.nodes[UPPER + axis, child])
                scene.nodes[axis, start + i], scene.nodes[UPPER + axis, start + i] = lower, upper
