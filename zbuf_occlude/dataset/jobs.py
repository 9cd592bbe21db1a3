"""What is still to be done in a dataset's folder, and in which order: shards, and parts of groups that are complete."""

import logging
import time
from bisect import bisect_right
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any, Protocol

from zbuf_occlude.dataset.formats import find_format
from zbuf_occlude.dataset.origins import check_origins, origins_of_made, worth_another_try
from zbuf_occlude.dataset.parts import (
    Places,
    Shard,
    find_written,
    look_at_part,
    n_parts,
    parts_of,
    places_of,
    runs_left,
    shards_of,
    shared_names,
    steps,
    write_part,
)
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.dataset.shard import Sidecar, look_at, run_shard
from zbuf_occlude.dataset.shared import unfinished
from zbuf_occlude.errors import DatasetError
from zbuf_occlude.limits import GivenUp, Limits
from zbuf_occlude.visibility import find_method

_LOG = logging.getLogger(__name__)

MOST_AT_ONCE = 5
"""At most a fifth of a dataset's parts are written at a time: what is in both shards and files stays below that. (Of
fewer parts two: so small a dataset takes little room.)"""

Done = Callable[[int, Any], Iterable[int]]
"""Told a job that is done, and its result; returns the jobs that may be begun now."""


class Task(Protocol):
    """What workers do: jobs, each known by its number. Sent to them once, when they start."""

    @property
    def needs_gl(self) -> bool:
        """Whether a worker needs a GL context for it."""

    def do(
        self,
        job: int,
        gl: Any,
        lost: Mapping[int, GivenUp] = MappingProxyType({}),
        on_mesh: Callable[[int | None], None] = lambda mesh_id: None,
    ) -> Any:
        """Do a job; what is returned goes back to whoever hired the worker.

        Parameters
        ----------
        job : int
        gl : GlContext or None
        lost, on_mesh
            As of `zbuf_occlude.dataset.shard.run_shard`, where the job is to make meshes.
        """


Run = Callable[[Task, list[int], Done], None]
"""Does jobs of a task: `zbuf_occlude.dataset.generate.run_here`, or an engine of the farm."""


@dataclass(frozen=True)
class Making:
    """The task of making a dataset: the jobs are its shards, and after them its parts.

    Parameters
    ----------
    plan : Plan
    out : Path
    needs_gl : bool
        Whether shards are made, and their method renders.
    """

    plan: Plan
    out: Path
    needs_gl: bool
    _shards: dict[int, list[Shard]] = field(default_factory=dict, init=False, repr=False)
    _places: list[Places] = field(default_factory=list, init=False, repr=False)

    def do(
        self,
        job: int,
        gl: Any,
        lost: Mapping[int, GivenUp] = MappingProxyType({}),
        on_mesh: Callable[[int | None], None] = lambda mesh_id: None,
    ) -> None:
        """Make a shard, or write a part."""
        if job < len(self.plan.shards):
            run_shard(self.plan, job, self.out, gl, lost=lost, on_mesh=on_mesh)
        else:
            part = job - len(self.plan.shards)
            write_part(self.plan, self.out, part, self._shards_of(part), self._all_places())

    def _shards_of(self, part: int) -> list[Shard]:
        whole = find_format(self.plan.format).whole_objects
        key = part if whole else self.plan.parts[part].group
        if key not in self._shards:  # others' are not needed any more, as a rule
            self._shards.clear()
            self._shards[key] = shards_of(self.plan, self.out, part)
        return self._shards[key]

    def _all_places(self) -> Places | None:
        if not find_format(self.plan.format).one_file:
            return None
        if not self._places:  # when the first part is written, all shards are done
            self._places.append(places_of(self.plan, self.out))
        return self._places[0]


class Jobs:
    """Finds out what is done in a folder, and hands out the rest.

    Parameters
    ----------
    plan : Plan
    out : Path
    shards : range or list of int
        Those to be made, where they are not done; of all others nothing is known.
    parts : range or list of int
        Those to be written.
    limits : Limits
        Shards with meshes that may be made within these, and failed within narrower ones, are made again.
    on_shard : callable
        Told the number of clouds planned in each shard that is done.
    on_part : callable
        Told 1 for each part that is written.

    Attributes
    ----------
    first : list of int
        The jobs that may be begun at once.
    task : Making
    made : float
        `time.perf_counter()` when the last shard was done.

    Raises
    ------
    DatasetError
        A mesh is another than what a finished shard was made of.
    """

    def __init__(
        self,
        plan: Plan,
        out: Path,
        shards: Iterable[int],
        parts: Iterable[int],
        limits: Limits,
        *,
        on_shard: Callable[[int], None] = lambda clouds: None,
        on_part: Callable[[int], None] = lambda parts: None,
    ) -> None:
        self.plan, self.out, self._limits = plan, out, limits
        self._on_shard, self._on_part = on_shard, on_part
        self.made = time.perf_counter()
        self._written = find_written(plan, out)
        missing = self._find_missing(shards)
        self._parts = {part for part in parts if part not in self._written}
        self._steps = steps(plan)
        self._ends = [step.shards.stop for step in self._steps]
        self._left = [len(missing.intersection(step.shards)) for step in self._steps]
        self._n_open, self._held = 0, deque[int]()
        for step, left in enumerate(self._left):
            if not left:
                self._hold(step)
        self.first = [*self._released(), *sorted(missing)]
        self.task = Making(plan, out, bool(missing) and find_method(plan.recipe.method).needs_gl)

    @property
    def n_written(self) -> int:
        """Parts that were written before."""
        return len(self._written)

    def done(self, job: int, result: Any = None) -> list[int]:
        """Take in that a job is done; return those that may be begun now."""
        if job < len(self.plan.shards):
            self._on_shard(len(self.plan.shards[job]) * self.plan.clouds_per_mesh)
            self.made = time.perf_counter()
            step = bisect_right(self._ends, job)
            self._left[step] -= 1
            if not self._left[step]:
                self._hold(step)
        else:
            self._n_open -= 1
            self._on_part(1)
        return self._released()

    def _hold(self, step: int) -> None:
        self._held.extend(part for part in reversed(self._steps[step].parts) if part in self._parts)

    def _released(self) -> list[int]:
        jobs = []
        while self._held and self._n_open < n_at_once(n_parts(self.plan)):
            jobs.append(len(self.plan.shards) + self._held.popleft())
            self._n_open += 1
        return jobs

    def _find_missing(self, shards: Iterable[int]) -> set[int]:
        missing = set()
        n_runs = runs_left(self.plan, self._written)
        begun = any(unfinished(self.out, name).exists() for name in shared_names(self.plan))
        for shard in shards:
            settled = begun or not self._written.isdisjoint(parts_of(self.plan, shard))
            sidecar, fault = look_at(self.plan, self.out, shard, closely=True, n_runs=n_runs[shard])
            if sidecar is not None:
                entries = [self.plan.meshes[i] for i in self.plan.shards[shard]]
                check_origins(entries, origins_of_made(sidecar), self.out)
                if not settled:  # else files without them are written already
                    again = worth_another_try(self.plan, sidecar, self._limits)
                    fault = f"{again[0]}, which failed, may be made now" if again else ""
            elif settled:
                self._check_unchanged(shard)
            if fault:
                _LOG.warning("shard %d is made again: %s", shard, fault)
            if sidecar is None or fault:
                missing.add(shard)
            else:
                self._on_shard(len(self.plan.shards[shard]) * self.plan.clouds_per_mesh)
        return missing

    def _check_unchanged(self, shard: int) -> None:
        """Check that a shard of which files hold clouds already would be made again as it was."""
        sidecar, _ = look_at(self.plan, self.out, shard, n_runs=0)
        if sidecar is None:
            return  # lost too; whether all clouds are there is found out in the end
        check_origins([self.plan.meshes[i] for i in self.plan.shards[shard]], origins_of_made(sidecar), self.out)
        if again := worth_another_try(self.plan, sidecar, self._limits):
            raise DatasetError(
                f"{again[0]} must fail as it did when the files in {self.out} were made, which have none of its "
                "clouds; its file, or what it may take, is another. Put it back, or make all again with --overwrite."
            )


def put_ahead(queue: deque[int], jobs: Iterable[int]) -> None:
    """Put jobs that may be begun now at the front of a queue, behind those there with higher numbers.

    So the parts of a group are written from the last to the first, and what they hold is always the end of its shards.
    """
    for job in jobs:
        queue.insert(next((place for place, other in enumerate(queue) if other < job), len(queue)), job)


def n_at_once(n_parts: int) -> int:
    """Return how many of this many parts may be written at a time."""
    return n_parts // MOST_AT_ONCE or min(2, n_parts)


def n_shards_done(plan: Plan, out: Path) -> int:
    """Count the shards of a folder that are done."""
    return sum(sidecar is not None for sidecar, _ in look_at_shards(plan, out))


def n_parts_written(plan: Plan, out: Path) -> int:
    """Count the parts of a folder that are written."""
    return sum(look_at_part(plan, out, part)[0] is not None for part in range(n_parts(plan)))


def look_at_shards(plan: Plan, out: Path, *, closely: bool = False) -> Iterator[tuple[Sidecar | None, str]]:
    """Look at all shards, as `shard.look_at` does, for what of their data is not in files yet."""
    written = {part for part in range(n_parts(plan)) if look_at_part(plan, out, part)[0] is not None}
    for shard, n_runs in enumerate(runs_left(plan, written)):
        yield look_at(plan, out, shard, closely=closely, n_runs=n_runs)


def check_all_done(plan: Plan, out: Path) -> None:
    """Check that all shards are done, before parts are written of them.

    Raises
    ------
    DatasetError
        One is not.
    """
    closely = find_format(plan.format).all_points  # else they are checked when they are read
    for shard, (sidecar, fault) in enumerate(look_at_shards(plan, out, closely=closely)):
        if sidecar is None:
            raise DatasetError(
                f"{out}: all {len(plan.shards)} shards must be done; shard {shard} is not{fault and f': {fault}'}. "
                "Run it first: the `zbuf-occlude generate` that made the others."
            )
