"""Solids whose visible part is known in closed form: spheres, a box, a plate before a plate, a plate with a hole."""

import numpy as np
from numpy.typing import ArrayLike

from zbuf_occlude.arrays import FloatArray, IntArray, as_vectors
from zbuf_occlude.errors import OptionError
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.shapes.kit import MeshPart, boxes, ellipsoid, join, quad_grid, quartered

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
    """Return a sphere about the origin with vertices on it: an icosahedron quartered, 20 * 4^subdivisions faces.

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


def uv_sphere(segments: int = 48, radius: float = 1.0) -> Mesh:
    """Return a sphere about the origin of meridians and parallels; long thin triangles at its poles.

    Raises
    ------
    OptionError
        Fewer than 8 segments, or a radius that is not positive.
    """
    if segments < 8:
        raise OptionError(f"segments must be at least 8; got {segments}.")
    _positive(radius=radius)
    part = ellipsoid((0, 0, 0), (radius, radius, radius), segments)
    return Mesh(part.points, part.faces, name="uv_sphere")


def box(size: tuple[float, float, float] = (1.0, 1.0, 1.0)) -> Mesh:
    """Return a box of 12 faces about the origin."""
    _positive(width=size[0], depth=size[1], height=size[2])
    part = boxes(-np.asarray(size) / 2, np.asarray(size) / 2)
    return Mesh(part.points, part.faces, name="box")


def two_plates(front: float = 0.5, rear: float = 1.0, gap: float = 1.0) -> Mesh:
    """Return two squares across the y axis: the front one at y = 0, of side `front`, the rear one at y = `gap`.

    Faces 0 and 1 are the front one. Seen from (0, -distance, 0), `two_plates_hidden` tells how much of the rear
    one is hidden.
    """
    _positive(front=front, rear=rear, gap=gap)
    part = join([_square(front, 0.0), _square(rear, gap)])
    return Mesh(part.points, part.faces, name="two_plates")


def holed_plate(side: float = 1.0, hole: float = 0.5, gap: float = 1.0) -> Mesh:
    """Return a square with a square hole at y = 0 and a full square of the same side behind it at y = `gap`.

    Faces 0 to 7 are the front one. Seen from (0, -distance, 0), the rear one is visible through the hole alone
    as long as its rim hides the rest: ``two_plates_hidden(hole, side, gap, distance)`` is then the *visible* part.
    """
    _positive(side=side, hole=hole, gap=gap)
    if hole >= side:
        raise OptionError(f"hole must be smaller than side ({side:g}); got {hole:g}.")
    rings = np.stack([_corners(side, 0.0), _corners(hole, 0.0)])
    part = join([quad_grid(rings, wrap_columns=True), _square(side, gap)])
    return Mesh(part.points, part.faces, name="holed_plate")


def sphere_visible(radius: float, distance: float) -> float:
    """Return the fraction of a sphere's area that an eye at `distance` from its centre sees: (1 - r / d) / 2."""
    _positive(radius=radius, distance=distance)
    return 0.5 * (1.0 - radius / distance) if distance > radius else 0.0


def box_visible(size: tuple[float, float, float], eye: ArrayLike) -> float:
    """Return the fraction of the area of `box` that an eye outside it, (3,), sees: the sides that face it."""
    x, y, z = size
    areas = np.array([y * z, z * x, x * y])
    outside = np.abs(as_vectors(np.reshape(eye, (1, 3)), "eye")[0]) > np.array(size) / 2
    return float(areas[outside].sum() / (2 * areas.sum()))


def two_plates_hidden(front: float, rear: float, gap: float, distance: float) -> float:
    """Return the fraction of the rear square of `two_plates` that is hidden from (0, -distance, 0).

    The front one's shadow on the rear plane has the side ``front * (distance + gap) / distance``.
    """
    _positive(distance=distance)
    return min(1.0, (front * (distance + gap) / (distance * rear)) ** 2)


def _unit(points: FloatArray) -> FloatArray:
    return points / np.linalg.norm(points, axis=1, keepdims=True)


def _corners(side: float, y: float) -> FloatArray:
    half = side / 2
    return np.array([[-half, y, -half], [half, y, -half], [half, y, half], [-half, y, half]])


def _square(side: float, y: float) -> MeshPart:
    return quad_grid(_corners(side, y)[[[0, 1], [3, 2]]])


def _positive(**values: float) -> None:
    for name, value in values.items():
        if not 0.0 < value < np.inf:
            raise OptionError(f"{name} must be positive and finite; got {value}.")
