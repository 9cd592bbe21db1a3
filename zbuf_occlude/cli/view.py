"""Command `view`: what a camera that one drags sees of a mesh, or the clouds of a dataset, in the browser."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np

from zbuf_occlude.base.errors import MeshError
from zbuf_occlude.base.extras import importing
from zbuf_occlude.base.limits import Limits
from zbuf_occlude.base.point_files import columns_of, write_csv, write_pcd, write_table
from zbuf_occlude.cli.file_frames import print_frame
from zbuf_occlude.cli.scan_options import parse_sensor, sensor_options
from zbuf_occlude.cli.shared_options import MeshPlace, Settings, explicitly_set, finite, frame_options, suffix_of
from zbuf_occlude.cli.shell import Command, counted, echo
from zbuf_occlude.cli.visible import warn_of_far_faces
from zbuf_occlude.datasets.gallery import hidden_part, upright
from zbuf_occlude.datasets.source import CloudReader, open_dataset
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.meshes.load import load_mesh
from zbuf_occlude.sensors import SENSORS

if TYPE_CHECKING:
    from zbuf_occlude.drawing.viewer import StoredCloud, Viewer

SAVED = (".ply", ".pcd", ".csv")
"""Suffixes of the files of saved clouds."""
OF_MESHES = ("sensor", "set_sensor", "camera", "size", "points", "up", "unit")
"""Options that datasets do not have."""


@click.command(cls=Command)
@click.argument("place", metavar="MESH|DATASET", type=MeshPlace(exists=True))
@sensor_options(None)
@click.option(
    "--size",
    type=click.FloatRange(0, min_open=True),
    callback=finite,
    help="Longest side of the mesh, metres.  [default: as in the file]",
)
@click.option("--points", type=click.IntRange(1), default=20_000, help="Number of points sampled at first.")
@frame_options
@click.option("--host", default="127.0.0.1", help="Address that serves the page; 0.0.0.0: to other machines too.")
@click.option("--port", type=click.IntRange(0, 65535), default=8080, help="Port; if in use, the next free one.")
@click.option("--open", "opens", is_flag=True, help="Open the page in the browser of this machine.")
@click.option(
    "--out", type=click.Path(path_type=Path), help="Name of saved clouds: .ply, .pcd or .csv.  [default: NAME.ply]"
)
@click.pass_context
def view_command(
    context: click.Context,
    /,
    place: Path,
    host: str,
    port: int,
    opens: bool,
    out: Path | None,
    **options: Any,
) -> None:
    """Show in the browser what a camera sees of MESH while you drag it, or the clouds of DATASET one by one.

    Visible points are blue, hidden ones grey. Drag the camera by its arrows, move it by its sliders, or let it follow
    your own viewpoint. Visibility is exact and answered at every move. Without a sensor the camera sees in all
    directions; with one the blue points are a scan, and lengths are metres (--size or --unit).

    The button "Save cloud" writes NAME-1.ply, NAME-2.ply, ... into the current folder, or as --out names them. DATASET
    is a folder of `generate` or of `crop`. Ctrl-C ends the viewer.

    \b
    Examples:
      zbuf-occlude view chair.off
      zbuf-occlude view part.stl --unit mm --sensor realsense-d435
      zbuf-occlude view car.obj --size 4.3 --sensor vlp-32c --open
      zbuf-occlude view modelnet40-occluded
      zbuf-occlude view chair.off --host 0.0.0.0 --port 8000      # on a server; open http://SERVER:8000
    """
    out = Path(f"{place.absolute().stem}.ply") if out is None else out
    suffix_of(out, SAVED)
    with importing("viser", "the viewer"):
        import zbuf_occlude.drawing.viewer  # noqa: F401  # late: viser takes a second
    served = {"title": place.absolute().name, "out": out, "host": host, "port": port}
    if place.is_dir():
        if idle := explicitly_set(context, OF_MESHES):
            raise click.UsageError(f"{idle[0]} is for a mesh; {place} is a folder. Leave it out.")
        page = view_dataset(place, served)
    else:
        page = view_mesh(place, served, **options)
    echo(f"{page.url}  (Ctrl-C ends)")
    if opens:
        click.launch(page.url)
    try:
        page.run()
    except KeyboardInterrupt:
        echo("viewer ended")
    finally:
        page.close()


def view_mesh(
    path: Path,
    served: dict[str, Any],
    *,
    sensor: str | None,
    set_sensor: Settings,
    camera: str | None,
    size: float | None,
    points: int,
    up: str | None,
    unit: str | None,
) -> "Viewer":
    """Return the viewer of a mesh file."""
    from zbuf_occlude.drawing.viewer import NO_SENSOR, MeshViewer

    if size is not None and unit is not None:
        raise click.UsageError("--size is in metres for files of any unit; leave out --unit.")
    if (set_sensor or camera) and sensor is None:
        raise click.UsageError(f"{'--set-sensor' if set_sensor else '--camera'} must go with --sensor.")
    sensors, chosen = dict(SENSORS), NO_SENSOR
    if sensor is not None:
        model = parse_sensor(sensor, set_sensor, camera)
        chosen = model.name
        sensors[chosen] = model
    with Limits().watch():
        mesh = load_mesh(path, up=up, unit=unit)
    if not mesh.longest_side > 0.0:
        raise MeshError(f"{mesh.name} has no extent: all its vertices coincide.")
    if size is not None:
        mesh = mesh.transformed(size / mesh.longest_side)
    warn_of_far_faces(mesh)
    page = MeshViewer(mesh, sensors, sensor=chosen, n_points=points, **served)
    _print_mesh(path, mesh, size, up, unit)
    return page


def _print_mesh(path: Path, mesh: Mesh, size: float | None, up: str | None, unit: str | None) -> None:
    """Print the number of faces and the frame."""
    echo(counted(len(mesh.faces), "face"))
    print_frame(path, mesh, up, "m" if size is not None else unit)


def view_dataset(folder: Path, served: dict[str, Any]) -> "Viewer":
    """Return the viewer of the clouds of a dataset."""
    from zbuf_occlude.drawing.viewer import CloudsViewer

    source = open_dataset(folder, to_show=True)
    numbers = list(dict.fromkeys(np.concatenate(list(source.order.values())).tolist()))
    echo(f"{counted(len(numbers), 'cloud')}, {counted(len(source.plan.classes), 'class', 'classes')}: {folder}")
    return CloudsViewer(len(numbers), lambda place: stored_cloud(source, numbers[place]), **served)


def stored_cloud(source: CloudReader, number: int) -> "StoredCloud":
    """Return a cloud of a dataset by its number."""
    from zbuf_occlude.drawing.viewer import StoredCloud

    record, plan = source.take(np.array([number]))[0], source.plan
    is_real = source.sweeps is not None
    hidden = np.empty((0, 3)) if is_real else hidden_part(record, source)
    positions, eye, _, hidden = upright(record, plan.config, hidden)
    azimuth, elevation, distance = record["view"]
    facts = {
        "object": plan.meshes[int(record["mesh_id"])].key,
        "split": ", ".join(split for split, numbers in source.order.items() if number in numbers),
        "azimuth, elevation": f"{np.degrees(azimuth):.1f}°, {np.degrees(elevation):.1f}°",
        "range" if source.has_ranges else "distance": f"{distance:.3g}" + " m" * source.has_ranges,
        "points": f"{len(positions):,}",
    }
    save: Callable[[Path], None] = partial(write_record, record)
    return StoredCloud(save, plan.classes[int(record["label"][0])], facts, positions, hidden, None if is_real else eye)


def write_record(record: Any, path: Path) -> None:
    """Write the points of a record as they are stored, in the format of the file's suffix."""
    if path.suffix.lower() == ".pcd":
        write_pcd(path, record)
        return
    names = record.dtype.names or ()
    normals, colors = (record[name] if name in names else None for name in ("normal", "color"))
    table = columns_of(record["data"], normals, colors)
    (write_csv if path.suffix.lower() == ".csv" else write_table)(path, table)
