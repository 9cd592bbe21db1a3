"""`exact`: image space made exact on the CPU. The oracle's answers, faster than a ray caster's."""

import numba
import numpy as np

from zbuf_occlude.arrays import BoolArray, FloatArray
from zbuf_occlude.checks import check_fraction
from zbuf_occlude.image_space.backs import followed_area, make_solids, no_solids
from zbuf_occlude.image_space.frames import make_frames
from zbuf_occlude.image_space.packets import CHUNK, PACKET, make_packets
from zbuf_occlude.image_space.scene import make_scene
from zbuf_occlude.image_space.search import find_visible
from zbuf_occlude.image_space.surface import make_surface, no_surface
from zbuf_occlude.image_space.workspace import GROUP
from zbuf_occlude.mesh import Mesh
from zbuf_occlude.sampling import SurfacePoints
from zbuf_occlude.visibility.interface import CONTACT, Occluder

WORTH = 100
"""Answers a face after which it pays to look for solids: that takes about as long as it has saved by then."""

FOLLOWED = 8
"""With fewer points than so many times the faces, regions are not followed."""

LEAST_FOLLOWED = 0.3
"""Nor where visibility can be followed over a smaller part of the mesh's area."""

FOLLOWED_CONTACTS = (1e-6, 1e-4)
"""Nor with contact tolerances beside these: with none, and from 0.01 on, regions gave wrong answers in random scenes
with points on and near edges; why is not known for certain."""


def prepare(mesh: Mesh, *, contact: float = CONTACT) -> "Exact":
    """Make a mesh ready; `contact` is the contact tolerance as a fraction of the mesh's diagonal."""
    check_fraction("contact", contact)
    return Exact(mesh, contact)


class Exact(Occluder):
    """Packets of points against clusters of faces, both projected; float32 where its sign is certain, float64 else."""

    def __init__(self, mesh: Mesh, contact: float) -> None:
        super().__init__(mesh)
        self._contact, self._n_asked = contact, 0
        self._solids, self._looked = no_solids(), False
        self._scene = make_scene(mesh, contact * mesh.diagonal)
        self._surface, self._worth_following = no_surface(self._scene), False
        face_ids = self._scene.face_ids.reshape(-1)
        self._rows = np.full(len(mesh.faces) + 1, -1, dtype=np.int32)
        used = np.flatnonzero(face_ids >= 0)
        self._rows[face_ids[used]] = used

    def _visible(self, points: SurfacePoints, eyes: FloatArray) -> BoolArray:
        scene = self._scene
        if len(scene.used) == 0:
            return np.ones((len(eyes), len(points)), dtype=bool)
        self._n_asked += len(points) * len(eyes)
        if not self._looked and self._n_asked >= WORTH * len(self.mesh.faces):
            self._solids, self._looked = make_solids(self.mesh, self._contact), True
            self._surface = make_surface(scene, self._rows, self._solids)
            near = FOLLOWED_CONTACTS[0] <= self._contact <= FOLLOWED_CONTACTS[1]
            self._worth_following = near and followed_area(self.mesh, self._solids) >= LEAST_FOLLOWED
        packets = make_packets(points, scene, self._rows, self._solids, self._surface.records)
        frames = make_frames(eyes, scene.centre, scene.scale, float(packets.farthest))
        n_threads = numba.get_num_threads()
        n_groups = -(-packets.coordinates.shape[1] // (GROUP * CHUNK * PACKET))
        n_blocks = 1 if len(eyes) >= 4 * n_threads else min(n_groups, 4 * n_threads)
        following = packets.on_faces and self._worth_following and len(points) >= FOLLOWED * len(self.mesh.faces)
        answer = np.empty((len(eyes), len(points)), dtype=bool)
        if n_blocks > 1:
            answer[:] = True
        n_workers = min(n_threads, len(eyes) * n_blocks)
        find_visible(scene, self._surface, packets, frames, following, n_blocks, n_workers, answer)
        return answer
