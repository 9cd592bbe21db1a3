"""Command `shapes`: list the built-in shapes, or write one of them as a mesh file."""

from pathlib import Path

import click
import numpy as np

from zbuf_occlude.base import atomic
from zbuf_occlude.cli.shared_options import suffix_of
from zbuf_occlude.cli.shell import Command, Name, echo
from zbuf_occlude.geometry.mesh import UP, Mesh
from zbuf_occlude.meshes.load import default_up
from zbuf_occlude.meshes.shapes.built_in import BUILT_IN, find_shape
from zbuf_occlude.sensors.scenes.sizes import SIZES

ENDINGS = (".off", ".obj", ".ply", ".stl", ".glb")
TEXT_FORMATS = (".off", ".obj")
"""Text formats, whose number of digits can be set."""


@click.command(cls=Command)
@click.argument("name", required=False)
@click.option("--number", type=click.IntRange(0), default=0, metavar="N", help="Index of the member of its class.")
@click.option("--seed", type=click.IntRange(0), default=0, help="Seed of the members; 0: the built-in ones.")
@click.option("--up", type=Name(UP), default=None, help="Up axis of the file.  [default: y for glTF, else z]")
@click.option("--out", type=click.Path(path_type=Path), help=f"Output file: shape{', '.join(ENDINGS)}")
def shapes_command(name: str | None, number: int, seed: int, up: str | None, out: Path | None) -> None:
    """List the built-in shapes, or write the shape NAME as a mesh, in metres.

    NAME is a class, or collection/class where two collections have it: car, road-users/car.

    \b
    Examples:
      zbuf-occlude shapes
      zbuf-occlude shapes chair --out chair.off
      zbuf-occlude shapes road-users/truck --number 3 --up y --out truck.obj
      zbuf-occlude generate --shapes road-users --sensor hdl-64e --range 5..40 --out roads
    """
    if name is None:
        for row in BUILT_IN:
            each = f", {row.n_members} each" if row.n_members > 1 else ""
            echo(f"{row.name}: {row.summary}{each} (generate --shapes {row.name})\n  {', '.join(row.classes)}")
        echo("write one, in metres: zbuf-occlude shapes chair --out chair.off; of two alike: shapes road-users/car")
        return
    suffix = "" if out is None else suffix_of(out, ENDINGS)
    row, label = find_shape(name)
    mesh = row.make(label, number, seed)
    if not row.in_metres and label in SIZES:
        mesh = mesh.transformed(SIZES[label] / mesh.longest_side)
    sides = " x ".join(f"{side:.3g}" for side in np.ptp(mesh.bounds, axis=0))
    unit = " m" if row.in_metres or label in SIZES else ""
    said = f"{row.name}/{label}, number {number}: {len(mesh.faces)} faces, {sides}{unit}"
    if out is None:
        echo(f"{said} (x, y, z); --out FILE writes it")
        return
    axis = up or default_up(out)
    write_mesh(out, mesh, suffix, axis)
    echo(f"{said}, {axis} up in {out}")


def write_mesh(out: Path, mesh: Mesh, suffix: str, up: str) -> None:
    """Write a mesh in the format of a suffix, with z or y up in the file."""
    turned = mesh if up == "z" else mesh.rotated([[1, 0, 0], [0, 0, 1], [0, -1, 0]])
    digits = {"digits": 17} if suffix in TEXT_FORMATS else {}
    content = turned.to_trimesh().export(file_type=suffix[1:], **digits)
    atomic.write(out, lambda file: file.write(content.encode() if isinstance(content, str) else content))
