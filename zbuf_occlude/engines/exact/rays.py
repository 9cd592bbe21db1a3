"""First hits: rays of one origin in blocks, as an eye there sees them; rays of many origins one by one.

Rays of one origin may come in any order. They are processed in blocks in the given order, since a sensor's rays follow
each other. A block is sorted by position in the image while it is in the cache, and neighbours share candidate lists as
the points of a search do. Scattered rays are sorted as a whole first; for ordered rays this would not pay.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.base.arrays import FloatArray, IntArray, have_safe_norms, rescale_directions
from zbuf_occlude.base.jit.compiler import always_inline, device_function, njit
from zbuf_occlude.base.jit.pointer import pointer_to
from zbuf_occlude.base.jit.simd import N_LANES, load, store
from zbuf_occlude.base.jit.threads import allocating_kernel, n_blocks, parallel_for, take_block_from, take_end
from zbuf_occlude.base.precompiler import Compilation
from zbuf_occlude.engines.exact.bvh import Bvh, empty_bvh
from zbuf_occlude.engines.exact.layout import (
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
from zbuf_occlude.engines.exact.project import ImageRect
from zbuf_occlude.engines.exact.ray_packets import PacketRays, RayFrame, first_hits_of_packet, make_state, rect_of_rays
from zbuf_occlude.engines.exact.search import list_candidates, project_children, select_candidates
from zbuf_occlude.engines.exact.single_rays import TRAVERSAL_RAYS, cast_singles, make_traversal_scratch
from zbuf_occlude.engines.exact.view import project_eyes, view_of

MIN_RAYS_PER_LEAF = 3
"""Below this many rays per leaf, each ray traverses the BVH alone: projecting all boxes does not pay."""
MAX_IMAGE_DISTANCE = 1e5
"""Largest distance of an origin, in scene units, at which float64 resolves the image to a thousandth of float32."""
RAYS_PER_LEAF = 16
"""Below this many rays per leaf, rays are always sorted as a whole: compact blocks share triangle set-ups."""
RUN_RAYS = 256
"""Rays per step of the distance computation, which is skipped if none of them meets a face."""
SAMPLE_STEP = 251
"""Stride between the rays of a block that are sampled to tell whether rays are scattered."""
SCATTERED_SHARE = 0.925
"""Share of the directions' variance within blocks above which rays count as scattered."""
BLOCK_RAYS = GROUP * CHUNK_POINTS
"""Rays per block, a thread's unit of work: they share a candidate list, from which every `CHUNK_POINTS` select."""
MAX_BITS = 6
"""Maximum bits of a cell's column, and of its row."""
N_FRAMES = 6
MIN_WIDTH = np.float32(1e-30)


class RayQuery(NamedTuple):
    """Rays of one origin, and the arrays for their answers."""

    origin: FloatArray  # (3,) world space
    directions: FloatArray  # (3 n,)
    patterns: Int64  # (3 n,) bit patterns of the directions
    away: float  # distance of the origin from the scene's centre, scene units
    bits: int  # bits of a cell's column, and of its row
    order: NDArray[np.uint32]  # (n,) processing order; empty: the given order
    cells: NDArray[np.uint16]  # (n,) receives the rays' cells instead of answers; empty: answers are computed
    face_ids: IntArray  # (n,)
    distances: FloatArray  # (n,)
    unsafe: Int64  # (1,) set to 1 if a direction has no safe norm: then there are no answers


class RayBins(NamedTuple):
    """Rays of a block sorted by frame, then along a Morton curve of cells; rays that miss the scene are left out."""

    coordinates: Float32  # (2, m) x / w and y / w; each frame is padded to a multiple of `PACKET` by its last ray
    order: IntArray  # (m,) index of the ray in the block
    starts: Int64  # (6,) first entry of each frame
    ends: Int64  # (6,) one past the last entry of each frame
    unsorted: Float32  # (2 x BLOCK_RAYS,) x / w and y / w, ray after ray, in the block's order
    cells: IntArray  # (BLOCK_RAYS,)
    counts: IntArray  # (6 x 2^(2 x MAX_BITS),)


class Block(NamedTuple):
    """Buffers of a block: rays and answers if the caller's rays are sorted first, and the quotients of any block."""

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
    unsafe = np.zeros(1, dtype=np.int64)
    if len(origins) > 1 or n < MIN_RAYS_PER_LEAF * len(bvh.used) or away > MAX_IMAGE_DISTANCE:
        asked = bvh, origins, directions, directions.reshape(-1).view(np.int64), face_ids, distances, unsafe
        parallel_for(cast_singles, n_blocks(n, TRAVERSAL_RAYS), *asked, own=lambda: make_traversal_scratch(bvh))
    else:
        _cast_from_one_origin(bvh, origins, directions, away, face_ids, distances, unsafe)
    if unsafe[0]:
        return find_first_hits(bvh, origins, rescale_directions(directions))
    return face_ids, distances


def _cast_from_one_origin(
    bvh: Bvh,
    origin: FloatArray,
    directions: FloatArray,
    away: float,
    face_ids: IntArray,
    distances: FloatArray,
    unsafe: Int64,
) -> None:
    """Write the first hits of rays of one origin, (1, 3), in packets."""
    n, views = len(directions), project_eyes(bvh, origin, 1.0)
    bits = min(max((n // N_LANES).bit_length() // 2, 1), MAX_BITS)
    sort = n > BLOCK_RAYS and (n < RAYS_PER_LEAF * len(bvh.used) or _are_scattered(directions))
    if sort:
        directions = rescale_directions(directions)
    order, cells = np.empty(0, dtype=np.uint32), np.empty(n if sort else 0, dtype=np.uint16)
    flat, hits = directions.reshape(-1), (face_ids, distances, unsafe)
    query = RayQuery(origin[0], flat, flat.view(np.int64), away, bits, order, cells, *hits)
    if sort:
        parallel_for(_cast_blocks, n_blocks(n, BLOCK_RAYS), bvh, views, query)
        query = query._replace(order=_order_of_cells(cells, bits), cells=cells[:0])
    parallel_for(_cast_blocks, n_blocks(n, BLOCK_RAYS), bvh, views, query)


def compile_first_hits() -> None:
    """Compile the casting of rays of one origin, by a question without rays about a mesh without faces."""
    bvh, nothing, origin = empty_bvh(), np.empty(0), np.zeros((1, 3))
    order, cells = np.empty(0, dtype=np.uint32), np.empty(0, dtype=np.uint16)
    hits = np.empty(0, dtype=np.int32), nothing, np.zeros(1, dtype=np.int64)
    query = RayQuery(origin[0], nothing, nothing.view(np.int64), 0.0, 1, order, cells, *hits)
    parallel_for(_cast_blocks, 0, bvh, project_eyes(bvh, origin, 1.0), query)


def compile_scattered_rays() -> None:
    """Compile the casting of rays of many origins, by a question without rays about a mesh without faces."""
    bvh, nothing, none = empty_bvh(), np.empty((0, 3)), np.empty(0, dtype=np.int64)
    hits = np.empty(0, dtype=np.int32), np.empty(0), none
    parallel_for(cast_singles, 0, bvh, nothing, nothing, none, *hits, own=lambda: make_traversal_scratch(bvh))


@njit(cache=True)
def _are_scattered(directions):
    """Return whether the rays of a block, in the given order, go in unrelated directions."""
    n, m = len(directions) // BLOCK_RAYS, (BLOCK_RAYS + SAMPLE_STEP - 1) // SAMPLE_STEP  # blocks, samples of each
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
    return squares - of_blocks > SCATTERED_SHARE * (squares - of_all)


@njit(cache=True, _nrt=True)
def _order_of_cells(cells, bits):
    """Return the indices that sort rays by cell, (n,) uint32; rays of one cell keep their order."""
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
def _make_bins():
    room = BLOCK_RAYS + N_FRAMES * PACKET
    return RayBins(
        coordinates=np.empty((2, room), dtype=np.float32),
        order=np.empty(room, dtype=np.int32),
        starts=np.zeros(N_FRAMES, dtype=np.int64),
        ends=np.zeros(N_FRAMES, dtype=np.int64),
        unsorted=np.empty(2 * BLOCK_RAYS, dtype=np.float32),
        cells=np.empty(BLOCK_RAYS, dtype=np.int32),
        counts=np.empty(N_FRAMES << (2 * MAX_BITS), dtype=np.int32),
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


@allocating_kernel
def _cast_blocks(tasks, bvh, views, query):
    """Process blocks of rays: write their answers, or their cells if `query` has an array for cells.

    Each thread allocates its memory here: in Python the threads would allocate one after the other.
    """
    space, bins = _make_workspace(len(bvh.used), len(bvh.n_children)), _make_bins()
    _cast_tasks(tasks, pointer_to(bvh), views, query, (space, bins, make_state(), _make_block()))


@device_function
def _cast_tasks(tasks, bvh, views, query, memory):
    space, bins, state, block = pointer_to(memory[0]), pointer_to(memory[1]), pointer_to(memory[2]), memory[3]
    order, cells, bits = query.order, query.cells, query.bits
    axes, inverse_away = views.axes[0, : views.n_frames[0]], 1.0 / max(query.away, 1e-300)
    projected, rect = -1, ImageRect(ZERO, ZERO, ZERO, ZERO, F32_MAX)
    if len(axes) == 1:
        project_children(bvh, 0, pointer_to(view_of(views, 0, 0)), space)
        projected, rect = 0, _rect_of_bvh(bvh, space)
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
            query.unsafe[0] = 1
            return
        _bin_rays(axes, rect, bits, directions, bins)
        if len(cells):
            for i in range(n):
                cells[first + i] = bins.cells[i]
        else:
            _sort_bins(n, len(axes), bits, bins)
            face_ids[:] = -1
            rays = PacketRays(query.origin, directions, face_ids, block.heights, block.slopes, bins.order)
            before = max(projected, 0)
            for i in range(len(axes)):
                frame = (before + i) % len(axes)  # start with the frame whose boxes are projected already
                if bins.ends[frame] > bins.starts[frame]:
                    view = view_of(views, 0, frame)
                    view_at = pointer_to(view)
                    projected = frame
                    max_w = np.float32(2.1) * view.magnitude
                    ray_frame = RayFrame(len(axes) > 1, axes[frame, 2], inverse_away, max_w)
                    _cast_frame(bvh, view_at, ray_frame, rays, bins, frame, space, state)
            _measure(directions, face_ids, block.heights, block.slopes, distances)
            if len(order):
                for i in range(n):
                    query.face_ids[order[first + i]] = face_ids[i]
                    query.distances[order[first + i]] = distances[i]
        first, last = take_block_from(tasks, end, len(query.face_ids), BLOCK_RAYS)


@device_function
def _rect_of_bvh(bvh, space):
    """Return the rectangle around the projected children of the root."""
    bounds = space.rectangles
    left, right, bottom, top = F32_MAX, -F32_MAX, F32_MAX, -F32_MAX
    for i in range(bvh.n_children[0]):
        left, right = min(left, bounds[LEFT, i]), max(right, bounds[RIGHT, i])
        bottom, top = min(bottom, bounds[BOTTOM, i]), max(top, bounds[TOP, i])
    return ImageRect(left, right, bottom, top, F32_MAX)


@device_function
def _gather(directions, order, chosen):
    """Copy directions in a given order."""
    for i in range(len(order)):
        for axis in range(3):
            chosen[3 * i + axis] = directions[3 * order[i] + axis]


@device_function
def _measure(directions, face_ids, heights, slopes, distances):
    """Turn quotients into distances, skipping runs of rays that meet nothing."""
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
    """Compute distances; without branches, so that the compiler vectorises the loop."""
    for i in range(len(distances)):
        x, y, z = directions[3 * i], directions[3 * i + 1], directions[3 * i + 2]
        distance = heights[i] / slopes[i] * math.sqrt(x * x + y * y + z * z)
        distances[i] = distance if face_ids[i] >= 0 else np.inf


@device_function
def _cast_frame(bvh, view, frame, rays, bins, number, space, state):
    first, end, room = bins.starts[number], bins.ends[number], bins.coordinates.shape[1]
    n_before = list_candidates(bvh, view, rect_of_rays(bins.coordinates, first, end, frame.max_w), space)
    if n_before == 0:
        return
    for chunk in range(first, end, CHUNK_POINTS):
        last = min(chunk + CHUNK_POINTS, end)
        n_listed = select_candidates(n_before, rect_of_rays(bins.coordinates, chunk, last, frame.max_w), space)
        if n_listed == 0:
            continue
        for packet in range(chunk, last, PACKET):
            for at in range(0, PACKET, N_LANES):
                store(state.coordinates, at, load(bins.coordinates, packet + at))
                store(state.coordinates, PACKET + at, load(bins.coordinates, room + packet + at))
            chosen = rays.chosen[packet : min(packet + PACKET, last)]
            taken = PacketRays(rays.origin, rays.directions, rays.face_ids, rays.heights, rays.slopes, chosen)
            first_hits_of_packet(bvh, view, frame, taken, n_listed, space, state)


# Bins: a block of rays is sorted by position in the image


@device_function
def _bin_rays(axes, rect, bits, directions, bins):
    """Compute image positions and cells of a block of rays, directions (3 m,).

    `axes` holds the rows x, y, w of each frame, (1 or 6, 3, 3). `rect` is the rectangle around the scene if there is
    one frame; rays outside it meet nothing.
    """
    n = len(directions) // 3
    if len(axes) == 1:
        _place_from_outside(axes[0], directions, bins.unsorted[: 2 * n])
        _number_cells(rect, bits, bins.unsorted[: 2 * n], bins.cells[:n])
    else:
        _place_on_cube(directions, bits, bins.unsorted[: 2 * n], bins.cells[:n])


@device_function
def _sort_bins(n, n_frames, bits, bins):
    """Sort the n rays of a block by their cells."""
    cells, counts, size = bins.cells[:n], bins.counts, 1 << (2 * bits)
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
        bins.starts[frame] = total
        if present >> frame & 1:
            total = _accumulate(counts[frame * size : (frame + 1) * size], total)
        bins.ends[frame] = total
        total = (total + PACKET - 1) // PACKET * PACKET
    x, y = bins.coordinates[0], bins.coordinates[1]
    _scatter(cells, nowhere, bins.unsorted, counts, x, y, bins.order)
    for frame in range(n_frames):
        last = bins.ends[frame] - 1
        for at in range(last + 1, last + 1 + -(last + 1) % PACKET):
            x[at], y[at] = x[last], y[last]


@device_function
def _accumulate(counts, total):
    """Turn counts of cells into the start of each cell, beginning at `total`; return the end of the last one."""
    for cell in range(len(counts)):
        count = counts[cell]
        counts[cell] = total
        total += count
    return total


@device_function
def _scatter(cells, nowhere, unsorted, starts, x, y, order):
    """Write positions and indices of rays in the order of their cells."""
    for i in range(len(cells)):
        if cells[i] >= nowhere:
            continue
        at = starts[cells[i]]
        starts[cells[i]] = at + 1
        x[at], y[at], order[at] = unsorted[2 * i], unsorted[2 * i + 1], i


# The compiler vectorises the loops below: they have no branches, and flat arrays, whose strides are known.


@njit(error_model="numpy")
def _place_from_outside(axes, directions, coordinates):
    """Compute positions in the frame of an eye outside; x is infinite for a ray that leads away."""
    for i in range(len(coordinates) // 2):
        x, y, z = directions[3 * i], directions[3 * i + 1], directions[3 * i + 2]
        u = axes[0, 0] * x + axes[0, 1] * y + axes[0, 2] * z
        v = axes[1, 0] * x + axes[1, 1] * y + axes[1, 2] * z
        w = axes[2, 0] * x + axes[2, 1] * y + axes[2, 2] * z
        inverse = 1.0 / w
        coordinates[2 * i], coordinates[2 * i + 1] = (u * inverse if w > 0.0 else np.inf), v * inverse


@njit(error_model="numpy")
def _number_cells(rect, bits, coordinates, cells):
    """Compute the cells of a single frame, which divide a rectangle; rays outside it get the cell past the last."""
    nowhere, most = np.int32(1 << (2 * bits)), np.float32((1 << bits) - 1)
    across = most / max(rect.right - rect.left, MIN_WIDTH)
    upwards = most / max(rect.top - rect.bottom, MIN_WIDTH)
    for i in range(len(cells)):
        x, y = coordinates[2 * i], coordinates[2 * i + 1]
        within = (x >= rect.left) & (x <= rect.right) & (y >= rect.bottom) & (y <= rect.top)
        cell = _cell_at(np.int32((x - rect.left) * across), np.int32((y - rect.bottom) * upwards))
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
    """Return the index of a cell along a Morton curve."""
    return _spread_bits(column) | (_spread_bits(row) << np.int32(1))


@always_inline
def _spread_bits(i):
    """Insert a zero before each of the `MAX_BITS` bits of a number."""
    i = (i | (i << np.int32(4))) & np.int32(0x30F)
    i = (i | (i << np.int32(2))) & np.int32(0x333)
    return (i | (i << np.int32(1))) & np.int32(0x555)


RAYS = Compilation(_cast_blocks, compile_first_hits)
SCATTERED_RAYS = Compilation(cast_singles, compile_scattered_rays)
