"""`zbuf-occlude figure`: one of the paper's figures, of any mesh, as a PNG."""

from pathlib import Path

import click

from zbuf_occlude.cli.options import method_options, parse_settings, suffix_of, up_option
from zbuf_occlude.compare.figures import FIGURES, make_mask
from zbuf_occlude.meshes.files import load_mesh

DPI = 150


@click.command()
@click.argument("name", type=click.Choice(list(FIGURES)))
@click.argument("mesh_file", type=click.Path(path_type=Path), required=False, metavar="[MESH]")
@click.option("--out", type=click.Path(path_type=Path), required=True, help="The PNG.")
@method_options("exact")
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True)
@up_option
def command(
    name: str, mesh_file: Path | None, out: Path, method: str, settings: tuple[str, ...], seed: int, up: str | None
) -> None:
    """Draw a figure of the paper, of MESH or of a built-in shape.

    \b
    fig4    division of large faces into smaller ones
    fig7    mesh, full sampling, occupancy grid, and an occluded cloud from three sides
    fig8    object with camera, result of HSR by vertices, cloud
    fig10   clouds at four azimuths, from a fixed viewpoint and from the camera's
    fig11   the same at four elevations
    fig12   projected area of the visible part on the coordinate planes against elevation

    --method says how hidden surfaces are removed; fig4 and fig8 show HSR by vertices and do not use it.
    """
    suffix_of(out, (".png",))
    mask = make_mask(method, parse_settings(method, settings))
    chosen = FIGURES[name]
    if mesh_file is None:
        from zbuf_occlude.meshes import shapes  # late: only needed without a file

        mesh = next(entry for entry in shapes.collection() if entry.label == chosen.kind).load()
    else:
        mesh = load_mesh(mesh_file, up=up)
    chosen.draw(mesh.normalized(), mask, seed).savefig(out, dpi=DPI)
    click.echo(f"{name} of {mesh.name}: {out}")
