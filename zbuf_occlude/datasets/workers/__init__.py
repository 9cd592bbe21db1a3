"""Tasks in jobs, done in this process, or by worker processes on this machine (`local`) or a cluster (`ray`).

Several machines share the jobs of a task: each has the share I/N, or that of its SLURM array task.
"""

import re
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from types import MappingProxyType
from typing import Any, Protocol

from zbuf_occlude.base.errors import OptionError


class Task(Protocol):
    """Work in jobs. Sent to each worker once, when it starts; jobs may be done in any order by any worker."""

    @property
    def needs_gl(self) -> bool:
        """True where a worker needs a GL context."""

    def do(
        self,
        job: Any,
        gl: Any,
        lost: Mapping[int, str] = MappingProxyType({}),
        on_mesh: Callable[[int | None], None] = lambda mesh_id: None,
    ) -> Any:
        """Do a job; the result goes to the coordinator.

        Parameters
        ----------
        job : hashable
        gl : GlContext or None
        lost : mapping of mesh index to str
            Meshes that timed out, exceeded the memory limit or ended their workers, with the reasons: failures.
        on_mesh : callable
            To be called with each mesh's index before it is begun, and with None behind the last one: limits are each
            mesh's.
        """


Done = Callable[[Any, Any], None]
"""Called with each job that is done and its result."""

Run = Callable[[Task, list[Any], Done], None]
"""Does jobs of a task until none is left."""


def run_here(task: Task, jobs: list[Any], done: Done) -> None:
    """Do jobs in this process, one after the other; opens, and closes, a GL context when the task needs one."""
    with ExitStack() as stack:
        gl = None
        if task.needs_gl:
            from zbuf_occlude.engines.gl.context import GlContext  # late: only these tasks touch GL

            gl = stack.enter_context(GlContext.open())
        for job in jobs:
            done(job, task.do(job, gl))


def parse_shard(text: str) -> tuple[int, int]:
    """Read "I/N" with I counted from 0.

    Raises
    ------
    OptionError
        Not of that form, or I not below N.
    """
    match = re.fullmatch(r"(\d+)/(\d+)", text)
    if not match or int(match[1]) >= int(match[2]):
        raise OptionError(f"--shard must be I/N with 0 <= I < N; got {text!r}. The first of four is 0/4.")
    return int(match[1]), int(match[2])


def from_environment(environment: Mapping[str, str]) -> tuple[int, int]:
    """Return the share of a SLURM array task: (0, 1), everything, outside an array.

    SLURM_ARRAY_TASK_ID may start anywhere (``--array=7-10``): SLURM_ARRAY_TASK_MIN is taken off. Arrays with gaps
    (``--array=1,5,9``, ``--array=0-9:3``) cannot be told from their count and are refused.

    Raises
    ------
    OptionError
        The array has gaps.
    """
    if "SLURM_ARRAY_TASK_ID" not in environment or "SLURM_ARRAY_TASK_COUNT" not in environment:
        return 0, 1
    count = int(environment["SLURM_ARRAY_TASK_COUNT"])
    index = int(environment["SLURM_ARRAY_TASK_ID"]) - int(environment.get("SLURM_ARRAY_TASK_MIN", "0"))
    if not 0 <= index < count:
        raise OptionError(
            f"a SLURM array must be without gaps, like --array=0-{count - 1}; this task is number {index} of {count}. "
            "Or give --shard I/N."
        )
    return index, count
