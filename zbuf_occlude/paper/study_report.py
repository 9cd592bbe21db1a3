"""The report of a study: study.html (one self-contained file), study.md and plots, from stored results alone."""

import json
from collections.abc import Collection, Sequence
from pathlib import Path
from string import Template
from typing import Any

import numpy as np

from zbuf_occlude.compare.report import as_png, image
from zbuf_occlude.compare.tables import Table, marked_up, verbatim
from zbuf_occlude.drawing.pages import asset
from zbuf_occlude.errors import DatasetError
from zbuf_occlude.paper import reported as paper
from zbuf_occlude.paper.findings import sentences, table_of_findings
from zbuf_occlude.paper.names import (
    AUGMENTATION,
    BUDGETS,
    ELEVATION,
    HSR,
    METHODS,
    REALISM,
    SCANS,
    described,
    printed,
)
from zbuf_occlude.paper.realism_tables import table_realism
from zbuf_occlude.paper.results import AREAS, PICTURE, Result, read_results, read_study
from zbuf_occlude.paper.study_plots import all_plots
from zbuf_occlude.paper.study_tables import (
    budgets_of,
    dead_angle,
    models_of,
    of,
    table_3a,
    table_3b,
    table_methods,
)

TITLE = "Classifiers of occluded clouds: the paper's experiments again"
CAPTIONS = {
    "elevation": "Above: accuracy against the camera's elevation. Below: how much of an object is seen from there, as "
    "areas projected on three planes (Fig. 12; mean over objects, each object's largest 100 %).",
    "augmentation": "Test 1 and Test 2 by training set: bars are means, dots seeds, black lines the paper's numbers "
    "(of 12,000 points).",
    "scans": "The largest scans of some classes from the side, as they are used: wheels and trunks belong below.",
    "methods": "Trained on the clouds of one method, tested on those of each: bars are means, dots seeds.",
}


def write_study(folder: Path) -> list[Path]:
    """Write the report of a study's folder.

    Parameters
    ----------
    folder : Path
        Holds study.json, and results as far as there are any.

    Returns
    -------
    list of Path
        study.html, study.md and the plots.

    Raises
    ------
    DatasetError
        There is no study or no result, or a damaged file.

    Notes
    -----
    Trains and tests nothing. The page holds everything it shows; the Markdown refers to the plots beside it.
    """
    study, results = read_study(folder), read_results(folder)
    if not results:
        raise DatasetError(f"{folder} must hold results; it has none. Run: zbuf-occlude experiment all --out {folder}")
    areas, scans = read_areas(folder), folder / PICTURE
    figures = {name: as_png(figure) for name, figure in all_plots(results, areas).items()}
    if study.get("scans") and scans.exists():
        figures[scans.stem] = scans.read_bytes()
    written = []
    for name, png in figures.items():
        written.append(folder / f"{name}.png")
        written[-1].write_bytes(png)
    first, sections = opening(study, results), list(sections_of(study, results, areas, figures))
    page, text = folder / "study.html", folder / "study.md"
    page.write_text(as_html(first, sections, figures), encoding="utf-8")
    text.write_text(as_markdown(first, sections), encoding="utf-8")
    return [page, text, *written]


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


def opening(study: dict[str, Any], results: Sequence[Result]) -> list[str]:
    """Return the report's first sentences: the answers, then what they were measured on."""
    machines = sorted({result.document["machine"] for result in results})
    devices = sorted({result.document["device"] for result in results})
    seconds = sum(result.document["seconds"] for result in results)
    size = study["size"]
    facts = (
        f'The study "{size["name"]}" ({size["summary"]}) of {verbatim(study["objects"])}, begun {study["date"]}: '
        f"{len(results)} classifiers, {seconds / 60:.0f} minutes of training on {', '.join(devices)}; "
        f"{'; '.join(machines)}. {_guessing(results)} The paper: {paper.CITATION}."
    )
    if scans := study.get("scans"):
        facts += f" Real scans: {scans['said']}"
    if failed := study["failed_meshes"]:
        facts += f" {len(failed)} mesh{'es' * (len(failed) > 1)} could not be used: {verbatim(', '.join(failed))}."
    return [*sentences(results), facts]


def _guessing(results: Sequence[Result]) -> str:
    counts = sorted({len(test.predicted) for result in results for test in result.tests.values()})
    return f"Guessing would be right in {' or '.join(f'{100 / n:.1f} % (of {n} classes)' for n in counts)}."


def sections_of(
    study: dict[str, Any], results: Sequence[Result], areas: dict[str, Any] | None, figures: Collection[str]
) -> Sequence[Table | str]:
    """Return the tables of the report and the names of its plots, in their order."""
    sections: list[Table | str] = []
    if of(results, AUGMENTATION):
        sections += [table_of_findings(results), "augmentation", table_3b(results)]
    if SCANS in figures:
        sections.append(SCANS)
    if of(results, HSR):
        sections += ["methods", table_methods(results, study["missing_methods"])]
    if of(results, ELEVATION):
        sections += ["elevation", table_3a(results), dead_angle(results, areas)]
    ends: list[Table | str] = [departures(study)] if sections else []  # of the paper's experiments
    if of(results, REALISM):
        sections.append(table_realism(results, study["realism"]))
    return [*sections, trainings(results), *ends]


def trainings(results: Sequence[Result]) -> Table:
    """Return how the classifiers were trained."""
    body = []
    kinds = [(AUGMENTATION, {"budget": budget}) for budget in budgets_of(results)] + [
        (name, {}) for name in (HSR, ELEVATION, REALISM)
    ]
    for experiment, facts in kinds:
        for model in models_of(results, experiment):
            rows = [result.document for result in of(results, experiment, model=model, **facts)]
            if not rows:
                continue
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
        "the best validation counts. "
        "Seconds: mean of a training, validation included.",
        texts=2,
    )


def _range(counts: Any) -> str:
    low, high = min(found := list(counts)), max(found)
    return f"{low:,}" if low == high else f"{low:,} to {high:,}"


def departures(study: dict[str, Any]) -> Table:
    """Return what is done otherwise than in the paper, and where the paper does not say."""
    size = study["size"]
    points = " and ".join(f"{n:,}" for n in size["n_points"])
    rows = [
        [
            "hidden surfaces",
            "occupancy grid, 32³ (4.2) and 64³ (4.3)",
            f"`{METHODS[0].label}`: what a camera sees; the grid's effect is measured by itself",
        ],
        ["objects", "of ModelNet40", study["objects"]],
        [
            "elevation: objects × views × samplings",
            "200 × 100 × 10",
            f"{_objects(size)} × the paper's, at most {size['azimuths']} at an elevation × "
            f"{size['variations']}, {size['elevation_points']:,} points",
        ],
        [
            "augmentation: objects of a class, views, points",
            "40 + 10 + 25, 25, 12,000 and 1,024",
            f"{' + '.join(map(str, size['shares']))}, {size['views']}, {points}",
        ],
        ["runs", "one", f"{len(size['seeds'])} seeds ({len(size['elevation_seeds'])} for elevation)"],
        ["models of 4.2", "VoxNet, PointNet, 3DmFV", ", ".join(map(described, size["models"]))],
        ["models of 4.3", "VoxNet, 3DmFV", ", ".join(map(described, size["augmentation_models"]))],
        ["optimiser, epochs, validation in 4.2", "not said", "as in the table above; 10 % of the training clouds"],
    ]
    return Table("What is done otherwise than in the paper", ["", "the paper", "here"], rows, texts=3)


def _objects(size: dict[str, Any]) -> str:
    return "200" if size["elevation_each"] is None else f"{size['elevation_each']} of each class"


def as_html(first: Sequence[str], sections: Sequence[Table | str], figures: dict[str, bytes]) -> str:
    """Return the page."""
    *answers, facts = first
    parts = [
        f"<h2>{_heading(one)}</h2>{image(figures[one], CAPTIONS[one])}<p class=note>{marked_up(CAPTIONS[one])}</p>"
        if isinstance(one, str)
        else one.as_html()
        for one in sections
    ]
    return Template(asset("study.html")).substitute(
        title=TITLE,
        style=asset("page.css"),
        opening="".join(
            [f"<p class=lead>{marked_up(s)}</p>" for s in answers] + [f"<p class=facts>{marked_up(facts)}</p>"]
        ),
        sections="\n".join(parts),
    )


def as_markdown(first: Sequence[str], sections: Sequence[Table | str]) -> str:
    """Return the same in Markdown, plots as files beside it."""
    parts = [f"# {TITLE}\n", *(f"{sentence}\n" for sentence in first)]
    parts += [
        f"## {_heading(one)}\n\n![{CAPTIONS[one]}]({one}.png)\n\n{CAPTIONS[one]}\n"
        if isinstance(one, str)
        else one.as_markdown()
        for one in sections
    ]
    return "\n".join(parts)


def _heading(name: str) -> str:
    return {ELEVATION: "Elevation of the camera", AUGMENTATION: "Training sets", HSR: "Methods", SCANS: "Real scans"}[
        name
    ]
