"""A mesh as the kernel reads it: faces along a Hilbert curve, and a tree of boxes over them. Experimental."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.arrays import FloatArray, IntArray
from zbuf_occlude.geometry.hilbert import hilbert_order
from zbuf_occlude.geometry.mesh import Mesh

LEAF, WIDTH = 4, 4
"""Faces of a cluster, boxes of a box."""
MARGIN = 1e-5
"""Added to boxes on each side, in the mesh's unit: more than what the kernel rounds."""
MOST_LEVELS = 32

PARAMETERS = np.dtype(
    [
        ("centre", "<f8", 3), ("scale", "<f8"), ("contact", "<f8"), ("n_points", "<i8"), ("n_eyes", "<i8"),
        ("n_levels", "<i4"), ("leaf", "<i4"), ("width", "<i4"), ("unused", "<i4"),
        ("level_start", "<i4", MOST_LEVELS), ("level_size", "<i4", MOST_LEVELS),
    ]
)  # fmt: skip
"""The twin of the kernel's struct of the same name."""


@dataclass(frozen=True, eq=False)
class MeshTree:
    """What the kernel reads of a mesh.

    Parameters
    ----------
    corners : (f, 3, 3) float64
        World space, in the tree's order.
    places : (f,) int32
        Where each face of the mesh is in that order.
    boxes : (b, 6) float32
        Lowest and highest corner in the mesh's unit, level by level, clusters first, the root last.
    level_start, level_size : list of int
    centre : (3,) float64
    scale : float
        A power of two: scaling rounds nothing.
    """

    corners: FloatArray
    places: IntArray
    boxes: NDArray[np.float32]
    level_start: list[int]
    level_size: list[int]
    centre: FloatArray
    scale: float

    @classmethod
    def of(cls, mesh: Mesh) -> "MeshTree":
        """Arrange a mesh."""
        scale = float(np.ldexp(1.0, min(-int(np.frexp(mesh.diagonal)[1]), 1023))) if mesh.diagonal > 0.0 else 1.0
        order = hilbert_order(mesh.corners.mean(axis=1))
        corners = mesh.corners[order]
        places = np.empty(len(order), dtype=np.int32)
        places[order] = np.arange(len(order), dtype=np.int32)
        local = (corners - mesh.centre) * scale
        levels = [_joined(local.min(axis=1), local.max(axis=1), LEAF)]
        while len(levels[-1][0]) > 1:
            levels.append(_joined(*levels[-1], WIDTH))
        sizes = [len(low) for low, _ in levels]
        boxes = np.concatenate([np.concatenate([low - MARGIN, high + MARGIN], axis=1) for low, high in levels])
        starts = [0, *np.cumsum(sizes[:-1]).tolist()]
        return cls(corners, places, boxes.astype(np.float32), starts, sizes, mesh.centre, scale)

    def parameters(self, n_points: int, n_eyes: int, contact: float) -> NDArray[Any]:
        """Return what a launch is given; `contact` in world units."""
        given = np.zeros((), dtype=PARAMETERS)
        given["centre"], given["scale"], given["contact"] = self.centre, self.scale, contact
        given["n_points"], given["n_eyes"] = n_points, n_eyes
        given["n_levels"], given["leaf"], given["width"] = len(self.level_size), LEAF, WIDTH
        given["level_start"][: len(self.level_start)] = self.level_start
        given["level_size"][: len(self.level_size)] = self.level_size
        return given

    def own_places(self, face_ids: IntArray) -> IntArray:
        """Return where the points' own faces are in the tree's order, (n,) int32; -1 of free points."""
        return np.where(face_ids >= 0, self.places[face_ids], np.int32(-1)).astype(np.int32)


def _joined(low: FloatArray, high: FloatArray, step: int) -> tuple[FloatArray, FloatArray]:
    """Return the boxes of this many neighbours each."""
    starts = np.arange(0, len(low), step)
    return np.minimum.reduceat(low, starts), np.maximum.reduceat(high, starts)
