"""First hits: rays of one origin in blocks, as an eye there sees them; rays of many origins one by one.

Whoever gives one origin for all rays need not think of their order. They are taken in blocks, as they come: a sensor's
follow each other. A block is sorted by place in the image while it is in the cache, and neighbours share candidate
lists as the points of a search do. Rays in no order are sorted as a whole first, which costs as much as it gains where
they are in one.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.arrays import FloatArray, IntArray, have_safe_norms, rescale_directions
from zbuf_occlude.exact.bvh import Bvh
from zbuf_occlude.exact.layout import (
    BOTTOM,
    CHUNK_POINTS,
    F32_MAX,
    GROUP,
    LEFT,
    PACKET,
    RIGHT,
    TOP,
    ZERO,
    Float32,
    Int64,
    make_workspace,
)
from zbuf_occlude.exact.project import Window
from zbuf_occlude.exact.ray_packets import RayFrame, Rays, first_hits_of_packet, make_state, window_of
from zbuf_occlude.exact.search import choose, list_candidates, project_children
from zbuf_occlude.exact.single_rays import BLOCK_LINES, cast_singles, make_lines
from zbuf_occlude.exact.view import project_eyes, view_of
from zbuf_occlude.jit.compiler import always_inline, device_function, njit
from zbuf_occlude.jit.pointer import reference
from zbuf_occlude.jit.simd import N_LANES, load, store
from zbuf_occlude.jit.threads import n_blocks, parallel_for, shared_with_memory, take_block_from, take_end

FEW_RAYS_PER_LEAF = 3
"""Fewer rays per leaf go one by one: an eye looks at all boxes of a BVH."""
FAR = 1e5
"""Scene units. Of origins farther away float64 does not resolve places in the image to a thousandth of float32."""
RAYS_PER_LEAF = 16
"""Fewer rays per leaf are sorted as a whole in any case: compact blocks share what they set up."""
RUN_RAYS = 256
"""Rays whose distances are taken at a time, or left out where none meets anything."""
SAMPLE_STEP = 251
"""From one ray of a block to the next that is asked whether the rays are in any order."""
SCATTERED = 0.925
"""Rays are in no order where more than this share of the directions' variance is within blocks."""
BLOCK_RAYS = GROUP * CHUNK_POINTS
"""Rays that a thread takes at a time: they share a candidate list, from which each `CHUNK_POINTS` choose."""
MOST_BITS = 6
"""Of a cell's column and of its row, at most."""
N_FRAMES = 6
LEAST_WIDTH = np.float32(1e-30)


class RayQuery(NamedTuple):
    """n rays of one origin, and where their answers go."""

    origin: FloatArray  # (3,) world space
    directions: FloatArray  # (3 n,)
    patterns: Int64  # (3 n,) their bits
    away: float  # how far the origin is from the scene's centre, scene units
    bits: int  # of a cell's column and of its row
    order: NDArray[np.uint32]  # (n,) in which the rays are taken; empty: as they come
    cells: NDArray[np.uint16]  # (n,) receives the rays' cells, instead of answers; empty: answers
    face_ids: IntArray  # (n,)
    distances: FloatArray  # (n,)
    unusual: Int64  # (1,) becomes 1 where a direction is not of usual length: then there are no answers


class RayBins(NamedTuple):
    """The rays of a block, frame by frame, each along a Morton curve of cells; what misses the scene is left out."""

    coordinates: Float32  # (2, m) x / w and y / w. Each frame begins at a multiple of `PACKET`, and repeats its last
    # ray up to the next
    order: IntArray  # (m,) which ray of the block that is
    starts: Int64  # (6,) where each frame begins
    ends: Int64  # (6,) and ends
    unsorted: Float32  # (2 x BLOCK_RAYS,) x / w and y / w of each ray in turn, as the block has them
    cells: IntArray  # (BLOCK_RAYS,)
    counts: IntArray  # (6 x 2^(2 x MOST_BITS),)


class Block(NamedTuple):
    """A block's rays where the caller's are sorted first, and what any meet, ``height / slope`` directions away."""

    directions: FloatArray  # (3 x BLOCK_RAYS,)
    face_ids: IntArray  # (BLOCK_RAYS,)
    distances: FloatArray  # (BLOCK_RAYS,)
    heights: FloatArray  # (BLOCK_RAYS,)
    slopes: FloatArray  # (BLOCK_RAYS,)


def find_first_hits(bvh: Bvh, origins: FloatArray, directions: FloatArray) -> tuple[IntArray, FloatArray]:
    """Return the first face that each ray meets, (n,) int32, and its eye distance, (n,) float64.

    Parameters
    ----------
    bvh : Bvh
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
    if len(bvh.used) == 0:
        rescale_directions(directions)
        return np.full(n, -1, dtype=np.int32), np.full(n, np.inf)
    if (origins[0] == origins[-1]).all() and (origins == origins[0]).all():
        origins = origins[:1]
    face_ids, distances = np.empty(n, dtype=np.int32), np.empty(n)
    away = math.dist(origins[0], bvh.centre) * bvh.scale
    if len(origins) > 1 or n < FEW_RAYS_PER_LEAF * len(bvh.used) or away > FAR:
        directions = rescale_directions(directions)
        asked = bvh, origins, directions, face_ids, distances
        parallel_for(cast_singles, n_blocks(n, BLOCK_LINES), *asked, own=lambda: make_lines(bvh))
        return face_ids, distances
    views = project_eyes(bvh, origins, 1.0)
    bits = min(max((n // N_LANES).bit_length() // 2, 1), MOST_BITS)
    sort = n > BLOCK_RAYS and (n < RAYS_PER_LEAF * len(bvh.used) or _are_scattered(directions))
    if sort:
        directions = rescale_directions(directions)
    order, cells = np.empty(0, dtype=np.uint32), np.empty(n if sort else 0, dtype=np.uint16)
    flat, unusual = directions.reshape(-1), np.zeros(1, dtype=np.int64)
    hits = face_ids, distances, unusual
    query = RayQuery(origins[0], flat, flat.view(np.int64), away, bits, order, cells, *hits)
    if sort:
        parallel_for(_cast_blocks, n_blocks(n, BLOCK_RAYS), bvh, views, query)
        query = query._replace(order=_order_of_cells(cells, bits), cells=cells[:0])
    parallel_for(_cast_blocks, n_blocks(n, BLOCK_RAYS), bvh, views, query)
    if unusual[0]:
        return find_first_hits(bvh, origins, rescale_directions(directions))
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


@njit(cache=True, _nrt=True)
def _order_of_cells(cells, bits):
    """Return the order of the cells of any number of rays, (n,) uint32; those of one cell stay as they come."""
    starts, order = np.zeros((N_FRAMES << (2 * bits)) + 1, dtype=np.int64), np.empty(len(cells), dtype=np.uint32)
    for cell in cells:
        starts[cell] += 1
    _accumulate(starts, 0)
    for i in range(len(cells)):
        order[starts[cells[i]]] = i
        starts[cells[i]] += 1
    return order


_make_workspace = njit(_nrt=True)(make_workspace)


@njit(_nrt=True)
def _make_places():
    room = BLOCK_RAYS + N_FRAMES * PACKET
    return RayBins(
        coordinates=np.empty((2, room), dtype=np.float32),
        order=np.empty(room, dtype=np.int32),
        starts=np.zeros(N_FRAMES, dtype=np.int64),
        ends=np.zeros(N_FRAMES, dtype=np.int64),
        unsorted=np.empty(2 * BLOCK_RAYS, dtype=np.float32),
        cells=np.empty(BLOCK_RAYS, dtype=np.int32),
        counts=np.empty(N_FRAMES << (2 * MOST_BITS), dtype=np.int32),
    )


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
def _cast_blocks(tasks, bvh, views, query):
    """Take blocks of rays, in an order or as they come, and fill in their answers, or cells where these are asked.

    What a thread works with is allocated here: in Python threads would do so one after the other.
    """
    space, places = _make_workspace(len(bvh.used), len(bvh.n_children)), _make_places()
    _cast_tasks(tasks, reference(bvh), views, query, (space, places, make_state(), _make_block()))


@device_function
def _cast_tasks(tasks, bvh, views, query, memory):
    space, places, state, block = reference(memory[0]), reference(memory[1]), reference(memory[2]), memory[3]
    order, cells, bits = query.order, query.cells, query.bits
    axes, inverse_away = views.axes[0, : views.n_frames[0]], 1.0 / max(query.away, 1e-300)
    projected, window = -1, Window(ZERO, ZERO, ZERO, ZERO, F32_MAX)
    if len(axes) == 1:
        project_children(bvh, 0, reference(view_of(views, 0, 0)), space)
        projected, window = 0, _window_of_bvh(bvh, space)
    end = take_end(tasks)
    first, last = take_block_from(tasks, end, len(query.face_ids), BLOCK_RAYS)
    while first < last:
        n = last - first
        directions = query.directions[3 * first : 3 * last]
        face_ids, distances = query.face_ids[first:last], query.distances[first:last]
        if len(order):
            directions, face_ids, distances = block.directions[: 3 * n], block.face_ids[:n], block.distances[:n]
            _gather(query.directions, order[first:last], directions)
        elif not have_safe_norms(query.patterns[3 * first : 3 * last]):
            query.unusual[0] = 1
            return
        _find_places(axes, window, bits, directions, places)
        if len(cells):
            for i in range(n):
                cells[first + i] = places.cells[i]
        else:
            _sort_places(n, len(axes), bits, places)
            face_ids[:] = -1
            rays = Rays(query.origin, directions, face_ids, block.heights, block.slopes, places.order)
            before = max(projected, 0)
            for i in range(len(axes)):
                frame = (before + i) % len(axes)  # first the one whose boxes have been projected
                if places.ends[frame] > places.starts[frame]:
                    view = view_of(views, 0, frame)
                    view_at = reference(view)
                    projected = frame
                    farthest = np.float32(2.1) * view.reach
                    ray_frame = RayFrame(len(axes) > 1, axes[frame, 2], inverse_away, farthest)
                    _cast_frame(bvh, view_at, ray_frame, rays, places, frame, space, state)
            _measure(directions, face_ids, block.heights, block.slopes, distances)
            if len(order):
                for i in range(n):
                    query.face_ids[order[first + i]] = face_ids[i]
                    query.distances[order[first + i]] = distances[i]
        first, last = take_block_from(tasks, end, len(query.face_ids), BLOCK_RAYS)


@device_function
def _window_of_bvh(bvh, space):
    """Return the window that holds the projected children of the root."""
    bounds = space.rectangles
    left, right, bottom, top = F32_MAX, -F32_MAX, F32_MAX, -F32_MAX
    for i in range(bvh.n_children[0]):
        left, right = min(left, bounds[LEFT, i]), max(right, bounds[RIGHT, i])
        bottom, top = min(bottom, bounds[BOTTOM, i]), max(top, bounds[TOP, i])
    return Window(left, right, bottom, top, F32_MAX)


@device_function
def _gather(directions, order, chosen):
    """Copy the directions of an order."""
    for i in range(len(order)):
        for axis in range(3):
            chosen[3 * i + axis] = directions[3 * order[i] + axis]


@device_function
def _measure(directions, face_ids, heights, slopes, distances):
    """Turn quotients into distances, a run of rays at a time: a picture has many that meet nothing."""
    for first in range(0, len(distances), RUN_RAYS):
        last = min(first + RUN_RAYS, len(distances))
        met, along = face_ids[first:last], directions[3 * first : 3 * last]
        if _largest(met) < 0:
            distances[first:last] = np.inf
        else:
            _divide(along, met, heights[first:last], slopes[first:last], distances[first:last])


@device_function
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


@device_function
def _cast_frame(bvh, view, frame, rays, places, number, space, state):
    first, end, room = places.starts[number], places.ends[number], places.coordinates.shape[1]
    n_before = list_candidates(bvh, view, window_of(places.coordinates, first, end, frame.farthest), space)
    if n_before == 0:
        return
    for chunk in range(first, end, CHUNK_POINTS):
        last = min(chunk + CHUNK_POINTS, end)
        n_listed = choose(n_before, window_of(places.coordinates, chunk, last, frame.farthest), space)
        if n_listed == 0:
            continue
        for packet in range(chunk, last, PACKET):
            for at in range(0, PACKET, N_LANES):
                store(state.coordinates, at, load(places.coordinates, packet + at))
                store(state.coordinates, PACKET + at, load(places.coordinates, room + packet + at))
            chosen = rays.chosen[packet : min(packet + PACKET, last)]
            taken = Rays(rays.origin, rays.directions, rays.face_ids, rays.heights, rays.slopes, chosen)
            first_hits_of_packet(bvh, view, frame, taken, n_listed, space, state)


# Places of rays: a block is sorted by them


@device_function
def _find_places(axes, window, bits, directions, places):
    """Fill in the places of a block's rays, directions (3 m,), and their cells.

    `axes` are the rows x, y, w of each frame, (1 or 6, 3, 3); `window` holds the scene in an only frame: the rest of
    the image shows nothing.
    """
    n = len(directions) // 3
    if len(axes) == 1:
        _place_from_outside(axes[0], directions, places.unsorted[: 2 * n])
        _number_cells(window, bits, places.unsorted[: 2 * n], places.cells[:n])
    else:
        _place_on_cube(directions, bits, places.unsorted[: 2 * n], places.cells[:n])


@device_function
def _sort_places(n, n_frames, bits, places):
    """Sort the n rays of a block by their cells."""
    cells, counts, size = places.cells[:n], places.counts, 1 << (2 * bits)
    nowhere, present, total = n_frames * size, 0, 0
    for i in range(n):
        present |= 1 << (cells[i] >> (2 * bits))
    for frame in range(n_frames):
        if present >> frame & 1:
            counts[frame * size : (frame + 1) * size] = 0
    for i in range(n):
        if cells[i] < nowhere:
            counts[cells[i]] += 1
    for frame in range(n_frames):
        places.starts[frame] = total
        if present >> frame & 1:
            total = _accumulate(counts[frame * size : (frame + 1) * size], total)
        places.ends[frame] = total
        total = (total + PACKET - 1) // PACKET * PACKET
    x, y = places.coordinates[0], places.coordinates[1]
    _scatter(cells, nowhere, places.unsorted, counts, x, y, places.order)
    for frame in range(n_frames):
        last = places.ends[frame] - 1
        for at in range(last + 1, last + 1 + -(last + 1) % PACKET):
            x[at], y[at] = x[last], y[last]


@device_function
def _accumulate(counts, total):
    """Turn counts of cells into where each begins; return where the last one ends."""
    for cell in range(len(counts)):
        count = counts[cell]
        counts[cell] = total
        total += count
    return total


@device_function
def _scatter(cells, nowhere, unsorted, starts, x, y, order):
    """Write the places and numbers of rays where they go."""
    for i in range(len(cells)):
        if cells[i] >= nowhere:
            continue
        at = starts[cells[i]]
        starts[cells[i]] = at + 1
        x[at], y[at], order[at] = unsorted[2 * i], unsorted[2 * i + 1], i


# The loops below take several rays at a time: they have no branches, and arrays of one axis, whose strides are known.


@njit(error_model="numpy")
def _place_from_outside(axes, directions, coordinates):
    """Find places; infinity for a ray that goes away."""
    for i in range(len(coordinates) // 2):
        x, y, z = directions[3 * i], directions[3 * i + 1], directions[3 * i + 2]
        u = axes[0, 0] * x + axes[0, 1] * y + axes[0, 2] * z
        v = axes[1, 0] * x + axes[1, 1] * y + axes[1, 2] * z
        w = axes[2, 0] * x + axes[2, 1] * y + axes[2, 2] * z
        inverse = 1.0 / w
        coordinates[2 * i], coordinates[2 * i + 1] = (u * inverse if w > 0.0 else np.inf), v * inverse


@njit(error_model="numpy")
def _number_cells(window, bits, coordinates, cells):
    """Number the cells of an only frame, which cover a window; beyond it nothing is met."""
    nowhere, most = np.int32(1 << (2 * bits)), np.float32((1 << bits) - 1)
    across = most / max(window.right - window.left, LEAST_WIDTH)
    upwards = most / max(window.top - window.bottom, LEAST_WIDTH)
    for i in range(len(cells)):
        x, y = coordinates[2 * i], coordinates[2 * i + 1]
        within = (x >= window.left) & (x <= window.right) & (y >= window.bottom) & (y <= window.top)
        cell = _cell_at(np.int32((x - window.left) * across), np.int32((y - window.bottom) * upwards))
        cells[i] = cell if within else nowhere


@njit(error_model="numpy")
def _place_on_cube(directions, bits, coordinates, cells):
    n_cells, half = np.int32(1 << (2 * bits)), 0.5 * ((1 << bits) - 1)
    for i in range(len(cells)):
        x, y, z = directions[3 * i], directions[3 * i + 1], directions[3 * i + 2]
        size = _largest3(abs(x), abs(y), abs(z))
        first, second = abs(x) == size, abs(y) == size
        w = x if first else (y if second else z)
        u = y if first else (z if second else x)
        v = z if first else (x if second else y)
        inverse, behind = 1.0 / size, w < 0.0
        u, v = (v if behind else u) * inverse, (u if behind else v) * inverse
        coordinates[2 * i], coordinates[2 * i + 1] = u, v
        frame = np.int32(0 if first else (2 if second else 4)) + np.int32(behind)
        cells[i] = frame * n_cells + _cell_at(np.int32(u * half + half), np.int32(v * half + half))


@always_inline
def _largest3(a, b, c):
    larger = a if a > b else b
    return larger if larger > c else c


@always_inline
def _cell_at(column, row):
    """Number of a cell along a Morton curve."""
    return _spread_bits(column) | (_spread_bits(row) << np.int32(1))


@always_inline
def _spread_bits(i):
    """The `MOST_BITS` bits of a number with gaps between them."""
    i = (i | (i << np.int32(4))) & np.int32(0x30F)
    i = (i | (i << np.int32(2))) & np.int32(0x333)
    return (i | (i << np.int32(1))) & np.int32(0x555)
