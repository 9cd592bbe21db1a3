"""The whole job: mesh files to a finished dataset, by `generate` and by a script of thirty lines that casts rays.

    python benchmarks/whole_job.py FOLDER [--method exact depth_buffer] [--views modelnet8] [--points 20000] [--limit N]
                                          [--sample-size 2048] [--repeats 3] [--no-script] [--against CHECKOUT]
                                          [--stages] [--cold]

Each side is a whole process (`benchmarks/ray_casting_script.py`, `zbuf-occlude generate`), run in turns over the same
files, views, number of points and size of clouds; its clock is from start to end, its processor time that of it
and all processes that come from it. Compiled functions and bytecode are cached before anything is timed.

--limit: so many files, evenly spread over the folder. --repeats 0: only what is asked for below.
--no-script: only `generate` takes turns.
--against CHECKOUT: `generate` of another checkout of this repository takes its turns too: before and after in one run.
--stages: what each stage costs, `generate` in one process with one thread, so that the next thing to do shows.
--cold: `generate` on one mesh with nothing compiled yet.
"""

import json
import shutil
import statistics
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from common import ROOT, Cost, cost_of, run

import zbuf_occlude as zo

SUFFIXES = (".off", ".obj", ".ply", ".stl", ".glb", ".gltf")


class Job(NamedTuple):
    """What both sides are to make."""

    files: Sequence[str]
    views: str
    n_points: int
    sample_size: int


class Side(NamedTuple):
    """One of those that take turns."""

    name: str
    method: str  # "" for the script
    checkout: Path


def chosen_files(folder: Path, limit: int | None) -> list[str]:
    """Mesh files of a folder; with a limit, evenly spread over them."""
    found = sorted(str(path.resolve()) for path in folder.rglob("*") if path.suffix.lower() in SUFFIXES)
    if not found:
        raise SystemExit(f"error: {folder} must have mesh files in it ({', '.join(SUFFIXES)}); it has none.")
    n = min(limit or len(found), len(found))
    return [found[i * len(found) // n] for i in range(n)]


def made(side: Side, job: Job, folder: Path, **environment: str) -> Cost:
    """Make the dataset in an empty folder."""
    out, sizes = fresh(folder / "out"), (str(job.n_points), str(job.sample_size))
    if side.method:
        options = ["--method", side.method, "--views", job.views, "--points", sizes[0], "--sample-size", sizes[1]]
        command = ["-m", "zbuf_occlude", "generate", *job.files, "--out", str(out), *options]
    else:
        script = ROOT / "benchmarks" / "ray_casting_script.py"
        command = [str(script), str(out), str(folder / "eyes.npy"), *sizes, *job.files]
    return cost_of([sys.executable, *command], out, side.checkout, **environment)


def fresh(out: Path) -> Path:
    """Empty a folder, or make it."""
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir()
    return out


def in_turns(sides: list[Side], job: Job, repeats: int, folder: Path) -> dict[str, list[Cost]]:
    costs: dict[str, list[Cost]] = {side.name: [] for side in sides}
    for turn in range(repeats):
        for side in sides:
            cost = made(side, job, folder)
            costs[side.name].append(cost)
            print(f"turn {turn + 1}: {side.name} {cost.clock:.2f} s, {cost.processors:.2f} s", file=sys.stderr)
    return costs


def show(costs: dict[str, list[Cost]]) -> None:
    """Print medians, and medians of the ratios to the first side, turn by turn."""
    first = next(iter(costs.values()))
    print(f"\n{'':<28}{'clock s':>9}{'processor s':>13}{'x clock':>9}{'x processor':>13}   (x: of the first row)")
    for name, mine in costs.items():
        clock, processors, _ = (statistics.median(values) for values in zip(*mine, strict=True))
        ratios = [(a.clock / b.clock, a.processors / b.processors) for a, b in zip(first, mine, strict=True)]
        faster, cheaper = (statistics.median(values) for values in zip(*ratios, strict=True))
        print(f"{name:<28}{clock:>9.2f}{processors:>13.2f}{faster:>9.2f}{cheaper:>13.2f}")


def show_stages(side: Side, job: Job, folder: Path) -> None:
    out, report = fresh(folder / "stages"), folder / "stages.json"
    script = ROOT / "benchmarks" / "whole_job_stages.py"
    config = {"method": side.method, "views": job.views, "n_points": job.n_points, "sample_size": job.sample_size}
    command = [sys.executable, str(script), str(report), str(out), json.dumps(config), *job.files]
    one = {"NUMBA_NUM_THREADS": "1", "LP_NUM_THREADS": "0", "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    cost_of(command, out, side.checkout, **one)
    rows = json.loads(report.read_text())
    whole = sum(row["processors"] for row in rows)
    print(f"\n{side.name}, one process, one thread\n{'':<12}{'clock s':>9}{'processor s':>13}{'share':>8}{'calls':>8}")
    for row in rows:
        share = row["processors"] / whole
        print(f"{row['stage']:<12}{row['clock']:>9.2f}{row['processors']:>13.2f}{share:>8.1%}{row['calls']:>8}")
    print(f"{'all':<12}{sum(row['clock'] for row in rows):>9.2f}{whole:>13.2f}")


def show_cold(side: Side, job: Job, folder: Path) -> None:
    with tempfile.TemporaryDirectory() as cache:
        cost = made(side, job._replace(files=job.files[:1]), folder, NUMBA_CACHE_DIR=cache)
    print(f"\n{side.name}, one mesh, nothing compiled: {cost.clock:.1f} s, {cost.processors:.1f} s of processors")


def main(
    folder: Path,
    *,
    method: Sequence[str] = ("exact", "depth_buffer"),
    views: str = "modelnet8",
    points: int = 20_000,
    sample_size: int = 2048,
    limit: int | None = None,
    repeats: int = 3,
    no_script: bool = False,
    against: Path | None = None,
    stages: bool = False,
    cold: bool = False,
) -> None:
    job = Job(chosen_files(folder, limit), views, points, sample_size)
    sides = []
    for name in method:
        sides.append(Side(name, name, ROOT))
        if against is not None:
            sides.append(Side(f"{name}, other checkout", name, against.resolve()))
    print(f"{len(job.files)} meshes, views {job.views}, {job.n_points:,} points, clouds of {job.sample_size:,}")
    with tempfile.TemporaryDirectory() as place:
        work = Path(place)
        np.save(work / "eyes.npy", zo.views.parse(job.views).eyes)
        for side in sides:  # fill the caches
            made(side, job._replace(files=job.files[:2]), work)
        if repeats:
            script = [] if no_script else [Side("script (trimesh, Open3D)", "", ROOT)]
            show(in_turns([*script, *sides], job, repeats, work))
        for side in sides:
            if stages:
                show_stages(side, job, work)
            if cold:
                show_cold(side, job, work)


if __name__ == "__main__":
    run(main, __doc__)
