"""What eyes see of a surface, held to closed forms and to sampled visibility."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import zbuf_occlude as zo
from tests.random_scenes import KINDS, bodies, soup
from tests.scenes import SQUARE, box, stacked, together
from zbuf_occlude import coverage, visible_faces, visible_mesh, visible_vertices
from zbuf_occlude.base.arrays import BoolArray
from zbuf_occlude.meshes.sampling import points_in_triangles

CENTRED = SQUARE - [0.5, 0.5, 0.0]
SHADE = stacked(4.0 * CENTRED, 0.5 * CENTRED + [0.0, 0.0, 1.0])
EYE = np.array([[0.0, 0.0, 3.0]])
LYING: list[list[float]] = [[0, 0, 0], [1, 0, 0], [0.5, 1, 0]]
APART = [[0, 1, 2], [3, 4, 5]]
HIDDEN = 0.75**2
"""Area of the shadow: the small square's side is 0.5, two thirds of the way from the eye to the large one."""


def test_a_shadow_is_cut_out() -> None:
    part = visible_mesh(SHADE, EYE[0])
    assert part.mesh.areas.sum() == pytest.approx(16 - HIDDEN + 0.25, rel=1e-9)
    in_shadow = np.abs(part.mesh.corners.mean(axis=1)[part.face_ids < 2, :2]).max(axis=1) < 0.375
    assert not in_shadow.any()


def test_shares_of_faces_are_those_of_the_shadow() -> None:
    found = visible_faces(SHADE, EYE)
    off = np.abs(found.fraction[0] - [1 - HIDDEN / 16, 1 - HIDDEN / 16, 1, 1])
    assert (off < 4 * found.standard_error[0]).all()
    assert (found.standard_error[0] < 0.002).all()


def test_of_a_box_three_faces_and_seven_vertices_are_seen() -> None:
    mesh, eye = box(), np.array([[9.0, 7.0, 5.0]])
    towards = mesh.corners.mean(axis=1).max(axis=1) > 0.49  # of the sides at +0.5
    assert (visible_faces(mesh, eye, n_points=100).fraction[0] == towards).all()
    assert visible_vertices(mesh, eye).shape == visible_vertices(mesh, eye[0]).shape == (1, 8)
    assert visible_vertices(mesh, eye).sum() == 7
    part = visible_mesh(mesh, eye)
    assert set(part.face_ids) == set(np.flatnonzero(towards))
    assert len(part.mesh.faces) == 6, "faces wholly seen stay whole"


def test_exact_shares_of_a_box_and_of_a_shadow() -> None:
    found = visible_faces(box(), np.array([[9.0, 7.0, 5.0]]), exactly=True)
    assert found.proved.all()
    assert not found.standard_error.any()
    assert set(found.fraction[0]) == {0.0, 1.0}
    found = visible_faces(SHADE, EYE, exactly=True)
    assert found.proved.tolist() == [[False, False, True, True]]
    assert found.fraction[0] == pytest.approx([1 - HIDDEN / 16, 1 - HIDDEN / 16, 1, 1], rel=1e-9)
    assert not visible_faces(SHADE, EYE).proved.any()
    with pytest.raises(zo.ArgumentError, match="exactly needs"):
        visible_faces(SHADE, EYE, exactly=True, method="depth_buffer")


@pytest.mark.parametrize("kind", [each for each in KINDS if each.__name__ != "duplicates"])
def test_proved_faces_are_all_seen_or_all_hidden(kind: Callable[..., zo.Mesh]) -> None:
    """By the oracle without a contact tolerance, under which copies of a face would hide each other."""
    rng = np.random.default_rng(7)
    for _ in range(2):
        mesh = kind(rng)
        eyes = mesh.centre + mesh.longest_side * rng.normal(size=(2, 3)) * rng.choice([0.4, 1.5])
        proved = visible_faces(mesh, eyes, exactly=True, n_points=0, points_per_face=1).proved
        some = np.flatnonzero(proved.any(axis=0))[:200]
        counts = np.zeros(len(mesh.faces), dtype=np.int64)
        counts[some] = 20
        places = points_in_triangles(mesh.corners, counts, rng)
        points = zo.SurfacePoints(places, np.repeat(some, 20), np.repeat(mesh.face_normals[some], 20, axis=0))
        with zo.prepare(mesh, "oracle", contact=0.0) as oracle:
            seen = oracle.visible(points, eyes).reshape(2, -1, 20)
        assert not (proved[:, some] & seen.any(axis=2) & ~seen.all(axis=2)).any()


@pytest.mark.parametrize(
    ("corners", "faces", "eye", "contact"),
    [
        ([[0, 0, 0], [3, 0, 1], [0, 3, 1], [1, 1, -1], [2, 1, -2], [1, 3, -2]], APART, 0.4, 1e-5),
        ([*LYING, [0.5, 1.3, 3.2e-5]], [[0, 1, 2], [0, 1, 3]], [0.5, 0.3, 5], 1e-5),
        ([*LYING, [1.5, -0.3, 4e-5], [0.4, 1.4, 4e-5]], [[0, 1, 2], [0, 3, 4]], [0.5, 0.3, 5], 1e-5),
        ([*LYING, [-0.5, -0.5, 2e-3], [3, -0.5, 0.35], [-0.5, 3, 0.02]], APART, [0.3, 0.3, 50], 2e-2),
    ],
    ids=["eye on a face", "folded along an edge", "folded at a corner", "contact tolerance"],
)
def test_what_is_not_proved(corners: list[list[float]], faces: list[list[int]], eye: object, contact: float) -> None:
    """Faces that are partly seen within contact tolerances of another; or any face, where the eye lies on one."""
    mesh = zo.Mesh(corners, faces)
    place = np.mean(mesh.corners[0], axis=0) if isinstance(eye, float) else np.asarray(eye, dtype=float)
    found = visible_faces(mesh, place, exactly=True, contact=contact)
    assert not found.proved[0, 1 if isinstance(eye, float) else 0]


@pytest.mark.parametrize(
    ("third", "eye"),
    [([0.5, 1e-12, 0], [0.5, 0.3, 5]), ([0.5, 1, 0], [9, 0.3, 1e-10])],
    ids=["needle", "edge-on but for rounding"],
)
def test_shares_that_rounding_would_decide_are_sampled(third: list[float], eye: list[float]) -> None:
    mesh = zo.Mesh([[0, 0, 0], [1, 0, 0], third, [0, 0, -1], [0, 1, -1], [0.1, 0.5, -2]], APART)
    found = visible_faces(mesh, eye, exactly=True)
    assert (found.standard_error[0] > 0).tolist() == [True, False]
    assert found.proved[0].tolist() == [False, bool(found.fraction[0, 1] in (0.0, 1.0))]


def test_odd_meshes_and_eyes() -> None:
    hidden = zo.Mesh(
        [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, -1], [1, 0, -1], [0.5, 0, -1], [0, 1, -1]],
        [[0, 1, 2], [3, 4, 5], [3, 4, 6]],
    )
    assert visible_mesh(hidden, [0.2, 0.2, 5]).face_ids.tolist() == [0], "a face without area is not seen"
    assert visible_faces(hidden, [0.2, 0.2, 5]).fraction.shape == (1, 3)
    flat = zo.Mesh([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2]])
    for function in (visible_faces, visible_mesh):
        with pytest.raises(zo.MeshError, match="area"):
            function(flat, [0.2, 0.2, 5])


def test_two_eyes_see_what_either_does() -> None:
    mesh = box()
    eyes = np.array([[9.0, 7.0, 5.0], [-9.0, -7.0, -5.0]])
    assert visible_mesh(mesh, eyes).mesh.areas.sum() == pytest.approx(mesh.areas.sum())
    found = coverage(mesh, eyes)
    assert found.together[-1] == 1.0
    assert found.alone.sum() == pytest.approx(1.0)


def test_a_share_of_few_points_is_not_known_without_error() -> None:
    """All or nothing seen of n points: the share's standard deviation after that is that of Beta(n + 1, 1)."""
    plate = zo.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    for n in (3, 300):
        found = coverage(plate, [0.2, 0.2, 5.0], n_points=n)
        assert found.together[0] == 1.0
        assert found.standard_error[0] == pytest.approx(np.sqrt((n + 1) / ((n + 2) ** 2 * (n + 3))))


def on_part(part: Any, points: zo.SurfacePoints) -> BoolArray:
    """Whether points (n,) lie on a piece of their face."""
    corners, found = part.mesh.corners, np.zeros(len(points), dtype=bool)
    for face in np.unique(points.face_ids):
        pieces, mine = corners[part.face_ids == face], points.face_ids == face
        edges = np.roll(pieces, -1, axis=1) - pieces
        normals = np.cross(edges[:, 0], edges[:, 1])
        away = points.positions[mine][:, None, None] - pieces
        sides = np.einsum("npki,pi->npk", np.cross(edges, away), normals)
        found[mine] = (sides >= -1e-9 * (normals**2).sum(axis=1)[:, None]).all(axis=2).any(axis=1)
    return found


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("n_eyes", [1, 2])
def test_a_point_lies_on_the_part_where_the_oracle_sees_it(kind: Callable[..., zo.Mesh], n_eyes: int) -> None:
    rng = np.random.default_rng(n_eyes)
    mesh = kind(rng)
    eyes = mesh.centre + mesh.longest_side * rng.normal(size=(n_eyes, 3)) * rng.choice([0.4, 1.5])
    points = zo.sample_surface(mesh, n_points=2_000, seed=3)
    with zo.prepare(mesh, "oracle") as oracle:
        seen = oracle.visible(points, eyes).any(axis=0)
    assert (on_part(visible_mesh(mesh, eyes), points) != seen).mean() <= 0.001, "but for the contact tolerance"


@pytest.mark.parametrize("make", [bodies, soup])
def test_far_eyes_see_what_a_parallel_projection_does(make: Callable[..., zo.Mesh]) -> None:
    mesh = make(np.random.default_rng(3))
    way = np.array([1.9, -1.1, 0.9]) * mesh.diagonal
    areas = [visible_mesh(mesh, mesh.centre + far * way).mesh.areas.sum() for far in (1e5, 1e9, 1e14)]
    assert areas == pytest.approx([areas[1]] * 3, rel=1e-4)


@pytest.mark.parametrize("make", [bodies, soup])
def test_several_eyes_see_the_union(make: Callable[..., zo.Mesh]) -> None:
    """What two eyes see has the area of what the first sees, and of what the second alone sees."""
    mesh = make(np.random.default_rng(3))
    eyes = mesh.centre + mesh.longest_side * np.array([[1.9, -1.1, 0.9], [-0.3, 1.7, -0.8]])
    both, each = visible_mesh(mesh, eyes), [visible_mesh(mesh, eye) for eye in eyes]
    points = zo.sample_surface(each[1].mesh, n_points=20_000, seed=4)
    own = zo.SurfacePoints(points.positions, each[1].face_ids[points.face_ids], points.normals)
    with zo.prepare(mesh, "oracle") as occluder:
        new = 1 - occluder.visible(own, eyes[0]).mean()
    error = each[1].mesh.areas.sum() * np.sqrt(new * (1 - new) / len(points))
    expected = each[0].mesh.areas.sum() + new * each[1].mesh.areas.sum()
    assert both.mesh.areas.sum() == pytest.approx(expected, abs=3.5 * error)


def test_a_floor_under_many_faces_is_cut_in_quarters() -> None:
    """A grid of 1,600 small squares above a floor: the shadows' area is known, and each square is seen."""
    n, height = 40, 0.5
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(n) - n / 2, np.arange(n) - n / 2))
    low = np.stack([x, y, np.full(n * n, height)], axis=1)
    squares = low[:, None] + 0.5 * np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    floor = 2.0 * n * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    vertices = np.concatenate([squares.reshape(-1, 3), floor])
    corners = np.arange(len(vertices)).reshape(-1, 4)
    mesh = zo.Mesh(vertices, corners[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3))
    eye = np.array([0.3, 0.2, 40.0])
    part = visible_mesh(mesh, eye)
    shadows = n * n * 0.25 * (eye[2] / (eye[2] - height)) ** 2
    assert part.mesh.areas.sum() == pytest.approx(n * n * 0.25 + (4.0 * n) ** 2 - shadows, rel=1e-9)


def test_a_face_seen_edge_on_is_left_out() -> None:
    mesh = zo.Mesh([*LYING, [0, 0, 1], [1, 0, 1], [0, 0, 2]], APART)
    assert visible_mesh(mesh, [0.3, -5, 0]).face_ids.tolist() == [1]
    with pytest.raises(zo.MeshError, match=r"No part of .* is visible"):
        visible_mesh(zo.Mesh(LYING, [[0, 1, 2]]), [0.3, -5, 0])


def test_hidden_meshes_and_fractions_that_are_none_are_refused() -> None:
    shell = together(box(), box((3.0, 3.0, 3.0)))
    with pytest.raises(zo.OptionError, match="contact must"):
        visible_mesh(shell, EYE[0] * 9, contact=-1.0)
    with pytest.raises(zo.MeshError, match=r"No part of .* is visible"):
        visible_mesh(shell, np.empty((0, 3)))
    part = visible_mesh(shell, EYE[0] * 9)
    assert (part.face_ids >= 12).all()
