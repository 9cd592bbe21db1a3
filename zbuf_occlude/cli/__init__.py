"""Command line; the module of a command is imported when the command is called or its help is shown."""

from importlib import import_module
from typing import Any

import click

from zbuf_occlude.base.jit.compiler import on_compiled
from zbuf_occlude.cli.shell import COMPILING, CommandGroup, check_surroundings

COMMANDS = {
    "generate": "Make a dataset of occluded point clouds.",
    "visible": "Write the occluded cloud that one camera sees of one mesh.",
    "scan": "Write one scan of a mesh by a LiDAR or depth camera, alone or in a scene.",
    "drive": "Write a sequence of sweeps of a rig that drives through a scene (SemanticKITTI, nuScenes).",
    "views": "List the cameras of a view set about a mesh, and how much of it they see.",
    "shapes": "List the built-in shapes, or write one of them as a mesh file.",
    "sensors": "List the sensors (LiDARs, depth cameras), their parameters and sources.",
    "depth": "Write the depth buffer of one mesh as an image or array.",
    "compare": "Compare methods with the exact reference and each other: errors, times, report.",
    "compare-scans": "Compare real scans of a mesh with a sensor model's scans: report, pictures.",
    "compare-drives": "Compare the returns in the labelled boxes of a real drive with simulated ones.",
    "report": "Write the report of a comparison again from its rows.",
    "status": "Show the progress of a dataset.",
    "verify": "Check a finished dataset: checksums, counts, and some clouds against the oracle.",
    "merge": "Finish a dataset whose shards were made by several machines.",
    "convert": "Write a dataset in another format.",
    "show": "Draw a dataset: an interactive gallery, a contact sheet.",
    "view": "Look in the browser: what a camera that you drag sees of a mesh, or the clouds of a dataset.",
    "crop": "Crop labelled objects of real LiDAR sweeps to a dataset of single-object clouds.",
    "train": "Train a classifier (VoxNet, PointNet, 3DmFV) on a dataset.",
    "evaluate": "Test a trained classifier: accuracy, confusion matrix, scores by class, range and points.",
    "paper": "Repeat the paper's tables, figures and experiments with classifiers.",
    "methods": "List the methods of hidden-surface removal and their requirements.",
    "doctor": "Check this machine: OpenGL, methods, and how to fix what does not work.",
}
"""Summary of each command by its name; the function `NAME_command` of its module is the command."""

_MODULES = {
    "comparison": ("compare", "report"),
    "classifiers": ("train", "evaluate"),
    "datasets": ("status", "verify", "merge", "convert", "show"),
    "lists": ("methods", "sensors", "doctor"),
}
"""Modules of several commands. Any other command has a module of its own name, with underscores for dashes."""
OF_PAPER = ("experiment", "figure")
"""Old names of commands of `paper`."""


_WITH_WORKERS = {"generate"}
"""Commands whose workers are forked from a server, which imports while the command does."""
_WITHOUT_WORKERS = {"-h", "--help", "--dry-run", "--engine=ray", "ray"}
"""Arguments with which a command has no such workers: the server then does not start early."""


class LazyGroup(CommandGroup):
    """Group of all commands."""

    table = COMMANDS

    def get_command(self, context: click.Context, name: str) -> click.Command | None:
        """Return a command; its module is imported."""
        if name not in COMMANDS and name not in OF_PAPER:
            return None
        plain = name.replace("-", "_")
        home = next((module for module, names in _MODULES.items() if name in names), plain)
        command: click.Command = getattr(import_module(f"zbuf_occlude.cli.{home}"), f"{plain}_command")
        return command

    def resolve_command(
        self, context: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find the command that was called."""
        if args[0] in _WITH_WORKERS and not context.resilient_parsing and _WITHOUT_WORKERS.isdisjoint(args):
            from zbuf_occlude.datasets.workers.local import start_server  # late: other commands need no server

            start_server()
        return super().resolve_command(context, args)

    def invoke(self, context: click.Context) -> Any:
        """Run a command after the checks of the environment."""
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
    """Make occluded point clouds of complete triangle meshes.

    Start with `zbuf-occlude generate`: without arguments it writes a dataset of the built-in shapes to ./occluded.
    Angles are in degrees, distances in multiples of the object's longest side.
    """
