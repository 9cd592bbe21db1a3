"""The report of a study: study.html (one self-contained file), study.md and plots, from stored results alone.

Tables have the mean over the seeds and its spread, beside the paper's numbers.
"""

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from zbuf_occlude.drawing.pages import Picture, Section, Table, as_png, verbatim, write_pages
from zbuf_occlude.drawing.pictures import GREY, canvas
from zbuf_occlude.errors import ArgumentError, DatasetError
from zbuf_occlude.learn.evaluation import Confusion
from zbuf_occlude.paper.design import (
    ALONE,
    AUGMENTATION,
    BUDGETS,
    CITATION,
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
    MODELNET40_ACCURACY,
    MOST_POINTS,
    ORIGINAL,
    OWN,
    REALISM,
    SCANS,
    SCENES,
    SPLIT_BY,
    TABLE_3A,
    TABLE_3B,
    TEST_ELEVATIONS,
    TRAINING_SETS,
    TWO_EYES,
    UNIFORM,
    VEHICLES_F1,
    described,
    name_of_test,
    paper_name,
    printed,
)
from zbuf_occlude.paper.real_scans import SOURCE, VEHICLES
from zbuf_occlude.paper.results import (
    AREAS,
    PICTURE,
    Result,
    budgets_of,
    models_of,
    of,
    read_results,
    read_study,
    values,
)

TITLE = "Classifiers of occluded clouds: the paper's experiments again"
CAPTIONS = {
    ELEVATION: (
        "Elevation of the camera",
        "Above: accuracy against the camera's elevation. Below: how much of an object is seen from there, as "
        "areas projected on three planes (Fig. 12; mean over objects, each object's largest 100 %).",
    ),
    AUGMENTATION: (
        "Training sets",
        "Test 1 and Test 2 by training set: bars are means, dots seeds, black lines the paper's numbers "
        "(of 12,000 points).",
    ),
    SCANS: (
        "Real scans",
        "The largest scans of some classes from the side, as they are used: wheels and trunks belong below.",
    ),
    HSR: ("Methods", "Trained on the clouds of one method, tested on those of each: bars are means, dots seeds."),
}
COLOURS = {"voxnet": "#0072b2", "pointnet": "#d55e00", "threedmfv": "#009e73"}
PLANE_COLOURS = ("#882255", "#cc79a7", "#56b4e9")
SET_COLOURS = {1: "#56b4e9", 2: "#d55e00", 3: "#009e73"}
NONE = "–"
MUCH = 0.05
"""Five percentage points: what "loses much" is taken to mean; the paper's two models lose 7 and 36."""
CAR = "car"
WORDS = {
    UNIFORM: "uniform clouds",
    ALONE: "scans of single objects",
    SCENES: "scans in streets",
    TWO_EYES: "scans by two eyes",
}
COUNTED = {OWN: "their own", MATCHED: "matched"}


def write_study(folder: Path) -> list[Path]:
    """Write the report of a study's folder; return the paths of study.html, study.md and the plots.

    Trains and tests nothing. The page holds everything it shows; the Markdown links the plots in its folder. Raises
    DatasetError where there is no study or no result, or a damaged file.
    """
    study, results = read_study(folder), read_results(folder)
    if not results:
        raise DatasetError(f"{folder} must hold results; it has none. Run: zbuf-occlude paper table3 --out {folder}")
    areas = read_areas(folder)

    def picture(name: str, png: bytes) -> Picture:
        return Picture(name, png, *CAPTIONS[name])

    sections: list[Section] = []
    if of(results, AUGMENTATION):
        sections += [table_of_findings(results), picture(AUGMENTATION, as_png(plot_training_sets(results)))]
        sections.append(table_3b(results))
    if study.get("scans") and (folder / PICTURE).exists():
        sections.append(picture(SCANS, (folder / PICTURE).read_bytes()))
    if of(results, HSR):
        sections += [picture(HSR, as_png(plot_methods(results))), table_methods(results, study["missing_methods"])]
    if of(results, ELEVATION):
        sections += [picture(ELEVATION, as_png(plot_elevation(results, areas))), table_3a(results)]
        sections.append(dead_angle(results, areas))
    ends = [departures(study)] if sections else []  # of the paper's experiments
    if of(results, REALISM):
        sections.append(table_realism(results, study["realism"]))
    sections += [table_of_trainings(results), *ends]
    facts = [facts_of_study(study, results)]
    return write_pages(folder, "study", TITLE, answers=answers(results), facts=facts, sections=sections)


def read_areas(folder: Path) -> dict[str, Any] | None:
    """Read the projected areas of a study; None when they have not been measured."""
    path = folder / AREAS
    if not path.exists():
        return None
    try:
        areas: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        areas["elevations"].index(0), areas["n_objects"] + 0
        shape = np.array(areas["mean"], dtype=float).shape
        if not shape == (len(areas["elevations"]), len(areas["planes"])) == (len(areas["elevations"]), 3):
            raise ValueError(f"mean has the shape {shape}")
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise DatasetError(f"{path} must hold projected areas; it is damaged ({error!r}). Delete it.") from None
    return areas


def facts_of_study(study: Mapping[str, Any], results: Sequence[Result]) -> str:
    """Return what the answers were measured on."""
    documents, size = [result.document for result in results], study["size"]
    devices, machines = (sorted({row[what] for row in documents}) for what in ("device", "machine"))
    n_classes = sorted({len(test.predicted) for result in results for test in result.tests.values()})
    chances = " or ".join(f"{100 / n:.1f} % (of {n} classes)" for n in n_classes)
    text = (
        f'The study "{size["name"]}" ({size["summary"]}) of {verbatim(study["objects"])}, begun {study["date"]}: '
        f"{len(results)} classifiers, {sum(row['seconds'] for row in documents) / 60:.0f} minutes of training on "
        f"{', '.join(devices)}; {'; '.join(machines)}. Guessing would be right in {chances}. "
        f"The paper: {CITATION}."
    )
    if scans := study.get("scans"):
        text += f" Real scans: {scans['said']}"
    if failed := study["failed_meshes"]:
        text += f" {len(failed)} mesh{'es' * (len(failed) > 1)} could not be used: {verbatim(', '.join(failed))}."
    return text


def table_of_trainings(results: Sequence[Result]) -> Table:
    """Return how the classifiers were trained."""
    kinds: list[tuple[str, dict[str, str]]] = [(AUGMENTATION, {"budget": budget}) for budget in budgets_of(results)]
    body = []
    for experiment, facts in [*kinds, (HSR, {}), (ELEVATION, {}), (REALISM, {})]:
        for model in models_of(results, experiment):
            rows = [result.document for result in of(results, experiment, model=model, **facts)]
            if rows:
                body.append(
                    [
                        ", ".join([experiment, *map(BUDGETS.__getitem__, facts.values())]),
                        printed(model),
                        f"{rows[0]['n_parameters']:,}",
                        f"{len(rows)}",
                        _range(row["n_training"] for row in rows),
                        _range(row["epochs"] for row in rows),
                        _range(row["epochs"] * row["n_training"] for row in rows),
                        f"{np.mean([row['seconds'] for row in rows]):,.1f}",
                    ]
                )
    header = ["experiment", "model", "parameters", "trained", "clouds to train on", "epochs", "clouds shown", "seconds"]
    return Table(
        "How they were trained",
        header,
        body,
        "Adam, learning rate 0.001 falling to 0, rotation about the vertical axis, scaling and jitter; the epoch with "
        "the best validation counts. Seconds: mean of a training, validation included.",
        texts=range(2),
    )


def _range(counts: Iterable[int]) -> str:
    low, high = min(found := list(counts)), max(found)
    return f"{low:,}" if low == high else f"{low:,} to {high:,}"


def departures(study: Mapping[str, Any]) -> Table:
    """Return what is done otherwise than in the paper, and where the paper does not say."""
    size = study["size"]
    points = " and ".join(f"{n:,}" for n in size["n_points"])
    objects = "200" if size["elevation_each"] is None else f"{size['elevation_each']} of each class"
    exact = f"`{METHODS[0].label}`: what a camera sees; the grid's effect is measured by itself"
    views = (
        f"{objects} × the paper's, at most {size['azimuths']} at an elevation × {size['variations']}, "
        f"{size['elevation_points']:,} points"
    )
    shares = f"{' + '.join(map(str, size['shares']))}, {size['views']}, {points}"
    seeds = f"{len(size['seeds'])} seeds ({len(size['elevation_seeds'])} for elevation)"
    models, others = (", ".join(map(described, size[what])) for what in ("models", "augmentation_models"))
    rows = [
        ["hidden surfaces", "occupancy grid, 32³ (4.2) and 64³ (4.3)", exact],
        ["objects", "of ModelNet40", study["objects"]],
        ["elevation: objects × views × samplings", "200 × 100 × 10", views],
        ["augmentation: objects of a class, views, points", "40 + 10 + 25, 25, 12,000 and 1,024", shares],
        ["runs", "one", seeds],
        ["models of 4.2", "VoxNet, PointNet, 3DmFV", models],
        ["models of 4.3", "VoxNet, 3DmFV", others],
        ["optimiser, epochs, validation in 4.2", "not said", "as in the table above; 10 % of the training clouds"],
    ]
    return Table("What is done otherwise than in the paper", ["", "the paper", "here"], rows, texts=range(3))


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


def _once(rows: Iterable[Sequence[str]], n: int = 1) -> list[list[str]]:
    """Return rows of a table, their first n cells empty where they are those of the row above."""
    shown: list[list[str]] = []
    above: Sequence[str] = ()
    for row in rows:
        shown.append(["" if row[:n] == above else cell for cell in row[:n]] + list(row[n:]))
        above = row[:n]
    return shown


def _points_and_models(results: Sequence[Result]) -> list[tuple[int, str]]:
    """Return the numbers of points of 4.3, the most first, each with its models."""
    points = sorted(values(of(results, AUGMENTATION), "points"), reverse=True)
    return list(product(points, models_of(results, AUGMENTATION)))


# ---- elevation: Table 3A -----------------------------------------------------------------------------------------


def table_3a(results: Sequence[Result]) -> Table:
    """Return Table 3A: accuracy at each elevation, the paper's and ours with both splits."""
    body = _by_split(
        results,
        lambda model: [f"{number:.1f}" for number in TABLE_3A[paper_name(model)]],
        lambda rows: [accuracies(rows, elevation) for elevation in TEST_ELEVATIONS],
    )
    counts = {words: _clouds_in_tests(of(results, ELEVATION, split=split)) for split, words in SPLIT_BY.items()}
    note = (
        "Overall accuracy in percent; elevations in degrees. Trained at ±90, ±70, ±50 and ±20. "
        "The paper's split is by elevation alone, so that every object tested has been seen in training, from other "
        "elevations; with objects held out none has. "
        + " ".join(f"Clouds a column, {words}: {text}." for words, text in counts.items() if text)
        + " A share of 70 % has a standard error of 3 points among 200 clouds, of 5 among 80. The paper's forty "
        "classes are here only when ModelNet40 was given."
    )
    header = ["model", "split", *(f"{e:+d}".replace("+0", "0") for e in TEST_ELEVATIONS)]
    title = "Table 3A of the paper: accuracy against the camera's elevation"
    return Table(title, header, body, note, texts=range(2))


def _by_split(
    results: Sequence[Result],
    published: Callable[[str], list[str]],
    measured: Callable[[Sequence[Result]], list[str]],
) -> list[list[str]]:
    """Return rows of a table: of each model the paper's cells, then those measured with each split."""
    body = []
    for model in models_of(results, ELEVATION):
        body.append([printed(model), "**paper**", *published(model)])
        for split, words in SPLIT_BY.items():
            if rows := of(results, ELEVATION, model=model, split=split):
                body.append([printed(model), words, *measured(rows)])
    return _once(body)


def _clouds_in_tests(results: Iterable[Result], name: str | None = None) -> str:
    """Say how many clouds the tests have, or those of a name; nothing where there are none."""
    counts = [test.n_clouds for result in results for each, test in result.tests.items() if name in (None, each)]
    return "" if not counts else f"{min(counts)} to {max(counts)}" if min(counts) < max(counts) else f"{min(counts)}"


def dead_angle(results: Sequence[Result], areas: dict[str, Any] | None) -> Table:
    """Return how accuracy at 0 degrees compares with that at +-10 and over all, and the area that is seen there."""
    body = _by_split(
        results, lambda model: _dip([published_curve(model)]), lambda rows: _dip([_curve(row) for row in rows])
    )
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
    numbers = TABLE_3A[paper_name(model)]
    return {e: number / 100 for e, number in zip(TEST_ELEVATIONS, numbers, strict=True)}


def _curve(result: Result) -> dict[int, float]:
    return {e: result.tests[str(e)].accuracy for e in TEST_ELEVATIONS}


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
    for (n_points, model), (training_set, kind) in product(_points_and_models(mine), TRAINING_SETS.items()):
        heads = [f"{printed(model)}, {n_points:,} points", f"C{training_set} {kind}"]
        rows = of(mine, AUGMENTATION, model=model, points=n_points, set=training_set)
        if rows and (published := _published_3b(model, n_points)):
            points, numbers = published
            cells = [NONE if np.isnan(number) else f"{number:.1f}" for number in numbers[training_set]]
            words = "**paper**" + (f", {points:,} points" if points != n_points else "")
            body.append([*heads, words, *cells, NONE, NONE])
        for budget in budgets_of(rows):
            under = of(rows, AUGMENTATION, budget=budget)
            scores = [vehicle_scores(row.tests[SCANS]) for row in under if SCANS in row.tests]
            body.append(
                [
                    *(*heads, BUDGETS[budget], accuracies(under, ORIGINAL), accuracies(under, GENERATED)),
                    *(percent(s.recall[VEHICLES.index(label)] for s in scores) for label in (CAR, "4wd")),
                    percent(float(np.mean(s.f1)) for s in scores),
                    percent(float(np.average(s.f1, weights=s.n_scans)) for s in scores),
                ]
            )
    header = ["model", "trained on", "", "Test 1 (original)", "Test 2 (generated)", "Test 3: car", "4wd", "F1 of six"]
    title = "Table 3B of the paper: training on occluded clouds, complete ones, or both"
    return Table(title, [*header, "weighted"], _once(body), _note_3b(mine), texts=range(3))


def _note_3b(results: Sequence[Result]) -> str:
    model, n_points, f1 = VEHICLES_F1
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
            f" Test 3 is empty here: it needs the real scans of the Sydney Urban Objects dataset ({SOURCE}); "
            "unpack its archive and run the same command with `--sydney DIR`: only the test is then added."
        )
    return note + (
        " Test 3: the share of a class's scans taken for a car; F1 over the six vehicle classes, of 188 scans, "
        "false positives among the 400 others, unweighted and weighted by the classes' scans; the paper gives an "
        f"average F1 of {f1} for {printed(model)} with {n_points:,} points, and does not say of which classifier. For "
        "training on all of ModelNet40 it cites, in Test 1, VoxNet "
        f"{MODELNET40_ACCURACY['voxnet']} and 3DmFV {MODELNET40_ACCURACY['threedmfv']}."
    )


def _published_3b(model: str, n_points: int) -> tuple[int, Mapping[int, tuple[float, ...]]] | None:
    """Return the paper's points of a cloud, and its four numbers by training set, that are nearest to ours."""
    points = n_points if (paper_name(model), n_points) in TABLE_3B else MOST_POINTS
    numbers = TABLE_3B.get((paper_name(model), points))
    return None if numbers is None else (points, numbers)


class VehicleScores(NamedTuple):
    """How a classifier with one class "car" does on scans of the six vehicle classes (Test 3), class by class."""

    recall: list[float]  # the paper's "accuracy" of a class: the share of its scans that are labelled car
    f1: list[float]
    n_scans: list[int]


def vehicle_scores(scans: Confusion) -> VehicleScores:
    """Score the labels of real scans, in the order of `VEHICLES`, all of which should be labelled car.

    Paper 4.4: of a class c with n scans, TP are those labelled car; FP the scans of classes other than the six that
    are labelled car; the others of its own scans are FN = n - TP. F1 = 2 TP / (2 TP + FP + FN). "Average F1" does not
    say whether weighted; the unweighted mean is taken, the weighted one also given.

    Raises ArgumentError where a class has no scan, or "car" is not among the labels.
    """
    rows = [scans.truth.index(label) for label in VEHICLES if label in scans.truth]
    totals = scans.counts[rows].sum(axis=1)
    if len(rows) < len(VEHICLES) or not totals.all() or CAR not in scans.predicted:
        raise ArgumentError(
            f"a test on scans must have scans of {', '.join(VEHICLES)}, and the label {CAR}; it has not."
        )
    labelled_car = scans.counts[:, scans.predicted.index(CAR)]
    hits = labelled_car[rows]
    false_positives = labelled_car.sum() - hits.sum()
    f1 = 2 * hits / (hits + false_positives + totals)  # TP + FP + n
    return VehicleScores((hits / totals).tolist(), f1.tolist(), totals.tolist())


# ---- the paper's findings ----------------------------------------------------------------------------------------


class Finding(NamedTuple):
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


def whether_shown(differences: Sequence[float], least: float) -> str:
    """Return whether differences are at least `least`: yes, no, or not decided by the seeds.

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
    for finding, (n_points, model) in product(FINDINGS, _points_and_models(mine)):
        found = [differences(mine, finding, model, n_points, budget) for budget in budgets]
        if any(found):
            name = printed(model) + (f", {n_points:,} points" if several else "")
            cells = [cell for each in found for cell in (percent(each), whether_shown(each, finding.least))]
            body.append([finding.text, name, _published_difference(finding, model), *cells])
    heads = [cell for budget in budgets for cell in (f"here, {BUDGETS[budget]}", "shows")]
    return Table(
        "Do the paper's findings show?",
        ["the finding", "model", "the paper's difference", *heads],
        _once(body),
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
    numbers = TABLE_3B.get((paper_name(model), MOST_POINTS))
    if numbers is None:
        return NONE
    better, worse = (numbers[s][(ORIGINAL, GENERATED).index(test)] for s, test in (finding.better, finding.worse))
    return f"{better - worse:.1f}"


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
        for method, rows in by_method(results, model).items():
            cells = (accuracies(rows, test) for test in (ORIGINAL, *map(name_of_test, tested)))
            body.append([printed(model), f"`{method}`", *cells])
    header = ["model", "trained on clouds by", "Test 1 (original)", *(f"Test 2 by `{m.label}`" for m in tested)]
    note = (
        "The same objects, points and views; only what counts as hidden differs. `exact` is right in every answer, "
        f"`{METHODS[-1].label}` is the paper's. Overall accuracy in percent, mean ± standard deviation over the seeds."
    )
    note += "".join(f" `{method}` could not run here: {reason}" for method, reason in missing.items())
    return Table("Does the method of hidden-surface removal matter?", header, _once(body), note, texts=range(2))


# ---- realism -----------------------------------------------------------------------------------------------------


def table_realism(results: Sequence[Result], facts: Mapping[str, Any]) -> Table:
    """Return accuracies by what is trained and tested on; `facts` as of `Realism.notes`."""
    mine = of(results, REALISM)
    real = sorted({test for result in mine for test in result.tests if test not in KINDS})
    body = []
    for model, count, kind in product(models_of(results, REALISM), COUNTS, KINDS):
        rows = of(mine, REALISM, model=model, counts=count, trained_on=kind)
        cells = [accuracies(rows, test) for test in KINDS]
        for test in real:
            found = [cars_found(row.tests[test]) for row in rows if test in row.tests]
            cells += [percent(cars for cars, _ in found), percent(wrong for _, wrong in found)]
        if rows:
            body.append([printed(model), COUNTED[count], WORDS[kind], *cells])
    header = ["model", "points", "trained on", *(f"tested on {WORDS[kind]}" for kind in KINDS)]
    for test in real:
        name = test.partition(":")[2]
        header += [f"{name}: cars found", f"{name}: others taken for cars"]
    note = _note_realism(mine, facts, real)
    return Table("What a sensor does to a classifier", header, _once(body, 2), note, texts=range(3))


def cars_found(test: Confusion) -> tuple[float, float | None]:
    """Return the share of real cars that are taken for cars, and of the other objects; None without others."""
    column, row = test.predicted.index(CAR), test.truth.index(CAR)
    cars, others = test.counts[row], np.delete(test.counts, row, axis=0).sum(axis=0)
    return float(cars[column] / cars.sum()), float(others[column] / others.sum()) if others.any() else None


def _note_realism(results: Sequence[Result], facts: Mapping[str, Any], real: Sequence[str]) -> str:
    medians = ", ".join(f"{n:.0f} of {WORDS[kind]}" for kind, n in facts["points"].items())
    note = (
        f"Accuracy in percent, mean ± standard deviation over the seeds. All kinds show the same "
        f"{facts['clouds']:,} views of the same {facts['objects']:,} objects, {facts['metres']:g} m long, by a "
        f"{facts['sensor']} at {facts['range'][0]:g} to {facts['range'][1]:g} m; in streets up to "
        f"{100 * facts['hidden'][1]:.0f} % is hidden by others. Views in which one kind has fewer than "
        f"{facts['least']} points are left out. Points that differ per cloud, median: {medians}; matched: all "
        "are thinned to the fewest of that view."
    )
    if near := facts.get("two_eyes"):
        low, high = near["range"]
        note += f" Two eyes: {near['sensor']}, objects of {near['metres']:g} m alone, {low:g} to {high:g} m away."
    if not real:
        return note + " With `--real DIR` real objects are one more test: only the test is then added."
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
        said = [
            f"{percent(each)} ({BUDGETS[b]}: {whether_shown(each, finding.least)})" for b, each in found.items() if each
        ]
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
        by_split = (of(results, ELEVATION, model=model, split=split) for split in SPLIT_BY)
        lost = " and ".join(percent(lost_at_zero(_curve(row)) for row in rows) for rows in by_split if rows)
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


# ---- plots -------------------------------------------------------------------------------------------------------


def _legend(panel: Axes, title: str | None = None) -> None:
    if panel.get_legend_handles_labels()[0]:
        panel.legend(fontsize=9, frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5), title=title)


def _bars(panel: Axes, at: float, rows: Sequence[Result], test: str, colour: str, label: str | None) -> None:
    """Draw the accuracies of results in a test: a bar for their mean, a dot for each seed."""
    shares = [100 * share for row in rows if (share := row.accuracy(test)) is not None]
    if shares:
        panel.bar(at, float(np.mean(shares)), width=0.25, color=colour, alpha=0.55, label=label)
        panel.plot([at] * len(shares), shares, color=colour, marker="o", markersize=3.5, linestyle="none")


def plot_elevation(results: Sequence[Result], areas: dict[str, Any] | None) -> Figure:
    """Draw accuracy against elevation, a panel a split, the paper's dashed; below the projected areas of Fig. 12."""
    levels = TEST_ELEVATIONS
    figure, panels = canvas(11.0, 6.6, len(SPLIT_BY), 2, sharex=True, sharey="row", height_ratios=(1.45, 1.0))
    for (above, below), (split, words) in zip(panels.T, SPLIT_BY.items(), strict=True):
        above.set_title(words, fontsize=11, color=GREY)
        for model in models_of(results, ELEVATION):
            tint = COLOURS[paper_name(model)]
            rows = of(results, ELEVATION, model=model, split=split)
            curves = 100 * np.array([[row.accuracy(e) for e in levels] for row in rows], dtype=float)
            if curves.size:
                mean, label = curves.mean(axis=0), printed(model)
                above.plot(levels, mean, color=tint, marker="o", markersize=4, label=label)
                if len(curves) > 1:
                    above.fill_between(levels, curves.min(axis=0), curves.max(axis=0), color=tint, alpha=0.15)
            published = TABLE_3A[paper_name(model)]
            above.plot(levels, published, color=tint, linewidth=1.0, linestyle=(0, (4, 3)), alpha=0.55)
        if areas:
            for plane, seen, tint in zip(areas["planes"], np.transpose(areas["mean"]), PLANE_COLOURS, strict=True):
                label = f"onto {plane}"
                below.plot(areas["elevations"], 100 * seen, color=tint, marker="o", markersize=3, label=label)
        below.set_xticks(range(-90, 91, 30))
        below.set_xlabel("elevation of the camera, degrees", fontsize=10)
        below.set_ylim(0, 102)
    panels[0, 0].set_ylabel("accuracy, % (dashed: the paper's)", fontsize=10)
    panels[1, 0].set_ylabel("projected area seen,\n% of an object's largest", fontsize=10)
    for row in panels:
        _legend(row[-1])
    return figure


def plot_training_sets(results: Sequence[Result]) -> Figure:
    """Draw accuracy in Test 1 and Test 2 by training set: a bar per mean, a dot per seed, a line for the paper's."""
    mine = of(results, AUGMENTATION)
    groups = [(model, n, budget) for (n, model), budget in product(_points_and_models(mine), budgets_of(mine))]
    figure, panels = canvas(11.0, 3.9, 2, sharey=True)
    tests = ((ORIGINAL, "Test 1: complete clouds"), (GENERATED, "Test 2: occluded clouds"))
    for place, (panel, (test, words)) in enumerate(zip(panels, tests, strict=True)):
        panel.set_title(words, fontsize=11, color=GREY)
        for group, (model, n_points, budget) in enumerate(groups):
            published = TABLE_3B.get((paper_name(model), MOST_POINTS))
            for training_set, kind in TRAINING_SETS.items():
                rows = of(mine, AUGMENTATION, model=model, points=n_points, set=training_set, budget=budget)
                at = group + 0.27 * (training_set - 2)
                label = f"C{training_set}: {kind}" if group == 0 else None
                _bars(panel, at, rows, test, SET_COLOURS[training_set], label)
                if published:
                    panel.plot([at - 0.12, at + 0.12], [published[training_set][place]] * 2, color="#222222", lw=1.6)
        panel.set_xticks(range(len(groups)), ["\n".join(words) for words in _names(groups)], fontsize=8)
    panels[0].set_ylabel("accuracy, % (line: the paper's)", fontsize=10)
    _legend(panels[1], "trained on")
    return figure


def _names(groups: Sequence[tuple[str, int, str]]) -> list[list[str]]:
    """Return what groups of bars are called: the model, and what else differs between them."""
    points, budgets = (len({group[at] for group in groups}) > 1 for at in (1, 2))
    return [
        [printed(m)] + [f"{p:,} points"] * points + [BUDGETS[b].replace("equal ", "equal\n", 1)] * budgets
        for m, p, b in groups
    ]


def plot_methods(results: Sequence[Result]) -> Figure:
    """Draw the accuracy of classifiers trained on the clouds of each method, on those of each."""
    models = models_of(results, HSR)
    figure, panels = canvas(11.0, 3.6, len(models), sharey=True)
    tests = [ORIGINAL, *map(name_of_test, METHODS)]
    for panel, model in zip(panels, models, strict=True):
        panel.set_title(printed(model), fontsize=11, color=GREY)
        for place, (method, rows) in enumerate(by_method(results, model).items()):
            for group, test in enumerate(tests):
                at = group + 0.27 * (place - 1)
                _bars(panel, at, rows, test, PLANE_COLOURS[place], method if group == 0 else None)
        panel.set_xticks(range(len(tests)), ["complete", *(method.label.replace(":", "\n") for method in METHODS)])
        panel.set_xlabel("tested on", fontsize=10)
    panels[0].set_ylabel("accuracy, %", fontsize=10)
    _legend(panels[-1], "trained on")
    return figure
