"""The whole job: mesh files to a finished dataset, by `generate` and by a script of thirty lines that casts rays.

    python benchmarks/whole_job.py FOLDER [--method exact depth_buffer] [--views modelnet8] [--points 20000] [--limit N]
                                          [--repeats 3] [--against CHECKOUT] [--stages] [--cold] [--json FILE]

Each side is a whole process (`benchmarks/ray_casting_script.py`, `zbuf-occlude generate`), run in turns over the same
files, views, number of points and size of clouds; its clock is from start to end, its processor time that of it
and all processes that come from it. Compiled functions and bytecode are cached before anything is timed.

--against CHECKOUT: `generate` of another checkout of this repository takes its turns too: before and after in one run.
--stages: what each stage costs, `generate` in one process with one thread, so that the next thing to do shows.
--cold: `generate` on one mesh with nothing compiled yet.
--check: the datasets of both checkouts must be the same, record by record (their files may be laid out differently).
"""

import argparse
import ctypes
import json
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

import h5py
import numpy as np

import zbuf_occlude as zo

HERE = Path(__file__).resolve().parent
PR_SET_CHILD_SUBREAPER = 36
SUFFIXES = (".off", ".obj", ".ply", ".stl", ".glb", ".gltf")


class Job(NamedTuple):
    """What both sides are to make."""

    files: Sequence[str]
    views: str
    n_points: int
    sample_size: int


class Cost(NamedTuple):
    """Seconds of a whole process."""

    clock: float
    processors: float


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


def command_of(side: Side, job: Job, folder: Path, out: Path) -> list[str]:
    if not side.method:
        eyes = folder / "eyes.npy"
        numbers = [str(job.n_points), str(job.sample_size)]
        return [sys.executable, str(HERE / "ray_casting_script.py"), str(out), str(eyes), *numbers, *job.files]
    return [sys.executable, "-m", "zbuf_occlude", "generate", *job.files, "--out", str(out), *options_of(side, job)]


def options_of(side: Side, job: Job) -> list[str]:
    sizes = ["--points", str(job.n_points), "--sample-size", str(job.sample_size)]
    return ["--method", side.method, "--views", job.views, *sizes]


def run(command: list[str], checkout: Path, out: Path, **environment: str) -> Cost:
    """Run a command from outside any checkout, with the package of one of them; what it says is kept for errors."""
    variables = {**os.environ, "PYTHONPATH": str(checkout), **environment}
    variables.pop("PYTHONDONTWRITEBYTECODE", None)  # what is installed has its bytecode
    with open(out.with_suffix(".log"), "w+") as log:
        began = time.perf_counter()
        process = subprocess.Popen(command, cwd=out.parent, env=variables, stdout=log, stderr=log)
        _, status, usage = os.wait4(process.pid, 0)  # with those that it waited for
        clock = time.perf_counter() - began
        processors = usage.ru_utime + usage.ru_stime + of_orphans()
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode not in (0, 3):  # 3: done, some meshes failed
            log.seek(0)
            raise SystemExit(f"error: {' '.join(command)[:300]} ended with {process.returncode}:\n{log.read()[-2000:]}")
    return Cost(clock, processors)


def of_orphans() -> float:
    """Wait for those that a process has left behind, which are this one's now; return their seconds of processors."""
    seconds = 0.0
    with suppress(ChildProcessError):  # none is left
        while True:
            usage = os.wait4(-1, 0)[2]
            seconds += usage.ru_utime + usage.ru_stime
    return seconds


def fresh(out: Path) -> Path:
    """Empty a folder, or make it."""
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir()
    return out


def in_turns(sides: list[Side], job: Job, repeats: int, folder: Path) -> dict[str, list[Cost]]:
    costs: dict[str, list[Cost]] = {side.name: [] for side in sides}
    for turn in range(repeats):
        for side in sides:
            out = fresh(folder / "out")
            cost = run(command_of(side, job, folder, out), side.checkout, out)
            costs[side.name].append(cost)
            print(f"turn {turn + 1}: {side.name} {cost.clock:.2f} s, {cost.processors:.2f} s", file=sys.stderr)
    return costs


def show(costs: dict[str, list[Cost]]) -> None:
    """Print medians, and medians of the ratios to the first side, turn by turn."""
    first = next(iter(costs.values()))
    print(f"\n{'':<28}{'clock s':>9}{'processor s':>13}{'x clock':>9}{'x processor':>13}   (x: of the first row)")
    for name, mine in costs.items():
        clock, processors = (statistics.median(values) for values in zip(*mine, strict=True))
        ratios = [(a.clock / b.clock, a.processors / b.processors) for a, b in zip(first, mine, strict=True)]
        faster, cheaper = (statistics.median(values) for values in zip(*ratios, strict=True))
        print(f"{name:<28}{clock:>9.2f}{processors:>13.2f}{faster:>9.2f}{cheaper:>13.2f}")


def show_stages(side: Side, job: Job, folder: Path) -> None:
    out = fresh(folder / "stages")
    report = folder / "stages.json"
    command = [
        sys.executable,
        str(HERE / "whole_job_stages.py"),
        str(report),
        str(out),
        *options_of(side, job),
        *job.files,
    ]
    one = {"NUMBA_NUM_THREADS": "1", "LP_NUM_THREADS": "0", "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    run(command, side.checkout, out, **one)
    rows = json.loads(report.read_text())
    whole = sum(row["processors"] for row in rows)
    print(f"\n{side.name}, one process, one thread\n{'':<12}{'clock s':>9}{'processor s':>13}{'share':>8}{'calls':>8}")
    for row in rows:
        share = row["processors"] / whole
        print(f"{row['stage']:<12}{row['clock']:>9.2f}{row['processors']:>13.2f}{share:>8.1%}{row['calls']:>8}")
    print(f"{'all':<12}{sum(row['clock'] for row in rows):>9.2f}{whole:>13.2f}")


def show_cold(side: Side, job: Job, folder: Path) -> None:
    with tempfile.TemporaryDirectory() as cache:
        out = fresh(folder / "cold")
        cost = run(
            command_of(side, job._replace(files=job.files[:1]), folder, out), side.checkout, out, NUMBA_CACHE_DIR=cache
        )
    print(f"\n{side.name}, one mesh, nothing compiled: {cost.clock:.1f} s, {cost.processors:.1f} s of processors")


def check(sides: list[Side], job: Job, folder: Path) -> None:
    """Make the dataset with both checkouts and compare record by record."""
    outs = []
    for side in sides:
        outs.append(fresh(folder / f"checked {side.name}"))
        run(command_of(side, job, folder, outs[-1]), side.checkout, outs[-1])
    names = [sorted(path.name for path in out.glob("*.h5")) for out in outs]
    if names[0] != names[1]:
        raise SystemExit(f"error: the two checkouts must write the same files; they write {names[0]} and {names[1]}.")
    n_clouds = 0
    for name in names[0]:
        with h5py.File(outs[0] / name) as mine, h5py.File(outs[1] / name) as theirs:
            differing = [field for field in theirs if not np.array_equal(mine[field][:], theirs[field][:])]
            n_clouds += len(mine["label"])
        if differing:
            raise SystemExit(f"error: {name} must be the same in both checkouts; it differs in {', '.join(differing)}.")
    print(f"\n{sides[0].name}: {n_clouds:,} clouds, the same in both checkouts")


def arguments_given() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--method", nargs="+", default=["exact", "depth_buffer"])
    parser.add_argument("--views", default="modelnet8")
    parser.add_argument("--points", type=int, default=20_000)
    parser.add_argument("--sample-size", type=int, default=2048)
    parser.add_argument("--limit", type=int, help="this many files, evenly spread over the folder")
    parser.add_argument("--repeats", type=int, default=3, help="turns of each side; 0: only what is asked for below")
    parser.add_argument("--no-script", action="store_true", help="only `generate` takes turns")
    parser.add_argument("--against", type=Path, metavar="CHECKOUT")
    parser.add_argument("--stages", action="store_true")
    parser.add_argument("--cold", action="store_true")
    parser.add_argument("--check", action="store_true", help="needs --against")
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    if arguments.check and arguments.against is None:
        parser.error("--check needs --against CHECKOUT")
    return arguments


def main() -> None:
    arguments = arguments_given()
    ctypes.CDLL(None).prctl(PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)  # orphans come to this process, to be counted
    files = chosen_files(arguments.folder, arguments.limit)
    job = Job(files, arguments.views, arguments.points, arguments.sample_size)
    pairs = []  # of each method, here and in the other checkout
    for method in arguments.method:
        pair = [Side(method, method, HERE.parent)]
        if arguments.against is not None:
            pair.append(Side(f"{method}, other checkout", method, arguments.against.resolve()))
        pairs.append(pair)
    sides = [side for pair in pairs for side in pair]
    print(f"{len(job.files)} meshes, views {job.views}, {job.n_points:,} points, clouds of {job.sample_size:,}")
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        np.save(folder / "eyes.npy", zo.views.parse(job.views).eyes)
        for side in sides:  # fill the caches
            run(
                command_of(side, job._replace(files=job.files[:2]), folder, fresh(folder / "warm")),
                side.checkout,
                folder / "warm",
            )
        if arguments.repeats:
            script = [] if arguments.no_script else [Side("script (trimesh, Open3D)", "", HERE.parent)]
            costs = in_turns([*script, *sides], job, arguments.repeats, folder)
            show(costs)
            if arguments.json is not None:
                arguments.json.write_text(json.dumps(costs, indent=1) + "\n")
        for side in sides:
            if arguments.stages:
                show_stages(side, job, folder)
            if arguments.cold:
                show_cold(side, job, folder)
        for pair in pairs:
            if arguments.check:
                check(pair, job, folder)


if __name__ == "__main__":
    main()
