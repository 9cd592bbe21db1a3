"""What datasets of different kinds cost: the paper's presets and scans of built-in shapes. Markdown, a row for each.

    python benchmarks/dataset_costs.py presets [--limit 16]   # of the presets' 200 and 600 objects this many
    python benchmarks/dataset_costs.py scans [--limit 16]

Each row is a whole `zbuf-occlude generate`, with everything compiled; its seconds are those of processors, of the
command and all processes that come from it, which other programs on the machine disturb least. What a further cloud
takes is reckoned from that and from the same with one object, so that starting does not count.
"""

import json
import sys
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

from common import cost_of, heads, row, run

GRID_32, GRID_64 = (f"--method occupancy_grid --set n={n}" for n in (32, 64))
SCANS = "--sensor hdl-64e --range 5..50 --size airplane=6"


class Row(NamedTuple):
    """One dataset, as the table names it."""

    name: str
    arguments: str
    verified: bool = False


ROWS = {
    "presets": (
        Row("`paper-modelnet40`", "--preset paper-modelnet40", verified=True),
        Row(f"the same, `{GRID_32}`", f"--preset paper-modelnet40 {GRID_32}"),
        Row("`paper-modelnet8`", "--preset paper-modelnet8"),
        Row(f"the same, `{GRID_64}`", f"--preset paper-modelnet8 {GRID_64}"),
    ),
    "scans": (
        Row("of single objects", f"{SCANS} --views ring:25@0"),
        Row("in streets", f"{SCANS} --views ring:10@0 --scene street"),
    ),
}


def main(what: str, *, limit: int = 16) -> None:
    heads("", "clouds", "processors", "per further cloud", "on disk", "clouds per MB", "wrong")
    with tempfile.TemporaryDirectory() as place:
        for number, dataset in enumerate(ROWS[what]):
            out = Path(place, str(number))
            generate = ["generate", *dataset.arguments.split(), "--out", str(out)]
            starts = [cost([*generate, "--limit", "1", "--overwrite"], out) for _ in range(2)]  # the first compiles
            n_first = contents(out)[0]
            seconds = cost([*generate, "--limit", str(limit), "--overwrite"], out)
            n_clouds, megabytes, wrong = contents(out)
            each = (seconds - starts[1]) / (n_clouds - n_first)
            disk = f"{megabytes:.0f} MB", f"{n_clouds / megabytes:,.0f}"
            row(
                dataset.name, f"{n_clouds:,}", f"{seconds:.1f} s", f"{1e3 * each:.2g} ms", *disk, f"{100 * wrong:.2g} %"
            )
            if dataset.verified:
                seconds = cost(["verify", str(out)], out)
                each = seconds / n_clouds
                row("`verify` of it", f"{n_clouds:,}", f"{seconds:.1f} s", f"{1e3 * each:.2g} ms", "", "", "")


def cost(arguments: list[str], out: Path) -> float:
    """Return the processor seconds of a command."""
    return cost_of([sys.executable, "-m", "zbuf_occlude", *arguments], out).processors


def contents(out: Path) -> tuple[int, float, float]:
    """Return a dataset's number of clouds, without complete ones, its megabytes and its share of wrong answers."""
    manifest: dict[str, Any] = json.loads((out / "manifest.json").read_text(encoding="utf-8"))
    size = sum(path.stat().st_size for path in out.rglob("*") if path.is_file() and path.suffix != ".png")
    error = manifest["error"]
    return manifest["counts"]["clouds"], size / 1e6, error["false_visible"] + error["false_hidden"]


if __name__ == "__main__":
    run(main, __doc__, what=ROWS)
