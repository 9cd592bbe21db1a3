"""From mask to records: random subset, scale, frame, repeats."""

import numpy as np
import pytest

from zbuf_occlude import Mesh, SurfacePoints, Views, sample_surface
from zbuf_occlude.dataset.clouds import draw, fit, gather_clouds
from zbuf_occlude.dataset.plan import Recipe

SQUARE = Mesh([[10, 0, 0], [14, 0, 0], [14, 2, 0], [10, 2, 0]], [[0, 1, 2], [0, 2, 3]], name="square")
VIEWS = Views(np.radians([0.0, 90.0, 30.0]), np.radians([80.0, 45.0, 10.0]), np.array(16.0), SQUARE.centre)


@pytest.fixture
def points() -> SurfacePoints:
    return sample_surface(SQUARE, n_points=500, seed=3)


def half_mask(points: SurfacePoints) -> np.ndarray:
    """View 0 sees the left half, view 1 nothing, view 2 exactly three points."""
    mask = np.zeros((3, len(points)), dtype=bool)
    mask[0] = points.positions[:, 0] < 12
    mask[2, [5, 6, 7]] = True
    return mask


def test_draw_takes_each_point_once_when_there_are_enough() -> None:
    chosen = draw(np.arange(100, 200), 60, np.random.default_rng(0))
    assert len(set(chosen)) == 60
    assert set(chosen) <= set(range(100, 200))
    assert (np.diff(chosen) < 0).any(), "the order must be random: loaders take the first n"


def test_draw_repeats_only_when_there_are_fewer_and_drops_none() -> None:
    chosen = draw(np.array([4, 7, 9]), 10, np.random.default_rng(0))
    assert len(chosen) == 10
    assert set(chosen) == {4, 7, 9}


def test_fit_makes_the_longest_side_one() -> None:
    positions = np.array([[1.0, 2, 3], [5, 3, 3], [2, 2, 4]])
    centre, factor = fit(positions)
    scaled = (positions - centre) * factor
    assert np.ptp(scaled, axis=0).max() == pytest.approx(1.0)
    assert np.allclose(scaled.min(axis=0) + scaled.max(axis=0), 0)
    assert fit(np.ones((4, 3)))[1] == 1.0


def test_a_view_that_sees_nothing_gives_no_cloud(points: SurfacePoints) -> None:
    records = gather_clouds(points, half_mask(points), VIEWS, Recipe(sample_size=50), "square", 0)
    assert records["view_id"].tolist() == [0, 2]
    assert records["n_visible"].tolist() == [int(half_mask(points)[0].sum()), 3]


def test_centre_and_factor_lead_back_to_visible_points(points: SurfacePoints) -> None:
    record = gather_clouds(points, half_mask(points), VIEWS, Recipe(sample_size=50), "square", 0)[0]
    back = record["data"] / record["factor"] + record["centre"]
    distance = np.abs(back[:, None] - points.positions[None]).max(axis=2).min(axis=1)
    assert distance.max() < 1e-6
    assert (back[:, 0] < 12).all()
    assert np.ptp(record["data"], axis=0).max() == pytest.approx(1.0, abs=1e-6)


def test_camera_frame_puts_the_eye_at_the_origin_looking_along_minus_z(points: SurfacePoints) -> None:
    recipe = Recipe(sample_size=50, scale="mesh", frame="camera")
    record = gather_clouds(points, half_mask(points), VIEWS, recipe, "square", 0)[0]
    assert (record["data"][:, 2] < 0).all()
    world = (record["data"] - record["pose"][:3, 3]) @ record["pose"][:3, :3]
    assert np.abs(world[:, 2]).max() < 1e-5, "all points lie in the plane z = 0 of the world"
    # the pose sends the eye to the origin and the target straight ahead
    eye, target = VIEWS.eyes[0], SQUARE.centre
    assert np.allclose(record["pose"] @ [*eye, 1], [0, 0, 0, 1], atol=1e-9)
    assert np.allclose(record["pose"] @ [*target, 1], [0, 0, -16, 1], atol=1e-9)


def test_the_subset_depends_on_seed_key_variation_and_view_only(points: SurfacePoints) -> None:
    def data(**changes: object) -> bytes:
        recipe = Recipe(sample_size=50, seed=int(changes.get("seed", 0)))  # type: ignore[call-overload]
        key, variation = str(changes.get("key", "a")), int(changes.get("variation", 0))  # type: ignore[call-overload]
        return gather_clouds(points, half_mask(points), VIEWS, recipe, key, variation)["data"].tobytes()

    assert data() == data()
    assert len({data(), data(seed=1), data(key="b"), data(variation=1)}) == 4
