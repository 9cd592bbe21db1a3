"""What Python's fork server loads before it forks workers: all that they need, compiled functions too."""

import gc
import pickle
import signal
import sys
from typing import Any

from zbuf_occlude.jit.compiler import without_scipy

__all__ = ["local"]


def say(kind: type[BaseException], *more: Any) -> None:
    """Say how a process failed to start, unless who started it was killed before all was sent."""
    if not issubclass(kind, (EOFError, pickle.UnpicklingError)):
        sys.__excepthook__(kind, *more)


sys.excepthook = say

# an interrupt of the whole process group is the coordinator's: so no temporary folder stays
heard = {one: signal.signal(one, signal.SIG_IGN) for one in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}
signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
gc.disable()  # 10 % of the time
with without_scipy():
    from zbuf_occlude.dataset.plan import DatasetConfig
    from zbuf_occlude.dataset.rehearsal import is_warm, warm_up_jit
    from zbuf_occlude.jit.threads import single_threaded
    from zbuf_occlude.workers import local

    common = DatasetConfig(method="exact")  # most of what it has compiled the workers of all other methods need too
    if is_warm(common):
        with single_threaded():
            warm_up_jit(common)
gc.enable()
gc.freeze()  # what is loaded stays: no collection looks through it and so copies its pages into a worker
for one, handler in heard.items():
    signal.signal(one, handler)  # forked processes have it back
