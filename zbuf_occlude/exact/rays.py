"""Rays, shared out among threads: those of one origin as what an eye there sees, others one by one.

Whoever gives one origin for all rays need not think of their order. They are taken in blocks, as they come: a sensor's
follow each other. A block is sorted by their places in the image while it is in the cache, and neighbours share lists
of clusters as the points of a search do. Rays in no order are sorted as a whole first, which costs as much as it gains
where they are in one.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.arrays import FloatArray, IntArray, are_usual, of_usual_length
from zbuf_occlude.exact.bvh import Scene
from zbuf_occlude.exact.layout import BOTTOM, CHUNK_POINTS, CLUSTER, ENDLESS, LEFT, RIGHT, TOP, ZERO
from zbuf_occlude.exact.listing import choose, list_clusters
from zbuf_occlude.exact.ray_packets import PACKET_RAYS, Rays, Window, first_hits_of_packet, make_state, window_of
from zbuf_occlude.exact.ray_places import (
    BLOCK_RAYS,
    MOST_BITS,
    find_places,
    make_places,
    order_of_cells,
    sort_places,
)
from zbuf_occlude.exact.search import project_nodes
from zbuf_occlude.exact.single_rays import Stack, first_hit
from zbuf_occlude.exact.view import make_views, view_of
from zbuf_occlude.exact.workspace import make_workspace
from zbuf_occlude.jit.compiler import inner, njit
from zbuf_occlude.jit.pointer import reference
from zbuf_occlude.jit.pool import n_blocks, shared_with_memory, take, take_block_from, take_end, together
from zbuf_occlude.jit.simd import N_LANES, load, store

SINGLE_RAYS = 512
"""Rays that a thread takes at a time, in the caller's order, where they go one by one."""

CLUSTERS_PER_RAY = 8
"""Fewer rays than a cluster per this many go one by one: an eye looks at all boxes of a scene."""

RAYS_PER_CLUSTER = 16
"""Fewer rays per cluster are sorted as a whole in any case: compact blocks share what they set up."""

RUN_RAYS = 256
"""Rays whose distances are taken at a time, or left out where none meets anything."""

SAMPLE_STEP = 251
"""From one ray of a block to the next that is asked whether the rays are in any order."""

SCATTERED = 0.925
"""Rays are in no order where more than this share of the directions' variance is within blocks."""


class Frame(NamedTuple):
    """What rays need of a frame: whether of a cube, its axis w, 1 / how far the scene's centre is, the largest w."""

    inside: bool
    axis: FloatArray
    inverse_away: float
    farthest: np.float32


class Question(NamedTuple):
    """Rays of one origin, and where their answers go.

    Parameters
    ----------
    origin : (3,) float64, world space
    directions : (3 n,) float64
    patterns : (3 n,) int64
        Their bits.
    away : float
        How far the origin is from the scene's centre, scene units.
    bits : int
        Of a cell's column and of its row.
    order : (n,) uint32
        In which the rays are taken; empty: as they come.
    cells : (n,) uint16
        Where there is room, the rays' cells are asked for, and no answers.
    face_ids, distances : (n,) int32, float64
    unusual : (1,) int64
        Becomes 1 where a direction is not of usual length: then there are no answers.
    """

    origin: FloatArray
    directions: FloatArray
    patterns: NDArray[np.int64]
    away: float
    bits: int
    order: NDArray[np.uint32]
    cells: NDArray[np.uint16]
    face_ids: IntArray
    distances: FloatArray
    unusual: NDArray[np.int64]


def find_first_hits(scene: Scene, origins: FloatArray, directions: FloatArray) -> tuple[IntArray, FloatArray]:
    """Return the first face that each ray meets, (n,) int32, and its eye distance, (n,) float64.

    Parameters
    ----------
    scene : Scene
    origins : (n, 3) or (1, 3) float64, world space
    directions : (n, 3) float64, world space

    Raises
    ------
    ArgumentError
        A direction is zero, not finite, or too large.

    Notes
    -----
    -1 and infinity where a ray meets nothing. O(log f) per ray.
    """
    n = len(directions)
    if len(scene.used) == 0:
        of_usual_length(directions)
        return np.full(n, -1, dtype=np.int32), np.full(n, np.inf)
    if len(origins) > 1 and (origins == origins[0]).all():
        origins = origins[:1]
    face_ids, distances = np.empty(n, dtype=np.int32), np.empty(n)
    away = math.dist(origins[0], scene.centre) * scene.scale
    if len(origins) > 1 or n * CLUSTERS_PER_RAY < len(scene.used):
        directions = of_usual_length(directions)
        together(_cast_singles, -(-n // SINGLE_RAYS), scene, origins, directions, np.arange(n), face_ids, distances)
        return face_ids, distances
    views = make_views(scene, origins, 1.0)
    bits = min(max((n // N_LANES).bit_length() // 2, 1), MOST_BITS)
    sort = n > BLOCK_RAYS and (n < RAYS_PER_CLUSTER * len(scene.used) or _are_scattered(directions))
    if sort:
        directions = of_usual_length(directions)
    order, cells = np.empty(0, dtype=np.uint32), np.empty(n if sort else 0, dtype=np.uint16)
    flat, unusual = directions.reshape(-1), np.zeros(1, dtype=np.int64)
    hits = face_ids, distances, unusual
    question = Question(origins[0], flat, flat.view(np.int64), away, bits, order, cells, *hits)
    if sort:
        together(_cast_blocks, n_blocks(n, BLOCK_RAYS), scene, views, question)
        question = question._replace(order=order_of_cells(cells, bits), cells=cells[:0])
    together(_cast_blocks, n_blocks(n, BLOCK_RAYS), scene, views, question)
    if unusual[0]:
        return find_first_hits(scene, origins, of_usual_length(directions))
    return face_ids, distances


@njit(cache=True)
def _are_scattered(directions):
    """Whether rays that follow each other go anywhere, so that a block of them, as they come, has nothing in common."""
    n, m = len(directions) // BLOCK_RAYS, (BLOCK_RAYS + SAMPLE_STEP - 1) // SAMPLE_STEP  # blocks, rays asked of each
    if n < 2:
        return False
    squares, of_blocks, of_all = 0.0, 0.0, 0.0
    for axis in range(3):
        total = 0.0
        for first in range(0, n * BLOCK_RAYS, BLOCK_RAYS):
            part = 0.0
            for i in range(first, first + BLOCK_RAYS, SAMPLE_STEP):
                part += directions[i, axis]
                squares += directions[i, axis] * directions[i, axis]
            of_blocks += part * part / m
            total += part
        of_all += total * total / (n * m)
    return squares - of_blocks > SCATTERED * (squares - of_all)


@shared_with_memory
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


class Block(NamedTuple):
    """A block's rays where the caller's are sorted first, and what any meet, ``height / slope`` directions away."""

    directions: FloatArray  # (3 x BLOCK_RAYS,)
    face_ids: IntArray  # (BLOCK_RAYS,)
    distances: FloatArray  # (BLOCK_RAYS,)
    heights: FloatArray  # (BLOCK_RAYS,)
    slopes: FloatArray  # (BLOCK_RAYS,)


_make_workspace = njit(_nrt=True)(make_workspace)


@njit(_nrt=True)
def _make_block():
    return Block(
        directions=np.empty(3 * BLOCK_RAYS),
        face_ids=np.empty(BLOCK_RAYS, dtype=np.int32),
        distances=np.empty(BLOCK_RAYS),
        heights=np.empty(BLOCK_RAYS),
        slopes=np.empty(BLOCK_RAYS),
    )


@shared_with_memory
def _cast_blocks(tasks, scene, views, question):
    """Take blocks of rays, in an order or as they come, and fill in their answers, or cells where these are asked.

    What a thread works with is allocated here: in Python threads would do so one after the other.
    """
    space, places = _make_workspace(len(scene.used), scene.nodes.shape[1]), make_places()
    _cast_tasks(tasks, reference(scene), views, question, (space, places, make_state(), _make_block()))


@inner
def _cast_tasks(tasks, scene, views, question, memory):
    space, places, state, block = reference(memory[0]), reference(memory[1]), reference(memory[2]), memory[3]
    order, cells, bits = question.order, question.cells, question.bits
    axes, inverse_away = views.axes[0, : views.n_frames[0]], 1.0 / max(question.away, 1e-300)
    projected, window = -1, Window(ZERO, ZERO, ZERO, ZERO, ENDLESS)
    if len(axes) == 1:
        project_nodes(scene, reference(view_of(views, 0, 0)), space)
        projected, window = 0, _window_of_scene(scene, space)
    end = take_end(tasks)
    first, last = take_block_from(tasks, end, len(question.face_ids), BLOCK_RAYS)
    while first < last:
        n = last - first
        directions = question.directions[3 * first : 3 * last]
        face_ids, distances = question.face_ids[first:last], question.distances[first:last]
        if len(order):
            directions, face_ids, distances = block.directions[: 3 * n], block.face_ids[:n], block.distances[:n]
            _gather(question.directions, order[first:last], directions)
        elif not are_usual(question.patterns[3 * first : 3 * last]):
            question.unusual[0] = 1
            return
        find_places(axes, window, bits, directions, places)
        if len(cells):
            for i in range(n):
                cells[first + i] = places.cells[i]
        else:
            sort_places(n, len(axes), bits, places)
            face_ids[:] = -1
            rays = Rays(question.origin, directions, face_ids, block.heights, block.slopes, places.order)
            before = max(projected, 0)
            for i in range(len(axes)):
                frame = (before + i) % len(axes)  # first the one whose boxes have been projected
                if places.ends[frame] > places.starts[frame]:
                    view = view_of(views, 0, frame)
                    view_at = reference(view)
                    if projected != frame:
                        project_nodes(scene, view_at, space)
                        projected = frame
                    farthest = np.float32(2.1) * view.reach
                    frame_at = Frame(len(axes) > 1, axes[frame, 2], inverse_away, farthest)
                    _cast_frame(scene, view_at, frame_at, rays, places, frame, space, state)
            _measure(directions, face_ids, block.heights, block.slopes, distances)
            if len(order):
                for i in range(n):
                    question.face_ids[order[first + i]] = face_ids[i]
                    question.distances[order[first + i]] = distances[i]
        first, last = take_block_from(tasks, end, len(question.face_ids), BLOCK_RAYS)


@inner
def _window_of_scene(scene, space):
    """Return the window that holds the projected nodes of the top level."""
    first = scene.level_starts[-1]
    last = first + scene.level_counts[-1]
    bounds = space.rectangles
    left, right, bottom, top = ENDLESS, -ENDLESS, ENDLESS, -ENDLESS
    for i in range(first, last):
        left, right = min(left, bounds[LEFT, i]), max(right, bounds[RIGHT, i])
        bottom, top = min(bottom, bounds[BOTTOM, i]), max(top, bounds[TOP, i])
    return Window(left, right, bottom, top, ENDLESS)


@inner
def _gather(directions, order, chosen):
    """Copy the directions of an order."""
    for i in range(len(order)):
        for axis in range(3):
            chosen[3 * i + axis] = directions[3 * order[i] + axis]


@inner
def _measure(directions, face_ids, heights, slopes, distances):
    """Turn quotients into distances, a run of rays at a time: a picture has many that meet nothing."""
    for first in range(0, len(distances), RUN_RAYS):
        last = min(first + RUN_RAYS, len(distances))
        met, along = face_ids[first:last], directions[3 * first : 3 * last]
        if _largest(met) < 0:
            distances[first:last] = np.inf
        else:
            _divide(along, met, heights[first:last], slopes[first:last], distances[first:last])


@inner
def _largest(face_ids):
    most = face_ids[0]
    for i in range(len(face_ids)):
        most = max(most, face_ids[i])
    return most


@njit(error_model="numpy")
def _divide(directions, face_ids, heights, slopes, distances):
    """Divide; a loop without branches, which takes several rays at a time."""
    for i in range(len(distances)):
        x, y, z = directions[3 * i], directions[3 * i + 1], directions[3 * i + 2]
        distance = heights[i] / slopes[i] * math.sqrt(x * x + y * y + z * z)
        distances[i] = distance if face_ids[i] >= 0 else np.inf


@inner
def _cast_frame(scene, view, frame, rays, places, number, space, state):
    first, end, room = places.starts[number], places.ends[number], places.coordinates.shape[1]
    n_before = list_clusters(scene, window_of(places.coordinates, first, end, frame.farthest), space)
    if n_before == 0:
        return
    for chunk in range(first, end, CHUNK_POINTS):
        last = min(chunk + CHUNK_POINTS, end)
        n_listed = choose(n_before, window_of(places.coordinates, chunk, last, frame.farthest), space)
        if n_listed == 0:
            continue
        for packet in range(chunk, last, PACKET_RAYS):
            for at in range(0, PACKET_RAYS, N_LANES):
                store(state.coordinates, at, load(places.coordinates, packet + at))
                store(state.coordinates, PACKET_RAYS + at, load(places.coordinates, room + packet + at))
            chosen = rays.chosen[packet : min(packet + PACKET_RAYS, last)]
            taken = Rays(rays.origin, rays.directions, rays.face_ids, rays.heights, rays.slopes, chosen)
            first_hits_of_packet(scene, view, frame, taken, n_listed, space, state)
