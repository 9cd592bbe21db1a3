"""Busy cores: how long a small question to `exact` takes while other processes want the cores too.

    python benchmarks/busy_cores.py [--per-core 0 2 3] [--calls 60]

Prepares a built-in chair and answers for 25 eyes and 2,048 points, again and again, first alone and then beside
processes that do nothing but count, so many per core. Prints the median and the worst call, in milliseconds and as
multiples of the median alone. (A single thread that shares its core with two others can at best take three times as
long.)
"""

import argparse
import multiprocessing
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

import zbuf_occlude as zo
from zbuf_occlude.meshes import shapes


def count() -> None:
    while True:
        pass


@contextmanager
def busy(n_processes: int) -> Iterator[None]:
    spawn = multiprocessing.get_context("spawn")
    processes = [spawn.Process(target=count, daemon=True) for _ in range(n_processes)]
    for process in processes:
        process.start()
    time.sleep(1.0 if processes else 0.0)  # until they count
    try:
        yield
    finally:
        for process in processes:
            process.kill()
            process.join()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--per-core", type=int, nargs="+", default=[0, 2, 3])
    parser.add_argument("--calls", type=int, default=60)
    options = parser.parse_args()
    mesh = shapes.make("chair", 3).normalized()
    points, eyes = zo.sample_surface(mesh, n_points=2048, seed=0), zo.views.fibonacci(25, distance=4.0).eyes

    def seconds() -> float:
        start = time.perf_counter()
        with zo.prepare(mesh, method="exact") as occluder:
            occluder.visible(points, eyes)
        return time.perf_counter() - start

    seconds()  # compiles
    alone = 0.0
    for per_core in options.per_core:
        with busy(per_core * (os.cpu_count() or 1)):
            calls = 1e3 * np.array([seconds() for _ in range(options.calls)])
        alone = alone or float(np.median(calls))
        print(
            f"{per_core} others per core: median {np.median(calls):.1f} ms ({np.median(calls) / alone:.1f} times), "
            f"worst {calls.max():.1f} ms ({calls.max() / alone:.1f} times)",
            flush=True,
        )


if __name__ == "__main__":
    main()
