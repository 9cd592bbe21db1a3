"""The interval of a share, against its definition and SciPy's."""

import numpy as np
import pytest
from scipy.stats import binomtest

from zbuf_occlude.datasets.counts import CONFIDENCE, QualityCounts, WorstView, interval
from zbuf_occlude.datasets.plan import PAIRS_CHECKED


@pytest.mark.parametrize(
    ("n_wrong", "n"), [(0, 1), (1, 1), (0, 64), (3, 64), (64, 64), (160, 37_000), (30_000, 37_000)]
)
def test_it_is_clopper_and_pearsons(n_wrong: int, n: int) -> None:
    expected = binomtest(n_wrong, n).proportion_ci(CONFIDENCE, method="exact")
    assert interval(n_wrong, n) == pytest.approx((expected.low, expected.high), rel=1e-9)


def test_a_dataset_is_checked_often_enough_to_bound_its_error_by_a_hundredth_of_a_percent() -> None:
    assert interval(0, PAIRS_CHECKED)[1] <= 1e-4 < interval(0, PAIRS_CHECKED - 1000)[1]


def counts_of(shares: np.ndarray, n: int, rng: np.random.Generator) -> QualityCounts:
    """Count the wrong answers of views of which these shares are wrong, each of n points, two views a mesh."""
    wrong = rng.random((len(shares), n)) < shares[:, None]
    none, numbers, place = np.zeros((2, n), dtype=bool), np.arange(2), WorstView(0.0, "mesh", 0, 0)
    parts = [QualityCounts.of_views(wrong[i : i + 2], none, numbers, place) for i in range(0, len(wrong), 2)]
    return sum(parts, QualityCounts())


def test_answers_that_err_together_widen_the_interval() -> None:
    """Views are wrong by shares from a beta distribution: 5 % in the mean, a few views far more."""
    rng, mean, n = np.random.default_rng(0), 0.05, 64
    held = np.zeros(2)
    for _ in range(300):
        counts = counts_of(rng.beta(0.5, 0.5 / mean - 0.5, 40), n, rng)
        low, high = counts.error["interval"]
        alone = interval(counts.false_visible, counts.n_checked)
        held += low <= mean <= high, alone[0] <= mean <= alone[1]
    assert held[0] / 300 > 0.9
    assert held[1] / 300 < 0.6


def test_answers_that_err_each_for_itself_do_not() -> None:
    rng = np.random.default_rng(1)
    ratios = []
    for _ in range(50):
        counts = counts_of(np.full(40, 0.05), 64, rng)
        (low, high), (least, most) = counts.error["interval"], interval(counts.false_visible, counts.n_checked)
        ratios.append((high - low) / (most - least))
    assert 1.0 <= np.median(ratios) < 1.1


def test_with_nothing_wrong_or_one_view_answers_count_as_independent() -> None:
    rng = np.random.default_rng(2)
    assert counts_of(np.zeros(40), 64, rng).error["interval"] == list(interval(0, 40 * 64))
    one = QualityCounts.of_views(*(rng.random((2, 1, 64)) < 0.1), np.array([3]), WorstView(0.0, "mesh", 0, 0))
    assert one.error["interval"] == list(interval(one.false_visible + one.false_hidden, 64))
