"""Rays, shared out among threads: those of one origin as what an eye there sees, others one by one.

Whoever gives one origin for all rays need not think of their order: they are sorted by their place in the image, and
neighbours share lists of clusters as the points of a search do.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from zbuf_occlude.arrays import FloatArray, IntArray
from zbuf_occlude.image_space.layout import (
    BOTTOM,
    CHUNK,
    CHUNK_POINTS,
    CLUSTER,
    COORDINATE_ERROR,
    LEFT,
    PACKET,
    RIGHT,
    TOP,
)
from zbuf_occlude.image_space.rays.packet import State, first_hits_of_packet, make_state, window_of
from zbuf_occlude.image_space.rays.places import sort_by_place
from zbuf_occlude.image_space.rays.single import Stack, first_hit
from zbuf_occlude.image_space.reference import reference
from zbuf_occlude.image_space.scene import Scene
from zbuf_occlude.image_space.scene.scene import Float32
from zbuf_occlude.image_space.search.listing import choose, list_clusters
from zbuf_occlude.image_space.search.project import project_boxes
from zbuf_occlude.image_space.search.search import project_nodes
from zbuf_occlude.image_space.search.workspace import Workspace, make_workspace
from zbuf_occlude.image_space.view import Views, make_views, view_of
from zbuf_occlude.lanes import inner
from zbuf_occlude.threads import shared, take, together

BLOCK_RAYS = CHUNK * CHUNK_POINTS
"""Rays that a thread takes at a time: a list of clusters is made for them, from which each `CHUNK_POINTS` choose."""

SINGLE_RAYS = 512
"""Rays that a thread takes at a time, in the caller's order, where they go one by one."""

FARTHEST_ORIGIN = 1e6
"""Scene units; rays from farther away go one by one."""

CLUSTERS_PER_RAY = 8
"""Fewer rays than a cluster per this many go one by one: an eye looks at all boxes of a scene."""


class Frame(NamedTuple):
    """What float64 needs of a frame: whether of a cube, its axis w, and 1 / the distance from the scene's centre."""

    inside: bool
    axis: FloatArray
    inverse_away: float


def find_first_hits(scene: Scene, origins: FloatArray, directions: FloatArray) -> tuple[IntArray, FloatArray]:
    """Return the first face that each ray meets, (n,) int32, and its eye distance, (n,) float64.

    Parameters
    ----------
    scene : Scene
    origins : (n, 3) or (1, 3) float64, world space
    directions : (n, 3) float64, world space

    Notes
    -----
    -1 and infinity where a ray meets nothing. O(log f) per ray.
    """
    n = len(directions)
    if len(scene.used) == 0:
        return np.full(n, -1, dtype=np.int32), np.full(n, np.inf)
    if (origins == origins[0]).all():
        origins = origins[:1]
    face_ids, distances = np.empty(n, dtype=np.int32), np.empty(n)
    origins, directions = np.ascontiguousarray(origins), np.ascontiguousarray(directions)
    away = float(np.linalg.norm((origins[0] - scene.centre) * scene.scale))
    if len(origins) > 1 or away > FARTHEST_ORIGIN or n * CLUSTERS_PER_RAY < len(scene.used):
        together(_cast_singles, -(-n // SINGLE_RAYS), scene, origins, directions, np.arange(n), face_ids, distances)
        return face_ids, distances
    views = make_views(scene, origins, 1.0)
    axes = views.axes[0, : views.n_frames[0]]
    places = sort_by_place(axes, _window(scene, views), directions, face_ids, distances)
    n_blocks = int((-(-np.diff(places.starts[:-1]) // BLOCK_RAYS)).sum())
    rays = (origins[0], directions, face_ids, distances)
    together(_cast_blocks, n_blocks, scene, views, axes, places, away, rays, own=lambda: _make_memory(scene))
    singles = places.order[places.starts[-2] :]
    if len(singles):
        together(_cast_singles, 1, scene, origins, directions, singles, face_ids, distances)
    return face_ids, distances


def _window(scene: Scene, views: Views) -> tuple[np.float32, ...]:
    """Rectangle around the scene in the first frame."""
    n = int(scene.level_counts[-1])
    rectangles = np.empty((6, -(-n // CLUSTER) * CLUSTER), dtype=np.float32)
    _project_top(scene, views, rectangles)
    left, right, bottom, top = rectangles[[LEFT, RIGHT, BOTTOM, TOP], :n]
    return left.min(), right.max(), bottom.min(), top.max()


@njit(_nrt=False, cache=True)
def _project_top(scene, views, rectangles):
    """Fill in the rectangles of the top level's nodes."""
    view, start = view_of(views, 0, 0), scene.level_starts[-1]
    error = COORDINATE_ERROR * view.reach
    project_boxes(scene.nodes, start, start + rectangles.shape[1], view, error, rectangles)


@shared
def _cast_singles(tasks, scene, origins, directions, chosen, face_ids, distances):
    """Take blocks of rays and fill in the answers, ray by ray; the last face met is the first asked."""
    room = CLUSTER * (len(scene.level_counts) + 8)
    stack = Stack(
        levels=np.empty(room, dtype=np.int64),
        nodes=np.empty(room, dtype=np.int64),
        nearest=np.empty(room, dtype=np.float32),
        lanes=np.empty(CLUSTER, dtype=np.float32),
    )
    _cast_one_by_one(tasks, reference(scene), origins, directions, chosen, (face_ids, distances), stack)


@inner
def _cast_one_by_one(tasks, scene, origins, directions, chosen, hits, memory):
    stack = reference(memory)
    face_ids, distances = hits
    block = take(tasks)
    while block * SINGLE_RAYS < len(chosen):
        guess = -1
        for i in chosen[block * SINGLE_RAYS : (block + 1) * SINGLE_RAYS]:
            d = directions[i]
            face, fraction = first_hit(scene, origins[i if len(origins) > 1 else 0], d, guess, stack)
            guess = face if face >= 0 else guess
            face_ids[i], distances[i] = face, fraction * math.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
        block = take(tasks)


def _make_memory(scene: Scene) -> tuple[Workspace, State, Float32]:
    """What a thread works with alone: the search's workspace, a packet's state, a block's coordinates."""
    return make_workspace(scene), make_state(), np.empty((2, BLOCK_RAYS), dtype=np.float32)


@shared
def _cast_blocks(tasks, scene, views, axes, places, away, rays, memory):
    """Take blocks of rays of a frame and fill in their answers."""
    _cast_tasks(tasks, reference(scene), views, axes, places, away, rays, memory[0], memory[1], memory[2])


@inner
def _cast_tasks(tasks, scene, views, axes, places, away, rays, workspace, memory, coordinates):
    space, state, projected = reference(workspace), reference(memory), -1
    block, before = take(tasks), 0  # blocks of the frames before
    for frame in range(len(axes)):
        first, last = places.starts[frame], places.starts[frame + 1]
        n_blocks = (last - first + BLOCK_RAYS - 1) // BLOCK_RAYS
        view = view_of(views, 0, frame)
        view_at = reference(view)
        frame_at = Frame(len(axes) > 1, axes[frame, 2], 1.0 / max(away, 1e-300))
        while block - before < n_blocks:
            if projected != frame:
                project_nodes(scene, view_at, space)
                projected = frame
            begin = first + (block - before) * BLOCK_RAYS
            chosen = places.order[begin : min(begin + BLOCK_RAYS, last)]
            _cast_block(scene, view_at, frame_at, rays, places, chosen, coordinates, space, state)
            block = take(tasks)
        before += n_blocks


@inner
def _cast_block(scene, view, frame, rays, places, chosen, coordinates, space, state):
    n, farthest = len(chosen), np.float32(2.1) * view.reach
    for i in range(n):
        at = 2 * chosen[i]
        coordinates[0, i], coordinates[1, i] = places.coordinates[at], places.coordinates[at + 1]
    n_before = list_clusters(scene, window_of(coordinates, 0, n, farthest), space)
    if n_before == 0:
        return
    for chunk in range(0, n, CHUNK_POINTS):
        end = min(chunk + CHUNK_POINTS, n)
        n_listed = choose(n_before, window_of(coordinates, chunk, end, farthest), space)
        if n_listed == 0:
            continue
        for packet in range(chunk, end, PACKET):
            for lane in range(PACKET):
                i = min(packet + lane, end - 1)
                state.coordinates[0, lane], state.coordinates[1, lane] = coordinates[0, i], coordinates[1, i]
            taken = chosen[packet : min(packet + PACKET, end)]
            first_hits_of_packet(scene, view, frame, rays, taken, n_listed, farthest, space, state)
