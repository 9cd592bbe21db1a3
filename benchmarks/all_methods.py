"""Every method of the table against Embree, over numbers of faces and points: milliseconds per view, errors, growth.

    python benchmarks/all_methods.py [--faces 340 2600 19000 31000 1000000] [--points 2000 10000 50000 500000 1000000]
                                     [--seconds 1.5] [--rounds 3]

100 eyes (`paper100`); meshes of tiny faces (`shapes.benchmark_mesh`), below 1,500 faces a bookshelf of 346. In a cell
all methods answer in turn, `--rounds` times, and the medians of the ratios to Open3D's `test_occlusions` count: its
call alone, rays made beforehand, on the same points in the same (sampled, random) order. A method that would take
longer than `--seconds` a round is asked about fewer eyes; its time is given a view all the same. One that takes
longer for a single eye has no ratio, one that would take far longer no row. "trimesh" is `Trimesh.ray.intersects_any`
with embreex, as a user calls it. Wrong: against the oracle on 50 points and 2 eyes. Then exponents of growth: in
points and faces (least squares of logarithms, over the cells of at least 10,000 points), in eyes (10 to 100); and the
peak memory of each method, measured in a process of its own on the largest cell in which it answered for all eyes.
"""

import multiprocessing
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from common import Open3D, heads, in_turns, row, run

import zbuf_occlude as zo
from zbuf_occlude import Mesh, SurfacePoints
from zbuf_occlude.base.arrays import BoolArray, FloatArray
from zbuf_occlude.engines.gl.context import GlContext
from zbuf_occlude.meshes import shapes
from zbuf_occlude.visibility import find_method

Ask = Callable[[FloatArray], BoolArray]
PEER = "open3d"


def mesh_of(n_faces: int) -> Mesh:
    if n_faces < 1500:  # fewer than the airplane can have
        return shapes.make("bookshelf", 0).normalized()
    return shapes.benchmark_mesh(n_faces).normalized()


def open3d_peer(mesh: Mesh, points: SurfacePoints) -> Ask:
    caster, made = Open3D(mesh), dict[bytes, Any]()

    def ask(eyes: FloatArray) -> BoolArray:
        answers = []
        for eye in eyes:
            if eye.tobytes() not in made:
                made[eye.tobytes()] = caster.rays(eye, points.positions - eye)
            answers.append(~caster.occluded(made[eye.tobytes()]))
        return np.stack(answers)

    return ask


def trimesh_peer(mesh: Mesh, points: SurfacePoints) -> Ask:
    caster = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).ray

    def ask(eyes: FloatArray) -> BoolArray:
        answers = []
        for eye in eyes:
            away = eye - points.positions
            # rays begin off the surface, as its users must
            answers.append(~caster.intersects_any(points.positions + 1e-4 * away, away))
        return np.stack(answers)

    return ask


def seconds_of(ask: Ask, eyes: FloatArray) -> float:
    began = time.perf_counter()
    ask(eyes)
    return time.perf_counter() - began


def cell(mesh: Mesh, n_points: int, gl: GlContext, seconds: float, rounds: int, stack: ExitStack) -> dict[str, Any]:
    """Measure all methods on one mesh with this many points; what they hold goes onto the stack."""
    points, eyes = zo.sample_surface(mesh, n_points=n_points, seed=0), zo.views.paper100().eyes
    eyes = eyes[np.random.default_rng(0).permutation(len(eyes))]
    sample = np.random.default_rng(1).choice(n_points, 50, replace=False)
    with zo.prepare(mesh, "oracle") as oracle:
        truth = oracle.visible(points.select(sample), eyes[:2])
    asked: dict[str, tuple[Ask, int]] = {}
    found: dict[str, Any] = {}
    candidates: dict[str, Any] = {PEER: open3d_peer, "trimesh": trimesh_peer}
    for name in [*candidates, *(method.name for method in zo.METHODS)]:
        began = time.perf_counter()
        if name in candidates:
            ask = candidates[name](mesh, points)
        elif slow(name, len(mesh.faces), n_points, seconds):
            continue
        else:
            needs_gl = find_method(name).needs_gl
            occluder = stack.enter_context(zo.prepare(mesh, name, **({"gl": gl} if needs_gl else {})))

            def ask(eyes: FloatArray, occluder: Any = occluder) -> BoolArray:
                return occluder.visible(points, eyes)

        found[name] = {"prepare_s": time.perf_counter() - began}
        judged = ask(eyes[: len(truth)])[:, sample]
        found[name]["wrong"] = float((judged != truth).mean())
        one = min(seconds_of(ask, eyes[:1]) for _ in range(2))
        if one > seconds:
            found[name] |= {"ms": 1e3 * one, "eyes": 1}
            continue
        # what is done once a call, such as sorting points, must not be counted for a few eyes
        another = max((seconds_of(ask, eyes[:5]) - one) / 4, 1e-6)
        asked[name] = ask, int(np.clip(seconds / another, 1, len(eyes)))
    spent = in_turns({name: partial(ask, eyes[:n_eyes]) for name, (ask, n_eyes) in asked.items()}, rounds)
    times = {name: np.divide(spent[name], n_eyes) for name, (_, n_eyes) in asked.items()}
    for name, (ask, n_eyes) in asked.items():
        found[name] |= {
            "ms": 1e3 * float(np.median(times[name])),
            "eyes": n_eyes,
            "ratio": float(np.median(np.divide(times[PEER], times[name]))),
        }
        if n_eyes == len(eyes):
            found[name]["eyes_exponent"] = float(np.log10(np.median(times[name]) * 10 / seconds_of(ask, eyes[:10])) + 1)
    return found


def slow(name: str, n_faces: int, n_points: int, seconds: float) -> bool:
    """Whether a brute-force method would need far longer than `seconds` for one eye: 3e-9 s a pair at best."""
    pairs = {"oracle": n_points, "exact_hsr": n_points, "vertex_hsr": n_faces, "vertex_hsr_culled": n_faces}
    return pairs.get(name, 0) * n_faces * 3e-9 > 4 * seconds


def peak(arguments: tuple[str, int, int]) -> float:
    """Peak memory of a process that lets a method answer for 100 eyes, beyond what it has before, in MB."""
    name, n_faces, n_points = arguments
    mesh = mesh_of(n_faces)
    points, eyes = zo.sample_surface(mesh, n_points=n_points, seed=0), zo.views.paper100().eyes
    with zo.prepare(mesh, name) as occluder:  # what compiling takes, and opening a driver, is not the method's
        occluder.visible(points.select([0]), eyes[:1])
    Path("/proc/self/clear_refs").write_text("5")  # the peak becomes what is in use
    before = status("VmRSS")
    with zo.prepare(mesh, name) as occluder:
        occluder.visible(points, eyes)
    return status("VmHWM") - before


def status(field: str) -> float:
    """A number of this process's /proc status, in MB."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith(field)) / 1024


def exponents(cells: dict[tuple[int, int], dict[str, Any]], name: str) -> tuple[str, str]:
    """Growth in points and faces: log ms = a log points + b log faces + c."""
    rows = [(n, f, found[name]["ms"]) for (f, n), found in cells.items() if "ms" in found.get(name, {}) and n >= 10_000]
    if len({n for n, _, _ in rows}) < 2 or len({f for _, f, _ in rows}) < 2:
        return "-", "-"
    n, f, ms = np.log(np.array(rows, dtype=float)).T
    a, b, _ = np.linalg.lstsq(np.stack([n, f, np.ones_like(n)], axis=1), ms, rcond=None)[0]
    return f"{a:.2f}", f"{b:.2f}"


def print_times(cells: dict[tuple[int, int], dict[str, Any]]) -> None:
    """Print milliseconds per view, a row for each cell, a column for each method."""
    known = {method.name for method in zo.METHODS}
    names = list(dict.fromkeys(name for found in cells.values() for name in found))
    names.sort(key=lambda name: name in known)  # peers first
    heads("faces, points", *(f"`{name}`" if name in known else name for name in names))
    for (n_faces, n_points), found in cells.items():
        times = (rounded(found[name]["ms"]) if name in found else "-" for name in names)
        row(f"{n_faces:,}, {n_points:,}", *times)


def rounded(ms: float) -> str:
    """Three digits, two of them at most behind the point."""
    return f"{ms:,.{0 if ms >= 100 else 1 if ms >= 10 else 2}f}"


def main(
    *,
    faces: Sequence[int] = (340, 2_600, 19_000, 31_000, 1_000_000),
    points: Sequence[int] = (2_000, 10_000, 50_000, 500_000, 1_000_000),
    seconds: float = 1.5,
    rounds: int = 3,
) -> None:
    cells: dict[tuple[int, int], dict[str, Any]] = {}
    with GlContext.open() as gl:
        renderer = gl.renderer
        for n_faces in faces:
            mesh = mesh_of(n_faces)
            for n_points in points:
                with ExitStack() as stack:
                    found = cell(mesh, n_points, gl, seconds, rounds, stack)
                cells[len(mesh.faces), n_points] = found
                for name, one in found.items():
                    ratio = f"{one['ratio']:.2f} x {PEER}" if "ratio" in one else "-"
                    place = f"{len(mesh.faces):,} faces, {n_points:,} points, {name}"
                    told = f"{place}: {one['ms']:.2f} ms, {ratio}, {one['wrong']:.3f} wrong, {one['eyes']} eyes"
                    print(told, file=sys.stderr, flush=True)
    print(f"{renderer}\n")
    print_times(cells)
    print()
    heads("method", "points^", "faces^", "eyes^", "peak MB", "at faces, points", words=6)
    with multiprocessing.get_context("spawn").Pool(1, maxtasksperchild=1) as pool:
        for method in zo.METHODS:
            reached = [key for key, found in cells.items() if found.get(method.name, {}).get("eyes") == 100]
            eyes = [found[method.name]["eyes_exponent"] for key, found in cells.items() if key in reached]
            memory = at = "-"
            if reached:
                largest = max(reached, key=lambda key: key[0] * key[1])
                memory, at = f"{pool.apply(peak, ((method.name, *largest),)):.0f}", f"{largest[0]:,}, {largest[1]:,}"
            growth = f"{np.median(eyes):.2f}" if eyes else "-"
            row(method.name, *exponents(cells, method.name), growth, memory, at)


if __name__ == "__main__":
    run(main, __doc__)
