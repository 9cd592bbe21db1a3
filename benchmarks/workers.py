"""What a second worker gains for layouts of completion benchmarks, and the most on the disk. Markdown, a row for each.

    python benchmarks/workers.py [MESH_OR_DIR ...] [--limit 200] [--repeats 3] [--formats pcn ...]

Of each layout `generate` (`--method exact`, the views that the layout asks for), `convert` to it from `packed` of as
many points, and `verify`, in turns with one and with two workers, as whole processes with everything compiled. Without
MESH_OR_DIR the built-in shapes. The clock is the median; processors are those of the command and of all that come
from it; the most on the disk is looked for while it runs, every 20 ms, in blocks of the file system, with two workers.
"""

import argparse
import ctypes
import os
import statistics
import sys
import tempfile
from pathlib import Path
from threading import Event, Thread

from whole_job import HERE, PR_SET_CHILD_SUBREAPER, Cost, fresh, run

from zbuf_occlude.dataset.formats import find_format

LAYOUTS = ("pcn", "completion3d", "mvp", "projected-shapenet", "shapenet55")
WORKERS = (1, 2)


def size_of(folder: Path) -> int:
    """Bytes of all files in a folder, as far as they take room on the disk."""
    total = 0
    for place, _, names in os.walk(folder):
        for name in names:
            try:
                total += 512 * os.stat(os.path.join(place, name)).st_blocks
            except FileNotFoundError:
                continue  # it has just gone
    return total


def most_while(command: list[str], out: Path) -> tuple[Cost, int]:
    """Run a command; return what it took, and the most that was in a folder."""
    ended, most = Event(), [0]

    def look() -> None:
        while not ended.wait(0.02):
            most.append(size_of(out))

    looking = Thread(target=look)
    looking.start()
    try:
        return run(command, HERE.parent, out), max(most)
    finally:
        ended.set()
        looking.join()


def zbuf_occlude(*arguments: object) -> list[str]:
    return [sys.executable, "-m", "zbuf_occlude", *map(str, arguments)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("meshes", nargs="*", type=Path, metavar="MESH_OR_DIR")
    parser.add_argument("--limit", type=int, default=200)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--formats", nargs="+", default=LAYOUTS, choices=LAYOUTS)
    options = parser.parse_args()
    ctypes.CDLL(None).prctl(PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)  # orphans come to this process, to be counted
    meshes = [path.resolve() for path in options.meshes]
    print("| | clock, 1 worker | 2 workers | processors, 1 worker | 2 workers | most on the disk | dataset |")
    print("| --- | ---: | ---: | ---: | ---: | ---: | ---: |")
    with tempfile.TemporaryDirectory() as place:
        out, packed = Path(place, "out"), Path(place, "packed")
        for layout in options.formats:
            wanted = find_format(layout).options
            make = ("generate", *meshes, "--limit", options.limit, "--method", "exact")
            views = ("--views", wanted["views"], "--scale", wanted["scale"])
            run(zbuf_occlude(*make, *views, "--format", "packed", "--out", fresh(packed)), HERE.parent, packed)
            commands = {
                f"`{layout}`": zbuf_occlude(*make, "--format", layout, "--out", out),
                f"`convert` to `{layout}`": zbuf_occlude("convert", packed, "--format", layout, "--out", out),
                f"`verify` of `{layout}`": zbuf_occlude("verify", out, *meshes),
            }
            for name, command in commands.items():
                print(f"| {name} | {' | '.join(cells(command, out, options.repeats))} |", flush=True)


def cells(command: list[str], out: Path, repeats: int) -> list[str]:
    """Return a row of the table: clock and processors, with one and with two workers; the most on the disk, the end."""
    costs: dict[int, list[Cost]] = {n_workers: [] for n_workers in WORKERS}
    most = 0
    for _ in range(repeats):
        for n_workers, mine in costs.items():
            if "verify" not in command:
                fresh(out)
            cost, most = most_while([*command, "--workers", str(n_workers)], out)
            mine.append(cost)
    clocks, processors = ([statistics.median(values) for values in zip(*mine, strict=True)] for mine in costs.values())
    times = [f"{median:.1f} s" for pair in zip(clocks, processors, strict=True) for median in pair]
    return [*times, f"{most / 1e6:,.0f} MB", f"{size_of(out) / 1e6:,.0f} MB"]


if __name__ == "__main__":
    main()
