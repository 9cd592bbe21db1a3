"""The engine of `exact`: hidden-surface removal in image space on the CPU, every doubt decided by the definition.

A mesh becomes a BVH, points become packets, eyes become views, and each view is searched; rays are cast. docs/exact.md
tells the idea.
"""

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.arrays import BoolArray, FloatArray, IntArray
from zbuf_occlude.exact.bvh import build_bvh
from zbuf_occlude.exact.rays import find_first_hits
from zbuf_occlude.exact.search import answer_pairs, find_visible, find_visible_one_by_one
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.geometry.sampling import SurfacePoints

FEW_POINTS_PER_LEAF = 1
"""Fewer points per leaf are looked at one by one: an eye would see mostly other leaves."""


class Engine:
    """A prepared mesh; `contact` is the contact tolerance, world units.

    Costs O(f log f) once, then O(n) for each set of points, and for each eye about n log f.
    """

    def __init__(self, mesh: Mesh, contact: float) -> None:
        self._bvh = build_bvh(mesh, contact)

    def visible(self, points: SurfacePoints, eyes: FloatArray) -> BoolArray:
        """Return which of n points each of k eyes sees; (k, n) bool."""
        if len(self._bvh.face_ids) == 0:  # no face that could block
            return np.ones((len(eyes), len(points)), dtype=bool)
        if len(points) < FEW_POINTS_PER_LEAF * len(self._bvh.face_ids):
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
        """Write to (k, n) `visible` whether the eye sees the point, of pairs of eye and point alone.

        `pairs` are two arrays of their numbers; positions (n, 3) and face_ids (n,) are the points', eyes (k, 3).
        """
        if len(self._bvh.face_ids) == 0:
            visible[pairs] = True
        else:
            answer_pairs(self._bvh, positions, face_ids, eyes, pairs, visible.view(np.uint8))

    def first_hits(self, origins: FloatArray, directions: FloatArray) -> tuple[IntArray, FloatArray]:
        """Return which face n rays meet first, (n,) int32, -1 for none, and the eye distance, (n,) float64."""
        return find_first_hits(self._bvh, origins, directions)
