"""`vertex_hsr` and `vertex_hsr_culled`: own faces by position, dropping whole faces, division, culling."""

import warnings

import numpy as np
import pytest

import zbuf_occlude as zo
from tests.scenes import SQUARE, box, chair, needs_chair, soup, sphere, stacked, two_plates, unshared
from zbuf_occlude.visibility.methods import oracle

EYES = zo.views.paper100(4.0).eyes[::16]


def kept_faces(mesh: zo.Mesh, eye: object, **options: object) -> np.ndarray:
    """Which faces are left, asked through their centroids."""
    centroids = zo.SurfacePoints(mesh.corners.mean(axis=1), np.arange(len(mesh.faces)), mesh.face_normals)
    with zo.prepare(mesh, "vertex_hsr", **options) as occluder:
        return occluder.visible(centroids, np.atleast_2d(np.asarray(eye, dtype=float)))[0]


def test_a_box_seen_over_a_corner_keeps_three_sides() -> None:
    """Of the eight vertices only the far one is hidden; it takes the three far sides with it."""
    expected = [False, False, True, True] * 3  # -x, +x, -y, +y, -z, +z
    for mesh in (box(), unshared(box())):  # neighbours with vertices of their own do not hide each other
        assert kept_faces(mesh, [3.0, 4.0, 5.0]).tolist() == expected


def test_a_face_with_one_hidden_vertex_goes_whole() -> None:
    """The plate's four corners stick out from under a smaller one but for one: both halves hold it, or one does."""
    over = SQUARE * [0.4, 0.4, 1] + np.array([-0.1, -0.1, 0.5])
    mesh = stacked(SQUARE, over)
    assert kept_faces(mesh, [0.1, 0.1, 50.0]).tolist() == [False, False, True, True]  # corner 0 belongs to both
    over = SQUARE * [0.4, 0.4, 1] + np.array([0.7, -0.1, 0.5])
    mesh = stacked(SQUARE, over)
    assert kept_faces(mesh, [0.9, 0.1, 50.0]).tolist() == [False, True, True, True]  # corner 1 only to the first


def test_a_face_hidden_between_its_vertices_stays() -> None:
    mesh = stacked(SQUARE, SQUARE * [0.2, 0.2, 1] + np.array([0.4, 0.4, 0.5]))
    points = zo.SurfacePoints([[0.5, 0.45, 0.0]], [0], [[0, 0, 1]])
    eye = [[0.5, 0.5, 3.0]]
    assert zo.prepare(mesh, "vertex_hsr").visible(points, eye).item() is True
    assert oracle.prepare(mesh).visible(points, eye).item() is False
    assert zo.prepare(mesh, "vertex_hsr", divide=1e-3).visible(points, eye).item() is False


def test_a_vertex_upon_anothers_edge_is_not_hidden_by_it() -> None:
    """A T-junction: two small faces against the long edge of a large one, all in one plane, and one behind."""
    large = [[0, 0, 0], [2, 0, 0], [1, -2, 0]]
    small = [[0, 0, 0], [1, 0, 0], [0.5, 1, 0]], [[1, 0, 0], [2, 0, 0], [1.5, 1, 0.3]]
    mesh = zo.Mesh(np.concatenate([large, *small]), np.arange(9).reshape(3, 3))
    for eye in ([1.0, 0.0, 5.0], [3.0, 4.0, 1.0], [-2.0, -1.0, -3.0]):
        assert kept_faces(mesh, eye).all()


def test_points_go_with_their_face_and_free_points_are_tested() -> None:
    mesh = two_plates(0.5)
    points = zo.sample_surface(mesh, n_points=200, seed=0)
    eye = np.array([0.5, 0.5, 5.0])
    assert (zo.prepare(mesh, "vertex_hsr").visible(points, eye[None])[0] == (points.face_ids >= 2)).all()
    free = zo.SurfacePoints.free([[0.5, 0.4, 0.2], [0.5, 0.4, 0.7], [9.0, 9.0, 0.2]])
    for method in ("vertex_hsr", "vertex_hsr_culled"):
        with zo.prepare(mesh, method) as occluder:
            assert occluder.visible(free, eye[None]).tolist() == [[False, True, True]]


def test_division_brings_it_towards_the_oracle() -> None:
    mesh = stacked(SQUARE, SQUARE * [0.5, 0.5, 1] + np.array([0.2, 0.3, 0.4]))
    points = zo.sample_surface(mesh, n_points=2000, seed=0)
    truth = oracle.prepare(mesh).visible(points, EYES)
    wrong = [
        (zo.prepare(mesh, "vertex_hsr", divide=divide).visible(points, EYES) != truth).mean()
        for divide in (1.0, 0.01, 0.001)
    ]
    assert wrong[0] > 2 * wrong[1] > 4 * wrong[2] > 0
    assert wrong[2] < 0.03


def test_division_stops_at_its_limit_and_says_so() -> None:
    mesh = box()
    with pytest.warns(UserWarning, match=r"would make more than 500 faces; stopped at \d+, .* Raise max_faces"):
        occluder = zo.prepare(mesh, "vertex_hsr", divide=1e-6, max_faces=500)
    assert occluder.division.limited
    assert 300 < len(occluder.division.mesh.faces) <= 500
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert not zo.prepare(mesh, "vertex_hsr", divide=0.01).division.limited


def test_first_suggestion_changes_nothing() -> None:
    mesh = soup(300)
    points = zo.sample_surface(mesh, n_points=500, seed=0)
    plain, first = zo.prepare(mesh, "vertex_hsr"), zo.prepare(mesh, "vertex_hsr_culled", suggestion=1)
    assert (plain.visible(points, EYES) == first.visible(points, EYES)).all()
    assert (first.n_tests < plain.n_tests).all()


def test_second_suggestion_keeps_a_little_more() -> None:
    mesh = soup(300)
    points = zo.sample_surface(mesh, n_points=500, seed=0)
    plain, second = zo.prepare(mesh, "vertex_hsr"), zo.prepare(mesh, "vertex_hsr_culled")
    kept, more = plain.visible(points, EYES), second.visible(points, EYES)
    assert not (kept & ~more).any()
    assert (more & ~kept).mean() < 0.02
    assert (second.n_tests < 0.7 * plain.n_tests).all()


def test_tests_are_n_m_when_all_is_visible() -> None:
    mesh = unshared(sphere(4))
    flat = zo.Mesh(mesh.vertices * [1, 1, 0] + np.array([0, 0, 1.0]), mesh.faces)
    occluder = zo.prepare(flat, "vertex_hsr")
    points = zo.sample_surface(flat, n_points=10, seed=0)
    assert occluder.visible(points, [[0.1, 0.2, 5.0]]).all()
    assert occluder.n_tests.tolist() == [len(flat.vertices) * len(flat.faces)]


@needs_chair
def test_on_the_papers_chair() -> None:
    """False hidden is what dropping whole faces costs; the second suggestion halves the tests."""
    mesh = chair()
    eyes = zo.views.paper100().eyes[::20]
    points = zo.sample_surface(mesh, n_points=2000, seed=0)
    truth = oracle.prepare(mesh).visible(points, eyes)
    plain, second = zo.prepare(mesh, "vertex_hsr"), zo.prepare(mesh, "vertex_hsr_culled")
    answer = plain.visible(points, eyes)
    assert (answer & ~truth).mean() < 0.005
    assert (~answer & truth).mean() < 0.15
    assert (second.visible(points, eyes) != answer).mean() < 0.005
    assert 0.5 < 1 - second.n_tests.sum() / plain.n_tests.sum() < 0.7
