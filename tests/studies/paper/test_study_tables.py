"""Tables and scores of a study for hand-made results."""

from dataclasses import replace

import numpy as np
import pytest

from tests.studies.paper.hand_made import confusion, result, study_of_augmentation, study_of_elevation, study_of_methods
from zbuf_occlude.base.errors import ArgumentError
from zbuf_occlude.datasets.real.sydney import CLASSES, SOURCE
from zbuf_occlude.drawing.pages import Table
from zbuf_occlude.studies.learn.evaluation import Confusion
from zbuf_occlude.studies.paper.design import (
    AUGMENTATION,
    BUDGETS,
    CLOUDS,
    EPOCHS,
    GENERATED,
    METHODS,
    ORIGINAL,
    SCANS,
)
from zbuf_occlude.studies.paper.study_report import (
    dead_angle,
    table_3a,
    table_3b,
    table_methods,
    table_of_findings,
    table_of_trainings,
    vehicle_scores,
    verdict,
)

HERE = BUDGETS[CLOUDS]
AREAS = {
    "elevations": [-10, 0, 10],
    "planes": ["y-z", "x-z", "x-y"],
    "mean": [[0.9, 0.8, 0.5], [0.95, 0.9, 0.25], [0.9, 0.8, 0.55]],
    "n_objects": 40,
}


def line(table: Table, *begins: str) -> list[str]:
    """Return the only row with these first cells; an empty first cell repeats the one above."""
    first, found = "", []
    for row in table.rows:
        first = row[0] or first
        if [first, *row[1:]][: len(begins)] == list(begins):
            found.append(list(row))
    assert len(found) == 1, (begins, table.rows)
    return found[0]


def test_table_3a() -> None:
    table = table_3a(study_of_elevation())
    assert table.header[2:] == ["-80", "-60", "-40", "-30", "-10", "0", "+10", "+30", "+40", "+60", "+80"]
    assert line(table, "VoxNet", "**paper**")[2:5] == ["69.7", "71.1", "71.6"]
    assert line(table, "VoxNet", "by elevation, as in the paper")[6:9] == ["80.0", "60.0", "80.0"]
    assert line(table, "VoxNet", "by elevation, objects held out")[7] == "40.0"
    assert "200" in table.note


def test_the_dead_angle() -> None:
    table = dead_angle(study_of_elevation(), AREAS)
    published = line(table, "VoxNet", "**paper**")
    assert published[2] == "0°"
    assert published[3] == f"{(69.0 + 60.4) / 2 - 50.3:.1f}"
    assert line(table, "VoxNet", "by elevation, as in the paper")[2:] == ["0°", "20.0", "20.0"]
    assert "25 % onto x-y" in table.note
    assert "projected area" not in dead_angle(study_of_elevation(), None).note


def test_table_3b_without_scans() -> None:
    table = table_3b(study_of_augmentation())
    row = line(table, "VoxNet, 1,024 points", "C2 original", HERE)
    assert row[3:] == ["85.5 ± 0.7", "45.5 ± 0.7", "–", "–", "–", "–"]
    assert line(table, "VoxNet, 1,024 points", "C2 original", "**paper**, 12,000 points")[3:5] == ["82.0", "45.9"]
    assert line(table, "PointNet, 1,024 points", "C3 both", HERE)[3:5] == ["90.0", "80.0"]
    assert not [row for row in table.rows if row[0].startswith("PointNet") and "paper" in row[2]], (
        "it has none of these"
    )
    assert "Test 3 is empty:" in table.note
    assert SOURCE in table.note
    assert "--sydney DIR" in table.note
    assert "80 % has a standard error of 3 points with 200 objects" in table.note, "sqrt(0.8 x 0.2 / 200) = 0.028"


TOTALS = {"4wd": 21, "bus": 16, "car": 88, "truck": 12, "ute": 16, "van": 35}


def scans(hits: dict[str, int], false_positives: int) -> Confusion:
    """Return the confusion matrix of 588 scans: `hits` of each vehicle class, and some others, labelled car."""
    counts = np.zeros((len(CLASSES), 2), dtype=int)
    for label, total in TOTALS.items():
        counts[CLASSES.index(label)] = [total - hits[label], hits[label]]
    counts[CLASSES.index("tree")] = [400 - false_positives, false_positives]
    return Confusion(CLASSES, ("bed", "car"), counts)


def test_table_3b_with_scans() -> None:
    hits = {label: n // 2 for label, n in TOTALS.items()}
    tests = {ORIGINAL: confusion(0.9), GENERATED: confusion(0.8), SCANS: scans(hits, 20)}
    table = table_3b([result(AUGMENTATION, tests, model="voxnet", set=1, points=1024)])
    row = line(table, "VoxNet, 1,024 points", "C1 generated", HERE)
    f1 = {label: 2 * (n // 2) / (n // 2 + 20 + n) for label, n in TOTALS.items()}
    assert row[5:7] == [f"{100 * 44 / 88:.1f}", f"{100 * 10 / 21:.1f}"]
    assert row[7] == f"{100 * sum(f1.values()) / 6:.1f}"
    assert row[8] == f"{100 * sum(f1[label] * n for label, n in TOTALS.items()) / 188:.1f}"
    assert "Test 3 has 588 clouds" in table.note
    assert "empty" not in table.note


def test_scores_of_vehicles_are_the_papers_definition() -> None:
    hits = {"4wd": 14, "bus": 4, "car": 78, "truck": 3, "ute": 8, "van": 35}
    scores = vehicle_scores(scans(hits, 7))
    assert scores.n_scans == list(TOTALS.values())
    for label, n, found, f1 in zip(TOTALS, scores.n_scans, scores.recall, scores.f1, strict=True):
        precision, recall = hits[label] / (hits[label] + 7), hits[label] / n
        assert found == pytest.approx(recall)
        assert f1 == pytest.approx(2 * precision * recall / (precision + recall))
    assert vehicle_scores(scans(TOTALS, 0)).f1 == [1.0] * 6
    assert vehicle_scores(scans(dict.fromkeys(TOTALS, 0), 0)).f1 == [0.0] * 6
    blind = vehicle_scores(scans(TOTALS, 400))
    assert blind.f1[1] == pytest.approx(2 * 16 / (2 * 16 + 400)), "false positives count against each class"
    for truth, predicted in ((CLASSES, ("bed",)), (("bus",), ("car",)), (CLASSES, ("car",))):
        with pytest.raises(ArgumentError, match=r"must have scans of 4wd, bus, .*, and the label car"):
            vehicle_scores(Confusion(truth, predicted, np.zeros((len(truth), 1), int)))


def test_table_of_methods_takes_exact_from_table_3b() -> None:
    table = table_methods([*study_of_augmentation(), *study_of_methods()], {})
    assert [row[1] for row in table.rows] == [f"`{method.label}`" for method in METHODS]
    assert table.rows[0][2:4] == ["80.5 ± 0.7", "75.5 ± 0.7"], "training set 1"
    assert line(table, "VoxNet", "`occupancy_grid:n=64`")[3:] == ["71.0 ± 1.4", "61.0 ± 1.4", "66.0 ± 1.4"]
    assert (
        "`depth_buffer` could not run here: no GL" in table_methods(study_of_methods(), {"depth_buffer": "no GL"}).note
    )


@pytest.mark.parametrize(
    ("differences", "least", "said"),
    [
        ([0.1, 0.12, 0.11], 0.05, "yes"),
        ([0.01, 0.02, 0.015], 0.05, "**no**"),
        ([-0.02, 0.03, 0.0], 0.0, "not decided"),
        ([-0.04, -0.05, -0.045], 0.0, "**no**"),
        ([0.0, 0.0], 0.0, "yes"),
        ([0.2], 0.0, "one seed only"),
    ],
)
def test_whether_a_difference_shows(differences: list[float], least: float, said: str) -> None:
    assert verdict(differences, least) == said


def test_findings_are_differences_of_one_seed() -> None:
    table = table_of_findings(study_of_augmentation())
    loses = [row for row in table.rows if row[1] == "VoxNet"]
    assert loses[0][2:] == ["36.1", "40.0 ± 0.0", "yes"], "C2: 85 to 45; the paper 82.0 - 45.9"
    assert loses[1][2:] == ["33.8", "35.0 ± 0.0", "yes"], "C3 80 against C2 45"
    assert loses[2][2:] == ["3.4", "5.0 ± 0.0", "yes"]
    assert "C1 is trained on occluded clouds, C2 on complete ones, C3 on both." in table.note
    assert [row[4] for row in table.rows if row[1] == "PointNet"] == ["one seed only"] * 5


def test_both_budgets_stand_side_by_side() -> None:
    longer = [replace(row, facts={**row.facts, "budget": EPOCHS}) for row in study_of_augmentation()]
    better = {ORIGINAL: confusion(0.95), GENERATED: confusion(0.85)}
    longer = [replace(row, tests=better) if row.matches(set=3) else row for row in longer]
    rows = [*study_of_augmentation(), *longer]
    table = table_of_findings(rows)
    assert list(table.header[3:]) == ["here, equal clouds shown", "shows", "here, equal epochs", "shows"]
    complete = [row for row in table.rows if row[1] == "VoxNet"][-1]
    assert complete[2:] == ["5.5", "5.0 ± 0.0", "yes", "9.5 ± 0.7", "yes"], "C3 less C2 on complete clouds"
    trainings = table_of_trainings(rows)
    assert line(trainings, "augmentation, equal epochs, C2", "VoxNet")[3:7] == ["2", "40", "3", "120"]
    table = table_3b(rows)
    assert line(table, "VoxNet, 1,024 points", "C3 both", "equal clouds shown")[3] == "90.5 ± 0.7"
    assert line(table, "VoxNet, 1,024 points", "C3 both", "equal epochs")[3:5] == ["95.0 ± 0.0", "85.0 ± 0.0"]
    only = table_of_findings([row for row in rows if row.matches(budget=EPOCHS)])
    assert list(only.header[3:]) == ["here, equal epochs", "shows"]
    methods = table_methods([*rows, *study_of_methods()], {})
    assert methods.rows[0][2:4] == ["80.5 ± 0.7", "75.5 ± 0.7"], "of the budget that methods are compared under"
