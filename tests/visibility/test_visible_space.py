"""Voxels, blockers and the graph of occlusions, against closed forms and `VisibilityQuery.visible`."""

import json

import numpy as np
import pytest

import zbuf_occlude as zo
from tests.scenes import box, soup, sphere, two_plates
from zbuf_occlude.sensors.scenes import Placed, moved
from zbuf_occlude.visibility.visible_space import FREE, HIDDEN, SURFACE

EYE = np.array([4.0, 0.3, 0.2])


def test_voxels_before_and_behind_a_box() -> None:
    """An eye on the axis: before the front side free, within and behind it hidden, by the ray's own length."""
    mesh = box((1.0, 2.0, 2.0))
    grid = zo.visibility_grid(mesh, [10.0, 0.0, 0.0], n=20)
    assert grid.step == pytest.approx(2.0 * 1.1 / 20)
    centres = grid.centres
    t = (10.0 - 0.5) / (10.0 - centres[..., 0])  # where its line meets the plane of the front side
    meets = (np.abs(t * centres[..., 1]) < 1.0) & (np.abs(t * centres[..., 2]) < 1.0)
    away = np.linalg.norm(centres - [10.0, 0.0, 0.0], axis=-1)
    assert grid.distances[0][meets] == pytest.approx(((t - 1.0) * away)[meets], abs=1e-5)
    assert grid.free[meets].tolist() == (t > 1.0)[meets].tolist()
    assert grid.free[~meets].all()
    assert (grid.states[meets & (t > 1.1)] == FREE).all()
    assert (grid.states[meets & (t < 0.95)] == HIDDEN).all()
    assert (grid.states[meets & (np.abs(t - 1.0) * away < grid.step * 0.8)] == SURFACE).all()


def test_free_voxels_are_the_visible_points_and_eyes_are_joined() -> None:
    mesh, eyes = soup(200, 0.4), np.array([EYE, -EYE])
    grid = zo.visibility_grid(mesh, eyes, n=12)
    with zo.prepare(mesh, "oracle") as oracle:
        seen = oracle.visible(zo.SurfacePoints.free(grid.centres.reshape(-1, 3)), eyes)
    assert np.array_equal(grid.free.ravel(), seen.any(axis=0))
    assert np.array_equal(grid.distances[1] > 0, zo.visibility_grid(mesh, -EYE, n=12).free)
    with pytest.raises(zo.ArgumentError, match="centre of a voxel"):
        zo.visibility_grid(box(), [0.0, 0.0, 0.0], n=1)


def test_distances_of_eyes_on_both_sides_are_fused() -> None:
    """Two eyes on the axis of a plate's middle: each knows its own side; where both know, the mean."""
    grid = zo.visibility_grid(two_plates(0.5), [[0.5, 0.5, 50.0], [0.5, 0.5, -50.0]], n=20)
    found, t = grid.tsdf(0.2), 0.2
    x, y, z = np.moveaxis(grid.centres, -1, 0)
    over = (np.abs(x - 0.5) < 0.45) & (np.abs(y - 0.5) < 0.45)
    assert found[over & (z > 0.71)] == pytest.approx(t, abs=1e-3)
    assert found[over & (z < -0.21)] == pytest.approx(t, abs=1e-3)
    between = over & (z > 0.31) & (z < 0.49)
    assert found[between] == pytest.approx((z - 0.5)[between], abs=1e-3)
    assert (found[over & (z > 0.21) & (z < 0.29)] == -np.float32(t)).all(), "behind the surface for both"
    with pytest.raises(zo.ArgumentError, match="truncation"):
        grid.tsdf(0.0)


@pytest.mark.parametrize("size", [1e-25, 1e25])
def test_distances_count_in_the_unit_of_the_mesh(size: float) -> None:
    unit, grid = (
        zo.visibility_grid(box().transformed(factor), [3.0 * factor, factor, 2.0 * factor], n=9)
        for factor in (1.0, size)
    )
    assert grid.tsdf(3 * grid.step) / size == pytest.approx(unit.tsdf(3 * unit.step), abs=1e-5)
    with pytest.raises(zo.ArgumentError, match="side must be between 1e-30 and 1e\\+30"):
        zo.visibility_grid(box().transformed(size**2), [1.0, 0.0, 0.0], n=9)


def test_a_hidden_point_has_the_nearest_face_before_it() -> None:
    mesh = two_plates()  # faces 0, 1 below 2, 3
    points = zo.sample_surface(mesh, n_points=500, seed=0)
    found = zo.blockers(mesh, points, [0.5, 0.5, 9.0])
    below = points.face_ids < 2
    assert (found[~below] == -1).all()
    with zo.prepare(mesh, "oracle") as oracle:
        assert np.array_equal(found == -1, oracle.visible(points, np.array([0.5, 0.5, 9.0])))
    assert set(found[below].tolist()) <= {-1, 2, 3}
    assert (found[below] >= 2).mean() > 0.8


def test_who_hides_whom_in_a_row_of_balls() -> None:
    """The second is twice as far and nearly twice as large, so the first hides all of it."""
    ball = sphere()
    row = [
        Placed(ball, "near"),
        Placed(ball, "far", moved(scale=1.9, to=(-10.0, 0.0, 0.0))),
        Placed(ball, "beside", moved(to=(0.0, 6.0, 0.0))),
    ]
    graph = zo.occlusion_graph(zo.Scene.joined(row), [10.0, 0.0, 0.0], n_points=4000)
    assert graph.shares[1, 0] == pytest.approx(1.0, abs=0.01)
    others = graph.shares.copy()
    others[1, 0] = 0.0
    assert not others.any()
    assert json.loads(json.dumps(graph.to_dict()))["hides"] == [
        {"object": 1, "hidden_by": 0, "share": graph.shares[1, 0]}
    ]


def test_of_what_is_never_seen_no_share_is_known() -> None:
    """The one point of a ball is behind it for more than half of the seeds."""
    scene = zo.Scene.joined([Placed(sphere(), "ball"), Placed(sphere(), "other", moved(to=(0.0, 9.0, 0.0)))])
    graphs = [zo.occlusion_graph(scene, [5.0, 0.0, 0.0], n_points=1, seed=seed) for seed in range(40)]
    shares, errors = (np.array([getattr(each, name)[0, 1] for each in graphs]) for name in ("shares", "standard_error"))
    assert 20 < np.isnan(shares).sum() < 38
    assert (np.isnan(shares) == np.isnan(errors)).all()
    assert not shares[~np.isnan(shares)].any()
    assert all(each.shares[0, 0] == 0.0 for each in graphs)
    assert not any(each.to_dict()["hides"] for each in graphs)


def test_half_a_plate_hidden_is_a_half() -> None:
    plate = zo.Mesh([[0, -1, -1], [0, 1, -1], [0, 1, 1], [0, -1, 1]], [[0, 1, 2], [0, 2, 3]])
    scene = zo.Scene.joined([Placed(plate, "back"), Placed(plate, "front", moved(scale=0.5, to=(5.0, 0.5, 0.0)))])
    graph = zo.occlusion_graph(scene, [1e6, 0.0, 0.0], n_points=20_000)
    assert graph.shares[0, 1] == pytest.approx(0.25, abs=5 * graph.standard_error[0, 1])
    assert 0 < graph.standard_error[0, 1] < 0.005
    few = zo.occlusion_graph(scene, [1e6, 0.0, 0.0], n_points=5)
    assert few.shares[1, 0] == 0.0
    assert few.standard_error[1, 0] == pytest.approx(np.sqrt(6 / (7**2 * 8))), "of Beta(1, 6)"
    with pytest.raises(zo.ArgumentError, match="must be a Scene"):
        zo.occlusion_graph(plate, [1.0, 0.0, 0.0])  # type: ignore[arg-type]
