"""What every command has: the one way to print, a bar, one line of an error, a look at what the shell hands over."""

import os
from pathlib import Path
from typing import Any

import click

from zbuf_occlude.errors import OccludeError, OptionError, printable
from zbuf_occlude.limits import address_space

SOME_FAILED = 3
"""Exit code of a run that was done but for some meshes."""


def echo(text: object, *, err: bool = False) -> None:
    """Print lines, to standard output or standard error.

    Names in them come from files and folders, and from data that others made: what would command a terminal, or is in
    no encoding, is written as in Python; ``\\n`` alone ends a line.
    """
    click.echo("\n".join(map(printable, str(text).split("\n"))), err=err)


def on(renderer: str) -> str:
    """Say which renderer drew; nothing of a method that renders nothing."""
    return "" if renderer == "none" else f" on {renderer}"


def one_line(error: click.ClickException) -> str:
    """Return what click says of a command line, and where its help is."""
    context = error.ctx if isinstance(error, click.UsageError) else None
    said = " ".join(error.format_message().split())
    return f"{said} Help: {context.command_path} --help" if context is not None else said


def progress_bar(total: float, unit: str, what: str, **more: Any) -> Any:
    """Return a tqdm bar, shown with the first progress: after all that may refuse."""
    from tqdm import tqdm  # late: help needs none

    return tqdm(total=total, unit=f" {unit}", desc=what, **{"smoothing": 0.05, "delay": 1e-3, "mininterval": 0, **more})


LEAST_MEMORY = 768 * 2**20
"""Bytes of address space: with 500 MB compiling ends in an abort of LLVM's, with 800 MB a small dataset is made."""


def check_surroundings() -> None:
    """Raise OptionError or OccludeError where numba could not be imported, or the current folder is gone."""
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


def counted(n: int, one: str, many: str = "") -> str:
    """Return a number of things in words: ``1 mesh``, ``2 meshes``."""
    return f"{n} {one if n == 1 else many or one + 's'}"
