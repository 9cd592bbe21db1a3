"""`occupancy_grid`: cells' answers for their points, no hiding of one's own front, finer grids err less."""

import numpy as np
import pytest

import zbuf_occlude as zo
from tests.scenes import SQUARE, box, sphere, stacked, two_plates
from zbuf_occlude.visibility.methods import oracle

EYES = zo.views.paper100(4.0).eyes[::9]


def test_a_plate_hides_what_is_well_behind_it() -> None:
    mesh = two_plates(0.5)
    points = zo.sample_surface(mesh, n_points=2000, seed=0)
    with zo.prepare(mesh, "occupancy_grid") as occluder:
        answer = occluder.visible(points, [[0.5, 0.5, 9.0], [0.5, 0.5, -9.0]])
    upper = points.face_ids >= 2
    rim = (np.abs(points.positions[:, :2] - 0.5) > 0.46).any(axis=1)
    assert answer[0, upper].all()
    assert not answer[0, ~upper & ~rim].any()
    assert answer[1, ~upper].all()
    assert not answer[1, upper & ~rim].any()


@pytest.mark.parametrize("n", [32, 64])
def test_an_object_does_not_hide_its_own_front(n: int) -> None:
    """Convex bodies: of the points whose face is seen at more than 40 degrees, hardly one is lost."""
    for mesh in (sphere(32), box((1.0, 0.8, 0.6))):
        points = zo.sample_surface(mesh, n_points=3000, seed=0)
        towards = EYES[:, None] - points.positions
        towards /= np.linalg.norm(towards, axis=2, keepdims=True)
        front = (towards * points.normals * np.sign((points.normals * points.positions).sum(1))[:, None]).sum(
            2
        ) > np.sin(np.radians(40))
        with zo.prepare(mesh, "occupancy_grid", n=n) as occluder:
            assert occluder.visible(points, EYES)[front].mean() > 0.998


def test_a_finer_grid_errs_less() -> None:
    """Seen from above, where nothing grazes: what is left is the width of a cell around the shadow."""
    mesh = stacked(SQUARE, SQUARE * [0.5, 0.5, 1] + np.array([0.2, 0.3, 0.4]))
    points = zo.sample_surface(mesh, n_points=5000, seed=0)
    eyes = EYES[EYES[:, 2] > 3.0]
    truth = oracle.prepare(mesh).visible(points, eyes)
    wrong = []
    for n in (8, 16, 32, 64, 128):
        with zo.prepare(mesh, "occupancy_grid", n=n, n_samples=400_000) as occluder:
            wrong.append((occluder.visible(points, eyes) != truth).mean())
    assert (np.diff(wrong) < 0).all()
    assert wrong[-1] < 0.01


def test_points_of_one_cell_have_one_answer_and_lines_do_not_grow_with_points() -> None:
    mesh = sphere(16)
    few, many = (zo.sample_surface(mesh, n_points=n, seed=0) for n in (1000, 50_000))
    with zo.prepare(mesh, "occupancy_grid", n=16) as occluder:
        answer = occluder.visible(many, EYES)
        cells = np.ravel_multi_index(tuple(occluder.grid.cells_of(many.positions).T), (16, 16, 16))
        for cell in np.unique(cells)[::20]:
            same = answer[:, cells == cell]
            assert (same == same[:, :1]).all()
        assert occluder.n_lines <= occluder.grid.occupied.sum() + 5
        lines = occluder.n_lines
        occluder.visible(few, EYES)
        assert occluder.n_lines <= lines


def test_other_points_do_not_change_an_answer() -> None:
    mesh = two_plates(0.5)
    points = zo.sample_surface(mesh, n_points=500, seed=0)
    with zo.prepare(mesh, "occupancy_grid", n=24, n_samples=3000) as occluder:
        whole = occluder.visible(points, EYES)
        assert (occluder.visible(points.select(np.arange(0, 500, 7)), EYES) == whole[:, ::7]).all()


def test_free_points() -> None:
    mesh = two_plates(0.5)
    free = zo.SurfacePoints.free([[0.5, 0.5, 0.1], [0.5, 0.5, 0.9], [0.5, 0.5, -20.0], [5.0, 5.0, -20.0]])
    with zo.prepare(mesh, "occupancy_grid") as occluder:
        assert occluder.visible(free, [[0.5, 0.5, 30.0]]).tolist() == [[False, True, False, True]]


def test_an_eye_within_the_grid() -> None:
    mesh = box()
    points = zo.sample_surface(mesh, n_points=1000, seed=0)
    with zo.prepare(mesh, "occupancy_grid") as occluder:
        assert occluder.visible(points, [[0.05, 0.03, -0.02]]).mean() > 0.98
