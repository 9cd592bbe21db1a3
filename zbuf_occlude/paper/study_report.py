"""The report of a study: study.html (one self-contained file), study.md and plots, from stored results alone."""

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from zbuf_occlude.compare.plots import GREY, canvas
from zbuf_occlude.drawing.pages import Picture, Section, Table, as_png, verbatim, write_report
from zbuf_occlude.errors import DatasetError
from zbuf_occlude.paper import reported
from zbuf_occlude.paper.design import (
    AUGMENTATION,
    BUDGETS,
    ELEVATION,
    GENERATED,
    HSR,
    METHODS,
    ORIGINAL,
    REALISM,
    SCANS,
    SPLIT_BY,
    described,
    name_of_test,
    paper_name,
    printed,
)
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
from zbuf_occlude.paper.study_tables import (
    answers,
    by_method,
    dead_angle,
    table_3a,
    table_3b,
    table_methods,
    table_of_findings,
    table_realism,
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
PLANES = ("#882255", "#cc79a7", "#56b4e9")
SETS = {1: "#56b4e9", 2: "#d55e00", 3: "#009e73"}


def write_study(folder: Path) -> list[Path]:
    """Write the report of a study's folder; return the paths of study.html, study.md and the plots.

    Trains and tests nothing. The page holds everything it shows; the Markdown refers to the plots beside it. Raises
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
    facts = [measured_on(study, results)]
    return write_report(folder, "study", TITLE, answers=answers(results), facts=facts, sections=sections)


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


def measured_on(study: Mapping[str, Any], results: Sequence[Result]) -> str:
    """Return what the answers were measured on."""
    documents, size = [result.document for result in results], study["size"]
    devices, machines = (sorted({row[what] for row in documents}) for what in ("device", "machine"))
    n_classes = sorted({len(test.predicted) for result in results for test in result.tests.values()})
    chances = " or ".join(f"{100 / n:.1f} % (of {n} classes)" for n in n_classes)
    text = (
        f'The study "{size["name"]}" ({size["summary"]}) of {verbatim(study["objects"])}, begun {study["date"]}: '
        f"{len(results)} classifiers, {sum(row['seconds'] for row in documents) / 60:.0f} minutes of training on "
        f"{', '.join(devices)}; {'; '.join(machines)}. Guessing would be right in {chances}. "
        f"The paper: {reported.CITATION}."
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
    levels = reported.TEST_ELEVATIONS
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
            published = reported.TABLE_3A[paper_name(model)]
            above.plot(levels, published, color=tint, linewidth=1.0, linestyle=(0, (4, 3)), alpha=0.55)
        for column, tint in enumerate(PLANES if areas else ()):
            assert areas is not None
            mean, label = [100 * row[column] for row in areas["mean"]], f"onto {areas['planes'][column]}"
            below.plot(areas["elevations"], mean, color=tint, marker="o", markersize=3, label=label)
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
    groups = [
        (model, n_points, budget)
        for n_points in sorted(values(mine, "points"), reverse=True)
        for model in models_of(results, AUGMENTATION)
        for budget in budgets_of(mine)
    ]
    figure, panels = canvas(11.0, 3.9, 2, sharey=True)
    tests = ((ORIGINAL, "Test 1: complete clouds"), (GENERATED, "Test 2: occluded clouds"))
    for place, (panel, (test, words)) in enumerate(zip(panels, tests, strict=True)):
        panel.set_title(words, fontsize=11, color=GREY)
        for group, (model, n_points, budget) in enumerate(groups):
            name = paper_name(model)
            published = reported.TABLE_3B.get((name, n_points)) or reported.TABLE_3B.get((name, 12_000))
            for training_set, kind in reported.TRAINING_SETS.items():
                rows = of(mine, AUGMENTATION, model=model, points=n_points, set=training_set, budget=budget)
                at = group + 0.27 * (training_set - 2)
                label = f"C{training_set}: {kind}" if group == 0 else None
                _bars(panel, at, rows, test, SETS[training_set], label)
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
                _bars(panel, at, rows, test, PLANES[place], method if group == 0 else None)
        panel.set_xticks(range(len(tests)), ["complete", *(method.label.replace(":", "\n") for method in METHODS)])
        panel.set_xlabel("tested on", fontsize=10)
    panels[0].set_ylabel("accuracy, %", fontsize=10)
    _legend(panels[-1], "trained on")
    return figure
