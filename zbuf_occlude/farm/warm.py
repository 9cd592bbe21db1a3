"""Imported where workers are forked from: loads what they need, compiled functions too, while no thread is running."""

import gc
import sys

__all__ = ["worker"]

gc.disable()
hidden = "scipy" not in sys.modules
if hidden:  # numba would import it, for .15 s, to see whether compiled functions may call BLAS; none of these does
    sys.modules["scipy"] = None  # type: ignore[assignment]

from numba import njit  # noqa: E402

from zbuf_occlude.dataset.plan import Recipe  # noqa: E402
from zbuf_occlude.dataset.rehearsal import compile_ahead, is_compiled  # noqa: E402
from zbuf_occlude.farm import worker  # noqa: E402
from zbuf_occlude.threads import alone  # noqa: E402

_COMMON = Recipe(method="exact")
"""Most of what it has compiled, for reading, sampling and checking, every other method's workers need too."""

if is_compiled(_COMMON):
    with alone():
        compile_ahead(_COMMON)
else:
    njit(lambda: None)()  # half a second's work that numba leaves for the first function

if hidden:
    del sys.modules["scipy"]
gc.enable()
gc.freeze()  # what is loaded stays: no collection looks through it, here at the end or, page by page, in a worker
