"""A study's plots: accuracy against elevation with the areas seen below, training sets, methods of HSR."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from zbuf_occlude.compare.plots import GREY, dressed
from zbuf_occlude.paper import reported as paper
from zbuf_occlude.paper.names import (
    AUGMENTATION,
    BUDGETS,
    ELEVATION,
    GENERATED,
    HSR,
    METHODS,
    ORIGINAL,
    SPLIT_BY,
    name_of_test,
    paper_name,
    printed,
)
from zbuf_occlude.paper.results import Result
from zbuf_occlude.paper.study_tables import budgets_of, by_method, models_of, of, values

COLOURS = {"voxnet": "#0072b2", "pointnet": "#d55e00", "threedmfv": "#009e73"}
PLANES = ("#882255", "#cc79a7", "#56b4e9")
SETS = {1: "#56b4e9", 2: "#d55e00", 3: "#009e73"}


def all_plots(results: Sequence[Result], areas: dict[str, Any] | None) -> dict[str, Figure]:
    """Return every plot that there are results for, by file name without its ending."""
    figures = {}
    if of(results, ELEVATION):
        figures["elevation"] = accuracy_against_elevation(results, areas)
    if of(results, AUGMENTATION):
        figures["augmentation"] = training_sets(results)
    if of(results, HSR):
        figures["methods"] = methods(results)
    return figures


def accuracy_against_elevation(results: Sequence[Result], areas: dict[str, Any] | None) -> Figure:
    """Accuracy against elevation, a panel a split, the paper's dashed; below them the projected areas of Fig. 12."""
    figure = Figure(figsize=(11.0, 6.6), layout="constrained", facecolor="white")
    FigureCanvasAgg(figure)
    panels = figure.subplots(2, len(SPLIT_BY), sharex=True, sharey="row", height_ratios=(1.45, 1.0))
    for (above, below), (split, words) in zip(panels.T, SPLIT_BY.items(), strict=True):
        dressed(above)
        dressed(below)
        above.set_title(words, fontsize=11, color=GREY)
        for model in models_of(results, ELEVATION):
            tint = COLOURS[paper_name(model)]
            curves = np.array(
                [
                    [100 * row.tests[str(e)].accuracy if str(e) in row.tests else np.nan for e in paper.TEST_ELEVATIONS]
                    for row in of(results, ELEVATION, model=model, split=split)
                ]
            )
            if curves.size:
                above.plot(
                    paper.TEST_ELEVATIONS, curves.mean(axis=0), color=tint, marker="o", markersize=4,
                    label=printed(model),
                )  # fmt: skip
                _band(above, paper.TEST_ELEVATIONS, curves, tint)
            published = paper.TABLE_3A[paper_name(model)]
            above.plot(paper.TEST_ELEVATIONS, published, color=tint, linewidth=1.0, linestyle=(0, (4, 3)), alpha=0.55)
        if areas:
            for plane, tint, column in zip(areas["planes"], PLANES, range(3), strict=True):
                mean = [100 * row[column] for row in areas["mean"]]
                below.plot(areas["elevations"], mean, color=tint, marker="o", markersize=3, label=f"onto {plane}")
        below.set_xticks(range(-90, 91, 30))
        below.set_xlabel("elevation of the camera, degrees", fontsize=10)
        below.set_ylim(0, 102)
    panels[0, 0].set_ylabel("accuracy, % (dashed: the paper's)", fontsize=10)
    panels[1, 0].set_ylabel("projected area seen,\n% of an object's largest", fontsize=10)
    for row in panels:
        if row[-1].get_legend_handles_labels()[0]:
            row[-1].legend(fontsize=9, frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


def training_sets(results: Sequence[Result]) -> Figure:
    """Accuracy in Test 1 and Test 2 by training set: a bar per mean, a dot per seed, a line for the paper's number."""
    mine = of(results, AUGMENTATION)
    kinds = [
        (model, n_points, budget)
        for n_points in sorted(values(mine, "points"), reverse=True)
        for model in models_of(results, AUGMENTATION)
        for budget in budgets_of(mine)
    ]
    figure = Figure(figsize=(11.0, 3.9), layout="constrained", facecolor="white")
    FigureCanvasAgg(figure)
    panels = figure.subplots(1, 2, sharey=True)
    for place, (panel, test, words) in enumerate(
        zip(panels, (ORIGINAL, GENERATED), ("Test 1: complete clouds", "Test 2: occluded clouds"), strict=True)
    ):
        dressed(panel)
        panel.set_title(words, fontsize=11, color=GREY)
        for group, (model, n_points, budget) in enumerate(kinds):
            for training_set, kind in paper.TRAINING_SETS.items():
                rows = of(mine, AUGMENTATION, model=model, points=n_points, set=training_set, budget=budget)
                shares = [100 * row.tests[test].accuracy for row in rows if test in row.tests]
                at = group + 0.27 * (training_set - 2)
                _bar(panel, at, shares, SETS[training_set], f"C{training_set}: {kind}" if group == 0 else None)
                published = paper.TABLE_3B.get((paper_name(model), n_points)) or next(
                    (numbers for (name, _), numbers in paper.TABLE_3B.items() if name == paper_name(model)), None
                )
                if published:
                    panel.plot([at - 0.12, at + 0.12], [published[training_set][place]] * 2, color="#222222", lw=1.6)
        panel.set_xticks(range(len(kinds)), ["\n".join(words) for words in _names(kinds)], fontsize=8)
    panels[0].set_ylabel("accuracy, % (line: the paper's)", fontsize=10)
    panels[1].legend(fontsize=9, frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5), title="trained on")
    return figure


def _names(kinds: Sequence[tuple[str, int, str]]) -> list[list[str]]:
    """Return what groups of bars are called: the model, and what else differs between them."""
    points, budgets = (len({kind[at] for kind in kinds}) > 1 for at in (1, 2))
    return [
        [printed(m)] + [f"{p:,} points"] * points + [BUDGETS[b].replace("equal ", "equal\n", 1)] * budgets
        for m, p, b in kinds
    ]


def methods(results: Sequence[Result]) -> Figure:
    """Accuracy of classifiers trained on the clouds of each method, on those of each: means as bars, seeds as dots."""
    models = models_of(results, HSR)
    figure = Figure(figsize=(11.0, 3.6), layout="constrained", facecolor="white")
    FigureCanvasAgg(figure)
    panels = figure.subplots(1, len(models), sharey=True, squeeze=False)[0]
    tests = [ORIGINAL, *map(name_of_test, METHODS)]
    for panel, model in zip(panels, models, strict=True):
        dressed(panel)
        panel.set_title(printed(model), fontsize=11, color=GREY)
        for place, (method, rows) in enumerate(by_method(results, model).items()):
            for group, test in enumerate(tests):
                shares = [100 * row.tests[test].accuracy for row in rows if test in row.tests]
                _bar(panel, group + 0.27 * (place - 1), shares, PLANES[place], method if group == 0 else None)
        panel.set_xticks(range(len(tests)), ["complete", *(method.label.replace(":", "\n") for method in METHODS)])
        panel.set_xlabel("tested on", fontsize=10)
    panels[0].set_ylabel("accuracy, %", fontsize=10)
    panels[-1].legend(fontsize=9, frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5), title="trained on")
    return figure


def _bar(panel: Axes, at: float, shares: Sequence[float], colour: str, label: str | None) -> None:
    if shares:
        panel.bar(at, float(np.mean(shares)), width=0.25, color=colour, alpha=0.55, label=label)
        panel.plot([at] * len(shares), shares, color=colour, marker="o", markersize=3.5, linestyle="none")


def _band(panel: Axes, elevations: Sequence[int], curves: Any, colour: str) -> None:
    if len(curves) > 1:
        panel.fill_between(elevations, curves.min(axis=0), curves.max(axis=0), color=colour, alpha=0.15)
