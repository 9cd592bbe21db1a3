"""Hooks of mkdocs: reference pages of the command line and the API, and the gallery of docs/shapes.md."""

import shutil
import subprocess
import sys
import tempfile
from importlib import import_module
from pathlib import Path
from typing import Any

import click
from mkdocs.structure.files import File

GENERATE = ("generate", "--limit", "24", "--views", "ring:3@25", "--method", "exact", "--format", "packed")
FOLDER = "gallery-3d"
API = {
    "partial": ("Partial clouds", "", ("occlude", "PartialCloud")),
    "depth": ("Depth images", "", ("depth_image",)),
    "frames": ("Frames", "", ("frames", "Frame", "write_frames")),
    "bop": ("BOP", "", ("write_bop",)),
    "surface": ("Visible surfaces", "", ("visible_vertices", "visible_mesh")),
    "inspection": ("Inspection", "", ("visible_faces", "coverage")),
    "space": ("Visible space", "", ("visibility_grid", "blockers", "occlusion_graph")),
    "mesh": ("Mesh", "", ("Mesh",)),
    "meshes": ("Mesh files", "", ("load_mesh", "MeshCollection")),
    "points": ("Points", "", ("sample_surface", "SurfacePoints")),
    "views": ("Views", "", ("Views", "views.for_mesh", "views.parse")),
    "positions": (
        "Camera positions",
        "views.",
        ("paper100", "modelnet8", "ring", "grid", "fibonacci"),
    ),
    "random_positions": ("Random camera positions", "views.", ("random", "random_so3", "drive")),
    "visibility": ("Visibility", "", ("prepare", "visibility.interface.VisibilityQuery")),
    "methods": ("Methods", "", ("visibility.interface.Method",)),
    "scans": ("Scans", "", ("scan", "sensors.Scan")),
    "sensors": ("Sensors", "sensors.", ("make", "Sensor", "NoiseModel")),
    "drives": (
        "Drives and rigs",
        "sensors.",
        ("scan_drive", "DriveSweep", "read_rig", "Rig", "Mounted", "mount_pose"),
    ),
    "motion": ("Places and motion of sensors", "sensors.", ("look_at", "Motion", "read_trajectory")),
    "real_scans": ("Real scans", "", ("compare_scans", "studies.compare.scan_comparison.ScanComparison")),
    "crops": ("Crops", "", ("crop_objects", "datasets.real.crops.Crops")),
    "classifiers": ("Classifiers", "", ("load_classifier", "studies.learn.training.Trained")),
    "scenes": ("Scenes", "sensors.scenes.", ("Placed", "moved", "Scene")),
    "torch": (
        "PyTorch",
        "datasets.torch.",
        ("CloudDataset", "CloudStream", "CompletionPairs", "collate_ragged", "augmentation"),
    ),
    "on_the_fly": ("PyTorch, on the fly", "datasets.torch.", ("OnTheFlyOcclusion", "OnTheFlyScan", "OnTheFlyPairs")),
    "tensors": ("PyTorch, visibility of tensors", "datasets.torch.", ("visible", "first_hits")),
    "errors": (
        "Errors",
        "",
        ("OccludeError", "ArgumentError", "OptionError", "MeshError", "DatasetError", "GlError", "UnavailableError"),
    ),
}
"""Title of each page, prefix of its names below the package, and the names."""
MEMBERS = {
    "Mesh": ("normalized", "cleaned", "from_trimesh", "transformed", "to_open3d", "to_trimesh"),
    "MeshCollection": ("from_paths",),
    "SurfacePoints": ("free", "select"),
    "VisibilityQuery": ("visible", "first_hits", "close"),
    "Method": ("missing", "options", "check_options"),
    "Frame": ("mask", "points", "extrinsics", "camera_to_world", "to_open3d"),
    "PartialCloud": ("save", "to_open3d", "to_trimesh"),
    "Scan": ("select", "save", "to_open3d", "to_trimesh"),
    "ScanComparison": ("share",),
    "Sensor": ("rays", "with_numbers"),
    "Views": ("around", "eyes", "poses"),
    "Scene": ("joined",),
    "Crops": ("counts", "save"),
    "Trained": ("predict", "probabilities"),
}
"""Members of a class that its page documents."""


def on_files(files: Any, config: Any) -> Any:
    """Add the pages of the reference."""
    files.append(File.generated(config, "cli.md", content=command_line()))
    for page, (title, home, names) in API.items():
        blocks = [block(home + name) for name in names]
        files.append(File.generated(config, f"api/{page}.md", content="\n".join([f"# {title}\n", *blocks])))
    return files


def block(name: str) -> str:
    """Return the directive that mkdocstrings replaces by the documentation of a name."""
    members = list(MEMBERS.get(name.rpartition(".")[2], ()))
    return f"::: zbuf_occlude.{name}\n    options:\n      members: {members}\n"


def command_line() -> str:
    """Return the page of the command line with the help of each command."""
    group = import_module("zbuf_occlude.cli").group
    top = click.Context(group, info_name="zbuf-occlude", terminal_width=100, show_default=True)
    lines = [
        "# Command line\n",
        "The output of `zbuf-occlude COMMAND --help`.\n",
    ]
    for name in group.list_commands(top):
        command = group.get_command(top, name)
        lines += [f"### {name}\n", *folded(command, top, name)]
    return "\n".join(lines)


def folded(command: click.Command, above: click.Context, name: str) -> list[str]:
    """Return the folded help of a command and its subcommands."""
    here = click.Context(command, info_name=name, parent=above, terminal_width=100)
    summary = f"<code>{here.command_path} --help</code>: {command.get_short_help_str(200)}"
    lines = [f'<details markdown="1"><summary>{summary}</summary>\n']
    lines += ["```text", command.get_help(here), "```\n"]
    if isinstance(command, click.Group):
        for below in command.list_commands(here):
            lines += folded(command.get_command(here, below), here, below)
    return [*lines, "</details>\n"]


def on_post_build(config: Any) -> None:
    """Write gallery-3d/gallery.html into the site."""
    target = Path(config["site_dir"]) / FOLDER
    target.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / FOLDER  # the folder's name is the title of the page
        command = [sys.executable, "-m", "zbuf_occlude"]
        subprocess.run([*command, *GENERATE, "--out", str(folder)], check=True, capture_output=True)
        subprocess.run([*command, "show", str(folder)], check=True, capture_output=True)
        shutil.copy(folder / "gallery.html", target)
