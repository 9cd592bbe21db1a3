"""The supervisor alone, with workers that do as they are told at once."""

from collections.abc import Iterator

import pytest

from zbuf_occlude.errors import DatasetError
from zbuf_occlude.limits import GivenUp, Limits
from zbuf_occlude.workers.pool import CRASHES, DEATHS_PER_JOB, KILLS, STARTS, Ending, Message, do_jobs


class Puppet:
    """Makes each shard at once; one that has no room never says it is ready, one that is doomed dies of its first."""

    def __init__(self, *, room: bool = True, doomed: bool = False) -> None:
        self.said: list[Message] = [("ready", 1)] if room else []
        self.doomed, self.end = doomed, ""
        self.killed = False

    def assign(self, shard: int, lost: dict[int, GivenUp]) -> None:
        if self.doomed:
            self.end = "the worker died"
        else:
            self.said.append(("done", (shard, None)))

    def listen(self) -> list[Message]:
        said, self.said = self.said, []
        return said

    def ending(self) -> Ending | None:
        return Ending(self.end, self.killed) if self.end else None

    def gigabytes(self) -> float:
        return 0.0

    def kill(self) -> None:
        self.end = "killed"

    def dismiss(self) -> None:
        self.end = "dismissed"


def test_the_last_shard_does_not_wait_for_a_replacement_without_room() -> None:
    # seat 0 dies with the last shard; its replacement never gets ready (a lost node's room is gone); seat 1 is idle
    hired: list[Puppet] = []

    def hire(seat: int) -> Puppet:
        hired.append(Puppet(room=len(hired) < 2, doomed=len(hired) == 0))
        return hired[-1]

    finished: list[int] = []
    rounds = iter(range(50))
    do_jobs(
        [7, 8],
        lambda job, _: finished.append(job) or (),
        start=hire,
        wait=lambda *_: next(rounds) and None,
        n_workers=2,
        limits=Limits(),
    )
    assert sorted(finished) == [7, 8]
    assert [puppet.end for puppet in hired][1:] == ["dismissed", "dismissed"][: len(hired) - 1]


class Mortal(Puppet):
    """Has a shard of one mesh, its number; dies where `fates` says so: at "start", or at the mesh of a number."""

    fates: Iterator[str | int] = iter(())

    def __init__(self) -> None:
        super().__init__()
        self.lost: dict[int, GivenUp] = {}
        self.fate = next(self.fates, None)
        if self.fate == "start":
            self.said, self.end = [], "the worker died"

    def assign(self, shard: int, lost: dict[int, GivenUp]) -> None:
        self.lost = lost
        self.said.append(("mesh", shard))
        if self.fate == shard and shard not in lost:
            self.end = "the worker died"
        else:
            self.said.append(("done", (shard, None)))


@pytest.mark.parametrize(
    ("killed", "fates", "given_up"),
    [
        (False, [0] * (CRASHES - 1), False),
        (False, [0] * CRASHES, True),
        (False, ["start", "start", *[0] * (CRASHES - 1)], False),
        (True, [0] * (KILLS - 1), False),
        (True, [0] * KILLS, True),
    ],
)
def test_a_mesh_at_which_workers_end_is_a_failure(
    monkeypatch: pytest.MonkeyPatch, killed: bool, fates: list[str | int], given_up: bool
) -> None:
    """Sooner where they crash at it than where something kills them from outside."""
    started: list[Mortal] = []
    monkeypatch.setattr(Mortal, "fates", iter(fates))

    def start(seat: int) -> Mortal:
        started.append(Mortal())
        started[-1].killed = killed
        return started[-1]

    done: list[int] = []
    do_jobs([0], lambda job, _: done.append(job) or (), start=start, wait=lambda *_: None, n_workers=1, limits=Limits())
    assert done == [0]
    reason = f"the worker died at it, {fates.count(0)} times"
    assert started[-1].lost == ({0: GivenUp(reason, Limits())} if given_up else {})


class Writer(Puppet):
    """Makes the mesh 0 and dies before it has written the job, as often as `deaths` says; or never starts."""

    deaths = 0

    def __init__(self, *, starts: bool = True) -> None:
        super().__init__(room=starts)
        if not starts:
            self.end = "the worker ended with code 1"

    def assign(self, shard: int, lost: dict[int, GivenUp]) -> None:
        assert not lost  # the mesh has been made each time: it is not to blame
        self.said += [("mesh", 0), ("mesh", None)]
        if Writer.deaths:
            Writer.deaths -= 1
            self.end = "the worker was killed by signal 9"
        else:
            self.said.append(("done", (shard, None)))


def write(n_deaths: int, monkeypatch: pytest.MonkeyPatch, *, starts: bool = True) -> list[int]:
    monkeypatch.setattr(Writer, "deaths", n_deaths)
    done: list[int] = []
    do_jobs(
        [0],
        lambda job, _: done.append(job) or (),
        start=lambda seat: Writer(starts=starts),
        wait=lambda *_: None,
        n_workers=1,
        limits=Limits(),
    )
    return done


def test_workers_that_die_while_they_write_blame_no_mesh(monkeypatch: pytest.MonkeyPatch) -> None:
    assert write(DEATHS_PER_JOB - 1, monkeypatch) == [0]
    with pytest.raises(DatasetError, match=rf"{DEATHS_PER_JOB} ended at 0 while at no mesh: .* signal 9\. .*resumes"):
        write(DEATHS_PER_JOB, monkeypatch)


def test_jobs_at_which_all_workers_die_do_not_excuse_each_other() -> None:
    hired: list[Puppet] = []

    def hire(seat: int) -> Puppet:
        assert len(hired) < 10 * DEATHS_PER_JOB, "the run must have given up"
        hired.append(Puppet(doomed=True))
        return hired[-1]

    with pytest.raises(DatasetError, match=rf"{DEATHS_PER_JOB} ended at . while at no mesh: the worker died"):
        do_jobs([0, 1, 2], lambda job, _: (), start=hire, wait=lambda *_: None, n_workers=3, limits=Limits())
    assert len(hired) <= 3 * DEATHS_PER_JOB + 3


def test_workers_that_never_start_end_the_run_and_say_why(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(DatasetError, match=rf"must start; {STARTS} in a row .* ready: the worker ended with code 1\."):
        write(0, monkeypatch, starts=False)
