"""Polygons to triangles: area, orientation and coverage against a polygon's own formulas."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from zbuf_occlude import MeshError
from zbuf_occlude.meshes.polygons import Polygons

ARROW = [[0, 0], [4, 0], [4, 4], [2, 1], [0, 4]]  # concave at its fourth corner
DART = [[0, 0], [1, 3], [0, 1], [-1, 3]]  # a quadrilateral, concave at its third corner
COMB = [[0, 0], [7, 0], [7, 5], [6, 5], [6, 1], [5, 1], [5, 5], [4, 5], [4, 1], [3, 1], [3, 5], [2, 5], [2, 1], [0, 1]]


def rotation(seed: int) -> np.ndarray:
    return np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]


def in_space(polygon: np.ndarray, seed: int) -> np.ndarray:
    flat = np.column_stack([polygon, np.full(len(polygon), 0.7)])
    return flat @ rotation(seed).T + [3, -2, 1]


def shoelace(polygon: np.ndarray) -> float:
    x, y = np.asarray(polygon, dtype=float).T
    return float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2


def areas_and_normals(vertices: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    a, b, c = (vertices[triangles[:, i]] for i in range(3))
    normals = np.cross(b - a, c - a)
    return np.linalg.norm(normals, axis=1) / 2, normals


def cut(polygon: np.ndarray) -> np.ndarray:
    n = len(polygon)
    return Polygons(polygon, np.arange(n), np.array([n])).triangles()[0]


def assert_tiles(polygon: list[list[float]] | np.ndarray, seed: int) -> None:
    """The triangles turn the way the polygon does and have its area: then they cover it, once."""
    flat = np.asarray(polygon, dtype=float)
    vertices = in_space(flat, seed)
    triangles = cut(vertices)
    areas, normals = areas_and_normals(vertices, triangles)
    area = shoelace(flat)
    assert areas.sum() == pytest.approx(abs(area), rel=1e-9)
    real = areas > 1e-12 * abs(area)
    up = np.sign(area) * np.linalg.det(rotation(seed)) * rotation(seed)[:, 2]
    sides = normals[real] @ up
    assert (sides > 0).all() or (sides < 0).all()


@pytest.mark.parametrize("shape", [ARROW, DART, COMB], ids=["arrow", "dart", "comb"])
@pytest.mark.parametrize("reverse", [False, True], ids=["left", "right"])
def test_concave_polygons_are_tiled_from_whatever_corner_they_begin(shape: list[list[float]], reverse: bool) -> None:
    for first in range(len(shape)):
        turned = np.roll(np.array(shape, dtype=float)[:: -1 if reverse else 1], -first, axis=0)
        assert_tiles(turned, seed=first)


@given(
    radii=st.lists(st.floats(0.05, 1), min_size=4, max_size=40),
    seed=st.integers(0, 10),
    scale=st.sampled_from([1e-6, 1.0, 1e6]),
)
@settings(max_examples=60)
def test_any_star_shaped_polygon_is_tiled(radii: list[float], seed: int, scale: float) -> None:
    angles = np.arange(len(radii)) * 2 * np.pi / len(radii)
    polygon = np.column_stack([np.cos(angles), np.sin(angles)]) * np.array(radii)[:, None] * scale
    assert_tiles(polygon, seed)


def test_corners_on_a_straight_edge_leave_no_gap() -> None:
    # without the corner at (2, 0), a crack would open to a neighbour that has it
    assert set(cut(in_space(np.array([*ARROW[:1], [2, 0], *ARROW[1:]], dtype=float), 3)).flat) == set(range(6))


def test_a_folded_polygon_uses_all_its_corners() -> None:
    # a square with an upright triangle on one side, as one face: no plane shows all of it
    folded = np.array([[-5, 0, 5], [5, 0, 5], [5, 0, -5], [-5, 0, -5], [0, 5, -5.0]])
    triangles = cut(folded)
    assert len(triangles) == 3
    assert set(triangles.flat) == set(range(5))


def test_polygons_that_have_no_area_do_no_harm() -> None:
    line = np.array([[0, 0, 0], [1, 1, 1], [2, 2, 2], [3, 3, 3], [1, 1, 1.0]])
    point = np.zeros((6, 3))
    bow_tie = np.array([[0, 0, 0], [1, 1, 0], [1, 0, 0], [0, 1, 0.0]])
    for polygon in (line, point, bow_tie):
        triangles = cut(polygon)
        assert set(triangles.flat) <= set(range(len(polygon)))
        assert len(triangles) == len(polygon) - 2


def test_a_polygon_of_more_corners_than_can_be_cut_in_time_is_refused() -> None:
    """Ears of one that crosses itself take the square of its corners, in compiled code that no limit interrupts."""
    n = 50_001
    circle = np.exp(2j * np.pi * np.arange(n) / n)
    vertices, corners = np.column_stack([circle.real, circle.imag, np.zeros(n)]), np.arange(n)
    triangles, _ = Polygons(vertices, corners, np.array([n])).triangles()
    assert len(triangles) == n - 2, "convex ones are fans"
    vertices[::2] *= 0.9
    with pytest.raises(MeshError, match=r"a concave face must have at most 50,000 corners; one has 50,001\. Split it"):
        Polygons(vertices, corners, np.array([n])).triangles()
