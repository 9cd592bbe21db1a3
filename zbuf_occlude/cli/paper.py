"""`zbuf-occlude paper`: the paper's tables, figures and experiments, each a command of its own."""

from collections.abc import Callable, Collection
from functools import partial
from importlib import import_module
from typing import Any

import click

from zbuf_occlude.cli.shared_options import explicitly_set
from zbuf_occlude.cli.shell import Command, CommandGroup, echo

COMMANDS = {
    "table1a": "Table 1A: HSR by vertices, and with far faces excluded.",
    "table1b": "Table 1B: exact HSR, and occupancy grids.",
    "table2": "Table 2: datasets by samples and size, with the row of one made here.",
    "elevation": "4.2, Table 3A: classifiers against the camera's elevation.",
    "augmentation": "4.3, 4.4, Table 3B: training on occluded clouds, complete ones, or both.",
    "table3": "Both of these: Table 3A and 3B.",
    "realism": "Not the paper's: what a LiDAR and a street do to a classifier.",
    "fig4": "Fig. 4: division of large faces.",
    "fig7": "Fig. 7: mesh, sampling, grid, and an occluded cloud from three sides.",
    "fig8": "Fig. 8: object with camera, result of HSR, cloud.",
    "fig9": "Fig. 9: objects made by formulas.",
    "fig10": "Fig. 10: clouds at four azimuths.",
    "fig11": "Fig. 11: clouds at four elevations.",
    "fig12": "Fig. 12: projected area of the visible part against elevation.",
}
"""Name and one line of each command."""

_MAKERS = {
    "table1": ("comparison", "table1_command"),
    "table2": ("datasets", "table2_command"),
    "fig": ("figure", "figure_named"),
    "": ("experiment", "experiment_named"),
}
"""How names begin; module and function of this room that make the command, called with its name."""


class PaperGroup(CommandGroup):
    """The commands of `paper`."""

    table = COMMANDS

    def get_command(self, context: click.Context, name: str) -> click.Command | None:
        """Import the command's module and return the command."""
        if name not in COMMANDS:
            return None
        module, maker = next(row for start, row in _MAKERS.items() if name.startswith(start))
        command: click.Command = getattr(import_module(f"zbuf_occlude.cli.{module}"), maker)(name)
        return command


@click.command(cls=PaperGroup)
def paper_command() -> None:
    """Repeat the paper: its tables, its figures, its experiments with classifiers."""


def derived(
    old: click.Command, name: str, options: Collection[str], run: Callable[..., Any], text: str
) -> click.Command:
    """Return a command of `paper` that has some `options` of the `old` one; `run` is called with its name and these."""
    params = [parameter for parameter in old.params if parameter.name in options]
    return Command(name, params=params, callback=partial(run, name), help=text)


def replaced(old: str, new: str) -> None:
    """Say that a command goes on working, and by what it is replaced."""
    echo(f"note: `zbuf-occlude {old}` is now `zbuf-occlude {new}`", err=True)


def refuse_unused(name: str, options: Collection[str]) -> None:
    """Refuse typed options that a table, figure or experiment does not use, by a UsageError."""
    if idle := explicitly_set(click.get_current_context(), options):
        raise click.UsageError(f"{name} does not use {', '.join(idle)}. Leave it out.")
