"""`zbuf-occlude paper`: the paper's tables, figures and experiments, each a command of its own."""

from collections.abc import Callable, Collection
from functools import partial
from importlib import import_module
from typing import Any, NamedTuple

import click

from zbuf_occlude.cli.echo import echo
from zbuf_occlude.cli.options import given
from zbuf_occlude.cli.panels import Command, Group


class PaperCommand(NamedTuple):
    """A command: one line, and the module of this room whose `paper_command(name)` makes it."""

    summary: str
    module: str


COMMANDS = {
    "table1a": PaperCommand("Table 1A: HSR by vertices, and with far faces excluded.", "compare"),
    "table1b": PaperCommand("Table 1B: exact HSR, and occupancy grids.", "compare"),
    "table2": PaperCommand("Table 2: datasets by samples and size, with the row of one made here.", "show"),
    "elevation": PaperCommand("4.2, Table 3A: classifiers against the camera's elevation.", "experiment"),
    "augmentation": PaperCommand(
        "4.3, 4.4, Table 3B: training on occluded clouds, complete ones, or both.", "experiment"
    ),
    "table3": PaperCommand("Both of these: Table 3A and 3B.", "experiment"),
    "realism": PaperCommand("Not the paper's: what a LiDAR and a street do to a classifier.", "experiment"),
    "fig4": PaperCommand("Fig. 4: division of large faces.", "figure"),
    "fig7": PaperCommand("Fig. 7: mesh, sampling, grid, and an occluded cloud from three sides.", "figure"),
    "fig8": PaperCommand("Fig. 8: object with camera, result of HSR, cloud.", "figure"),
    "fig9": PaperCommand("Fig. 9: objects made by formulas.", "figure"),
    "fig10": PaperCommand("Fig. 10: clouds at four azimuths.", "figure"),
    "fig11": PaperCommand("Fig. 11: clouds at four elevations.", "figure"),
    "fig12": PaperCommand("Fig. 12: projected area of the visible part against elevation.", "figure"),
}


class PaperGroup(Group):
    """The commands of the table, imported when one is called or asked for help."""

    def list_commands(self, context: click.Context) -> list[str]:
        """Return the names in the order of the table."""
        return list(COMMANDS)

    def get_command(self, context: click.Context, name: str) -> click.Command | None:
        """Import the command's module and return the command."""
        if name not in COMMANDS:
            return None
        command: click.Command = import_module(f"zbuf_occlude.cli.{COMMANDS[name].module}").paper_command(name)
        return command

    def format_commands(self, context: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the list of commands from the table."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, row.summary) for name, row in COMMANDS.items()])


@click.command(cls=PaperGroup)
def command() -> None:
    """Repeat the paper: its tables, its figures, its experiments with classifiers."""


def derived(
    old: click.Command, name: str, options: Collection[str], run: Callable[..., Any], text: str
) -> click.Command:
    """Return a command of `paper` that has some options of the command it replaces.

    Parameters
    ----------
    old : click.Command
    name : str
    options : collection of str
        Parameters of `old` that it has.
    run : callable
        Called with the name and the options.
    text : str
        Its help.
    """
    params = [parameter for parameter in old.params if parameter.name in options]
    return Command(name, params=params, callback=partial(run, name), help=text)


def replaced(old: str, new: str) -> None:
    """Say that a command goes on working, and by what it is replaced."""
    echo(f"note: `zbuf-occlude {old}` is now `zbuf-occlude {new}`", err=True)


def refuse_unused(name: str, options: Collection[str]) -> None:
    """Refuse options of the running command that were typed and that a table, figure or experiment does not use.

    Raises
    ------
    click.UsageError
    """
    if idle := given(click.get_current_context(), options):
        raise click.UsageError(f"{name} does not use {', '.join(idle)}. Leave it out.")
