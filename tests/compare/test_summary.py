"""From rows to advice: ranking, Pareto front, and what each line says."""

from typing import Any

import numpy as np
import pytest

from zbuf_occlude.compare import summary


def row(subject: str, case: str, wrong: float, ms: float, **more: Any) -> dict[str, Any]:
    outside = {"n": 1000, "agreement": 1.0 - wrong, "false_visible": wrong, "false_hidden": 0.0}
    return {
        "suite": "meshes",
        "case": case,
        "subject": subject,
        "method": subject.partition(":")[0],
        "options": {},
        "exact": False,
        "status": "ok",
        "n_points": 100,
        "timed": {"seconds_per_view": ms / 1e3, "n_points": 100, "build_seconds": 0.01, "peak_memory": 2**20},
        "judged": {"outside": outside, "band": 0.001, "chamfer": 0.5},
    } | more


ROWS = [
    row("right", "a", 0.0, 2.0),
    row("right", "b", 0.0, 8.0),
    row("judge", "a", 0.0, 200.0),
    row("judge", "b", 0.0, 800.0),
    row("quick:n=1", "a", 0.02, 1.0),
    row("quick:n=1", "b", 0.04, 4.0),
    row("bad", "a", 0.5, 10.0),
    row("bad", "b", 0.5, 40.0),
]


def test_standings_are_means_over_the_meshes_least_wrong_first() -> None:
    ranking = summary.standings(ROWS)
    assert [s.subject for s in ranking] == ["right", "judge", "quick:n=1", "bad"]
    quick = ranking[2]
    assert quick.wrong == pytest.approx(0.03)
    assert quick.seconds == pytest.approx(0.002), "geometric mean"
    assert (quick.n_meshes, quick.pairs, quick.memory) == (2, 2000, 2**20)


def test_what_failed_or_was_not_judged_does_not_stand() -> None:
    rows = [{"subject": "x", "status": "failed"}, {"subject": "y", "status": "ok"}]
    assert summary.standings(rows) == []


def test_times_of_fewer_points_are_scaled_up() -> None:
    short = row("slow", "a", 0.0, 1.0)
    short["timed"]["n_points"] = 25
    (one,) = summary.standings([short])
    assert one.seconds == pytest.approx(0.004)
    assert one.extrapolated


def test_front_and_advice() -> None:
    ranking = summary.standings(ROWS)
    assert summary.front(ranking) == {"right", "quick:n=1"}
    words = summary.advice(ranking)
    assert (
        words["right"]
        == "whenever the answer must be right; the next that is never wrong, `judge`, takes 100 times as long"
    )
    assert words["judge"] == "as a check of the others; `right` answers the same 100 times as fast"
    assert words["quick:n=1"] == "when 3.0 % wrong is good enough: 2.0 times as fast as `right`"
    assert words["bad"] == "not here: `right` is never wrong and is 5.0 times as fast"


def test_advice_without_anything_right() -> None:
    words = summary.advice(summary.standings(ROWS[4:]))
    assert words["quick:n=1"] == "when 3.0 % wrong is good enough: nothing errs less"
    assert words["bad"] == "not here: `quick:n=1` errs 3.0 % and is 10 times as fast"


def test_each_method_is_shown_once_unless_on_the_front() -> None:
    rows = [*ROWS, row("bad:n=2", "a", 0.6, 90.0) | {"method": "bad"}]
    assert [s.subject for s in summary.representatives(summary.standings(rows))] == [
        "right",
        "judge",
        "quick:n=1",
        "bad",
    ]


def test_an_exponent_is_found() -> None:
    x = np.array([10.0, 100.0, 1000.0])
    factor, exponent = summary.fit_power(x, 3.0 * x**1.7)
    assert (factor, exponent) == (pytest.approx(3.0), pytest.approx(1.7))


@pytest.mark.parametrize(
    ("fraction", "text"),
    [(0.0, "0 %"), (0.5, "50 %"), (0.0312, "3.1 %"), (0.00012, "0.012 %"), (1.0, "100 %"), (0.1 - 1e-17, "10 %")],
)
def test_shares_keep_two_digits(fraction: float, text: str) -> None:
    assert summary.share(fraction) == text


@pytest.mark.parametrize(
    ("seconds", "text"), [(0.00065, "0.650"), (0.0123, "12.3"), (1.5678, "1,568"), (0.0099999, "10.0")]
)
def test_milliseconds_keep_three_digits(seconds: float, text: str) -> None:
    assert summary.milliseconds(seconds) == text
