"""`zbuf-occlude figure`: one of the paper's figures, of any mesh, as a PNG."""

from pathlib import Path

import click

from zbuf_occlude import shapes
from zbuf_occlude.cli.echo import echo
from zbuf_occlude.cli.options import given, method_options, parse_settings, suffix_of, up_option
from zbuf_occlude.limits import Limits
from zbuf_occlude.meshes.files import load_mesh
from zbuf_occlude.paper.figures import FIGURES, Exhibit, make_mask
from zbuf_occlude.paper.sydney import largest_scan, read_scan
from zbuf_occlude.paper.sydney_frame import find_frame
from zbuf_occlude.views import PAPER_DISTANCE

DPI = 150
WITH_SCAN = "fig7"


@click.command()
@click.argument("name", type=click.Choice(list(FIGURES)))
@click.argument("mesh_file", type=click.Path(path_type=Path), required=False, metavar="[MESH]")
@click.option("--out", type=click.Path(path_type=Path), required=True, help="The PNG.")
@method_options("exact")
@click.option(
    "--sydney",
    type=click.Path(path_type=Path),
    metavar="ROOT",
    help=f"The unpacked Sydney Urban Objects dataset: {WITH_SCAN} then shows its car of the most points, from three "
    "sides.",
)
@click.option(
    "--distance",
    type=click.FloatRange(0, min_open=True),
    default=PAPER_DISTANCE,
    show_default=True,
    help="Of the cameras from the object's centre, in multiples of its longest side.",
)
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True)
@up_option
@click.pass_context
def command(
    context: click.Context,
    /,
    name: str,
    mesh_file: Path | None,
    out: Path,
    method: str,
    settings: tuple[str, ...],
    sydney: Path | None,
    distance: float,
    seed: int,
    up: str | None,
) -> None:
    """Draw a figure of the paper, of MESH or of a built-in shape.

    \b
    fig4    division of large faces into smaller ones
    fig7    mesh, full sampling, occupancy grid, and an occluded cloud from three sides; with --sydney a real scan too
    fig8    object with camera, result of HSR by vertices, cloud
    fig9    objects made by mathematical formulas: those of `generate --shapes formulas`
    fig10   clouds at four azimuths, from a fixed viewpoint and from the camera's
    fig11   the same at four elevations
    fig12   projected area of the visible part on the coordinate planes against elevation

    --method says how hidden surfaces are removed in fig7 and fig10 to fig12.
    """
    suffix_of(out, (".png",))
    chosen = FIGURES[name]
    refuse_idle(context, name, mesh_file, up)
    mask = make_mask(method, parse_settings(method, settings))
    if mesh_file is not None:
        with Limits().watch():
            mesh = load_mesh(mesh_file, up=up)
    elif chosen.kind:
        mesh = shapes.make(chosen.kind, 0)
    else:
        mesh = shapes.formulas.make("torus")
    scan = None if sydney is None else read_scan(largest_scan(sydney, "car").path, find_frame(sydney).up)
    chosen.draw(Exhibit(mesh.normalized(), mask, seed, scan, distance)).savefig(out, dpi=DPI)
    echo(f"{name}{f' of {mesh.name}' if chosen.kind else ''}: {out}")


def refuse_idle(context: click.Context, name: str, mesh_file: Path | None, up: str | None) -> None:
    """Refuse what a figure would not look at.

    Raises
    ------
    click.UsageError
    """
    chosen = FIGURES[name]
    idle = [] if chosen.masked else given(context, ("method", "settings", "distance"))
    idle += [] if name == WITH_SCAN else given(context, ("sydney",))
    if mesh_file is not None and not chosen.kind:
        idle.append("MESH")
    if up is not None and mesh_file is None:
        idle.append("--up")
    if idle:
        raise click.UsageError(f"{name} ({chosen.summary}) does not use {', '.join(idle)}. Leave it out.")
