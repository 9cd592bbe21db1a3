"""Faces that keep clear of what they are not joined to, and the barriers on the others, by measured distances."""

import numpy as np
import pytest
import trimesh

from tests.scenes import together
from zbuf_occlude import Mesh, sample_surface
from zbuf_occlude.meshes import shapes
from zbuf_occlude.solids import Clearance, closed_surfaces, find_clearance
from zbuf_occlude.solids.clear import find_fans

REACH = 1e-4
BALL = shapes.solids.icosphere(2)


CROSSING = together(BALL, BALL.transformed(0.7, [0.8, 0.1, 0.05]))
MESHES = {
    "ball": BALL,
    "balls apart": together(BALL, BALL.transformed(0.5, [3.0, 0.0, 0.0])),
    "balls that cross": CROSSING,
    "half a ball": Mesh(BALL.vertices, BALL.faces[: len(BALL.faces) // 2]),
    "table": shapes.make("table", 0),
}


def clearance(mesh: Mesh) -> tuple[np.ndarray, Clearance]:
    corners = (mesh.corners - mesh.centre) / mesh.diagonal
    return corners, find_clearance(corners, closed_surfaces(mesh), REACH)


def joined(mesh: Mesh, face: int) -> np.ndarray:
    closed = closed_surfaces(mesh)
    fans = find_fans(closed.twins, closed.vertices.reshape(-1))
    return np.isin(fans, fans[face]).any(axis=1)


def distances(point: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    points = np.tile(point, (len(triangles), 1))
    return np.asarray(np.linalg.norm(points - trimesh.triangles.closest_point(triangles, points), axis=1))


@pytest.mark.parametrize("name", MESHES)
def test_what_is_near_a_point_of_a_followed_face_is_joined_to_it_or_behind_a_barrier(name: str) -> None:
    mesh = MESHES[name]
    corners, found = clearance(mesh)
    points = sample_surface(mesh, n_points=1500, seed=2)
    for position, face in zip((points.positions - mesh.centre) / mesh.diagonal, points.face_ids, strict=True):
        first, last = found.barriers.starts[face : face + 2]
        if not found.clear[face] and first == last:
            continue
        close = distances(position, corners) <= REACH
        if not (close & ~joined(mesh, face)).any():
            continue
        assert not found.clear[face]
        ends, radii = found.barriers.ends[first:last], found.barriers.radii[first:last]
        along = ends[:, 1] - ends[:, 0]
        share = ((position - ends[:, 0]) * along).sum(axis=1) / np.maximum((along**2).sum(axis=1), 1e-300)
        nearest = ends[:, 0] + np.clip(share, 0.0, 1.0)[:, None] * along
        assert (np.linalg.norm(position - nearest, axis=1) <= radii).any()


def test_faces_of_a_ball_are_clear_and_those_that_another_runs_through_have_barriers() -> None:
    assert clearance(BALL)[1].clear.all()
    _, found = clearance(CROSSING)
    fenced = np.diff(found.barriers.starts) > 0
    assert 0.5 < found.clear.mean() < 1.0
    assert fenced.sum() > 10
    assert not (fenced & found.clear).any()


def test_faces_that_lie_on_each_other_are_not_clear() -> None:
    twice = together(BALL, BALL.transformed(1.0 + 1e-5))
    assert not clearance(twice)[1].clear.any()


def test_solids_that_touch_at_a_corner_are_not_clear_there() -> None:
    box = Mesh.from_trimesh(trimesh.creation.box((1.0, 1.0, 1.0)))
    touching = together(box, box.transformed(1.0, [1.0, 1.0, 1.0]))
    _, found = clearance(touching)
    corner = (touching.corners == 0.5).all(axis=2).any(axis=1)
    assert corner.sum() > 4
    assert not found.clear[corner].any()
    assert found.clear[~corner].all()


def folded(degrees: float) -> Mesh:
    """Two rows of faces that share the line x = 0 = z."""
    t, y = np.radians(degrees), np.arange(5.0)
    ends = [np.stack([x * np.ones(5), y, z * np.ones(5)], axis=1) for x, z in ((0, 0), (1, 0), (np.cos(t), np.sin(t)))]
    first = np.arange(4)
    one = np.concatenate(
        [np.stack(c, axis=1) for c in ((first, first + 1, first + 5), (first + 1, first + 6, first + 5))]
    )
    return Mesh(np.concatenate(ends), np.concatenate([one, np.where(one >= 5, one + 5, one)]))


def test_leaves_of_sharp_folds_are_not_clear_but_for_a_solids_outer_edge() -> None:
    for degrees, clear in ((1.0, False), (50.0, False), (70.0, True), (180.0, True)):
        assert clearance(folded(degrees))[1].clear.all() == clear
    wedge = np.array([[0, 0, 0], [0, 9, 0], [9, 0, 0.5], [9, 9, 0.5], [9, 0, -0.5], [9, 9, -0.5]], dtype=np.float64)
    solid = Mesh(wedge, hull_faces(wedge))
    assert (closed_surfaces(solid).outward != 0).all()
    assert clearance(solid)[1].clear.all()


def hull_faces(points: np.ndarray) -> np.ndarray:
    hull = trimesh.convex.convex_hull(points)
    places = [int(np.abs(points - vertex).sum(axis=1).argmin()) for vertex in hull.vertices]
    return np.array(places)[hull.faces]


def test_a_fan_ends_where_an_edge_has_one_face_or_three() -> None:
    def fans(mesh: Mesh) -> np.ndarray:
        closed = closed_surfaces(mesh)
        return find_fans(closed.twins, closed.vertices.reshape(-1))

    assert len(np.unique(fans(BALL))) == len(BALL.vertices)
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1]], dtype=np.float64)
    two, three = np.array([[0, 1, 2], [1, 0, 3]]), np.array([[0, 1, 2], [1, 0, 3], [0, 1, 4]])
    assert fans(Mesh(corners, two))[0, 0] == fans(Mesh(corners, two))[1, 1]
    assert len(np.unique(fans(Mesh(corners, three)))) == 9


def test_meshes_with_too_many_pairs_have_no_clear_faces(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("zbuf_occlude.solids.clear.MOST_COMPARED", 10)
    _, found = clearance(BALL)
    assert not found.clear.any()
    assert len(found.barriers.radii) == 0
