"""Imported where workers are forked from: loads what they need, compiled functions too, while no thread is running."""

from numba import njit

from zbuf_occlude.dataset.plan import Recipe
from zbuf_occlude.dataset.rehearsal import compile_ahead, is_compiled
from zbuf_occlude.farm import worker
from zbuf_occlude.threads import alone

__all__ = ["worker"]

_COMMON = Recipe(method="exact")
"""Most of what it has compiled, for reading, sampling and checking, every other method's workers need too."""

if is_compiled(_COMMON):
    with alone():
        compile_ahead(_COMMON)
else:
    njit(lambda: None)()  # half a second's work that numba leaves for the first function
