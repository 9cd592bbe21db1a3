"""Sizes, array layouts and float32 error bounds that the kernels share, and a thread's workspace."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.base.arrays import IntArray
from zbuf_occlude.base.jit.compiler import always_inline
from zbuf_occlude.base.jit.simd import N_LANES, N_WIDE, load_scalar

Float32 = NDArray[np.float32]
Int64 = NDArray[np.int64]

LEAF = N_LANES
"""Faces of a leaf, and children of a node: tested in one vector."""
PACKET = N_WIDE
"""Points, or rays, of a packet: tested together in two registers, to amortise a hard-to-predict branch."""
CHUNK = 8
"""Packets of a chunk, which share a candidate list."""
CHUNK_POINTS = CHUNK * PACKET
GROUP = N_LANES
"""Chunks of a group: their boxes are projected in one vector."""

# rows of (6, n) boxes: lower and upper corner; an axis' upper bound is UPPER rows after its lower one
UPPER = 3
# rows of (6, n) rectangles: bounds of x / w and y / w, the position in the image, and of w
LEFT, RIGHT, BOTTOM, TOP, MIN_W, MAX_W = range(6)
# rows of a leaf's triangle set-up, one lane per face
EDGES = 0  # A, B, C of three edge functions A x + B y + C, in units of their error; all are >= 0 inside the face
NORMAL = 9  # unit normal and offset: n . p - offset is positive on the eye's side
CONTACT = 13  # contact tolerance times the eye's distance from the plane
SETUP_ROWS = 14
# rows of a leaf's triangles, one lane per face
FIRST_CORNER, FIRST_EDGE, SECOND_EDGE = 0, 3, 6  # the first corner, and the edges from it to the second and the third
LEAST = 9  # least value, of rounding, that a ray's test of a face may have where the ray hits it
TRIANGLE_ROWS = 10

ROUNDOFF = np.float32(2.0**-24)
"""Unit roundoff of float32: the largest relative error of one operation."""
COORDINATE_ERROR = np.float32(8.0) * ROUNDOFF
"""Error bound of a projected coordinate, for a point of magnitude 1 (derived in `project`)."""
CORNER_ERROR = np.float32(11.0) * ROUNDOFF
"""Error bound of a projected corner of a face (derived in `triangle_setup`)."""
AREA_ERROR = 1.3e-6
"""Error bound of a ray's tests of a face, per sum of the 1-norms of two edges (derived in `single_rays`)."""
VOLUME_ERROR = 4.2e-6
"""Error bound of the same tests, per product of both 1-norms; both parts add up."""
MIN_ERROR = 1e-30
"""Least error bound of the same tests: products of shorter edges underflow."""
EDGE_ERROR = np.float32(80.0) * ROUNDOFF
"""Error bound of an edge function, as a share of the face's size, at magnitude / w = 1 (see `triangle_setup`)."""
PLANE_ERROR = np.float32(12.0) * ROUNDOFF
"""Error bound of a point's distance from a plane, for a point of magnitude 1."""

F32_MAX = np.float32(3e38)
ZERO, HALF, ONE = np.float32(0.0), np.float32(0.5), np.float32(1.0)

SLOTS = 4096
"""Maximum triangle set-ups that a thread keeps, 900 bytes each; a power of two."""
DEPTHS = 64
"""Number of depth intervals that candidates are sorted into."""


def aligned(*shape: int) -> Float32:
    """Allocate a float32 array that starts at a cache line, so that every 16 numbers lie in one line."""
    numbers = np.empty(math.prod(shape) + N_LANES, dtype=np.float32)
    first = -numbers.ctypes.data // numbers.itemsize % N_LANES
    return numbers[first : first + len(numbers) - N_LANES].reshape(shape)


class CandidateList(NamedTuple):
    """Leaves that may hide something, nearest first; their number is passed beside the list."""

    leaves: IntArray  # (capacity,)
    rectangles: Float32  # (6, capacity) around the leaves in the image


class Workspace(NamedTuple):
    """Working memory of a thread that searches views: up to 4 MB of triangle set-ups, and about 5 bytes per face."""

    rectangles: Float32  # (6 n, 16) around the children of n nodes in the image
    projected: Int64  # (n,) number of the view that each node's rectangles belong to
    chunk_rectangles: Float32  # (6, GROUP) around the chunks of a group
    scratch: IntArray  # (2, leaves + 16)
    depth_starts: Int64  # (DEPTHS + 1,)
    before: CandidateList  # the leaves before a group of chunks
    listed: CandidateList  # those of `before` that are before the current chunk
    setups: Float32  # (n_slots x SETUP_ROWS x 16,)
    slot_rectangles: Float32  # (6, n_slots) around the faces that each slot holds
    slot_tags: Int64  # (n_slots,) view and leaf of each slot
    doubtful: Int64  # (n_slots,) mask of the faces of each slot that float32 must not decide
    image: Float32  # (3, 32) x / w, y / w and w of the current packet


def make_workspace(n_leaves: int, n_nodes: int) -> Workspace:
    """Allocate a thread's workspace. numba compiles this function too."""
    capacity = n_leaves + LEAF
    leaves, rectangles = np.empty((2, capacity), dtype=np.int32), np.empty((2, 6, capacity), dtype=np.float32)
    n_slots = 1
    while n_slots < min(n_leaves, SLOTS):
        n_slots *= 2
    return Workspace(
        rectangles=np.empty((n_nodes * 6, LEAF), dtype=np.float32),
        projected=np.full(n_nodes, -1, dtype=np.int64),
        chunk_rectangles=np.empty((6, GROUP), dtype=np.float32),
        scratch=np.empty((2, capacity), dtype=np.int32),
        depth_starts=np.zeros(DEPTHS + 1, dtype=np.int64),
        before=CandidateList(leaves[0], rectangles[0]),
        listed=CandidateList(leaves[1], rectangles[1]),
        setups=np.empty(n_slots * SETUP_ROWS * LEAF, dtype=np.float32),
        slot_rectangles=np.empty((6, n_slots), dtype=np.float32),
        slot_tags=np.full(n_slots, -1, dtype=np.int64),
        doubtful=np.zeros(n_slots, dtype=np.int64),
        image=np.zeros((3, PACKET), dtype=np.float32),
    )


@always_inline
def put(candidates, at, leaf, rectangles, index, stride):
    """Write entry `at` of a list: a leaf and its rectangle, read with a stride from a flat index."""
    candidates.leaves[at] = leaf
    for row in range(6):
        candidates.rectangles[row, at] = load_scalar(rectangles, index + row * stride)


@always_inline
def flat(slot):
    """Return the flat index of a child's first number in the boxes or rectangles of nodes' children."""
    return 6 * (slot & -LEAF) + (slot & (LEAF - 1))
