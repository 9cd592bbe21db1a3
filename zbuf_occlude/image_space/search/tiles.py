"""Tiles: for few points on many faces, the image is cut into tiles and each point tests its tile's clusters."""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from zbuf_occlude.arrays import IntArray
from zbuf_occlude.image_space.layout import (
    BOTTOM,
    CHUNK,
    COORDINATE_ERROR,
    ENDLESS,
    LEFT,
    NEAREST,
    ONE,
    PACKET,
    RIGHT,
    TOP,
    ZERO,
)
from zbuf_occlude.image_space.scene.scene import Float32
from zbuf_occlude.image_space.search.hide import hide_by_cluster
from zbuf_occlude.image_space.search.listing import sort_by_depth
from zbuf_occlude.image_space.search.project import Extent
from zbuf_occlude.image_space.search.setup import slot_of
from zbuf_occlude.image_space.search.workspace import SLOTS, ClusterList, make_list, put
from zbuf_occlude.lanes import (
    divide,
    first_lane,
    highest,
    load3,
    lowest,
    maximum,
    minimum,
    not_less,
    splat,
    store3,
    transform,
)

TILES_PER_SIDE = 32
"""Tiles along each side of the image, or a smaller power of two where lists would grow too long."""


class Tiles(NamedTuple):
    """A thread's workspace for n points and m clusters: 32 bytes per point, 1.1 KB per cluster."""

    unsorted: Float32  # (3, n') x / w, y / w, w
    order: IntArray  # (n' + 16,) points sorted by tile
    image: Float32  # (3, n' + 16) x / w, y / w, w in this order
    point_starts: NDArray[np.int64]  # (tiles + 1,)
    farthest: Float32  # (tiles,) highest w of a tile's points
    list_starts: NDArray[np.int64]  # (tiles + 1,)
    ends: NDArray[np.int64]  # (tiles,)
    pairs: IntArray  # (capacity, 2) tiles and clusters before them, nearest first
    listed: ClusterList  # clusters of the tiles, one after the other


class Grid(NamedTuple):
    """How the image is cut: a tile's number is row x n_side + column."""

    left: np.float32
    bottom: np.float32
    scale_x: np.float32
    scale_y: np.float32
    n_side: int


@njit
def make_tiles(n_points, n_clusters):
    """Allocate for this many points, padding included."""
    n_tiles = TILES_PER_SIDE * TILES_PER_SIDE
    capacity = 32 * n_clusters + n_tiles
    return Tiles(
        unsorted=np.empty((3, n_points), dtype=np.float32),
        order=np.zeros(n_points + PACKET, dtype=np.int32),
        image=np.zeros((3, n_points + PACKET), dtype=np.float32),
        point_starts=np.empty(n_tiles + 1, dtype=np.int64),
        farthest=np.empty(n_tiles, dtype=np.float32),
        list_starts=np.empty(n_tiles + 1, dtype=np.int64),
        ends=np.empty(n_tiles, dtype=np.int64),
        pairs=np.empty((capacity, 2), dtype=np.int32),
        listed=make_list(capacity),
    )


@njit(_nrt=False)
def search_tiles(scene, points, view, chunks, space, tiles, answer):
    """Answer for the chunks from one to another and an eye outside; writes False where a point is hidden."""
    first, last = chunks[0] * CHUNK * PACKET, min(chunks[1] * CHUNK * PACKET, points.n_points)
    if first >= last:
        return
    extent = _project_points(scene, points, view, first, last, tiles)
    n_clusters = _list_nearest_first(scene, view, extent, space)
    error = np.float32(3.0) * COORDINATE_ERROR * extent.blur
    n_side = TILES_PER_SIDE
    while True:
        grid = Grid(
            left=extent.left,
            bottom=extent.bottom,
            scale_x=np.float32(n_side) / max(extent.right - extent.left, np.float32(1e-30)),
            scale_y=np.float32(n_side) / max(extent.top - extent.bottom, np.float32(1e-30)),
            n_side=n_side,
        )
        _bin_points(first, last, grid, tiles)
        if _bin_clusters(n_clusters, grid, error, space, tiles) or n_side == 1:
            break
        n_side //= 2
    for tile in range(n_side * n_side):
        for start in range(tiles.point_starts[tile], tiles.point_starts[tile + 1], PACKET):
            undecided = (1 << min(tiles.point_starts[tile + 1] - start, PACKET)) - 1
            for i in range(PACKET):
                space.ids[i] = tiles.order[start + i]
                space.image[0, i], space.image[1, i] = tiles.image[0, start + i], tiles.image[1, start + i]
            hidden = _search_tile(scene, points, view, tile, start, undecided, extent, (space, tiles))
            while hidden:
                answer[points.order[tiles.order[start + first_lane(hidden)]]] = False
                hidden &= hidden - 1


@njit(_nrt=False)
def _project_points(scene, points, view, first, last, tiles):
    """Project points, packet after packet, and return their extent."""
    far, low = splat(ENDLESS), splat(-ENDLESS)
    x0, x1, y0, y1, w0, w1 = far, low, far, low, far, low
    for base in range(first, last, PACKET):
        x, y, z = load3(points.coordinates, base, points.coordinates.shape[1])
        u, v, w = transform(view.matrix, x, y, z)
        inverse = divide(splat(ONE), w)
        u, v = u * inverse, v * inverse
        store3(tiles.unsorted, base - first, tiles.unsorted.shape[1], (u, v, w))
        x0, x1, y0, y1 = minimum(x0, u), maximum(x1, u), minimum(y0, v), maximum(y1, v)
        w0, w1 = minimum(w0, w), maximum(w1, w)
    blur = points.farthest * max(ONE, ONE / lowest(w0))
    away = np.sqrt(view.eye[0] * view.eye[0] + view.eye[1] * view.eye[1] + view.eye[2] * view.eye[2])
    least = away * np.float32(0.999) - points.farthest - np.float32(scene.contact)
    return Extent(
        left=lowest(x0),
        right=highest(x1),
        bottom=lowest(y0),
        top=highest(y1),
        farthest=highest(w1) + np.float32(3.0) * COORDINATE_ERROR * blur,
        blur=blur,
        reach=points.farthest,
        inverse_distance_max=ONE / least if least > ZERO else ENDLESS,
        inverse_distance_min=ONE / ((away + points.farthest) * np.float32(1.001)),
    )


@njit(_nrt=False)
def _list_nearest_first(scene, view, extent, space):
    """List in ``space.scratch[1]`` the clusters that are seen, and not behind all points; return how many."""
    bounds, n = space.rectangles, 0
    for cluster in range(len(scene.used)):
        if len(scene.used) <= SLOTS and bounds[LEFT, cluster] <= bounds[RIGHT, cluster]:
            slot = slot_of(scene, cluster, view, space)
            for row in range(6):
                bounds[row, cluster] = space.slot_rectangles[row, slot]
        if bounds[LEFT, cluster] <= bounds[RIGHT, cluster] and bounds[NEAREST, cluster] <= extent.farthest:
            space.scratch[0, n] = cluster
            n += 1
    sort_by_depth(space.scratch[0], space.scratch[1], n, extent.farthest, space)
    return n


@njit(_nrt=False, forceinline=True)
def _cell(value, origin, scale, n_side):
    """Tile of a coordinate along one side. Monotone, so what lies within an interval lies within its tiles."""
    return np.int64(min(max((value - origin) * scale, ZERO), np.float32(n_side - 1)))


@njit(_nrt=False, forceinline=True)
def _tile_of(grid, x, y):
    column, row = _cell(x, grid.left, grid.scale_x, grid.n_side), _cell(y, grid.bottom, grid.scale_y, grid.n_side)
    return row * grid.n_side + column


@njit(_nrt=False)
def _bin_points(first, last, grid, tiles):
    """Sort points by tile."""
    n_tiles, starts, unsorted = grid.n_side * grid.n_side, tiles.point_starts, tiles.unsorted
    starts[: n_tiles + 1] = 0
    tiles.farthest[:n_tiles] = -ENDLESS
    for i in range(last - first):
        tile = _tile_of(grid, unsorted[0, i], unsorted[1, i])
        tiles.farthest[tile] = max(tiles.farthest[tile], unsorted[2, i])
        starts[tile + 1] += 1
    for tile in range(n_tiles):
        starts[tile + 1] += starts[tile]
        tiles.ends[tile] = starts[tile]
    for i in range(last - first):
        tile = _tile_of(grid, unsorted[0, i], unsorted[1, i])
        to = tiles.ends[tile]
        tiles.ends[tile] = to + 1
        tiles.order[to] = first + i
        for axis in range(3):
            tiles.image[axis, to] = unsorted[axis, i]


@njit(_nrt=False)
def _bin_clusters(n_clusters, grid, error, space, tiles):
    """List the clusters of each tile, nearest first; False where the lists would not fit."""
    n_tiles, starts, bounds, n = grid.n_side * grid.n_side, tiles.list_starts, space.rectangles, 0
    starts[: n_tiles + 1] = 0
    for j in range(n_clusters):
        cluster = space.scratch[1, j]
        bounds[LEFT, cluster] -= error
        bounds[RIGHT, cluster] += error
        bounds[BOTTOM, cluster] -= error
        bounds[TOP, cluster] += error
        bounds[NEAREST, cluster] -= error
        low = _tile_of(grid, bounds[LEFT, cluster], bounds[BOTTOM, cluster])
        high = _tile_of(grid, bounds[RIGHT, cluster], bounds[TOP, cluster])
        n_columns = high % grid.n_side - low % grid.n_side
        for corner in range(low, high + 1 - n_columns, grid.n_side):
            for tile in range(corner, corner + n_columns + 1):
                if bounds[NEAREST, cluster] <= tiles.farthest[tile]:
                    if n == len(tiles.pairs):
                        return False
                    tiles.pairs[n, 0], tiles.pairs[n, 1] = tile, cluster
                    starts[tile + 1] += 1
                    n += 1
    for tile in range(n_tiles):
        starts[tile + 1] += starts[tile]
        tiles.ends[tile] = starts[tile]
    for i in range(n):
        tile, cluster = tiles.pairs[i, 0], tiles.pairs[i, 1]
        put(tiles.listed, tiles.ends[tile], cluster, bounds, cluster)
        tiles.ends[tile] += 1
    return True


@njit(_nrt=False, forceinline=True)
def _search_tile(scene, points, view, tile, start, undecided, extent, spaces):
    """Mask of the points in hand, a tile's from `start` on, that the tile's clusters hide."""
    space, tiles = spaces
    x, y, w = load3(tiles.image, start, tiles.image.shape[1])
    bounds, found_hidden = tiles.listed.rectangles, 0
    for j in range(tiles.list_starts[tile], tiles.list_starts[tile + 1]):
        within = (
            undecided
            & not_less(x, splat(bounds[LEFT, j]))
            & not_less(splat(bounds[RIGHT, j]), x)
            & not_less(y, splat(bounds[BOTTOM, j]))
            & not_less(splat(bounds[TOP, j]), y)
            & not_less(w, splat(bounds[NEAREST, j]))
        )
        if within:
            cluster = tiles.listed.clusters[j]
            slot = slot_of(scene, cluster, view, space)
            hidden = hide_by_cluster(scene, points, view, space, slot, cluster, within, extent)
            found_hidden |= hidden
            undecided &= ~hidden
            if not undecided:
                break
    return found_hidden
