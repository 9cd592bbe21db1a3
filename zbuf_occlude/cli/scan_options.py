"""Options of everything that scans: sensor, range, size, scene; and how they become a setup."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click
import numpy as np
from click.core import ParameterSource

from zbuf_occlude import sensors
from zbuf_occlude.cli.shared_options import Setting, Settings, explicitly_set, finite
from zbuf_occlude.cli.shell import Decorator, all_of, echo
from zbuf_occlude.dataset.auto import AUTO
from zbuf_occlude.errors import OptionError
from zbuf_occlude.meshes.collection import MeshCollection
from zbuf_occlude.scenes.contents import read_scene, with_checksums
from zbuf_occlude.scenes.kinds import KINDS
from zbuf_occlude.scenes.sizes import ALL, FILE, SIZES, size_of, sizes_of
from zbuf_occlude.sensors import Sensor, read_trajectory
from zbuf_occlude.sensors.scanning import default_caster
from zbuf_occlude.sensors.setup import SURFACE, ScanConfig
from zbuf_occlude.shapes.built_in import BUILT_IN
from zbuf_occlude.views import Views
from zbuf_occlude.visibility import METHODS, find_method

SCAN_OPTIONS = (
    "sensor", "set_sensor", "range_", "size", "scene", "hidden", "keep", "keep_clean", "sensor_height", "transparent",
    "velocity", "turn", "trajectory", "deskew",
)  # fmt: skip
"""Names of the parameters that `scan_options` adds."""


CASTING = [method.name for method in METHODS if not method.no_first_hits]
"""Methods that cast rays."""


def vector(text: str) -> tuple[float, float, float]:
    """Read three finite numbers with commas between."""
    try:
        x, y, z = map(float, text.split(","))
    except ValueError:
        x = y = z = math.nan
    if not all(map(math.isfinite, (x, y, z))):
        raise click.BadParameter(f"must be three finite numbers X,Y,Z; got {text!r}.")
    return x, y, z


def sensor_options(sensor: str) -> Decorator:
    """--sensor and --set-sensor; `sensor` is the default."""
    return all_of(
        click.option(
            "--sensor",
            default=sensor,
            help="Name of `zbuf-occlude sensors`, or YAML or CSV"
            + ("; surface: no sensor." if sensor == SURFACE else "."),
        ),
        click.option(
            "--set-sensor",
            type=Setting(),
            multiple=True,
            help="Number of the sensor, e.g. columns=900, noise=0; repeatable.",
        ),
    )


def scan_options(sensor: str) -> Decorator:
    """--sensor and what goes with it; `sensor` is the default."""
    scenes = ", ".join(kind.name for kind in KINDS)
    return all_of(
        sensor_options(sensor),
        click.option(
            "--range", "range_", metavar="M|A..B", help="Metres from sensor to object.  [default: from the views]"
        ),
        click.option(
            "--size",
            metavar="CLASS=M,...|M|file",
            help="Longest sides, metres; M: of the objects seen, file: as in the files.  "
            "[default: by class; file with --unit]",
        ),
        click.option("--scene", default="none", help=f"{scenes}, or a JSON file."),
        click.option("--hidden", metavar="A..B", help="Share of the object that others hide.  [default: the scene's]"),
        click.option(
            "--keep",
            default="target",
            metavar="target|box|all",
            help="Points of the object, in its box (box:shift=0.5,rotate,scale), or all.",
        ),
        click.option("--keep-clean", is_flag=True, help="Store the ranges without noise too."),
        click.option("--sensor-height", type=float, help="Of a LiDAR, metres above ground.  [default: the scene's]"),
        click.option(
            "--transparent",
            multiple=True,
            metavar="NAME[=SHARE]",
            help="Material that lets light pass (alpha of glTF, d of MTL); * for any.",
        ),
        click.option(
            "--velocity", type=vector, metavar="X,Y,Z", help="Of the sensor while it scans: m/s forward, left, up."
        ),
        click.option("--turn", type=float, default=0.0, callback=finite, help="Of it, degrees a second to the left."),
        click.option(
            "--trajectory",
            type=click.Path(path_type=Path, exists=True, dir_okay=False),
            help="Instead of both: lines of t x y z qx qy qz qw.",
        ),
        click.option("--deskew", is_flag=True, help="Undo the sensor's motion: points are where they were met."),
    )


def size_of_files(context: click.Context, size: str | None) -> str | None:
    """Return how large objects are: as a person said by --size, or as they are, with --unit or built in in metres.

    --size and --unit together are a UsageError.
    """
    if context.params.get("unit") is None:
        shapes = None if context.params["meshes"] else context.params.get("shapes")
        in_metres = any(row.in_metres for row in BUILT_IN if row.name == shapes)
        return FILE if in_metres and size is None else size
    if size not in (None, FILE) and explicitly_set(context, ("size",)):
        raise click.UsageError(f"--unit must go without --size {size}, which is metres whatever the files' unit.")
    return FILE


def pop_scan_options(context: click.Context, options: dict[str, Any], *, sampled: bool) -> ScanConfig | None:
    """Take the options of `scan_options` out of a command's own and return the setup; None without a sensor.

    `sampled`: whether the whole objects are sampled too, for a format that holds complete clouds. Else options that say
    how points are sampled are refused beside a sensor.
    """
    taken = {name: options.pop(name) for name in SCAN_OPTIONS}
    if taken["sensor"] == SURFACE:
        preset = {name for name in taken if context.get_parameter_source(name) is ParameterSource.DEFAULT_MAP}
        return parse_setup("", {**taken, **dict.fromkeys(preset - {"sensor"})})  # it goes with the preset's sensor
    if idle := explicitly_set(context, ("settings",) if sampled else ("points", "density", "settings")):
        raise click.UsageError(f"{idle[0]} is for points on the surface; a sensor decides itself. Leave it out.")
    taken["size"] = size_of_files(context, taken["size"])
    return parse_setup(named_caster(context), taken)


def named_caster(context: click.Context) -> str:
    """Return the method named to cast rays, or the one that casts them here; one that casts none is an OptionError."""
    name = context.params.get("method")
    if not explicitly_set(context, ("method",)) or name in (None, AUTO):
        return default_caster()
    find_method(str(name)).check_first_hits()
    return str(name)


def parse_sensor(name: str, settings: Settings) -> Sensor:
    """Return a sensor with the numbers that were set; OptionError as `zbuf_occlude.sensors.make`."""
    sensor = sensors.make(name, **dict(settings))
    sensor.rays()  # for its errors
    return sensor


def check_sizes(setup: ScanConfig | None, collection: MeshCollection) -> None:
    """Raise OptionError for a class without a size, a size without a class, or a range within an object of it.

    Of a range that begins within an object, a remark says what is taken of it.
    """
    if setup is None or isinstance(setup.size, str):
        return
    known = {*collection.classes, *SIZES, ALL}
    if unknown := [label for label in setup.size if label not in known]:
        raise OptionError(
            f"--size must be of classes that there are, {', '.join(collection.classes)}; got {unknown[0]}."
        )
    sizes = {label: size_of(label, setup.size, 1.0) for label in collection.classes}
    if setup.range is None:
        return
    for label, size in sizes.items():
        if setup.range[1] <= size / 2:
            assumed = "" if {label, "*"} & set(setup.size) else ", assumed of its class"
            raise OptionError(
                f"--range must be more than half of every object; one of class {label} has {size:g} m{assumed}, the "
                f"range is {setup.range[1]:g} m. Raise --range, or give --size {label}=METRES, or the files' --unit."
            )
    large = [f"{label} ({size / 2:g} m)" for label, size in sizes.items() if setup.range[0] <= size / 2]
    if large:
        echo(f"scanned from outside them only, half their size away or more: {', '.join(large)}", err=True)


def overruled(setup: ScanConfig | None, views: Views) -> Iterator[str]:
    """Say what of the views does not count: where a LiDAR is mounted above the ground, and how far the sensor is."""
    if setup is None or views.rotations is not None:
        return
    name = setup.sensor_model.name
    if setup.height is not None and (np.abs(views.elevation) > 1e-9).any():
        places = len(np.unique(np.round(np.exp(1j * views.azimuth), 9)))
        same = f"; {len(views)} views look from {places} sides" if places < len(views) else ""
        yield f"{name} is mounted {setup.height:g} m above the ground: elevations of --views do not count{same}"


def parse_setup(method: str, options: dict[str, Any]) -> ScanConfig | None:
    """Turn the options of `scan_options` into a setup; None without a sensor, where others are an OptionError."""
    if options["sensor"] == SURFACE:
        for name in SCAN_OPTIONS[1:]:
            if options[name] not in (None, False, "", (), "none", "target"):
                raise OptionError(f"--{name.strip('_').replace('_', '-')} needs a sensor; give --sensor NAME.")
        return None
    sensor = parse_sensor(options["sensor"], options["set_sensor"])
    scene, objects = options["scene"], list[dict[str, Any]]()
    transparent = dict(_material(each) for each in options["transparent"])
    if Path(scene).suffix.lower() == ".json":
        scene, objects = "file", with_checksums(read_scene(Path(scene)), colors=bool(transparent))
    if any(each.get("velocity") or each.get("turn") for each in objects) and sensor.no_motion_reason:
        echo(f"warning: objects that move stand still: {sensor.no_motion_reason}", err=True)
    setup = ScanConfig(
        sensor.to_dict(),
        range=options["range_"],
        size={} if options["size"] is None else sizes_of(options["size"]),
        scene=scene,
        objects=objects,
        hidden=options["hidden"],
        keep=options["keep"],
        keep_clean=options["keep_clean"],
        sensor_height=options["sensor_height"],
        method=method,
        transparent=transparent,
        motion=_motion(options),
    )
    if setup.motion_model is not None and (said := setup.motion_model.duration_mismatch(sensor.rays())):
        echo(f"warning: {said}", err=True)
    return setup


def _motion(options: dict[str, Any]) -> dict[str, Any] | None:
    """Return how the sensor moves as a `ScanConfig` has it."""
    if not (options["velocity"] or options["turn"] or options["trajectory"]):
        if options["deskew"]:
            raise OptionError("--deskew must go with --velocity, --turn or --trajectory.")
        return None
    velocity, rows = list(options["velocity"] or (0.0, 0.0, 0.0)), options["trajectory"]
    poses = None if rows is None else read_trajectory(rows).tolist()
    return {"velocity": velocity, "turn": options["turn"], "trajectory": poses, "deskew": options["deskew"]}


def _material(text: str) -> tuple[str, float | None]:
    """Read ``NAME`` or ``NAME=SHARE``."""
    name, equals, share = text.rpartition("=")
    try:
        return (name, float(share)) if equals else (text, None)
    except ValueError:
        raise OptionError(f"--transparent must be NAME or NAME=SHARE, a share in 0..1; got {text!r}.") from None
