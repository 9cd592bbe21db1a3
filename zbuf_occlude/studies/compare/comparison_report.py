"""The report of a comparison: report.html (one self-contained file), report.md and plots, from stored rows alone."""

import base64
import math
import re
from collections.abc import Callable, Sequence
from itertools import pairwise, product
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter, NullLocator

from zbuf_occlude.base.arrays import FloatArray
from zbuf_occlude.base.errors import DatasetError
from zbuf_occlude.drawing import pages
from zbuf_occlude.drawing.pages import NONE, Picture, Section, Table, as_png, pack_cloud, verbatim
from zbuf_occlude.drawing.pictures import canvas
from zbuf_occlude.engines.gl.devices import is_software
from zbuf_occlude.studies.compare.metrics import (
    Ranking,
    Row,
    best_rival,
    fit_exponent,
    format_error,
    format_milliseconds,
    format_percent,
    pareto_front,
    rank_subjects,
    representatives,
    seconds_for_all_points,
)
from zbuf_occlude.studies.compare.run import ROWS, ComparisonFolder

OUTCOMES = (
    ("truly hidden", (208, 212, 216), False),
    ("truly visible", (86, 132, 180), True),
    ("false visible: shown, but hidden", (213, 94, 0), True),
    ("false hidden: dropped, but visible", (148, 0, 130), True),
)
"""Name, colour and initial visibility of each outcome, in the order of their numbers in `metrics`."""
HEADINGS = {
    "resolution": "Error against resolution and against the size of the grid",
    "elevation": "Error against the camera's elevation",
    "where": "Error against distance from the nearest silhouette and angle of incidence",
    "scaling": "Time against N points and M faces; exponents fitted to the three largest",
}
COLOURS = {
    "depth_buffer": "#0072b2",
    "exact": "#d55e00",
    "exact_gl": "#e69f00",
    "oracle": "#333333",
    "embree": "#009e73",
    "warp": "#117733",
    "pyrender": "#56b4e9",
    "vertex_hsr": "#a6761d",
    "vertex_hsr_culled": "#c9a66b",
    "exact_hsr": "#882255",
    "occupancy_grid": "#cc79a7",
    "hidden_point_removal": "#999933",
}
MARKS = {"exact": "*", "exact_gl": "*", "oracle": "s", "embree": "D", "pyrender": "v", "hidden_point_removal": "^"}
SIDES = ("left", "right")
"""Side of a label that is at its mark."""


def write_report(folder: Path, extra_tables: Callable[[Sequence[Row]], list[Table]] = lambda rows: []) -> list[Path]:
    """Write the report of a comparison's folder; return the paths of report.html, report.md and the plots.

    `extra_tables` makes further tables of all rows, such as those of presets. No visibility is computed. The HTML is
    self-contained; the Markdown links the plots in its folder. Raises DatasetError where there is no row, or where a
    file is damaged.
    """
    store = ComparisonFolder(folder)
    rows = list(store.rows().values())
    if not rows:
        raise DatasetError(
            f"{folder} must hold a comparison's {ROWS} with rows; it has none. Run compare --out {folder}."
        )
    of_meshes = [row for row in rows if row["suite"] == "meshes"]
    ranking = rank_subjects(of_meshes)
    first: list[Section] = []
    if ranking:
        best = (
            "Left and low is good. Grey staircase: the Pareto front, where no method is better in both error and time."
        )
        first += [table_of_answers(ranking), Picture("pareto", as_png(pareto(ranking)), caption=best)]
    figures = {
        "resolution": error_against_setting(of_meshes),
        "elevation": error_against_elevation(of_meshes, ranking),
        "where": error_by_place(of_meshes, ranking),
    }
    sections: list[Section] = [
        Picture(name, as_png(figure), HEADINGS[name]) for name, figure in figures.items() if figure
    ]
    sections += extra_tables(rows)
    if timed := [row for row in rows if row["suite"] == "scaling" and row["status"] == "ok"]:
        sections.append(Picture("scaling", as_png(time_against_size(timed)), HEADINGS["scaling"]))
    sections += [table_of_subjects(ranking), table_by_mesh(of_meshes)] if ranking else []
    sections += [*table_of_failures(rows), definitions(rows)]
    return pages.write_pages(
        folder,
        "report",
        "Hidden-surface removal: error and time of each method",
        answers=[],
        facts=[facts_of_rows(rows)],
        first=first,
        sections=sections,
        page="comparison.html.j2",
        worst_views=worst_views(store, rows, ranking),
        outcomes=OUTCOMES,
    )


def facts_of_rows(rows: Sequence[Row]) -> str:
    """Return the numbers of rows and cases, the machines and the renderers."""
    ok = [row for row in rows if row["status"] == "ok"]
    renderers = sorted({row["timed"]["renderer"] for row in ok} - {"none"})
    text = f"{len(ok)} rows on {len({row['case'] for row in ok})} meshes or cases; "
    text += f"{', '.join(sorted({row['machine'] for row in rows}))}; OpenGL: {', '.join(renderers) or 'not used'}"
    if any(map(is_software, renderers)):
        text += " (a software rasteriser: methods that render are faster on a GPU)"
    return text + "."


def table_of_answers(ranking: Sequence[Ranking]) -> Table:
    """Return the table of the first screen: error and time of each method, and the method that is better in both."""
    rows = []
    for one in representatives(ranking):
        rival, name = best_rival(one, ranking), f"`{one.subject}`"
        better = [NONE, NONE] if rival is None else [f"`{rival.subject}`", f"{one.seconds / rival.seconds:,.1f}"]
        rows.append([name if rival else f"**{name}**", format_percent(one.wrong), format_time(one), *better])
    note = "Bold: on the Pareto front. Better method: no more errors and no slower; the last column is its speed-up."
    return Table("", ["method", "wrong", "ms per view", "better method", "times as fast"], rows, note, texts=(0, 3))


def format_time(one: Ranking) -> str:
    """Format the milliseconds per view; ≈ marks times scaled up from fewer points."""
    return ("≈ " if one.extrapolated else "") + format_milliseconds(one.seconds)


def table_of_subjects(ranking: Sequence[Ranking]) -> Table:
    """Return the table of all subjects and measures, means over the meshes."""
    columns: dict[str, Callable[[Ranking], str]] = {
        "subject": lambda s: f"`{s.subject}`",
        "wrong": lambda s: format_percent(s.wrong),
        "false visible": lambda s: format_percent(s.false_visible),
        "false hidden": lambda s: format_percent(s.false_hidden),
        "in the band": lambda s: format_percent(s.band),
        "Chamfer": lambda s: NONE if s.chamfer is None else f"{s.chamfer:.2g}",
        "ms per view": format_time,
        "ms to prepare": lambda s: format_milliseconds(s.build),
        "M points/s": lambda s: f"{s.points_per_second / 1e6:.3g}",
        "peak MiB": lambda s: NONE if s.memory is None else f"{s.memory / 2**20:,.0f}",
        "meshes": lambda s: f"{s.n_meshes}",
        "pairs": lambda s: f"{s.pairs:,}",
    }
    return Table(
        "Every subject",
        list(columns),
        [[cell(one) for cell in columns.values()] for one in ranking],
        "Wrong, false visible, false hidden: fractions of the compared pairs of view and point outside the boundary "
        "band, means over the meshes. The last column is the number of these pairs; slow methods are asked from fewer "
        "views. Chamfer: distance between the method's cloud and the reference's, in longest sides. Times: geometric "
        "means; ≈ marks times scaled up linearly from fewer points. Peak: growth of the process while preparing and "
        "answering, the largest over the meshes.",
    )


def table_by_mesh(rows: Sequence[Row]) -> Table:
    """Return the table of error and time of each subject on each mesh."""
    cells: dict[tuple[str, str], str] = {}
    heads: dict[str, str] = {}
    for row in rows:
        case, faces = row["case"], row.get("mesh", {}).get("faces")
        heads[case] = f"{verbatim(case)} ({faces:,} faces)" if faces else heads.get(case, verbatim(case))
        if row["status"] == "ok":
            wrong = format_error(row)
            cells[case, row["subject"]] = f"{wrong} · {format_milliseconds(seconds_for_all_points(row))} ms"
    subjects = [one.subject for one in rank_subjects(rows)]
    body = [[f"`{subject}`", *(cells.get((case, subject), NONE) for case in heads)] for subject in subjects]
    return Table("Mesh by mesh: wrong outside the band · time a view", ["subject", *heads.values()], body)


def table_of_failures(rows: Sequence[Row]) -> list[Table]:
    """Return the table of failed and unavailable subjects, grouped by reason; an empty list without failures."""
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
    """Return the table of the report's terms."""
    band = max((row["judged"]["band"] for row in rows if row["status"] == "ok" and "judged" in row), default=0.0)
    words = {
        "wrong": "the answer differs from the reference's: `oracle`, brute force over all faces in float64",
        "false visible": "the method shows a point that is hidden in the reference",
        "false hidden": "the method drops a point that is visible in the reference",
        "boundary band": "pairs whose answer changes when the line's end moves by 1e-6 of the diagonal, or with half "
        f"or twice the contact tolerance; at most {format_percent(band)} of the pairs of a row",
        "footprint": "size of a pixel of a 512 x 512 image around the mesh: 1/512 of its diagonal",
        "time a view": "median wall clock of a call with all views, divided by their number; preparing not included",
    }
    return Table("Words", ["", ""], list(words.items()), texts=range(2))


def worst_views(store: ComparisonFolder, rows: Sequence[Row], ranking: Sequence[Ranking]) -> dict[str, Any]:
    """Return the data of the viewer: the points of each mesh, and the outcomes in the worst view of each subject."""
    clouds: dict[str, Any] = {}
    order = {one.subject: i for i, one in enumerate(ranking)}
    shown = [row for row in rows if row["suite"] == "meshes" and row["status"] == "ok" and "worst" in row]
    for row in sorted(shown, key=lambda row: (row["case"], order[row["subject"]])):
        question = store.load_arrays("questions", row["question"])
        if row["case"] not in clouds:
            cloud = pack_cloud(
                question["positions"],
                centre=question["centre"],
                longest=float(question["longest"]),
                normals=question["normals"],
            )
            clouds[row["case"]] = {**cloud, "worst": {}}
        outcomes = store.load_arrays("worst", row["key"])["outcomes"]
        x, y, z = question["eyes"][row["worst"]["view"]] - question["centre"]
        clouds[row["case"]]["worst"][row["subject"]] = {
            "n": len(outcomes),
            "outcomes": pack_outcomes(outcomes),
            "azimuth": float(np.degrees(np.arctan2(y, x))),
            "elevation": float(np.degrees(np.arctan2(z, np.hypot(x, y)))),
            "false_visible": row["worst"]["false_visible"],
            "false_hidden": row["worst"]["false_hidden"],
        }
    first = subject_shown_first(ranking)
    worst = {case: cloud["worst"].get(first) for case, cloud in clouds.items()}
    errors = {case: one["false_visible"] + one["false_hidden"] for case, one in worst.items() if one}
    return {
        "clouds": dict(sorted(clouds.items(), key=lambda item: -errors.get(item[0], 0.0))),
        "palette": [colour for _, colour, _ in OUTCOMES],
        "first": first,
    }


def subject_shown_first(ranking: Sequence[Ranking]) -> str:
    """Return the subject whose worst views are shown first: the default method, at its default resolution if there."""
    subjects = [one.subject for one in ranking]
    for subject in ("depth_buffer", "depth_buffer:resolution=512"):
        if subject in subjects:
            return subject
    shown = [s for s in ranking if s.method == "depth_buffer"] or [s for s in ranking if s.wrong > 0] or [*ranking]
    return shown[0].subject if shown else ""


def pack_outcomes(outcomes: Any) -> str:
    """Pack outcomes 0..3 four to a byte, lowest bits first, as base64."""
    bits = outcomes[:, None] >> np.arange(2) & 1
    return base64.b64encode(np.packbits(bits, bitorder="little").tobytes()).decode()


# ---- plots -----------------------------------------------------------------------------------------------------------


def colour(method: str) -> str:
    """Return the colour of a method; methods without one are grey."""
    return COLOURS.get(method, "#888888")


def percent_log(axes: Axes, zero: float = 0.0) -> None:
    """Make y a logarithmic axis of percentages with ticks at 1, 2 and 5; with `zero`, at powers of ten and 0."""
    axes.set_yscale("log")
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0,) if zero else (1.0, 2.0, 5.0), numticks=12 if zero else 20))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda y, _: "0" if y <= zero * 1.001 else f"{100 * y:g} %"))
    axes.yaxis.set_minor_formatter(NullFormatter())
    if zero:
        axes.set_ylim(zero * 0.3, 1.0)
        axes.axhline(zero * 3.16, color="#cccccc", linewidth=0.8, linestyle=(0, (2, 3)))


def plain_axis(axis: Any) -> None:
    """Label a logarithmic axis with plain numbers instead of powers of ten."""
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:,.10g}"))
    axis.set_minor_formatter(NullFormatter())


def pareto(ranking: Sequence[Ranking]) -> Figure:
    """Plot error against time of all subjects; lines join settings of a method, a staircase is the Pareto front."""
    figure, (axes,) = canvas(7.2, 5.0)
    least = min((s.wrong for s in ranking if s.wrong > 0), default=1e-3)
    zero = float(10.0 ** (np.floor(np.log10(least)) - 1.0))  # the position of 0 on the axis
    percent_log(axes, zero)
    place = {s.subject: (1e3 * s.seconds, max(s.wrong, zero)) for s in ranking}
    best = sorted((place[name] for name in pareto_front(ranking)), key=lambda at: at[0])
    axes.step([x for x, _ in best], [y for _, y in best], where="post", color="#bbbbbb", linewidth=5, alpha=0.5)
    for family in dict.fromkeys(_family(s.subject) for s in ranking):
        group = sorted((s for s in ranking if _family(s.subject) == family), key=lambda s: s.seconds)
        method = group[0].method
        x, y = zip(*(place[s.subject] for s in group), strict=True)
        axes.plot(x, y, color=colour(method), linewidth=1.0, alpha=0.5 if len(group) > 1 else 0)
        axes.scatter(
            x, y, s=90 if method in ("exact", "exact_gl") else 42, color=colour(method),
            marker=MARKS.get(method, "o"), edgecolors="white", linewidths=0.8, zorder=3,
        )  # fmt: skip
    axes.set_xscale("log")
    plain_axis(axes.xaxis)
    low, high = axes.get_xlim()
    axes.set_xlim(low / 1.3, high * 1.3)
    axes.set_xlabel("milliseconds per view (geometric mean over the meshes)", fontsize=10)
    axes.set_ylabel("wrong answers outside the boundary band", fontsize=10)
    label_points(figure, axes, [(place[s.subject], brief(s.subject), colour(s.method)) for s in ranking])
    return figure


def _family(subject: str) -> str:
    """Return a label without its numbers; the plot joins subjects of equal family by a line."""
    return re.sub(r"\d+", "", subject)


def brief(subject: str) -> str:
    """Shorten a label for a plot: ``depth_buffer:resolution=256,refine=none`` is ``depth_buffer 256 none``."""
    method, _, options = subject.partition(":")
    return " ".join([method, *(pair.partition("=")[2] for pair in filter(None, options.split(",")))])


def label_points(
    figure: Figure, axes: Axes, labels: Sequence[tuple[tuple[float, float], str, str]], sides: Sequence[str] = SIDES
) -> None:
    """Write labels (position, text, colour) beside their marks without overlaps of labels, marks and lines.

    Positions are in data coordinates. The method is greedy: each label takes the first free one of several offsets.
    """
    figure.canvas.draw()
    figure.set_layout_engine("none")  # keep the layout that was measured
    height, width = 11.5, 5.2  # points of text at size 8: line, character
    to_points = 72.0 / figure.dpi
    places = [axes.transData.transform(place) * to_points for place, _, _ in labels]
    box = axes.get_window_extent()
    taken = [(x - 4, y - 4, x + 4, y + 4) for x, y in places]
    taken += [(x - 1, y - 1, x + 1, y + 1) for line in axes.lines for x, y in _along(line, to_points)]
    shifts = [sign * 9.0 * step for step in range(12) for sign in (1.0, -1.0)]
    for (x, y), (place, text, tint) in sorted(zip(places, labels, strict=True), key=lambda item: -item[0][1]):
        span = width * len(text)
        for shift, side in product(shifts, sides):
            left = x + 8 if side == "left" else x - 8 - span
            candidate = (left, y + shift - height / 2, left + span, y + shift + height / 2)
            inside = candidate[0] > box.x0 * to_points and candidate[2] < box.x1 * to_points
            inside &= candidate[1] > box.y0 * to_points and candidate[3] < box.y1 * to_points + height
            if inside and not any(_overlap(candidate, other) for other in taken):
                break
        else:
            candidate, shift, side = (x, y, x, y), 0.0, "left"
        taken.append(candidate)
        offset = (8 if side == "left" else -8, shift)
        axes.annotate(
            text, place, xytext=offset, textcoords="offset points",
            ha=side, va="center", fontsize=8, color=tint,
            arrowprops={"arrowstyle": "-", "color": tint, "linewidth": 0.5, "alpha": 0.6} if abs(shift) > 9 else None,
        )  # fmt: skip


def _along(line: Any, to_points: float) -> FloatArray:
    """Return positions (n, 2) along a drawn line, in typographic points."""
    if line.get_alpha() == 0:  # invisible: the family has one subject
        return np.zeros((0, 2))
    corners = line.axes.transData.transform(line.get_xydata()) * to_points
    corners = corners[np.isfinite(corners).all(axis=1)]
    steps = np.linspace(0.0, 1.0, 64)[:, None]
    return np.concatenate([np.zeros((0, 2)), *(a + steps * (b - a) for a, b in pairwise(corners))])


def _overlap(a: tuple[float, ...], b: tuple[float, ...]) -> bool:
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]


def error_against_setting(rows: Sequence[Row]) -> Figure | None:
    """Plot error against the resolution of image-space methods and the size of grids, a line for each method."""
    ranking = rank_subjects(rows)
    options = {row["subject"]: row["options"] for row in rows}
    panels = []
    for key, title in (("resolution", "pixels on a side of the image"), ("n", "cells on a side of the grid")):
        lines: dict[tuple[str, str], list[tuple[float, Ranking]]] = {}
        for one in ranking:
            setting = dict(options[one.subject])
            if isinstance(value := setting.pop(key, None), (int, float)):
                rest = ",".join(f"{k}={v}" for k, v in setting.items())
                lines.setdefault((one.method, rest), []).append((float(value), one))
        if any(len(line) > 1 for line in lines.values()):
            panels.append((title, lines))
    if not panels:
        return None
    figure, all_axes = canvas(5.0 * len(panels), 3.9, len(panels))
    for axes, (title, lines) in zip(all_axes, panels, strict=True):
        for (method, rest), line in lines.items():
            line.sort(key=lambda item: item[0])
            x, y = [value for value, _ in line], [one.wrong for _, one in line]
            text, style = method + (f", {rest}" if rest else ""), "--" if rest else "-"
            axes.plot(x, y, style, color=colour(method), marker="o", markersize=5, label=text)
            axes.plot(x, [one.false_visible for _, one in line], style, color=colour(method), alpha=0.35, linewidth=1)
        axes.set_xscale("log", base=2)
        percent_log(axes)
        plain_axis(axes.xaxis)
        axes.set_xlabel(title, fontsize=10)
        axes.legend(fontsize=8, frameon=False)
    all_axes[0].set_ylabel("wrong outside the band (pale: false visible)", fontsize=10)
    return figure


def error_against_elevation(rows: Sequence[Row], ranking: Sequence[Ranking]) -> Figure | None:
    """Plot error against the camera's elevation, mean over meshes and azimuths; None for a single elevation."""
    shown = [s for s in representatives(ranking) if s.wrong > 0]
    judged = [row["judged"]["views"] for row in rows if row["status"] == "ok"]
    if not shown or len({round(view["elevation"]) for views in judged for view in views}) < 2:
        return None
    figure, (axes,) = canvas(7.2, 4.2)
    labels = []
    for one in shown:
        sums: dict[float, list[float]] = {}
        for row in rows:
            if row["subject"] == one.subject and row["status"] == "ok":
                for view in (view for view in row["judged"]["views"] if view["outside"]["n"]):
                    sums.setdefault(round(view["elevation"]), []).append(1.0 - view["outside"]["agreement"])
        elevations = sorted(sums)
        means = [float(np.mean(sums[e])) or np.nan for e in elevations]  # a logarithmic axis has no 0
        axes.plot(elevations, means, color=colour(one.method), marker="o", markersize=3.5, linewidth=1.4)
        last = int(np.flatnonzero(np.isfinite(means))[-1])
        labels.append(((elevations[last], means[last]), brief(one.subject), colour(one.method)))
    percent_log(axes)
    axes.set_xlim(-92, 168)
    axes.set_xticks(range(-90, 91, 30))
    axes.set_xlabel("elevation of the camera, degrees", fontsize=10, x=0.35)
    axes.set_ylabel("wrong outside the boundary band", fontsize=10)
    label_points(figure, axes, labels, SIDES[:1])
    return figure


def error_by_place(rows: Sequence[Row], ranking: Sequence[Ranking]) -> Figure | None:
    """Plot error against distance from the nearest silhouette and against angle of incidence."""
    shown = [s for s in representatives(ranking) if s.wrong > 0]
    if not shown:
        return None
    figure, (left, right) = canvas(10.0, 4.2, 2)
    for axes, key in ((left, "by_silhouette"), (right, "by_incidence")):
        for one in shown:
            errors, names = _pooled(rows, one.subject, key)
            axes.plot(range(len(errors)), errors, color=colour(one.method), marker="o", markersize=4, label=one.subject)
            axes.set_xticks(range(len(names)), names)
        percent_log(axes)
    left.set_xlabel("up to ... pixels (of 512²) from a silhouette", fontsize=10)
    right.set_xlabel("up to ... degrees of incidence", fontsize=10)
    left.set_ylabel("wrong answers", fontsize=10)
    right.legend(fontsize=8, frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


def _pooled(rows: Sequence[Row], subject: str, key: str) -> tuple[list[float], list[str]]:
    """Return the error of each bin over all meshes (NaN without an error), and the names of the bins."""
    totals: dict[Any, list[int]] = {}
    for row in rows:
        if row["subject"] == subject and row["status"] == "ok":
            for one in row["judged"][key]:
                pair = totals.setdefault(one["upto"], [0, 0])
                pair[0] += one["n"]
                pair[1] += one["false_visible"] + one["false_hidden"]
    bins = sorted(totals, key=lambda upto: math.inf if upto is None else upto)
    errors = [totals[upto][1] / totals[upto][0] if totals[upto][1] else math.nan for upto in bins]
    return errors, [f"{upto:g}" if upto is not None else "beyond" for upto in bins]


def time_against_size(rows: Sequence[Row]) -> Figure:
    """Plot time per view against numbers of points and faces, with exponents fitted to the three largest."""
    figure, all_axes = canvas(11.0, 4.6, 2)
    every_label = []
    for axes, sweep, key in zip(all_axes, ("points", "faces"), ("n_points", "faces"), strict=True):
        labels = []
        chosen = [row for row in rows if row["facts"].get("sweep") == sweep]
        for subject in dict.fromkeys(row["subject"] for row in chosen):
            line = sorted(
                (row["n_points"] if key == "n_points" else row["mesh"]["faces"], row["timed"]["seconds_per_view"])
                for row in chosen
                if row["subject"] == subject and row["timed"]["n_points"] == row["n_points"]
            )
            if len(line) < 2:
                continue
            x, y = [float(a) for a, _ in line], [1e3 * b for _, b in line]
            tint = colour(subject.split(":")[0])
            axes.plot(x, y, color=tint, marker="o", markersize=4, linewidth=1.4)
            exponent = fit_exponent(x[-3:], y[-3:])
            labels.append(
                ((x[-1], y[-1]), f"{brief(subject)}  ∝ {'N' if sweep == 'points' else 'M'}^{exponent:.2f}", tint)
            )
        axes.set_xscale("log")
        axes.set_yscale("log")
        plain_axis(axes.xaxis)
        plain_axis(axes.yaxis)
        low, high = axes.get_xlim()
        axes.set_xlim(low, high * (high / low) ** 0.95)  # room for the labels
        axes.set_xticks([10.0**e for e in range(9) if low <= 10.0**e <= high])
        axes.xaxis.set_minor_locator(NullLocator())
        axes.set_xlabel(f"number of {sweep}", fontsize=10, x=0.25)
        every_label.append((axes, labels))
    all_axes[0].set_ylabel("milliseconds per view", fontsize=10)
    for axes, labels in every_label:
        label_points(figure, axes, labels, SIDES[:1])
    return figure
