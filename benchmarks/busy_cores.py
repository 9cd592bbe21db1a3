"""Busy cores: how long a small question to `exact` takes while other processes want the cores too.

    python benchmarks/busy_cores.py [--per-core 0 2 3] [--calls 150]

Prepares a built-in chair and answers for 25 eyes and 2,048 points, again and again, first alone and then beside
processes that do nothing but count, this many per core. Prints the mean and the median call, and the mean as a multiple
of that alone; and the same of a plain loop in Python that takes as long alone, by turns with the calls. (A thread that
shares its core with two others takes three times as long on the average: it works for a slice and waits for two. What
is delayed no more than the loop loses nothing by having threads.)

Where it may (as root, where Linux groups processes by session), all of it runs in a scheduling group of its own, before
all others, so that what else is done on the machine does not count; it says whether it does.
"""

import argparse
import multiprocessing
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

import zbuf_occlude as zo
from zbuf_occlude import shapes
from zbuf_occlude.arrays import FloatArray


def count() -> None:
    while True:
        pass


def turn(n: int) -> None:
    for _ in range(n):
        pass


def come_first() -> str:
    """Go into a session of our own, which the scheduler prefers to all others; say whether that was done."""
    if os.getpgrp() == os.getpid() and (child := os.fork()):  # the leader of a group cannot leave its session
        raise SystemExit(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
    os.setsid()
    try:
        Path("/proc/self/autogroup").write_text("-20")
    except OSError as error:
        return f"beside all else on this machine ({error.strerror})"
    return "before all else on this machine, in a scheduling group of its own"


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
    parser.add_argument("--calls", type=int, default=150)
    options = parser.parse_args()
    print(come_first(), flush=True)
    mesh = shapes.make("chair", 3).normalized()
    points, eyes = zo.sample_surface(mesh, n_points=2048, seed=0), zo.views.fibonacci(25, distance=4.0).eyes

    def ask() -> None:
        with zo.prepare(mesh, method="exact") as occluder:
            occluder.visible(points, eyes)

    def taken(work: Callable[[], None]) -> float:
        start = time.perf_counter()
        work()
        return 1e3 * (time.perf_counter() - start)

    ask()  # compiles
    n_turns = int(10_000 * min(taken(ask) for _ in range(20)) / min(taken(lambda: turn(10_000)) for _ in range(20)))
    first: FloatArray | None = None
    for per_core in options.per_core:
        with busy(per_core * (os.cpu_count() or 1)):
            began = time.process_time()
            both = np.array([[taken(ask), taken(lambda: turn(n_turns))] for _ in range(options.calls)])
            processors = 1e3 * (time.process_time() - began) / options.calls
        mean, median = both.mean(axis=0), np.median(both, axis=0)
        first = mean if first is None else first
        calls, loop = (
            f"{a:.1f} ms ({a / b:.1f} times; median {c:.1f})" for a, b, c in zip(mean, first, median, strict=True)
        )
        print(f"{per_core} others per core: {calls}, loop {loop}; both {processors:.1f} ms of processors", flush=True)


if __name__ == "__main__":
    main()
