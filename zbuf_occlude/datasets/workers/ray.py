"""The Ray engine: actors on a cluster's nodes, each with its own GL context; nodes may die at any moment."""

import logging
import os
import socket
import threading
import time
from multiprocessing import Pipe
from typing import Any

from zbuf_occlude.base.errors import GlError, UnavailableError
from zbuf_occlude.base.extras import importing
from zbuf_occlude.base.limits import Limits, resident_gigabytes
from zbuf_occlude.datasets.workers import Done, Task
from zbuf_occlude.datasets.workers.pool import ExitStatus, Message, do_jobs, work

LISTEN_SECONDS = 0.4
"""Seconds that an actor waits for a message before it answers without one."""


def run_ray(
    task: Task,
    jobs: list[Any],
    done: Done,
    *,
    n_workers: int | None,
    limits: Limits,
    address: str | None = None,
    gpus_per_worker: float = 0.0,
) -> None:
    """Do jobs by Ray actors, with the errors and promises of `do_jobs`.

    Parameters
    ----------
    task : Task
        The folder that it is about must be the same on every node.
    jobs, done, limits
        As in `do_jobs`.
    n_workers : int or None
        Actors; by default as many as the cluster has CPUs, or room for by `gpus_per_worker`.
    address : str, optional
        Of a running cluster ("auto", "host:port"); by default RAY_ADDRESS's, or a new one on this machine.
    gpus_per_worker : float
        Ray's num_gpus for an actor; fractions share a GPU. The actor renders on the EGL device of the GPU it was given.

    Raises
    ------
    UnavailableError
        Ray is not installed or cannot be imported, or no cluster answers at the address.
    """
    with importing("ray", "the Ray engine"):
        import ray

        owned = not ray.is_initialized()
    if owned:
        try:
            address = address or os.environ.get("RAY_ADDRESS") or None
            _check_reachable(address or "")
            # without "local" Ray waits for what the last cluster of this machine has left, even if that was killed
            ray.init(
                address=address or "local", log_to_driver=False, include_dashboard=False, logging_level=logging.ERROR
            )
        except (OSError, RuntimeError, ValueError) as error:
            raise UnavailableError(f"a Ray cluster must answer at {address or 'this machine'}: {error}") from None
    try:
        resources = ray.cluster_resources()
        room = resources.get("GPU", 0) / gpus_per_worker if gpus_per_worker else resources.get("CPU", 1)
        actor = ray.remote(_Actor).options(
            num_cpus=0 if gpus_per_worker else 1, num_gpus=gpus_per_worker, max_restarts=0
        )
        handle = ray.put(task)
        do_jobs(
            jobs,
            done,
            start=lambda seat: RayWorker(ray, actor.remote(handle), limits.seconds),
            wait=_wait,
            n_workers=n_workers or max(1, int(room)),
            limits=limits,
        )
    finally:
        if owned:
            ray.shutdown()


def _check_reachable(address: str) -> None:
    """Raise OSError where no process listens at "host:port": Ray itself would try for minutes."""
    host, _, port = address.rpartition(":")
    if host and port.isdecimal() and "//" not in host:
        socket.create_connection((host, int(port)), timeout=10).close()


class _Actor:
    """Actor in a Ray process: a thread that works, and short methods that pass on its messages."""

    def __init__(self, task: Task) -> None:
        self.connection, theirs = Pipe()
        # one thread does all the GL; Ray may call the methods from others
        arguments = (theirs, task, _egl_device(task))
        self.thread = threading.Thread(target=work, args=arguments, daemon=True)
        self.thread.start()

    def assign(self, job: Any, lost: dict[int, str]) -> None:
        self.connection.send((job, lost))

    def listen(self) -> tuple[list[Message], float]:
        messages: list[Message] = []
        if self.connection.poll(LISTEN_SECONDS):
            messages.append(self.connection.recv())
            while self.connection.poll():
                messages.append(self.connection.recv())
        return messages, resident_gigabytes(os.getpid())


def _egl_device(task: Task) -> int | None:
    """The EGL device of the GPU that Ray gave this actor: EGL ignores CUDA_VISIBLE_DEVICES and would take the first."""
    if not task.needs_gl:
        return None
    import ray

    from zbuf_occlude.engines.gl.devices import egl_devices  # late: only these methods touch GL

    given = [int(gpu) for gpu in ray.get_gpu_ids()]
    try:
        devices = egl_devices() if given else ()
    except GlError:
        return None
    return next((device.index for device in devices if device.cuda_device in given), None)


class RayWorker:
    """An actor as the coordinator sees it; one `listen` is always under way, so a death shows at once."""

    def __init__(self, ray: Any, actor: Any, patience: float) -> None:
        self.ray, self.actor, self.patience = ray, actor, patience
        self.end: ExitStatus | None = None
        self.memory = 0.0
        self.heard: float | None = None  # when it last answered; None until it has started
        self.future = actor.listen.remote()

    def assign(self, job: Any, lost: dict[int, str]) -> None:
        """Send a request."""
        self.actor.assign.remote(job, lost)

    def listen(self) -> list[Message]:
        """Take what the call under way has brought, and start the next."""
        if self.end or not self.ray.wait([self.future], timeout=0)[0]:
            return []
        try:
            messages, self.memory = self.ray.get(self.future)
        except self.ray.exceptions.RayError as error:
            self.end = ExitStatus(f"the actor ended ({type(error).__name__})", True)
            return []
        self.heard = time.monotonic()
        self.future = self.actor.listen.remote()
        return list(messages)

    def ending(self) -> ExitStatus | None:
        """Return how the actor or its node ended, as the last `listen` learned it; or that it no longer answers.

        An actor answers twice a second, unless a kernel keeps Python waiting. Ray may see a lost node late or never.
        """
        if not self.end and self.heard is not None and time.monotonic() - self.heard > self.patience:
            self.end = ExitStatus(f"the actor has not answered for {self.patience:g} seconds", True)
            self.kill()
        return self.end

    def gigabytes(self) -> float:
        """Return what the actor said last."""
        return self.memory

    def kill(self) -> None:
        """Kill the actor's process."""
        self.ray.kill(self.actor)

    def dismiss(self) -> None:
        """Kill the actor's process, which has no job."""
        self.kill()


def _wait(workers: list[RayWorker], seconds: float) -> None:
    workers[0].ray.wait([worker.future for worker in workers], timeout=seconds)
