"""echo: the one way in which commands print, names made printable; and what several of them say alike."""

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
