"""Test 3's scores against hand-made tables: the paper's TP and FP, unweighted and weighted means."""

import numpy as np
import pytest

from zbuf_occlude.errors import ArgumentError
from zbuf_occlude.paper import sydney
from zbuf_occlude.paper.study_tables import vehicle_scores

PREDICTED = ("airplane", "car", "table")
TOTALS = {"4wd": 21, "bus": 16, "car": 88, "truck": 12, "ute": 16, "van": 35}


def table(hits: dict[str, int], false_positives: int) -> np.ndarray:
    """588 scans: of each vehicle class this many labelled car, and this many of the 400 others."""
    counts = np.zeros((len(sydney.CLASSES), 3), dtype=int)
    for label, total in TOTALS.items():
        row = sydney.CLASSES.index(label)
        counts[row, 1], counts[row, 2] = hits[label], total - hits[label]
    counts[sydney.CLASSES.index("tree"), 1] = false_positives
    counts[sydney.CLASSES.index("tree"), 0] = 200 - false_positives
    counts[sydney.CLASSES.index("pole"), 2] = 200
    return counts


def test_the_papers_definition_by_hand() -> None:
    hits = {"4wd": 14, "bus": 4, "car": 78, "truck": 3, "ute": 8, "van": 35}
    scores = vehicle_scores(table(hits, 7), sydney.CLASSES, PREDICTED)
    assert sum(scores.n_scans.values()) == 188
    assert scores.n_others == 400
    assert scores.false_positives == 7
    assert scores.recall["car"] == pytest.approx(78 / 88)
    assert scores.recall["4wd"] == pytest.approx(14 / 21)
    # 4wd: TP 14, FP 7, FN 7: precision 14/21, recall 14/21, so F1 is the same 2/3
    assert scores.f1["4wd"] == pytest.approx(2 / 3)
    for label, n in TOTALS.items():
        precision, recall = hits[label] / (hits[label] + 7), hits[label] / n
        assert scores.f1[label] == pytest.approx(2 * precision * recall / (precision + recall))
    assert scores.mean_f1 == pytest.approx(sum(scores.f1.values()) / 6)
    assert scores.weighted_f1 == pytest.approx(sum(scores.f1[c] * n for c, n in TOTALS.items()) / 188)
    assert scores.weighted_f1 > scores.mean_f1, "the large classes do better here"


def test_everything_right_is_one_and_everything_car_is_not() -> None:
    right = vehicle_scores(table(TOTALS, 0), sydney.CLASSES, PREDICTED)
    assert right.mean_f1 == right.weighted_f1 == 1.0
    blind = vehicle_scores(table(TOTALS, 200), sydney.CLASSES, PREDICTED)
    assert blind.recall["bus"] == 1.0
    assert blind.f1["bus"] == pytest.approx(2 * 16 / (2 * 16 + 200)), "false positives count against each class"


def test_nothing_right_is_zero() -> None:
    scores = vehicle_scores(table(dict.fromkeys(TOTALS, 0), 0), sydney.CLASSES, PREDICTED)
    assert scores.mean_f1 == scores.weighted_f1 == 0.0


@pytest.mark.parametrize(
    ("shape", "truth", "predicted", "message"),
    [
        ((2, 3), sydney.CLASSES, PREDICTED, r"confusion must be \(14, 3\); got \(2, 3\)"),
        ((1, 3), ("bus",), PREDICTED, "must have the classes 4wd, car, truck, ute, van; it has not"),
        ((14, 1), sydney.CLASSES, ("bed",), "must have the classes car"),
        (
            (14, 3),
            sydney.CLASSES,
            PREDICTED,
            "scans of each of the six classes; it has none of 4wd, bus",
        ),
    ],
)
def test_errors(shape: tuple[int, int], truth: tuple[str, ...], predicted: tuple[str, ...], message: str) -> None:
    with pytest.raises(ArgumentError, match=message):
        vehicle_scores(np.zeros(shape, int), truth, predicted)
