"""Options of commands that scan (sensor, range, size, scene), and their conversion to a `ScanConfig`."""

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import click
import numpy as np
from click.core import ParameterSource

from zbuf_occlude import sensors
from zbuf_occlude.base.errors import OptionError
from zbuf_occlude.cli.shared_options import Setting, Settings, explicitly_set, finite
from zbuf_occlude.cli.shell import Decorator, all_of, echo
from zbuf_occlude.datasets.auto import AUTO
from zbuf_occlude.meshes.collection import MeshCollection
from zbuf_occlude.meshes.shapes.built_in import BUILT_IN
from zbuf_occlude.sensors import Motion, Sensor, read_trajectory
from zbuf_occlude.sensors.scan_config import SURFACE, ScanConfig
from zbuf_occlude.sensors.scenes.contents import read_scene, surroundings, with_checksums
from zbuf_occlude.sensors.scenes.kinds import KINDS
from zbuf_occlude.sensors.scenes.sizes import ALL, FILE, SIZES, size_of, sizes_of
from zbuf_occlude.views import Views
from zbuf_occlude.visibility import METHODS, find_method

SCAN_OPTIONS = (
    "sensor", "set_sensor", "camera", "range_", "size", "scene", "hidden", "keep", "keep_clean", "sensor_height",
    "transparent", "velocity", "turn", "trajectory", "deskew",
)  # fmt: skip
"""Names of the parameters that `scan_options` adds."""
OF_SCANS = (
    "hidden", "keep", "keep_clean", "transparent", "velocity", "turn", "trajectory", "deskew", "least_points",
)  # fmt: skip
"""Those, and another of `generate`, that say what a scan gives; the others say where the sensor stands."""


CASTING = [method.name for method in METHODS if not method.ray_casting_unsupported_reason]
"""Names of the methods that cast rays."""


def vector(text: str) -> tuple[float, float, float]:
    """Parse three finite numbers separated by commas."""
    try:
        x, y, z = map(float, text.split(","))
    except ValueError:
        x = y = z = math.nan
    if not all(map(math.isfinite, (x, y, z))):
        raise click.BadParameter(f"must be three finite numbers X,Y,Z; got {text!r}.")
    return x, y, z


def sensor_options(sensor: str | None) -> Decorator:
    """Return the options --sensor, --set-sensor and --camera; `sensor` is the default, None for no sensor."""
    return all_of(
        click.option(
            "--sensor",
            default=sensor,
            help="Sensor: a name of `zbuf-occlude sensors`, or a YAML or CSV file"
            + ("; surface: none." if sensor == SURFACE else "."),
        ),
        click.option(
            "--set-sensor",
            type=Setting(),
            multiple=True,
            help="Parameter of the sensor, such as columns=900 or noise=0; repeatable.",
        ),
        click.option(
            "--camera",
            metavar="FILE",
            help="Intrinsics of a pinhole sensor: BOP's camera.json, ROS's camera_info.yaml, COLMAP's cameras.txt, "
            "Open3D's JSON.",
        ),
    )


trajectory_options = all_of(
    click.option("--velocity", type=vector, metavar="X,Y,Z", help="Velocity of the sensor: m/s forward, left, up."),
    click.option(
        "--turn",
        type=float,
        default=0.0,
        callback=finite,
        help="Yaw rate of the sensor, degrees per second, left positive.",
    ),
    click.option(
        "--trajectory",
        type=click.Path(path_type=Path, exists=True, dir_okay=False),
        help="File of poses t x y z qx qy qz qw; replaces --velocity and --turn.",
    ),
)
"""The options --velocity, --turn and --trajectory."""


def scan_options(sensor: str) -> Decorator:
    """Return the options of a scan; `sensor` is the default of --sensor."""
    scenes = ", ".join(kind.name for kind in KINDS)
    return all_of(
        sensor_options(sensor),
        click.option(
            "--range",
            "range_",
            metavar="M|A..B[@area]",
            help="Distance of sensor and object, metres; drawn uniformly in range, or in area.  "
            "[default: from the views]",
        ),
        click.option(
            "--size",
            metavar="CLASS=M,...|M|file",
            help="Longest sides of objects, metres; M: of all; file: as in the files.  "
            "[default: by class; file with --unit]",
        ),
        click.option("--scene", default="none", help=f"Scene about the object: {scenes}, or a JSON file."),
        click.option(
            "--hidden", metavar="A..B", help="Fraction of the object hidden by others.  [default: the scene's]"
        ),
        click.option(
            "--keep",
            default="target",
            metavar="target|box|all",
            help="Points kept: of the object, in its box (box:shift=0.5,rotate,scale), or all.",
        ),
        click.option("--keep-clean", is_flag=True, help="Store noise-free ranges as well."),
        click.option(
            "--sensor-height", type=float, help="Height of a LiDAR above the ground, metres.  [default: the scene's]"
        ),
        click.option(
            "--transparent",
            multiple=True,
            metavar="NAME[=SHARE]",
            help="Transparent material (alpha of glTF, d of MTL); *: all.",
        ),
        trajectory_options,
        click.option("--deskew", is_flag=True, help="Correct for the sensor's motion: points at their true positions."),
    )


def are_shapes_in_metres(context: click.Context) -> bool:
    """Return whether a command takes built-in shapes that are in metres."""
    shapes = None if context.params["meshes"] else context.params.get("shapes")
    return any(row.in_metres for row in BUILT_IN if row.name == shapes)


def size_of_files(context: click.Context, size: str | None) -> str | None:
    """Return the value of --size; `FILE` with --unit, or for built-in shapes in metres.

    Raises UsageError for --size together with --unit.
    """
    if context.params.get("unit") is None:
        return FILE if are_shapes_in_metres(context) and size is None else size
    if size not in (None, FILE) and explicitly_set(context, ("size",)):
        raise click.UsageError(f"--unit must go without --size {size}, which is in metres for files of any unit.")
    return FILE


def pop_scan_options(context: click.Context, options: dict[str, Any], *, sampled: bool) -> ScanConfig | None:
    """Remove the options of scans from a command's options; return them as a `ScanConfig`, None without a sensor.

    `sampled` is True for formats that hold complete clouds too. Otherwise options of sampling are refused for a sensor.
    """
    taken, least_points = {name: options.pop(name) for name in SCAN_OPTIONS}, options.pop("least_points")
    if taken["sensor"] == SURFACE:
        if least_points is not None:
            raise OptionError("--least-points is for scans; give --sensor NAME.")
        preset = {name for name in taken if context.get_parameter_source(name) is ParameterSource.DEFAULT_MAP}
        for name in SCAN_OPTIONS[1:]:  # those of the preset are its sensor's
            if name not in preset and taken[name] not in (None, False, "", (), "none", "target"):
                raise OptionError(f"--{name.strip('_').replace('_', '-')} needs a sensor; give --sensor NAME.")
        return None
    if idle := explicitly_set(context, ("settings",) if sampled else ("points", "density", "settings")):
        raise click.UsageError(f"{idle[0]} is for samples of the surface; it does not apply to a sensor. Leave it out.")
    taken["size"] = size_of_files(context, taken["size"])
    scan = parse_scan(named_caster(context), taken)
    return scan if least_points is None else replace(scan, least_points=least_points)


def named_caster(context: click.Context) -> str:
    """Return the method that casts rays, as typed or by default; raises OptionError for one that cannot."""
    name = context.params.get("method")
    if not explicitly_set(context, ("method",)) or name in (None, AUTO):
        return "exact"
    find_method(str(name)).check_first_hits()
    return str(name)


def parse_sensor(name: str, settings: Settings, camera: str | None) -> Sensor:
    """Return a sensor with the intrinsics of --camera and the parameters of --set-sensor.

    Raises OptionError as `zbuf_occlude.sensors.make` and `read_intrinsics`, and for a parameter that both give.
    """
    sensor = sensors.make(name)
    if camera is not None:
        if sensor.kind != "pinhole":
            raise OptionError(f"--camera must go with a pinhole sensor; {sensor.name} is {sensor.kind}. Leave it out.")
        intrinsics = sensors.read_intrinsics(camera)
        if given := [each for each, _ in settings if each in (*intrinsics, "fov")]:
            raise OptionError(f"--set-sensor {given[0]} must not be beside --camera, which gives it. Leave one out.")
        sensor = sensors.make(sensor, **intrinsics)
    sensor = sensors.make(sensor, **dict(settings))
    sensor.rays()  # raises for wrong parameters
    return sensor


def check_sizes(scan: ScanConfig, collection: MeshCollection) -> None:
    """Raise OptionError for a size of an unknown class, or a range that lies within an object.

    A size of no mesh and no object of the scene, and a range that only begins within an object, are reported.
    """
    if isinstance(scan.size, str):
        return
    known = {*collection.classes, *SIZES, ALL}
    if unknown := [label for label in scan.size if label not in known]:
        raise OptionError(f"--size must name classes of the meshes, {', '.join(collection.classes)}; got {unknown[0]}.")
    used = {*collection.classes, *(entry.label for entry in surroundings((), scan.scene)), ALL}
    if idle := [label for label in scan.size if label not in used]:
        echo(
            f"warning: --size {', '.join(idle)} names no class of the meshes, {', '.join(collection.classes)}, "
            "or of the scene: it changes nothing",
            err=True,
        )
    sizes = {label: size_of(label, scan.size, 1.0) for label in collection.classes}
    if scan.range is None:
        return
    for label, size in sizes.items():
        if scan.range[1] <= size / 2:
            assumed = "" if {label, "*"} & set(scan.size) else ", the default of its class"
            raise OptionError(
                f"--range must be more than half the size of every object; class {label} has {size:g} m{assumed}, the "
                f"range is {scan.range[1]:g} m. Raise --range, or give --size {label}=METRES, or the files' --unit."
            )
    large = [f"{label} ({size / 2:g} m)" for label, size in sizes.items() if scan.range[0] <= size / 2]
    if large:
        echo(f"the range starts at half the object's size for: {', '.join(large)}", err=True)


def overruled(scan: ScanConfig, views: Views) -> Iterator[str]:
    """Yield a text where the elevations of views do not count: for a LiDAR mounted above the ground."""
    if views.rotations is not None:
        return
    name = scan.sensor.name
    if scan.height is not None and (np.abs(views.elevation) > 1e-9).any():
        n_sides = len(np.unique(np.round(np.exp(1j * views.azimuth), 9)))
        same = f"; {len(views)} views look from {n_sides} sides" if n_sides < len(views) else ""
        yield f"{name} is mounted {scan.height:g} m above the ground: elevations of --views do not count{same}"


def parse_scan(method: str, options: dict[str, Any]) -> ScanConfig:
    """Return the options of `scan_options`, those of a sensor; raise OptionError for one that is out of range."""
    sensor = parse_sensor(options["sensor"], options["set_sensor"], options["camera"])
    scene, of_file = options["scene"], dict[str, Any]()
    transparent = dict(_material(each) for each in options["transparent"])
    if Path(scene).suffix.lower() == ".json":
        scene, of_file = "file", read_scene(Path(scene))
        of_file["objects"] = with_checksums(of_file["objects"], colors=bool(transparent))
    moving = any(each.get("velocity") or each.get("turn") for each in of_file.get("objects", ()))
    if moving and sensor.no_motion_reason:
        echo(f"warning: moving objects stand still: {sensor.no_motion_reason}", err=True)
    scan = ScanConfig(
        sensor,
        range=options["range_"],
        size={} if options["size"] is None else sizes_of(options["size"]),
        scene=scene,
        **of_file,
        hidden=options["hidden"],
        keep=options["keep"],
        keep_clean=options["keep_clean"],
        sensor_height=options["sensor_height"],
        method=method,
        transparent=transparent,
        motion=_motion(options),
    )
    if scan.motion is not None and (said := scan.motion.duration_mismatch(sensor.rays())):
        echo(f"warning: {said}", err=True)
    return scan


def _motion(options: dict[str, Any]) -> Motion | None:
    """Return the motion of the sensor; None where it stands still."""
    if not (options["velocity"] or options["turn"] or options["trajectory"]):
        if options["deskew"]:
            raise OptionError("--deskew must go with --velocity, --turn or --trajectory.")
        return None
    path = options["trajectory"]
    return Motion(
        options["velocity"] or (0.0, 0.0, 0.0),
        options["turn"],
        None if path is None else read_trajectory(path),
        options["deskew"],
    )


def _material(text: str) -> tuple[str, float | None]:
    """Parse ``NAME`` or ``NAME=SHARE``."""
    name, equals, share = text.rpartition("=") if "=" in text else (text, "", "")
    try:
        if not name.strip():
            raise ValueError
        return name, float(share) if equals else None
    except ValueError:
        raise OptionError(f"--transparent must be NAME or NAME=SHARE, SHARE in 0..1; got {text!r}.") from None
