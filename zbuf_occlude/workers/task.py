"""What workers do: jobs of a task, each known by a name; and doing them in this process."""

from collections import deque
from collections.abc import Callable, Hashable, Iterable, Mapping
from contextlib import ExitStack
from types import MappingProxyType
from typing import Any, Protocol

from zbuf_occlude.limits import GivenUp

Job = Hashable


class Task(Protocol):
    """Work in jobs. Sent to each worker once, when it starts; jobs may be done in any order by any worker."""

    @property
    def needs_gl(self) -> bool:
        """Whether a worker needs a GL context."""

    def do(
        self,
        job: Any,
        gl: Any,
        lost: Mapping[int, GivenUp] = MappingProxyType({}),
        on_mesh: Callable[[int | None], None] = lambda mesh_id: None,
    ) -> Any:
        """Do a job; the result goes to the coordinator.

        Parameters
        ----------
        job : hashable
        gl : GlContext or None
        lost : mapping of mesh index to GivenUp
            Meshes that timed out, exceeded the memory limit or ended their workers: failures, not tried again.
        on_mesh : callable
            To be called with each mesh's index before it is begun, and with None behind the last one: limits are each
            mesh's.
        """


Done = Callable[[Any, Any], Iterable[Job]]
"""Called with each job that is done and its result; returns jobs to do next, before those that wait."""

Run = Callable[[Task, list[Any], Done], None]
"""Does jobs of a task until none is left."""


def run_here(task: Task, jobs: list[Any], done: Done) -> None:
    """Do jobs in this process, one after the other; opens, and closes, a GL context when the task needs one."""
    with ExitStack() as stack:
        gl = None
        if task.needs_gl:
            from zbuf_occlude.gl.context import GlContext  # late: only these tasks touch GL

            gl = stack.enter_context(GlContext.open())
        queue = deque(jobs)
        while queue:
            job = queue.popleft()
            queue.extendleft(reversed(list(done(job, task.do(job, gl)))))
