"""The command line: each command is imported when it is called or asked for help."""

from importlib import import_module
from typing import Any

import click

from zbuf_occlude.cli.shell import COMPILING, CommandGroup, check_surroundings
from zbuf_occlude.jit.compiler import on_compiled

COMMANDS = {
    "generate": "Make a dataset of occluded point clouds.",
    "visible": "Write the occluded cloud that one camera sees of one mesh.",
    "scan": "Write one scan of a mesh by a LiDAR or depth camera, alone or in a scene.",
    "views": "List the cameras of a view set about a mesh; how much of it they see.",
    "shapes": "List the built-in shapes, or write one as a mesh to try things on.",
    "sensors": "List the sensors (LiDARs, depth cameras), their numbers and where each is from.",
    "depth": "Write the depth buffer of one mesh as an image or array.",
    "compare": "Measure methods against the exact reference and each other: rows, report.",
    "compare-scans": "Measure how real a sensor's scans are, by real scans of a mesh: report, pictures.",
    "report": "Write the report of a comparison again from its rows.",
    "status": "Show progress of a dataset.",
    "verify": "Check a finished dataset: checksums, counts, and some clouds against the oracle.",
    "merge": "Finish a dataset whose shards were made by several machines.",
    "convert": "Write a dataset in another format.",
    "show": "Draw a dataset: an interactive gallery, a contact sheet.",
    "train": "Train a classifier (VoxNet, PointNet, 3DmFV) on a dataset.",
    "evaluate": "Test a trained classifier: accuracy, confusion matrix, figures of each class.",
    "paper": "Repeat the paper: its tables, its figures, its experiments with classifiers.",
    "methods": "List the methods of hidden-surface removal, and what they need.",
    "doctor": "Say what works on this machine, and the command that would fix what does not.",
}
"""Name and one line of each command; `NAME_command` of its module is it."""

_MODULES = {
    "comparison": ("compare", "report"),
    "classifiers": ("train", "evaluate"),
    "datasets": ("status", "verify", "merge", "convert", "show"),
    "lists": ("methods", "sensors", "doctor"),
    "mesh_views": ("visible", "depth", "views"),
    "one_scan": ("scan",),
    "compare_scans": ("compare-scans",),
    # commands that go on working, and say by what they are replaced
    "experiment": ("experiment",),
    "figure": ("figure",),
}
"""Module to the commands in it, where it is not the one of the same name."""


class LazyGroup(CommandGroup):
    """All commands."""

    table = COMMANDS

    def get_command(self, context: click.Context, name: str) -> click.Command | None:
        """Import the command's module and return the command."""
        home = next((module for module, names in _MODULES.items() if name in names), name)
        if name not in COMMANDS and home not in _MODULES:
            return None
        command: click.Command = getattr(import_module(f"zbuf_occlude.cli.{home}"), f"{name.replace('-', '_')}_command")
        return command

    def invoke(self, context: click.Context) -> Any:
        """Run a command after environment checks."""
        check_surroundings()
        on_compiled(COMPILING.one_more)
        try:
            return super().invoke(context)
        finally:
            COMPILING.close()


@click.command(
    cls=LazyGroup,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 118, "show_default": True},
)
@click.version_option(package_name="zbuf-occlude")
def group() -> None:
    """Complete triangle meshes in, occluded point clouds out.

    Start with `zbuf-occlude generate`: without arguments it makes a dataset of the built-in shapes in ./occluded.
    Angles are in degrees, distances in multiples of the object's longest side.
    """
