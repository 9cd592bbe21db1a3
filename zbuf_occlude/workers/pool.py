"""A pool of workers that does jobs, and expects workers to crash, hang and run out of memory. Knows no engine."""

import logging
import time
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple, Protocol

from zbuf_occlude.errors import DatasetError
from zbuf_occlude.limits import GivenUp, Limits
from zbuf_occlude.workers.task import Done

_LOG = logging.getLogger(__name__)

CRASHES, KILLS = 2, 5
"""A mesh is a failure when so many workers have crashed at it, or were killed at it from outside (by the kernel for
memory, or by a person), since it was last made."""
DEATHS_PER_JOB = 20
"""The run ends when so many workers have ended at a job while at no mesh: writing a file, say."""
STARTS = 20
"""The run ends when so many workers in a row have ended before they were ready."""
BROKEN = 5
"""The run ends when so many workers in a row have lost, or never got, their GL context."""
JOBS_PER_WORKER = 200
"""A worker is replaced after so many jobs: drivers leak."""
LOOK = 0.5
"""Seconds between two looks at the workers' time and memory."""
READY_SECONDS = 300.0
"""The run ends when no worker is ready for so long: the cluster has no room, or processes do not start."""

Message = tuple[Literal["ready", "mesh", "done", "broken", "failed"], Any]
"""("ready", pid) first; ("mesh", mesh_id) before each mesh, None behind the last of a job; ("done", (job, result)); as
the last one ("broken", reason) of a lost GL context, or ("failed", reason) of an error that any worker would meet."""


class Ending(NamedTuple):
    """How a worker ended."""

    reason: str
    killed: bool
    """From outside, by SIGKILL or SIGTERM."""


class Worker(Protocol):
    """A process somewhere that does jobs."""

    def assign(self, job: Any, lost: dict[int, GivenUp]) -> None:
        """Have it do a job; meshes in `lost` are failures with their reasons. Never raises: `ending` will tell."""

    def listen(self) -> list[Message]:
        """Return its messages since the last call, without waiting."""

    def ending(self) -> Ending | None:
        """Say how it ended; None while it lives."""

    def gigabytes(self) -> float:
        """Return its resident memory."""

    def kill(self) -> None:
        """End it now."""

    def dismiss(self) -> None:
        """End it when it has no job."""


@dataclass
class _Seat:
    """A worker, and its job."""

    worker: Worker
    ready: bool = False
    job: Any = None
    mesh_id: int | None = None
    mesh_began: float = 0.0
    n_done: int = 0


@dataclass
class _State:
    """Jobs that wait, and what has gone wrong so far."""

    queue: deque[Any]
    limits: Limits
    lost: dict[int, GivenUp] = field(default_factory=dict)
    ends_at_mesh: Counter[tuple[int, bool]] = field(default_factory=Counter)
    ends_at_job: Counter[Any] = field(default_factory=Counter)
    n_failed_starts: int = 0
    n_broken: int = 0


def do_jobs(
    jobs: list[Any],
    done: Done,
    *,
    start: Callable[[int], Worker],
    wait: Callable[[list[Worker], float], None],
    n_workers: int,
    limits: Limits,
) -> None:
    """Have workers do jobs, until none is left.

    Parameters
    ----------
    jobs : list of hashable
    done : callable
        Called with each job that is done and its result; returns jobs to do next.
    start : callable
        Starts a worker for a seat (0 to n_workers - 1).
    wait : callable
        Returns when a worker has a message, or after this many seconds.
    n_workers : int
    limits : Limits

    Raises
    ------
    DatasetError
        An error that any worker would meet: a full disk, no GL context. What is done stays done.

    Notes
    -----
    A worker that ends is replaced and its job done again; a mesh at which workers end, or that exceeds the limits, is
    in `lost` from then on. What a job writes depends on the plan alone, so any number of ends leaves the same data.
    """
    state, seats, last_ready = _State(deque(jobs), limits), dict[int, _Seat](), time.monotonic()
    try:
        while state.queue or any(seat.job is not None for seat in seats.values()):
            n_busy = sum(seat.job is not None for seat in seats.values())
            for number in range(min(n_workers, n_busy + len(state.queue))):
                if number not in seats:
                    seats[number] = _Seat(start(number))
            for seat in seats.values():
                if seat.ready and seat.job is None and state.queue:
                    seat.job, seat.mesh_id = state.queue.popleft(), None
                    seat.worker.assign(seat.job, dict(state.lost))
            wait([seat.worker for seat in seats.values()], LOOK)
            for number, seat in list(seats.items()):
                if _has_left(seat, state, done):
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


def _has_left(seat: _Seat, state: _State, done: Done) -> bool:
    """Take a worker's messages, and look at its state; True when its seat is free again."""
    ending = seat.worker.ending()  # asked first: what it sent before it ended counts
    for message in seat.worker.listen():
        _take(message, seat, state, done)
    if ending is None and seat.mesh_id is not None:
        excess = state.limits.excess(time.monotonic() - seat.mesh_began, seat.worker.gigabytes())
        if excess:
            excess += f"; raise --mesh-{'seconds' if 'timed out' in excess else 'gigabytes'}."
            seat.worker.kill()
            state.lost[seat.mesh_id] = GivenUp(excess, state.limits)
            _put_back(seat, state, excess)
            return True
    if ending is not None:
        _ended(seat, state, ending)
        return True
    if seat.n_done >= JOBS_PER_WORKER and seat.job is None:
        seat.worker.dismiss()
        return True
    return False


def _take(message: Message, seat: _Seat, state: _State, done: Done) -> None:
    kind, value = message
    if kind == "ready":
        seat.ready, state.n_failed_starts = True, 0
    elif kind == "mesh":
        _clear(seat, state)
        seat.mesh_id, seat.mesh_began = value, time.monotonic()
    elif kind == "done":
        _clear(seat, state)
        job, result = value
        state.n_broken = 0
        state.ends_at_job.pop(job, None)
        seat.job, seat.mesh_id, seat.n_done = None, None, seat.n_done + 1
        state.queue.extendleft(reversed(list(done(job, result))))
    elif kind == "broken":
        state.n_broken += 1
        if state.n_broken >= BROKEN:
            raise DatasetError(f"workers must get an OpenGL context; {BROKEN} in a row did not: {value}")
        seat.mesh_id = None  # not the mesh's fault
    else:
        raise DatasetError(f"{str(value).rstrip('.')}. What was finished is kept, and the same command resumes.")


def _clear(seat: _Seat, state: _State) -> None:
    """Forget the ends at a mesh that is made now."""
    for killed in (False, True):
        state.ends_at_mesh.pop((seat.mesh_id, killed), None)  # type: ignore[arg-type]  # None is no key


def _ended(seat: _Seat, state: _State, ending: Ending) -> None:
    if not seat.ready:
        state.n_failed_starts += 1
        if state.n_failed_starts >= STARTS:
            raise DatasetError(f"a worker must start; {STARTS} in a row ended before they were ready: {ending.reason}.")
    elif seat.mesh_id is not None:
        state.ends_at_mesh[seat.mesh_id, ending.killed] += 1
        n = state.ends_at_mesh[seat.mesh_id, ending.killed]
        if n >= (KILLS if ending.killed else CRASHES):
            state.lost[seat.mesh_id] = GivenUp(f"{ending.reason} at it, {n} times", state.limits)
    elif seat.job is not None:
        state.ends_at_job[seat.job] += 1
        if state.ends_at_job[seat.job] >= DEATHS_PER_JOB:
            raise DatasetError(
                f"a job must leave its worker alive; {DEATHS_PER_JOB} ended at {seat.job} while at no mesh: "
                f"{ending.reason}. Is there memory enough? What was finished is kept, and the same command resumes."
            )
    _put_back(seat, state, ending.reason)


def _put_back(seat: _Seat, state: _State, reason: str) -> None:
    if seat.job is not None:
        state.queue.appendleft(seat.job)
        name = " ".join(map(str, seat.job)) if isinstance(seat.job, tuple) else seat.job
        _LOG.warning("%s is done again: %s", name, reason)
