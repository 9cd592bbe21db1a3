"""Report of a study from its stored results: study.html (self-contained), study.md and plots.

Tables show means and standard deviations over the seeds beside the paper's numbers.
"""

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from zbuf_occlude.base.errors import ArgumentError, DatasetError
from zbuf_occlude.datasets.real.sydney import SOURCE, VEHICLES
from zbuf_occlude.drawing.pages import NONE, Picture, Section, Table, as_png, verbatim, write_pages
from zbuf_occlude.drawing.pictures import GREY, canvas
from zbuf_occlude.studies.learn.evaluation import Confusion
from zbuf_occlude.studies.paper.design import (
    ALONE,
    AUGMENTATION,
    BUDGETS,
    CITATION,
    COUNTS,
    ELEVATION,
    GENERATED,
    HSR,
    KINDS,
    MAIN,
    MATCHED,
    METHODS,
    MODELNET40_ACCURACY,
    ORIGINAL,
    OWN,
    PUBLISHED_POINTS,
    REAL,
    REAL_OBJECTS,
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
from zbuf_occlude.studies.paper.real_report import plot_confusions, table_by_fit, table_by_range, table_real
from zbuf_occlude.studies.paper.results import (
    AREAS,
    PICTURE,
    REAL_PICTURE,
    Result,
    budgets_of,
    models_of,
    percent,
    read_results,
    read_study,
    select_results,
    values,
)

TITLE = "Classifiers of occluded clouds: the paper's experiments again"
CAPTIONS = {
    ELEVATION: (
        "Elevation of the camera",
        "Above: accuracy against the camera's elevation. Below: projected area of the visible part of an object on "
        "three planes (Fig. 12; mean over objects, each object's largest 100 %).",
    ),
    AUGMENTATION: (
        "Training sets",
        "Test 1 and Test 2 by training set: bars are means, dots seeds, black lines the paper's numbers "
        "(of 12,000 points).",
    ),
    SCANS: (
        "Real scans",
        "The largest scans of some classes from the side: wheels and trunks must be below.",
    ),
    REAL: (
        "Answers about real objects",
        "Each model with its best training set: fractions of each class, all seeds together.",
    ),
    REAL_OBJECTS: ("Real and simulated", "Real objects, and below each the simulated scan nearest in range."),
    HSR: ("Methods", "Trained on the clouds of one method, tested on those of each: bars are means, dots seeds."),
}
COLOURS = {"voxnet": "#0072b2", "pointnet": "#d55e00", "threedmfv": "#009e73"}
PLANE_COLOURS = ("#882255", "#cc79a7", "#56b4e9")
SET_COLOURS = {1: "#56b4e9", 2: "#d55e00", 3: "#009e73"}
LARGE_LOSS = 0.05
"""Minimum difference that counts as a large loss: 5 percentage points; the paper's two models lose 7 and 36."""
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

    Nothing is trained or tested. The page is self-contained; the Markdown links the plots in its folder. Raises
    DatasetError where there is no study or no result, or where a file is damaged.
    """
    study, results = read_study(folder), read_results(folder)
    if not results:
        raise DatasetError(f"{folder} must hold results; it has none. Run: zbuf-occlude paper table3 --out {folder}")
    areas = read_areas(folder)

    def captioned(name: str, png: bytes) -> Picture:
        return Picture(name, png, *CAPTIONS[name])

    sections: list[Section] = []
    if select_results(results, AUGMENTATION):
        sections += [table_of_findings(results), captioned(AUGMENTATION, as_png(plot_training_sets(results)))]
        sections.append(table_3b(results))
    if study.get("scans") and (folder / PICTURE).exists():
        sections.append(captioned(SCANS, (folder / PICTURE).read_bytes()))
    if select_results(results, HSR):
        sections += [captioned(HSR, as_png(plot_methods(results))), table_methods(results, study["missing_methods"])]
    if select_results(results, ELEVATION):
        sections += [captioned(ELEVATION, as_png(plot_elevation(results, areas))), table_3a(results)]
        sections.append(dead_angle(results, areas))
    ends = [departures(study)] if sections else []  # for the experiments of the paper
    if select_results(results, REALISM):
        sections += [table_realism(results, study["realism"]), table_of_clouds(study["realism"])]
    if select_results(results, REAL):
        sections += [table_real(results, study[REAL]), captioned(REAL, as_png(plot_confusions(results)))]
        sections += [table_by_fit(results), table_by_range(results)]
        sections += [captioned(REAL_OBJECTS, (folder / REAL_PICTURE).read_bytes())]
    sections += [table_of_trainings(results), *ends]
    facts = [facts_of_study(study, results)]
    return write_pages(folder, "study", TITLE, answers=[], facts=facts, sections=sections)


def tables_of_answers(folder: Path) -> list[Table]:
    """Return the table that answers each experiment of a study, without its note."""
    study, results = read_study(folder), read_results(folder)
    tables: dict[str, Callable[[], Table]] = {
        AUGMENTATION: lambda: table_of_findings(results),
        HSR: lambda: table_methods(results, {}),
        ELEVATION: lambda: dead_angle(results, None),
        REALISM: lambda: table_realism(results, study["realism"]),
        REAL: lambda: table_real(results, study[REAL]),
    }
    return [replace(table(), note="") for name, table in tables.items() if select_results(results, name)]


def read_areas(folder: Path) -> dict[str, Any] | None:
    """Read the projected areas of a study; None where they have not been measured."""
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
    """Return a text on size, objects, machines and classes of the study."""
    documents, size = [result.document for result in results], study["size"]
    devices, machines = (sorted({row[what] for row in documents}) for what in ("device", "machine"))
    n_classes = sorted({len(test.predicted) for result in results for test in result.tests.values()})
    chances = " or ".join(f"{100 / n:.1f} % (of {n} classes)" for n in n_classes)
    text = (
        f'The study "{size["name"]}" ({size["summary"]}) of {verbatim(study["objects"])}, begun {study["date"]}: '
        f"{len(results)} classifiers, {sum(row['seconds'] for row in documents) / 60:.0f} minutes of training on "
        f"{', '.join(devices)}; {'; '.join(machines)}. A random guess is right in {chances}. "
        f"The paper: {CITATION}."
    )
    if scans := study.get("scans"):
        text += f" Real scans: {scans['said']}"
    if failed := study["failed_meshes"]:
        text += f" {len(failed)} mesh{'es' * (len(failed) > 1)} could not be used: {verbatim(', '.join(failed))}."
    return text


def table_of_trainings(results: Sequence[Result]) -> Table:
    """Return the table of trainings: parameters, clouds, epochs and seconds by experiment, training set and model."""
    kinds = {
        f"{AUGMENTATION}, {BUDGETS[budget]}, C{training_set}": (AUGMENTATION, {"budget": budget, "set": training_set})
        for budget, training_set in product(budgets_of(results), TRAINING_SETS)
    }
    body = []
    for name, (experiment, facts) in (kinds | {name: (name, {}) for name in (HSR, ELEVATION, REALISM)}).items():
        for model in models_of(results, experiment):
            rows = [result.document for result in select_results(results, experiment, model=model, **facts)]
            if rows:
                body.append(
                    [
                        name,
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
        "the best validation counts. Clouds shown: epochs times clouds. Seconds: mean of a training, with validation.",
        texts=range(2),
    )


def _range(counts: Iterable[int]) -> str:
    low, high = min(found := list(counts)), max(found)
    return f"{low:,}" if low == high else f"{low:,} to {high:,}"


def departures(study: Mapping[str, Any]) -> Table:
    """Return the table of differences from the paper, and of choices that the paper leaves open."""
    size = study["size"]
    points = " and ".join(f"{n:,}" for n in size["n_points"])
    objects = "200" if size["elevation_each"] is None else f"{size['elevation_each']} of each class"
    exact = f"`{METHODS[0].label}`; the effect of the grid is measured separately"
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
        ["optimiser, epochs, validation in 4.2", "not stated", "as in the table above; 10 % of the training clouds"],
    ]
    return Table("Differences from the paper", ["", "the paper", "here"], rows, texts=range(3))


def accuracies(results: Iterable[Result], test: str | int) -> str:
    """Format the mean accuracy of results in a test, as `percent` does."""
    return percent(result.accuracy(test) for result in results)


def _once(rows: Iterable[Sequence[str]], n: int = 1) -> list[list[str]]:
    """Return rows of a table, the first n cells left empty where they repeat the row above."""
    shown: list[list[str]] = []
    above: Sequence[str] = ()
    for row in rows:
        shown.append(["" if row[:n] == above else cell for cell in row[:n]] + list(row[n:]))
        above = row[:n]
    return shown


def _points_and_models(results: Sequence[Result]) -> list[tuple[int, str]]:
    """Return the pairs of number of points and model of 4.3, most points first."""
    points = sorted(values(select_results(results, AUGMENTATION), "points"), reverse=True)
    return list(product(points, models_of(results, AUGMENTATION)))


# ---- elevation: Table 3A -----------------------------------------------------------------------------------------


def table_3a(results: Sequence[Result]) -> Table:
    """Return Table 3A: accuracy at each elevation, in the paper and here with both splits."""
    body = _by_split(
        results,
        lambda model: [f"{number:.1f}" for number in TABLE_3A[paper_name(model)]],
        lambda rows: [accuracies(rows, elevation) for elevation in TEST_ELEVATIONS],
    )
    counts = {
        words: _clouds_in_tests(select_results(results, ELEVATION, split=split)) for split, words in SPLIT_BY.items()
    }
    note = (
        "Overall accuracy in percent; elevations in degrees. Trained at ±90, ±70, ±50 and ±20. "
        "The paper splits by elevation alone: every test object was seen in training from other elevations. With "
        "objects held out none was. "
        + " ".join(f"Clouds per column, {words}: {text}." for words, text in counts.items() if text)
        + " An accuracy of 70 % has a standard error of 3 points with 200 clouds, of 5 with 80. The paper's forty "
        "classes need ModelNet40."
    )
    header = ["model", "split", *(f"{e:+d}".replace("+0", "0") for e in TEST_ELEVATIONS)]
    title = "Table 3A of the paper: accuracy against the camera's elevation"
    return Table(title, header, body, note, texts=range(2))


def _by_split(
    results: Sequence[Result],
    published: Callable[[str], list[str]],
    measured: Callable[[Sequence[Result]], list[str]],
) -> list[list[str]]:
    """Return rows of a table: for each model the paper's cells, then those measured with each split."""
    body = []
    for model in models_of(results, ELEVATION):
        body.append([printed(model), "**paper**", *published(model)])
        for split, words in SPLIT_BY.items():
            if rows := select_results(results, ELEVATION, model=model, split=split):
                body.append([printed(model), words, *measured(rows)])
    return _once(body)


def _clouds_in_tests(results: Iterable[Result], name: str | None = None) -> str:
    """Return the number of clouds in the tests, or in those of a name; "" without tests."""
    counts = [test.n_clouds for result in results for each, test in result.tests.items() if name in (None, each)]
    return "" if not counts else f"{min(counts)} to {max(counts)}" if min(counts) < max(counts) else f"{min(counts)}"


def dead_angle(results: Sequence[Result], areas: dict[str, Any] | None) -> Table:
    """Return the table of accuracy lost at 0 degrees against +-10 and the other elevations, with the visible areas."""
    body = _by_split(
        results, lambda model: _dip([published_curve(model)]), lambda rows: _dip([_curve(row) for row in rows])
    )
    note = "Percentage points lost: accuracy at ±10 minus that at 0; mean over all other elevations minus that at 0."
    if areas:
        seen = zip(areas["planes"], areas["mean"][areas["elevations"].index(0)], strict=True)
        note += (
            " Projected area of the visible part at 0, relative to its largest over all elevations: "
            f"{', '.join(f'{100 * share:.0f} % onto {plane}' for plane, share in seen)} (mean over "
            f"{areas['n_objects']} objects)."
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
    """Return the mean accuracy at +-10 degrees minus that at 0."""
    return (curve[-10] + curve[10]) / 2 - curve[0]


def _dip(curves: Sequence[dict[int, float]]) -> list[str]:
    mean = {e: float(np.mean([curve[e] for curve in curves])) for e in curves[0]}
    far = [float(np.mean([v for e, v in curve.items() if e != 0])) - curve[0] for curve in curves]
    worst = min(mean, key=lambda e: mean[e])
    return [f"{worst:+d}°".replace("+0", "0"), percent(map(lost_at_zero, curves)), percent(far)]


# ---- augmentation: Table 3B --------------------------------------------------------------------------------------


def table_3b(results: Sequence[Result]) -> Table:
    """Return Table 3B: three training sets and three tests, in the paper and here."""
    body = []
    mine = select_results(results, AUGMENTATION)
    for (n_points, model), (training_set, kind) in product(_points_and_models(mine), TRAINING_SETS.items()):
        heads = [f"{printed(model)}, {n_points:,} points", f"C{training_set} {kind}"]
        rows = select_results(mine, AUGMENTATION, model=model, points=n_points, set=training_set)
        if rows and (published := _published_3b(model, n_points)):
            points, numbers = published
            cells = [NONE if np.isnan(number) else f"{number:.1f}" for number in numbers[training_set]]
            words = "**paper**" + (f", {points:,} points" if points != n_points else "")
            body.append([*heads, words, *cells, NONE, NONE])
        for budget in budgets_of(rows):
            under = select_results(rows, AUGMENTATION, budget=budget)
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
            " This spread does not include the choice of test objects: an accuracy of 80 % has a standard error of "
            f"{40 / n**0.5:.0f} points with {n} objects."
        )
    if not any(SCANS in row.tests for row in results):
        note += (
            f" Test 3 is empty: it needs the real scans of the Sydney Urban Objects dataset ({SOURCE}). Unpack its "
            "archive and run the same command with `--sydney DIR`; only the test is then added."
        )
    return note + (
        " Test 3: fraction of a class's scans labelled car; F1 over the six vehicle classes (188 scans), with false "
        "positives among the 400 others, unweighted and weighted by the classes' scans. The paper gives an average F1 "
        f"of {f1} for {printed(model)} with {n_points:,} points, without naming the classifier. For training on all of "
        f"ModelNet40 it cites, in Test 1, VoxNet {MODELNET40_ACCURACY['voxnet']} and 3DmFV "
        f"{MODELNET40_ACCURACY['threedmfv']}."
    )


def _published_3b(model: str, n_points: int) -> tuple[int, Mapping[int, tuple[float, ...]]] | None:
    """Return the number of points and the numbers by training set of the closest entry of the paper's Table 3B."""
    points = n_points if (paper_name(model), n_points) in TABLE_3B else PUBLISHED_POINTS
    numbers = TABLE_3B.get((paper_name(model), points))
    return None if numbers is None else (points, numbers)


class VehicleScores(NamedTuple):
    """Scores of a classifier with one class "car" on scans of the six vehicle classes (Test 3), by class."""

    recall: list[float]  # fraction of a class's scans labelled car, which the paper calls accuracy
    f1: list[float]
    n_scans: list[int]


def vehicle_scores(scans: Confusion) -> VehicleScores:
    """Return the scores of real scans, in the order of `VEHICLES`; all of them should be labelled car.

    Paper 4.4: TP are the scans of a class that are labelled car, FN its other scans, FP the scans of classes other than
    the six that are labelled car. F1 = 2 TP / (2 TP + FP + FN). The paper does not state whether its "average F1" is
    weighted; the report gives both.

    Raises ArgumentError where a class has no scan, or where "car" is not among the labels.
    """
    rows = [scans.truth.index(label) for label in VEHICLES if label in scans.truth]
    totals = scans.counts[rows].sum(axis=1)
    if len(rows) < len(VEHICLES) or not totals.all() or CAR not in scans.predicted:
        raise ArgumentError(
            f"a test on scans must have scans of {', '.join(VEHICLES)}, and the label {CAR}; one is missing."
        )
    labelled_car = scans.counts[:, scans.predicted.index(CAR)]
    hits = labelled_car[rows]
    false_positives = labelled_car.sum() - hits.sum()
    f1 = 2 * hits / (hits + false_positives + totals)  # TP + FP + n
    return VehicleScores((hits / totals).tolist(), f1.tolist(), totals.tolist())


# ---- the paper's findings ----------------------------------------------------------------------------------------


class Finding(NamedTuple):
    """A statement of the paper: the first accuracy minus the second is at least `least`."""

    text: str
    better: tuple[int, str]  # training set and test
    worse: tuple[int, str]
    least: float = 0.0


FINDINGS = (
    Finding("trained on complete shapes only (C2): lost on occluded clouds", (2, ORIGINAL), (2, GENERATED), LARGE_LOSS),
    Finding("on occluded clouds C3 is better than C2", (3, GENERATED), (2, GENERATED), LARGE_LOSS),
    Finding("on occluded clouds C3 is at least as good as C1", (3, GENERATED), (1, GENERATED)),
    Finding("on complete clouds C3 is at least as good as C1", (3, ORIGINAL), (1, ORIGINAL)),
    Finding("on complete clouds C3 is at least as good as C2", (3, ORIGINAL), (2, ORIGINAL)),
)


def verdict(differences: Sequence[float], least: float) -> str:
    """Return "yes", "no" or "not decided": whether differences are at least `least`.

    The answer is decided where the mean differs from `least` by more than its standard error, estimated from at least
    two seeds.
    """
    if len(differences) < 2:
        return "one seed only" if differences else NONE
    away = float(np.mean(differences)) - least
    error = float(np.std(differences, ddof=1)) / len(differences) ** 0.5
    return "not decided" if abs(away) < error else "yes" if away >= 0.0 else "**no**"


def table_of_findings(results: Sequence[Result]) -> Table:
    """Return the table of findings of 4.3 and 4.4: the paper's differences, ours under each budget, and verdicts."""
    body = []
    mine = select_results(results, AUGMENTATION)
    several = len(values(mine, "points")) > 1
    budgets = budgets_of(mine)
    for finding, (n_points, model) in product(FINDINGS, _points_and_models(mine)):
        found = [differences(mine, finding, model, n_points, budget) for budget in budgets]
        if any(found):
            name = printed(model) + (f", {n_points:,} points" if several else "")
            cells = [cell for each in found for cell in (percent(each), verdict(each, finding.least))]
            body.append([finding.text, name, _published_difference(finding, model), *cells])
    heads = [cell for budget in budgets for cell in (f"here, {BUDGETS[budget]}", "shows")]
    return Table(
        "Do the paper's findings show?",
        ["the finding", "model", "the paper's difference", *heads],
        _once(body),
        "C1 is trained on occluded clouds, C2 on complete ones, C3 on both. "
        "Percentage points; between classifiers of the same seed, mean ± standard deviation over the seeds. Shows: the "
        f"difference is at least {100 * LARGE_LOSS:.0f} for the first two, at least 0 for the others; not decided: "
        "within the standard error of the mean.",
        texts=(0, 1, 2 + len(heads)),
    )


def differences(results: Sequence[Result], finding: Finding, model: str, n_points: int, budget: str) -> list[float]:
    """Return the difference of a finding for each seed that has both results."""
    sides = []
    for training_set, test in (finding.better, finding.worse):
        rows = select_results(results, AUGMENTATION, model=model, points=n_points, set=training_set, budget=budget)
        sides.append({row.facts["seed"]: row.tests[test].accuracy for row in rows if test in row.tests})
    return [sides[0][seed] - sides[1][seed] for seed in sides[0] if seed in sides[1]]


def _published_difference(finding: Finding, model: str) -> str:
    numbers = TABLE_3B.get((paper_name(model), PUBLISHED_POINTS))
    if numbers is None:
        return NONE
    better, worse = (numbers[s][(ORIGINAL, GENERATED).index(test)] for s, test in (finding.better, finding.worse))
    return f"{better - worse:.1f}"


# ---- methods of HSR ----------------------------------------------------------------------------------------------


def by_method(results: Sequence[Result], model: str) -> dict[str, list[Result]]:
    """Return a model's results of training on generated clouds alone, by the method that made the clouds.

    The results of `MAIN` are those of training set 1 in Table 3B with the same points and budget.
    """
    found = {}
    others = [result.facts for result in select_results(results, HSR, model=model)]
    for method in METHODS:
        rows = select_results(results, HSR, model=model, method=method.label)
        if method is MAIN and others:
            same = {fact: others[0][fact] for fact in ("points", "budget")}
            rows = select_results(results, AUGMENTATION, model=model, set=1, **same)
        if rows:
            found[method.label] = rows
    return found


def table_methods(results: Sequence[Result], missing: dict[str, str]) -> Table:
    """Return the table of methods of HSR: trained on the clouds of one, tested on those of each."""
    tested = [
        method
        for method in METHODS
        if any(name_of_test(method) in result.tests for result in select_results(results, HSR))
    ]
    body = []
    for model in models_of(results, HSR):
        for method, rows in by_method(results, model).items():
            cells = (accuracies(rows, test) for test in (ORIGINAL, *map(name_of_test, tested)))
            body.append([printed(model), f"`{method}`", *cells])
    header = ["model", "trained on clouds by", "Test 1 (original)", *(f"Test 2 by `{m.label}`" for m in tested)]
    note = (
        "Objects, points and views are the same; only the method of hidden-surface removal differs. `exact` is always "
        f"right; `{METHODS[-1].label}` is the paper's. Overall accuracy in percent, mean ± standard deviation."
    )
    note += "".join(f" `{method}` could not run here: {reason}" for method, reason in missing.items())
    return Table("Does the method of hidden-surface removal matter?", header, _once(body), note, texts=range(2))


# ---- realism -----------------------------------------------------------------------------------------------------


def table_realism(results: Sequence[Result], facts: Mapping[str, Any]) -> Table:
    """Return the table of accuracies by kind of training and test clouds; `facts` as returned by `Realism.notes`."""
    mine = select_results(results, REALISM)
    real = sorted({test for result in mine for test in result.tests if test not in KINDS})
    body = []
    for model, count, kind in product(models_of(results, REALISM), COUNTS, KINDS):
        rows = select_results(mine, REALISM, model=model, counts=count, trained_on=kind)
        cells = [accuracies(rows, test) for test in KINDS]
        for test in real:
            found = [cars_found(row.tests[test]) for row in rows if test in row.tests]
            cells += [percent(cars for cars, _ in found), percent(wrong for _, wrong in found)]
        if rows:
            body.append([printed(model), COUNTED[count], WORDS[kind], *cells])
    header = ["model", "points", "trained on", *(f"tested on {WORDS[kind]}" for kind in KINDS)]
    for test in real:
        name = test.partition(":")[2]
        header += [f"{name}: cars found", f"{name}: others labelled car"]
    note = "Accuracy in percent, mean ± standard deviation over the seeds."
    for test in real:
        counts = next(row.tests[test].counts.sum(axis=1) for row in mine if test in row.tests)
        note += f" {test.partition(':')[2]}: {counts[0]:,} cars and {counts[1:].sum():,} other objects."
    note += (
        " A cloud of a real object has all points in its labelled box, ground included, if they are at least "
        f"{facts['least']}; trucks and buses are left out."
        if real
        else " `--real DIR` adds a test on real objects; only the test is then added."
    )
    return Table("What a sensor does to a classifier", header, _once(body, 2), note, texts=range(3))


def cars_found(test: Confusion) -> tuple[float, float | None]:
    """Return the fractions of real cars and of other objects that are labelled car; None without other objects."""
    column, row = test.predicted.index(CAR), test.truth.index(CAR)
    cars, others = test.counts[row], np.delete(test.counts, row, axis=0).sum(axis=0)
    return float(cars[column] / cars.sum()), float(others[column] / others.sum()) if others.any() else None


def table_of_clouds(facts: Mapping[str, Any]) -> Table:
    """Return the table of the kinds of clouds; `facts` as returned by `Realism.notes`."""
    near, medians = facts["two_eyes"], facts["points"]
    hidden = f"up to {100 * facts['hidden'][1]:.0f} %"
    kinds = {
        UNIFORM: ["none", NONE, NONE, NONE],
        ALONE: [facts["sensor"], f"{facts['metres']:g}", _span(facts["range"]), NONE],
        SCENES: [facts["sensor"], f"{facts['metres']:g}", _span(facts["range"]), hidden],
        TWO_EYES: [near["sensor"], f"{near['metres']:g}", _span(near["range"]), NONE],
    }
    header = ["clouds", "sensor", "object, m", "range, m", "hidden by others", "points, median"]
    note = (
        f"All kinds show the same {facts['clouds']:,} views of the same {facts['objects']:,} objects. Views with fewer "
        f"than {facts['least']} points in one kind are left out. Matched: each cloud has as many points as the "
        "smallest one of its view."
    )
    rows = [[WORDS[kind], *cells, f"{medians[kind]:.0f}"] for kind, cells in kinds.items()]
    return Table("Kinds of clouds", header, rows, note, texts=(0, 1))


def _span(ends: Sequence[float]) -> str:
    return f"{ends[0]:g} to {ends[1]:g}"


# ---- plots -------------------------------------------------------------------------------------------------------


def _legend(panel: Axes, title: str | None = None) -> None:
    if panel.get_legend_handles_labels()[0]:
        panel.legend(fontsize=9, frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5), title=title)


def _bars(panel: Axes, at: float, rows: Sequence[Result], test: str, colour: str, label: str | None) -> None:
    """Draw the accuracies of results in a test: a bar for the mean, a dot for each seed."""
    shares = [100 * share for row in rows if (share := row.accuracy(test)) is not None]
    if shares:
        panel.bar(at, float(np.mean(shares)), width=0.25, color=colour, alpha=0.55, label=label)
        panel.plot([at] * len(shares), shares, color=colour, marker="o", markersize=3.5, linestyle="none")


def plot_elevation(results: Sequence[Result], areas: dict[str, Any] | None) -> Figure:
    """Plot accuracy against elevation, a panel per split, the paper's dashed; below it the areas of Fig. 12."""
    levels = TEST_ELEVATIONS
    figure, panels = canvas(11.0, 6.6, len(SPLIT_BY), 2, sharex=True, sharey="row", height_ratios=(1.45, 1.0))
    for (above, below), (split, words) in zip(panels.T, SPLIT_BY.items(), strict=True):
        above.set_title(words, fontsize=11, color=GREY)
        for model in models_of(results, ELEVATION):
            tint = COLOURS[paper_name(model)]
            rows = select_results(results, ELEVATION, model=model, split=split)
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
    """Plot accuracy in Test 1 and Test 2 by training set: a bar per mean, a dot per seed, a line for the paper."""
    mine = select_results(results, AUGMENTATION)
    groups = [(model, n, budget) for (n, model), budget in product(_points_and_models(mine), budgets_of(mine))]
    figure, panels = canvas(11.0, 3.9, 2, sharey=True)
    tests = ((ORIGINAL, "Test 1: complete clouds"), (GENERATED, "Test 2: occluded clouds"))
    for place, (panel, (test, words)) in enumerate(zip(panels, tests, strict=True)):
        panel.set_title(words, fontsize=11, color=GREY)
        for group, (model, n_points, budget) in enumerate(groups):
            published = TABLE_3B.get((paper_name(model), PUBLISHED_POINTS))
            for training_set, kind in TRAINING_SETS.items():
                rows = select_results(mine, AUGMENTATION, model=model, points=n_points, set=training_set, budget=budget)
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
    """Return the labels of groups of bars: the model, and points and budget where they differ."""
    points, budgets = (len({group[at] for group in groups}) > 1 for at in (1, 2))
    return [
        [printed(m)] + [f"{p:,} points"] * points + [BUDGETS[b].replace("equal ", "equal\n", 1)] * budgets
        for m, p, b in groups
    ]


def plot_methods(results: Sequence[Result]) -> Figure:
    """Plot the accuracy of classifiers trained on the clouds of each method, tested on those of each."""
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
