"""The plots of a report: from rows to matplotlib figures, nothing computed but means and fits."""

import re
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter, NullLocator

from zbuf_occlude.compare.summary import Row, Standing, fit_power, front, representatives, standings

COLOURS = {
    "depth_buffer": "#0072b2",
    "exact": "#d55e00",
    "exact_gl": "#e69f00",
    "oracle": "#333333",
    "embree": "#009e73",
    "pyrender": "#56b4e9",
    "vertex_hsr": "#a6761d",
    "vertex_hsr_culled": "#c9a66b",
    "exact_hsr": "#882255",
    "occupancy_grid": "#cc79a7",
    "hidden_point_removal": "#999933",
}
MARKS = {"exact": "*", "exact_gl": "*", "oracle": "s", "embree": "D", "pyrender": "v", "hidden_point_removal": "^"}
GREY = "#555555"
SIDES = ("left", "right")
"""Which side of a label lies at its mark."""


def all_plots(rows: Sequence[Row]) -> dict[str, Figure]:
    """Return every plot that the rows have data for, by file name without its ending."""
    judged = [row for row in rows if row["suite"] == "meshes"]
    ranking = standings(judged)
    timed = [row for row in rows if row["suite"] == "scaling" and row["status"] == "ok"]
    figures = {
        "pareto": pareto(ranking) if ranking else None,
        "resolution": error_against_setting(judged),
        "elevation": error_against_elevation(judged, ranking),
        "where": error_by_place(judged, ranking),
        "scaling": time_against_size(timed) if timed else None,
    }
    return {name: figure for name, figure in figures.items() if figure is not None}


def canvas(width: float, height: float, columns: int = 1, rows: int = 1, **options: Any) -> tuple[Figure, Any]:
    """Return a figure of a size in inches, and its axes (rows, columns), or (columns,) of one row; in one style."""
    figure = Figure(figsize=(width, height), layout="constrained", facecolor="white")
    FigureCanvasAgg(figure)
    panels = figure.subplots(rows, columns, squeeze=False, **options)
    for axes in panels.flat:
        axes.spines[["top", "right"]].set_visible(False)
        axes.grid(color="#e6e6e6", linewidth=0.7)
        axes.set_axisbelow(True)
        axes.tick_params(labelsize=9, colors=GREY)
    return figure, panels[0] if rows == 1 else panels


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


def pareto(ranking: Sequence[Standing]) -> Figure:
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
    """Write a label beside each place, moved up or down until none covers another or a mark.

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
    shifts = [sign * 9.0 * step for step in range(12) for sign in (1.0, -1.0)]
    for (x, y), (place, text, tint) in sorted(zip(places, labels, strict=True), key=lambda item: -item[0][1]):
        span = width * len(text)
        free = None
        for shift in shifts:
            for side in sides:
                left = x + 8 if side == "left" else x - 8 - span
                candidate = (left, y + shift - height / 2, left + span, y + shift + height / 2)
                inside = candidate[0] > box.x0 * to_points and candidate[2] < box.x1 * to_points
                inside &= candidate[1] > box.y0 * to_points
                if inside and not any(_overlap(candidate, other) for other in taken):
                    free = (candidate, shift, side)
                    break
            if free:
                break
        candidate, shift, side = free or ((x, y, x, y), 0.0, "left")
        taken.append(candidate)
        offset = (8 if side == "left" else -8, shift)
        axes.annotate(
            text, place, xytext=offset, textcoords="offset points",
            ha=side, va="center", fontsize=8, color=tint,
            arrowprops={"arrowstyle": "-", "color": tint, "linewidth": 0.5, "alpha": 0.6} if abs(shift) > 9 else None,
        )  # fmt: skip


def _overlap(a: tuple[float, ...], b: tuple[float, ...]) -> bool:
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]


def error_against_setting(rows: Sequence[Row]) -> Figure | None:
    """Error against the resolution of image-space methods and against the size of grids, one line a method."""
    ranking = standings(rows)
    options = {row["subject"]: row["options"] for row in rows}
    panels = []
    for key, title in (("resolution", "pixels on a side of the image"), ("n", "cells on a side of the grid")):
        lines: dict[tuple[str, str], list[tuple[float, Standing]]] = {}
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


def error_against_elevation(rows: Sequence[Row], ranking: Sequence[Standing]) -> Figure | None:
    """Error against the camera's elevation, mean over meshes and azimuths."""
    shown = [s for s in representatives(ranking) if s.wrong > 0]
    if not shown:
        return None
    figure, (axes,) = canvas(7.2, 4.2)
    labels = []
    for one in shown:
        sums: dict[float, list[float]] = {}
        for row in rows:
            if row["subject"] == one.subject and row["status"] == "ok":
                for view in row["judged"]["views"]:
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


def error_by_place(rows: Sequence[Row], ranking: Sequence[Standing]) -> Figure | None:
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
    bins = sorted(upto for upto in totals if upto is not None) + ([None] if None in totals else [])
    errors = [totals[upto][1] / totals[upto][0] if totals[upto][1] else float("nan") for upto in bins]
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
            _, exponent = fit_power(x[-3:], y[-3:])
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
