"""A study's tables and answers: results of trials, mean and spread over the seeds, beside the paper's numbers."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from zbuf_occlude.drawing.pages import Table
from zbuf_occlude.errors import ArgumentError
from zbuf_occlude.paper import reported, sydney
from zbuf_occlude.paper.design import (
    ALONE,
    AUGMENTATION,
    BUDGETS,
    CLOUDS,
    COUNTS,
    ELEVATION,
    EPOCHS,
    GENERATED,
    HSR,
    KINDS,
    MAIN,
    MATCHED,
    METHODS,
    ORIGINAL,
    OWN,
    REALISM,
    SCANS,
    SCENES,
    SPLIT_BY,
    UNIFORM,
    name_of_test,
    paper_name,
    printed,
)
from zbuf_occlude.paper.results import Confusion, Result, budgets_of, models_of, of, values

NONE = "–"
MUCH = 0.05
"""Five percentage points: what "loses much" is taken to mean; the paper's two models lose 7 and 36."""
CAR = "car"
WORDS = {UNIFORM: "uniform clouds", ALONE: "scans of single objects", SCENES: "scans in streets"}
COUNTED = {OWN: "their own", MATCHED: "matched"}


def percent(shares: Iterable[float | None]) -> str:
    """Write the mean of some shares in percent, and over several seeds their standard deviation."""
    known = [100.0 * share for share in shares if share is not None]
    if not known:
        return NONE
    spread = f" ± {np.std(known, ddof=1):.1f}" if len(known) > 1 else ""
    return f"{np.mean(known):.1f}{spread}"


def accuracies(results: Iterable[Result], test: str | int) -> str:
    """Write the mean accuracy of results in a test, as `percent` does."""
    return percent(result.accuracy(test) for result in results)


# ---- elevation: Table 3A -----------------------------------------------------------------------------------------


def table_3a(results: Sequence[Result]) -> Table:
    """Return Table 3A: accuracy at each elevation, the paper's and ours with both splits."""
    body = []
    for model in models_of(results, ELEVATION):
        published = reported.TABLE_3A[paper_name(model)]
        body.append([printed(model), "**paper**", *(f"{number:.1f}" for number in published)])
        for split, words in SPLIT_BY.items():
            if rows := of(results, ELEVATION, model=model, split=split):
                body.append(["", words, *(accuracies(rows, e) for e in reported.TEST_ELEVATIONS)])
    counts = {words: _clouds_in_tests(of(results, ELEVATION, split=split)) for split, words in SPLIT_BY.items()}
    note = (
        "Overall accuracy in percent; elevations in degrees. Trained at ±90, ±70, ±50 and ±20. "
        "The paper's split is by elevation alone, so that every object tested has been seen in training, from other "
        "elevations; with objects held out none has. "
        + " ".join(f"Clouds a column, {words}: {text}." for words, text in counts.items() if text)
        + " A share of 70 % has a standard error of 3 points among 200 clouds, of 5 among 80. The paper's forty "
        "classes are here only when ModelNet40 was given."
    )
    header = ["model", "split", *(f"{e:+d}".replace("+0", "0") for e in reported.TEST_ELEVATIONS)]
    title = "Table 3A of the paper: accuracy against the camera's elevation"
    return Table(title, header, body, note, texts=range(2))


def _clouds_in_tests(results: Iterable[Result], name: str | None = None) -> str:
    """Say how many clouds the tests have, or those of a name; nothing where there are none."""
    counts = [test.n_clouds for result in results for each, test in result.tests.items() if name in (None, each)]
    return "" if not counts else f"{min(counts)} to {max(counts)}" if min(counts) < max(counts) else f"{min(counts)}"


def dead_angle(results: Sequence[Result], areas: dict[str, Any] | None) -> Table:
    """Return how accuracy at 0 degrees compares with that at +-10 and over all, and the area that is seen there."""
    body = []
    for model in models_of(results, ELEVATION):
        body.append([printed(model), "**paper**", *_dip([published_curve(model)])])
        for split, words in SPLIT_BY.items():
            if curves := curves_of(results, model, split):
                body.append(["", words, *_dip(curves)])
    note = "Percentage points lost: accuracy at ±10 less that at 0; mean over all other elevations less that at 0."
    if areas:
        seen = zip(areas["planes"], areas["mean"][areas["elevations"].index(0)], strict=True)
        note += (
            " At 0 the visible part's projected area is, of its largest over all elevations, "
            f"{', '.join(f'{100 * share:.0f} % onto {plane}' for plane, share in seen)} (mean over "
            f"{areas['n_objects']} objects): the plane that the camera looks along shows its least."
        )
    header = ["model", "split", "worst elevation", "lost at 0 against ±10", "against the others"]
    return Table("The dead angle", header, body, note, texts=range(2))


def published_curve(model: str) -> dict[int, float]:
    """Return the paper's accuracy by elevation."""
    numbers = reported.TABLE_3A[paper_name(model)]
    return {e: number / 100 for e, number in zip(reported.TEST_ELEVATIONS, numbers, strict=True)}


def curves_of(results: Sequence[Result], model: str, split: str) -> list[dict[int, float]]:
    """Return accuracy by elevation for each seed that has all elevations."""
    rows = of(results, ELEVATION, model=model, split=split)
    curves = [{e: row.accuracy(e) for e in reported.TEST_ELEVATIONS} for row in rows]
    return [{e: a for e, a in curve.items() if a is not None} for curve in curves if None not in curve.values()]


def lost_at_zero(curve: dict[int, float]) -> float:
    """Return accuracy at +-10 degrees less that at 0."""
    return (curve[-10] + curve[10]) / 2 - curve[0]


def _dip(curves: Sequence[dict[int, float]]) -> list[str]:
    mean = {e: float(np.mean([curve[e] for curve in curves])) for e in curves[0]}
    far = [float(np.mean([v for e, v in curve.items() if e != 0])) - curve[0] for curve in curves]
    worst = min(mean, key=lambda e: mean[e])
    return [f"{worst:+d}°".replace("+0", "0"), percent(map(lost_at_zero, curves)), percent(far)]


# ---- augmentation: Table 3B --------------------------------------------------------------------------------------


def table_3b(results: Sequence[Result]) -> Table:
    """Return Table 3B: three training sets, three tests, the paper's numbers beside ours."""
    body = []
    mine = of(results, AUGMENTATION)
    for n_points in sorted(values(mine, "points"), reverse=True):
        for model in models_of(results, AUGMENTATION):
            first = f"{printed(model)}, {n_points:,} points"
            for training_set, kind in reported.TRAINING_SETS.items():
                rows = of(mine, AUGMENTATION, model=model, points=n_points, set=training_set)
                lines = []
                if rows and (published := _published_3b(model, n_points)):
                    points, numbers = published
                    cells = [NONE if number is None else f"{number:.1f}" for number in numbers[training_set]]
                    words = "**paper**" + (f", {points:,} points" if points != n_points else "")
                    lines.append([words, *cells, NONE, NONE])
                for budget in budgets_of(rows):
                    under = of(rows, AUGMENTATION, budget=budget)
                    scores = [score for row in under if (score := _scores(row))]
                    lines.append(
                        [
                            BUDGETS[budget],
                            accuracies(under, ORIGINAL),
                            accuracies(under, GENERATED),
                            *(percent(s.recall[label] for s in scores) for label in ("car", "4wd")),
                            percent(s.mean_f1 for s in scores),
                            percent(s.weighted_f1 for s in scores),
                        ]
                    )
                for line in lines:
                    body.append([first, f"C{training_set} {kind}", *line])
                    first = ""
    header = ["model", "trained on", "", "Test 1 (original)", "Test 2 (generated)", "Test 3: car", "4wd", "F1 of six"]
    title = "Table 3B of the paper: training on occluded clouds, complete ones, or both"
    return Table(title, [*header, "weighted"], body, _note_3b(mine), texts=range(3))


def _note_3b(results: Sequence[Result]) -> str:
    model, n_points, f1 = reported.VEHICLES_F1
    note = "Overall accuracy in percent; mean ± standard deviation over the seeds. " + " ".join(
        f"{name} has {text} clouds."
        for name, test in (("Test 1", ORIGINAL), ("Test 2", GENERATED), ("Test 3", SCANS))
        if (text := _clouds_in_tests(results, test))
    )
    if n := min((row.tests[ORIGINAL].n_clouds for row in results if ORIGINAL in row.tests), default=0):
        note += (
            " The spread is that of the seeds; which objects are tested is not in it: a share of 80 % has a standard "
            f"error of {40 / n**0.5:.0f} points among {n} objects."
        )
    if not any(SCANS in row.tests for row in results):
        note += (
            f" Test 3 is empty here: it needs the real scans of the Sydney Urban Objects dataset ({sydney.SOURCE}); "
            "unpack its archive and run the same command with `--sydney DIR`: only the test is then added."
        )
    return note + (
        " Test 3: the share of a class's scans taken for a car; F1 over the six vehicle classes, of 188 scans, "
        "false positives among the 400 others, unweighted and weighted by the classes' scans; the paper gives an "
        f"average F1 of {f1} for {printed(model)} with {n_points:,} points, and does not say of which classifier. For "
        "training on all of ModelNet40 it cites, in Test 1, VoxNet "
        f"{reported.MODELNET40_ACCURACY['voxnet']} and 3DmFV {reported.MODELNET40_ACCURACY['threedmfv']}."
    )


def _published_3b(model: str, n_points: int) -> tuple[int, Mapping[int, tuple[float | None, ...]]] | None:
    """Return points of a cloud and the four numbers by training set that the paper has nearest to a model of ours."""
    known: dict[int, Mapping[int, tuple[float | None, ...]]] = {}
    for (name, points), numbers in reported.TABLE_3B.items():
        if name == paper_name(model):
            known[points] = numbers
    if fewer := reported.TABLE_3B_FEWER.get((paper_name(model), n_points)):
        known[n_points] = {s: (None, None, *two) for s, two in fewer.items()}
    nearest = min(known, key=lambda points: abs(points - n_points), default=0)
    return (nearest, known[nearest]) if known else None


@dataclass(frozen=True)
class VehicleScores:
    """How a classifier with one class "car" does on scans of six vehicle classes (Test 3)."""

    recall: dict[str, float]  # the paper's "accuracy" of a class: the share of its scans that are labelled car
    f1: dict[str, float]
    false_positives: int  # scans of all other classes that are labelled car; the same for each of the six
    n_scans: dict[str, int]
    n_others: int

    @property
    def mean_f1(self) -> float:
        """Unweighted mean over the classes."""
        return float(np.mean(list(self.f1.values())))

    @property
    def weighted_f1(self) -> float:
        """Mean over the classes, each weighted by its number of scans."""
        return float(np.average(list(self.f1.values()), weights=[self.n_scans[label] for label in self.f1]))


def vehicle_scores(confusion: ArrayLike, truth: tuple[str, ...], predicted: tuple[str, ...]) -> VehicleScores:
    """Score a table (t, p) of scans of each true class that got each label.

    The six of `sydney.VEHICLES` must be among `truth`, "car", which all of them should get, among `predicted`.

    Paper 4.4: of a class c with n scans, TP are those labelled car; FP the scans of classes other than the six that
    are labelled car; the others of its own scans are FN = n - TP. F1 = 2 TP / (2 TP + FP + FN). "Average F1" does not
    say whether weighted; the unweighted mean is taken, the weighted one given beside it.

    Raises ArgumentError where the table has not those rows and columns, or no scan of one of the six.
    """
    counts = np.asarray(confusion)
    if counts.shape != (len(truth), len(predicted)):
        raise ArgumentError(f"confusion must be ({len(truth)}, {len(predicted)}); got {counts.shape}.")
    absent = [label for label in sydney.VEHICLES if label not in truth] + [CAR] * (CAR not in predicted)
    if absent:
        raise ArgumentError(f"confusion must have the classes {', '.join(absent)}; it has not.")
    column = counts[:, predicted.index(CAR)]
    rows = {label: truth.index(label) for label in sydney.VEHICLES}
    if empty := [label for label, row in rows.items() if not counts[row].any()]:
        raise ArgumentError(f"confusion must have scans of each of the six classes; it has none of {', '.join(empty)}.")
    others = np.setdiff1d(np.arange(len(truth)), list(rows.values()))
    false_positives = int(column[others].sum())
    totals = {label: int(counts[row].sum()) for label, row in rows.items()}
    hits = {label: int(column[row]) for label, row in rows.items()}
    recall = {label: hits[label] / n for label, n in totals.items()}
    f1 = {label: 2 * hits[label] / (hits[label] + false_positives + n) for label, n in totals.items()}  # TP + FP + n
    return VehicleScores(recall, f1, false_positives, totals, int(counts[others].sum()))


def _scores(result: Result) -> VehicleScores | None:
    scans = result.tests.get(SCANS)
    return None if scans is None else vehicle_scores(scans.counts, scans.truth, scans.predicted)


# ---- the paper's findings ----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Finding:
    """A statement of the paper: the first accuracy less the second is at least `least`."""

    text: str
    better: tuple[int, str]  # training set and test
    worse: tuple[int, str]
    least: float = 0.0


FINDINGS = (
    Finding("trained on complete shapes only (C2): lost on occluded clouds", (2, ORIGINAL), (2, GENERATED), MUCH),
    Finding("on occluded clouds C3 is better than C2", (3, GENERATED), (2, GENERATED), MUCH),
    Finding("on occluded clouds C3 is at least as good as C1", (3, GENERATED), (1, GENERATED)),
    Finding("on complete clouds C3 is at least as good as C1", (3, ORIGINAL), (1, ORIGINAL)),
    Finding("on complete clouds C3 is at least as good as C2", (3, ORIGINAL), (2, ORIGINAL)),
)


def verdict(differences: Sequence[float], least: float) -> str:
    """Say whether differences are at least `least`: yes, no, or not decided by the seeds.

    Decided is what lies farther from `least` than the standard error of the mean, estimated from two seeds or more.
    """
    if len(differences) < 2:
        return "one seed only" if differences else NONE
    away = float(np.mean(differences)) - least
    error = float(np.std(differences, ddof=1)) / len(differences) ** 0.5
    return "not decided" if abs(away) < error else "yes" if away >= 0.0 else "**no**"


def table_of_findings(results: Sequence[Result]) -> Table:
    """Return the paper's findings of 4.3 and 4.4, its differences, ours under each budget, and whether they show."""
    body = []
    mine = of(results, AUGMENTATION)
    several = len(values(mine, "points")) > 1
    budgets = budgets_of(mine)
    for finding in FINDINGS:
        text = finding.text
        for n_points in sorted(values(mine, "points"), reverse=True):
            for model in models_of(results, AUGMENTATION):
                found = [differences(mine, finding, model, n_points, budget) for budget in budgets]
                if any(found):
                    name = printed(model) + (f", {n_points:,} points" if several else "")
                    cells = [cell for each in found for cell in (percent(each), verdict(each, finding.least))]
                    body.append([text, name, _published_difference(finding, model), *cells])
                    text = ""
    heads = [cell for budget in budgets for cell in (f"here, {BUDGETS[budget]}", "shows")]
    return Table(
        "Do the paper's findings show?",
        ["the finding", "model", "the paper's difference", *heads],
        body,
        "C1 is trained on occluded clouds, C2 on complete ones, C3 on both. "
        "Percentage points; between classifiers of the same seed, mean ± standard deviation over the seeds. Shows: the "
        f"difference is at least {100 * MUCH:.0f} for the first two, at least 0 for the others; not decided: within "
        f"the standard error of the mean.{_how_often(mine)}",
        texts=(0, 1, 2 + len(heads)),
    )


def _how_often(results: Sequence[Result]) -> str:
    """Say how often each classifier was shown each cloud, and how long each was trained."""
    sentences = {
        CLOUDS: " Equal clouds shown: C2 saw each complete cloud {0:.0f} times, C3 each of its clouds {1:.0f} times.",
        EPOCHS: " Equal epochs: both saw each of their clouds {0:.0f} and {1:.0f} times, "
        "C3 {2:.1f} times as many in all.",
    }
    said = ""
    for budget, words in sentences.items():
        rows = [[row.document for row in of(results, AUGMENTATION, set=s, budget=budget)] for s in (2, 3)]
        if all(rows):
            epochs = [float(np.median([row["epochs"] for row in each])) for each in rows]
            shown = [float(np.median([row["epochs"] * row["n_training"] for row in each])) for each in rows]
            said += words.format(*epochs, shown[1] / shown[0])
    return said


def differences(results: Sequence[Result], finding: Finding, model: str, n_points: int, budget: str) -> list[float]:
    """Return a finding's difference for each seed that has both results."""
    sides = []
    for training_set, test in (finding.better, finding.worse):
        rows = of(results, AUGMENTATION, model=model, points=n_points, set=training_set, budget=budget)
        sides.append({row.facts["seed"]: row.tests[test].accuracy for row in rows if test in row.tests})
    return [sides[0][seed] - sides[1][seed] for seed in sides[0] if seed in sides[1]]


def _published_difference(finding: Finding, model: str) -> str:
    numbers = next((rows for (name, _), rows in reported.TABLE_3B.items() if name == paper_name(model)), None)
    if numbers is None:
        return NONE
    (first, test), (second, other) = finding.better, finding.worse
    place = {ORIGINAL: 0, GENERATED: 1}
    return f"{numbers[first][place[test]] - numbers[second][place[other]]:.1f}"


# ---- methods of HSR ----------------------------------------------------------------------------------------------


def by_method(results: Sequence[Result], model: str) -> dict[str, list[Result]]:
    """Return a model's results of training on the generated clouds alone, by the method that made them.

    Those of `MAIN` are training set 1 of Table 3B, with as many points and under the same budget.
    """
    found = {}
    others = [result.facts for result in of(results, HSR, model=model)]
    for method in METHODS:
        rows = of(results, HSR, model=model, method=method.label)
        if method is MAIN and others:
            same = {fact: others[0][fact] for fact in ("points", "budget")}
            rows = of(results, AUGMENTATION, model=model, set=1, **same)
        if rows:
            found[method.label] = rows
    return found


def table_methods(results: Sequence[Result], missing: dict[str, str]) -> Table:
    """Return what the method of HSR changes: trained on the clouds of one, tested on those of each."""
    tested = [method for method in METHODS if any(name_of_test(method) in result.tests for result in of(results, HSR))]
    body = []
    for model in models_of(results, HSR):
        for place, (method, rows) in enumerate(by_method(results, model).items()):
            cells = (accuracies(rows, test) for test in (ORIGINAL, *map(name_of_test, tested)))
            body.append(["" if place else printed(model), f"`{method}`", *cells])
    header = ["model", "trained on clouds by", "Test 1 (original)", *(f"Test 2 by `{m.label}`" for m in tested)]
    note = (
        "The same objects, points and views; only what counts as hidden differs. `exact` is right in every answer, "
        f"`{METHODS[-1].label}` is the paper's. Overall accuracy in percent, mean ± standard deviation over the seeds."
    )
    note += "".join(f" `{method}` could not run here: {reason}" for method, reason in missing.items())
    return Table("Does the method of hidden-surface removal matter?", header, body, note, texts=range(2))


# ---- realism -----------------------------------------------------------------------------------------------------


def table_realism(results: Sequence[Result], facts: Mapping[str, Any]) -> Table:
    """Return accuracies by what is trained and tested on; `facts` as of `RealismClouds.facts`."""
    mine = of(results, REALISM)
    real = sorted({test for result in mine for test in result.tests if test not in KINDS})
    body = []
    for model in models_of(results, REALISM):
        for count in COUNTS:
            for place, kind in enumerate(KINDS):
                rows = of(mine, REALISM, model=model, counts=count, trained_on=kind)
                cells = [accuracies(rows, test) for test in KINDS]
                for test in real:
                    found = [cars_found(row.tests[test]) for row in rows if test in row.tests]
                    cells += [percent(cars for cars, _ in found), percent(wrong for _, wrong in found)]
                if rows:
                    first = [printed(model), COUNTED[count]] if place == 0 else ["", ""]
                    body.append([*first, WORDS[kind], *cells])
    header = ["model", "points", "trained on", *(f"tested on {WORDS[kind]}" for kind in KINDS)]
    for test in real:
        name = test.partition(":")[2]
        header += [f"{name}: cars found", f"{name}: others taken for cars"]
    return Table("What a sensor does to a classifier", header, body, _note_realism(mine, facts, real), texts=range(3))


def cars_found(test: Confusion) -> tuple[float, float | None]:
    """Return the share of real cars that are taken for cars, and of the other objects; None without others."""
    column, row = test.predicted.index(CAR), test.truth.index(CAR)
    cars, others = test.counts[row], np.delete(test.counts, row, axis=0).sum(axis=0)
    return float(cars[column] / cars.sum()), float(others[column] / others.sum()) if others.any() else None


def _note_realism(results: Sequence[Result], facts: Mapping[str, Any], real: Sequence[str]) -> str:
    medians = ", ".join(f"{n:.0f} of {WORDS[kind]}" for kind, n in facts["points"].items())
    note = (
        f"Accuracy in percent, mean ± standard deviation over the seeds. All three kinds show the same "
        f"{facts['clouds']:,} views of the same {facts['objects']:,} objects, {facts['metres']:g} m long, by a "
        f"{facts['sensor']} at {facts['range'][0]:g} to {facts['range'][1]:g} m; in streets up to "
        f"{100 * facts['hidden'][1]:.0f} % is hidden by others. Views in which one of the three has fewer than "
        f"{facts['least']} points are left out. Points that differ per cloud, median: {medians}; matched: all three "
        "are thinned to the fewest of that view."
    )
    if not real:
        return note + " With `--real DIR` real objects are a fourth test: only the test is then added."
    for test in real:
        counts = next(row.tests[test].counts.sum(axis=1) for row in results if test in row.tests)
        note += f" {test.partition(':')[2]}: {counts[0]:,} cars and {counts[1:].sum():,} other objects."
    return note + (
        f" Of a real object all points in its labelled box are taken, the ground below it too, where there are "
        f"{facts['least']}; trucks and buses are left out, as neither clearly cars nor clearly none."
    )


# ---- answers -----------------------------------------------------------------------------------------------------


def answers(results: Sequence[Result]) -> list[str]:
    """Return the study's answers in a few sentences."""
    makers = {AUGMENTATION: _augmentation, HSR: _methods, ELEVATION: _elevation, REALISM: _realism}
    return [make(results) for experiment, make in makers.items() if of(results, experiment)]


def _augmentation(results: Sequence[Result]) -> str:
    mine, models = of(results, AUGMENTATION), models_of(results, AUGMENTATION)
    points, budgets = values(mine, "points")[-1], budgets_of(mine)
    text = "On occluded clouds, trained on occluded ones, on complete ones only, and on both:"
    for budget in budgets:
        parts = []
        for model in models:
            rows = of(mine, AUGMENTATION, model=model, points=points, budget=budget)
            c1, c2, c3 = (accuracies(of(rows, AUGMENTATION, set=s), GENERATED) for s in (1, 2, 3))
            parts.append(f"{printed(model)} {c1}, {c2} and {c3} %")
        text += f" ({BUDGETS[budget]}) {'; '.join(parts)}."
    finding, parts = FINDINGS[-1], []
    for model in models:
        found = {b: differences(mine, finding, model, points, b) for b in budgets}
        said = [f"{percent(each)} ({BUDGETS[b]}: {verdict(each, finding.least)})" for b, each in found.items() if each]
        if said:
            parts.append(f"{printed(model)} {', '.join(said)}, the paper {_published_difference(finding, model)}")
    return text + (f" C3 less C2 on complete clouds: {'; '.join(parts)}." if parts else "")


def _methods(results: Sequence[Result]) -> str:
    test, parts = name_of_test(MAIN), []
    for model in models_of(results, HSR):
        cells = [f"{accuracies(rows, test)} % (`{name}`)" for name, rows in by_method(results, model).items()]
        parts.append(f"{printed(model)} {', '.join(cells)}")
    return f"Tested on clouds by `{MAIN.label}`, trained on clouds by another method: " + "; ".join(parts) + "."


def _elevation(results: Sequence[Result]) -> str:
    parts = []
    for model in models_of(results, ELEVATION):
        curves = [found for split in SPLIT_BY if (found := curves_of(results, model, split))]
        lost = " and ".join(percent(map(lost_at_zero, each)) for each in curves)
        parts.append(f"{printed(model)} {lost} (the paper {percent([lost_at_zero(published_curve(model))])})")
    begin = "Percentage points lost at the elevation 0 against ±10, with the paper's split and with objects held out: "
    return begin + "; ".join(parts) + "."


def _realism(results: Sequence[Result]) -> str:
    parts = []
    for model in models_of(results, REALISM):
        own, matched = (
            ", ".join(
                accuracies(of(results, REALISM, model=model, counts=count, trained_on=kind), SCENES) for kind in KINDS
            )
            for count in COUNTS
        )
        parts.append(f"{printed(model)} {own} % (numbers of points matched: {matched} %)")
    return f"Tested on scans in streets, trained on {', '.join(WORDS.values())}: " + "; ".join(parts) + "."
