"""Random subsets: each point once, all equally likely, by seed and view alone; and clouds placed by them."""

import numpy as np
import pytest
from scipy import stats

from zbuf_occlude.dataset.clouds import fit
from zbuf_occlude.dataset.subsets import ALL, draw_visible, place
from zbuf_occlude.geometry.camera import view_matrices

SEED = np.uint64(12345)
UNLIKELY = 1e-6


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


def test_the_same_again() -> None:
    mask = np.random.default_rng(1).random(300) < 0.5
    first, second = (draw_visible(mask, 100, SEED, 9)[0] for _ in range(2))
    assert np.array_equal(first, second)


@pytest.mark.parametrize("fitted", [True, False])
@pytest.mark.parametrize("turned", [True, False])
def test_clouds_are_placed_as_said(fitted: bool, turned: bool) -> None:
    rng = np.random.default_rng(2)
    positions, face_ids = rng.normal(size=(200, 3)) + 5.0, rng.integers(0, 9, 200).astype(np.int32)
    chosen = rng.permutation(200)[:40].astype(np.int32)
    frame = view_matrices(np.array([[3.0, 4.0, 5.0]]), np.zeros(3))[0] if turned else np.eye(4)
    centre, data, ids = np.array([1.0, 2.0, 3.0]), np.empty((40, 3), np.float32), np.empty(40, np.int32)
    factor = place(positions, face_ids, chosen, frame, fitted, centre, 0.5, np.empty((40, 3)), data, ids)
    expected = positions[chosen] @ frame[:3, :3].T + frame[:3, 3]
    box = fit(expected) if fitted else (np.array([1.0, 2.0, 3.0]), 0.5)
    assert np.allclose(centre, box[0], rtol=1e-14)
    assert np.isclose(factor, box[1], rtol=1e-14)
    assert np.allclose(data, (expected - box[0]) * box[1], atol=1e-6)
    assert np.array_equal(ids, face_ids[chosen])


def test_a_single_place_has_factor_one() -> None:
    chosen, face_ids = np.zeros(5, dtype=np.int32), np.zeros(1, dtype=np.int32)
    centre, data, ids = np.zeros(3), np.empty((5, 3), np.float32), np.empty(5, np.int32)
    factor = place(np.ones((1, 3)), face_ids, chosen, np.eye(4), True, centre, 1.0, np.empty((5, 3)), data, ids)
    assert (data == 0).all()
    assert (centre == 1).all()
    assert factor == 1.0
