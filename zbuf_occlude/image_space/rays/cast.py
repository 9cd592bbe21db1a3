"""Rays, shared out among threads: neighbours that begin in one place go 16 at a time, others one by one."""

import numpy as np

from zbuf_occlude.arrays import FloatArray, IntArray
from zbuf_occlude.image_space.layout import CLUSTER, PACKET
from zbuf_occlude.image_space.rays.beam import make_beam, make_state
from zbuf_occlude.image_space.rays.packet import first_hits_of_packet
from zbuf_occlude.image_space.rays.single import Stack, first_hit
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
    face_ids = np.full(len(directions), -1, dtype=np.int32)
    distances = np.full(len(directions), np.inf)
    origins, directions = np.ascontiguousarray(origins), np.ascontiguousarray(directions)
    together(_cast, -(-len(directions) // BLOCK_RAYS), scene, origins, directions, face_ids, distances)
    return face_ids, distances


@shared
def _cast(tasks, scene, origins, directions, face_ids, distances):
    """Take blocks of rays and fill in their answers."""
    room = CLUSTER * (len(scene.level_counts) + 8)
    stack = Stack(
        levels=np.empty(room, dtype=np.int64),
        nodes=np.empty(room, dtype=np.int64),
        nearest=np.empty(room, dtype=np.float32),
        lanes=np.empty(CLUSTER, dtype=np.float32),
    )
    state = make_state()
    n = len(directions)
    block = take(tasks)
    while block * BLOCK_RAYS < n:
        guess = -1
        for first in range(block * BLOCK_RAYS, min((block + 1) * BLOCK_RAYS, n), PACKET):
            last = min(first + PACKET, n)
            beam = make_beam(scene, origins, directions, first, last, state)
            if beam.together:
                first_hits_of_packet(scene, beam, stack, state)
                for i in range(first, last):
                    face_ids[i], distances[i] = state.face_ids[i - first], state.fractions[i - first]
            else:
                for i in range(first, last):
                    origin = origins[i if len(origins) > 1 else 0]
                    face_ids[i], distances[i] = first_hit(scene, origin, directions[i], guess, stack)
                    guess = face_ids[i] if face_ids[i] >= 0 else guess
            for i in range(first, last):  # so far in directions
                d = directions[i]
                distances[i] *= np.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
        block = take(tasks)
