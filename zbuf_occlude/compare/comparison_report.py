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

from zbuf_occlude.arrays import FloatArray
from zbuf_occlude.compare.metrics import (
    Ranking,
    Row,
    advice,
    fit_exponent,
    front,
    milliseconds,
    representatives,
    seconds_for_all_points,
    share,
    standings,
    wrong_outside,
)
from zbuf_occlude.compare.run import ROWS, ComparisonFolder
from zbuf_occlude.drawing import pages
from zbuf_occlude.drawing.pages import Picture, Section, Table, as_png, pack_cloud, verbatim
from zbuf_occlude.drawing.pictures import canvas
from zbuf_occlude.errors import DatasetError

OUTCOMES = (
    ("truly hidden", (208, 212, 216), False),
    ("truly visible", (86, 132, 180), True),
    ("false visible: shown, but hidden", (213, 94, 0), True),
    ("false hidden: dropped, but visible", (148, 0, 130), True),
)
"""Name, colour and whether it is shown at first, by the outcome's number in `metrics`."""
HEADINGS = {
    "resolution": "Error against resolution and against the size of the grid",
    "elevation": "Error against the camera's elevation",
    "where": "Where the errors lie: distance from the nearest silhouette, angle of incidence",
    "scaling": "How cost grows: N points, M faces; exponents fitted to the three largest",
}
NONE = "–"
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
"""Which side of a label lies at its mark."""


def write_report(folder: Path, extra_tables: Callable[[Sequence[Row]], list[Table]] = lambda rows: []) -> list[Path]:
    """Write the report of a comparison's folder; return the paths of report.html, report.md and the plots.

    `extra_tables` makes further tables of all rows, such as those of presets. Computes no visibility. The HTML holds
    everything it shows; the Markdown links the plots in its folder. Raises DatasetError where there is no row, or a
    damaged file.
    """
    store = ComparisonFolder(folder)
    rows = list(store.rows().values())
    if not rows:
        raise DatasetError(
            f"{folder} must hold a comparison's {ROWS} with rows; it has none. Run compare --out {folder}."
        )
    of_meshes = [row for row in rows if row["suite"] == "meshes"]
    ranking = standings(of_meshes)
    first: list[Section] = []
    if ranking:
        best = "Left and low is good. The grey staircase joins what nothing beats in both error and time."
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
        "Hidden-surface removal: how wrong, how fast, when to use which",
        answers=[finding(ranking)] if any(s.wrong == 0.0 for s in ranking) else [],
        facts=[facts_of_rows(rows)],
        first=first,
        sections=sections,
        page="comparison.html.j2",
        worst_views=worst_views(store, rows, ranking),
        outcomes=OUTCOMES,
    )


def finding(ranking: Sequence[Ranking]) -> str:
    """Return the answer in a sentence: the fastest that is never wrong, the depth buffer and the paper's grid."""
    best = min((s for s in ranking if s.wrong == 0.0), key=lambda s: s.seconds)
    text = (
        f"**`{best.subject}`** was right in all {best.pairs:,} compared answers and took "
        f"{milliseconds(best.seconds)} ms per view"
    )
    least = next((s for s in ranking if s.method == "depth_buffer"), None)
    if least and least.wrong > 0:
        text += f"; the best depth buffer errs {share(least.wrong)} in {milliseconds(least.seconds)} ms"
    if grids := [s.wrong for s in ranking if s.method == "occupancy_grid"]:
        text += f"; the paper's occupancy grid errs {share(min(grids))} to {share(max(grids))}"
    return text + "."


def facts_of_rows(rows: Sequence[Row]) -> str:
    """Return what was measured, and on which machine."""
    ok = [row for row in rows if row["status"] == "ok"]
    renderers = sorted({row["timed"]["renderer"] for row in ok} - {"none"})
    text = f"{len(ok)} rows on {len({row['case'] for row in ok})} meshes or cases; "
    text += f"{', '.join(sorted({row['machine'] for row in rows}))}; OpenGL: {', '.join(renderers) or 'not used'}"
    if any(word in name.lower() for name in renderers for word in ("llvmpipe", "softpipe", "swrast")):
        text += " (a software rasteriser: on a GPU the times of methods that render are others)"
    return text + "."


def table_of_answers(ranking: Sequence[Ranking]) -> Table:
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


def approximately(one: Ranking) -> str:
    """Write a standing's time, marked when it was scaled up from fewer points."""
    return ("≈ " if one.extrapolated else "") + milliseconds(one.seconds)


def table_of_subjects(ranking: Sequence[Ranking]) -> Table:
    """Return the table of every subject with every measure, means over the meshes."""
    columns: dict[str, Callable[[Ranking], str]] = {
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
        "Wrong, false visible, false hidden: shares of the compared pairs of view and point outside the boundary band, "
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
            wrong = wrong_outside(row)
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


def worst_views(store: ComparisonFolder, rows: Sequence[Row], ranking: Sequence[Ranking]) -> dict[str, Any]:
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
    first = subject_shown_first(ranking)
    worst = {case: cloud["worst"].get(first) for case, cloud in clouds.items()}
    errors = {case: one["false_visible"] + one["false_hidden"] for case, one in worst.items() if one}
    return {
        "clouds": dict(sorted(clouds.items(), key=lambda item: -errors.get(item[0], 0.0))),
        "palette": [colour for _, colour, _ in OUTCOMES],
        "first": first,
    }


def subject_shown_first(ranking: Sequence[Ranking]) -> str:
    """Return whose worst views the page opens on: the default method's, at its default resolution where it has rows."""
    subjects = [one.subject for one in ranking]
    for subject in ("depth_buffer", "depth_buffer:resolution=512"):
        if subject in subjects:
            return subject
    telling = [s for s in ranking if s.method == "depth_buffer"] or [s for s in ranking if s.wrong > 0] or [*ranking]
    return telling[0].subject if telling else ""


def pack_outcomes(outcomes: Any) -> str:
    """Pack outcomes 0..3 four to a byte, the first lowest, as base64."""
    bits = outcomes[:, None] >> np.arange(2) & 1
    return base64.b64encode(np.packbits(bits, bitorder="little").tobytes()).decode()


# ---- plots -----------------------------------------------------------------------------------------------------------


def colour(method: str) -> str:
    """Return a method's colour; a method without one is grey."""
    return COLOURS.get(method, "#888888")


def percent_log(axes: Axes, zero: float = 0.0) -> None:
    """Make y a logarithmic axis of percentages, numbers at 1, 2 and 5; or of powers of ten with a place for 0."""
    axes.set_yscale("log")
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0,) if zero else (1.0, 2.0, 5.0), numticks=12 if zero else 20))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda y, _: "0" if y <= zero * 1.001 else f"{100 * y:g} %"))
    axes.yaxis.set_minor_formatter(NullFormatter())
    if zero:
        axes.set_ylim(zero * 0.3, 1.0)
        axes.axhline(zero * 3.16, color="#cccccc", linewidth=0.8, linestyle=(0, (2, 3)))


def plain_axis(axis: Any) -> None:
    """Write a logarithmic axis' numbers out instead of as powers of ten."""
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:,.10g}"))
    axis.set_minor_formatter(NullFormatter())


def pareto(ranking: Sequence[Ranking]) -> Figure:
    """Error against time of all subjects, settings of one method joined, the Pareto front drawn as a staircase."""
    figure, (axes,) = canvas(7.2, 5.0)
    least = min((s.wrong for s in ranking if s.wrong > 0), default=1e-3)
    zero = float(10.0 ** (np.floor(np.log10(least)) - 1.0))  # the place of 0
    percent_log(axes, zero)
    place = {s.subject: (1e3 * s.seconds, max(s.wrong, zero)) for s in ranking}
    best = sorted((place[name] for name in front(ranking)), key=lambda at: at[0])
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
    """What stays of a label when its numbers vary: the subjects of a family are joined by a line."""
    return re.sub(r"\d+", "", subject)


def brief(subject: str) -> str:
    """Shorten a label for a plot: ``depth_buffer:resolution=256,refine=none`` is ``depth_buffer 256 none``."""
    method, _, options = subject.partition(":")
    return " ".join([method, *(pair.partition("=")[2] for pair in filter(None, options.split(",")))])


def label_points(
    figure: Figure, axes: Axes, labels: Sequence[tuple[tuple[float, float], str, str]], sides: Sequence[str] = SIDES
) -> None:
    """Write a label beside each place, moved up or down until none covers another, a mark or a line.

    Places are in data coordinates, labels (place, text, colour). Greedy: each label takes the first free of some
    places around its mark.
    """
    figure.canvas.draw()
    figure.set_layout_engine("none")  # what was measured stays where it is
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
    """Return places (n, 2) all along a drawn line, in points of text, some 3 apart."""
    if line.get_alpha() == 0:  # it joins nothing
        return np.zeros((0, 2))
    corners = line.axes.transData.transform(line.get_xydata()) * to_points
    corners = corners[np.isfinite(corners).all(axis=1)]
    steps = np.linspace(0.0, 1.0, 64)[:, None]
    return np.concatenate([np.zeros((0, 2)), *(a + steps * (b - a) for a, b in pairwise(corners))])


def _overlap(a: tuple[float, ...], b: tuple[float, ...]) -> bool:
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]


def error_against_setting(rows: Sequence[Row]) -> Figure | None:
    """Error against the resolution of image-space methods and against the size of grids, one line a method."""
    ranking = standings(rows)
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
    """Error against the camera's elevation, mean over meshes and azimuths; None of a single elevation."""
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
        means = [float(np.mean(sums[e])) or np.nan for e in elevations]  # a logarithm has no place for 0
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
    """Error by distance from the nearest silhouette and by angle of incidence."""
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
    """Share of wrong answers in each bin over all meshes (nan where a bin is empty or has no error), and its name."""
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
    """Time a view against the numbers of points and of faces, with exponents fitted to the larger half."""
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
