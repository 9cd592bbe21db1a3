"""The chart of docs/performance.md, from docs/figures.json: python benchmarks/charts.py --out docs/benchmarks.png"""

import argparse
import re
from pathlib import Path

import figures
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

OURS, PAPER, OTHERS = "#0b66b0", "#8a929c", "#d55e00"
"""Colours that the colour-blind can tell apart."""
KINDS = {
    "vertex_hsr": PAPER,
    "occupancy_grid": PAPER,
    "exact_hsr": PAPER,
    "embree": OTHERS,
    "pyrender": OTHERS,
    "hidden_point_removal": OTHERS,
}


def methods() -> list[tuple[str, float, str]]:
    """Return name, milliseconds per view and wrong answers of each row of the table of methods, the fastest first."""
    rows = []
    for line in figures.read()["methods"]["value"][2:]:
        name, wrong, time = (cell.strip() for cell in line.strip("| ").split("|")[:3])
        if "refine=none" in name:
            continue
        names = re.findall(r"`(\w+)`", name)
        sizes = re.findall(r"\d+", re.sub(r"`\w+`|\(.*\)", "", name))
        times = time.split(" / ")
        shares = wrong.rstrip("% ").split(" / ")
        for i, each in enumerate(times):
            label = f"{names[0]} {sizes[i]}" if sizes else names[i]
            rows.append((label, float(each), f"{shares[min(i, len(shares) - 1)]} %"))
    return sorted(rows, key=lambda row: row[1])


def whole_job() -> list[tuple[str, float, str]]:
    """Return name, seconds and their label of each side of the whole job."""
    lines = figures.read()["whole-job"]["value"][3:6]
    found = [re.match(r"(\S+).*?\s(\d+\.\d+)\s", line) for line in lines]
    named = {"script": "script on Open3D"}
    rows = [(named.get(m[1], m[1]), float(m[2]), f"{float(m[2]):.1f} s") for m in found if m]
    return sorted(rows, key=lambda row: row[1])


def bars(panel: Axes, rows: list[tuple[str, float, str]], title: str) -> None:
    """Draw horizontal bars, the fastest on top, each with its label."""
    kinds = [KINDS.get(name.split()[0], OTHERS if "script" in name else OURS) for name, _, _ in rows]
    drawn = panel.barh([name for name, _, _ in rows], [value for _, value, _ in rows], color=kinds)
    panel.bar_label(drawn, [label for _, _, label in rows], padding=4, fontsize=9)
    panel.invert_yaxis()
    panel.set_title(title, fontsize=11, loc="left")
    panel.spines[["top", "right"]].set_visible(False)


def main() -> None:
    """Draw both charts."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("docs/benchmarks.png"))
    given = parser.parse_args()
    figure = Figure(figsize=(11.0, 4.4), layout="constrained", facecolor="white")
    FigureCanvasAgg(figure)
    left, right = figure.subplots(1, 2, width_ratios=(3, 2))
    bars(left, methods(), "milliseconds per view (label: wrong answers)")
    left.set_xscale("log")
    left.set_xlim(0.1, 200)
    left.set_xticks([0.1, 1, 10, 100], ["0.1", "1", "10", "100"])
    for name, colour in {"this project": OURS, "the paper's methods": PAPER, "other libraries": OTHERS}.items():
        left.bar(0, 0, color=colour, label=name)
    left.legend(loc="upper right", frameon=False)
    bars(right, whole_job(), "seconds: dataset of 175 meshes")
    right.set_xlim(right=24)
    figure.savefig(given.out, format="png", dpi=110)


if __name__ == "__main__":
    main()
