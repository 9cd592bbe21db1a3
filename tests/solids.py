"""Solids whose visible part is known in closed form: a sphere, a box, a plate before a plate, a plate with a hole."""

import numpy as np

import zbuf_occlude as zo
from zbuf_occlude.meshes.shapes.kit import MeshPart, ellipsoid, join, quad_grid


def uv_sphere(segments: int = 48, radius: float = 1.0) -> zo.Mesh:
    """A sphere about the origin of meridians and parallels; its triangles at the poles are long and thin."""
    part = ellipsoid((0, 0, 0), (radius, radius, radius), segments)
    return zo.Mesh(part.points, part.faces, name="uv_sphere")


def two_plates(front: float = 0.5, rear: float = 1.0, gap: float = 1.0) -> zo.Mesh:
    """Two squares across the y axis: faces 0 and 1, side `front`, at y = 0; faces 2 and 3, side `rear`, at `gap`."""
    part = join([_square(front, 0.0), _square(rear, gap)])
    return zo.Mesh(part.points, part.faces, name="two_plates")


def holed_plate(side: float = 1.0, hole: float = 0.5, gap: float = 1.0) -> zo.Mesh:
    """A square with a square hole at y = 0 (faces 0 to 7), and a full square of the same side behind it at y = `gap`.

    An eye at (0, -distance, 0) sees of the rear one ``two_plates_hidden(hole, side, gap, distance)``, as long as the
    rim hides the rest.
    """
    rings = np.stack([_corners(side, 0.0), _corners(hole, 0.0)])
    part = join([quad_grid(rings, wrap_columns=True), _square(side, gap)])
    return zo.Mesh(part.points, part.faces, name="holed_plate")


def sphere_visible(radius: float, distance: float) -> float:
    """The fraction of a sphere's area that an eye at `distance` from its centre sees: (1 - r / d) / 2."""
    return 0.5 * (1.0 - radius / distance) if distance > radius else 0.0


def box_visible(size: tuple[float, float, float], eye: tuple[float, float, float]) -> float:
    """The fraction of the area of `solids.box` that an eye outside it sees: the sides that face it."""
    x, y, z = size
    areas = np.array([y * z, z * x, x * y])
    outside = np.abs(eye) > np.array(size) / 2
    return float(areas[outside].sum() / (2 * areas.sum()))


def two_plates_hidden(front: float, rear: float, gap: float, distance: float) -> float:
    """The fraction of the rear square of `two_plates` that is hidden from (0, -distance, 0).

    The front one's shadow on the rear plane has the side ``front * (distance + gap) / distance``.
    """
    return min(1.0, (front * (distance + gap) / (distance * rear)) ** 2)


def _corners(side: float, y: float) -> np.ndarray:
    half = side / 2
    return np.array([[-half, y, -half], [half, y, -half], [half, y, half], [-half, y, half]])


def _square(side: float, y: float) -> MeshPart:
    return quad_grid(_corners(side, y)[[[0, 1], [3, 2]]])
