"""What stands in scenes besides objects: plates, boxes, poles; few faces each, in metres."""

from functools import lru_cache

import numpy as np

from zbuf_occlude.arrays import FloatArray
from zbuf_occlude.geometry.mesh import Mesh

_CORNERS = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (0.0, 1.0)])
_SIDES = ((0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5))


@lru_cache(4)
def plate(half: float) -> Mesh:
    """Return a horizontal square at z = 0, `half` to each side."""
    corners = half * np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    return Mesh(corners, np.array([[0, 1, 2], [0, 2, 3]]), "plate")


@lru_cache(16)
def box(length: float, width: float, height: float) -> Mesh:
    """Return a box that stands on z = 0, its length along x."""
    faces = [face for a, b, c, d in _SIDES for face in ([a, b, c], [a, c, d])]
    return Mesh(_CORNERS * [length, width, height], np.array(faces), "box")


@lru_cache(16)
def pole(radius: float, height: float, n_sides: int = 12) -> Mesh:
    """Return an upright prism that stands on z = 0, open below and above."""
    angles = np.arange(n_sides) * (2 * np.pi / n_sides)
    ring: FloatArray = np.stack([radius * np.cos(angles), radius * np.sin(angles), np.zeros(n_sides)], axis=1)
    i = np.arange(n_sides)
    j = (i + 1) % n_sides
    faces = np.concatenate([np.stack([i, j, j + n_sides], 1), np.stack([i, j + n_sides, i + n_sides], 1)])
    return Mesh(np.concatenate([ring, ring + np.array([0.0, 0.0, height])]), faces, "pole")
