"""`exact_hsr`: the paper's formulas against the oracle's outside the boundary band; what culling keeps and loses."""

import numpy as np
import pytest

import zbuf_occlude as zo
from tests.scenes import box, chair, needles, needs_chair, soup, sphere, two_plates, wrong_outside_band

EYES = zo.views.paper100(4.0).eyes[::16]
MESHES = {"soup": soup(600), "needles": needles(600), "sphere": sphere(12)}


@pytest.mark.parametrize("name", MESHES)
@pytest.mark.parametrize("distance", [0.1, 1.0, 1000.0])
@pytest.mark.parametrize("cull", ["none", "first"])
def test_equals_the_oracle_outside_the_band(name: str, distance: float, cull: str) -> None:
    mesh = MESHES[name]
    points = zo.sample_surface(mesh, n_points=700, seed=1)
    eyes = EYES * distance + 0.01
    answer = zo.prepare(mesh, "exact_hsr", cull=cull).visible(points, eyes)
    assert wrong_outside_band(mesh, answer, points, eyes) == 0


def test_symmetric_views_of_a_box_aim_at_its_edges() -> None:
    """From the diagonal planes many lines pass exactly through edges and corners; one leak would show."""
    mesh = box()
    grid = np.linspace(-0.5, 0.5, 9)
    x, y = (a.ravel() for a in np.meshgrid(grid, grid))
    behind = zo.SurfacePoints.free(np.stack([x, y, np.full(81, -0.7)], axis=1))
    eyes = np.array([[0.0, 0.0, 3.0], [2.0, 2.0, 2.0], [3.0, 3.0, 0.0], [0.0, 2.0, 2.0], [-3.0, 0.0, 3.0]])
    answer = zo.prepare(mesh, "exact_hsr").visible(behind, eyes)
    assert not answer[0].any()
    assert wrong_outside_band(mesh, answer, behind, eyes) == 0


@needs_chair
def test_equals_the_oracle_on_the_papers_chair() -> None:
    """The whole of it, 100 views at 5,000 points, is benchmarks/reference_check.py."""
    mesh = chair()
    points = zo.sample_surface(mesh, n_points=500, seed=0)
    eyes = zo.views.paper100().eyes[::4]
    assert wrong_outside_band(mesh, zo.prepare(mesh, "exact_hsr").visible(points, eyes), points, eyes) == 0


def test_first_suggestion_excludes_little_and_nothing_wrongly() -> None:
    mesh = MESHES["soup"]
    points = zo.sample_surface(mesh, n_points=500, seed=2)
    plain, first = (zo.prepare(mesh, "exact_hsr", cull=cull) for cull in ("none", "first"))
    assert (plain.visible(points, EYES) == first.visible(points, EYES)).all()
    assert first.n_tests.shape == (len(EYES),)
    assert (first.n_tests < plain.n_tests).all()
    assert (first.n_tests > 0.7 * plain.n_tests).all()


def test_second_suggestion_halves_the_tests_and_only_errs_to_visible() -> None:
    mesh = MESHES["soup"]
    points = zo.sample_surface(mesh, n_points=500, seed=2)
    plain, second = (zo.prepare(mesh, "exact_hsr", cull=cull) for cull in ("none", "second"))
    exact, culled = plain.visible(points, EYES), second.visible(points, EYES)
    assert not (exact & ~culled).any()
    assert (culled & ~exact).mean() < 0.01
    assert second.n_tests.sum() < 0.6 * plain.n_tests.sum()


def test_second_suggestion_excludes_a_face_whose_near_part_has_no_sample() -> None:
    """One sample each: the large face reaches nearer to the eye than the point, its sample does not."""
    reach = np.array([[-1.0, -1.0, 0.5], [-1.0, 1.0, 0.5], [400.0, 0.0, 0.5]])
    mesh = zo.Mesh(np.concatenate([reach, [[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0]]]), [[0, 1, 2], [3, 4, 5]])
    point = zo.SurfacePoints([[0.02, 0.02, 0.0]], [1], [[0, 0, 1]])
    eye = [[0.02, 0.02, 1.0]]
    assert zo.prepare(mesh, "exact_hsr").visible(point, eye).item() is False
    assert zo.prepare(mesh, "exact_hsr", cull="first").visible(point, eye).item() is False
    assert zo.prepare(mesh, "exact_hsr", cull="second", n_samples=1).visible(point, eye).item() is True


def test_tests_are_n_m_when_all_is_visible() -> None:
    """Paper 3.6: "maximum of the form k N M when all vertices are visible, as in the case of a planar object"."""
    mesh = two_plates(0.0)
    points = zo.sample_surface(mesh, n_points=100, seed=0)
    occluder = zo.prepare(mesh, "exact_hsr")
    assert occluder.visible(points, [[0.3, 0.4, 2.0], [0.3, 0.4, -2.0]]).all()
    assert occluder.n_tests.tolist() == [400, 400]
