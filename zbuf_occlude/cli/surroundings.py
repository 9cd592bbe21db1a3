"""What a shell hands to every command, looked at before anything compiled is loaded, which would end in a traceback."""

import os
from pathlib import Path

from zbuf_occlude.errors import OccludeError, OptionError
from zbuf_occlude.limits import address_space

LEAST_MEMORY = 768 * 2**20
"""Bytes of address space: with 500 MB compiling ends in an abort of LLVM's, with 800 MB a small dataset is made."""


def check_surroundings() -> None:
    """Look at what numba would refuse while it is imported, and at the folder that paths begin in.

    Raises
    ------
    OptionError
        NUMBA_NUM_THREADS is a whole number below 1. (numba takes no notice of words.)
    OccludeError
        The process may have less than `LEAST_MEMORY` of address space, or its folder has been removed.
    """
    try:
        Path.cwd()
    except FileNotFoundError:
        raise OccludeError("the current folder must be there; it has been removed. Change to another: cd.") from None
    threads = os.environ.get("NUMBA_NUM_THREADS", "").strip()
    if threads.lstrip("+-").isdecimal() and int(threads) < 1:
        raise OptionError(f"NUMBA_NUM_THREADS must be 1 or more; it is {threads}. Unset it, or give a number.")
    allowed = address_space()
    if allowed is not None and allowed < LEAST_MEMORY:
        raise OccludeError(
            f"a process must be allowed {LEAST_MEMORY // 1024:,} kB of address space; this one is allowed "
            f"{allowed // 1024:,} kB. Raise the limit, as ulimit -v {LEAST_MEMORY // 1024} does."
        )
