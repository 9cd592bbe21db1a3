"""Imported where workers are forked from: loads what they need, compiled functions too, while no thread is running."""

import gc
import signal

from zbuf_occlude.jit.compiler import without_scipy

__all__ = ["worker"]

# what a whole group is sent is its parent's to hear, and the server ends with that: so no temporary folder stays
heard = {one: signal.signal(one, signal.SIG_IGN) for one in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}
signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
gc.disable()
with without_scipy():
    from numba import njit

    from zbuf_occlude.dataset.plan import Recipe
    from zbuf_occlude.dataset.rehearsal import compile_ahead, was_rehearsed
    from zbuf_occlude.jit.pool import alone
    from zbuf_occlude.workers import worker

    common = Recipe(method="exact")  # most of what it has compiled every other method's workers need too
    if was_rehearsed(common):
        with alone():
            compile_ahead(common)
    else:
        njit(lambda: None)()  # half a second's work that numba leaves for the first function
gc.enable()
gc.freeze()  # what is loaded stays: no collection looks through it, here at the end or, page by page, in a worker
for one, handler in heard.items():
    signal.signal(one, handler)  # whoever is forked has it back
