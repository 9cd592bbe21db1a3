"""Cameras: OpenGL's conventions held against closed forms, and fits that hold everything and waste nothing."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from zbuf_occlude.base.errors import ArgumentError
from zbuf_occlude.geometry.camera import (
    WIDEST,
    Frusta,
    cube_faces,
    cube_frusta,
    cube_view_matrices,
    fitted_frusta,
    projection_matrices,
    view_matrices,
)
from zbuf_occlude.views import paper100

CORNERS = np.stack(np.meshgrid([-0.5, 0.5], [-0.3, 0.3], [-0.1, 0.1]), axis=-1).reshape(-1, 3)

coordinates = st.floats(-10, 10, allow_subnormal=False)
vectors = arrays(np.float64, (4, 3), elements=coordinates)


def window_coordinates(matrices: np.ndarray, positions: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Pixels from the lower left corner, and depth in [0, 1], of (n, 3) points; matrices (..., 4, 4), world to clip."""
    clip = np.einsum("...ij,nj->...ni", matrices[..., :3], positions) + matrices[..., None, :, 3]
    return (clip[..., :3] / clip[..., 3:] + 1.0) / 2.0 * np.array([*size, 1.0])


def to_eye_space(view: np.ndarray, positions: np.ndarray) -> np.ndarray:
    return np.asarray(positions @ view[:3, :3].T + view[:3, 3])


def test_the_camera_looks_along_minus_z_with_x_right_and_y_up() -> None:
    # an eye on +x looking back at the origin, z up: +y is to its right
    view = view_matrices([[5, 0, 0]], [0, 0, 0])[0]
    assert np.allclose(to_eye_space(view, np.array([[0, 0, 0], [0, 1, 0], [0, 0, 1], [5, 0, 0]])), [
        [0, 0, -5], [1, 0, -5], [0, 1, -5], [0, 0, 0],
    ])  # fmt: skip


@given(vectors, vectors)
def test_views_are_rigid_and_see_the_target_ahead(eyes: np.ndarray, targets: np.ndarray) -> None:
    distances = np.linalg.norm(eyes - targets, axis=1)
    if (distances < 1e-3).any():
        return
    views = view_matrices(eyes, targets)
    rotations = views[:, :3, :3]
    assert np.allclose(rotations @ rotations.transpose(0, 2, 1), np.eye(3), atol=1e-12)
    assert np.allclose(np.linalg.det(rotations), 1.0)
    for view, target, distance in zip(views, targets, distances, strict=True):
        assert np.allclose(to_eye_space(view, target[None]), [[0, 0, -distance]], atol=1e-9)


def test_depth_and_window_space_at_known_places() -> None:
    matrix = projection_matrices(Frusta(*(np.array([x]) for x in (-1.0, 3.0, -1.0, 1.0, 2.0, 10.0))))[0]
    seen = window_coordinates(matrix, np.array([[-2, -2, -2], [6, 2, -2], [-10, -10, -10], [30, 10, -10]]), (400, 100))
    assert np.allclose(seen, [[0, 0, 0], [400, 100, 0], [0, 0, 1], [400, 100, 1]])
    # the centre of the lower left pixel looks along its own tangent
    assert np.allclose(window_coordinates(matrix, np.array([[-0.99, -0.98, -1.0]]) * 5, (400, 50))[0, :2], [1.0, 0.5])


@given(vectors, arrays(np.float64, (9, 3), elements=coordinates))
def test_a_fit_holds_every_point_and_touches_all_four_sides(eyes: np.ndarray, positions: np.ndarray) -> None:
    eyes = eyes + np.where(eyes[:, :1] < 0, -40.0, 40.0)
    views = view_matrices(eyes, positions.mean(axis=0))
    fits, frusta = fitted_frusta(views, positions)
    for view, fit, *bounds in zip(views, fits, *frusta, strict=True):
        assert fit
        bounds_of_one = Frusta(*(np.array([bound]) for bound in bounds))
        seen = window_coordinates(projection_matrices(bounds_of_one)[0] @ view, positions, (2, 2)) - [1, 1, 0]
        assert (seen[:, 2] >= 0).all()
        assert (seen[:, 2] <= 1).all()
        extent = np.abs(seen[:, :2]).max(axis=0)
        assert (extent <= 1 + 1e-9).all()
        x, y, z = to_eye_space(view, positions).T
        width, height = np.ptp(x / z), np.ptp(y / z)
        # what is flat and seen edge on has no width, and touches nothing with it
        if min(width, height) > max(1e-6, 0.01 * max(width, height)):
            assert extent == pytest.approx([1.0, 1.0], abs=0.01)


def test_the_margin_leaves_so_many_pixels_free() -> None:
    views = view_matrices([[4, 1, 2]], [0, 0, 0])
    _, frusta = fitted_frusta(views, CORNERS, margin=2 / 64)
    seen = window_coordinates(projection_matrices(frusta)[0] @ views[0], CORNERS, (64, 64))
    assert 1.8 < seen[:, :2].min() <= 2.0
    assert 62.0 <= seen[:, :2].max() < 62.2


def test_an_eye_inside_or_too_near_does_not_fit() -> None:
    eyes = np.array([[0.1, 0.1, 0.05], [0.501, 0.0, 0.0], [4.0, 0.0, 0.0]])
    fits, frusta = fitted_frusta(view_matrices(eyes, [0, 0, 0]), CORNERS)
    assert fits.tolist() == [False, False, True]
    assert frusta.right[2] < WIDEST


@pytest.mark.parametrize("factor", [2.0**-40, 2.0**-10, 2.0**7])
def test_scaling_by_a_power_of_two_changes_no_bit_of_a_fit(factor: float) -> None:
    eyes = paper100().eyes + np.array([0.01, 0.02, 0.03])
    _, one = fitted_frusta(view_matrices(eyes, [0, 0, 0]), CORNERS)
    _, other = fitted_frusta(view_matrices(eyes * factor, [0, 0, 0]), CORNERS * factor)
    assert np.array_equal(one.left, other.left)
    assert np.array_equal(one.top, other.top)
    assert np.array_equal(one.near * factor, other.near)


@given(arrays(np.float64, 3, elements=coordinates), arrays(np.float64, 3, elements=coordinates))
def test_a_direction_lies_inside_its_cube_face(eye: np.ndarray, direction: np.ndarray) -> None:
    if np.abs(direction).max() < 1e-3:
        return
    face = int(cube_faces(direction))
    projection = projection_matrices(cube_frusta(1, 1e-3, 100.0))[0]
    seen = window_coordinates(projection @ cube_view_matrices(eye[None])[0, face], (eye + direction)[None], (2, 2))[0]
    assert (seen[:2] > -1e-9).all()
    assert (seen[:2] < 2 + 1e-9).all()
    assert 0 <= seen[2] <= 1


@pytest.mark.parametrize(
    ("eyes", "targets", "ups", "message"),
    [
        ([[0, 0, 1]], [0, 0, 1], None, "Eye 0 coincides with its target"),
        ([[0, 0, 1]], [0, 0, 0], [0, 0, 2], "up vector of eye 0 is parallel to its line of sight"),
        ([0, 0, 1], [0, 0, 0], None, "got .3,. int64. Add a leading axis"),
    ],
)
def test_errors(eyes: list[object], targets: list[float], ups: list[float] | None, message: str) -> None:
    with pytest.raises(ArgumentError, match=message):
        view_matrices(eyes, targets, ups)
    with pytest.raises(ArgumentError, match="0 < near < far; one does not"):
        projection_matrices(cube_frusta(2, 0.0, 1.0))
