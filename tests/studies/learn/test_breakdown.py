"""Scores with intervals: figures by hand, coverage of a known truth by whole groups, rows by range and points."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from zbuf_occlude.studies.learn import breakdown
from zbuf_occlude.studies.learn.breakdown import Answers

CLASSES = ("bike", "car", "truck")


def answers(labels: object, predicted: object, groups: object = None, **more: object) -> Answers:
    labels, predicted = (np.asarray(each, np.int64) for each in (labels, predicted))
    m = len(labels)
    values = {"ranges": np.full(m, np.nan), "n_measured": np.zeros(m, np.int64), **more}
    return Answers(CLASSES, labels, predicted, np.arange(m) if groups is None else np.asarray(groups), **values)


def test_figures_by_hand() -> None:
    """Two bikes, one right; five cars, four right; no truck, but one is answered."""
    found = answers([0, 0, 1, 1, 1, 1, 1], [0, 1, 1, 1, 1, 1, 2])
    scores = found.scores()
    assert scores["accuracy"].value == pytest.approx(5 / 7)
    assert scores["recall"].value == pytest.approx((1 / 2 + 4 / 5) / 2)
    assert scores["f1"].value == pytest.approx((2 / 3 + 8 / 10 + 0) / 3), "a class that was answered counts"
    assert found.confusion.counts.tolist() == [[1, 1, 0], [0, 4, 1], [0, 0, 0]]


def test_an_interval_covers_the_truth_as_often_as_it_says(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each sweep of ten clouds has its own chance to be right; the mean chance is the truth."""
    monkeypatch.setattr(breakdown, "DRAWS", 300)
    rng = np.random.default_rng(5)
    truth, covered, naive = 0.7, 0, 0
    for _ in range(120):
        chances = rng.beta(3.5, 1.5, 40)
        right = (rng.random((40, 10)) < chances[:, None]).ravel()
        groups = np.repeat(np.arange(40), 10)
        labels = np.ones(400, int)
        score = answers(labels, np.where(right, 1, 0), groups).scores()["accuracy"]
        covered += score.low <= truth <= score.high
        score = answers(labels, np.where(right, 1, 0)).scores()["accuracy"]
        naive += score.low <= truth <= score.high
    assert 0.87 <= covered / 120 <= 0.99
    assert naive / 120 < covered / 120 - 0.05, "single clouds are not independent"


def test_rows_have_the_clouds_between_their_edges() -> None:
    ranges, n_measured = np.array([5.0, 10.0, 19.9, np.nan]), np.array([31, 32, 5000, 0])
    found = answers([0, 1, 1, 1], [0, 1, 0, 1], ranges=ranges, n_measured=n_measured)
    assert [(row.low, row.high, row.n_clouds) for row in found.by_range] == [(0, 10, 1), (10, 20, 2)]
    assert [row.scores["accuracy"].value for row in found.by_range] == [1.0, 0.5]
    assert [(row.low, row.n_clouds) for row in found.by_points] == [(1, 1), (32, 1), (1024, 1)]


def test_no_error_in_few_sweeps_is_no_certainty() -> None:
    """Nine sweeps without an error: a chance of .664 still gives that in 2.5 % of cases."""
    score = answers([0, 1] * 9, [0, 1] * 9, np.repeat(np.arange(9), 2)).scores()["accuracy"]
    assert (score.value, score.high) == (1.0, 1.0)
    assert score.low**9 == pytest.approx(0.025)


def test_what_is_undefined(tmp_path: Path) -> None:
    alone = answers([1, 1], [1, 0], [7, 7]).scores()["accuracy"]
    assert alone.value == 0.5
    assert math.isnan(alone.low)
    assert str(alone) == "50.0%"
    nothing = answers([], [])
    assert str(nothing.scores()["f1"]) == "-"
    assert nothing.by_range == []
    nothing.write(tmp_path)
    document = json.loads((tmp_path / "evaluation.json").read_text())
    assert document["scores"]["accuracy"] == [None, None, None]
    assert document["n_groups"] == 0


def test_samples_without_a_class_say_nothing_of_its_recall() -> None:
    """One answer for all has a mean recall of a half by construction, also where one sweep alone has a bike."""
    found = answers([0, *[1] * 8], [1] * 9)
    assert found.scores()["recall"][:3] == (0.5, 0.5, 0.5)
