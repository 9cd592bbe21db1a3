"""The report of a comparison: report.html (one self-contained file), report.md and plots, from stored rows alone."""

import base64
import io
from collections.abc import Callable, Sequence
from pathlib import Path
from string import Template
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from zbuf_occlude.compare import tables
from zbuf_occlude.compare.plots import all_plots
from zbuf_occlude.compare.store import ROWS, Store
from zbuf_occlude.compare.summary import Row, Standing, milliseconds, share, standings
from zbuf_occlude.compare.tables import Table, marked_up
from zbuf_occlude.drawing.pages import asset, json_for_page, pack_cloud, viewer_script
from zbuf_occlude.errors import DatasetError

TITLE = "Hidden-surface removal: how wrong, how fast, when to use which"
OUTCOMES = (
    ("truly hidden", (208, 212, 216), False),
    ("truly visible", (86, 132, 180), True),
    ("false visible: shown, but hidden", (213, 94, 0), True),
    ("false hidden: dropped, but visible", (148, 0, 130), True),
)
"""Name, colour and whether it is shown at first, by the outcome's number in `metrics`."""
CAPTIONS = {
    "pareto": "Left and low is good. The grey staircase joins what nothing beats in both error and time.",
    "resolution": "Error against resolution and against the size of the grid",
    "elevation": "Error against the camera's elevation",
    "where": "Where the errors lie: distance from the nearest silhouette, angle of incidence",
    "scaling": "How cost grows: N points, M faces; exponents fitted to the three largest",
}
DPI = 110


def write_report(folder: Path, extra_tables: Callable[[Sequence[Row]], list[Table]] = lambda rows: []) -> list[Path]:
    """Write the report of a comparison's folder.

    Parameters
    ----------
    folder : Path
        Holds rows.jsonl, and what belongs to its worst views.
    extra_tables : callable, optional
        From all rows to further tables, such as those of presets.

    Returns
    -------
    list of Path
        report.html, report.md and the plots.

    Raises
    ------
    DatasetError
        No rows, or a damaged file.

    Notes
    -----
    Computes no visibility. The HTML holds everything it shows; the Markdown refers to the plots beside it.
    """
    store = Store(folder)
    rows = list(store.rows().values())
    if not rows:
        raise DatasetError(
            f"{folder} must hold a comparison's {ROWS} with rows; it has none. Run compare --out {folder}."
        )
    judged = [row for row in rows if row["suite"] == "meshes"]
    ranking = standings(judged)
    figures = {name: as_png(figure) for name, figure in all_plots(rows).items()}
    written = []
    for name, png in figures.items():
        written.append(folder / f"{name}.png")
        written[-1].write_bytes(png)
    sections: list[Table | str] = ["resolution", "elevation", "where", *extra_tables(rows), "scaling"]
    if ranking:
        sections += [tables.all_subjects(ranking), tables.by_mesh(judged)]
    if failed := tables.failures(rows):
        sections.append(failed)
    sections.append(definitions(rows))
    sections = [s for s in sections if isinstance(s, Table) or s in figures]
    page, text = folder / "report.html", folder / "report.md"
    page.write_text(as_html(store, rows, ranking, figures, sections), encoding="utf-8")
    text.write_text(as_markdown(rows, ranking, figures, sections), encoding="utf-8")
    return [page, text, *written]


def opening(rows: Sequence[Row], ranking: Sequence[Standing]) -> list[str]:
    """Return the report's first sentences: the finding, and what it was measured on."""
    ok = [row for row in rows if row["status"] == "ok"]
    cases = {row["case"] for row in ok}
    renderers = sorted({row["timed"]["renderer"] for row in ok} - {"none"})
    facts = f"{len(ok)} rows on {len(cases)} meshes or cases; {', '.join(sorted({row['machine'] for row in rows}))}; "
    facts += f"OpenGL: {', '.join(renderers) or 'not used'}"
    if any(word in name.lower() for name in renderers for word in ("llvmpipe", "softpipe", "swrast")):
        facts += " (a software rasteriser: on a GPU the times of methods that render are others)"
    sentences = [facts + "."]
    right = [s for s in ranking if s.wrong == 0.0]
    if right:
        best = min(right, key=lambda s: s.seconds)
        least = next((s for s in ranking if s.method == "depth_buffer"), None)
        finding = (
            f"**`{best.subject}`** was right in all {best.pairs:,} judged answers and took "
            f"{milliseconds(best.seconds)} ms per view"
        )
        if least and least.wrong > 0:
            finding += f"; the best depth buffer errs {share(least.wrong)} in {milliseconds(least.seconds)} ms"
        if grids := [s for s in ranking if s.method == "occupancy_grid"]:
            low, high = min(s.wrong for s in grids), max(s.wrong for s in grids)
            finding += f"; the paper's occupancy grid errs {share(low)} to {share(high)}"
        sentences.insert(0, finding + ".")
    return sentences


def definitions(rows: Sequence[Row]) -> Table:
    """Return what the report's words mean."""
    judged = [row["judged"] for row in rows if row["status"] == "ok" and "judged" in row]
    band = max((j["band"] for j in judged), default=0.0)
    words = [
        ["wrong", "the answer differs from the judge's: `oracle`, brute force over all faces in float64"],
        ["false visible", "the method shows a point that the judge finds hidden"],
        ["false hidden", "the method drops a point that the judge finds visible"],
        [
            "boundary band",
            "pairs whose answer changes when the line's end moves by 1e-6 of the diagonal, or with half or twice the "
            f"contact tolerance; at most {share(band)} of the pairs of a row",
        ],
        ["footprint", "what a pixel of a 512 x 512 image around the mesh covers: 1/512 of its diagonal"],
        [
            "time a view",
            "median wall clock of a call with all views, divided by them; warmed up, preparing not counted",
        ],
    ]
    return Table("Words", ["", ""], words, texts=2)


def as_html(
    store: Store,
    rows: Sequence[Row],
    ranking: Sequence[Standing],
    figures: dict[str, bytes],
    sections: Sequence[Table | str],
) -> str:
    """Return the page."""
    lead, *facts = opening(rows, ranking) if ranking else ["", *opening(rows, ranking)]
    data = worst_views(store, rows, ranking)
    parts = [
        f"<h2>{CAPTIONS[one]}</h2>{image(figures[one], CAPTIONS[one])}" if isinstance(one, str) else one.as_html()
        for one in sections
    ]
    return Template(asset("report.html")).substitute(
        title=TITLE,
        style=asset("page.css"),
        opening="".join(
            [f"<p class=lead>{marked_up(lead)}</p>", *(f"<p class=facts>{marked_up(fact)}</p>" for fact in facts)]
        ),
        answer=tables.answer(ranking).as_html() if ranking else "",
        pareto=(
            image(figures["pareto"], "error against time") + f"<figcaption class=note>{CAPTIONS['pareto']}</figcaption>"
            if "pareto" in figures
            else ""
        ),
        viewer=_viewer_html() if data["clouds"] else "",
        sections="\n".join(parts),
        viewer_script=viewer_script(),
        data=json_for_page(data),
        page_script=asset("report.js"),
    )


def as_markdown(
    rows: Sequence[Row], ranking: Sequence[Standing], figures: dict[str, bytes], sections: Sequence[Table | str]
) -> str:
    """Return the same in Markdown, plots as files beside it."""
    parts = [f"# {TITLE}\n", *(f"{sentence}\n" for sentence in opening(rows, ranking))]
    if ranking:
        parts.append(tables.answer(ranking).as_markdown())
    if "pareto" in figures:
        parts.append(f"![error against time](pareto.png)\n\n{CAPTIONS['pareto']}\n")
    parts += [
        f"## {CAPTIONS[one]}\n\n![{CAPTIONS[one]}]({one}.png)\n" if isinstance(one, str) else one.as_markdown()
        for one in sections
    ]
    return "\n".join(parts)


def worst_views(store: Store, rows: Sequence[Row], ranking: Sequence[Standing]) -> dict[str, Any]:
    """Collect what the viewer shows: each mesh's points, and the outcomes of each subject's worst view of it."""
    clouds: dict[str, Any] = {}
    order = {one.subject: i for i, one in enumerate(ranking)}
    shown = [row for row in rows if row["suite"] == "meshes" and row["status"] == "ok" and "worst" in row]
    for row in sorted(shown, key=lambda row: (row["case"], order[row["subject"]])):
        question = store.load_question(row["question"])
        if row["case"] not in clouds:
            clouds[row["case"]] = {
                **pack_cloud(
                    question["positions"],
                    centre=question["centre"],
                    longest=float(question["longest"]),
                    normals=question["normals"],
                ),
                "worst": {},
            }
        outcomes = store.load_worst(row["key"])
        towards = question["eyes"][row["worst"]["view"]] - question["centre"]
        clouds[row["case"]]["worst"][row["subject"]] = {
            "n": len(outcomes),
            "outcomes": pack_outcomes(outcomes),
            "azimuth": float(np.degrees(np.arctan2(towards[1], towards[0]))),
            "elevation": float(np.degrees(np.arcsin(towards[2] / np.linalg.norm(towards)))),
            "false_visible": row["worst"]["false_visible"],
            "false_hidden": row["worst"]["false_hidden"],
        }
    telling = [s for s in ranking if s.method == "depth_buffer"] or [s for s in ranking if s.wrong > 0] or [*ranking]
    return {
        "clouds": clouds,
        "palette": [colour for _, colour, _ in OUTCOMES],
        "first": telling[-1].subject if telling else "",
    }


def pack_outcomes(outcomes: Any) -> str:
    """Pack outcomes 0..3 four to a byte, the first lowest, as base64."""
    codes = np.zeros(-(-len(outcomes) // 4) * 4, dtype=np.uint8)
    codes[: len(outcomes)] = outcomes
    four = codes.reshape(-1, 4)
    packed = four[:, 0] | four[:, 1] << 2 | four[:, 2] << 4 | four[:, 3] << 6
    return base64.b64encode(packed.astype(np.uint8).tobytes()).decode()


def _viewer_html() -> str:
    legend = "".join(
        f'<label><input type="checkbox" value="{code}"{" checked" if shown else ""}>'
        f'<i style="background: rgb{colour}"></i>{name}</label>'
        for code, (name, colour, shown) in enumerate(OUTCOMES)
    )
    return (
        "<h2>Worst views</h2>"
        "<p>What each subject gets wrong from the eye where it errs most. Drag to turn, wheel to zoom, double click to "
        'go back.</p><div class="viewer"><canvas id="worst-view" aria-label="point cloud of the worst view"></canvas>'
        '<div><label>mesh<select id="mesh"></select></label><label>method<select id="subject"></select></label>'
        f'<div class="legend">{legend}</div><button id="camera">from the camera</button>'
        '<button id="aside">from aside</button><p id="fact" class="note"></p></div></div>'
    )


def image(png: bytes, text: str) -> str:
    """Return a picture as an element of a page that needs no other file."""
    return f'<img alt="{text}" src="data:image/png;base64,{base64.b64encode(png).decode()}">'


def as_png(figure: Figure) -> bytes:
    """Return a figure as a PNG file's bytes."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=DPI)
    return buffer.getvalue()
