"""From mask to records: random and farthest-point subsets, scale, frame, repeats."""

from typing import Any

import numpy as np
import pytest
from scipy import stats

from tests.scenes import box
from zbuf_occlude import Mesh, OptionError, SurfacePoints, Views, sample_surface
from zbuf_occlude.datasets.plan import DatasetConfig
from zbuf_occlude.datasets.records import (
    ALL,
    draw_points,
    draw_visible,
    farthest_points,
    gather_clouds,
    unit_box_transform,
)
from zbuf_occlude.views import ring

SEED = np.uint64(12345)
UNLIKELY = 1e-6
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
    chosen = draw_points(np.arange(100, 200), 60, np.random.default_rng(0))
    assert len(set(chosen)) == 60
    assert set(chosen) <= set(range(100, 200))
    assert (np.diff(chosen) < 0).any(), "the order must be random: loaders take the first n"


def test_draw_repeats_only_when_there_are_fewer_and_drops_none() -> None:
    chosen = draw_points(np.array([4, 7, 9]), 10, np.random.default_rng(0))
    assert len(chosen) == 10
    assert set(chosen) == {4, 7, 9}


def test_fit_makes_the_longest_side_one() -> None:
    positions = np.array([[1.0, 2, 3], [5, 3, 3], [2, 2, 4]])
    centre, factor = unit_box_transform(positions)
    scaled = (positions - centre) * factor
    assert np.ptp(scaled, axis=0).max() == pytest.approx(1.0)
    assert np.allclose(scaled.min(axis=0) + scaled.max(axis=0), 0)
    assert unit_box_transform(np.ones((4, 3)))[1] == 1.0


def test_a_view_that_sees_nothing_gives_no_cloud(points: SurfacePoints) -> None:
    records = gather_clouds(points, half_mask(points), VIEWS, 1.0, DatasetConfig(sample_size=50), "square", 0)
    assert records["view_id"].tolist() == [0, 2]
    assert records["n_visible"].tolist() == [int(half_mask(points)[0].sum()), 3]


def test_centre_and_factor_lead_back_to_visible_points(points: SurfacePoints) -> None:
    record = gather_clouds(points, half_mask(points), VIEWS, 1.0, DatasetConfig(sample_size=50), "square", 0)[0]
    back = record["data"] / record["factor"] + record["centre"]
    distance = np.abs(back[:, None] - points.positions[None]).max(axis=2).min(axis=1)
    assert distance.max() < 1e-6
    assert (back[:, 0] < 12).all()
    assert np.ptp(record["data"], axis=0).max() == pytest.approx(1.0, abs=1e-6)


def test_camera_frame_puts_the_eye_at_the_origin_looking_along_minus_z(points: SurfacePoints) -> None:
    config = DatasetConfig(sample_size=50, scale="mesh", frame="camera")
    record = gather_clouds(points, half_mask(points), VIEWS, 1.0, config, "square", 0)[0]
    assert (record["data"][:, 2] < 0).all()
    world = (record["data"] - record["pose"][:3, 3]) @ record["pose"][:3, :3]
    assert np.abs(world[:, 2]).max() < 1e-5, "all points lie in the plane z = 0 of the world"
    # the pose sends the eye to the origin and the target straight ahead
    eye, target = VIEWS.eyes[0], SQUARE.centre
    assert np.allclose(record["pose"] @ [*eye, 1], [0, 0, 0, 1], atol=1e-9)
    assert np.allclose(record["pose"] @ [*target, 1], [0, 0, -16, 1], atol=1e-9)


def test_the_subset_depends_on_seed_key_variation_and_view_only(points: SurfacePoints) -> None:
    def data(**changes: object) -> bytes:
        config = DatasetConfig(sample_size=50, seed=int(changes.get("seed", 0)))  # type: ignore[call-overload]
        key, variation = str(changes.get("key", "a")), int(changes.get("variation", 0))  # type: ignore[call-overload]
        return gather_clouds(points, half_mask(points), VIEWS, 1.0, config, key, variation)["data"].tobytes()

    assert data() == data()
    assert len({data(), data(seed=1), data(key="b"), data(variation=1)}) == 4


def test_each_visible_point_once_where_there_are_enough() -> None:
    mask = np.random.default_rng(0).random(500) < 0.3
    chosen, n_visible = draw_visible(mask, 50, SEED, 0)
    assert n_visible == mask.sum()
    assert mask[chosen].all()
    assert len(set(chosen.tolist())) == 50
    assert sorted(draw_visible(mask, ALL, SEED, 0)[0]) == np.flatnonzero(mask).tolist()


def test_none_is_left_out_where_there_are_too_few() -> None:
    mask = np.zeros(90, dtype=bool)
    mask[[0, 7, 89]] = True
    chosen, n_visible = draw_visible(mask, 3000, SEED, 4)
    assert n_visible == 3
    assert set(chosen.tolist()) == {0, 7, 89}
    counts = np.unique(chosen, return_counts=True)[1]
    assert stats.chisquare(counts).pvalue > UNLIKELY
    assert set(draw_visible(mask, 4, SEED, 4)[0].tolist()) == {0, 7, 89}


@pytest.mark.parametrize("size", [1, 3, 7, 10])
def test_all_are_equally_likely_at_every_place(size: int) -> None:
    """Pairs of (place in the cloud, point) against the uniform distribution, over views and over seeds."""
    mask = np.ones(7, dtype=bool)
    for draws in (
        [draw_visible(mask, size, SEED, view)[0] for view in range(4000)],
        [draw_visible(mask, size, np.uint64(seed), 3)[0] for seed in range(4000)],
    ):
        for at_place in np.transpose(draws):
            assert stats.chisquare(np.bincount(at_place, minlength=7)).pvalue > UNLIKELY


def test_all_orders_are_equally_likely() -> None:
    mask = np.ones(4, dtype=bool)
    orders = [tuple(draw_visible(mask, 4, SEED, view)[0].tolist()) for view in range(12_000)]
    counts = np.unique(orders, axis=0, return_counts=True)[1]
    assert len(counts) == 24
    assert stats.chisquare(counts).pvalue > UNLIKELY


def test_neighbouring_views_and_seeds_have_nothing_in_common() -> None:
    mask = np.ones(10_000, dtype=bool)
    sets = [set(draw_visible(mask, 1000, SEED, view)[0].tolist()) for view in range(20)]
    sets += [set(draw_visible(mask, 1000, SEED + np.uint64(seed), 0)[0].tolist()) for seed in range(1, 20)]
    shared = [len(a & b) for i, a in enumerate(sets) for b in sets[:i]]
    assert 90 < np.mean(shared) < 110, "a tenth of a tenth"
    assert max(shared) < 160


@pytest.mark.parametrize("shift", [0.0, 1e4])
def test_each_point_is_the_farthest_from_those_before_it(shift: float) -> None:
    positions = np.random.default_rng(2).random((900, 3)) + shift
    found = farthest_points(positions, 300, np.random.default_rng(1))
    assert len(set(found.tolist())) == 300
    nearest = np.linalg.norm(positions - positions[found[0]], axis=1)
    for index in found[1:]:
        assert nearest[index] >= nearest.max() * (1 - 1e-9)
        nearest = np.minimum(nearest, np.linalg.norm(positions - positions[index], axis=1))


def test_clouds_of_farthest_points_are_spread_more_evenly_than_random_ones() -> None:
    mesh, views = box(), ring(2, elevation=17)
    points = sample_surface(mesh, n_points=4_000, seed=1)
    mask = np.ones((2, 4_000), dtype=bool)
    mask[1, 50:] = False  # fewer than asked
    closest = {}
    for subset in ("random", "fps"):
        clouds = gather_clouds(points, mask, views, 1.0, DatasetConfig(subset=subset, sample_size=200), "key", 0)
        assert set(points.face_ids[:50]) >= set(clouds[1]["face_ids"]), "points repeat, none is made up"
        cloud = clouds[0]["data"].astype(float)
        apart = np.linalg.norm(cloud[:, None] - cloud, axis=2) + np.eye(200) * 9
        closest[subset] = apart.min()
        again = gather_clouds(points, mask, views, 1.0, DatasetConfig(subset=subset, sample_size=200), "key", 0)
        assert np.array_equal(again["data"], clouds["data"])
    assert closest["fps"] > 5 * closest["random"]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"subset": "first"}, "subset must be one of random, fps; got 'first'"),
        ({"subset": "fps", "sample_size": None}, "fps must have a number of points to choose; got sample size all"),
        ({"attributes": ("colours",)}, "attribute must be one of normals, colors, boxes; got 'colours'"),
        ({"overlap": (0.7, 0.3)}, "overlap must be shares above 0 and up to 1"),
    ],
)
def test_what_no_recipe_has(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(OptionError, match=message):
        DatasetConfig(**changes)


def test_attributes_are_in_the_order_of_their_columns() -> None:
    assert DatasetConfig(attributes=("colors", "normals")).attributes == ["normals", "colors"]
