"""The supervisor: hands jobs to workers, and expects them to die, hang and swell. Knows no engine."""

import logging
import time
from collections import Counter, deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol

from zbuf_occlude.dataset.jobs import put_ahead
from zbuf_occlude.errors import DatasetError
from zbuf_occlude.limits import GivenUp, Limits

_LOG = logging.getLogger(__name__)

DEATHS_PER_MESH = 5
"""A mesh at which this many workers have died is given up. It is given more while workers die that are at no mesh, or
at one that another makes: then something else kills them."""
DEATHS_PER_JOB = 20
"""When this many workers have died at a job while at no mesh (merging, say, or writing), the run gives up: the next
would die too. It waits for one more for each that died elsewhere since the first of them, at what another has done
since: then something else kills them, and jobs are done in spite of it."""
STARTS = 20
"""This many workers in a row may end before they are ready before the run gives up."""
BREAKS = 5
"""This many workers in a row may lose, or never get, their GL context before the run gives up."""
JOBS_PER_WORKER = 200
"""A worker is replaced after this many jobs: drivers leak."""
GRACE = 0.5
"""Seconds between two looks at the workers' time and memory."""

READY_SECONDS = 300.0
"""When no worker is ready for so long, the run gives up: the cluster has no room, or processes do not start."""

Message = tuple[Literal["ready", "mesh", "done", "broken", "failed"], Any]
"""("ready", pid) first, ("mesh", mesh_id) before each mesh, None for what follows the last, ("done", (job, result)); as
the last word before leaving ("broken", reason) when the GL context was lost or never came, or ("failed", reason) for
what no other worker would do better."""


class Worker(Protocol):
    """A process somewhere that does jobs, as an engine offers it."""

    def assign(self, job: int, lost: dict[int, GivenUp]) -> None:
        """Have it do a job; meshes in `lost` are failures with their reasons. Never raises: death is told later."""

    def listen(self) -> list[Message]:
        """Return what it said since the last call, without waiting."""

    def ending(self) -> str:
        """Say how it ended; empty while it lives."""

    def gigabytes(self) -> float:
        """Return its resident memory."""

    def kill(self) -> None:
        """End it now."""

    def dismiss(self) -> None:
        """Let it go when it is at rest."""


@dataclass
class _Seat:
    """A worker, and what it is at."""

    worker: Worker
    ready: bool = False
    job: int | None = None
    mesh_id: int | None = None
    mesh_began: float = 0.0
    n_done: int = 0


@dataclass
class _Book:
    """What is remembered about jobs and meshes.

    `deaths` are of workers at a mesh that has not been made yet; when it is, they were no fault of its and are counted
    in `n_innocent`, as are those of workers at no mesh. `innocent_before` is that number when a mesh had its first.
    `deaths_at_job` are of workers at a job but at no mesh, until it is done; `cleared_before_job` is what `n_cleared`
    was when a job had its first.
    """

    queue: deque[int]
    left: set[int]
    limits: Limits
    deaths: Counter[int] = field(default_factory=Counter)
    n_innocent: int = 0
    innocent_before: dict[int, int] = field(default_factory=dict)
    lost: dict[int, GivenUp] = field(default_factory=dict)
    n_broken: int = 0
    n_stillborn: int = 0
    deaths_at_job: Counter[int] = field(default_factory=Counter)
    cleared_before_job: dict[int, int] = field(default_factory=dict)
    n_dead: int = 0

    @property
    def n_cleared(self) -> int:
        """Deaths at what is made by now, or at nothing: neither mesh nor job is still to blame."""
        return self.n_dead - self.deaths.total() - self.deaths_at_job.total()


def supervise(
    jobs: list[int],
    done: Callable[[int, Any], Iterable[int] | None],
    *,
    hire: Callable[[int], Worker],
    wait: Callable[[list[Worker], float], None],
    n_workers: int,
    limits: Limits,
) -> None:
    """Have jobs done by workers, until each is.

    Parameters
    ----------
    jobs : list of int
        Those that may be begun.
    done : callable
        Told each job when it is done, and its result; what it returns are jobs that may be begun now, and are next.
    hire : callable
        Starts a worker for a seat (0 to n_workers - 1).
    wait : callable
        Returns when one of the workers has something to say, or after this many seconds.
    n_workers : int
    limits : Limits

    Raises
    ------
    DatasetError
        Something that would happen to any worker: a full disk, no GL context. What is done stays done.

    Notes
    -----
    A worker that dies is replaced and its job done again; a mesh at which `DEATHS_PER_MESH` workers died, or that
    exceeds the limits, becomes a failure in the shard's sidecar. What a job writes depends on the plan alone, never on
    the worker that did it, so any number of deaths leaves the same bytes.
    """
    book = _Book(deque(jobs), set(jobs), limits)
    seats: dict[int, _Seat] = {}
    last_ready = time.monotonic()
    try:
        while book.left:
            for number in range(min(n_workers, len(book.left))):
                if number not in seats:
                    seats[number] = _Seat(hire(number))
            for seat in seats.values():
                _assign(seat, book)  # all of them: the last shard must not wait for a replacement that finds no room
            wait([seat.worker for seat in seats.values()], GRACE)
            for number, seat in list(seats.items()):
                if _look_after(seat, book, done):
                    del seats[number]
            if any(seat.ready for seat in seats.values()):
                last_ready = time.monotonic()
            elif time.monotonic() - last_ready > READY_SECONDS:
                raise DatasetError(f"a worker must be ready within {READY_SECONDS:g} seconds; none was. Is there room?")
    finally:
        for seat in seats.values():
            if seat.job is None:
                seat.worker.dismiss()
            else:
                seat.worker.kill()


def _assign(seat: _Seat, book: _Book) -> None:
    if seat.ready and seat.job is None and book.queue:
        seat.job, seat.mesh_id = book.queue.popleft(), None
        seat.worker.assign(seat.job, dict(book.lost))


def _look_after(seat: _Seat, book: _Book, done: Callable[[int, Any], Iterable[int] | None]) -> bool:
    """Take in what a worker says and how it is; True when its seat is free again."""
    ending = seat.worker.ending()  # asked first: what it said before it ended is heard all the same
    for message in seat.worker.listen():
        _hear(seat, book, message, done)
    if ending:
        _bury(seat, book, ending)
        return True
    if excess := _excess(seat, book.limits):
        seat.worker.kill()
        _bury(seat, book, excess, at_once=True)
        return True
    if seat.n_done >= JOBS_PER_WORKER and seat.job is None:
        seat.worker.dismiss()
        return True
    return False


def _hear(seat: _Seat, book: _Book, message: Message, done: Callable[[int, Any], Iterable[int] | None]) -> None:
    kind, value = message
    if kind == "ready":
        seat.ready, book.n_stillborn = True, 0
    elif kind == "mesh":
        _acquit(seat, book)
        seat.mesh_id, seat.mesh_began = value, time.monotonic()
    elif kind == "done":
        _acquit(seat, book)
        book.n_broken = 0
        book.deaths_at_job.pop(value[0], None)
        seat.job, seat.mesh_id, seat.n_done = None, None, seat.n_done + 1
        following = list(done(*value) or ())
        put_ahead(book.queue, following)
        book.left.update(following)
        book.left.discard(value[0])
    elif kind == "broken":
        book.n_broken += 1
        if book.n_broken >= BREAKS:
            raise DatasetError(f"workers must get an OpenGL context; {BREAKS} in a row did not: {value}")
        seat.mesh_id = None  # not the mesh's fault
    else:
        raise DatasetError(f"{str(value).rstrip('.')}. What was finished is kept, and the same command resumes.")


def _acquit(seat: _Seat, book: _Book) -> None:
    """The mesh that a worker was at is made: whatever killed others at it was something else."""
    if seat.mesh_id is not None:
        book.n_innocent += book.deaths.pop(seat.mesh_id, 0)


def _bury(seat: _Seat, book: _Book, reason: str, *, at_once: bool = False) -> None:
    """Put a dead worker's job back; blame the mesh it was at, at once or after `DEATHS_PER_MESH` deaths or more."""
    mesh_id = seat.mesh_id
    book.n_dead += 1
    if not seat.ready:
        book.n_stillborn += 1
        if book.n_stillborn >= STARTS:
            raise DatasetError(f"a worker must start; {STARTS} in a row ended before they were ready: {reason}.")
    if mesh_id is None and seat.job is not None:
        _blame(seat.job, book, reason)
    if mesh_id is None:
        book.n_innocent += 1
    elif at_once:
        book.lost[mesh_id] = GivenUp(reason, book.limits)
    else:
        book.deaths[mesh_id] += 1
        elsewhere = book.n_innocent - book.innocent_before.setdefault(mesh_id, book.n_innocent)
        if book.deaths[mesh_id] >= DEATHS_PER_MESH + elsewhere:
            book.lost[mesh_id] = GivenUp(f"{reason} at it, {book.deaths[mesh_id]} times", book.limits)
    if seat.job is not None:
        book.queue.appendleft(seat.job)
        _LOG.warning("job %d is done again: %s", seat.job, reason)


def _blame(job: int, book: _Book, reason: str) -> None:
    """Count a death at a job that cannot be the fault of a mesh."""
    book.deaths_at_job[job] += 1
    n = book.deaths_at_job[job]
    elsewhere = book.n_cleared - book.cleared_before_job.setdefault(job, book.n_cleared)
    if n >= DEATHS_PER_JOB + elsewhere:
        raise DatasetError(
            f"a job must leave its worker alive; {n} died at job {job} while at no mesh: {reason}. Is there memory "
            f"enough? What was finished is kept, and the same command resumes."
        )


def _excess(seat: _Seat, limits: Limits) -> str:
    """Say which limit a worker's mesh has exceeded; empty when none."""
    if seat.mesh_id is None:
        return ""
    excess = limits.excess(time.monotonic() - seat.mesh_began, seat.worker.gigabytes())
    return excess and f"{excess} Raise --mesh-{'seconds' if 'seconds' in excess else 'gigabytes'}."
