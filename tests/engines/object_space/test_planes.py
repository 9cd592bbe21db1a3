"""The paper's formulas for one face and one line: planes, perpendicular planes, rounding at edges and in planes."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import zbuf_occlude as zo
from tests.scenes import SQUARE, box, soup, stacked
from zbuf_occlude.engines.object_space.exhaustive import hidden_points
from zbuf_occlude.engines.object_space.planes import FacePlanes


def hidden(mesh: zo.Mesh, positions: object, eye: object, contact: float = 1e-9, own: object = None) -> list[bool]:
    """Points against the faces; `own` face indices or none."""
    positions = np.asarray(positions, dtype=np.float64)
    labels = np.full(len(positions), -1, dtype=np.int32) if own is None else np.asarray(own, dtype=np.int32)
    face_labels = np.arange(len(mesh.faces), dtype=np.int32)[:, None]
    planes = FacePlanes.from_mesh(mesh)
    answer, _ = hidden_points(planes, face_labels, positions, labels, np.asarray(eye, dtype=np.float64), contact)
    return list(answer.tolist())


def test_planes_pass_through_their_corners_and_edges() -> None:
    mesh = soup(50)
    planes = FacePlanes.from_mesh(mesh)
    corners = mesh.corners - planes.origin
    heights = np.einsum("fx,fcx->fc", planes.planes[:, :3], corners) + planes.planes[:, 3:4]  # Eq. 2
    assert np.abs(heights).max() < 1e-15
    assert np.allclose(planes.planes[:, :3], mesh.face_normals, atol=1e-15)  # Eq. 1 and the consecutive edges agree
    values = np.einsum("fix,fcx->fic", planes.sides[..., :3], corners) + planes.sides[..., 3:]  # Eq. 10
    for i in range(3):
        ends, opposite = [i, (i + 1) % 3], (i + 2) % 3
        assert np.abs(values[:, i, ends]).max() < 1e-16
        assert (values[:, i, opposite] > 0).all()  # the third corner is inside


def test_with_equation_1s_second_edge_the_perpendicular_planes_would_be_wrong() -> None:
    """Why v2 is c - b: with v2 = c - a a point well inside gets a negative value."""
    a, b, c = np.array([0.0, 0, 0]), np.array([4.0, 0, 0]), np.array([0.0, 4, 0])
    n, inside = np.cross(b - a, c - a), np.array([1.0, 1.0, 0.0])
    assert np.dot(inside - b, np.cross(n, c - a)) > 0 > np.dot(np.array([3.0, 0.5, 0]) - b, np.cross(n, a - c))
    mesh = zo.Mesh(np.stack([a, b, c]), [[0, 1, 2]])
    planes = FacePlanes.from_mesh(mesh)
    for point, expected in (([1, 1, 0], True), ([3, 0.5, 0], True), ([3, 1.5, 0], False), ([-1, 1, 0], False)):
        values = planes.sides[0, :, :3] @ (np.asarray(point) - planes.origin) + planes.sides[0, :, 3]
        assert (values >= 0).all() == expected


@pytest.mark.parametrize(
    ("point", "expected"),
    [
        ((0.25, 0.25, -1), True),
        ((0.25, 0.25, 0.5), False),  # the face is behind the point
        ((0.25, 0.25, 3), False),  # the face and the point are on two sides of the eye
        ((2, 2, -1), False),
        ((0.5, -0.5, -1), True),  # through the edge y = 0
        ((2, -0.5, -1), True),  # through the corner (1, 0)
    ],
)
def test_a_face_is_closed_and_the_segment_open(point: tuple[float, ...], expected: bool) -> None:
    mesh = zo.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    eye = {(0.5, -0.5, -1): (0.5, 0.5, 1), (2, -0.5, -1): (0, 0.5, 1)}.get(point, (0.25, 0.25, 2))  # type: ignore[call-overload]
    assert hidden(mesh, [point], eye) == [expected]
    assert hidden(zo.Mesh(mesh.vertices, [[2, 1, 0]]), [point], eye) == [expected]  # winding carries no meaning


def test_own_face_and_contact() -> None:
    mesh = stacked(SQUARE, SQUARE + np.array([0, 0, 0.01]))
    point, eye = [[0.5, 0.25, 0.0]], [0.5, 0.25, 1.0]
    assert hidden(mesh, point, eye) == [True]
    assert hidden(mesh, point, eye, contact=0.011) == [False]
    assert hidden(mesh, [[0.5, 0.25, -1.0]], eye, own=[0]) == [True]
    below = zo.Mesh(SQUARE, [[0, 1, 2]])
    assert hidden(below, [[0.5, 0.25, -1.0]], eye, own=[0]) == [False]


angles = st.floats(-3.0, 3.0)


@settings(max_examples=200)
@given(
    axis=st.tuples(angles, angles, angles),
    at=st.floats(0.05, 0.95),
    distance=st.floats(0.5, 1000.0),
    direction=st.tuples(angles, angles),
)
def test_no_line_slips_through_the_edge_two_faces_share(
    axis: tuple[float, ...], at: float, distance: float, direction: tuple[float, ...]
) -> None:
    """A square of two faces, anywhere in space, and a line aimed at its diagonal as well as floats can."""
    mesh = stacked(SQUARE).rotated(rotation(axis))
    target = mesh.vertices[0] + at * (mesh.vertices[2] - mesh.vertices[0])
    towards = mesh.face_normals[0] + direction[0] * mesh.vertices[1] + direction[1] * mesh.vertices[3]
    towards /= np.linalg.norm(towards)
    assume(abs(towards @ mesh.face_normals[0]) > 1e-3)
    assert hidden(mesh, [target - distance * towards], target + distance * towards) == [True]


@settings(max_examples=200)
@given(axis=st.tuples(angles, angles, angles), x=st.floats(-3.0, -0.5), y=st.floats(0.1, 0.9))
def test_a_line_within_a_plane_is_not_blocked_however_it_is_tilted(axis: tuple[float, ...], x: float, y: float) -> None:
    turn = rotation(axis)
    mesh = stacked(SQUARE).rotated(turn)
    assert hidden(mesh, [turn @ [x, y, 0.0]], turn @ [2.0, 1.0 - y, 0.0]) == [False]


def test_far_from_the_worlds_origin() -> None:
    mesh = box()
    place = np.array([3e5, -2e5, 1e5])
    rng = np.random.default_rng(0)
    points, eye = rng.uniform(-1, 1, (500, 3)), np.array([1.5, 2.0, 3.0])
    assert hidden(mesh.transformed(1.0, place), points + place, eye + place) == hidden(mesh, points, eye)


def rotation(vector: tuple[float, ...]) -> np.ndarray:
    """Rodrigues: about the vector, by its length."""
    angle = float(np.linalg.norm(vector))
    if angle < 1e-9:
        return np.eye(3)
    x, y, z = np.asarray(vector) / angle
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k)
