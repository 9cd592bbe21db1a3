"""Engine of `exact`: hidden-surface removal in image space on the CPU; float64 decides what float32 cannot.

A mesh becomes a BVH, points become packets, and eyes become views. Each view is searched, or rays are cast.
docs/exact.md explains the idea.
"""

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.base.arrays import BoolArray, FloatArray, IntArray
from zbuf_occlude.engines.exact.bvh import build_bvh
from zbuf_occlude.engines.exact.rays import find_first_hits
from zbuf_occlude.engines.exact.search import answer_pairs, find_visible, find_visible_one_by_one
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.meshes.sampling import SurfacePoints

MIN_POINTS_PER_LEAF = 1
"""Below this many points per leaf, each point is tested alone: grouping them does not pay."""


class Engine:
    """Prepared mesh; `contact` is the contact tolerance in world units.

    Preparing costs O(f log f), each set of points O(n), and each eye about O(n log f).
    """

    def __init__(self, mesh: Mesh, contact: float) -> None:
        self._bvh = build_bvh(mesh, contact)

    def visible(self, points: SurfacePoints, eyes: FloatArray) -> BoolArray:
        """Return which of n points each of k eyes sees; (k, n) bool."""
        if len(self._bvh.face_ids) == 0:  # no face that could block
            return np.ones((len(eyes), len(points)), dtype=bool)
        if len(points) < MIN_POINTS_PER_LEAF * len(self._bvh.face_ids):
            return find_visible_one_by_one(self._bvh, points, eyes)
        return find_visible(self._bvh, points, eyes)

    def answer_pairs(
        self,
        positions: FloatArray,
        face_ids: IntArray,
        eyes: FloatArray,
        pairs: tuple[NDArray[np.int64], ...],
        visible: BoolArray,
    ) -> None:
        """Write the answers of chosen pairs of eye and point to `visible`, (k, n).

        `pairs` holds two arrays: indices into `eyes` (k, 3), and into `positions` (n, 3) and `face_ids` (n,).
        """
        if len(self._bvh.face_ids) == 0:
            visible[pairs] = True
        else:
            answer_pairs(self._bvh, positions, face_ids, eyes, pairs, visible.view(np.uint8))

    def first_hits(self, origins: FloatArray, directions: FloatArray) -> tuple[IntArray, FloatArray]:
        """Return the first face that each of n rays meets, (n,) int32, -1 for none, and its distance, (n,) float64."""
        return find_first_hits(self._bvh, origins, directions)
