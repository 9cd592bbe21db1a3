"""Do the paper's findings show? Differences between classifiers of one seed, their mean and spread, and a verdict."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from zbuf_occlude.compare.tables import Table
from zbuf_occlude.paper import reported as paper
from zbuf_occlude.paper.names import (
    AUGMENTATION,
    BUDGETS,
    CLOUDS,
    ELEVATION,
    EPOCHS,
    GENERATED,
    HSR,
    MAIN,
    ORIGINAL,
    REALISM,
    SPLIT_BY,
    name_of_test,
    paper_name,
    printed,
)
from zbuf_occlude.paper.realism_tables import sentence
from zbuf_occlude.paper.results import Result
from zbuf_occlude.paper.study_tables import (
    NONE,
    accuracy,
    budgets_of,
    by_method,
    curves_of,
    lost_at_zero,
    models_of,
    of,
    percent,
    published_curve,
    values,
)

MUCH = 0.05
"""Five percentage points: what "loses much" is taken to mean; the paper's two models lose 7 and 36."""


@dataclass(frozen=True)
class Finding:
    """A statement of the paper about differences of accuracy.

    Parameters
    ----------
    text : str
    better, worse : (int, str)
        Training set and test; the finding is that the first's accuracy less the second's is at least `least`.
    least : float
    """

    text: str
    better: tuple[int, str]
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
    """Say whether differences are at least `least`: yes, no, or not decided by this many seeds.

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
                found = {budget: differences(mine, finding, model, n_points, budget) for budget in budgets}
                if any(found.values()):
                    name = printed(model) + (f", {n_points:,} points" if several else "")
                    cells = [cell for each in found.values() for cell in (percent(each), verdict(each, finding.least))]
                    body.append([text, name, _published(finding, model), *cells])
                    text = ""
    return Table(
        "Do the paper's findings show?",
        [
            "the finding",
            "model",
            "the paper's difference",
            *(cell for budget in budgets for cell in (f"here, {BUDGETS[budget]}", "shows")),
        ],
        body,
        "C1 is trained on occluded clouds, C2 on complete ones, C3 on both. "
        "Percentage points; between classifiers of the same seed, mean ± standard deviation over the seeds. Shows: the "
        f"difference is at least {100 * MUCH:.0f} for the first two, at least 0 for the others; not decided: within "
        f"the standard error of the mean.{_how_often(mine)}",
        texts=2,
        last_is_text=True,
    )


def _how_often(results: Sequence[Result]) -> str:
    """Say how often each classifier was shown each cloud, and how long each was trained."""
    said = ""
    for budget, words in (
        (CLOUDS, " Equal clouds shown: C2 saw each complete cloud {0:.0f} times, C3 each of its clouds {1:.0f} times."),
        (
            EPOCHS,
            " Equal epochs: both saw each of their clouds {0:.0f} and {1:.0f} times, C3 {2:.1f} times as many in all.",
        ),
    ):
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


def _published(finding: Finding, model: str) -> str:
    numbers = next((rows for (name, _), rows in paper.TABLE_3B.items() if name == paper_name(model)), None)
    if numbers is None:
        return NONE
    (first, test), (second, other) = finding.better, finding.worse
    place = {ORIGINAL: 0, GENERATED: 1}
    return f"{numbers[first][place[test]] - numbers[second][place[other]]:.1f}"


def sentences(results: Sequence[Result]) -> list[str]:
    """Return the study's answers in a few sentences."""
    said = []
    answers = (AUGMENTATION, _of_augmentation), (HSR, _of_methods), (ELEVATION, _of_elevation), (REALISM, sentence)
    for experiment, make in answers:
        if of(results, experiment):
            said.append(make(results))
    return said


def _of_augmentation(results: Sequence[Result]) -> str:
    mine = of(results, AUGMENTATION)
    points = values(mine, "points")[-1]
    said = ""
    for budget in budgets_of(mine):
        parts = []
        for model in models_of(results, AUGMENTATION):
            rows = {s: of(mine, AUGMENTATION, model=model, set=s, points=points, budget=budget) for s in (1, 2, 3)}
            cells = [percent(map(accuracy(GENERATED), rows[s])) for s in (1, 2, 3)]
            parts.append(f"{printed(model)} {cells[0]}, {cells[1]} and {cells[2]} %")
        said += f" ({BUDGETS[budget]}) {'; '.join(parts)}."
    return (
        f"On occluded clouds, trained on occluded ones, on complete ones only, and on both:{said}{_of_complete(mine)}"
    )


def _of_complete(results: Sequence[Result]) -> str:
    """Return the answer to the last finding, under each budget."""
    finding, points = FINDINGS[-1], values(results, "points")[-1]
    parts = []
    for model in models_of(results, AUGMENTATION):
        found = {b: differences(results, finding, model, points, b) for b in budgets_of(results)}
        said = [f"{percent(each)} ({BUDGETS[b]}: {verdict(each, finding.least)})" for b, each in found.items() if each]
        if said:
            parts.append(f"{printed(model)} {', '.join(said)}, the paper {_published(finding, model)}")
    return f" C3 less C2 on complete clouds: {'; '.join(parts)}." if parts else ""


def _of_methods(results: Sequence[Result]) -> str:
    parts = []
    test = name_of_test(MAIN)
    for model in models_of(results, HSR):
        rows = by_method(results, model)
        cells = ", ".join(f"{percent(map(accuracy(test), found))} % (`{name}`)" for name, found in rows.items())
        parts.append(f"{printed(model)} {cells}")
    return f"Tested on clouds by `{MAIN.label}`, trained on clouds by another method: " + "; ".join(parts) + "."


def _of_elevation(results: Sequence[Result]) -> str:
    parts = []
    for model in models_of(results, ELEVATION):
        lost = " and ".join(
            percent(map(lost_at_zero, curves)) for split in SPLIT_BY if (curves := curves_of(results, model, split))
        )
        parts.append(f"{printed(model)} {lost} (the paper {percent([lost_at_zero(published_curve(model))])})")
    return (
        "Percentage points lost at the elevation 0 against ±10, with the paper's split and with objects held out: "
        + "; ".join(parts)
        + "."
    )
