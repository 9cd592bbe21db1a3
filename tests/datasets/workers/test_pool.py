"""The pool alone, with workers that do at once what a test says."""

import pytest

from zbuf_occlude.base.errors import DatasetError
from zbuf_occlude.base.limits import Limits
from zbuf_occlude.datasets.workers.pool import CRASHES, KILLS, MAX_BROKEN, MAX_ENDS, ExitStatus, Message, do_jobs

ENDS = "the worker ended"


class Puppet:
    """Its job n is one mesh, n: "done" or "slow"; or it ends at the "start", the "mesh", the "job", or is "broken"."""

    def __init__(
        self, fate: str = "done", *, killed: bool = False, ready: bool = True, memory: tuple[float, float] = (0.0, 0.0)
    ) -> None:
        self.fate, self.killed, self.end = fate, killed, ENDS if fate == "start" else ""
        self.memory = memory  # before its mesh and at it, gigabytes
        self.said: list[Message] = [("ready", 1)] if ready and fate != "start" else []
        self.lost: dict[int, str] = {}

    def assign(self, job: int, lost: dict[int, str]) -> None:
        self.lost = lost
        if self.fate == "broken":
            self.said.append(("broken", "no driver"))
        else:
            begun: list[Message] = [("mesh", (job, self.memory[0])), ("mesh", (None, self.memory[0]))]
            self.said += begun[: 1 + (self.fate not in ("mesh", "slow"))]
        if self.fate == "done" or (self.fate == "mesh" and job in lost):
            self.said.append(("done", (job, None)))
        elif self.fate == "slow":
            self.fate = "done"
        else:
            self.end = ENDS

    def listen(self) -> list[Message]:
        said, self.said = self.said, []
        if said and said[-1][0] == "mesh" and self.fate == "done":  # it is slow: done at the next look
            self.said.append(("done", (said[-1][1][0], None)))
        return said

    def ending(self) -> ExitStatus | None:
        return ExitStatus(self.end, self.killed) if self.end else None

    def gigabytes(self) -> float:
        return self.memory[1]

    def kill(self) -> None:
        self.end = "killed"

    def dismiss(self) -> None:
        self.end = "dismissed"


def run(jobs: list[int], puppets: list[Puppet], n_workers: int = 1) -> tuple[list[int], list[Puppet]]:
    """Do jobs by these workers in turn, then by ones that live; return the jobs done and the workers started."""
    done: list[int] = []
    started: list[Puppet] = []

    def start(seat: int) -> Puppet:
        started.append(puppets[len(started)] if len(started) < len(puppets) else Puppet())
        return started[-1]

    rounds = iter(range(500))
    do_jobs(
        jobs,
        lambda job, _: done.append(job),
        start=start,
        wait=lambda *_: next(rounds) and None,
        n_workers=n_workers,
        limits=Limits(),
    )
    return done, started


@pytest.mark.parametrize(
    ("killed", "fates", "given_up"),
    [
        (False, ["mesh"] * (CRASHES - 1), False),
        (False, ["mesh"] * CRASHES, True),
        (False, ["start", "start", *["mesh"] * (CRASHES - 1)], False),
        (True, ["mesh"] * (KILLS - 1), False),
        (True, ["mesh"] * KILLS, True),
    ],
)
def test_a_mesh_at_which_workers_end_is_a_failure(killed: bool, fates: list[str], given_up: bool) -> None:
    """Sooner where they crash at it than where something kills them from outside."""
    done, started = run([0], [Puppet(fate, killed=killed) for fate in fates])
    assert done == [0]
    reason = f"{ENDS} at it, {fates.count('mesh')} times"
    assert started[-1].lost == ({0: reason} if given_up else {})


@pytest.mark.parametrize(("before", "lost"), [(7.0, False), (0.0, True)])
def test_what_a_worker_had_before_a_mesh_does_not_count_as_the_meshs(before: float, lost: bool) -> None:
    """A worker has the clouds of its shard in memory, up to half a gigabyte, besides the mesh that it is at."""
    done, started = run([0], [Puppet("slow", memory=(before, Limits().gigabytes + 1.0))])
    assert done == [0]
    assert len(started) == 1 + lost
    assert started[-1].lost == ({0: started[-1].lost.get(0, "")} if lost else {})


@pytest.mark.parametrize(
    ("fate", "most", "words"),
    [("start", MAX_ENDS, "must start"), ("job", MAX_ENDS, "ended at 0"), ("broken", MAX_BROKEN, "no driver")],
)
def test_workers_that_end_in_a_row_at_no_mesh_end_the_run(fate: str, most: int, words: str) -> None:
    done, started = run([0], [Puppet(fate) for _ in range(most - 1)])
    assert (done, started[-1].lost) == ([0], {}), "no mesh is to blame"
    with pytest.raises(DatasetError, match=words):
        run([0], [Puppet(fate) for _ in range(most)])


def test_jobs_at_which_all_workers_end_do_not_excuse_each_other() -> None:
    with pytest.raises(DatasetError, match=rf"{MAX_ENDS} ended at \d while at no mesh"):
        run([0, 1, 2], [Puppet("job") for _ in range(3 * MAX_ENDS)], n_workers=3)


def test_the_last_job_does_not_wait_for_a_replacement_without_room() -> None:
    """Seat 0 ends at the last job; its replacement never gets ready (a lost node's room is gone); seat 1 is idle."""
    done, started = run([7, 8], [Puppet("mesh"), Puppet(), *(Puppet(ready=False) for _ in range(9))], n_workers=2)
    assert sorted(done) == [7, 8]
    assert all(puppet.end == "dismissed" for puppet in started[1:])
