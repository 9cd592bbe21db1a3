"""A long run of `depth_buffer`: does memory stay flat, do the last answers equal the first?

    python benchmarks/soak.py [--one 200000] [--recycled 1000000] [--workers W]          0 renders: none

A render is one view's visibility: a depth buffer of the mesh, and a thousand points tested against it.

One process: calls of 100 renders, each with a mesh made, prepared and closed anew, in a context that is passed on and,
as in README, without one. A cycle of 24 calls has meshes of all classes, 64 to 256 pixels, both refinements, 500 to
2,000 points, eyes outside and inside the mesh; then the same again, and the answers must be those of the first cycle.
With recycling: four plans of other options, made by the farm's local engine as `generate` uses it; each worker is
replaced after 200 shards. The first and the last shards of each plan are then made again by a fresh
process and must be the same bytes.

Resident memory is taken after each call, and of each worker and of the parent after each shard. Warm-up is the first
tenth of a process's life (shaders compile, the allocator's arenas grow to the largest mesh); the most after it may
exceed the most during it by 5 %. Exit status 1 when it does, or when answers differ.
"""

import hashlib
import multiprocessing
import os
import tempfile
import time
from collections import defaultdict
from contextlib import nullcontext
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from common import heads, row, run
from tqdm import tqdm

import zbuf_occlude as zo
from zbuf_occlude.base.cores import n_cores
from zbuf_occlude.base.limits import Limits, resident_gigabytes
from zbuf_occlude.datasets.generate import GenerateTask, generate
from zbuf_occlude.datasets.packed import archive_name
from zbuf_occlude.datasets.plan import DatasetConfig, Plan
from zbuf_occlude.datasets.workers import local, run_here
from zbuf_occlude.engines.gl.context import GlContext
from zbuf_occlude.meshes import shapes
from zbuf_occlude.meshes.collection import MeshCollection, MeshEntry

VIEWS = 100
WARM_UP, FLAT = 0.1, 0.05
MIN_SAMPLES = 50
"""A worker that made fewer shards has no life to speak of."""
COMPARED = 5
"""This many of a plan's first and of its last shards are made again."""

CALLS = [
    {"label": label, "index": index, "resolution": resolution, "refine": refine, "points": points, "distance": distance}
    for index, resolution, refine, points, distance in (
        (1, 128, "witness", 1000, 4.0),
        (4, 256, "none", 2000, 2.0),
        (7, 64, "witness", 500, 0.2),
    )
    for label in shapes.CLASSES
]
PLANS: list[dict[str, Any]] = [
    {"method_options": {"resolution": 128}},
    {"method_options": {"resolution": 64, "refine": "none"}, "distance": 2.0},
    {"method_options": {"resolution": 256, "tolerance": 1e-3}, "n_points": 500},
    {"method_options": {"resolution": 64}, "distance": 0.3},
]


def answer(gl: GlContext | None, call: dict[str, Any]) -> str:
    """Make, prepare, ask and close; a digest of the mask."""
    mesh = shapes.make(call["label"], call["index"])
    points = zo.sample_surface(mesh, n_points=call["points"], seed=0)
    eyes = zo.views.paper100(distance=call["distance"]).around(mesh.centre, mesh.longest_side).eyes
    options = {"resolution": call["resolution"], "refine": call["refine"]}
    with zo.prepare(mesh, "depth_buffer", gl=gl, **options) as occluder:
        return hashlib.sha256(np.packbits(occluder.visible(points, eyes)).tobytes()).hexdigest()


def one_process(n_renders: int, name: str, gl_of_ours: bool) -> dict[str, Any]:
    """Render in this process alone, with a context that is passed on or with what `prepare` does without one."""
    memory, first, n_different = [], {}, 0
    began = time.perf_counter()
    with GlContext.open() if gl_of_ours else nullcontext() as gl:
        for i in tqdm(range(n_renders // VIEWS), unit="00 renders", desc=name, mininterval=10):
            number = i % len(CALLS)
            digest = answer(gl, CALLS[number])
            n_different += digest != first.setdefault(number, digest)
            memory.append(resident_gigabytes(os.getpid()))
    seconds = time.perf_counter() - began
    return {
        "renders": len(memory) * VIEWS,
        "seconds": seconds,
        "different": n_different,
        "lives": [judged("the process", memory)],
    }


def plan_of(number: int, n_renders: int) -> Plan:
    """A plan of this many renders: small built-in shapes over and over, each time with other points."""
    members = [(label, index) for index in range(8) for label in shapes.CLASSES]
    members = [m for m in members if len(shapes.make(*m).faces) < 3000]
    entries = []
    for i in range(n_renders // VIEWS):
        label, index = members[i % len(members)]
        entries.append(MeshEntry(f"{label}/{index}/{i}", label, "train", partial(shapes.make, label, index)))
    config = {"n_points": 1000, "sample_size": 16, "views": "paper100", **PLANS[number]}
    return Plan(MeshCollection(entries), DatasetConfig(**config), "packed")


def by_workers(n_renders: int, n_workers: int, folder: Path) -> dict[str, Any]:
    """Render by workers that are replaced after a while, as `generate` does."""
    lives: dict[str, list[float]] = defaultdict(list)
    report: dict[str, Any] = {"renders": 0, "workers": 0, "different": 0}
    began = time.perf_counter()
    for number in range(len(PLANS)):
        plan, out, again = plan_of(number, n_renders // len(PLANS)), folder / f"{number}", folder / f"{number}-again"
        with tqdm(total=plan.n_clouds, unit=" renders", desc=f"plan {number}", mininterval=10) as bar:

            def look(clouds: int, number: int = number, bar: Any = bar) -> None:
                bar.update(clouds)
                lives["the parent"].append(resident_gigabytes(os.getpid()))
                for process in multiprocessing.active_children():
                    lives[f"plan {number}, worker {process.pid}"].append(resident_gigabytes(process.pid))

            generate(plan, out, run=partial(local.run_local, n_workers=n_workers, limits=Limits()), progress=look)
        shards = range(len(plan.shards))
        some = sorted({*shards[:COMPARED], *shards[-COMPARED:]})
        again.mkdir()
        fresh = multiprocessing.get_context("spawn").Process(target=make_here, args=(plan, some, again))
        fresh.start()
        fresh.join()
        for shard in some:
            name = archive_name(shard)
            report["different"] += (out / name).read_bytes() != (again / name).read_bytes()
        report["renders"] += plan.n_clouds
    report["workers"] = len(lives) - 1
    report["seconds"] = time.perf_counter() - began
    report["lives"] = [judged(name, memory) for name, memory in lives.items() if len(memory) >= MIN_SAMPLES]
    return report


def make_here(plan: Plan, shards: list[int], out: Path) -> None:
    """Make some shards in this process."""
    run_here(
        GenerateTask(plan, out),
        shards,
        lambda *_: (),
    )


def judged(name: str, memory: list[float]) -> dict[str, Any]:
    """What the resident memory of one process did, in MB."""
    values = 1000.0 * np.array(memory)
    warm = max(1, int(WARM_UP * len(values)))
    during, after = float(values[:warm].max()), float(values[warm:].max())
    return {
        "name": name,
        "samples": len(values),
        "start": float(values[0]),
        "warm_up": during,
        "after": after,
        "growth": after / during - 1,
        # where memory first came within 5 % of its most: how long the warm-up really was
        "warm_after": int(np.argmax(values * (1 + FLAT) >= values.max())) / len(values),
        "quarters": [float(part.mean()) for part in np.array_split(values[warm:], 4)],
    }


def print_table(report: dict[str, Any]) -> None:
    memory = "start MB", "warm-up MB", "after MB", "growth", "warm after"
    heads("run", "process", "renders/s", *memory, "quarters", words=2)
    for name, found in report.items():
        for life in found["lives"]:
            values = [found["renders"] / found["seconds"], *(life[key] for key in ("start", "warm_up", "after"))]
            cells = [f"{name}, {found['renders']:,}", life["name"], *(f"{value:.0f}" for value in values)]
            cells += [f"{life['growth']:+.1%}", f"{life['warm_after']:.0%}"]
            row(*cells, ", ".join(f"{quarter:.0f}" for quarter in life["quarters"]))


def main(*, one: int = 200_000, recycled: int = 1_000_000, workers: int = n_cores()) -> int:
    report: dict[str, Any] = {}
    if recycled:
        with tempfile.TemporaryDirectory() as folder:
            report["recycled"] = by_workers(recycled, workers, Path(folder))
    if one:
        for name, gl_of_ours in (("one process", True), ("README's form", False)):
            report[name] = one_process(one, name, gl_of_ours)
    print_table(report)
    growth = max((life["growth"] for found in report.values() for life in found["lives"]), default=0.0)
    n_different = sum(found["different"] for found in report.values())
    print(f"answers that differ: {n_different}; most growth after warm-up: {growth:+.1%} (allowed {FLAT:.0%})")
    return int(growth > FLAT or n_different > 0)


if __name__ == "__main__":
    run(main, __doc__)
