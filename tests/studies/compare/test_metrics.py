"""Measures of error against closed forms and plain loops; rankings from rows."""

from typing import Any

import numpy as np
import pytest

from tests.scenes import two_plates
from zbuf_occlude import sample_surface
from zbuf_occlude.studies.compare import metrics
from zbuf_occlude.studies.compare.comparison_report import table_by_mesh, table_of_answers

ANSWER = np.array([[True, True, False, False, True]])
TRUTH = np.array([[True, False, True, False, True]])


def test_counts_and_fractions() -> None:
    assert metrics.count_errors(ANSWER, TRUTH) == {"n": 5, "false_visible": 1, "false_hidden": 1}
    outside = np.array([[True, False, True, True, False]])
    counts = metrics.count_errors(ANSWER, TRUTH, outside)
    assert counts == {"n": 3, "false_visible": 0, "false_hidden": 1}
    assert metrics.as_fractions(counts) == {
        "n": 3,
        "agreement": pytest.approx(2 / 3),
        "false_visible": 0.0,
        "false_hidden": pytest.approx(1 / 3),
    }
    of_none = metrics.as_fractions({"n": 0, "false_visible": 0, "false_hidden": 0})
    assert of_none == {"n": 0, "agreement": None, "false_visible": None, "false_hidden": None}


def test_bins_include_their_upper_end_and_open_last() -> None:
    values = np.array([[0.0, 1.0, 1.5, 2.0, np.inf]])
    bins = metrics.count_by_bin(ANSWER, TRUTH, values, (1.0, 2.0))
    assert [(b["upto"], b["n"], b["false_visible"], b["false_hidden"]) for b in bins] == [
        (1.0, 2, 1, 0),
        (2.0, 2, 0, 1),
        (None, 1, 0, 0),
    ]
    assert len(metrics.count_by_bin(ANSWER, TRUTH, np.zeros((1, 5)), (1.0, 2.0))) == 2, "an empty open bin is left out"


def test_incidence_does_not_depend_on_the_normals_sign() -> None:
    points = sample_surface(two_plates(), n_points=20, seed=0)
    above = points.positions[0] + [0.0, 0.0, 3.0]
    aslant = points.positions[0] + [2.0, 0.0, 2.0]
    angles = metrics.incidence_degrees(points, np.array([above, aslant, points.positions[0] - [0.0, 0.0, 3.0]]))
    assert np.allclose(angles[:, 0], [0.0, 45.0, 0.0])


def test_chamfer_against_the_definition() -> None:
    rng = np.random.default_rng(1)
    positions = rng.normal(size=(700, 3))
    answer, truth = rng.random((2, 700)) < 0.6
    a, b = positions[answer], positions[truth]
    distances = np.linalg.norm(a[:, None] - b[None], axis=2)
    expected = distances.min(axis=1).mean() + distances.min(axis=0).mean()
    assert metrics.chamfer(positions, answer, truth) == pytest.approx(expected)


def test_chamfer_of_equal_and_of_empty_clouds() -> None:
    positions, some, none = np.eye(3), np.array([True, False, True]), np.zeros(3, dtype=bool)
    assert metrics.chamfer(positions, some, some) == 0.0
    assert metrics.chamfer(positions, none, none) == 0.0
    assert metrics.chamfer(positions, some, none) is None


# ---- over all meshes ------------------------------------------------------------------------------------------------


def row(subject: str, case: str, wrong: float, ms: float, **more: Any) -> dict[str, Any]:
    outside = {"n": 1000, "agreement": 1.0 - wrong, "false_visible": wrong, "false_hidden": 0.0}
    return {
        "suite": "meshes",
        "case": case,
        "subject": subject,
        "method": subject.partition(":")[0],
        "options": {},
        "status": "ok",
        "n_points": 100,
        "timed": {"seconds_per_view": ms / 1e3, "n_points": 100, "build_seconds": 0.01, "peak_memory": 2**20},
        "judged": {"outside": outside, "band": 0.001, "chamfer": 0.5},
    } | more


ROWS = [
    row("right", "a", 0.0, 2.0),
    row("right", "b", 0.0, 8.0),
    row("slow", "a", 0.0, 200.0),
    row("slow", "b", 0.0, 800.0),
    row("quick:n=1", "a", 0.02, 1.0),
    row("quick:n=1", "b", 0.04, 4.0),
    row("bad", "a", 0.5, 10.0),
    row("bad", "b", 0.5, 40.0),
]


def test_standings_are_means_over_the_meshes_least_wrong_first() -> None:
    ranking = metrics.rank_subjects(ROWS)
    assert [s.subject for s in ranking] == ["right", "slow", "quick:n=1", "bad"]
    quick = ranking[2]
    assert quick.wrong == pytest.approx(0.03)
    assert quick.seconds == pytest.approx(0.002), "geometric mean"
    assert (quick.n_meshes, quick.pairs, quick.memory) == (2, 2000, 2**20)


def test_a_mesh_without_a_pair_to_compare_makes_no_subject_right() -> None:
    """A mesh whose pairs all lie in the boundary band is in no mean, and a dash in the table."""
    band = row("quick:n=1", "c", 0.0, 1.0)
    band["judged"]["outside"] = metrics.as_fractions({"n": 0, "false_visible": 0, "false_hidden": 0})
    ranking = {one.subject: one for one in metrics.rank_subjects([*ROWS, band])}
    assert ranking["quick:n=1"].wrong == pytest.approx(0.03)
    assert metrics.rank_subjects([band]) == []
    assert metrics.format_error(band) == "–"
    cells = table_by_mesh([*ROWS, band]).rows
    assert any(cell.startswith("–") for line in cells for cell in line)


def test_times_of_fewer_points_are_scaled_up() -> None:
    short = row("slow", "a", 0.0, 1.0)
    short["timed"]["n_points"] = 25
    (one,) = metrics.rank_subjects([short])
    assert one.seconds == pytest.approx(0.004)
    assert one.extrapolated


def test_the_pareto_front_and_the_best_rival_of_the_others() -> None:
    ranking = metrics.rank_subjects(ROWS)
    assert metrics.pareto_front(ranking) == {"right", "quick:n=1"}
    rivals = {one.subject: metrics.best_rival(one, ranking) for one in ranking}
    assert {name: rival and rival.subject for name, rival in rivals.items()} == {
        "right": None,
        "slow": "right",
        "quick:n=1": None,
        "bad": "right",
    }
    table = table_of_answers(ranking)
    assert ["**`right`**", "0 %", "4.00", "–", "–"] in table.rows
    assert ["`slow`", "0 %", "400", "`right`", "100.0"] in table.rows


def test_an_exponent_is_found() -> None:
    x = np.array([10.0, 100.0, 1000.0])
    assert metrics.fit_exponent(x, 3.0 * x**1.7) == pytest.approx(1.7)


@pytest.mark.parametrize(
    ("fraction", "text"),
    [(0.0, "0 %"), (0.5, "50 %"), (0.0312, "3.1 %"), (0.00012, "0.012 %"), (1.0, "100 %"), (0.1 - 1e-17, "10 %")],
)
def test_shares_keep_two_digits(fraction: float, text: str) -> None:
    assert metrics.format_percent(fraction) == text


@pytest.mark.parametrize(
    ("seconds", "text"), [(0.00065, "0.650"), (0.0123, "12.3"), (1.5678, "1,568"), (0.0099999, "10.0")]
)
def test_milliseconds_keep_three_digits(seconds: float, text: str) -> None:
    assert metrics.format_milliseconds(seconds) == text
