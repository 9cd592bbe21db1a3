"""The paper's object-space methods: what each modification saves, what it gets wrong, how cost grows. Markdown.

    python benchmarks/object_space.py culling [MESH ...]      # Table 1A: both suggestions of section 3.6
    python benchmarks/object_space.py grid [MESH ...]         # Table 1B: occupancy grids against exact HSR
    python benchmarks/object_space.py errors MESH [MESH ...]  # the grid's and the vertices' error against `exact`
    python benchmarks/object_space.py growth                  # fitted exponents over points, faces and cells

Without a mesh and --faces, built-in cars of the paper's 13,164 and 18,014 faces. Views are every 20th of the paper's
100. Times are processor seconds of one core, which other programs on the machine disturb least: medians of rounds in
which the methods take turns; the first, which compiles, is thrown away. Ratios are what counts.
"""

import statistics
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np
from common import heads, in_turns, rates, row, run

import zbuf_occlude as zo
from zbuf_occlude.base.jit.threads import use_threads
from zbuf_occlude.meshes.load import load_mesh
from zbuf_occlude.meshes.shapes import benchmark_mesh
from zbuf_occlude.visibility.interface import VisibilityQuery

EYES = zo.views.paper100().eyes[::20]
ROUNDS = 3
Question = tuple[VisibilityQuery, zo.SurfacePoints]


def main(what: str, *meshes: Path, faces: Sequence[int] = ()) -> None:
    use_threads(1)
    if what == "growth":
        return growth()
    some = [load_mesh(path).normalized() for path in meshes]
    cars = faces or (() if meshes else (13_164, 18_014))
    return ON_MESHES[what]([*some, *(benchmark_mesh(n, "car").normalized() for n in cars)])


def seconds_per_view(questions: Sequence[Question], rounds: int = ROUNDS) -> list[float]:
    """Median seconds per view of each question, asked in turns."""
    jobs = {f"{i}": partial(occluder.visible, points, EYES) for i, (occluder, points) in enumerate(questions)}
    times = in_turns(jobs, rounds + 1, time.process_time)
    return [statistics.median(taken[1:]) / len(EYES) for taken in times.values()]


def culling(meshes: list[zo.Mesh]) -> None:
    """Time, tests and answers changed of both suggestions, by vertices and by points."""
    heads("mesh, what is tested", "suggestion, samples", "time saved", "tests saved", "answers changed", words=2)
    samples = (1_000, 10_000, 100_000)
    for mesh in meshes:
        points = zo.sample_surface(mesh, n_points=min(5_000, 2 * len(mesh.faces)), seed=0)
        by_vertices = [
            zo.prepare(mesh, "vertex_hsr"),
            zo.prepare(mesh, "vertex_hsr_culled", suggestion=1),
            *(zo.prepare(mesh, "vertex_hsr_culled", suggestion=2, n_samples=n) for n in samples),
        ]
        by_points = [
            zo.prepare(mesh, "exact_hsr"),
            zo.prepare(mesh, "exact_hsr", cull="first"),
            *(zo.prepare(mesh, "exact_hsr", cull="second", n_samples=n) for n in samples),
        ]
        for what, occluders in (
            (f"{len(mesh.vertices):,} vertices", by_vertices),
            (f"{len(points):,} points (`exact_hsr`)", by_points),
        ):
            times = seconds_per_view([(occluder, points) for occluder in occluders])
            answers = [occluder.visible(points, EYES) for occluder in occluders]
            tests = [float(np.mean(occluder.n_tests)) for occluder in occluders]  # type: ignore[attr-defined]
            first = f"{mesh.name}, {len(mesh.faces):,} faces, {what}"
            labels = ["first", *(f"second, {n:,}" for n in samples)]
            for label, taken, n_tests, answer in zip(labels, times[1:], tests[1:], answers[1:], strict=True):
                saved = f"{100 * (1 - taken / times[0]):.0f} %", f"{100 * (1 - n_tests / tests[0]):.1f} %"
                row(first, label, *saved, f"{(answer != answers[0]).mean():.1e}")
                first = ""


def grid(meshes: list[zo.Mesh]) -> None:
    """Time of exact HSR and of grids for the paper's numbers of points, and the grids' error."""
    times = "grid, ms per view", "reduction", "with preparing"
    heads("mesh", "points", "exact HSR, ms per view", "n", *times, "error")
    for mesh in meshes:
        for n_points in (1_000, 10_000, 50_000):
            points = zo.sample_surface(mesh, n_points=n_points, seed=0)
            exact = zo.prepare(mesh, "exact_hsr")
            grids = []
            preparing = []
            for n in (32, 64):
                start = time.process_time()
                grids.append(zo.prepare(mesh, "occupancy_grid", n=n))
                preparing.append(time.process_time() - start)
            slow = seconds_per_view([(exact, points)], rounds=1)[0]
            fast = seconds_per_view([(g, points) for g in grids], rounds=9)
            truth = exact.visible(points, EYES)
            for n, occluder, taken, made in zip((32, 64), grids, fast, preparing, strict=True):
                error = (occluder.visible(points, EYES) != truth).mean()
                saved = f"{100 * (1 - taken / slow):.2f} %", f"{100 * (1 - (taken + made) / slow):.1f} %"
                row(mesh.name, f"{n_points:,}", f"{1e3 * slow:.1f}", n, f"{1e3 * taken:.2f}", *saved, f"{error:.3f}")


def errors(meshes: list[zo.Mesh]) -> None:
    """False visible and false hidden of the approximate methods, means over the meshes."""
    vertices = {"as it is": {"divide": 1.0}} | {f"`divide={d:g}`": {"divide": d} for d in (1e-3, 1e-4)}
    grids: dict[str, dict[str, float]] = {f"n = {n}": {"n": n} for n in (16, 32, 64)}
    tables: dict[str, list[tuple[str, str, dict[str, float]]]] = {
        "vertex_hsr": [(label, "vertex_hsr", options) for label, options in vertices.items()],
        "occupancy_grid": [
            *((label, "occupancy_grid", options) for label, options in grids.items()),
            ("n = 128, 400,000 samples", "occupancy_grid", {"n": 128, "n_samples": 400_000}),
            ("`hidden_point_removal`", "hidden_point_removal", {}),
            ("the same, `radius=100`, as in Open3D's tutorial", "hidden_point_removal", {"radius": 100.0}),
        ],
    }
    samples = [zo.sample_surface(mesh, n_points=5_000, seed=0) for mesh in meshes]
    truths = [zo.prepare(mesh, "exact").visible(points, EYES) for mesh, points in zip(meshes, samples, strict=True)]
    for heading, rows in tables.items():
        print(f"\n## {heading}\n")
        heads("", "agreement", "false visible", "false hidden")
        for label, method, options in rows:
            shares = []
            for mesh, points, truth in zip(meshes, samples, truths, strict=True):
                with zo.prepare(mesh, method, **options) as occluder:
                    shares.append(rates(occluder.visible(points, EYES), truth))
            row(label, *(f"{share:.3f}" for share in np.mean(shares, axis=0)))


def growth() -> None:
    """Fit exponents: time over one number while the others stay."""
    heads("method", "over", "numbers", "ms per view", "exponent", words=4)
    mesh = benchmark_mesh(4_000, "chair").normalized()
    counts = (2_000, 4_000, 8_000, 16_000)
    samples = [zo.sample_surface(mesh, n_points=n, seed=0) for n in counts]
    exact = zo.prepare(mesh, "exact_hsr")
    fit("exact_hsr", "points N", counts, seconds_per_view([(exact, points) for points in samples]))
    faces = (2_000, 4_000, 8_000, 16_000)
    divided = [benchmark_mesh(n, "chair").normalized() for n in faces]
    points = [zo.sample_surface(m, n_points=2_000, seed=0) for m in divided]
    for method in ("exact_hsr", "vertex_hsr"):
        questions = [(zo.prepare(m, method), p) for m, p in zip(divided, points, strict=True)]
        fit(method, "faces M", faces, seconds_per_view(questions))
    counts = (10_000, 30_000, 100_000, 300_000, 1_000_000)
    samples = [zo.sample_surface(mesh, n_points=n, seed=0) for n in counts]
    for n in (32, 64):
        occluder = zo.prepare(mesh, "occupancy_grid", n=n)
        fit(f"occupancy_grid n={n}", "points N", counts, seconds_per_view([(occluder, p) for p in samples], 9))
    counts, times = [], []
    for n in (16, 32, 64, 128, 256):
        occupancy = zo.prepare(mesh, "occupancy_grid", n=n, n_samples=1_000_000).grid  # type: ignore[attr-defined]
        cells = np.argwhere(occupancy.occupied).astype(np.int32)
        taken = []
        for eye in EYES:
            start = time.process_time()
            occupancy.occluded_cells(cells, eye)
            taken.append(time.process_time() - start)
        counts.append(len(cells))
        times.append(statistics.median(taken))
    fit("occupancy_grid n=16..256, lines of sight alone", "occupied cells", counts, times)


def fit(method: str, over: str, numbers: Sequence[int], seconds: Sequence[float]) -> None:
    exponent = np.polyfit(np.log(numbers), np.log(seconds), 1)[0]
    row(
        method,
        over,
        ", ".join(f"{n:,}" for n in numbers),
        ", ".join(f"{1e3 * s:.2f}" for s in seconds),
        f"{exponent:.2f}",
    )


ON_MESHES = {"culling": culling, "grid": grid, "errors": errors}


if __name__ == "__main__":
    run(main, __doc__, what=["growth", *ON_MESHES])
