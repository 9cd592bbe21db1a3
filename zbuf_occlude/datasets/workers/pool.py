"""A pool of workers that do jobs and may crash, hang or run out of memory; `local` and `ray` start them."""

import logging
import logging.handlers
import os
import time
from collections import Counter, deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any, Literal, NamedTuple, Protocol

from zbuf_occlude.base.errors import DatasetError, GlError, OccludeError
from zbuf_occlude.base.limits import Limits, resident_gigabytes
from zbuf_occlude.datasets.workers import Done, Task

_LOG = logging.getLogger(__name__)

CRASHES, KILLS = 2, 5
"""Number of workers that crash at a mesh, or are killed at it from outside (by the kernel for memory, or by a person),
after which the mesh is a failure."""
MAX_ENDS = 20
"""Number of workers in a row that end before they are ready, or at one job outside any mesh, until the run ends."""
MAX_BROKEN = 5
"""Number of workers in a row without a GL context after which the run ends."""
JOBS_PER_WORKER = 50
"""Number of jobs after which a worker is replaced: drivers leak."""
LOOK = 0.5
"""Seconds between two checks of the workers' time and memory."""
READY_SECONDS = 300.0
"""Seconds without a ready worker after which the run ends: the cluster has no room, or processes do not start."""

Message = tuple[Literal["ready", "mesh", "done", "log", "broken", "failed"], Any]
"""("ready", pid) first; ("mesh", (mesh_id, gigabytes)) before each mesh, with the worker's memory then, and mesh_id
None behind the last of a job; ("done", (job, result)); at any time ("log", record) of the package's log; as the last
one ("broken", reason) of a lost GL context, or ("failed", reason) of an error that any worker would meet."""


class LogSender(logging.handlers.QueueHandler):
    """Handler of the worker's log that sends each record to the coordinator, whose log shows it."""

    queue: Any

    def __init__(self, connection: Connection) -> None:
        super().__init__(queue=connection)  # type: ignore[arg-type]  # only `enqueue` uses it

    def enqueue(self, record: logging.LogRecord) -> None:
        """Send a record; none where the coordinator is gone."""
        with suppress(OSError):
            self.queue.send(("log", record))


def work(connection: Connection, task: Task, device_index: int | None) -> None:
    """Answer (job, lost) requests with messages until None comes: a worker's whole life.

    Everything GL happens in the thread that calls this.
    """
    gl: Any = None
    log = logging.getLogger("zbuf_occlude")
    log.handlers, log.propagate = [LogSender(connection)], False
    with suppress(EOFError, BrokenPipeError):  # the coordinator is gone
        try:
            if task.needs_gl:
                from zbuf_occlude.engines.gl.context import GlContext  # late: only these methods touch GL

                gl = GlContext.open(device_index=device_index)
            connection.send(("ready", os.getpid()))
            while (request := connection.recv()) is not None:
                job, lost = request
                result = task.do(
                    job, gl, lost, lambda mesh_id: connection.send(("mesh", (mesh_id, resident_gigabytes(os.getpid()))))
                )
                connection.send(("done", (job, result)))
        except GlError as error:
            connection.send(("broken", str(error)))
        except OccludeError as error:
            connection.send(("failed", str(error)))
        except BrokenPipeError:
            raise
        except OSError as error:
            connection.send(("failed", f"{error.strerror or error}{f': {error.filename}' if error.filename else ''}"))
        finally:
            if gl is not None:
                gl.close()


class ExitStatus(NamedTuple):
    """The end of a worker."""

    reason: str
    killed: bool
    """True where SIGKILL or SIGTERM ended it from outside."""


class Worker(Protocol):
    """A process somewhere that runs `work`."""

    def assign(self, job: Any, lost: dict[int, str]) -> None:
        """Have it do a job; meshes in `lost` are failures with their reasons. Never raises: `ending` will tell."""

    def listen(self) -> list[Message]:
        """Return its messages since the last call, without waiting."""

    def ending(self) -> ExitStatus | None:
        """Return how it ended; None while it lives."""

    def gigabytes(self) -> float:
        """Return its resident memory."""

    def kill(self) -> None:
        """End it now."""

    def dismiss(self) -> None:
        """End it when it has no job."""


def do_jobs(
    jobs: list[Any],
    done: Done,
    *,
    start: Callable[[int], Worker],
    wait: Callable[[list[Any], float], None],
    n_workers: int,
    limits: Limits,
) -> None:
    """Have workers do jobs, until none is left.

    Parameters
    ----------
    jobs : list of hashable
    done : callable
        Called with each job that is done and its result.
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
    pool, seats, last_ready = _Pool(deque(jobs), done, limits), dict[int, _WorkerSlot](), time.monotonic()
    try:
        while pool.queue or any(seat.job is not None for seat in seats.values()):
            n_busy = sum(seat.job is not None for seat in seats.values())
            for number in range(min(n_workers, n_busy + len(pool.queue))):
                if number not in seats:
                    seats[number] = _WorkerSlot(start(number))
            for seat in seats.values():
                if seat.ready and seat.job is None and pool.queue:
                    seat.job, seat.mesh_id = pool.queue.popleft(), None
                    seat.worker.assign(seat.job, dict(pool.lost))
            wait([seat.worker for seat in seats.values()], LOOK)
            seats = {number: seat for number, seat in seats.items() if pool.keeps(seat)}
            if any(seat.ready for seat in seats.values()):
                last_ready = time.monotonic()
            elif time.monotonic() - last_ready > READY_SECONDS:
                raise DatasetError(
                    f"No worker was ready within {READY_SECONDS:g} s. Is there enough memory, or room on the cluster?"
                )
    finally:
        for seat in seats.values():
            if seat.job is None:
                seat.worker.dismiss()
            else:
                seat.worker.kill()


@dataclass
class _WorkerSlot:
    """A worker, its job and its mesh."""

    worker: Worker
    ready: bool = False
    job: Any = None
    mesh_id: int | None = None
    mesh_began: float = 0.0
    gigabytes_before: float = 0.0  # of the worker, which has the clouds of its shard in memory too
    n_done: int = 0


class _Pool:
    """Jobs that wait, meshes that are lost, and counts of the ends of workers."""

    def __init__(self, queue: deque[Any], done: Done, limits: Limits) -> None:
        self.queue, self.done, self.limits = queue, done, limits
        self.lost: dict[int, str] = {}
        self.ends: Counter[Any] = Counter()
        """Number of ends since the last success, by ("mesh", mesh_id, killed), ("job", job), "start" or "GL"."""

    def keeps(self, seat: _WorkerSlot) -> bool:
        """Take a worker's messages and look at its state; return False when it has gone."""
        ending = seat.worker.ending()  # asked first: what it sent before it ended counts
        for kind, value in seat.worker.listen():
            self._take(seat, kind, value)
        if ending is not None:
            self._count_end(seat, ending)
            self._put_back(seat, ending.reason)
            return False
        if seat.mesh_id is not None:
            grown = seat.worker.gigabytes() - seat.gigabytes_before
            excess = self.limits.exceeded(time.monotonic() - seat.mesh_began, grown)
            if excess:
                excess += f"; raise --mesh-{'seconds' if 'timed out' in excess else 'gigabytes'}, with --retry-failed."
                seat.worker.kill()
                self.lost[seat.mesh_id] = excess
                self._put_back(seat, excess)
                return False
        if seat.n_done >= JOBS_PER_WORKER and seat.job is None:
            seat.worker.dismiss()
            return False
        return True

    def _take(self, seat: _WorkerSlot, kind: str, value: Any) -> None:
        if kind in ("mesh", "done"):  # the mesh before is made
            for killed in (False, True):
                self.ends.pop(("mesh", seat.mesh_id, killed), None)
        if kind == "log":
            logging.getLogger(value.name).handle(value)
        elif kind == "ready":
            seat.ready = True
            self.ends.pop("start", None)
        elif kind == "mesh":
            (seat.mesh_id, seat.gigabytes_before), seat.mesh_began = value, time.monotonic()
        elif kind == "done":
            job, result = value
            self.ends.pop("GL", None)
            self.ends.pop(("job", job), None)
            seat.job, seat.mesh_id, seat.n_done = None, None, seat.n_done + 1
            self.done(job, result)
        elif kind == "broken":
            seat.mesh_id = None  # not the mesh's fault
            self.ends["GL"] += 1
            if self.ends["GL"] >= MAX_BROKEN:
                raise DatasetError(f"workers must get an OpenGL context; {MAX_BROKEN} in a row did not: {value}")
        else:
            raise DatasetError(f"{str(value).rstrip('.')}. What was finished is kept, and the same command resumes.")

    def _count_end(self, seat: _WorkerSlot, ending: ExitStatus) -> None:
        """Note what a worker ended at; raise DatasetError when too many have and no mesh is to blame."""
        if not seat.ready:
            self.ends["start"] += 1
            if self.ends["start"] >= MAX_ENDS:
                raise DatasetError(
                    f"a worker must start; {MAX_ENDS} in a row ended before they were ready: {ending.reason}."
                )
        elif seat.mesh_id is not None:
            at = ("mesh", seat.mesh_id, ending.killed)
            self.ends[at] += 1
            if self.ends[at] >= (KILLS if ending.killed else CRASHES):
                self.lost[seat.mesh_id] = f"{ending.reason} at it, {self.ends[at]} times"
        elif seat.job is not None:
            self.ends["job", seat.job] += 1
            if self.ends["job", seat.job] >= MAX_ENDS:
                raise DatasetError(
                    f"a job must leave its worker alive; {MAX_ENDS} ended at {seat.job} while at no mesh: "
                    f"{ending.reason}. Is there memory enough? What was finished is kept, and the same command resumes."
                )

    def _put_back(self, seat: _WorkerSlot, reason: str) -> None:
        if seat.job is not None:
            self.queue.appendleft(seat.job)
            _LOG.warning("job %s is done again: %s", seat.job, reason)
