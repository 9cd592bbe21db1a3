"""Commands `paper figN` (old name `figure`): a figure of the paper, of any mesh, as PNG."""

from pathlib import Path
from typing import Any

import click

from zbuf_occlude.base import atomic
from zbuf_occlude.base.limits import Limits
from zbuf_occlude.cli.paper import derived, refuse_unused, replaced
from zbuf_occlude.cli.shared_options import MeshPlace, Settings, method_options, parse_settings, suffix_of, up_option
from zbuf_occlude.cli.shell import Command, Name, echo
from zbuf_occlude.meshes import shapes
from zbuf_occlude.meshes.load import load_mesh
from zbuf_occlude.studies.paper.figures import FIGURES, Exhibit, make_mask
from zbuf_occlude.studies.paper.real_scans import find_frame, largest_scan, read_scan
from zbuf_occlude.views import PAPER_DISTANCE

DPI = 150
WITH_SCAN = "fig7"


@click.command(cls=Command)
@click.argument("name", type=Name(list(FIGURES)))
@click.argument("mesh_file", type=MeshPlace(), required=False, metavar="[MESH]")
@click.option("--out", type=click.Path(path_type=Path), required=True, help="Output file, PNG.")
@method_options("exact")
@click.option(
    "--sydney",
    type=click.Path(path_type=Path),
    metavar="ROOT",
    help=f"Sydney Urban Objects, unpacked; {WITH_SCAN} then shows its largest car.",
)
@click.option(
    "--distance",
    type=click.FloatRange(0, min_open=True),
    default=PAPER_DISTANCE,
    help="Distance of the cameras from the centre, in longest sides.",
)
@click.option("--seed", type=click.IntRange(0), default=0, help="Seed of all random draws.")
@up_option
def figure_command(name: str, **options: Any) -> None:
    """Draw a figure of the paper, of MESH or a built-in shape; replaced by `zbuf-occlude paper NAME`."""
    replaced(f"figure {name}", f"paper {name}")
    refuse_unused(name, unused(name))
    draw_figure(name, **options)


def figure_named(name: str) -> click.Command:
    """Return the command that draws a figure."""
    options = {str(parameter.name) for parameter in figure_command.params} - {"name"} - unused(name)
    figure = FIGURES[name]
    text = f"Draw the paper's Fig. {name[3:]}: {figure.summary}."
    return derived(
        figure_command,
        name,
        options,
        draw_figure,
        text + (" The object is MESH or a built-in shape." if figure.kind else ""),
    )


def unused(name: str) -> set[str]:
    """Return the options that a figure does not use."""
    figure = FIGURES[name]
    found = set() if figure.masked else {"method", "settings", "distance"}
    found |= set() if name == WITH_SCAN else {"sydney"}
    return found | (set() if figure.kind else {"mesh_file", "up"})


def draw_figure(
    name: str,
    out: Path,
    seed: int,
    mesh_file: Path | None = None,
    up: str | None = None,
    method: str = "exact",
    settings: Settings = (),
    distance: float = PAPER_DISTANCE,
    sydney: Path | None = None,
) -> None:
    """Draw a figure and write it."""
    suffix_of(out, (".png",))
    if mesh_file is None:
        refuse_unused("a built-in shape", ["up"])
    mask = make_mask(method, parse_settings(method, settings))
    kind = FIGURES[name].kind
    if mesh_file is not None:
        with Limits().watch():
            mesh = load_mesh(mesh_file, up=up)
    else:
        mesh = shapes.make(kind, 0) if kind else shapes.formulas.make("torus")
    scan = None if sydney is None else read_scan(largest_scan(sydney, "car").path, find_frame(sydney).up)
    figure = FIGURES[name].draw(Exhibit(mesh.normalized(), mask, seed, scan, distance))
    atomic.write(out, lambda file: figure.savefig(file, format="png", dpi=DPI))
    echo(f"{name}{f' of {mesh.name}' if kind else ''}: {out}")
