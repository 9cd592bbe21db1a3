"""`blocks`, the definition: closed forms, rational arithmetic, and properties that must hold to the last bit."""

from fractions import Fraction
from typing import Any

import numba
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from tests.rational import exact, sees
from tests.rational import meeting as rational_meeting
from zbuf_occlude import Mesh
from zbuf_occlude.geometry.determinants import CLEAR, determinant, low_part
from zbuf_occlude.geometry.predicates import blocks, compare_hits, filtered_hit, ray_triangle_t

Vector = tuple[float, float, float]

# a triangle in the plane z = 1, seen from the origin along +z
TRIANGLE: tuple[Vector, Vector, Vector] = ((-1.0, -1.0, 1.0), (1.0, -1.0, 1.0), (0.0, 1.0, 1.0))
EYE: Vector = (0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("point", "expected"),
    [
        ((0.0, 0.0, 2.0), True),  # through the middle
        ((0.0, 0.0, 0.5), False),  # the face is behind the point
        ((0.0, 0.0, -2.0), False),  # the face is behind the eye
        ((3.0, 0.0, 2.0), False),  # past it
        ((0.0, -2.0, 2.0), True),  # through the edge y = -1
        ((0.0, 2.0, 2.0), True),  # through the corner c
        ((0.0, 2.0 + 1e-9, 2.0), False),  # just past the corner
    ],
)
def test_closed_triangle_and_open_segment(point: Vector, expected: bool) -> None:
    a, b, c = TRIANGLE
    for corners in ((a, b, c), (b, c, a), (c, a, b), (a, c, b), (c, b, a), (b, a, c)):  # winding carries no meaning
        assert blocks(EYE, point, *corners, 1e-5) is expected


def test_a_line_within_the_plane_is_not_blocked() -> None:
    a, b, c = (0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)
    assert not blocks((-1.0, 0.25, 0.0), (2.0, 0.25, 0.0), a, b, c, 1e-5)
    assert blocks((-1.0, 0.25, 1.0), (1.5, 0.25, -1.0), a, b, c, 1e-5)  # tilted, it meets the face


def test_contact_is_a_distance_along_the_line_from_the_point() -> None:
    direction = np.array([0.6, 0.0, 0.8])  # meets z = 1 at (0.75, 0, 1), a distance 1.25 from the eye
    a, b, c = (-9.0, -9.0, 1.0), (9.0, -9.0, 1.0), (0.0, 9.0, 1.0)
    for behind, expected in ((0.0099, False), (0.0101, True)):
        point = tuple(direction * (1.25 + behind))
        assert blocks(EYE, point, a, b, c, 0.01) is expected


def test_a_face_through_the_eye_does_not_block() -> None:
    a, b, c = (-1.0, -1.0, 0.0), (1.0, -1.0, 0.0), (0.0, 1.0, 0.0)
    assert not blocks(EYE, (0.0, 0.0, 2.0), a, b, c, 1e-5)  # the segment is open at the eye


def test_no_area_blocks_nothing() -> None:
    a = (0.0, 0.0, 1.0)
    assert not blocks(EYE, (0.0, 0.0, 2.0), a, a, a, 0.0)
    assert not blocks(EYE, (0.0, 0.0, 2.0), (-1.0, 0.0, 1.0), (1.0, 0.0, 1.0), (0.5, 0.0, 1.0), 0.0)


numbers = st.floats(-1.0, 1.0, width=64)
vectors = st.tuples(numbers, numbers, numbers)


@settings(max_examples=100)
@given(a=vectors, b=vectors, apex=vectors, other=vectors, eye=vectors, s=st.floats(0.01, 0.99))
def test_shared_edges_are_watertight(a: Vector, b: Vector, apex: Vector, other: Vector, eye: Vector, s: float) -> None:
    """Aim at a place on the edge ab, not near its ends: of its two faces, on its two sides, one at least is met."""
    b, eye = np.add(b, (0, 0, 9)), np.add(eye, (0, 9, 0))  # their plane is nearly x = 0
    apex, other = np.add(apex, (6, 0, 0)), np.subtract(other, (6, 0, 0))
    direction = a + s * np.subtract(b, a) - eye
    far = tuple(eye + 2.0 * direction)
    assert blocks(eye, far, a, b, apex, 0.0) or blocks(eye, far, b, a, other, 0.0)


def blocks_exactly(eye: Vector, point: Vector, *corners: Vector) -> bool:
    """The definition in rational arithmetic, contact 0."""
    return not sees(Mesh(corners, [[0, 1, 2]]), np.array(eye), np.array(point), -1, 0.0)


small = st.integers(-3, 3).map(float)
grid_points = st.tuples(small, small, small)


@settings(max_examples=200)
@given(eye=grid_points, point=grid_points, a=grid_points, b=grid_points, c=grid_points)
def test_equals_rational_arithmetic_on_small_integers(
    eye: Vector, point: Vector, a: Vector, b: Vector, c: Vector
) -> None:
    # every product of small integers is exact in float64, but the quotient is not: a meeting point exactly at the
    # point (fraction 0) or at the eye (fraction 1) comes out exactly all the same
    assert bool(blocks(eye, point, a, b, c, 0.0)) == blocks_exactly(eye, point, a, b, c)


def test_a_far_eye_is_judged_as_well_as_a_near_one() -> None:
    """From 4e5 sizes away, by rational arithmetic: lines that pass 1e-6 inside and outside an edge."""
    rng = np.random.default_rng(0)
    wrong = 0
    for _ in range(200):
        a, b, c = rng.uniform(-0.5, 0.5, (3, 3))
        eye = rng.normal(size=3)
        eye *= 4e5 / np.linalg.norm(eye)
        on_edge = a + rng.uniform(0.2, 0.8) * (b - a)
        inwards = (c - on_edge) / np.linalg.norm(c - on_edge)
        for offset in (1e-6, -1e-6):
            met = on_edge + offset * inwards
            point = met + (met - eye) * (0.5 / 4e5)
            arguments = [tuple(map(float, v)) for v in (eye, point, a, b, c)]
            wrong += bool(blocks(*arguments, 0.0)) != blocks_exactly(*arguments)  # type: ignore[arg-type]
    assert wrong == 0


parts = st.floats(-1e3, 1e3, width=64).map(lambda x: x + 0.0)
tiny = st.sampled_from([0.0, 1e-17, 3e-200, 5e-324])
rows = st.tuples(st.tuples(parts, parts, parts), st.tuples(tiny, tiny, tiny))


@settings(max_examples=200)
@given(
    a=st.tuples(rows, rows, rows),
    scale=st.sampled_from([1.0, 1e-100, 1e90]),
    degree=st.integers(0, 2),
    level=st.sets(st.integers(0, 2)),
    axis=st.integers(0, 2),
)
def test_determinants_have_the_sign_of_rational_arithmetic(
    a: Any, scale: float, degree: int, level: set[int], axis: int
) -> None:
    """Rows of differences that rounding changes, some nearly parallel, some level: sign exact, size to 1e-9."""
    positions = [(np.array(p) * scale, np.array(q) * scale) for p, q in a]
    if degree:
        positions[degree] = positions[0][0] * (1.0 + 2.0**-52), positions[0][1]
    for row in level:  # as the rows of a point on a face that is parallel to two axes
        positions[row][0][axis] = positions[row][1][axis]
    arguments, exact_rows = [], []
    for begin, end in positions:
        high = begin - end
        low = low_part(tuple(begin), tuple(end), tuple(high))
        arguments += [tuple(map(float, high)), low]
        exact_rows.append([Fraction(float(x)) - Fraction(float(y)) for x, y in zip(begin, end, strict=True)])
    x, y, z = exact_rows
    truth = sum(x[i] * (y[i - 2] * z[i - 1] - y[i - 1] * z[i - 2]) for i in range(3))
    found = determinant(CLEAR, *arguments)
    assert np.sign(found) == (truth > 0) - (truth < 0)
    if 1e-300 < abs(truth) < 1e300:
        assert abs(Fraction(found) / truth - 1) < 1e-9


@numba.njit
def _filtered_hit(origin: Vector, direction: Vector, a: Vector, b: Vector, c: Vector) -> tuple[float, float]:
    return filtered_hit(origin, direction, a, b, c)  # type: ignore[no-any-return]


def test_the_filter_decides_clear_cases() -> None:
    for x, expected in ((0.0, 1.0), (0.3, 1.0), (2.0, np.inf), (-0.999, np.inf)):
        assert _filtered_hit(EYE, (x, 0.0, 1.0), *TRIANGLE)[0] == expected
    assert _filtered_hit((0.0, 0.0, 2.0), (0.0, 0.0, 1.0), *TRIANGLE)[0] == np.inf  # behind the ray
    assert np.isnan(_filtered_hit(EYE, (0.0, -1.0, 1.0), *TRIANGLE)[0])  # through an edge


@settings(max_examples=100)
@given(
    origin=vectors,
    face=st.tuples(vectors, vectors, vectors),
    other=st.tuples(vectors, vectors, vectors),
    kind=st.integers(0, 2),
)
def test_meetings_are_ordered_as_by_rational_arithmetic(origin: Vector, face: Any, other: Any, kind: int) -> None:
    """Faces anywhere, of the same corners, and with an edge in common that the ray aims at."""
    other = (other, (face[1], face[2], face[0]), (face[1], face[0], other[2]))[kind]
    direction = tuple(float(x) for x in 0.5 * (np.array(face[0]) + np.array(face[1])) - origin)
    assume(any(direction))
    met = [rational_meeting(exact(origin), exact(direction), [exact(c) for c in corners]) for corners in (face, other)]
    for corners, t in zip((face, other), met, strict=True):
        found, error = ray_triangle_t(origin, direction, *corners)
        assert np.isinf(found) == (t is None)
        assert t is None or abs(Fraction(found) - t) <= Fraction(error)
        filtered, filtered_error = _filtered_hit(origin, direction, *corners)
        assert np.isnan(filtered) or (filtered == found and (t is None or filtered_error == error))
    if None not in met:
        assert compare_hits(origin, direction, face, other) == (met[0] > met[1]) - (met[0] < met[1])
