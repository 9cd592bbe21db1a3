"""The interval of a share, against its definition and SciPy's."""

import pytest
from scipy.stats import binomtest

from zbuf_occlude.datasets.counts import CONFIDENCE, interval
from zbuf_occlude.datasets.plan import PAIRS_CHECKED


@pytest.mark.parametrize(
    ("n_wrong", "n"), [(0, 1), (1, 1), (0, 64), (3, 64), (64, 64), (160, 37_000), (30_000, 37_000)]
)
def test_it_is_clopper_and_pearsons(n_wrong: int, n: int) -> None:
    expected = binomtest(n_wrong, n).proportion_ci(CONFIDENCE, method="exact")
    assert interval(n_wrong, n) == pytest.approx((expected.low, expected.high), rel=1e-9)


def test_a_dataset_is_checked_often_enough_to_bound_its_error_by_a_hundredth_of_a_percent() -> None:
    assert interval(0, PAIRS_CHECKED)[1] <= 1e-4 < interval(0, PAIRS_CHECKED - 1000)[1]
