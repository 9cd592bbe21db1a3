"""A study's tables: results of trials, mean and spread over the seeds, beside the paper's numbers."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from zbuf_occlude.compare.tables import Table
from zbuf_occlude.paper import reported as paper
from zbuf_occlude.paper import sydney
from zbuf_occlude.paper.names import (
    AUGMENTATION,
    BUDGETS,
    ELEVATION,
    GENERATED,
    HSR,
    MAIN,
    METHODS,
    ORIGINAL,
    SCANS,
    SPLIT_BY,
    name_of_test,
    paper_name,
    printed,
)
from zbuf_occlude.paper.results import Result
from zbuf_occlude.paper.vehicles import vehicle_scores

NONE = "–"
Measure = Callable[[Result], float | None]


def percent(values: Iterable[float | None]) -> str:
    """Write the mean of some shares in percent, and over several seeds their standard deviation."""
    known = [100.0 * value for value in values if value is not None]
    if not known:
        return NONE
    spread = f" ± {np.std(known, ddof=1):.1f}" if len(known) > 1 else ""
    return f"{np.mean(known):.1f}{spread}"


def accuracy(test: str) -> Measure:
    """Return a function that gives a result's accuracy in a test, None where it was not tested."""
    return lambda result: result.tests[test].accuracy if test in result.tests else None


def of(results: Iterable[Result], experiment: str, **facts: Any) -> list[Result]:
    """Return the results of an experiment with these facts, in the order of their seeds."""
    chosen = (result for result in results if result.experiment == experiment and result.is_of(**facts))
    return sorted(chosen, key=lambda result: int(result.facts["seed"]))


def values(results: Iterable[Result], fact: str) -> list[Any]:
    """Return the values of a fact in the order in which they first come."""
    return list(dict.fromkeys(result.facts[fact] for result in results))


def budgets_of(results: Iterable[Result]) -> list[str]:
    """Return the budgets that classifiers of 4.3 were trained under, in the order of `BUDGETS`."""
    found = {result.facts["budget"] for result in results if result.experiment == AUGMENTATION}
    return [budget for budget in BUDGETS if budget in found]


def models_of(results: Sequence[Result], experiment: str) -> list[str]:
    """Return the models of an experiment in the paper's order."""
    order = list(paper.TABLE_3A)
    found = {str(result.facts["model"]) for result in results if result.experiment == experiment}
    return sorted(found, key=lambda model: (order.index(paper_name(model)), model))


# ---- Table 3A ----------------------------------------------------------------------------------------------------


def table_3a(results: Sequence[Result]) -> Table:
    """Return Table 3A: accuracy at each elevation, the paper's and ours with both splits."""
    body = []
    for model in models_of(results, ELEVATION):
        published = paper.TABLE_3A[paper_name(model)]
        body.append([printed(model), "**paper**", *(f"{number:.1f}" for number in published)])
        for split, words in SPLIT_BY.items():
            rows = of(results, ELEVATION, model=model, split=split)
            if rows:
                cells = (percent(accuracy(str(e))(row) for row in rows) for e in paper.TEST_ELEVATIONS)
                body.append(["", words, *cells])
    some = of(results, ELEVATION)
    counts = {split: _clouds_in_tests(of(some, ELEVATION, split=split)) for split in SPLIT_BY}
    note = (
        "Overall accuracy in percent; elevations in degrees. Trained at ±90, ±70, ±50 and ±20. "
        "The paper's split is by elevation alone, so that every object tested has been seen in training, from other "
        "elevations; with objects held out none has. "
        + " ".join(f"Clouds a column, {SPLIT_BY[split]}: {text}." for split, text in counts.items() if text)
        + " A share of 70 % has a standard error of 3 points among 200 clouds, of 5 among 80. The paper's forty "
        "classes are here only when ModelNet40 was given."
    )
    header = ["model", "split", *(f"{e:+d}".replace("+0", "0") for e in paper.TEST_ELEVATIONS)]
    return Table("Table 3A of the paper: accuracy against the camera's elevation", header, body, note, texts=2)


def _clouds_in_tests(results: Sequence[Result]) -> str:
    counts = [int(test.counts.sum()) for result in results for test in result.tests.values()]
    return "" if not counts else f"{min(counts)} to {max(counts)}" if min(counts) < max(counts) else f"{min(counts)}"


def dead_angle(results: Sequence[Result], areas: dict[str, Any] | None) -> Table:
    """Return how accuracy at 0 degrees compares with that at +-10 and over all, and the area that is seen there."""
    body = []
    for model in models_of(results, ELEVATION):
        body.append([printed(model), "**paper**", *_dip([published_curve(model)])])
        body += [
            ["", words, *_dip(curves)]
            for split, words in SPLIT_BY.items()
            if (curves := curves_of(results, model, split))
        ]
    note = "Percentage points lost: accuracy at ±10 less that at 0; mean over all other elevations less that at 0."
    if areas:
        at = areas["elevations"].index(0)
        shares = ", ".join(
            f"{100 * share:.0f} % onto {plane}" for plane, share in zip(areas["planes"], areas["mean"][at], strict=True)
        )
        note += (
            f" At 0 the visible part's projected area is, of its largest over all elevations, {shares} (mean over "
            f"{areas['n_objects']} objects): the plane that the camera looks along shows its least."
        )
    header = ["model", "split", "worst elevation", "lost at 0 against ±10", "against the others"]
    return Table("The dead angle", header, body, note, texts=2)


def published_curve(model: str) -> dict[int, float]:
    """Return the paper's accuracy by elevation."""
    numbers = paper.TABLE_3A[paper_name(model)]
    return {e: number / 100 for e, number in zip(paper.TEST_ELEVATIONS, numbers, strict=True)}


def curves_of(results: Sequence[Result], model: str, split: str) -> list[dict[int, float]]:
    """Return accuracy by elevation for each seed that has all elevations."""
    rows = of(results, ELEVATION, model=model, split=split)
    return [
        {e: row.tests[str(e)].accuracy for e in paper.TEST_ELEVATIONS}
        for row in rows
        if all(str(e) in row.tests for e in paper.TEST_ELEVATIONS)
    ]


def lost_at_zero(curve: dict[int, float]) -> float:
    """Return accuracy at +-10 degrees less that at 0."""
    return (curve[-10] + curve[10]) / 2 - curve[0]


def _dip(curves: Sequence[dict[int, float]]) -> list[str]:
    mean = {e: float(np.mean([curve[e] for curve in curves])) for e in curves[0]}
    far = [float(np.mean([v for e, v in curve.items() if e != 0])) - curve[0] for curve in curves]
    worst = min(mean, key=lambda e: mean[e])
    return [f"{worst:+d}°".replace("+0", "0"), percent(map(lost_at_zero, curves)), percent(far)]


# ---- Table 3B ----------------------------------------------------------------------------------------------------


def table_3b(results: Sequence[Result]) -> Table:
    """Return Table 3B: three training sets, three tests, the paper's numbers beside ours."""
    body = []
    mine = of(results, AUGMENTATION)
    for n_points in sorted(values(mine, "points"), reverse=True):
        for model in models_of(results, AUGMENTATION):
            first = f"{printed(model)}, {n_points:,} points"
            for training_set, kind in paper.TRAINING_SETS.items():
                rows = of(mine, AUGMENTATION, model=model, points=n_points, set=training_set)
                if not rows:
                    continue
                if published := _published(model, n_points):
                    points, numbers = published
                    cells = [NONE if number is None else f"{number:.1f}" for number in numbers[training_set]]
                    words = "**paper**" + (f", {points:,} points" if points != n_points else "")
                    body.append([first, f"C{training_set} {kind}", words, *cells, NONE, NONE])
                    first = ""
                for budget in budgets_of(rows):
                    under = of(rows, AUGMENTATION, budget=budget)
                    scores = [_scores(row) for row in under]
                    body.append(
                        [
                            first,
                            f"C{training_set} {kind}",
                            BUDGETS[budget],
                            percent(map(accuracy(ORIGINAL), under)),
                            percent(map(accuracy(GENERATED), under)),
                            *(percent(s and s.recall[label] for s in scores) for label in ("car", "4wd")),
                            percent(s and s.mean_f1 for s in scores),
                            percent(s and s.weighted_f1 for s in scores),
                        ]
                    )
                    first = ""
    header = ["model", "trained on", "", "Test 1 (original)", "Test 2 (generated)", "Test 3: car", "4wd", "F1 of six"]
    return Table(
        "Table 3B of the paper: training on occluded clouds, complete ones, or both",
        [*header, "weighted"],
        body,
        _note_3b(mine),
        texts=3,
    )


def _note_3b(results: Sequence[Result]) -> str:
    model, n_points, f1 = paper.VEHICLES_F1
    note = "Overall accuracy in percent; mean ± standard deviation over the seeds. " + " ".join(
        f"{name} has {_clouds_in_tests([_only(row, test) for row in results if test in row.tests])} clouds."
        for name, test in (("Test 1", ORIGINAL), ("Test 2", GENERATED), ("Test 3", SCANS))
        if any(test in row.tests for row in results)
    )
    if n := min((int(row.tests[ORIGINAL].counts.sum()) for row in results if ORIGINAL in row.tests), default=0):
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
        f"training on all of ModelNet40 it cites, in Test 1, VoxNet {paper.MODELNET40_ACCURACY['voxnet']} and 3DmFV "
        f"{paper.MODELNET40_ACCURACY['threedmfv']}."
    )


def _only(result: Result, test: str) -> Result:
    return Result(result.experiment, result.facts, {test: result.tests[test]}, result.document)


def _published(model: str, n_points: int) -> tuple[int, Mapping[int, tuple[float | None, ...]]] | None:
    """Return points of a cloud and the four numbers by training set that the paper has nearest to a model of ours."""
    name = paper_name(model)
    known: dict[tuple[str, int], Mapping[int, tuple[float | None, ...]]] = {}
    known.update(paper.TABLE_3B)
    if (name, n_points) in paper.TABLE_3B_FEWER:
        fewer = paper.TABLE_3B_FEWER[name, n_points]
        known[name, n_points] = {s: (None, None, *numbers) for s, numbers in fewer.items()}
    mine = [points for other, points in known if other == name]
    if not mine:
        return None
    nearest = min(mine, key=lambda points: abs(points - n_points))
    return nearest, known[name, nearest]


def _scores(result: Result) -> Any:
    scans = result.tests.get(SCANS)
    return None if scans is None else vehicle_scores(scans.counts, scans.truth, scans.predicted)


# ---- methods of HSR ----------------------------------------------------------------------------------------------


def by_method(results: Sequence[Result], model: str) -> dict[str, list[Result]]:
    """Return a model's results of training on the generated clouds alone, by the method that made them.

    Those of `MAIN` are training set 1 of Table 3B, with as many points and under the same budget.
    """
    found = {}
    for method in METHODS:
        rows = of(results, HSR, model=model, method=method.label)
        if method is MAIN:
            others = [result.facts for result in of(results, HSR, model=model)]
            same = {fact: others[0][fact] for fact in ("points", "budget")} if others else {}
            rows = of(results, AUGMENTATION, model=model, set=1, **same) if same else []
        if rows:
            found[method.label] = rows
    return found


def table_methods(results: Sequence[Result], missing: dict[str, str]) -> Table:
    """Return what the method of HSR changes: trained on the clouds of one, tested on those of each."""
    tested = [method for method in METHODS if any(name_of_test(method) in result.tests for result in of(results, HSR))]
    body = []
    for model in models_of(results, HSR):
        for place, (method, rows) in enumerate(by_method(results, model).items()):
            cells = (percent(map(accuracy(test), rows)) for test in (ORIGINAL, *map(name_of_test, tested)))
            body.append(["" if place else printed(model), f"`{method}`", *cells])
    header = ["model", "trained on clouds by", "Test 1 (original)", *(f"Test 2 by `{m.label}`" for m in tested)]
    note = (
        "The same objects, points and views; only what counts as hidden differs. `exact` is right in every answer, "
        f"`{METHODS[-1].label}` is the paper's. Overall accuracy in percent, mean ± standard deviation over the seeds."
    )
    note += "".join(f" `{method}` could not run here: {reason}" for method, reason in missing.items())
    return Table("Does the method of hidden-surface removal matter?", header, body, note, texts=2)
