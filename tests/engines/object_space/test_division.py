"""Division of large faces: areas, counts, limits, and which child a point lies in."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import zbuf_occlude as zo
from tests.scenes import SQUARE, soup, stacked
from zbuf_occlude.engines.object_space.division import Division, divide_faces


def inside(mesh: zo.Mesh, faces: np.ndarray, positions: np.ndarray) -> np.ndarray:
    """Least barycentric coordinate of each position in its face, by linear least squares."""
    corners = mesh.corners[faces]
    weights = [np.linalg.lstsq(np.vstack([c.T, np.ones(3)]), np.append(p, 1.0)) for c, p in zip(corners, positions)]  # noqa: B905
    return np.array([w[0].min() for w in weights])


def test_a_right_triangle_in_nine() -> None:
    mesh = zo.Mesh([[0, 0, 0], [3, 0, 0], [0, 3, 0]], [[0, 1, 2]])
    division = divide_faces(mesh, 1 / 9, 100)
    assert division.parts.tolist() == [3]
    assert not division.limited
    assert np.allclose(division.mesh.areas, 0.5)
    assert (division.mesh.face_normals[:, 2] > 0).all()  # wound as the parent is
    assert len(division.mesh.vertices) == 10  # 4 + 3 + 2 + 1 lattice nodes, the corners being the old vertices
    assert len(np.unique(division.mesh.vertices, axis=0)) == 10
    assert np.unique(division.mesh.faces).size == 10
    centres = division.mesh.corners.mean(axis=1)
    assert division.children_of(zo.SurfacePoints(centres, [0] * 9, centres * 0)).tolist() == list(range(9))


@pytest.mark.parametrize("largest", [0.5, 0.03, 0.004, 0.0007])
def test_area_is_kept_and_no_face_is_larger(largest: float) -> None:
    mesh = soup(20, 0.3)
    division = divide_faces(mesh, largest, 100_000)
    parent = np.repeat(np.arange(20), division.parts**2)
    assert len(division.mesh.faces) == len(parent)
    assert division.mesh.areas.max() <= largest * mesh.areas.sum() * (1 + 1e-9)
    assert np.allclose(np.bincount(parent, division.mesh.areas), mesh.areas)
    # not finer than needed: with one part fewer a face would be too large
    divided = division.parts > 1
    assert (mesh.areas[divided] / (division.parts[divided] - 1) ** 2 > largest * mesh.areas.sum()).all()


def test_nothing_to_divide_leaves_the_mesh_alone() -> None:
    mesh = soup(20)
    assert divide_faces(mesh, 1.0, 100).mesh is mesh
    assert divide_faces(mesh, 1.0, 100).parts.tolist() == [1] * 20


@pytest.mark.parametrize("max_faces", [1, 20, 21, 50, 1000])
def test_a_limit_stops_it_and_says_so(max_faces: int) -> None:
    mesh = soup(20, 0.3)
    division = divide_faces(mesh, 1e-9, max_faces)
    assert division.limited
    assert len(division.mesh.faces) <= max(max_faces, 20)
    if max_faces == 1000:
        assert len(division.mesh.faces) > 900  # as far as it goes


def test_an_impossible_division_costs_nothing() -> None:
    assert divide_faces(soup(20, 0.3), 1e-300, 1000).limited


@settings(max_examples=30)
@given(seed=st.integers(0, 10_000), largest=st.floats(0.002, 1.0))
def test_points_lie_in_the_child_they_are_given(seed: int, largest: float) -> None:
    mesh = soup(8, 0.3, seed)
    division = divide_faces(mesh, largest, 10_000)
    points = zo.sample_surface(mesh, n_points=60, seed=seed)
    children = division.children_of(points)
    assert (np.repeat(np.arange(8), division.parts**2)[children] == points.face_ids).all()
    assert inside(division.mesh, children, points.positions).min() > -1e-9


def test_points_on_edges_and_corners_lie_in_a_child_that_holds_them() -> None:
    mesh = stacked(SQUARE)
    division: Division = divide_faces(mesh, 0.02, 1000)
    m = int(division.parts[0])
    edge = np.linspace(0, 1, 4 * m + 1)
    on_edges = np.concatenate([np.outer(edge, b - a) + a for a, b in zip(SQUARE[:3], SQUARE[[1, 2, 0]], strict=True)])
    points = zo.SurfacePoints(on_edges, np.zeros(len(on_edges), dtype=int), on_edges * 0)
    children = division.children_of(points)
    assert ((children >= 0) & (children < m * m)).all()
    assert inside(division.mesh, children, on_edges).min() > -1e-9


def test_free_points_have_no_child() -> None:
    assert divide_faces(soup(5, 0.3), 0.01, 1000).children_of(zo.SurfacePoints.free([[0, 0, 0]])).tolist() == [-1]
