"""The supervisor alone, with workers that do as they are told at once."""

from zbuf_occlude.farm.supervisor import Limits, Message, supervise


class Puppet:
    """Makes each shard at once; one that has no room never says it is ready, one that is doomed dies of its first."""

    def __init__(self, *, room: bool = True, doomed: bool = False) -> None:
        self.said: list[Message] = [("ready", 1)] if room else []
        self.doomed, self.end = doomed, ""

    def assign(self, shard: int, lost: dict[int, str]) -> None:
        if self.doomed:
            self.end = "the worker died"
        else:
            self.said.append(("done", shard))

    def listen(self) -> list[Message]:
        said, self.said = self.said, []
        return said

    def ending(self) -> str:
        return self.end

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
    supervise([7, 8], finished.append, hire=hire, wait=lambda *_: next(rounds) and None, n_workers=2, limits=Limits())
    assert sorted(finished) == [7, 8]
    assert [puppet.end for puppet in hired][1:] == ["dismissed", "dismissed"][: len(hired) - 1]
