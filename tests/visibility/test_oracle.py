"""The oracle: rational arithmetic on small integer meshes, closed forms, the boundary band, silhouettes."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import zbuf_occlude as zo
from tests.rational import sees
from tests.scenes import box, holed_plate_over_plate, sphere, two_plates
from zbuf_occlude.geometry.predicates import blocks
from zbuf_occlude.visibility.methods import oracle

EYES = zo.views.paper100(4.0).eyes[::9]

coordinates = st.integers(-3, 3)
places = st.tuples(coordinates, coordinates, coordinates)
triples = st.permutations(range(5)).map(lambda order: order[:3])


@settings(max_examples=300)
@given(
    vertices=st.lists(places, min_size=5, max_size=5),
    faces=st.lists(triples, min_size=1, max_size=4),
    points=st.lists(st.tuples(places, st.integers(-1, 3)), min_size=1, max_size=4),
    eyes=st.lists(places, min_size=1, max_size=3),
    contact=st.sampled_from([0.0, 0.0123, 0.0987]),  # of no diagonal a fraction that a distance could equal
)
def test_equals_rational_arithmetic_on_small_integer_meshes(
    vertices: list[tuple[int, ...]],
    faces: list[list[int]],
    points: list[tuple[tuple[int, ...], int]],
    eyes: list[tuple[int, ...]],
    contact: float,
) -> None:
    """Edges, corners, planes through the eye, eyes and points upon faces: small integers meet them all the time."""
    mesh = zo.Mesh(np.asarray(vertices, dtype=float), faces)
    assume(mesh.diagonal > 0)
    positions = np.asarray([p for p, _ in points], dtype=float)
    own = [min(face, len(faces) - 1) for _, face in points]
    reference = oracle.prepare(mesh, contact=contact)
    answer = reference.visible(zo.SurfacePoints(positions, own, positions * 0), np.asarray(eyes, dtype=float))
    for j, eye in enumerate(eyes):
        for i, point in enumerate(positions):
            assert answer[j, i] == sees(mesh, np.asarray(eye, dtype=float), point, own[i], reference.contact)


@pytest.mark.parametrize("distance", [1.2, 2.0, 4.0, 100.0])
def test_sphere_shows_its_closed_form_fraction(distance: float) -> None:
    """(1 - r/d) / 2 of the area; the polyhedron's error is that of its rings, 1/64 of the half circle."""
    mesh = sphere(64)
    centroids = zo.SurfacePoints(mesh.corners.mean(axis=1), np.arange(len(mesh.faces)), mesh.face_normals)
    eye = distance * np.array([[0.48, 0.6, 0.64]])
    visible = oracle.prepare(mesh).visible(centroids, eye)[0]
    assert abs(mesh.areas[visible].sum() / mesh.areas.sum() - (1 - 1 / distance) / 2) < 0.01
    # of a convex body exactly those faces show that the eye is in front of
    outwards = np.sign(np.einsum("fx,fx->f", mesh.face_normals, centroids.positions))
    front = outwards * np.einsum("fx,fx->f", mesh.face_normals, eye - centroids.positions) > 0
    assert (visible == front).all()


def test_box_shows_the_sides_that_face_the_eye() -> None:
    mesh = box((1.0, 0.7, 0.4))
    points = zo.sample_surface(mesh, n_points=500, seed=0)
    side = points.face_ids // 2
    half = np.array([1.0, 0.7, 0.4]) / 2
    for eye, row in zip(EYES, oracle.prepare(mesh).visible(points, EYES), strict=True):
        shows = [eye[s // 2] * (1 if s % 2 else -1) > half[s // 2] for s in range(6)]
        assert (row == np.take(shows, side)).all()
    assert oracle.prepare(mesh).visible(points, [[0.1, 0.2, 0.05], [-0.4, 0.0, 0.1]]).all()  # from within, all


def test_a_hole_shows_what_is_behind_it() -> None:
    mesh = holed_plate_over_plate()
    points = zo.sample_surface(mesh, n_points=4000, seed=2)
    eye = np.array([0.5, -0.3, 3.0])
    visible = oracle.prepare(mesh).visible(points, eye[None])[0]
    below = points.face_ids < 2
    assert visible[~below].all()
    crossing = (eye + (points.positions - eye) * ((1.0 - 3.0) / (points.positions[:, 2:] - 3.0)))[below, :2]
    in_hole = (np.abs(crossing) < 1).all(axis=1)
    assert (visible[below] == in_hole).all()  # from here the rim's outside shows nothing
    assert in_hole.sum() > 100


def test_the_band_is_where_a_hair_decides() -> None:
    mesh = two_plates(0.5)
    hair = 1e-6 * mesh.diagonal
    # seen from straight above x = 1, the upper plate's edge stands over the lower plate's points at x = 1 - offset
    offsets = np.array([-2.0, -0.5, 0.5, 2.0]) * hair
    free = zo.SurfacePoints.free(np.stack([1.0 + offsets, np.full(4, 0.5), np.full(4, -1.0)], axis=1))
    eye = np.array([[1.0, 0.5, 1.0]])  # the edge is half way to the points, and the points' ends are what moves
    reference = oracle.prepare(mesh)
    assert reference.visible(free, eye).tolist() == [[False, False, True, True]]
    assert reference.decided(free, eye).tolist() == [[True, False, False, True]]
    assert reference.decided(free, eye, width=1e-7).all()


def test_contact_is_part_of_the_band() -> None:
    for gap, expected in ((0.4e-5, True), (0.7e-5, False), (1.5e-5, False), (2.5e-5, True)):
        mesh = two_plates(gap * np.sqrt(2))
        lower = zo.SurfacePoints([[0.5, 0.25, 0.0]], [0], [[0, 0, 1]])
        assert oracle.prepare(mesh).decided(lower, [[0.5, 0.25, 3.0]]).item() is expected


def test_silhouette_distance_is_that_of_the_edge() -> None:
    mesh = two_plates(0.5)
    widths = np.geomspace(1e-4, 1e-1, 31)
    away = np.array([0.0015, -0.003, 0.01, -0.03, 0.2]) * mesh.diagonal
    points = zo.SurfacePoints.free(np.stack([1.0 + away, np.full(5, 0.5), np.full(5, -1.0)], axis=1))
    distance = oracle.prepare(mesh).silhouette_distance(points, [[1.0, 0.5, 1.0]], widths[::-1])[0]
    # the line's end moves across the line: one of the eight directions is along x
    for found, true in zip(distance[:4], np.abs(away[:4]) / mesh.diagonal, strict=True):
        assert true <= found <= true * 10**0.1 * 1.001
    assert distance[4] == np.inf


def test_silhouette_distance_on_a_ball_is_that_of_its_outline() -> None:
    """Of a finely tessellated ball as many points are near the outline as of a true one; inner edges do not count."""
    mesh = sphere(48)
    points = zo.sample_surface(mesh, n_points=800, seed=0)
    eye = np.array([1.0, 2.0, 7.0])
    towards = (points.positions - eye) / np.linalg.norm(points.positions - eye, axis=1, keepdims=True)
    to_outline = 1.0 - np.linalg.norm(np.cross(towards, eye), axis=1)  # of the line of sight
    for width in (1e-3, 4e-3):
        near = np.isfinite(oracle.prepare(mesh).silhouette_distance(points, eye[None], [width])[0])
        assert near[to_outline < 0.3 * width * mesh.diagonal].all()
        assert (to_outline < width * mesh.diagonal).mean() * 0.8 < near.mean()
        assert near.mean() < (to_outline < width * mesh.diagonal).mean() * 1.5


def test_silhouette_distance_and_band_agree() -> None:
    """At a free-standing edge both definitions are the same."""
    mesh = two_plates(0.5)
    rng = np.random.default_rng(0)
    free = zo.SurfacePoints.free(
        np.stack([rng.uniform(0.99, 1.01, 500), np.full(500, 0.5), np.full(500, -1.0)], axis=1)
    )
    eye = np.array([[1.0, 0.5, 1.0]])
    reference = oracle.prepare(mesh)
    distance = reference.silhouette_distance(free, eye, np.array([1e-3, 2e-3]))
    assert set(np.unique(distance)) == {1e-3, 2e-3, np.inf}
    assert (reference.decided(free, eye, width=1e-3) == (distance > 1e-3)).all()


def test_runs_whose_boxes_are_passed_over_hide_nothing() -> None:
    """Lines along axes, within flat boxes' planes and from far away too, against the definition asked face by face."""
    rng = np.random.default_rng(5)
    cells = np.repeat(rng.integers(-3, 4, (150, 1, 3)), 3, axis=1)
    corners = np.concatenate([cells + rng.integers(-1, 2, (150, 3, 3)), cells + rng.normal(size=(150, 3, 3))]) / 4.0
    mesh = zo.Mesh(corners.reshape(-1, 3), np.arange(900).reshape(-1, 3)).cleaned()
    far = rng.normal(size=(60, 3)) * 10.0 ** rng.uniform(4, 14, (60, 1))
    points = zo.SurfacePoints.free(np.concatenate([rng.integers(-4, 5, (60, 3)) / 4.0, rng.normal(size=(60, 3)), far]))
    eyes = np.array([[3.0, 0.0, 0.0], [0.0, 0.25, -5.0], [0.3, 0.1, 0.2], [1e4, 2e4, -3e4], [1e14, 0.0, 1.0]])
    with oracle.prepare(mesh) as occluder:
        seen, contact = occluder.visible(points, eyes), occluder.contact
    expected = [
        [
            not any(blocks(tuple(eye), tuple(p), *map(tuple, face), contact) for face in mesh.corners)
            for p in points.positions
        ]
        for eye in eyes
    ]
    assert seen.tolist() == expected


def test_a_face_in_whose_plane_a_line_ends_hides_nothing() -> None:
    """Its plane holds the line of sight to the last digit, which ends before it comes near the face."""
    face = np.array(
        [
            [-0.5791568004828695, 0.6892086707927667, 0.37467803308741093],
            [-0.6526597680189957, 0.736092880304156, 0.36339109542836207],
            [-0.6161812299881277, 0.8036071157835547, 0.4062787926223912],
        ]
    )
    point = np.array([-0.8002140298457999, 1.0117757248397987, 0.4153053816137331])
    eye = np.array([-1.2400666515352292, -0.06714663241188012, -0.21060564279371152])
    assert max(eye[0], point[0]) < face[:, 0].min() - 0.1
    assert not blocks(tuple(eye), tuple(point), *map(tuple, face), 0.0)
    aside = [[-1.3, 1.2, 0.8], [-1.3, 1.3, 0.8], [-1.3, 1.2, 0.9]]  # the line is in the box of both faces
    mesh = zo.Mesh(np.concatenate([face, aside]), [[0, 1, 2], [3, 4, 5]])
    for method in ("oracle", "exact"):
        with zo.prepare(mesh, method) as occluder:
            assert occluder.visible(zo.SurfacePoints.free(point[None]), eye[None]).all(), method
