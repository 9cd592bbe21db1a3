"""Rays, shared out among threads: neighbours that begin in one place go 16 at a time, others one by one.

Who gives one origin for all rays need not think of their order: where rays that follow each other do not go the same
way, as those of a spinning LiDAR do not, they are sorted by direction.
"""

import math

import numpy as np
from numba import njit

from zbuf_occlude.arrays import FloatArray, IntArray
from zbuf_occlude.image_space.layout import CLUSTER, PACKET
from zbuf_occlude.image_space.rays.beam import NARROW, make_beam, make_state
from zbuf_occlude.image_space.rays.packet import first_hits_of_packet
from zbuf_occlude.image_space.rays.single import Stack, first_hit
from zbuf_occlude.image_space.reference import reference
from zbuf_occlude.image_space.scene import Scene
from zbuf_occlude.threads import shared, take, together

BLOCK_RAYS = 32 * PACKET
"""Rays that a thread casts at a time, in the caller's order: neighbours often meet the same face."""


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
    face_ids, distances = np.full(n, -1, dtype=np.int32), np.full(n, np.inf)
    origins, directions = np.ascontiguousarray(origins), np.ascontiguousarray(directions)
    order = np.arange(n)
    if len(origins) == 1 and n > PACKET and not _follow_each_other(directions):
        cells = np.empty(n, dtype=np.uint16)
        together(_find_cells, -(-n // BLOCK_RAYS), directions, cells)
        order = np.argsort(cells, kind="stable")  # of 16 bits: a radix sort
    together(_cast, -(-n // BLOCK_RAYS), scene, origins, directions, order, face_ids, distances)
    return face_ids, distances


def _follow_each_other(directions: FloatArray) -> bool:
    """Whether most rays that come one after the other go nearly the same way, by 64 packets taken from all over."""
    firsts = np.linspace(0, len(directions) - PACKET, 64).astype(np.int64)
    packets = directions[firsts[:, None] + np.arange(PACKET)]
    packets = packets / np.abs(packets).max(axis=2, keepdims=True)  # squares neither overflow nor vanish
    packets = packets / np.linalg.norm(packets, axis=2, keepdims=True)
    narrow = (packets @ packets[:, PACKET // 2, :, None])[..., 0].min(axis=1) > NARROW
    return bool(narrow.mean() > 0.5)


@shared
def _find_cells(tasks, directions, cells):
    """Number the cell of a 256 x 256 octahedral map that each direction points to, along a Morton curve.

    References
    ----------
    Cigolle et al.: A survey of efficient representations for independent unit vectors. Journal of Computer Graphics
    Techniques 3 (2014).
    """
    block = take(tasks)
    while block * BLOCK_RAYS < len(directions):
        for i in range(block * BLOCK_RAYS, min((block + 1) * BLOCK_RAYS, len(directions))):
            x, y, z = directions[i]
            size = 1.0 / (abs(x) + abs(y) + abs(z))
            u, v = x * size, y * size
            if z < 0.0:
                u, v = math.copysign(1.0 - abs(v), u), math.copysign(1.0 - abs(u), v)
            cells[i] = _spread(u) | (_spread(v) << np.uint32(1))
        block = take(tasks)


@njit(_nrt=False)
def _spread(coordinate):
    """Bits of the cell of a coordinate in [-1, 1], with gaps between them."""
    bits = np.uint32(min(max(128.0 * (coordinate + 1.0), 0.0), 255.0))
    bits = (bits | (bits << np.uint32(4))) & np.uint32(0x0F0F)
    bits = (bits | (bits << np.uint32(2))) & np.uint32(0x3333)
    return (bits | (bits << np.uint32(1))) & np.uint32(0x5555)


@shared
def _cast(tasks, scene, origins, directions, order, face_ids, distances):
    """Take blocks of rays and fill in their answers."""
    room = CLUSTER * (len(scene.level_counts) + 8)
    stack = Stack(
        levels=np.empty(room, dtype=np.int64),
        nodes=np.empty(room, dtype=np.int64),
        nearest=np.empty(room, dtype=np.float32),
        lanes=np.empty(CLUSTER, dtype=np.float32),
    )
    rays, hits = (origins, directions, order), (face_ids, distances)
    _cast_blocks(tasks, reference(scene), rays, hits, stack, make_state())


@njit(_nrt=False)
def _cast_blocks(tasks, scene, rays, hits, memory, beam_state):
    stack, state = reference(memory), reference(beam_state)
    origins, directions, order = rays
    face_ids, distances = hits
    n = len(directions)
    block = take(tasks)
    while block * BLOCK_RAYS < n:
        guess = -1
        for first in range(block * BLOCK_RAYS, min((block + 1) * BLOCK_RAYS, n), PACKET):
            last = min(first + PACKET, n)
            beam = make_beam(scene, origins, directions, order[first:last], state)
            if beam.together:
                first_hits_of_packet(scene, beam, stack, state)
            for lane in range(last - first):
                i = order[first + lane]
                if beam.together:
                    face_ids[i], distances[i] = state.face_ids[lane], state.fractions[lane]
                else:
                    origin = origins[i if len(origins) > 1 else 0]
                    face_ids[i], distances[i] = first_hit(scene, origin, directions[i], guess, stack)
                    guess = face_ids[i] if face_ids[i] >= 0 else guess
                d = directions[i]  # so far in lengths of this
                distances[i] *= math.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
        block = take(tasks)
