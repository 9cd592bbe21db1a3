"""What a worker does, whatever engine hired it: open a GL context of its own, do the jobs it is handed, say so."""

import ctypes
import os
import signal
import sys
from collections.abc import Mapping
from contextlib import suppress
from multiprocessing import forkserver
from multiprocessing.connection import Connection
from typing import Any

from zbuf_occlude.errors import GlError, OccludeError
from zbuf_occlude.workers.sent import Sent
from zbuf_occlude.workers.task import Task

_PR_SET_PDEATHSIG = 1

FIXED = ("NUMBA_NUM_THREADS",)
"""Variables that numba has read where workers are forked from."""


def serve(
    connection: Connection,
    sent: Sent,
    device_index: int | None,
    n_threads: int,
    environment: Mapping[str, str],
) -> None:
    """Run as the main function of a child process with these variables, of this many threads.

    A forked one ends with the server that it was forked from, which ends with the supervisor's process.
    """
    from zbuf_occlude.jit.pool import use_threads  # late, with numba: the supervisor's process computes nothing

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the supervisor decides what an interrupt means
    _let_server_end()
    die_with_parent(os.getppid())
    variables = {name: value for name, value in environment.items() if name not in FIXED}
    variables |= {name: os.environ[name] for name in FIXED if name in os.environ}
    os.environ.clear()  # the server's, perhaps of another run
    os.environ.update(variables)
    use_threads(n_threads)
    work(connection, sent.unpacked(), device_index)


def work(connection: Connection, task: Task, device_index: int | None) -> None:
    """Answer (job, lost) requests until None comes, with messages as `supervisor.Message` says.

    Everything GL happens in the thread that calls this.
    """
    gl: Any = None
    with suppress(EOFError, BrokenPipeError):  # the supervisor is gone
        try:
            if task.needs_gl:
                from zbuf_occlude.gl.context import GlContext  # late: only these methods touch GL

                gl = GlContext.open(device_index=device_index)
            connection.send(("ready", os.getpid()))
            while (request := connection.recv()) is not None:
                job, lost = request
                result = task.do(job, gl, lost, lambda mesh_id: connection.send(("mesh", mesh_id)))
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


def _let_server_end() -> None:
    """Close this process's copy of the pipe that Python's fork server lives by, and the supervisor's alone is to hold.

    With copies in workers the server would outlive the supervisor, and a worker that hangs the server.
    """
    server: Any = forkserver._forkserver
    if server._forkserver_alive_fd is not None:
        os.close(server._forkserver_alive_fd)
        server._forkserver_alive_fd = None


def die_with_parent(parent: int) -> None:
    """Have the kernel kill this process when its parent ends, however that ends; elsewhere than on Linux do nothing."""
    if sys.platform != "linux":
        return
    ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:  # it ended before the line above
        os._exit(1)
