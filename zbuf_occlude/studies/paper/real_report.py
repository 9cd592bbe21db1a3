"""Tables and plots of experiment `real`, from its stored results."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from zbuf_occlude.base.arrays import FloatArray
from zbuf_occlude.drawing.pages import NONE, Table
from zbuf_occlude.drawing.pictures import canvas
from zbuf_occlude.studies.learn.evaluation import Confusion
from zbuf_occlude.studies.paper.design import (
    ALL_AROUND,
    COMPLETE,
    COMPLETE_AND_OCCLUDED,
    COMPLETE_AND_SCANS,
    DRIVE,
    FITTED,
    FITTED_ON,
    HELD_OUT,
    LIDAR,
    OCCLUDED,
    REAL,
    REAL_OBJECTS,
    RECIPES,
    SIMULATED,
    printed,
)
from zbuf_occlude.studies.paper.results import Result, models_of, percent, select_results

WORDS = {
    COMPLETE: "complete clouds (C2)",
    OCCLUDED: "occluded clouds (C1)",
    COMPLETE_AND_OCCLUDED: "both (C3)",
    LIDAR: "simulated LiDAR scans",
    COMPLETE_AND_SCANS: "complete clouds and scans",
}
AZIMUTHS = {ALL_AROUND: "all", DRIVE: "of traffic"}
MEASURES = ("accuracy", "mean recall")
MAIN_CLASSES = ("car", "pedestrian", "cyclist")
"""Classes of which every drive has some."""


def mean_recall(test: Confusion, classes: Sequence[str] | None = None) -> float:
    """Return the mean recall over classes, by default all that have clouds."""
    known = [
        recall
        for name, recall in zip(test.truth, test.recall, strict=True)
        if not np.isnan(recall) and (classes is None or name in classes)
    ]
    return float(np.mean(known)) if known else float("nan")


def recipes_of(results: Sequence[Result]) -> list[tuple[str, str, str]]:
    """Return the training sets, azimuths and scales of results, in the order of the experiment."""
    found = {tuple(result.facts[name] for name in ("trained_on", "azimuths", "scale")) for result in results}
    return [recipe for recipe in RECIPES if recipe in found]


def rows_of(results: Sequence[Result], model: str, recipe: tuple[str, str, str]) -> list[Result]:
    """Return the results of a model and a recipe, in the order of their seeds."""
    name, azimuths, scale = recipe
    return select_results(results, REAL, model=model, trained_on=name, azimuths=azimuths, scale=scale)


def table_real(results: Sequence[Result], facts: Mapping[str, Any]) -> Table:
    """Return the main table: each model and training set, tested on real objects and on simulated scans."""
    mine, body = select_results(results, REAL), []
    for model in models_of(mine, REAL):
        for place, recipe in enumerate(recipes_of(mine)):
            rows = rows_of(mine, model, recipe)
            tests = [row.tests[REAL_OBJECTS] for row in rows]
            name, azimuths, scale = recipe
            body.append(
                [
                    "" if place else printed(model),
                    WORDS[name],
                    AZIMUTHS[azimuths] if LIDAR in name else NONE,
                    "metres" if scale == "metres" else "1",
                    percent([test.accuracy for test in tests]),
                    percent([mean_recall(test) for test in tests]),
                    percent([mean_recall(test, MAIN_CLASSES) for test in tests]),
                    percent([mean_recall(row.tests[SIMULATED]) for row in rows]),
                ]
            )
    objects = ", ".join(f"{n} {name}" for name, n in facts["objects"].items())
    low, high = facts["range"]
    note = (
        f"Percent, mean ± standard deviation over the seeds. Real objects: {objects}, of {facts['sweeps']} sweeps, "
        f"with at least {facts['least']} points, {low:g} to {high:g} m away. Scale 1: each cloud is scaled to its "
        "longest side; metres: no cloud is. All classifiers of a model are shown equally many clouds. "
        f"{agreement(mine)}"
    )
    header = ["model", "trained on", "azimuths of scans", "scale", "accuracy", "mean recall"]
    header += [f"mean recall of {', '.join(MAIN_CLASSES)}", "simulated scans: mean recall"]
    return Table("Trained on generated clouds, tested on real objects", header, body, note, texts=range(4))


def table_by_fit(results: Sequence[Result]) -> Table:
    """Return the table of each model and training set on objects of sweeps held out from fitting, and on the others."""
    mine, body = select_results(results, REAL), []
    for model in models_of(mine, REAL):
        for place, recipe in enumerate(recipes_of(mine)):
            row: list[str] = ["" if place else printed(model), recipe_in_words(recipe)]
            for test in (HELD_OUT, FITTED):
                found = [each.tests[test] for each in rows_of(mine, model, recipe)]
                row.append(percent([test.accuracy for test in found]))
                row.append(percent([mean_recall(test, MAIN_CLASSES) for test in found]))
            body.append(row)
    said = []
    for test, words in ((HELD_OUT, "held out"), (FITTED, "fitted")):
        truth, counts = mine[0].tests[test].truth, mine[0].tests[test].counts.sum(axis=1).tolist()
        said.append(
            f"{words}: {', '.join(f'{n} {name}' for n, name in zip(counts, truth, strict=True) if n) or 'none'}"
        )
    note = (
        f"Percent. Mean recall is that of {', '.join(MAIN_CLASSES)}. The windows of simulated vehicles were fitted on "
        f"KITTI's sweeps {', '.join(FITTED_ON)}; all others are held out. Objects {'; '.join(said)}."
    )
    header = ["model", "training set", *(f"{what}, {where}" for where in ("held out", "fitted") for what in MEASURES)]
    return Table("Sweeps held out from fitting", header, body, note, texts=range(2))


def agreement(results: Sequence[Result]) -> str:
    """Return the rank correlation of both tests over the training sets, as a sentence for each model."""
    said = []
    for model in models_of(results, REAL):
        rows = [rows_of(results, model, recipe) for recipe in recipes_of(results)]
        pairs = np.array(
            [[np.mean([mean_recall(row.tests[test]) for row in each]) for test in (REAL_OBJECTS, SIMULATED)]
             for each in rows if each]
        )  # fmt: skip
        if len(pairs) > 2:
            said.append(f"{printed(model)} {spearman(*pairs.T):.2f}")
    return f"Rank correlation of both tests' mean recall over the rows: {', '.join(said)}." if said else ""


def spearman(first: FloatArray, second: FloatArray) -> float:
    """Return the rank correlation of two series, equal values with their mean rank; NaN where one is constant."""
    ranks = [(each[:, None] > each).sum(axis=1) + (each[:, None] == each).sum(axis=1) / 2 for each in (first, second)]
    if any(np.ptp(each) == 0.0 for each in ranks):
        return float("nan")
    return float(np.corrcoef(ranks)[0, 1])


def table_by_range(results: Sequence[Result]) -> Table:
    """Return the table of mean recall by range, of each model's best training set."""
    mine = select_results(results, REAL)
    names = [name for name in mine[0].tests if name.startswith(f"{REAL_OBJECTS} ")]
    names.sort(key=lambda name: float(name.removeprefix(REAL_OBJECTS).partition("-")[0]))
    counts = [mine[0].tests[name].n_clouds for name in names]
    body = []
    for model in models_of(mine, REAL):
        recipe = best_recipe(mine, model)
        rows = rows_of(mine, model, recipe)
        cells = [percent([mean_recall(row.tests[name]) for row in rows]) for name in names]
        body.append([printed(model), recipe_in_words(recipe), *cells])
    header = ["model", "best training set"]
    header += [f"{name.removeprefix(REAL_OBJECTS).strip()} ({n})" for name, n in zip(names, counts, strict=True)]
    note = "Mean recall on real objects, percent; in brackets the objects of the column."
    return Table("By range", header, body, note, texts=range(2))


def best_recipe(results: Sequence[Result], model: str) -> tuple[str, str, str]:
    """Return the recipe with the highest mean recall of the main classes on real objects."""

    def recall(recipe: tuple[str, str, str]) -> float:
        rows = rows_of(results, model, recipe)
        return float(np.mean([mean_recall(row.tests[REAL_OBJECTS], MAIN_CLASSES) for row in rows]))

    return max((recipe for recipe in recipes_of(results) if rows_of(results, model, recipe)), key=recall)


def recipe_in_words(recipe: tuple[str, str, str]) -> str:
    """Return a recipe in words."""
    name, azimuths, scale = recipe
    said = WORDS[name] + (f", azimuths {AZIMUTHS[azimuths]}" if LIDAR in name else "")
    return said + (", metres" if scale == "metres" else "")


def plot_confusions(results: Sequence[Result]) -> Figure:
    """Plot the confusion matrix of each model's best training set on real objects, as fractions over all seeds."""
    mine = select_results(results, REAL)
    models = models_of(mine, REAL)
    figure, panels = canvas(4.2 * len(models), 4.6, len(models))
    figure.set_layout_engine("constrained")  # titles of two lines
    for panel, model in zip(panels, models, strict=True):
        recipe = best_recipe(mine, model)
        tests = [row.tests[REAL_OBJECTS] for row in rows_of(mine, model, recipe)]
        counts = np.sum([test.counts for test in tests], axis=0)
        shares = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
        panel.grid(visible=False)
        panel.imshow(shares, cmap="Blues", vmin=0.0, vmax=1.0)
        for row, column in np.argwhere(counts > 0):
            colour = "white" if shares[row, column] > 0.6 else "black"
            panel.text(column, row, f"{shares[row, column]:.0%}", ha="center", va="center", fontsize=8, color=colour)
        panel.set_xticks(range(counts.shape[1]), tests[0].predicted, rotation=45, ha="right")
        panel.set_yticks(range(counts.shape[0]), tests[0].truth)
        panel.set_title(f"{printed(model)}\n{recipe_in_words(recipe)}", fontsize=9)
    panels[0].set_ylabel("true class", fontsize=10)
    figure.supxlabel("answered class", fontsize=10)
    return figure
