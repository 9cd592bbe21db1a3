"""Tiles: for few points on many faces, the image is cut into tiles and each point tests its tile's clusters."""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from zbuf_occlude.arrays import IntArray
from zbuf_occlude.image_space.hiding import hide_points
from zbuf_occlude.image_space.packets import PACKET
from zbuf_occlude.image_space.projection import COORDINATE, FAR, ONE, ZERO, project_packet
from zbuf_occlude.image_space.scene import Float32
from zbuf_occlude.image_space.slots import SLOTS, slot_of
from zbuf_occlude.lanes import (
    divide,
    first_lane,
    highest,
    load,
    lowest,
    maximum,
    minimum,
    muladd,
    not_less,
    splat,
    store,
    whole,
)

SIDE = 32
"""Tiles along each side of the image, or a smaller power of two where lists would grow too long."""

DEPTHS = 64
"""Intervals of depth that the clusters are sorted into, nearest first."""


class Tiles(NamedTuple):
    """A thread's workspace for n points and m clusters: 32 bytes a point, 1.1 KB a cluster."""

    unsorted: Float32  # (3, n') x / w, y / w, w
    tile_ids: Float32  # (n',) whole numbers
    order: IntArray  # (n' + 16,) points sorted by tile
    image: Float32  # (3, n' + 16) x / w, y / w, w in this order
    point_starts: NDArray[np.int64]  # (SIDE^2 + 1,)
    deepest: Float32  # (SIDE^2,) highest w of a tile's points
    cluster_order: IntArray  # (m,) nearest first
    depth_starts: NDArray[np.int64]  # (DEPTHS + 1,)
    list_starts: NDArray[np.int64]  # (SIDE^2 + 1,)
    ends: NDArray[np.int64]  # (SIDE^2,)
    pairs: IntArray  # (capacity, 2) tiles and clusters before them, nearest first
    listed: IntArray  # (capacity,) clusters of the tiles, one after the other
    rectangles: Float32  # (5, capacity) theirs


@njit
def make_tiles(n_points, n_clusters):  # type: ignore[no-untyped-def]
    """Allocate for so many points, padding included."""
    capacity = 32 * n_clusters + SIDE * SIDE
    return Tiles(
        np.empty((3, n_points), dtype=np.float32),
        np.empty(n_points, dtype=np.float32),
        np.zeros(n_points + 16, dtype=np.int32),
        np.zeros((3, n_points + 16), dtype=np.float32),
        np.empty(SIDE * SIDE + 1, dtype=np.int64),
        np.empty(SIDE * SIDE, dtype=np.float32),
        np.empty(n_clusters, dtype=np.int32),
        np.empty(DEPTHS + 1, dtype=np.int64),
        np.empty(SIDE * SIDE + 1, dtype=np.int64),
        np.empty(SIDE * SIDE, dtype=np.int64),
        np.empty((capacity, 2), dtype=np.int32),
        np.empty(capacity, dtype=np.int32),
        np.empty((5, capacity), dtype=np.float32),
    )


@njit(_nrt=False, forceinline=True)
def search_tiles(scene, points, n_left, frame, window, eye, world_eye, space, tiles, epoch, answer):  # type: ignore[no-untyped-def]
    """Answer for the first `n_left` packets of ``space.left`` and an eye outside; False where a point is hidden."""
    x0, x1, y0, y1, w0, w1 = _project(points, frame, n_left, space.left, tiles)
    blur = points.farthest * max(ONE, ONE / w0)
    slack = np.float32(3.0) * COORDINATE * blur
    away = np.sqrt(eye[0] * eye[0] + eye[1] * eye[1] + eye[2] * eye[2])
    least = away * np.float32(0.999) - points.farthest - np.float32(scene.contact)
    nearer = ONE / least if least > ZERO else FAR
    farther = ONE / ((away + points.farthest) * np.float32(1.001))
    whole = (x0, x1, y0, y1, w1 + slack, blur, points.farthest, nearer, farther)
    if len(scene.used) <= SLOTS:
        for cluster in range(len(scene.used)):
            if space.rectangles[0, cluster] <= space.rectangles[1, cluster]:
                slot = slot_of(scene, cluster, frame, window, eye, ONE, space, epoch)
                for row in range(5):
                    space.rectangles[row, cluster] = space.slot_rectangles[slot, row]
    _sort_by_depth(scene, whole, space, tiles)
    side = SIDE
    while True:
        scale_x = np.float32(side) / max(x1 - x0, np.float32(1e-30))
        scale_y = np.float32(side) / max(y1 - y0, np.float32(1e-30))
        grid = (x0, y0, scale_x, scale_y, side)
        _bin_points(points, n_left, grid, space, tiles)
        if _bin_clusters(grid, slack, space, tiles) or side == 1:
            break
        side //= 2
    for tile in range(side * side):
        for start in range(tiles.point_starts[tile], tiles.point_starts[tile + 1], PACKET):
            left = min(tiles.point_starts[tile + 1] - start, PACKET)
            _search_packet(
                scene,
                points,
                start,
                (1 << left) - 1,
                tiles.list_starts[tile],
                tiles.list_starts[tile + 1],
                frame,
                window,
                eye,
                world_eye,
                whole,
                space,
                tiles,
                epoch,
                answer,
            )


@njit(_nrt=False)
def _project(points, frame, n_left, left, tiles):  # type: ignore[no-untyped-def]
    """Project packets, one after the other; return the lowest and highest x, y and w."""
    total = tiles.unsorted.shape[1]
    far, low = splat(FAR), splat(-FAR)
    x0, x1, y0, y1, w0, w1 = far, low, far, low, far, low
    for packet in range(n_left):
        base = packet * PACKET
        u, v, w = project_packet(points, left[packet] * PACKET, frame)
        inverse = divide(splat(ONE), w)
        u, v = u * inverse, v * inverse
        store(tiles.unsorted, base, u)
        store(tiles.unsorted, total + base, v)
        store(tiles.unsorted, 2 * total + base, w)
        x0, x1, y0, y1 = minimum(x0, u), maximum(x1, u), minimum(y0, v), maximum(y1, v)
        w0, w1 = minimum(w0, w), maximum(w1, w)
    return lowest(x0), highest(x1), lowest(y0), highest(y1), lowest(w0), highest(w1)


@njit(_nrt=False)
def _sort_by_depth(scene, whole, space, tiles):  # type: ignore[no-untyped-def]
    """Sort the clusters that are seen, and not behind all points, by their lowest w; `depth_starts[-1]` counts them."""
    n_clusters = len(scene.used)
    rectangles, starts = space.rectangles, tiles.depth_starts
    nearest = whole[4]
    for cluster in range(n_clusters):
        nearest = min(nearest, rectangles[4, cluster])
    scale = np.float32(DEPTHS - 1) / max(whole[4] - nearest, np.float32(1e-30))
    starts[:] = 0
    for cluster in range(n_clusters):
        if rectangles[0, cluster] <= rectangles[1, cluster] and rectangles[4, cluster] <= whole[4]:
            starts[np.int64((rectangles[4, cluster] - nearest) * scale) + 1] += 1
    for i in range(DEPTHS):
        starts[i + 1] += starts[i]
    for cluster in range(n_clusters):
        if rectangles[0, cluster] <= rectangles[1, cluster] and rectangles[4, cluster] <= whole[4]:
            depth = np.int64((rectangles[4, cluster] - nearest) * scale)
            tiles.cluster_order[starts[depth]] = cluster
            starts[depth] += 1


@njit(_nrt=False, forceinline=True)
def _cell(value, origin, scale, side):  # type: ignore[no-untyped-def]
    """Tile of a coordinate along one side. Monotone, so what lies within an interval lies within its tiles."""
    return np.int64(min(max((value - origin) * scale, ZERO), np.float32(side - 1)))


@njit(_nrt=False, forceinline=True)
def _cells(values, origin, scale, side):  # type: ignore[no-untyped-def]
    """The same for 16 of them."""
    cells = (values - splat(origin)) * splat(scale)
    return whole(minimum(maximum(cells, splat(ZERO)), splat(np.float32(side - 1))))


@njit(_nrt=False)
def _bin_points(points, n_left, grid, space, tiles):  # type: ignore[no-untyped-def]
    """Sort the points that are not yet decided by tile."""
    side, total = grid[4], tiles.unsorted.shape[1]
    starts = tiles.point_starts
    starts[: side * side + 1] = 0
    tiles.deepest[: side * side] = -FAR
    for packet in range(n_left):
        base, left = packet * PACKET, _undecided(points, space, packet)
        if left:
            column = _cells(load(tiles.unsorted, base), grid[0], grid[2], side)
            row = _cells(load(tiles.unsorted, total + base), grid[1], grid[3], side)
            store(tiles.tile_ids, base, muladd(row, splat(np.float32(side)), column))
        while left:
            i = base + first_lane(left)
            left &= left - 1
            tile = int(tiles.tile_ids[i])
            tiles.deepest[tile] = max(tiles.deepest[tile], tiles.unsorted[2, i])
            starts[tile + 1] += 1
    for tile in range(side * side):
        starts[tile + 1] += starts[tile]
        tiles.ends[tile] = starts[tile]
    for packet in range(n_left):
        base, left = packet * PACKET, _undecided(points, space, packet)
        first = space.left[packet] * PACKET
        while left:
            lane = first_lane(left)
            i = base + lane
            left &= left - 1
            tile = int(tiles.tile_ids[i])
            to = tiles.ends[tile]
            tiles.ends[tile] = to + 1
            tiles.order[to] = first + lane
            for j in range(3):
                tiles.image[j, to] = tiles.unsorted[j, i]


@njit(_nrt=False, forceinline=True)
def _undecided(points, space, i):  # type: ignore[no-untyped-def]
    """Mask of the points of the i-th packet left that are not decided."""
    packet = space.left[i]
    there = min(points.n_points - packet * PACKET, PACKET)
    return ((1 << there) - 1) & ~np.int64(space.decided[packet])


@njit(_nrt=False)
def _bin_clusters(grid, slack, space, tiles):  # type: ignore[no-untyped-def]
    """List the clusters of each tile, nearest first; False where the lists would not fit."""
    side, starts, n = grid[4], tiles.list_starts, 0
    starts[: side * side + 1] = 0
    for j in range(tiles.depth_starts[DEPTHS - 1]):
        cluster = tiles.cluster_order[j]
        x0, x1 = space.rectangles[0, cluster] - slack, space.rectangles[1, cluster] + slack
        y0, y1 = space.rectangles[2, cluster] - slack, space.rectangles[3, cluster] + slack
        w0 = space.rectangles[4, cluster] - slack
        left, right = _cell(x0, grid[0], grid[2], side), _cell(x1, grid[0], grid[2], side)
        for row in range(_cell(y0, grid[1], grid[3], side), _cell(y1, grid[1], grid[3], side) + 1):
            for tile in range(row * side + left, row * side + right + 1):
                if w0 <= tiles.deepest[tile]:
                    if n == len(tiles.listed):
                        return False
                    tiles.pairs[n, 0], tiles.pairs[n, 1] = tile, cluster
                    starts[tile + 1] += 1
                    n += 1
    for tile in range(side * side):
        starts[tile + 1] += starts[tile]
        tiles.ends[tile] = starts[tile]
    for i in range(n):
        tile, cluster = tiles.pairs[i, 0], tiles.pairs[i, 1]
        to = tiles.ends[tile]
        tiles.ends[tile] = to + 1
        tiles.listed[to] = cluster
        tiles.rectangles[0, to] = space.rectangles[0, cluster] - slack
        tiles.rectangles[1, to] = space.rectangles[1, cluster] + slack
        tiles.rectangles[2, to] = space.rectangles[2, cluster] - slack
        tiles.rectangles[3, to] = space.rectangles[3, cluster] + slack
        tiles.rectangles[4, to] = space.rectangles[4, cluster] - slack
    return True


@njit(_nrt=False, forceinline=True)
def _search_packet(  # type: ignore[no-untyped-def]
    scene, points, base, undecided, start, stop, frame, window, eye, world_eye, whole, space, tiles, epoch, answer
):
    """Test up to 16 points of a tile, a mask of those sorted from `base` on, against the tile's clusters."""
    total = tiles.image.shape[1]
    x, y, w = load(tiles.image, base), load(tiles.image, total + base), load(tiles.image, 2 * total + base)
    for j in range(start, stop):
        within = (
            undecided
            & not_less(x, splat(tiles.rectangles[0, j]))
            & not_less(splat(tiles.rectangles[1, j]), x)
            & not_less(y, splat(tiles.rectangles[2, j]))
            & not_less(splat(tiles.rectangles[3, j]), y)
            & not_less(w, splat(tiles.rectangles[4, j]))
        )
        if not within:
            continue
        cluster = tiles.listed[j]
        slot = slot_of(scene, cluster, frame, window, eye, ONE, space, epoch)
        hidden = hide_points(
            scene,
            space.slots,
            slot,
            space.doubtful[slot],
            cluster,
            within,
            tiles.order,
            base,
            tiles.image,
            base,
            points,
            whole,
            world_eye,
        )
        undecided &= ~hidden
        while hidden:
            answer[points.order[tiles.order[base + first_lane(hidden)]]] = False
            hidden &= hidden - 1
        if not undecided:
            return
