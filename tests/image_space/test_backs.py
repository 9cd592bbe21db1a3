"""Points and clusters that turn their back: decided without a search, left out, and all as the oracle decides."""

import numpy as np
import pytest
import trimesh

from zbuf_occlude import Mesh, SurfacePoints, prepare, sample_surface, views
from zbuf_occlude.image_space.backs import make_solids
from zbuf_occlude.image_space.packets import make_packets
from zbuf_occlude.image_space.scene import make_scene
from zbuf_occlude.image_space.sides import drop_turned, find_sides
from zbuf_occlude.image_space.surface import make_surface
from zbuf_occlude.meshes import shapes
from zbuf_occlude.visibility import exact

BALL = shapes.solids.icosphere(4)
BALL_PAIRS, BALL_EDGES = trimesh.graph.face_adjacency(BALL.faces, return_edges=True)
EYES = views.fibonacci(20, distance=5.0).eyes


@pytest.fixture
def at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Solids are looked for at the first question."""
    monkeypatch.setattr(exact, "WORTH", 0)


def backed(mesh: Mesh, points: SurfacePoints) -> tuple[np.ndarray, np.ndarray, bool]:
    """Which points are backed, the faces beside their own where these matter, else -1; whether all are on faces."""
    scene, solids = make_scene(mesh, 1e-5 * mesh.diagonal), make_solids(mesh, 1e-5)
    rows = np.full(len(mesh.faces) + 1, -1, dtype=np.int32)
    rows[scene.face_ids[scene.face_ids >= 0]] = np.flatnonzero(scene.face_ids.reshape(-1) >= 0)
    packets = make_packets(points, scene, rows, solids, make_surface(scene, rows, solids).records)
    found, beside, order = np.zeros(len(points), dtype=bool), np.full(len(points), -1), packets.order[: len(points)]
    bits = [(words[:, None] >> np.arange(64)) & 1 for words in (packets.backed, packets.twofold)]
    found[order], two = (bit.reshape(-1)[: len(points)] != 0 for bit in bits)
    beside[order[two]] = scene.face_ids.reshape(-1)[packets.beside_rows[: len(points)][two]]
    return found, beside, packets.on_faces


def share_backed(mesh: Mesh, points: SurfacePoints) -> float:
    return float(backed(mesh, points)[0].mean())


def test_points_of_solids_are_backed_and_others_are_not() -> None:
    points = sample_surface(BALL, n_points=2000, seed=0)
    assert share_backed(BALL, points) == 1.0
    assert share_backed(Mesh(BALL.vertices, BALL.faces[1:]), points.select(points.face_ids > 0)) == 0.0
    assert share_backed(BALL, SurfacePoints.free(points.positions)) == 0.0
    off = SurfacePoints(points.positions + 1e-6 * points.normals, points.face_ids, points.normals)
    assert share_backed(BALL, off) == 0.0
    elsewhere = SurfacePoints(points.positions, np.roll(points.face_ids, 7), points.normals)
    assert share_backed(BALL, elsewhere) < 0.01


def test_corners_are_left_to_the_search_and_edges_are_not() -> None:
    corners = BALL.corners
    for target, expected in ((corners[:, 0], 0.0), ((corners[:, 0] + corners[:, 1]) / 2.0, 1.0)):
        positions = target + 1e-6 * (corners.mean(axis=1) - target)
        points = SurfacePoints(positions, np.arange(len(corners), dtype=np.int32), BALL.face_normals)
        assert share_backed(BALL, points) == expected


def test_the_face_beside_is_the_one_across_the_edge_that_a_point_is_close_to() -> None:
    corners = BALL.corners
    across = {tuple(sorted(edge)): faces for edge, faces in zip(BALL_EDGES.tolist(), BALL_PAIRS.tolist(), strict=True)}
    for edge in range(3):
        middle = (corners[:, edge] + corners[:, (edge + 1) % 3]) / 2.0
        points = SurfacePoints(
            middle + 1e-6 * (corners.mean(axis=1) - middle), np.arange(len(corners), dtype=np.int32), BALL.face_normals
        )
        pairs = [across[tuple(sorted((face[edge], face[(edge + 1) % 3])))] for face in BALL.faces.tolist()]
        expected = [pair[0] + pair[1] - own for own, pair in enumerate(pairs)]
        assert backed(BALL, points)[1].tolist() == expected
    inner = SurfacePoints(corners.mean(axis=1), np.arange(len(corners), dtype=np.int32), BALL.face_normals)
    assert (backed(BALL, inner)[1] == -1).all()


@pytest.mark.parametrize("n_points", [200, 20_000])  # fewer than faces, and more: two ways through the search
@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.usefixtures("at_once")
def test_every_answer_stays_the_same(n_points: int, turned: bool) -> None:
    ball = Mesh(BALL.vertices, BALL.faces[:, ::-1]) if turned else BALL
    table = shapes.make("table", 0).normalized()
    mesh = Mesh(
        np.concatenate([ball.vertices, table.transformed(1.0, [0.9, 0.0, 0.0]).vertices]),
        np.concatenate([ball.faces, table.faces + len(ball.vertices)]),
    )
    points = sample_surface(mesh, n_points=n_points, seed=3)
    eyes = np.concatenate([EYES, [[0.0, 0.0, 0.0], [0.3, 0.2, -0.1]]])  # inside the ball, where its backs are seen
    some = np.arange(0, n_points, max(1, n_points // 500))
    with prepare(mesh, "exact") as occluder, prepare(mesh, "oracle") as oracle:
        assert (occluder.visible(points, eyes)[:, some] == oracle.visible(points.select(some), eyes)).all()
    assert share_backed(mesh, points) > 0.9


def test_solids_are_looked_for_when_it_pays(monkeypatch: pytest.MonkeyPatch) -> None:
    made = []
    monkeypatch.setattr(exact, "make_solids", lambda *arguments: made.append(1) or make_solids(*arguments))
    points = sample_surface(BALL, n_points=40 * len(BALL.faces), seed=0)
    with prepare(BALL, "exact") as occluder:
        first = occluder.visible(points, EYES[:1])
        assert not made
        masks = occluder.visible(points, EYES[:2])
        assert made == [1]
        assert (masks[0] == first[0]).all()
        occluder.visible(points, EYES[:2])
        assert made == [1]


@pytest.mark.parametrize("inwards", [False, True])
def test_clusters_are_dropped_where_all_their_faces_are_turned_away(inwards: bool) -> None:
    mesh = Mesh(BALL.vertices, BALL.faces[:, ::-1]) if inwards else BALL
    scene = make_scene(mesh, 1e-5 * mesh.diagonal)
    rows = np.argsort(np.append(scene.face_ids[scene.face_ids >= 0], len(mesh.faces))).astype(np.int32)
    rows[:-1] = np.flatnonzero(scene.face_ids.reshape(-1) >= 0)[rows[:-1]]
    rows[-1] = -1
    surface = make_surface(scene, rows, make_solids(mesh, 1e-5))
    front, back = np.zeros((2, len(scene.used)), dtype=np.int64)
    for eye in 3.0 * EYES:
        local = (eye - scene.centre) * scene.scale
        rectangles = np.zeros((6, len(scene.used)), dtype=np.float32)
        find_sides(scene, surface, tuple(local.astype(np.float32)), front, back)
        drop_turned(scene, surface, back, rectangles)
        dropped = rectangles[0] > rectangles[1]
        heights = ((eye - BALL.corners[:, 0]) * BALL.face_normals).sum(axis=1)
        turned = np.append(heights < 0.0, True)[scene.face_ids].all(axis=1)
        assert not (dropped & ~turned).any()
        assert 0.9 * turned.sum() < dropped.sum() < 0.5 * len(turned)


@pytest.mark.parametrize("n_points", [200, 20_000])
@pytest.mark.usefixtures("at_once")
def test_a_point_beyond_the_solid_is_hidden_by_a_back_when_the_front_is_its_own(n_points: int) -> None:
    points = sample_surface(BALL, n_points=n_points, seed=5)
    eye = np.array([[0.0, 0.0, 40.0]])
    front = np.flatnonzero(points.normals[:, 2] > 0.9)[:50]
    positions = points.positions.copy()
    positions[front] += 0.1 * (positions[front] - eye)  # along the line of sight, through the ball and out of it
    beyond = SurfacePoints(positions, points.face_ids, points.normals)
    some = np.append(front, np.arange(0, n_points, 50))
    with prepare(BALL, "exact") as occluder, prepare(BALL, "oracle") as oracle:
        truth = oracle.visible(beyond.select(some), eye)[0]
        assert not truth[: len(front)].any()
        assert (occluder.visible(beyond, eye)[0, some] == truth).all()


def test_points_are_on_their_faces_or_not() -> None:
    points = sample_surface(BALL, n_points=500, seed=6)

    def on_faces(positions: np.ndarray) -> bool:
        return backed(BALL, SurfacePoints(positions, points.face_ids, points.normals))[2]

    corners = BALL.corners[points.face_ids]
    assert on_faces(points.positions)
    assert on_faces(corners[:, 0])
    assert on_faces((corners[:, 1] + corners[:, 2]) / 2.0)
    assert not on_faces(points.positions + 1e-8 * points.normals)
    assert not on_faces(points.positions + np.eye(500)[:, :1] * 2.0 * (corners[:, 1] - corners[:, 0]))  # in its plane
