"""`exact` against the oracle where tests/engines/exact does not go: many slender faces, one plane, far away."""

import numpy as np
import pytest
import trimesh

import zbuf_occlude as zo
from tests.scenes import soup, wrong
from zbuf_occlude import Mesh, SurfacePoints, sample_surface

RNG = np.random.default_rng


def disagreements(mesh: Mesh, points: SurfacePoints, eyes: np.ndarray) -> int:
    with zo.prepare(mesh, "exact") as occluder:
        return wrong(mesh, occluder.visible(points, eyes), points, eyes)


def around(mesh: Mesh, n_eyes: int, distance: float) -> np.ndarray:
    return zo.views.random(n_eyes, distance=distance, seed=0).around(mesh.centre, mesh.longest_side).eyes


@pytest.mark.parametrize("distance", [0.2, 0.9, 4.0, 1e2, 1e4, 1e6])
def test_a_cylinder_of_3000_sections(distance: float) -> None:
    mesh = Mesh.from_trimesh(trimesh.creation.cylinder(radius=0.5, height=1.5, sections=3000))
    assert disagreements(mesh, sample_surface(mesh, n_points=1500, seed=1), around(mesh, 6, distance)) == 0


def sheet(n: int, rng: np.random.Generator) -> tuple[Mesh, np.ndarray]:
    """A flat square of 2 n^2 faces somewhere in space, and its plane's two directions and a point of it, (3, 3)."""
    frame = np.concatenate([np.linalg.qr(rng.normal(size=(3, 3)))[0][:2], 3.0 * rng.normal(size=(1, 3))])
    u, v = np.meshgrid(np.linspace(-1, 1, n + 1), np.linspace(-1, 1, n + 1), indexing="ij")
    first = ((n + 1) * np.arange(n)[:, None] + np.arange(n)).reshape(-1)
    faces = np.concatenate([first[:, None] + [0, 1, n + 1], first[:, None] + [1, n + 2, n + 1]])
    return Mesh(np.stack([u, v, np.ones_like(u)], axis=-1).reshape(-1, 3) @ frame, faces), frame


@pytest.mark.parametrize("distance", [(1.5, 2.1), (2.2, 8.0)])  # six frames, and one
def test_eyes_in_the_plane_of_the_faces(distance: tuple[float, float]) -> None:
    rng = RNG(3)
    for _ in range(10):
        mesh, frame = sheet(2, rng)
        angles, radii = rng.uniform(0.0, 2.0 * np.pi, (20, 1)), rng.uniform(*distance, (20, 1))
        eyes = np.concatenate([radii * np.cos(angles), radii * np.sin(angles), np.ones((20, 1))], axis=1) @ frame
        assert disagreements(mesh, sample_surface(mesh, n_points=100, seed=rng), eyes) == 0


def test_free_points_far_outside_the_mesh() -> None:
    mesh = soup(400, 0.1, 9)
    points = SurfacePoints.free(RNG(0).normal(size=(1500, 3)) * 10.0 ** RNG(1).uniform(-1, 3, (1500, 1)))
    assert disagreements(mesh, points, around(mesh, 6, 3.0)) == 0


@pytest.mark.parametrize("exponent", [-332, -200, 230])
@pytest.mark.parametrize("method", ["exact", "oracle"])
def test_units_of_any_size_give_the_same_answers(method: str, exponent: int) -> None:
    """From 1e-100 to 1e69: products of three lengths underflow, or overflow, in float64."""
    mesh, unit = soup(200, 0.3, 2), 2.0**exponent
    points, eyes = sample_surface(mesh, n_points=200, seed=0), around(mesh, 3, 2.0)
    rays = points.positions - eyes[0]
    with zo.prepare(mesh, method) as usual, zo.prepare(mesh.transformed(unit), method) as scaled:
        moved = SurfacePoints(points.positions * unit, points.face_ids, points.normals)
        assert (scaled.visible(moved, eyes * unit) == usual.visible(points, eyes)).all()
        found, expected = scaled.first_hits(eyes[:1] * unit, rays * unit), usual.first_hits(eyes[:1], rays)
        assert (found.face_ids == expected.face_ids).all()
        assert np.allclose(found.distances / unit, expected.distances, rtol=1e-12)


def test_faces_of_no_area_hide_nothing() -> None:
    mesh = Mesh([[-1, 0, 0], [1, 0, 0], [3, 0, 0], [0, 0, 5]], [[0, 1, 2], [0, 0, 0]])
    with zo.prepare(mesh, "exact") as occluder:
        assert occluder.visible(SurfacePoints.free([[0.0, 0.0, -1.0]]), [0.0, 0.0, 3.0]).all()


@pytest.mark.parametrize("method", ["exact", pytest.param("exact_gl", marks=pytest.mark.gl)])
def test_points_behind_their_own_face_are_not_hidden_by_it(method: str) -> None:
    # a packet and a chunk of points well off their face, which alone would cover them all
    mesh = Mesh([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.9, 0.9, 0.9]], [[0, 1, 2], [1, 2, 3]])
    positions = np.tile([0.25, 0.25, -0.01], (600, 1)) + 0.01 * RNG(0).random((600, 3)) * [1, 1, 0]
    points = SurfacePoints(positions, np.zeros(600, dtype=np.int32), np.tile([0.0, 0.0, 1.0], (600, 1)))
    with zo.prepare(mesh, method) as occluder, zo.prepare(mesh, "oracle") as oracle:
        for eye in ([0.2, 0.3, 9.0], [0.2, 0.3, 0.3]):
            assert oracle.visible(points, [eye]).all()
            assert occluder.visible(points, [eye]).all()
