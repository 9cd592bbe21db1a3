"""The depth test's plain form: closed answers on one plane, and slopes against finite differences."""

import numpy as np

from zbuf_occlude.geometry.camera import Frusta, view_matrices
from zbuf_occlude.meshes.sampling import SurfacePoints
from zbuf_occlude.visibility.methods.pyrender import depth_slopes, depth_test, window_coordinates

FRUSTUM = Frusta(*(np.float64(bound) for bound in (-0.5, 1.0, -1.0, 0.5, 1.0, 9.0)))
VIEW = view_matrices([[4.0, 1.0, 2.0]], [0.0, 0.0, 0.0])[0]


def world(eye_space: list[list[float]]) -> np.ndarray:
    return np.asarray((np.array(eye_space) - VIEW[:3, 3]) @ VIEW[:3, :3])


def test_deeper_than_the_image_by_more_than_the_tolerance_is_hidden() -> None:
    depths = np.full((30, 60), 5.0)
    depths[:, 30:] = np.inf
    points = SurfacePoints.free(
        world([[0, 0, -4.9], [0, 0, -5.05], [0, 0, -5.2], [4.9, 0, -5.2], [9, 0, -5.2], [0, 0, 5]])
    )
    visible = depth_test(depths, VIEW, FRUSTUM, points, tolerance=0.1, slope_bias=1.0)
    assert visible.tolist() == [True, True, False, True, True, True]  # a free point has no slope


def test_rows_count_from_below() -> None:
    x, y, depth = window_coordinates(VIEW, FRUSTUM, world([[-2.5, -5.0, -5.0], [5.0, 2.5, -5.0]]), (60, 30))
    assert np.allclose(x, [0, 60])
    assert np.allclose(y, [0, 30])
    assert np.allclose(depth, 5)


def test_slopes_are_the_derivative_of_the_planes_depth() -> None:
    normal = np.array([0.3, -0.8, 0.5])
    normal /= np.linalg.norm(normal)
    place = np.array([0.2, 0.4, -5.0])
    tangents = -place[:2] / place[2]
    pixels = np.array([1.5 / 60, 1.5 / 30])

    def depth_at(s: float, t: float) -> float:
        return float(normal @ place / (normal @ [s, t, -1.0]))

    by_x = (depth_at(tangents[0] + 1e-6, tangents[1]) - depth_at(tangents[0] - 1e-6, tangents[1])) / 2e-6 * pixels[0]
    by_y = (depth_at(tangents[0], tangents[1] + 1e-6) - depth_at(tangents[0], tangents[1] - 1e-6)) / 2e-6 * pixels[1]
    points = SurfacePoints(world([list(place)]), np.array([0]), (normal @ VIEW[:3, :3])[None])
    assert np.allclose(depth_slopes(VIEW, FRUSTUM, points, (60, 30)), max(abs(by_x), abs(by_y)))


def test_a_plane_seen_edge_on_has_the_frustums_depth_for_a_slope() -> None:
    points = SurfacePoints(world([[0, 0, -5]]), np.array([0]), VIEW[1:2, :3].copy())
    assert depth_slopes(VIEW, FRUSTUM, points, (60, 30)) == 8.0
