"""Visibility followed over the surface: whole regions at one answer, against the oracle, and what it must not cross."""

import numpy as np
import pytest

from tests.scenes import together
from zbuf_occlude import Mesh, SurfacePoints, prepare, sample_surface, views
from zbuf_occlude.image_space import search
from zbuf_occlude.meshes import shapes
from zbuf_occlude.visibility import exact

BALL = shapes.solids.icosphere(4)
EYES = views.fibonacci(12, distance=4.0).eyes


@pytest.fixture(autouse=True)
def at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Solids are looked for at the first question, and regions wherever there can be any."""
    monkeypatch.setattr(exact, "WORTH", 0)
    monkeypatch.setattr(exact, "FOLLOWED", 0)
    monkeypatch.setattr(exact, "LEAST_FOLLOWED", 0)


def bowl() -> Mesh:
    """A ball without its top: open, seen from both sides."""
    return Mesh(BALL.vertices, BALL.faces[BALL.corners[:, :, 2].max(axis=1) < 0.6])


MESHES = {
    "ball": BALL,
    "moon": together(BALL, BALL.transformed(0.4, [2.0, 0.3, 0.1])),
    "balls that cross": together(BALL, BALL.transformed(0.7, [0.8, 0.1, 0.05])),
    "nested": together(BALL, BALL.transformed(0.5), BALL.transformed(0.99999)),
    "bowl": bowl(),
    "bowls": together(bowl(), bowl().transformed(0.8)),
    "wound anyhow": Mesh(
        BALL.vertices, np.where(np.arange(len(BALL.faces))[:, None] % 3, BALL.faces, BALL.faces[:, ::-1])
    ),
    "airplane": shapes.make("airplane", 0),
    "chair": shapes.make("chair", 1),
    "car": shapes.make("car", 2),
}


@pytest.mark.parametrize("name", MESHES)
def test_every_answer_is_the_oracles(name: str) -> None:
    mesh = MESHES[name].normalized()
    points = sample_surface(mesh, n_points=40_000, seed=1)
    eyes = np.concatenate([EYES, [[0.1, 0.0, 0.2]], 300.0 * np.eye(3)])  # one inside, three far and on the axes
    some = np.arange(0, len(points), 80)
    with prepare(mesh, "exact") as occluder, prepare(mesh, "oracle") as oracle:
        found = occluder.visible(points, eyes)
        assert (found[:, some] == oracle.visible(points.select(some), eyes)).all()
    with prepare(mesh, "embree") as judge:
        assert (found != judge.visible(points, eyes)).mean() < 2e-3


def test_an_edge_that_is_shared_with_a_face_without_area_only_ends_the_surface() -> None:
    plates = [[[-1, -1, 1], [1, -1, 1], [1, 1, 1]], [[-1, -1, 1], [1, 1, 1], [-1, 1, 1]]]
    slivers = [[[1, 1, 1], [1, -1, 1], [1, -3, 1]], [[-1, 1, 1], [1, 1, 1], [3, 1, 1]]]  # along two edges of the plates
    u, v = np.meshgrid(np.linspace(-2, 2, 9), np.linspace(-2, 2, 9), indexing="ij")
    floor = np.stack([u.reshape(-1), v.reshape(-1), np.zeros(81)], axis=1)
    first = (9 * np.arange(8)[:, None] + np.arange(8)).reshape(-1)
    faces = floor[np.concatenate([first[:, None] + [0, 9, 1], first[:, None] + [1, 9, 10]])][2:]  # whole clusters of 16
    for order in (plates + slivers, slivers + plates):
        corners = np.concatenate([np.array(order, dtype=np.float64), faces])
        mesh = Mesh(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))
        points = sample_surface(mesh, n_points=4000, seed=0)
        with prepare(mesh, "exact") as occluder, prepare(mesh, "oracle") as oracle:
            assert (occluder.visible(points, 2.0 * EYES) == oracle.visible(points, 2.0 * EYES)).all()
            assert (occluder._surface.edges[:, 0] >= 0).all()  # type: ignore[attr-defined]


@pytest.mark.parametrize("size", [(1.0, 1.0, 0.0), (1.0, 1.0, 5e-4), (1.0, 5e-4, 5e-4)])
def test_flat_and_thin_bodies_seen_along_the_axes(size: tuple[float, float, float]) -> None:
    """Their images are lower than a cell's margin."""
    box = shapes.refined(shapes.solids.box(), 400)
    corners = box.corners * size
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    corners = corners[area > 0.0] if size[2] else corners[(area > 0.0) & (box.corners[:, :, 2] > 0.0).all(axis=1)]
    mesh = Mesh(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))
    points = sample_surface(mesh, n_points=4000, seed=0)
    eyes = mesh.centre + 2.0 * mesh.diagonal * np.concatenate([np.eye(3), [[0.6, 0.8, 0.0], [0.5, 0.5, 0.7]]])
    with prepare(mesh, "exact") as occluder, prepare(mesh, "oracle") as oracle:
        assert (occluder.visible(points, eyes) == oracle.visible(points, eyes)).all()


@pytest.mark.parametrize("degrees", [0.5, 2.0, 10.0, 55.0, 65.0, 100.0])
def test_points_along_a_fold_are_hidden_where_the_other_leaf_is_farther_than_the_tolerance(degrees: float) -> None:
    t, n = np.radians(degrees), 6
    u, v = (a.reshape(-1) for a in np.meshgrid(np.linspace(0, 1, n), np.linspace(0, 1, n), indexing="ij"))
    leaves = [np.stack([u * np.cos(a), v, u * np.sin(a)], axis=1) for a in (0.0, t)]
    first = (n * np.arange(n - 1)[:, None] + np.arange(n - 1)).reshape(-1)
    faces = np.concatenate([first[:, None] + [0, 1, n], first[:, None] + [1, n + 1, n]])
    mesh = Mesh(np.concatenate(leaves), np.concatenate([faces, faces + n * n]))
    points = sample_surface(mesh, n_points=8000, seed=0)
    near = points.positions.copy()
    low = points.face_ids < len(faces)
    near[low, 0] *= 10.0 ** np.random.default_rng(0).uniform(
        -5.0, 0.0, low.sum()
    )  # towards the fold, on its row of faces
    own = (np.minimum(near[:, 1] * (n - 1), n - 1.001)).astype(int)
    upper = near[:, 0] * (n - 1) + near[:, 1] * (n - 1) - own > 1.0
    moved = low & (near[:, 0] < 1.0 / (n - 1))
    face_ids = np.where(moved, own + np.where(upper, (n - 1) ** 2, 0), points.face_ids).astype(np.int32)
    near = np.where(moved[:, None], near, points.positions)
    points = SurfacePoints(near, face_ids, points.normals)
    eyes = mesh.centre + 2.0 * np.array([[0.1, 0.2, 1.0], [0.5, -0.3, 0.8], [-0.4, 0.2, 0.9], [0.2, 0.9, 0.4]])
    with prepare(mesh, "exact") as occluder, prepare(mesh, "oracle") as oracle:
        assert (occluder.visible(points, eyes) == oracle.visible(points, eyes)).all()


def test_most_points_of_a_closed_mesh_need_no_search(monkeypatch: pytest.MonkeyPatch) -> None:
    mesh = MESHES["moon"].normalized()
    points = sample_surface(mesh, n_points=40_000, seed=1)
    asked = []
    monkeypatch.setattr(exact, "find_visible", lambda *arguments: asked.append(arguments))
    with prepare(mesh, "exact") as occluder:
        occluder.visible(points, EYES)
        scene, surface, packets, frames, following, *_ = asked[0]
        assert following
        assert searched(scene, surface, packets, frames) < 0.02
        occluder.visible(SurfacePoints.free(points.positions), EYES)
    assert (np.diff(asked[1][2].row_starts) == 0).all()


def searched(scene, surface, packets, frames) -> float:  # type: ignore[no-untyped-def]
    """Share of the points that are left to the search, for the first eye."""
    space = search.make_workspace(scene, packets.coordinates.shape[1] // 16)
    regions = search.make_regions(len(scene.used), surface.n_vertices, True)
    contours = search.make_contours(len(surface.edges))
    tiles = search.make_tiles(0, 0)
    answer = np.ones(packets.n_points, dtype=bool)
    search.search_frame(
        scene,
        surface,
        packets,
        frames.matrices[0, 0],
        frames.windows[0],
        frames.eyes[0],
        -1,
        0,
        packets.coordinates.shape[1] // 16,
        space,
        regions,
        contours,
        tiles,
        1,
        answer,
    )
    decided = (space.decided[:, None] >> np.arange(16)) & 1
    return float(1.0 - decided.reshape(-1)[: packets.n_points].mean())


def test_points_off_their_faces_are_not_followed(monkeypatch: pytest.MonkeyPatch) -> None:
    points = sample_surface(BALL, n_points=20_000, seed=1)
    off = SurfacePoints(points.positions + 1e-7 * points.normals, points.face_ids, points.normals)
    asked = []
    monkeypatch.setattr(exact, "find_visible", lambda *arguments: asked.append(arguments[4]))
    with prepare(BALL, "exact") as occluder:
        occluder.visible(points, EYES)
        occluder.visible(off, EYES)
    assert asked == [True, False]


@pytest.mark.parametrize("contact", [0.0, 1e-7, 1e-3, 0.05])
def test_small_and_large_contact_tolerances_are_not_followed_and_are_answered(
    contact: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    points = sample_surface(BALL, n_points=20_000, seed=1)
    corners = BALL.corners[points.face_ids[::50]]  # some on edges, where the faces next to them decide
    positions = points.positions.copy()
    positions[::50] = (corners[:, 0] + corners[:, 1]) / 2.0
    on_edges = SurfacePoints(positions, points.face_ids, points.normals)
    asked, find_visible = [], exact.find_visible
    monkeypatch.setattr(
        exact, "find_visible", lambda *arguments: asked.append(arguments[4]) or find_visible(*arguments)
    )
    some = np.arange(0, 20_000, 10)
    with prepare(BALL, "exact", contact=contact) as occluder, prepare(BALL, "oracle", contact=contact) as oracle:
        found, chosen = occluder.visible(on_edges, EYES)[:, some], on_edges.select(some)
        assert not ((found != oracle.visible(chosen, EYES)) & oracle.decided(chosen, EYES)).any()
    assert asked == [False]


def test_few_points_or_little_clear_area_are_not_followed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(exact, "FOLLOWED", 4)
    monkeypatch.setattr(exact, "LEAST_FOLLOWED", 0.3)
    asked = []
    monkeypatch.setattr(exact, "find_visible", lambda *arguments: asked.append(arguments[4]))
    twice = together(BALL, BALL.transformed(1.0 + 1e-7))
    for mesh, n_points in ((BALL, 4 * len(BALL.faces)), (BALL, 3 * len(BALL.faces)), (twice, 50_000)):
        with prepare(mesh, "exact") as occluder:
            occluder.visible(sample_surface(mesh, n_points=n_points, seed=0), EYES)
    assert asked == [True, False, False]
