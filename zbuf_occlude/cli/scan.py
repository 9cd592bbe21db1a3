"""Command `scan`: one scan of a mesh by a LiDAR or a depth camera, alone or in a scene, and a plot of it."""

import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import click
import numpy as np

from zbuf_occlude.base import atomic
from zbuf_occlude.base.arrays import BoolArray, FloatArray
from zbuf_occlude.base.errors import MeshError, OptionError
from zbuf_occlude.base.limits import Limits
from zbuf_occlude.base.provenance import seed_of
from zbuf_occlude.cli.file_frames import lengths_of, taken_as, warn_of_lying
from zbuf_occlude.cli.messages import cut_off
from zbuf_occlude.cli.scan_options import CASTING, check_sizes, parse_scan, scan_options, size_of_files
from zbuf_occlude.cli.shared_options import (
    MeshPlace,
    angle_options,
    check_place,
    explicitly_set,
    frame_options,
    suffix_of,
)
from zbuf_occlude.cli.shell import Command, Name, echo
from zbuf_occlude.datasets.counts import QualityCounts
from zbuf_occlude.geometry.cloud import SUFFIXES
from zbuf_occlude.meshes.collection import MeshCollection
from zbuf_occlude.sensors import Scan, Sensor
from zbuf_occlude.sensors.capture import Capture, captures, in_metres, n_raised, sensor_views
from zbuf_occlude.sensors.emptiness import why_empty
from zbuf_occlude.sensors.scan_config import SURFACE, ScanConfig
from zbuf_occlude.sensors.scanning import no_transparent_material, question_of
from zbuf_occlude.sensors.scenes.contents import Pool
from zbuf_occlude.views import from_angles
from zbuf_occlude.visibility import precompile


@click.command(cls=Command)
@click.argument("meshes", nargs=-1, required=True, type=MeshPlace())
@scan_options("vlp-32c")
@angle_options("Degrees above the xy plane; for scenes without a ground.")
@click.option("--method", type=Name(CASTING), default="exact", show_default=True, help="Method that casts the rays.")
@click.option("--seed", type=click.IntRange(0), default=0, help="Seed of all random draws.")
@click.option("--picture", type=click.Path(path_type=Path), help="Plot of range image and cloud, as PNG.")
@frame_options
@click.option(
    "--out", type=click.Path(path_type=Path), required=True, help="Output file: scan.ply, .npz, .pcd, .npy or .csv"
)
def scan_command(
    meshes: tuple[Path, ...],
    azimuth: float,
    elevation: float,
    method: str,
    seed: int,
    picture: Path | None,
    up: str | None,
    unit: str | None,
    out: Path,
    **options: Any,
) -> None:
    """Scan the first of MESHES; the others, or the built-in shapes, fill the scene.

    Points are in metres, z up, in the coordinates of the object's file: a --size scales it about the centre of its box,
    a --unit about its origin. A camera is --range away from that centre in the direction of --azimuth and --elevation.
    So is a LiDAR in a scene without a ground; over a ground it is mounted at its height, --range away along the ground.
    Each point has range, incidence (radians), intensity, ring, column, instance (0: the object), n_returns, time and
    normal. Where nothing returns, no file is written, and the exit code is 1.

    \b
    Examples:
      zbuf-occlude scan car.off --sensor vlp-32c --range 15 --azimuth 30 --out scan.ply
      zbuf-occlude scan car.off --sensor hdl-64e --range 20 --scene street --keep all --out street.ply --picture a.png
      zbuf-occlude scan car.off --sensor vlp-16 --range 10 --velocity 20,0,0 --turn 30 --out moving.ply
      zbuf-occlude scan chair.off --sensor kinect-v1 --range 2 --scene room --set-sensor noise=0 --out chair.csv
    """
    suffix_of(out, SUFFIXES)
    if options["sensor"] == SURFACE:
        raise OptionError("scan needs a sensor. `zbuf-occlude visible` writes surface samples.")
    if picture is not None:
        if picture.suffix.lower() != ".png":
            raise OptionError(f"--picture must end in .png; got {picture.name!r}.")
        check_place(picture, "--picture")
    options["size"] = size_of_files(click.get_current_context(), options["size"])
    scan = parse_scan(method, options)
    if scan.height is not None and explicitly_set(click.get_current_context(), ("elevation",)):
        raise click.UsageError("--elevation is for cameras; the height of a LiDAR above the ground is --sensor-height.")
    collection = MeshCollection.from_paths(meshes, up=up, unit=unit, colors=bool(scan.transparent))
    check_sizes(scan, collection)
    warn_of_lying(collection[:1], up)
    capture, size, centre = scan_once(collection, scan, azimuth, elevation, seed)
    check_returns(capture, scan, size)
    found = replace(capture.scan, origin=capture.scan.origin + centre)
    with warnings.catch_warnings(record=True) as said:
        found.save(out, keep_clean=scan.keep_clean)
    for each in said:
        echo(f"warning: {each.message}", err=True)
    hidden = ""
    if scan.may_hide:
        hidden = f", {capture.hidden:.0%} of the object hidden by others"
        if not capture.reached:
            hidden += " (the requested share could not be reached)"
    echo(f"{len(found)} returns by {scan.sensor.name}, rays by {scan.method}{hidden}: {out}")
    lengths = lengths_of(scan, unit) or f"in {unit}"
    echo(f"{meshes[0]} read as {taken_as(collection[:1], up, unit, f'{size:.4g} m long, {lengths}')}")
    for warning in cut_off(QualityCounts(**capture.cut._asdict()).cut, scan.to_dict()):
        echo(warning, err=True)
    if picture is not None:
        draw_scan(picture, found, scan.sensor)


def check_returns(capture: Capture, scan: ScanConfig, size: float) -> None:
    """Raise MeshError where a scan has no return: with the reason, and what to do."""
    if len(capture.scan):
        return
    is_of_all = scan.keep == "all"
    why = why_empty(capture, scan.sensor, scan.method, is_of_all)
    away = float(np.linalg.norm(capture.pose[:3, 3]))
    raise MeshError(
        f"nothing of the {'scene' if is_of_all else 'object'} returns: {why.reason}. The object is {size:.4g} m long "
        f"and {away:.4g} m away. {why.cure}"
    )


def scan_once(
    collection: MeshCollection, scan: ScanConfig, azimuth: float, elevation: float, seed: int
) -> tuple[Capture, float, FloatArray]:
    """Return the capture of a collection's first mesh, its longest side in metres, and its centre (3,) in the file.

    The rest of the collection, or the built-in shapes, fill the scene. Raises OptionError for a class without a size,
    or a range within the object.
    """
    first = collection[0]
    precompile(scan.method, question_of(scan.sensor, scan.motion))
    with Limits().watch():
        loaded = first.load()
    mesh, size = in_metres(loaded, first.label, scan)

    def seeds(what: str, view: int) -> np.random.SeedSequence:
        return seed_of(seed, f"{first.key}/{what}", 0, view)

    views = from_angles(azimuth, elevation)
    floor = float(mesh.bounds[0, 2])
    try:
        places = sensor_views(views, size, floor, scan, seeds)
    except MeshError as error:  # the range given is within the object
        raise OptionError(str(error)) from None
    pool = Pool(collection[1:], scan.size, scan.scene, seed_of(seed, "pool"), scan.transparent)
    capture = next(captures(mesh, scan, places, floor, seeds, pool))
    if scan.transparent and capture.scene.transmittance is None:
        raise OptionError(no_transparent_material("--transparent", loaded))
    if n_raised(views, places, scan):
        echo("warning: the camera would be below the ground or table, and stands on it. Raise --elevation.", err=True)
    return capture, size, loaded.centre


PLOT_RADIUS = 4.0
"""Radius of the part of the cloud that is drawn, in radii of the object."""


def draw_scan(path: Path, scan: Scan, sensor: Sensor) -> None:
    """Plot the returns by azimuth and elevation, and the cloud by range and by object; write a PNG."""
    from zbuf_occlude.drawing.pictures import blank_figure, draw_cloud

    figure = blank_figure(13, 4.4)
    image, by_range, by_object = figure.subplots(1, 3)
    towards = scan.positions - scan.origin
    middle = np.median(towards, axis=0) if len(scan) else np.array([1.0, 0.0, 0.0])
    turned = np.arctan2(towards[:, 1], towards[:, 0]) - np.arctan2(middle[1], middle[0])
    azimuth = np.degrees((turned + np.pi) % (2 * np.pi) - np.pi)
    elevation = np.degrees(np.arcsin(np.clip(towards[:, 2] / np.maximum(scan.ranges, 1e-9), -1, 1)))
    size = float(np.clip(20_000 / max(len(scan), 1), 0.3, 12.0))
    marks = image.scatter(azimuth, elevation, c=scan.ranges, s=size, cmap="turbo", linewidths=0)
    image.invert_xaxis()
    image.set_xlabel("azimuth from the middle, degrees")
    image.set_ylabel("elevation, degrees")
    image.set_title(f"{len(scan):,} returns of {sensor.name}, coloured by range", fontsize=10)
    figure.colorbar(marks, ax=image, label="metres")
    shown, centre, radius = around_the_object(scan)
    size = float(np.clip(20_000 / max(shown.sum(), 1), 0.3, 12.0))
    for axes, values, title in ((by_range, scan.ranges, "by range"), (by_object, scan.instances, "by object")):
        axes.set_axis_off()
        axes.set_title(title + ("" if shown.all() else ", about the object"), fontsize=10)
        if shown.any():
            away = scan.origin - centre
            angle = np.arctan2(away[1], away[0]) + np.radians(50.0)
            eye = centre + 3.5 * radius * np.array([np.cos(angle), np.sin(angle), 0.45])
            colour = colours(values[shown])
            draw_cloud(axes, scan.positions[shown], eye=eye, target=centre, values=colour, radius=radius, size=size)
    atomic.write(path, lambda file: figure.savefig(file, format="png", dpi=110))


def around_the_object(scan: Scan) -> tuple[BoolArray, FloatArray, float]:
    """Return the mask of the returns to draw, their centre and their radius.

    These are the returns near the object: a car in 150 m of ground would be a dot. All returns are drawn where the
    object has none, or where all lie near it.
    """
    positions = scan.positions
    if not len(positions):
        return np.zeros(0, dtype=bool), np.zeros(3), 1.0
    centre, whole = (positions.min(axis=0) + positions.max(axis=0)) / 2, np.linalg.norm(np.ptp(positions, axis=0)) / 2
    own = positions[scan.instances == 0]
    if len(own):
        radius = PLOT_RADIUS * float(np.linalg.norm(np.ptp(own, axis=0))) / 2
        if 0.0 < radius < whole:
            centre = (own.min(axis=0) + own.max(axis=0)) / 2
            return np.linalg.norm(positions - centre, axis=1) <= radius, centre, radius
    return np.ones(len(positions), dtype=bool), centre, float(whole) or 1.0


def colours(values: np.ndarray) -> np.ndarray:
    """Return an RGB colour in [0, 1] per value: a cycle of colours for integers, a colour scale for others."""
    from matplotlib import colormaps

    if np.issubdtype(values.dtype, np.integer):
        return np.asarray(colormaps["tab20"](values % 20)[:, :3])
    low, high = (float(values.min()), float(values.max())) if len(values) else (0.0, 1.0)
    return np.asarray(colormaps["turbo"]((values - low) / max(high - low, 1e-9))[:, :3])
