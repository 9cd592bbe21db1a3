"""`zbuf-occlude scan`: one scan of a mesh by a LiDAR or a depth camera, alone or in a scene."""

from functools import partial
from pathlib import Path
from typing import Any

import click
import numpy as np
from click.core import ParameterSource

from zbuf_occlude.arrays import FloatArray
from zbuf_occlude.cli.echo import echo
from zbuf_occlude.cli.options import MeshPlace, check_place, finite, suffix_of, up_option
from zbuf_occlude.cli.panels import Command, Name
from zbuf_occlude.cli.scan_options import parse_setup, scan_options
from zbuf_occlude.dataset import atomic
from zbuf_occlude.dataset.point_files import write_table
from zbuf_occlude.errors import MeshError, OptionError
from zbuf_occlude.limits import Limits
from zbuf_occlude.meshes.collection import MeshCollection
from zbuf_occlude.provenance import seed_of
from zbuf_occlude.scenes.contents import Pool
from zbuf_occlude.sensors import Scan
from zbuf_occlude.sensors.capture import captures, in_metres, sensor_places
from zbuf_occlude.sensors.scanning import default_caster
from zbuf_occlude.sensors.setup import Setup
from zbuf_occlude.views import Views
from zbuf_occlude.visibility import METHODS

CASTING = [method.name for method in METHODS if not method.no_first_hits]
COLUMNS = (
    ("range", "ranges", "<f8"), ("incidence", "incidences", "<f4"), ("intensity", "intensities", "<f4"),
    ("ring", "rings", "<i4"), ("column", "columns", "<i4"), ("instance", "instances", "<i4"),
    ("n_returns", "n_returns", "<i4"),
)  # fmt: skip
"""Of a point besides x, y, z, nx, ny, nz: its name in files, in a `Scan`, and its type."""


@click.command(cls=Command)
@click.argument("meshes", nargs=-1, required=True, type=MeshPlace())
@scan_options("vlp-32c")
@click.option(
    "--azimuth",
    type=float,
    default=0.0,
    show_default=True,
    callback=finite,
    help="Of the sensor: degrees from +x towards +y.",
)
@click.option(
    "--elevation",
    type=click.FloatRange(-90, 90),
    default=0.0,
    show_default=True,
    callback=finite,
    help="Where no ground is.",
)
@click.option("--method", type=Name(CASTING), help="Who casts the rays. [default: the first that can here]")
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True)
@click.option("--picture", type=click.Path(path_type=Path), help="Range image and cloud, as a PNG.")
@up_option
@click.option("--out", type=click.Path(path_type=Path), required=True, help="scan.ply, .npy or .csv")
def command(
    meshes: tuple[Path, ...],
    azimuth: float,
    elevation: float,
    method: str | None,
    seed: int,
    picture: Path | None,
    up: str | None,
    out: Path,
    **given: Any,
) -> None:
    """Scan the first of MESHES; the others, or else the built-in shapes, are what scenes are filled with.

    Points are metres, the middle of the object's box at the origin, z up. With a ground the sensor stands at its height
    above it, --range away along the ground; without one it looks at the object from --azimuth and --elevation. Each
    point has range, incidence (radians), intensity, ring, column, instance (0: the object), n_returns and normal.

    \b
    Examples:
      zbuf-occlude scan car.off --sensor vlp-32c --range 15 --azimuth 30 --out scan.ply
      zbuf-occlude scan car.off --sensor hdl-64e --range 20 --scene street --keep all --out street.ply --picture a.png
      zbuf-occlude scan chair.off --sensor kinect-v1 --range 2 --scene room --set-sensor noise=0 --out chair.csv
    """
    suffix = suffix_of(out, (".ply", ".npy", ".csv"))
    if picture is not None:
        if picture.suffix.lower() != ".png":
            raise OptionError(f"--picture must end in .png; got {picture.name!r}.")
        check_place(picture, "--picture")
    setup = parse_setup(method or default_caster(), given)
    if setup is None:
        raise OptionError("scan needs a sensor; `zbuf-occlude visible` samples the surface.")
    typed = click.get_current_context().get_parameter_source("elevation") is ParameterSource.COMMANDLINE
    if typed and setup.height is not None:
        raise click.UsageError("--elevation must go without a ground, on which --sensor-height says how high.")
    capture = scan_once(MeshCollection.from_paths(meshes, up=up), setup, azimuth, elevation, seed)
    found = capture.scan
    table = table_of(found, setup.keep_clean)
    if suffix == ".ply":
        write_table(out, table)
    elif suffix == ".npy":
        atomic.write(out, lambda file: np.save(file, table))
    else:
        names = table.dtype.names or ()
        rows = np.stack([table[name].astype(np.float64) for name in names], axis=1)
        header = ",".join(names)
        atomic.write(out, lambda file: np.savetxt(file, rows, delimiter=",", header=header, comments="", fmt="%.9g"))
    hidden = ""
    if setup.share is not None or setup.objects:
        hidden = f", {capture.hidden:.0%} of the object hidden by others"
        if not capture.reached:
            hidden += " (what was asked for could not be reached)"
    echo(f"{len(found)} returns by {setup.made_sensor.name}, rays by {setup.method}{hidden}: {out}")
    if picture is not None:
        from zbuf_occlude.cli.scan_pictures import draw_scan

        draw_scan(picture, found, setup.made_sensor)


def scan_once(collection: MeshCollection, setup: Setup, azimuth: float, elevation: float, seed: int) -> Any:
    """Return the capture of a collection's first mesh; the rest of it, or the built-in shapes, fill the scene.

    Raises
    ------
    OptionError
        A class without a size, or a range within the object.
    """
    first = collection[0]
    with Limits().watch():
        loaded = first.load()
    if len(collection) > 1:
        others = collection[1:]
    else:
        from zbuf_occlude import shapes  # late: only needed without files

        others = shapes.collection()
    mesh, size = in_metres(loaded, first.label, setup)
    seeds = partial(_seed, seed, first.key)
    views = Views(np.radians([azimuth]), np.radians([elevation]), np.array([4.0]))
    floor = float(mesh.bounds[0, 2])
    try:
        places = sensor_places(views, size, floor, setup, seeds)
    except MeshError as error:  # it is the range that was typed
        raise OptionError(str(error)) from None
    pool = Pool(others, setup.size, setup.scene, seed_of(seed, "pool"))
    return next(captures(mesh, setup, places, floor, seeds, pool))


def table_of(found: Scan, keep_clean: bool) -> Any:
    """Return a scan as a structured array, one row per point."""
    axes = [(name, "<f8") for name in "xyz"] + [(name, "<f4") for name in ("nx", "ny", "nz")]
    columns = [*COLUMNS, ("clean_range", "clean_ranges", "<f8")] if keep_clean else COLUMNS
    table = np.empty(len(found), dtype=[*axes, *((name, kind) for name, _, kind in columns)])
    positions: FloatArray = found.positions
    for axis, name in enumerate("xyz"):
        table[name], table["n" + name] = positions[:, axis], found.normals[:, axis]
    for name, attribute, _ in columns:
        table[name] = getattr(found, attribute)
    return table


def _seed(seed: int, key: str, what: str, view: int) -> np.random.SeedSequence:
    return seed_of(seed, f"{key}/{what}", 0, view)
