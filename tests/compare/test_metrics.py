"""The measures of error against closed forms and plain loops."""

import numpy as np
import pytest

from tests.scenes import two_plates
from zbuf_occlude import sample_surface
from zbuf_occlude.compare import metrics

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
    assert metrics.as_fractions({"n": 0, "false_visible": 0, "false_hidden": 0})["agreement"] == 1.0


def test_outcomes_are_the_four() -> None:
    assert metrics.outcomes(ANSWER, TRUTH).tolist() == [
        [metrics.TRUE_VISIBLE, metrics.FALSE_VISIBLE, metrics.FALSE_HIDDEN, metrics.TRUE_HIDDEN, metrics.TRUE_VISIBLE]
    ]


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
