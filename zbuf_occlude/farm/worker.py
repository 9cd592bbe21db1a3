"""A worker process: opens its own GL context, makes the shards it is handed, says what it is at."""

import ctypes
import os
import signal
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.dataset.shard import run_shard
from zbuf_occlude.errors import GlError, OccludeError
from zbuf_occlude.visibility import find_method

_PR_SET_PDEATHSIG = 1


def serve(connection: Connection, plan: Plan, out: Path, device_index: int | None, parent: int) -> None:
    """Run in the child: answer (shard, lost) requests until None comes, with messages as `supervisor.Message` says."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent decides what an interrupt means
    _die_with_parent(parent)
    gl: Any = None
    try:
        if find_method(plan.recipe.method).needs_gl:
            from zbuf_occlude.gl.context import GlContext  # late: only these methods touch GL

            gl = GlContext.open(device_index=device_index)
        while (request := connection.recv()) is not None:
            shard, lost = request
            run_shard(plan, shard, out, gl, lost=lost, on_mesh=lambda mesh_id: connection.send(("mesh", mesh_id)))
            connection.send(("done", shard))
    except GlError as error:
        connection.send(("broken", str(error)))
    except OccludeError as error:
        connection.send(("failed", str(error)))
    except OSError as error:
        connection.send(("failed", f"{error.strerror or error}{f': {error.filename}' if error.filename else ''}"))
    except EOFError:  # the parent is gone
        pass
    finally:
        if gl is not None:
            gl.close()


def _die_with_parent(parent: int) -> None:
    """Have the kernel kill this process when its parent ends, however that ends (Linux)."""
    ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:  # it ended before the line above
        os._exit(1)
