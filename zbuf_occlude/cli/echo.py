"""echo: the one way in which commands print, names made printable; and what several of them say alike."""

from typing import Any

import click

from zbuf_occlude.errors import printable


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
