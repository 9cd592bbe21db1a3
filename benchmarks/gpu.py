"""exact_gl and depth_buffer on this machine's GPU: answers per second, and the limit that the hardware sets.

    python benchmarks/gpu.py                  # 100 eyes x 1,000,000 points, 19,000 faces
    python benchmarks/gpu.py --quick          # small enough for a software rasteriser

Prints a table and writes a JSON (--out). An answer is one point seen or not seen by one eye. "Whole call" is what a
user waits for with new points: points ordered and uploaded, answered, bits read back and unpacked. "On the GPU" is
GL_TIME_ELAPSED of a call with points that are there already (of a software rasteriser: that whole call). Of exact_gl
the parts of a whole call are told apart too: ordering, arranging and uploading, the dispatches alone (a timer query
around each; of a software rasteriser, which does the work when it is waited for, the clock until it has finished), and
what is left, clearing, reading back and unpacking. The limit is
the smaller of two: the arithmetic that was counted over the multiply-add rate that was measured, and the bytes that
the work groups read over the copy rate that was measured (caches make it less).
"""

import argparse
import json
import platform
import statistics
import time
from collections.abc import Callable
from datetime import UTC, datetime
from typing import Any

import numpy as np

import zbuf_occlude as zo
from zbuf_occlude.geometry.hilbert import hilbert_order
from zbuf_occlude.gl.context import GlContext
from zbuf_occlude.gl.exact_pass import ExactPass, Shape, Shapes, best_shape
from zbuf_occlude.gl.shaders import compile_program
from zbuf_occlude.shapes.benchmark import benchmark_mesh
from zbuf_occlude.visibility import oracle
from zbuf_occlude.visibility.interface import CONTACT

METHODS = ("exact_gl", "depth_buffer")

SHAPES = (
    Shape(32, 1, 8, 16),
    Shape(32, 1, 2, 16),
    Shape(32, 1, 1, 16),
    Shape(32, 2, 1, 16),
    Shape(32, 4, 1, 16),
    Shape(64, 1, 1, 32),
    Shape(64, 2, 1, 32),
    Shape(8, 16, 1, 24),
)

# floating-point operations, counted by hand in shaders/exact.comp
FLOPS_BOX, FLOPS_TRIANGLE, FLOPS_TEST = 55, 250, 31

# bytes that a work group reads for each
BYTES_BOX, BYTES_TRIANGLE, BYTES_POINT = 32, 64, 48


def measured(gl: GlContext, call: Callable[[], Any], repeats: int) -> dict[str, float]:
    """Median seconds of a call as a user waits, and as the GPU counts."""
    waited, counted = [], []
    for _ in range(repeats):
        query = gl.ctx.query(time=True)
        start = time.perf_counter()
        with query:
            call()
        waited.append(time.perf_counter() - start)
        # llvmpipe's timer sees only the submission
        counted.append(waited[-1] if gl.is_software else query.elapsed * 1e-9)
    return {"call_seconds": statistics.median(waited), "gpu_seconds": statistics.median(counted)}


def peak_flops(gl: GlContext) -> float:
    """Measured float32 operations a second, a multiply-add counting as two."""
    groups, iterations = (64, 2000) if gl.is_software else (65535, 4000)
    program, results = compile_program(gl.ctx, "peak.comp"), gl.ctx.buffer(reserve=groups * 64 * 16)
    program["iterations"].value = iterations
    results.bind_to_storage_buffer(0)

    def call() -> None:
        program.run(groups)
        gl.ctx.finish()

    call()
    seconds = measured(gl, call, 3)["gpu_seconds"]
    results.release()
    program.release()
    return groups * 64 * iterations * 8 * 4 * 2 / seconds


def peak_bytes(gl: GlContext) -> float:
    """Measured bytes per second, read and written together."""
    rows, columns = 64, 1024
    size = rows * columns * 64 * 16
    program = compile_program(gl.ctx, "stream.comp")
    buffers = [gl.ctx.buffer(reserve=size), gl.ctx.buffer(reserve=size)]
    for binding, buffer in enumerate(buffers):
        buffer.bind_to_storage_buffer(binding)
    repeats = 1 if gl.is_software else 50

    def call() -> None:
        for _ in range(repeats):
            program.run(columns, rows)
        gl.ctx.finish()

    call()
    seconds = measured(gl, call, 3)["gpu_seconds"]
    for buffer in buffers:
        buffer.release()
    program.release()
    return 2 * size * repeats / seconds


def wrong_outside_band(mesh: zo.Mesh, points: zo.SurfacePoints, eyes: np.ndarray, mask: np.ndarray) -> dict[str, int]:
    """Hold a sample of a mask to the oracle."""
    rng = np.random.default_rng(0)
    which, some = rng.permutation(len(points))[:500], rng.permutation(len(eyes))[:4]
    judge, sample = oracle.prepare(mesh), points.select(which)
    differs = judge.visible(sample, eyes[some]) != mask[np.ix_(some, which)]
    decided = judge.decided(sample, eyes[some]) if differs.any() else differs
    return {"checked": differs.size, "wrong": int(differs.sum()), "wrong_outside_band": int((differs & decided).sum())}


def run_method(
    name: str, gl: GlContext, mesh: zo.Mesh, points: zo.SurfacePoints, eyes: np.ndarray, repeats: int
) -> dict[str, Any]:
    """One row of the table."""
    every = np.arange(len(points))  # selecting all makes points that no occluder has seen
    start = time.perf_counter()
    with zo.prepare(mesh, name, gl=gl) as occluder:
        occluder.visible(points.select(every), eyes[:1])  # compiles what is compiled at first use
        prepared = time.perf_counter() - start
        mask = occluder.visible(points, eyes)
        there = measured(gl, lambda: occluder.visible(points, eyes), repeats)
        new = measured(gl, lambda: occluder.visible(points.select(every), eyes), repeats)
    answers = len(points) * len(eyes)
    return {
        "prepare_seconds": prepared,
        "call_seconds": new["call_seconds"],
        "call_seconds_same_points": there["call_seconds"],
        "gpu_seconds": there["gpu_seconds"],
        "answers_per_second_call": answers / new["call_seconds"],
        "answers_per_second_gpu": answers / there["gpu_seconds"],
        "visible": float(mask.mean()),
        **wrong_outside_band(mesh, points, eyes, mask),
    }


def exact_pass(gl: GlContext, mesh: zo.Mesh, shapes: Shapes | None, counting: bool = False) -> ExactPass:
    return ExactPass(gl, mesh, CONTACT * mesh.diagonal, shapes=shapes, counting=counting)


class TimedProgram:
    """A compute program whose dispatches are timed, each alone."""

    def __init__(self, program: Any, gl: GlContext, seconds: list[float]) -> None:
        self._program, self._gl, self._seconds = program, gl, seconds

    def __getitem__(self, name: str) -> Any:
        return self._program[name]

    def run(self, *groups: int) -> None:
        """Dispatch, and wait for the end."""
        self._gl.ctx.finish()  # what came before is not counted
        query = self._gl.ctx.query(time=True)
        start = time.perf_counter()
        with query:
            self._program.run(*groups)
        self._gl.ctx.finish()
        self._seconds.append(time.perf_counter() - start if self._gl.is_software else query.elapsed * 1e-9)


def call_parts(gl: GlContext, mesh: zo.Mesh, points: zo.SurfacePoints, eyes: np.ndarray) -> dict[str, float]:
    """Seconds of the parts of one whole call of `exact_gl` with new points."""
    engine = exact_pass(gl, mesh, None)
    dispatches: list[float] = []
    program = engine._program
    engine._program = lambda shape: TimedProgram(program(shape), gl, dispatches)  # type: ignore[method-assign]

    def call() -> tuple[float, float]:
        dispatches.clear()
        began = time.perf_counter()
        uploaded = engine.upload(points.positions, points.face_ids)
        gl.ctx.finish()
        asked = time.perf_counter()
        engine.visible(uploaded, eyes)
        ended = time.perf_counter()
        uploaded.release()
        return asked - began, ended - asked

    call()  # compiles what is compiled at first use
    hilbert_order(points.positions)
    began = time.perf_counter()
    hilbert_order(points.positions)
    ordering = time.perf_counter() - began
    uploading, answering = call()
    engine.release()
    return {
        "ordering": ordering,
        "arranging_and_uploading": max(uploading - ordering, 0.0),
        "dispatches": sum(dispatches),
        "clearing_reading_unpacking": max(answering - sum(dispatches), 0.0),
        "n_dispatches": len(dispatches),
    }


def run_shape(
    shape: Shape, gl: GlContext, mesh: zo.Mesh, points: zo.SurfacePoints, eyes: np.ndarray, repeats: int
) -> dict[str, Any]:
    engine = exact_pass(gl, mesh, ((0.0, shape),))
    uploaded = engine.upload(points.positions, points.face_ids)
    engine.visible(uploaded, eyes[:1])
    times = measured(gl, lambda: engine.visible(uploaded, eyes), repeats)
    uploaded.release()
    engine.release()
    return {**vars(shape), **times}


def limits(gl: GlContext, mesh: zo.Mesh, points: zo.SurfacePoints, eyes: np.ndarray) -> dict[str, float]:
    """Count the work of `exact_gl`, and say how fast the hardware could do it."""
    engine = exact_pass(gl, mesh, None, counting=True)
    uploaded = engine.upload(points.positions, points.face_ids)
    engine.visible(uploaded, eyes)
    uploaded.release()
    work, packet = engine.work, best_shape(engine.shapes, len(points), len(mesh.faces)).packet
    engine.release()
    answers = len(points) * len(eyes)
    flops = work.boxes * FLOPS_BOX + work.triangles * FLOPS_TRIANGLE + work.tests * packet * FLOPS_TEST
    bytes_read = work.boxes * BYTES_BOX + work.triangles * BYTES_TRIANGLE + work.groups * packet * BYTES_POINT
    flops_per_second, bytes_per_second = peak_flops(gl), peak_bytes(gl)
    return {
        "boxes_per_packet": work.boxes / work.groups,
        "triangles_per_packet": work.triangles / work.groups,
        "tests_per_point": work.tests / work.groups,
        "doubts_per_answer": work.doubts / answers,
        "flops_per_answer": flops / answers,
        "bytes_per_answer": bytes_read / answers,
        "measured_flops_per_second": flops_per_second,
        "measured_bytes_per_second": bytes_per_second,
        "answers_per_second_by_arithmetic": flops_per_second / (flops / answers),
        "answers_per_second_by_traffic": bytes_per_second / (bytes_read / answers),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--faces", type=int, default=19_000)
    parser.add_argument("--points", type=int, help="default 1,000,000; 50,000 with --quick")
    parser.add_argument("--eyes", type=int, help="default 100; 8 with --quick")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--shapes", action="store_true", help="also time exact_gl cut in other ways for the hardware")
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--backend", choices=("egl", "osmesa"))
    parser.add_argument("--out", default="gpu.json")
    options = parser.parse_args()
    n_points = options.points or (50_000 if options.quick else 1_000_000)
    n_eyes = options.eyes or (8 if options.quick else 100)

    mesh = benchmark_mesh(options.faces).normalized()
    points = zo.sample_surface(mesh, n_points=n_points, seed=0)
    all_eyes = zo.views.paper100().eyes
    eyes = all_eyes[np.linspace(0, len(all_eyes) - 1, n_eyes).astype(int)]
    with GlContext.open(options.backend) as gl:
        print(f"{gl.renderer}; {len(mesh.faces)} faces, {n_points} points, {n_eyes} eyes")
        rows: dict[str, Any] = {}
        for name in METHODS:
            if name not in [method.name for method in zo.METHODS]:
                print(f"{name:14} is not in the table of methods")
                continue
            row = rows[name] = run_method(name, gl, mesh, points, eyes, options.repeats)
            print(
                f"{name:14} {row['answers_per_second_call']:.3g} answers/s whole call, "
                f"{row['answers_per_second_gpu']:.3g} on the GPU; "
                f"{row['call_seconds'] / n_eyes * 1e3:.3g} ms per view; "
                f"{row['wrong_outside_band']} of {row['checked']} wrong outside the band"
            )
        spent = call_parts(gl, mesh, points, eyes)
        n_dispatches = spent.pop("n_dispatches")
        whole = sum(spent.values())
        parts = ", ".join(f"{name.replace('_', ' ')} {seconds / whole:.0%}" for name, seconds in spent.items())
        alone = len(points) * n_eyes / spent["dispatches"]
        print(f"a whole call of exact_gl, {whole:.3g} s: {parts}")
        print(f"its {n_dispatches} dispatches alone: {alone:.3g} answers/s")
        limit = limits(gl, mesh, points, eyes)
        print(
            f"limit of exact_gl: {limit['answers_per_second_by_arithmetic']:.3g} answers/s by arithmetic "
            f"({limit['flops_per_answer']:.0f} flops an answer), "
            f"{limit['answers_per_second_by_traffic']:.3g} by traffic ({limit['bytes_per_answer']:.0f} bytes); "
            f"{limit['doubts_per_answer']:.2g} float64 tests an answer"
        )
        shapes = []
        for shape in SHAPES if options.shapes else ():
            shapes.append(run_shape(shape, gl, mesh, points, eyes, options.repeats))
            print(f"{shape}: {shapes[-1]['gpu_seconds'] / n_eyes * 1e3:.3g} ms per view on the GPU")
        report = {
            "date": datetime.now(UTC).isoformat(timespec="seconds"),
            "machine": platform.machine(),
            "renderer": gl.renderer,
            "version": gl.version,
            "is_software": gl.is_software,
            "n_faces": len(mesh.faces),
            "n_points": n_points,
            "n_eyes": n_eyes,
            "methods": rows,
            "exact_gl_parts": spent,
            "limit": limit,
            "shapes": shapes,
        }
    with open(options.out, "w", encoding="utf-8") as file:
        json.dump(report, file, indent=1)
        file.write("\n")
    print(f"wrote {options.out}")


if __name__ == "__main__":
    main()
