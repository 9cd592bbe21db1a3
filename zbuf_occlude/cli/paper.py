"""Command group `paper`: a command for each table, figure and experiment of the paper."""

from collections.abc import Callable, Collection
from functools import partial
from importlib import import_module
from typing import Any

import click

from zbuf_occlude.cli.shared_options import explicitly_set
from zbuf_occlude.cli.shell import Command, CommandGroup, echo

COMMANDS = {
    "table1a": "Table 1A: HSR by vertices, and with far faces excluded.",
    "table1b": "Table 1B: exact HSR and occupancy grids.",
    "table2": "Table 2: datasets by samples and size, with a dataset of `generate`.",
    "elevation": "4.2, Table 3A: classifiers against the camera's elevation.",
    "augmentation": "4.3, 4.4, Table 3B: training on occluded clouds, complete ones, or both.",
    "table3": "Tables 3A and 3B: `elevation` and `augmentation`.",
    "real": "4.4, Test 3: generated clouds as training for the objects of a real drive.",
    "realism": "Not in the paper: classifiers on scans by a LiDAR, in streets, by a depth camera.",
    "fig4": "Fig. 4: division of large faces.",
    "fig7": "Fig. 7: mesh, sampling, grid, and an occluded cloud from three sides.",
    "fig8": "Fig. 8: object with camera, result of HSR, cloud.",
    "fig9": "Fig. 9: objects made by formulas.",
    "fig10": "Fig. 10: clouds at four azimuths.",
    "fig11": "Fig. 11: clouds at four elevations.",
    "fig12": "Fig. 12: projected area of the visible part against elevation.",
}
"""Summary of each command by its name."""

_MAKERS = {
    "table1": ("comparison", "table1_command"),
    "table2": ("datasets", "table2_command"),
    "fig": ("figure", "figure_named"),
    "": ("experiment", "experiment_named"),
}
"""Prefix of names; module of `cli` and function that return the command of a name."""


class PaperGroup(CommandGroup):
    """Group of the commands of `paper`."""

    table = COMMANDS

    def get_command(self, context: click.Context, name: str) -> click.Command | None:
        """Return a command; its module is imported."""
        if name not in COMMANDS:
            return None
        module, maker = next(row for start, row in _MAKERS.items() if name.startswith(start))
        command: click.Command = getattr(import_module(f"zbuf_occlude.cli.{module}"), maker)(name)
        return command


@click.command(cls=PaperGroup)
def paper_command() -> None:
    """Repeat the paper's tables, figures and experiments with classifiers.

    The paper: Sryamkin, Msallam, Klestov, A method to create real-like point clouds for 3D object classification,
    2023. HSR is its hidden-surface removal; numbers such as 4.2 are its sections.
    """


def derived(
    old: click.Command, name: str, options: Collection[str], run: Callable[..., Any], text: str
) -> click.Command:
    """Return a command of `paper` that calls `run` with its name and with some `options` of an `old` command."""
    params = [parameter for parameter in old.params if parameter.name in options]
    return Command(name, params=params, callback=partial(run, name), help=text)


def replaced(old: str, new: str) -> None:
    """Print a note that a command has a new name."""
    echo(f"note: `zbuf-occlude {old}` is now `zbuf-occlude {new}`", err=True)


def refuse_unused(name: str, options: Collection[str]) -> None:
    """Raise UsageError for typed options that a table, figure or experiment does not use."""
    if idle := explicitly_set(click.get_current_context(), options):
        raise click.UsageError(f"{name} does not use {', '.join(idle)}. Leave it out.")
