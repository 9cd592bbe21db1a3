"""Generate a dataset in a folder: plan, shards, final files, picture, manifest. The same call again resumes."""

import time
from collections import deque
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from zbuf_occlude.dataset.claim import claim, own_names, remove, remove_shards
from zbuf_occlude.dataset.finish import finish
from zbuf_occlude.dataset.folder import read_manifest
from zbuf_occlude.dataset.formats import find_format
from zbuf_occlude.dataset.jobs import Done, Jobs, Run, Task, check_all_done, put_ahead
from zbuf_occlude.dataset.origins import check_finished
from zbuf_occlude.dataset.parts import look_at_part, n_parts
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.errors import DatasetError
from zbuf_occlude.limits import Limits


def generate(
    plan: Plan,
    out: Path,
    *,
    run: Run | None = None,
    overwrite: bool = False,
    share: tuple[int, int] = (0, 1),
    limits: Limits | None = None,
    progress: Callable[[int], None] = lambda clouds: None,
    written: Callable[[int], None] = lambda parts: None,
) -> dict[str, Any]:
    """Make the dataset of a plan in a folder.

    Parameters
    ----------
    plan : Plan
    out : Path
        Made when missing. A folder with the same plan is resumed: shards that are done are not made again.
    run : callable, optional
        The engine; `run_here`, in this process, by default.
    overwrite : bool
        Remove a dataset that is in the folder first; with anything else in it, nothing is removed and it is an error.
    share : (int, int)
        (i, n): make only the shards of the i-th (from 0) of n machines; `merge` then makes the dataset of them.
    limits : Limits, optional
        Those that the engine keeps: a mesh given up within narrower ones is tried again.
    progress : callable
        Told the number of clouds planned in a shard when the shard is done.
    written : callable
        Told how many more parts of the final files are written: at the beginning those of before, then each.

    Returns
    -------
    dict
        The manifest; of a share of the dataset, {}.

    Raises
    ------
    DatasetError
        The folder holds another plan's dataset, or files that are not a dataset; a mesh is another than what has been
        made of it; the dataset is finished, and a mesh that failed may be made now; no mesh could be used.
    GlError
        The method needs GL and there is none.
    OptionError, UnavailableError
        The format cannot hold such a plan, or not here.
    """
    find_format(plan.format).check(plan)
    began = time.perf_counter()
    own_names(plan)  # a format that cannot write them says so
    if overwrite:
        remove(out)
    claim(plan, out)
    if (finished := read_manifest(out)) is not None:
        check_finished(plan, finished, limits or Limits(), out)
        remove_shards(plan, out)  # left when the run ended between its last two steps
        progress(plan.n_clouds)
        return finished
    limits = limits or Limits()
    try:
        alone = share == (0, 1)
        shards = range(share[0], len(plan.shards), share[1])
        parts = range(n_parts(plan) if alone else 0)
        jobs = Jobs(plan, out, shards, parts, limits, on_shard=progress, on_part=written)
        written(jobs.n_written)
        do(jobs, run or run_here)
        if not alone:
            return {}
        return finish(plan, out, {"making": jobs.made - began, "writing": time.perf_counter() - jobs.made})
    except (DatasetError, OSError):
        if (finished := finished_by_another(plan, out)) is None:
            raise
        return finished


def merge(
    plan: Plan,
    out: Path,
    *,
    run: Run | None = None,
    share: tuple[int, int] = (0, 1),
    progress: Callable[[int], None] = lambda parts: None,
) -> dict[str, Any]:
    """Write the final files of finished shards, then what belongs to the whole dataset; remove what is left of shards.

    Parameters
    ----------
    plan : Plan
    out : Path
    run, progress
        As of `generate`; progress is told 1 for each part that is written.
    share : (int, int)
        (i, n): write only the i-th (from 0) of n shares of the files; whoever writes the last completes the dataset.

    Returns
    -------
    dict
        The manifest; {} while there are files to be written.

    Raises
    ------
    DatasetError
        A shard is missing or damaged, a mesh has changed since it was used, or no mesh has a cloud.
    """
    began, n = time.perf_counter(), n_parts(plan)
    parts = range(share[0] * n // share[1], (share[0] + 1) * n // share[1])
    jobs = Jobs(plan, out, (), parts, Limits(), on_part=progress)
    try:
        check_all_done(plan, out)
        do(jobs, run or run_here)
        if any(look_at_part(plan, out, i)[0] is None for i in range(n)):
            return {}
        return finish(plan, out, {"writing": time.perf_counter() - began})
    except (DatasetError, OSError):
        if (finished := finished_by_another(plan, out)) is None:
            raise
        return finished


def finished_by_another(plan: Plan, out: Path) -> dict[str, Any] | None:
    """Return the manifest, if there is one: of two at one dataset, who comes first takes the other's shards away."""
    finished = read_manifest(out)
    if finished is None or finished["fingerprint"] != plan.fingerprint:
        return None
    remove_shards(plan, out)
    return finished


def do(jobs: Jobs, run: Run) -> None:
    """Have jobs done by an engine, if there are any."""
    if jobs.first:
        run(jobs.task, jobs.first, jobs.done)


def run_here(task: Task, jobs: list[int], done: Done) -> None:
    """Do jobs in this process, one after the other; opens, and closes, a GL context when the task needs one."""
    with ExitStack() as stack:
        gl = None
        if task.needs_gl:
            from zbuf_occlude.gl.context import GlContext  # late: only these methods touch GL

            gl = stack.enter_context(GlContext.open())
        queue = deque(jobs)
        while queue:
            job = queue.popleft()
            put_ahead(queue, done(job, task.do(job, gl)))
