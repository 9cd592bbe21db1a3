"""Solids against their closed forms and the oracle; formulas against topology; refinement against area and gaps."""

import numpy as np
import pytest

import zbuf_occlude as zo
from tests.scenes import unshared
from tests.solids import box_visible, holed_plate, sphere_visible, two_plates, two_plates_hidden, uv_sphere
from zbuf_occlude.base.errors import OptionError
from zbuf_occlude.meshes import shapes
from zbuf_occlude.meshes.shapes import formulas, solids

N = 20_000


def faces_at_edges(mesh: zo.Mesh) -> np.ndarray:
    """How many faces meet at each edge, edges told apart by position alone."""
    _, which = np.unique(mesh.vertices + 0.0, axis=0, return_inverse=True)
    faces = which.reshape(-1)[mesh.faces]
    edges = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    return np.unique(edges, axis=0, return_counts=True)[1]


def euler(mesh: zo.Mesh) -> int:
    """Vertices minus edges plus faces, vertices told apart by position."""
    used = mesh.vertices[np.unique(mesh.faces)]
    return len(np.unique(used + 0.0, axis=0)) - len(faces_at_edges(mesh)) + len(mesh.faces)


def visible_part(mesh: zo.Mesh, eye: tuple[float, float, float], faces: slice = slice(None)) -> float:
    """Fraction of the area of some faces that the oracle sees."""
    points = zo.sample_surface(mesh, n_points=N, seed=1)
    ours = np.isin(points.face_ids, np.arange(len(mesh.faces))[faces])
    with zo.prepare(mesh, method="oracle") as occluder:
        mask = occluder.visible(points.select(ours), [eye])
    return float(mask.mean())


# ---- solids ------------------------------------------------------------------------------------------------------


def test_icosphere() -> None:
    mesh = solids.icosphere(3, radius=2.0)
    assert len(mesh.faces) == 20 * 4**3
    np.testing.assert_allclose(np.linalg.norm(mesh.vertices, axis=1), 2.0, rtol=1e-14)
    assert (faces_at_edges(mesh) == 2).all()
    assert euler(mesh) == 2
    assert 0.98 < mesh.areas.sum() / (16 * np.pi) < 1.0
    assert mesh.areas.max() < 1.6 * mesh.areas.min()


@pytest.mark.parametrize("make", [lambda: solids.icosphere(4), lambda: uv_sphere(64)])
@pytest.mark.parametrize("distance", [1.2, 2.0, 8.0])
def test_visible_part_of_a_sphere(make, distance: float) -> None:
    seen = visible_part(make(), (0.0, -distance, 0.0))
    assert seen == pytest.approx(sphere_visible(1.0, distance), abs=0.012)
    assert sphere_visible(1.0, distance) == (1 - 1 / distance) / 2


@pytest.mark.parametrize("eye", [(3.0, 0.1, 0.2), (3.0, -4.0, 0.2), (2.0, 3.0, -4.0), (0.1, 0.1, 0.1)])
def test_visible_part_of_a_box(eye: tuple[float, float, float]) -> None:
    size = (1.0, 2.0, 0.5)
    mesh = solids.box(size)
    assert len(mesh.faces) == 12
    assert mesh.areas.sum() == pytest.approx(2 * (2.0 + 1.0 + 0.5))
    inside = all(abs(a) < s / 2 for a, s in zip(eye, size, strict=True))
    expected = box_visible(size, eye)
    assert expected == 0.0 if inside else 0.0 < expected < 1.0
    if not inside:
        assert visible_part(mesh, eye) == pytest.approx(expected, abs=0.012)


@pytest.mark.parametrize("distance", [0.5, 1.0, 4.0])
def test_hidden_part_of_the_rear_plate(distance: float) -> None:
    mesh = two_plates(front=0.3, rear=1.0, gap=0.7)
    hidden = two_plates_hidden(0.3, 1.0, 0.7, distance)
    assert hidden == pytest.approx((0.3 * (distance + 0.7) / distance) ** 2)
    assert 1 - visible_part(mesh, (0, -distance, 0), slice(2, 4)) == pytest.approx(hidden, abs=0.012)
    assert visible_part(mesh, (0, -distance, 0), slice(0, 2)) == 1.0
    assert two_plates_hidden(1.0, 1.0, 1.0, 5.0) == 1.0


def test_rear_plate_through_a_hole() -> None:
    mesh = holed_plate(side=2.0, hole=0.5, gap=1.0)
    assert mesh.areas.sum() == pytest.approx(4.0 - 0.25 + 4.0)
    seen = two_plates_hidden(0.5, 2.0, 1.0, 2.0)
    assert visible_part(mesh, (0, -2.0, 0), slice(8, 10)) == pytest.approx(seen, abs=0.012)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: solids.icosphere(9), "subdivisions must lie in 0 to 8; got 9"),
        (lambda: solids.icosphere(2, radius=0.0), "radius must be positive and finite; got 0.0"),
        (lambda: solids.box((1.0, -1.0, 1.0)), "depth must be positive and finite; got -1.0"),
        (lambda: formulas.make("blob"), "formula must be one of ellipsoid, .*; got 'blob'"),
        (lambda: formulas.make("torus", 3), "n must be at least 4; got 3"),
        (lambda: shapes.benchmark_mesh(10), "n_faces must be at least [0-9]+ for airplane 0; got 10"),
        (lambda: shapes.benchmark_mesh(9000, "sofa"), "label must be one of"),
        (lambda: shapes.soup(0), "n_faces must be a positive int; got 0"),
    ],
)
def test_errors(call, message: str) -> None:
    with pytest.raises(OptionError, match=message):
        call()


# ---- formulas ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", formulas.FORMULAS)
def test_every_formula_is_a_normalized_surface(name: str) -> None:
    mesh = formulas.make(name, 24)
    assert 24 * 24 * 2 - 100 <= len(mesh.faces) <= 24 * 24 * 2
    assert mesh.longest_side == pytest.approx(1.0)
    np.testing.assert_allclose(mesh.centre, 0.0, atol=1e-12)
    assert np.ptp(mesh.bounds, axis=0).min() > 0.1
    assert faces_at_edges(mesh).max() == 2, "a surface, not a heap"


@pytest.mark.parametrize(
    ("name", "characteristic", "closed"),
    [("torus", 0, True), ("trefoil", 0, True), ("saddle", 1, False), ("helicoid", 1, False), ("cylinder", 0, False),
     ("hyperboloid", 0, False), ("helix", 0, False), ("cone", 1, False)],
)  # fmt: skip
def test_topology(name: str, characteristic: int, closed: bool) -> None:
    mesh = formulas.make(name, 20)
    assert euler(mesh) == characteristic
    assert (faces_at_edges(mesh).min() == 2) == closed


def test_closed_forms_of_formulas() -> None:
    """Points lie on the surfaces that the names promise, up to the normalization."""
    torus = formulas.make("torus", 96)
    x, y, z = torus.vertices.T * 2.8
    np.testing.assert_allclose((np.hypot(x, y) - 1.0) ** 2 + z**2, 0.16, atol=1e-12)
    assert torus.areas.sum() * 2.8**2 == pytest.approx(4 * np.pi**2 * 0.4, rel=0.01)
    saddle = formulas.make("saddle", 16).vertices * 2
    np.testing.assert_allclose(saddle[:, 2], 0.6 * (saddle[:, 0] ** 2 - saddle[:, 1] ** 2), atol=1e-12)


# ---- meshes of any number of faces -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("n_faces", "label"), [(13_000, "car"), (18_000, "car"), (19_000, "airplane"), (45_000, "airplane")]
)
def test_benchmark_meshes(n_faces: int, label: str) -> None:
    mesh = shapes.benchmark_mesh(n_faces, label)
    assert n_faces - 8 <= len(mesh.faces) <= n_faces
    edges = np.linalg.norm(mesh.corners - np.roll(mesh.corners, 1, axis=1), axis=2)
    assert edges.max() < 0.05 * mesh.longest_side, "no large face is left"


def test_refinement_keeps_the_surface_and_opens_no_gap() -> None:
    """Also where every face has vertices of its own: then midpoints are equal to the last bit."""
    for mesh in (solids.icosphere(1), unshared(solids.icosphere(1)), solids.box((1.0, 3.0, 0.2))):
        finer = shapes.refined(mesh, 1501)
        assert 1493 <= len(finer.faces) <= 1501
        assert finer.areas.sum() == pytest.approx(mesh.areas.sum(), rel=1e-12)
        assert (faces_at_edges(finer) == 2).all()
        assert euler(finer) == 2
