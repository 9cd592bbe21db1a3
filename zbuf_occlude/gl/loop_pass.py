"""The points tested against the depth atlas by compiled loops: what the shaders do, where a CPU would run these."""

from typing import NamedTuple

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from zbuf_occlude.arrays import BoolArray, FloatArray, IntArray
from zbuf_occlude.gl.atlas import Atlas
from zbuf_occlude.gl.loop_test import PLACE, on_side, settle, vote
from zbuf_occlude.gl.point_data import Batch, Criteria, PointData, coherent_order
from zbuf_occlude.gl.tiles import CUBE
from zbuf_occlude.lanes import ALL, N_LANES, first_lane
from zbuf_occlude.threads import threaded

BLOCK = 128
"""Packets of 16 points that one thread takes at a time."""

Float32 = NDArray[np.float32]


class _Points(NamedTuple):
    """Points in the order in which the loops take them, unit space."""

    order: NDArray[np.int64]  # (n,) where each was among the caller's
    coordinates: Float32  # (3, n'), filled up to whole packets of 16 by repeating the last one
    normals: Float32  # (3, n')
    own: IntArray  # (n,)
    closed: NDArray[np.int64]  # (n' / 16,) masks
    positions: FloatArray  # (n, 3)


class LoopPass:
    """Some points, and their answers.

    Parameters
    ----------
    points : PointData
    atlas : Atlas
        What is drawn into before `ask`.
    tiles : (k x tiles_an_eye,) TILE
        Of all eyes.
    tiles_an_eye : int
        1, or `CUBE`.
    corners : (f, 3, 3) float64
        Of the faces drawn, unit space; none are needed without witnesses.
    criteria : Criteria
    out : (k, n) bool
        Receives the answers.

    Notes
    -----
    The same test as `PointPass` (`loop_test` says how nearly). A software renderer runs shaders on the CPU, for some
    27 ns a point and eye; these loops take 9, and reading the atlas is a copy in memory. Takes 61 bytes a point.
    """

    def __init__(
        self,
        points: PointData,
        atlas: Atlas,
        tiles: NDArray[np.void],
        tiles_an_eye: int,
        corners: FloatArray,
        criteria: Criteria,
        out: BoolArray,
    ) -> None:
        order = coherent_order(points.positions, points.normals)
        self._points = _Points(order, *_pack(order, *points))
        self._atlas, self._out, self._corners, self._criteria = atlas, out, corners, criteria
        self._tiles = tiles.view(np.float32).reshape(len(tiles), -1)
        self._tiles_an_eye = tiles_an_eye

    def ask(self, batch: Batch) -> None:
        """Answer for a batch, which has just been drawn."""
        first, n_tiles = batch.first_eye * self._tiles_an_eye, batch.n_eyes * self._tiles_an_eye
        answer(
            *self._atlas.read_rows(n_tiles),
            self._tiles[first : first + n_tiles],
            self._tiles_an_eye,
            self._points,
            self._corners,
            self._criteria,
            self._out[batch.first_eye : batch.first_eye + batch.n_eyes],
        )

    def finish(self, batches: list[Batch]) -> None:
        """Do nothing: the answers are there as soon as they are asked for."""

    def release(self) -> None:
        """Do nothing: the GPU holds nothing."""


@threaded
def _pack(
    order: NDArray[np.int64], positions: FloatArray, normals: Float32, own: IntArray, closed: BoolArray
) -> tuple[Float32, Float32, IntArray, NDArray[np.int64], FloatArray]:
    """All of `_Points` but the order."""
    n, n_packets = len(order), -(-len(order) // N_LANES)
    coordinates = np.empty((3, n_packets * N_LANES), dtype=np.float32)
    ordered_normals = np.empty_like(coordinates)
    ordered_own = np.empty(n, dtype=np.int32)
    masks = np.zeros(n_packets, dtype=np.int64)
    ordered = np.empty((n, 3))
    for packet in prange(n_packets):
        for i in range(packet * N_LANES, (packet + 1) * N_LANES):
            k = order[min(i, n - 1)]
            masks[packet] |= int(closed[k]) << (i % N_LANES)
            for axis in range(3):
                coordinates[axis, i], ordered_normals[axis, i] = positions[k, axis], normals[k, axis]
            if i < n:
                ordered_own[i] = own[k]
                for axis in range(3):
                    ordered[i, axis] = positions[k, axis]
    return coordinates, ordered_normals, ordered_own, masks, ordered


@threaded
def answer(
    depths: Float32,
    seen: IntArray,
    tiles: Float32,
    tiles_an_eye: int,
    points: _Points,
    corners: FloatArray,
    criteria: Criteria,
    out: BoolArray,
) -> None:
    """Answer for the eyes of a batch.

    Parameters
    ----------
    depths, seen : (height, width) float32 and int32
        The atlas, the lowest row first; `seen` may be empty without a refinement.
    tiles : (n, 32) float32
    tiles_an_eye : int
    points, corners, criteria
        As in `LoopPass`.
    out : (k, n) bool
    """
    n_packets = len(points.closed)
    n_blocks = -(-n_packets // BLOCK)
    for task in prange(len(out) * n_blocks):
        eye, block = task // n_blocks, task % n_blocks
        first, last = block * BLOCK, min((block + 1) * BLOCK, n_packets)
        places = np.empty((PLACE, N_LANES), dtype=np.float32)
        _ask(first, last, eye, depths, seen, tiles, tiles_an_eye, points, corners, criteria, places, out)


# _nrt=False: the loops allocate nothing, and counting references to their arrays would cost more than the arithmetic


@njit(_nrt=False)
def _ask(first, last, eye, depths, seen, tiles, tiles_an_eye, points, corners, criteria, places, out):  # type: ignore[no-untyped-def]
    """Answer for an eye and the packets first to last; `places` is scratch."""
    cube = tiles_an_eye == CUBE
    for packet in range(first, last):
        base = packet * N_LANES
        visible = 0
        for tile in range(eye * tiles_an_eye, (eye + 1) * tiles_an_eye):
            among = on_side(tile % CUBE, base, tile, tiles, points) if cube else ALL
            if cube and not among:
                continue
            found, doubtful = vote(packet, tile, cube, depths, tiles, points, criteria, places)
            visible |= found & among
            doubtful &= among
            while doubtful:
                lane = first_lane(doubtful)
                doubtful &= doubtful - 1
                if base + lane < len(points.order):
                    decided = settle(base + lane, lane, tile, depths, seen, tiles, points, corners, criteria, places)
                    visible |= int(decided) << lane
        for lane in range(min(N_LANES, len(points.order) - base)):
            out[eye, points.order[base + lane]] = visible >> lane & 1
