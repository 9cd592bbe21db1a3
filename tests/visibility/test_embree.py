"""`embree`: against the oracle outside the boundary band, own faces, contacts, far points, error texts."""

import numpy as np
import pytest

import zbuf_occlude as zo
from tests.scenes import needles, soup, two_plates, wrong_outside_band

pytestmark = pytest.mark.needs("embreex")

EYES = zo.views.paper100().eyes[::16]


def slats(n_slats: int) -> zo.Mesh:
    """Upright plates on a common base plate: grazing angles on the base, occluders standing on it."""
    base = [[[-1, -1, 0], [1, -1, 0], [1, 1, 0]], [[-1, -1, 0], [1, 1, 0], [-1, 1, 0]]]
    for x in np.linspace(-0.9, 0.9, n_slats):
        base += [[[x, -1, 0], [x, 1, 0], [x, 1, 0.05]], [[x, -1, 0], [x, 1, 0.05], [x, -1, 0.05]]]
    corners = np.asarray(base, dtype=np.float64)
    return zo.Mesh(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3)).cleaned().normalized()


MESHES = {"soup": soup(800), "needles": needles(800, 1), "slats": slats(12)}


def share_wrong(mesh: zo.Mesh, points: zo.SurfacePoints, eyes: np.ndarray) -> float:
    """The fraction of answers that differ from the oracle's and are decided at the band's width."""
    with zo.prepare(mesh, "embree") as occluder:
        answer = occluder.visible(points, eyes)
    return wrong_outside_band(mesh, answer, points, eyes) / answer.size


@pytest.mark.parametrize("name", MESHES)
@pytest.mark.parametrize("distance", [0.05, 1.0, 1000.0])
def test_agrees_with_the_oracle_outside_the_band(name: str, distance: float) -> None:
    """Eyes within the mesh, at the paper's distance, and 4,000 sizes away; the issue asks for 99.99 %."""
    mesh = MESHES[name]
    points = zo.sample_surface(mesh, n_points=2000, seed=3)
    assert share_wrong(mesh, points, EYES * distance + 0.01) <= 1e-4


def test_grazing_rays_are_not_hidden_by_their_own_face() -> None:
    """Eyes 1e-7 to 1e-2 above a slat's base plane: the own face is met by rounding, the slats really block."""
    mesh = MESHES["slats"]
    points = zo.sample_surface(mesh, n_points=1000, seed=4)
    height = mesh.vertices[0, 2] + np.array([1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2])
    eyes = np.stack([np.full(6, 3.0), np.full(6, 0.1), height], axis=1)
    assert share_wrong(mesh, points, eyes) == 0.0


def test_a_plate_alone_is_seen_whole() -> None:
    mesh = zo.Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 1e-3], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    points = zo.sample_surface(mesh, n_points=5000, seed=0)
    eyes = [[0.5, 0.5, 4.0], [0.5, 0.5, -4.0], [100.0, 0.3, 1.0]]
    with zo.prepare(mesh, "embree") as occluder:
        assert occluder.visible(points, eyes).all()


@pytest.mark.parametrize(("gap", "expected"), [(0.0, True), (0.9e-5, True), (1.1e-5, False), (0.1, False)])
def test_contact_tolerance(gap: float, expected: bool) -> None:
    """The upper plate hides the lower from straight above, but for a gap below 1e-5 of the diagonal."""
    mesh = two_plates(gap * np.sqrt(2.0))
    lower = zo.SurfacePoints([[0.5, 0.25, 0.0], [0.25, 0.5, 0.0]], [0, 1], [[0, 0, 1], [0, 0, 1]])
    eyes = lower.positions + np.array([0.0, 0.0, 4.0])
    with zo.prepare(mesh, "embree") as occluder:
        assert np.diagonal(occluder.visible(lower, eyes)).tolist() == [expected, expected]


def test_contact_is_an_option() -> None:
    points = zo.SurfacePoints([[0.5, 0.25, 0.0]], [0], [[0, 0, 1]])
    with zo.prepare(two_plates(0.01), "embree", contact=0.1) as occluder:
        assert occluder.visible(points, [[0.5, 0.25, 4.0]]).all()


def test_free_points_may_be_far_outside() -> None:
    """A plate's shadow on a plane a million sizes away: rays start at the bounding sphere, where float32 is fine."""
    mesh = two_plates(0.1)
    x, y = np.meshgrid(np.linspace(-1, 2, 30), np.linspace(-1, 2, 30))
    through = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    eye = np.array([0.5, 0.5, 3.0])
    free = zo.SurfacePoints.free(eye + (through - eye) * 1e6)
    margin = np.abs(np.abs(through[:, :2] - 0.5).max(axis=1) - 0.5 * 3.0 / 2.9)  # the upper plate's shadow is larger
    inside = np.abs(through[:, :2] - 0.5).max(axis=1) < 0.5 * 3.0 / 2.9
    with zo.prepare(mesh, "embree") as occluder:
        visible = occluder.visible(free, eye[None])[0]
    assert (visible == ~inside)[margin > 1e-6].all()
    assert 0 < inside.sum() < len(inside)
