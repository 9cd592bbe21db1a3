"""A sphere and a box about the origin."""

import numpy as np

from zbuf_occlude.base.arrays import FloatArray, IntArray
from zbuf_occlude.base.errors import OptionError
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.meshes.shapes.kit import boxes, quartered

_PHI = (1 + 5**0.5) / 2
_ICOSAHEDRON = np.array(
    [[-1, _PHI, 0], [1, _PHI, 0], [-1, -_PHI, 0], [1, -_PHI, 0], [0, -1, _PHI], [0, 1, _PHI],
     [0, -1, -_PHI], [0, 1, -_PHI], [_PHI, 0, -1], [_PHI, 0, 1], [-_PHI, 0, -1], [-_PHI, 0, 1]]
)  # fmt: skip
_ICOSAHEDRON_FACES: IntArray = np.array(
    [[0, 11, 5], [0, 5, 1], [0, 1, 7], [0, 7, 10], [0, 10, 11], [1, 5, 9], [5, 11, 4], [11, 10, 2], [10, 7, 6],
     [7, 1, 8], [3, 9, 4], [3, 4, 2], [3, 2, 6], [3, 6, 8], [3, 8, 9], [4, 9, 5], [2, 4, 11], [6, 2, 10],
     [8, 6, 7], [9, 8, 1]], dtype=np.int32
)  # fmt: skip


def icosphere(subdivisions: int = 3, radius: float = 1.0) -> Mesh:
    """Return a sphere about the origin of ``20 * 4^subdivisions`` faces: an icosahedron subdivided.

    All vertices lie on the sphere.

    Raises
    ------
    OptionError
        Subdivisions outside 0 to 8, or a radius that is not positive.
    """
    if not 0 <= subdivisions <= 8:
        raise OptionError(f"subdivisions must lie in 0 to 8; got {subdivisions}.")
    _positive(radius=radius)
    points, faces = _unit(_ICOSAHEDRON), _ICOSAHEDRON_FACES
    for _ in range(subdivisions):
        points, faces = quartered(points, faces)
        points = _unit(points)
    return Mesh(points * radius, faces, name="icosphere")


def box(size: tuple[float, float, float] = (1.0, 1.0, 1.0)) -> Mesh:
    """Return a box of 12 faces about the origin."""
    _positive(width=size[0], depth=size[1], height=size[2])
    part = boxes(-np.asarray(size) / 2, np.asarray(size) / 2)
    return Mesh(part.points, part.faces, name="box")


def _unit(points: FloatArray) -> FloatArray:
    return points / np.linalg.norm(points, axis=1, keepdims=True)


def _positive(**values: float) -> None:
    for name, value in values.items():
        if not 0.0 < value < np.inf:
            raise OptionError(f"{name} must be positive and finite; got {value}.")
