"""The report of a comparison: report.html (one self-contained file), report.md and plots, from stored rows alone."""

import base64
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from zbuf_occlude.compare.plots import all_plots
from zbuf_occlude.compare.run import ROWS, Store
from zbuf_occlude.compare.summary import (
    Row,
    Standing,
    advice,
    front,
    milliseconds,
    representatives,
    seconds_for_all_points,
    share,
    standings,
)
from zbuf_occlude.drawing import pages
from zbuf_occlude.drawing.pages import Picture, Section, Table, as_png, pack_cloud, verbatim
from zbuf_occlude.errors import DatasetError

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
NONE = "–"


def write_report(folder: Path, extra_tables: Callable[[Sequence[Row]], list[Table]] = lambda rows: []) -> list[Path]:
    """Write the report of a comparison's folder; return the paths of report.html, report.md and the plots.

    `extra_tables` makes further tables of all rows, such as those of presets. Computes no visibility. The HTML holds
    everything it shows; the Markdown refers to the plots beside it. Raises DatasetError where there is no row, or a
    damaged file.
    """
    store = Store(folder)
    rows = list(store.rows().values())
    if not rows:
        raise DatasetError(
            f"{folder} must hold a comparison's {ROWS} with rows; it has none. Run compare --out {folder}."
        )
    judged = [row for row in rows if row["suite"] == "meshes"]
    ranking = standings(judged)
    plots = {name: Picture(name, as_png(figure), CAPTIONS[name]) for name, figure in all_plots(rows).items()}
    first: list[Section] = [table_of_answers(ranking)] if ranking else []
    first += [replace(plots["pareto"], heading="", caption=CAPTIONS["pareto"])] if ranking else []
    sections: list[Section] = [plots[name] for name in ("resolution", "elevation", "where") if name in plots]
    sections += extra_tables(rows)
    sections += [plots["scaling"]] if "scaling" in plots else []
    sections += [table_of_subjects(ranking), table_by_mesh(judged)] if ranking else []
    sections += [*table_of_failures(rows), definitions(rows)]
    return pages.write_report(
        folder,
        "report",
        "Hidden-surface removal: how wrong, how fast, when to use which",
        answers=[finding(ranking)] if any(s.wrong == 0.0 for s in ranking) else [],
        facts=[measured_on(rows)],
        first=first,
        sections=sections,
        page="comparison.html.j2",
        worst_views=worst_views(store, rows, ranking),
        outcomes=OUTCOMES,
    )


def finding(ranking: Sequence[Standing]) -> str:
    """Return the answer in a sentence: the fastest that is never wrong, the depth buffer and the paper's grid."""
    best = min((s for s in ranking if s.wrong == 0.0), key=lambda s: s.seconds)
    text = (
        f"**`{best.subject}`** was right in all {best.pairs:,} judged answers and took "
        f"{milliseconds(best.seconds)} ms per view"
    )
    least = next((s for s in ranking if s.method == "depth_buffer"), None)
    if least and least.wrong > 0:
        text += f"; the best depth buffer errs {share(least.wrong)} in {milliseconds(least.seconds)} ms"
    if grids := [s.wrong for s in ranking if s.method == "occupancy_grid"]:
        text += f"; the paper's occupancy grid errs {share(min(grids))} to {share(max(grids))}"
    return text + "."


def measured_on(rows: Sequence[Row]) -> str:
    """Return what was measured, and on which machine."""
    ok = [row for row in rows if row["status"] == "ok"]
    renderers = sorted({row["timed"]["renderer"] for row in ok} - {"none"})
    text = f"{len(ok)} rows on {len({row['case'] for row in ok})} meshes or cases; "
    text += f"{', '.join(sorted({row['machine'] for row in rows}))}; OpenGL: {', '.join(renderers) or 'not used'}"
    if any(word in name.lower() for name in renderers for word in ("llvmpipe", "softpipe", "swrast")):
        text += " (a software rasteriser: on a GPU the times of methods that render are others)"
    return text + "."


def table_of_answers(ranking: Sequence[Standing]) -> Table:
    """Return the first screen's table: which method is how wrong, how fast, and when to use which."""
    words, best = advice(ranking), front(ranking)
    rows = [
        [
            f"**`{one.subject}`**" if one.subject in best else f"`{one.subject}`",
            share(one.wrong),
            approximately(one),
            words[one.subject],
        ]
        for one in representatives(ranking)
    ]
    return Table("", ["method", "wrong", "ms per view", "use it"], rows, texts=(0, 3))


def approximately(one: Standing) -> str:
    """Write a standing's time, marked when it was scaled up from fewer points."""
    return ("≈ " if one.extrapolated else "") + milliseconds(one.seconds)


def table_of_subjects(ranking: Sequence[Standing]) -> Table:
    """Return the table of every subject with every measure, means over the meshes."""
    columns: dict[str, Callable[[Standing], str]] = {
        "subject": lambda s: f"`{s.subject}`",
        "wrong": lambda s: share(s.wrong),
        "false visible": lambda s: share(s.false_visible),
        "false hidden": lambda s: share(s.false_hidden),
        "in the band": lambda s: share(s.band),
        "Chamfer": lambda s: NONE if s.chamfer is None else f"{s.chamfer:.2g}",
        "ms per view": approximately,
        "ms to prepare": lambda s: milliseconds(s.build),
        "M points/s": lambda s: f"{s.points_per_second / 1e6:.3g}",
        "peak MiB": lambda s: NONE if s.memory is None else f"{s.memory / 2**20:,.0f}",
        "meshes": lambda s: f"{s.n_meshes}",
        "pairs": lambda s: f"{s.pairs:,}",
    }
    return Table(
        "Every subject",
        list(columns),
        [[cell(one) for cell in columns.values()] for one in ranking],
        "Wrong, false visible, false hidden: shares of the judged pairs of view and point outside the boundary band, "
        "as many as the last column says (a slow method is asked from fewer of the views), "
        "mean over the meshes. Chamfer: between the method's cloud and the reference's, in longest sides. Times: "
        "geometric means; ≈ marks times scaled up linearly from fewer points. Peak: growth of the process while "
        "preparing and asking, the largest over the meshes.",
    )


def table_by_mesh(rows: Sequence[Row]) -> Table:
    """Return the table of error and time of each subject on each mesh."""
    cells: dict[tuple[str, str], str] = {}
    heads: dict[str, str] = {}
    for row in rows:
        case, faces = row["case"], row.get("mesh", {}).get("faces")
        heads[case] = f"{verbatim(case)} ({faces:,} faces)" if faces else heads.get(case, verbatim(case))
        if row["status"] == "ok":
            wrong = share(1.0 - row["judged"]["outside"]["agreement"])
            cells[case, row["subject"]] = f"{wrong} · {milliseconds(seconds_for_all_points(row))} ms"
    subjects = [one.subject for one in standings(rows)]
    body = [[f"`{subject}`", *(cells.get((case, subject), NONE) for case in heads)] for subject in subjects]
    return Table("Mesh by mesh: wrong outside the band · time a view", ["subject", *heads.values()], body)


def table_of_failures(rows: Sequence[Row]) -> list[Table]:
    """Return the table of what failed or cannot run here, equal reasons together; none where nothing did."""
    reasons: dict[tuple[str, str, str], list[str]] = {}
    for row in rows:
        if row["status"] != "ok":
            reasons.setdefault((row["subject"], row["status"], row["reason"]), []).append(row["case"])
    body = [
        [f"`{subject}`", status, verbatim(", ".join(cases)), verbatim(reason)]
        for (subject, status, reason), cases in reasons.items()
    ]
    return [Table("What did not run", ["subject", "", "on", "because"], body, texts=range(4))] if body else []


def definitions(rows: Sequence[Row]) -> Table:
    """Return what the report's words mean."""
    band = max((row["judged"]["band"] for row in rows if row["status"] == "ok" and "judged" in row), default=0.0)
    words = {
        "wrong": "the answer differs from the reference's: `oracle`, brute force over all faces in float64",
        "false visible": "the method shows a point that is hidden in the reference",
        "false hidden": "the method drops a point that is visible in the reference",
        "boundary band": "pairs whose answer changes when the line's end moves by 1e-6 of the diagonal, or with half "
        f"or twice the contact tolerance; at most {share(band)} of the pairs of a row",
        "footprint": "what a pixel of a 512 x 512 image around the mesh covers: 1/512 of its diagonal",
        "time a view": "median wall clock of a call with all views, divided by them; warmed up, preparing not counted",
    }
    return Table("Words", ["", ""], list(words.items()), texts=range(2))


def worst_views(store: Store, rows: Sequence[Row], ranking: Sequence[Standing]) -> dict[str, Any]:
    """Collect what the viewer shows: each mesh's points, and the outcomes of each subject's worst view of it."""
    clouds: dict[str, Any] = {}
    order = {one.subject: i for i, one in enumerate(ranking)}
    shown = [row for row in rows if row["suite"] == "meshes" and row["status"] == "ok" and "worst" in row]
    for row in sorted(shown, key=lambda row: (row["case"], order[row["subject"]])):
        question = store.load("questions", row["question"])
        if row["case"] not in clouds:
            cloud = pack_cloud(
                question["positions"],
                centre=question["centre"],
                longest=float(question["longest"]),
                normals=question["normals"],
            )
            clouds[row["case"]] = {**cloud, "worst": {}}
        outcomes = store.load("worst", row["key"])["outcomes"]
        x, y, z = question["eyes"][row["worst"]["view"]] - question["centre"]
        clouds[row["case"]]["worst"][row["subject"]] = {
            "n": len(outcomes),
            "outcomes": pack_outcomes(outcomes),
            "azimuth": float(np.degrees(np.arctan2(y, x))),
            "elevation": float(np.degrees(np.arctan2(z, np.hypot(x, y)))),
            "false_visible": row["worst"]["false_visible"],
            "false_hidden": row["worst"]["false_hidden"],
        }
    telling = [s for s in ranking if s.method == "depth_buffer"] or [s for s in ranking if s.wrong > 0] or [*ranking]
    palette, first = [colour for _, colour, _ in OUTCOMES], telling[-1].subject if telling else ""
    return {"clouds": clouds, "palette": palette, "first": first}


def pack_outcomes(outcomes: Any) -> str:
    """Pack outcomes 0..3 four to a byte, the first lowest, as base64."""
    codes = np.zeros(-(-len(outcomes) // 4) * 4, dtype=np.uint8)
    codes[: len(outcomes)] = outcomes
    four = codes.reshape(-1, 4)
    packed = four[:, 0] | four[:, 1] << 2 | four[:, 2] << 4 | four[:, 3] << 6
    return base64.b64encode(packed.astype(np.uint8).tobytes()).decode()
