"""The local engine: spawned worker processes under a supervisor that expects them to die, hang and swell."""

import multiprocessing
import os
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any

from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.errors import DatasetError, GlError
from zbuf_occlude.farm.worker import serve
from zbuf_occlude.visibility import find_method

DEATHS_A_MESH = 5
"""A mesh at which so many workers have died is given up; below that the death may have had another cause."""
BREAKS = 5
"""So many workers in a row may lose, or never get, their GL context before the run gives up."""
SHARDS_A_WORKER = 200
"""A worker is replaced after so many shards: drivers leak."""
GRACE = 0.5
"""Seconds between two looks at the workers' time and memory."""


@dataclass(frozen=True)
class Limits:
    """What one mesh may take before its worker is killed and the mesh counted as failed.

    Parameters
    ----------
    seconds : float
        Wall-clock time for one mesh, all its views and variations.
    gigabytes : float
        Resident memory of the worker process while it is at the mesh.
    """

    seconds: float = 600.0
    gigabytes: float = 8.0


@dataclass
class _Worker:
    process: Any
    connection: Connection
    shard: int | None = None
    mesh_id: int | None = None
    mesh_began: float = 0.0
    n_done: int = 0


@dataclass
class _Book:
    """What the supervisor remembers about shards and meshes."""

    queue: deque[int]
    left: set[int]
    deaths: Counter[int] = field(default_factory=Counter)
    lost: dict[int, str] = field(default_factory=dict)
    n_broken: int = 0


def run_shards(
    plan: Plan, shards: list[int], out: Path, done: Callable[[int], None], *, n_workers: int, limits: Limits
) -> None:
    """Make shards in worker processes until each is done.

    Parameters
    ----------
    plan : Plan
    shards : list of int
        Indices into ``plan.shards`` that are not done.
    out : Path
        The dataset's folder.
    done : callable
        Told each shard when it is done.
    n_workers : int
        Processes; each has its own GL context and its share of the cores.
    limits : Limits

    Raises
    ------
    DatasetError
        Something that would happen to any worker: a full disk, no GL context. What is done stays done.

    Notes
    -----
    A worker that dies is replaced and its shard made again; a mesh at which `DEATHS_A_MESH` workers died, or that
    exceeds the limits, becomes a failure in the shard's sidecar. What a shard holds depends on the plan alone, never on
    the worker that made it, so any number of deaths leaves the same bytes.
    """
    book = _Book(deque(shards), set(shards))
    workers: list[_Worker] = []
    devices = _gl_devices(plan)
    try:
        while book.left:
            workers = [worker for worker in workers if not _retire(worker)]
            while len(workers) < min(n_workers, len(book.left)):
                workers.append(_spawn(plan, out, n_workers, devices[len(workers) % len(devices)]))
            for worker in workers:
                _assign(worker, book)
            handles = [handle for worker in workers for handle in (worker.connection, worker.process.sentinel)]
            ready = wait(handles, timeout=GRACE)
            for worker in list(workers):
                if worker.connection in ready and _listen(worker, book, done):
                    continue
                if worker.process.sentinel in ready and not worker.process.is_alive():
                    _bury(worker, book, f"{_ending(worker)} at it, {DEATHS_A_MESH} times", fatal=False)
                    workers.remove(worker)
                elif reason := _excess(worker, limits):
                    worker.process.kill()
                    worker.process.join()
                    _bury(worker, book, reason, fatal=True)
                    workers.remove(worker)
    finally:
        _dismiss(workers)


def _assign(worker: _Worker, book: _Book) -> None:
    if worker.shard is None and book.queue:
        worker.shard, worker.mesh_id = book.queue.popleft(), None
        with suppress(OSError):  # it died; its sentinel will tell
            worker.connection.send((worker.shard, dict(book.lost)))


def _listen(worker: _Worker, book: _Book, done: Callable[[int], None]) -> bool:
    """Take in what a worker says; True when it said something."""
    try:
        kind, value = worker.connection.recv()
    except (EOFError, OSError):
        return False
    if kind == "mesh":
        worker.mesh_id, worker.mesh_began = value, time.monotonic()
    elif kind == "done":
        book.left.discard(value)
        book.n_broken = 0
        worker.shard, worker.mesh_id, worker.n_done = None, None, worker.n_done + 1
        done(value)
    elif kind == "broken":
        book.n_broken += 1
        if book.n_broken >= BREAKS:
            raise DatasetError(f"workers must get an OpenGL context; {BREAKS} in a row did not: {value}")
        worker.mesh_id = None  # not the mesh's fault
    else:
        raise DatasetError(f"{value}. What was finished is kept, and the same command resumes.")
    return True


def _bury(worker: _Worker, book: _Book, reason: str, *, fatal: bool) -> None:
    """Put a dead worker's shard back; blame the mesh it was at, at once or after `DEATHS_A_MESH` deaths."""
    worker.connection.close()
    if worker.mesh_id is not None:
        book.deaths[worker.mesh_id] += 1
        if fatal or book.deaths[worker.mesh_id] >= DEATHS_A_MESH:
            book.lost[worker.mesh_id] = reason
    if worker.shard is not None:
        book.queue.appendleft(worker.shard)


def _excess(worker: _Worker, limits: Limits) -> str:
    """Say which limit a worker's mesh has exceeded; empty when none."""
    if worker.mesh_id is None:
        return ""
    if time.monotonic() - worker.mesh_began > limits.seconds:
        return f"a mesh may take {limits.seconds:g} seconds; this one took longer. Raise --mesh-seconds."
    if _resident_gigabytes(worker.process.pid) > limits.gigabytes:
        return f"a mesh may take {limits.gigabytes:g} GB of memory; this one took more. Raise --mesh-gigabytes."
    return ""


def _resident_gigabytes(pid: int) -> float:
    try:
        pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    except (OSError, IndexError):  # it has just ended
        return 0.0
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e9


def _ending(worker: _Worker) -> str:
    code = worker.process.exitcode
    return f"the worker was killed by signal {-code}" if code and code < 0 else f"the worker ended with code {code}"


def _retire(worker: _Worker) -> bool:
    """Send a worker home that has done its share."""
    if worker.n_done < SHARDS_A_WORKER or worker.shard is not None:
        return False
    _dismiss([worker])
    return True


def _dismiss(workers: list[_Worker]) -> None:
    """End workers: those at rest by word, those at work by force."""
    for worker in workers:
        with suppress(OSError):  # it has gone already
            worker.connection.send(None)
        if worker.shard is not None:
            worker.process.kill()
    for worker in workers:
        worker.process.join(10)
        if worker.process.is_alive():
            worker.process.kill()
            worker.process.join()
        worker.connection.close()


def _spawn(plan: Plan, out: Path, n_workers: int, device_index: int | None) -> _Worker:
    """Start a worker; spawned, never forked: a GL context does not survive a fork."""
    spawn = multiprocessing.get_context("spawn")
    ours, theirs = spawn.Pipe()
    process = spawn.Process(target=serve, args=(theirs, plan, out, device_index, os.getpid()), daemon=True)
    with _threads(max(1, (os.cpu_count() or 1) // n_workers)):
        process.start()
    theirs.close()
    return _Worker(process, ours)


@contextmanager
def _threads(count: int) -> Iterator[None]:
    """Have a child started here use so many threads, in numba's kernels and in Mesa's rasteriser."""
    names = ("NUMBA_NUM_THREADS", "LP_NUM_THREADS")
    before = {name: os.environ.get(name) for name in names}
    os.environ.update({name: str(count) for name in names if name not in os.environ})
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)


def _gl_devices(plan: Plan) -> list[int | None]:
    """The EGL devices over which workers are spread: the hardware ones, or None for whatever opens first."""
    if not find_method(plan.recipe.method).needs_gl:
        return [None]
    from zbuf_occlude.gl.devices import egl_devices  # late: only these methods touch GL

    try:
        hardware: list[int | None] = [device.index for device in egl_devices() if not device.is_software]
    except GlError:  # no EGL; OSMesa may do
        hardware = []
    return hardware or [None]
