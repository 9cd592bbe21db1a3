"""`exact` against the oracle: the meshes that break float32, eyes in awkward places, options and errors."""

import numpy as np
import pytest
import trimesh

import zbuf_occlude as zo
from zbuf_occlude import Mesh, OptionError, SurfacePoints, sample_surface
from zbuf_occlude.visibility.exact import prepare as prepare_exact
from zbuf_occlude.visibility.oracle import prepare as prepare_oracle

RNG = np.random.default_rng


def disagreements(mesh: Mesh, points: SurfacePoints, eyes: np.ndarray) -> int:
    """Count pairs outside the boundary band on which `exact` and the oracle differ."""
    exact, oracle = prepare_exact(mesh), prepare_oracle(mesh)
    wrong = exact.visible(points, eyes) != oracle.visible(points, eyes)
    if not wrong.any():
        return 0
    columns = np.flatnonzero(wrong.any(axis=0))
    return int((wrong[:, columns] & oracle.decided(points.select(columns), eyes)).sum())


def around(mesh: Mesh, n_eyes: int, distance: float, seed: int = 0) -> np.ndarray:
    return zo.views.random(n_eyes, distance=distance, seed=seed).around(mesh.centre, mesh.longest_side).eyes


def soup(n_faces: int, size: float, seed: int) -> Mesh:
    rng = RNG(seed)
    return Mesh(
        (rng.uniform(-1, 1, (n_faces, 1, 3)) + rng.normal(0, size, (n_faces, 3, 3))).reshape(-1, 3),
        np.arange(3 * n_faces).reshape(-1, 3),
    )


def needles(width: float) -> Mesh:
    rng = RNG(5)
    start = rng.uniform(-1, 1, (300, 1, 3))
    along = rng.normal(0, 0.6, (300, 1, 3)) * np.array([0.0, 1.0, 0.99])[None, :, None]
    across = rng.normal(0, width, (300, 3, 3))
    return Mesh((start + along + across).reshape(-1, 3), np.arange(900).reshape(-1, 3))


def huge_beside_tiny() -> Mesh:
    tiny = soup(2000, 0.005, 3)
    wall = np.array([[-40.0, -40.0, 0.1], [40.0, -40.0, 0.12], [0.0, 60.0, 0.11]])
    return Mesh(np.concatenate([tiny.vertices, wall]), np.concatenate([tiny.faces, [[6000, 6001, 6002]]]))


def twice(mesh: Mesh) -> Mesh:
    return Mesh(mesh.vertices, np.concatenate([mesh.faces, mesh.faces[:, [1, 2, 0]]]))


HARD = {
    "soup": lambda: soup(600, 0.15, 1),
    "dust": lambda: soup(2000, 0.02, 2),
    "needles 1e-2": lambda: needles(1e-2),
    "needles 1e-4": lambda: needles(1e-4),
    "needles 1e-7": lambda: needles(1e-7),
    "huge beside tiny": huge_beside_tiny,
    "cylinder": lambda: Mesh.from_trimesh(trimesh.creation.cylinder(radius=0.5, height=1.5, sections=3000)),
    "icosphere": lambda: Mesh.from_trimesh(trimesh.creation.icosphere(subdivisions=4)),
    "plate": lambda: Mesh.from_trimesh(trimesh.creation.box((1.0, 1.0, 0.001))),
    "duplicates": lambda: twice(soup(200, 0.3, 4)),
    "one face": lambda: Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]),
    "box": lambda: Mesh.from_trimesh(trimesh.creation.box()),
}


@pytest.mark.parametrize("name", HARD)
@pytest.mark.parametrize("distance", [4.0, 0.9, 0.2])
def test_equals_the_oracle_outside_the_boundary_band(name: str, distance: float) -> None:
    mesh = HARD[name]()
    points = sample_surface(mesh, n_points=1500, seed=1)
    assert disagreements(mesh, points, around(mesh, 6, distance)) == 0


def test_axis_aligned_eyes_see_faces_edge_on() -> None:
    mesh = HARD["box"]()
    points = sample_surface(mesh, n_points=3000, seed=1)
    eyes = np.concatenate([np.eye(3), -np.eye(3)]) * 3.0
    assert disagreements(mesh, points, np.concatenate([eyes, eyes * 0.7, eyes + np.array([0.5, 0, 0])])) == 0


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
        points = sample_surface(mesh, n_points=100, seed=rng)
        assert disagreements(mesh, points, eyes) == 0


def test_eyes_a_hair_above_the_surface() -> None:
    mesh = HARD["icosphere"]()
    points = sample_surface(mesh, n_points=2000, seed=2)
    for height in (1e-2, 1e-4, 1e-6):
        eyes = points.positions[:5] + height * points.normals[:5] * np.sign(
            (points.normals[:5] * points.positions[:5]).sum(axis=1, keepdims=True)
        )
        assert disagreements(mesh, points, eyes) == 0


def test_free_points_far_outside_the_mesh() -> None:
    mesh = soup(400, 0.2, 9)
    directions = RNG(0).normal(size=(1500, 3))
    points = SurfacePoints.free(directions * 10.0 ** RNG(1).uniform(-1, 3, (1500, 1)))
    assert disagreements(mesh, points, around(mesh, 6, 3.0)) == 0


@pytest.mark.parametrize("distance", [1e2, 1e4, 1e6])
def test_eyes_far_away(distance: float) -> None:
    mesh = HARD["icosphere"]()
    points = sample_surface(mesh, n_points=1000, seed=2)
    assert disagreements(mesh, points, around(mesh, 4, distance)) == 0


def test_faces_of_no_area_hide_nothing() -> None:
    mesh = Mesh([[-1, 0, 0], [1, 0, 0], [3, 0, 0], [0, 0, 5]], [[0, 1, 2], [0, 0, 0]])
    points = SurfacePoints.free([[0.0, 0.0, -1.0]])
    assert prepare_exact(mesh).visible(points, [[0.0, 0.0, 3.0]]).all()


def test_visible_fraction_of_a_sphere() -> None:
    mesh = Mesh.from_trimesh(trimesh.creation.icosphere(subdivisions=6))  # 81,920 faces
    points = sample_surface(mesh, n_points=20_000, seed=3)
    share = prepare_exact(mesh).visible(points, [[0.0, 0.0, 3.0], [2.0, 0.0, 0.0]]).mean(axis=1)
    expected = np.array([(1 - 1 / 3) / 2, (1 - 1 / 2) / 2])
    assert (np.abs(share - expected) < 4 * np.sqrt(expected * (1 - expected) / 20_000)).all()


def test_contact_must_be_a_fraction() -> None:
    with pytest.raises(OptionError, match=r"contact must lie in \[0, 1\), a fraction of the mesh's diagonal; got 2"):
        prepare_exact(HARD["box"](), contact=2.0)


@pytest.mark.parametrize("method", ["exact", pytest.param("exact_gl", marks=pytest.mark.gl)])
def test_points_behind_their_own_face_are_not_hidden_by_it(method: str) -> None:
    # a packet and a chunk of points well off their face, which alone would cover them all
    mesh = zo.Mesh([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.9, 0.9, 0.9]], [[0, 1, 2], [1, 2, 3]])
    positions = np.tile([0.25, 0.25, -0.01], (600, 1)) + 0.01 * np.random.default_rng(0).random((600, 3)) * [1, 1, 0]
    points = zo.SurfacePoints(positions, np.zeros(600, dtype=np.int32), np.tile([0.0, 0.0, 1.0], (600, 1)))
    with zo.prepare(mesh, method=method) as occluder, zo.prepare(mesh, method="oracle") as oracle:
        for eye in ([0.2, 0.3, 9.0], [0.2, 0.3, 0.3]):
            assert oracle.visible(points, [eye]).all()
            assert occluder.visible(points, [eye]).all()
