"""The modelling kit: parts against areas, volumes and closedness that follow from geometry."""

import numpy as np
import pytest

from zbuf_occlude.shapes import curves, furniture, kit
from zbuf_occlude.shapes.draw import Draw


def area(part: kit.MeshPart) -> float:
    a, b, c = part.points[part.faces].transpose(1, 0, 2)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def is_closed(part: kit.MeshPart) -> bool:
    """Every edge, told apart by position up to rounding, is one of an even number of faces."""
    _, which = np.unique(part.points.round(9) + 0.0, axis=0, return_inverse=True)
    faces = which.reshape(-1)[part.faces]
    edges = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    return bool((np.unique(edges, axis=0, return_counts=True)[1] % 2 == 0).all())


def draw() -> Draw:
    return Draw(np.random.default_rng(5), detail=1.0)


@pytest.mark.parametrize(("steps", "n_faces"), [(1, 44), (2, 108), (4, 332)])
def test_soft_boxes_lie_between_the_box_and_its_core(steps: int, n_faces: int) -> None:
    part = kit.cuboid((-1, -1, -1), (1, 1, 1), edge=0.2, steps=steps)
    assert len(part.faces) == n_faces
    assert is_closed(part)
    assert np.abs(part.points).max() == pytest.approx(1.0)
    exact = 6 * 1.6**2 + 12 * 1.6 * 0.2 * np.pi / 2 + 4 * np.pi * 0.2**2  # of the round one
    assert exact * (0.95 if steps == 1 else 0.985) < area(part) < exact


@pytest.mark.parametrize(
    "part",
    [
        kit.cylinder(0.5, 0.0, 1.0, 12),
        kit.ellipsoid((0, 0, 0), (1, 2, 3), 16),
        kit.rod((0, 0, 0), (1, 2, 3), 0.1, 8),
        kit.bar((0, 0, 0), (0, 0, 3), 0.1, 0.2),
        kit.bar((0, 0, 0), (1, 1, 0), 0.1, 0.2, end=0.5),
        kit.prism(curves.circle(12), 0.0, 1.0),
        kit.prism(curves.rectangle(2, 1, 0.2), 0.0, 1.0, edge=0.1),
        kit.pillow((1, 1, 0.3), 9),
        kit.tube(curves.smooth([(0, 0, 0), (1, 0, 1), (2, 1, 0)], 9), 0.1, 8),
        kit.tube(np.column_stack([curves.circle(12), np.zeros(12)]), 0.1, 8, closed=True),
        kit.shell(np.stack(np.meshgrid([0.0, 1.0, 2.0], [0.0, 1.0], [0.0], indexing="ij"), axis=-1)[:, :, 0], 0.1),
    ],
)
def test_solids_are_closed(part: kit.MeshPart) -> None:
    assert is_closed(part)
    assert part.faces.dtype == np.int32
    corners = part.points[part.faces]
    assert not (corners == np.roll(corners, 1, axis=1)).all(axis=2).any(), "no face with two equal corners"


def test_areas_of_round_things() -> None:
    assert area(kit.cylinder(0.5, 0.0, 2.0, 200)) == pytest.approx(2 * np.pi * 0.5 * 2 + 2 * np.pi * 0.25, rel=1e-3)
    assert area(kit.ellipsoid((0, 0, 0), (1, 1, 1), 96)) == pytest.approx(4 * np.pi, rel=2e-3)
    assert area(kit.rod((0, 0, 0), (0, 3, 4), 0.1, 100)) == pytest.approx(2 * np.pi * 0.1 * 5 + 0.02 * np.pi, rel=1e-3)


def test_turning_follows_the_right_hand() -> None:
    point = kit.MeshPart(np.array([[1.0, 2.0, 3.0]]), np.zeros((0, 3), np.int32))
    np.testing.assert_allclose(point.turned("z", 90).points, [[-2, 1, 3]], atol=1e-15)
    np.testing.assert_allclose(point.turned("x", 90).points, [[1, -3, 2]], atol=1e-15)
    np.testing.assert_allclose(point.turned("y", 90).points, [[3, 2, -1]], atol=1e-15)
    np.testing.assert_array_equal(point.mirrored("y").at(z=1).scaled(x=2).points, [[2, -2, 4]])


def test_smooth_and_bent_curves() -> None:
    knots = np.array([(0.0, 0.0), (1.0, 2.0), (3.0, 1.0), (4.0, 0.0)])
    np.testing.assert_allclose(curves.smooth(knots, 13)[::4], knots, atol=1e-12)
    pipe = curves.bent(knots, 0.2, 4)
    np.testing.assert_array_equal(pipe[[0, -1]], knots[[0, -1]])
    reach = np.linalg.norm(pipe[:, None] - knots[None, 1:3], axis=2).min(axis=0)
    assert ((reach > 0) & (reach < 0.2)).all(), "corners are cut, but not by more than the radius"


@pytest.mark.parametrize("kind", furniture.LEG_KINDS)
def test_legs_stand_on_the_floor(kind: str) -> None:
    part = furniture.leg(draw(), kind, 0.7, 0.05)
    assert part.points[:, 2].max() == pytest.approx(0.7, abs=0.02)
    assert part.points[:, 2].min() == pytest.approx(0.0, abs=0.02)
