"""README's table of methods, wrong answers and time of each: python benchmarks/method_table.py FOLDER [OPTION ...]

Runs `zbuf-occlude compare FOLDER` with its defaults (10,000 points, 15 of the paper's 100 views; options are passed on)
and writes its rows short. Wrong answers are shares of those outside the boundary band, against the oracle, means over
the meshes; times are geometric means.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

from common import row

from zbuf_occlude.cli.shell import SOME_FAILED
from zbuf_occlude.studies.compare.metrics import Ranking, rank_subjects
from zbuf_occlude.studies.compare.run import ComparisonFolder

RESOLUTIONS = (256, 512, 1024)
PLAIN, WITNESS = "depth_buffer:resolution={},refine=none", "depth_buffer:resolution={}"
ROWS = (
    ("`exact`", ["exact"], "when the answer must be right; needs no GPU"),
    ("`exact_gl`", ["exact_gl"], "the same on a GPU (not tuned for one yet)"),
    (
        "`depth_buffer` 256 / 512 / 1024",
        [WITNESS.format(n) for n in RESOLUTIONS],
        "for the paper's image-space idea: a small error that every dataset states",
    ),
    (
        "`depth_buffer` with `refine=none`",
        [PLAIN.format(n) for n in RESOLUTIONS],
        "to see what a textbook depth buffer costs",
    ),
    ("`pyrender` 512 / 1024", [f"pyrender:resolution={n}" for n in RESOLUTIONS[1:]], "the image-space peer"),
    (
        "`hidden_point_removal`",
        ["hidden_point_removal"],
        "when there is no mesh: `visible scan.ply` takes a point cloud",
    ),
    ("`vertex_hsr` (paper 3.3)", ["vertex_hsr"], "to repeat the paper"),
    (
        "`occupancy_grid` 32 / 64 (paper 3.6)",
        [f"occupancy_grid:n={n}" for n in (32, 64)],
        "to repeat the paper's data",
    ),
    ("`embree`", ["embree"], "an independent check"),
    ("`oracle`, `exact_hsr` (paper 3.5)", ["oracle", "exact_hsr"], "the reference, and the paper's own exact method"),
)
"""Of each row the methods and options, as `compare` takes them."""


def main() -> None:
    with tempfile.TemporaryDirectory() as scratch:
        out = Path(scratch) / "comparison"
        command = [sys.executable, "-m", "zbuf_occlude", "compare", *sys.argv[1:], "--out", str(out)]
        if (code := subprocess.run(command, stdout=subprocess.DEVNULL, check=False).returncode) not in (0, SOME_FAILED):
            raise SystemExit(code)
        known = {standing.subject: standing for standing in rank_subjects(ComparisonFolder(out).rows().values())}
    row("method", "wrong answers", "ms per view", "take it")
    row("---", "---:", "---:", "---")
    for name, labels, when in ROWS:
        found = [known.get(label) for label in labels]
        if any(found):
            row(name, wrong(found), " / ".join(milliseconds(one) for one in found), when)


def wrong(found: list[Ranking | None]) -> str:
    """Write shares of wrong answers, once where they are the same."""
    shares = [short(100 * one.wrong) if one else "-" for one in found]
    return " / ".join(shares[:1] if len(set(shares)) == 1 else shares) + " %"


def milliseconds(one: Ranking | None) -> str:
    """Write the time of a view."""
    return short(1e3 * one.seconds) if one else "-"


def short(value: float) -> str:
    """Write a number with two digits that count."""
    return f"{float(f'{value:.2g}'):g}"


if __name__ == "__main__":
    main()
