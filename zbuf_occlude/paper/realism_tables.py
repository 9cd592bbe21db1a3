"""The table of `realism`, and its sentence: uniform clouds, scans, scans in streets, real objects."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from zbuf_occlude.compare.tables import Table
from zbuf_occlude.paper.names import ALONE, COUNTS, KINDS, MATCHED, OWN, REALISM, SCENES, UNIFORM, printed
from zbuf_occlude.paper.results import Confusion, Result
from zbuf_occlude.paper.study_tables import accuracy, models_of, of, percent

CAR = "car"
WORDS = {UNIFORM: "uniform clouds", ALONE: "scans of single objects", SCENES: "scans in streets"}
COUNTED = {OWN: "their own", MATCHED: "matched"}


def table_realism(results: Sequence[Result], facts: Mapping[str, Any]) -> Table:
    """Return accuracies by what is trained and tested on.

    Parameters
    ----------
    results : sequence of Result
    facts : mapping
        Of `zbuf_occlude.paper.realism.RealismClouds.facts`.
    """
    mine = of(results, REALISM)
    real = sorted({test for result in mine for test in result.tests if test not in KINDS})
    body = []
    for model in models_of(results, REALISM):
        for count in COUNTS:
            for place, kind in enumerate(KINDS):
                rows = of(mine, REALISM, model=model, counts=count, trained_on=kind)
                if not rows:
                    continue
                cells = [percent(accuracy(test)(row) for row in rows) for test in KINDS]
                for test in real:
                    cars = [cars_found(row.tests[test]) if test in row.tests else (None, None) for row in rows]
                    cells += [percent(found for found, _ in cars), percent(wrong for _, wrong in cars)]
                first = [printed(model), COUNTED[count]] if place == 0 else ["", ""]
                body.append([*first, WORDS[kind], *cells])
    header = ["model", "points", "trained on", *(f"tested on {WORDS[kind]}" for kind in KINDS)]
    for test in real:
        name = test.partition(":")[2]
        header += [f"{name}: cars found", f"{name}: others taken for cars"]
    return Table("What a sensor does to a classifier", header, body, _note(mine, facts, real), texts=3)


def cars_found(test: Confusion) -> tuple[float, float | None]:
    """Return the share of real cars that are taken for cars, and of the other objects; None without others."""
    column = test.predicted.index(CAR)
    rows = {name: test.counts[i] for i, name in enumerate(test.truth)}
    others = sum((counts for name, counts in rows.items() if name != CAR), np.zeros(len(test.predicted), dtype=int))
    cars = rows[CAR]
    return float(cars[column] / cars.sum()), float(others[column] / others.sum()) if others.sum() else None


def sentence(results: Sequence[Result]) -> str:
    """Return what training on scans gains where scans are tested, in one sentence."""
    mine, parts = of(results, REALISM), []
    for model in models_of(results, REALISM):
        shares = {
            (count, kind): percent(
                accuracy(SCENES)(row) for row in of(mine, REALISM, model=model, counts=count, trained_on=kind)
            )
            for count in COUNTS
            for kind in KINDS
        }
        cells = (", ".join(f"{shares[count, kind]}" for kind in KINDS) for count in COUNTS)
        parts.append("{} {} % (numbers of points matched: {} %)".format(printed(model), *cells))
    words = ", ".join(WORDS[kind] for kind in KINDS)
    return f"Tested on scans in streets, trained on {words}: " + "; ".join(parts) + "."


def _note(results: Sequence[Result], facts: Mapping[str, Any], real: Sequence[str]) -> str:
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
