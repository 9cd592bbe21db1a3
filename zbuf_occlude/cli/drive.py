"""Command `drive`: a sequence of sweeps of a rig that moves through a scene."""

from pathlib import Path
from typing import Any

import click
import numpy as np

from zbuf_occlude.base.arrays import FloatArray
from zbuf_occlude.base.errors import OptionError
from zbuf_occlude.base.provenance import seed_of
from zbuf_occlude.cli.scan_options import CASTING, parse_sensor, sensor_options, trajectory_options
from zbuf_occlude.cli.shared_options import OutFolder, explicitly_set, finite
from zbuf_occlude.cli.shell import Command, Name, counted, echo, progress_bar
from zbuf_occlude.datasets.sequences import LAYOUTS, load_layout
from zbuf_occlude.sensors import Motion, read_trajectory
from zbuf_occlude.sensors.drives import scan_drive, sweeps_held
from zbuf_occlude.sensors.rigs import HEIGHT, Rig, read_rig, single_rig
from zbuf_occlude.sensors.scenes.contents import placed_of, read_scene
from zbuf_occlude.sensors.scenes.road import ground_about, road_along
from zbuf_occlude.sensors.scenes.scene import Scene

SPEED = (10.0, 0.0, 0.0)
"""Default velocity, metres a second."""
SWEEPS = 20
"""Default number of sweeps without a trajectory."""
MAX_SWEEPS = 1_000_000
"""Maximum sweeps: SemanticKITTI's names of files have six digits."""


@click.command(cls=Command)
@sensor_options("hdl-64e")
@click.option(
    "--rig",
    type=click.Path(path_type=Path, exists=True, dir_okay=False),
    help="YAML file of several sensors and their poses; replaces --sensor.",
)
@click.option(
    "--sensor-height",
    type=click.FloatRange(min=0.0),
    callback=finite,
    help=f"Height of --sensor above the ground, metres.  [default: {HEIGHT}]",
)
@trajectory_options
@click.option(
    "--deskew/--no-deskew",
    default=True,
    help="Points at their true positions, as in SemanticKITTI, or as reported by sensors that ignore their motion.",
)
@click.option(
    "--sweeps",
    type=click.IntRange(1),
    help=f"Number of sweeps.  [default: all that the trajectory holds; {SWEEPS} without one]",
)
@click.option("--scene", default="street", help="street: drawn along the path; or a JSON file.")
@click.option("--method", type=Name(CASTING), default="exact", show_default=True, help="Method that casts the rays.")
@click.option("--seed", type=click.IntRange(0), default=0, help="Seed of all random draws.")
@click.option("--format", "layout", type=Name(list(LAYOUTS)), default=next(iter(LAYOUTS)), help="Layout of the files.")
@click.option("--sequence", type=click.IntRange(0, 99), default=0, help="Number of the sequence in --out.")
@click.option("--out", type=OutFolder(), required=True, help="Folder of the dataset; other sequences in it stay.")
def drive_command(
    rig: Path | None, sweeps: int | None, scene: str, layout: str, sequence: int, out: Path, seed: int, **options: Any
) -> None:
    """Write a sequence of sweeps of a LiDAR, or of a rig of sensors, that drives through a scene.

    A trajectory has lines of t x y z qx qy qz qw: seconds, and the poses of the rig in the scene, x forward, z up. The
    ground is z = 0. Without one the rig drives from the origin at --velocity, by default 10 m/s ahead. A LiDAR of your
    own is a YAML file, and so is a rig:

    \b
      kind: spinning
      elevations: {from: -25, to: 15, n: 64}    # degrees of the lasers
      columns: 1024                             # firings per turn
      range_max: 100

    \b
      sensors:
        - {name: top, sensor: my-lidar.yaml, position: [0, 0, 1.9]}
        - {name: left, sensor: mid-360, position: [0.5, 0.8, 1.2], yaw: 90, pitch: 10}

    In a scene file positions are metres in the same frame, and objects may move: {"objects": [{"class": "car", "mesh":
    "car.off", "position": [20, 4, 0], "yaw": -90, "velocity": [-8, 0, 0]}]}. Classes are the labels of the points.

    \b
    Examples:
      zbuf-occlude drive --out kitti
      zbuf-occlude drive --sensor my-lidar.yaml --trajectory path.txt --sweeps 50 --out kitti
      zbuf-occlude drive --rig rig.yaml --trajectory path.txt --scene town.json --sequence 1 --out kitti
    """
    writer = load_layout(layout)
    sensors = _rig(rig, options)
    writer.check(out, sequence, sensors)
    motion = _motion(options)
    held = sweeps_held(sensors, motion)
    n_sweeps = sweeps or (SWEEPS if held is None else max(held, 1))
    if n_sweeps > MAX_SWEEPS:
        raise OptionError(f"a sequence must have at most {MAX_SWEEPS:,} sweeps; it has {n_sweeps:,}. Give --sweeps N.")
    path = _path(motion, n_sweeps * sensors.period)
    placed = _placed(scene, path, seed)
    world = Scene.joined(placed, rng=np.random.default_rng(seed_of(seed, "drive/albedo")))
    made = scan_drive(world, sensors, motion, n_sweeps, seed=seed, method=options["method"])
    n_points, bar = list[int](), progress_bar(n_sweeps, "sweeps", "drive")
    with bar:
        for sweep in writer.write(out, sequence, sensors, made):
            n_points.append(sum(len(scan) for scan in sweep.scans.values()))
            bar.update()
    length = float(np.hypot(*np.diff(path[:, :2], axis=0).T).sum())
    names = ", ".join(each.sensor.name for each in sensors)
    echo(f"{counted(n_sweeps, 'sweep')} of {names} in {n_sweeps * sensors.period:g} s and {length:.1f} m: {out}")
    echo(f"{sum(n_points):,} points, {np.median(n_points):,.0f} in the usual sweep; {counted(len(placed), 'object')}")
    if not all(n_points):
        echo(f"warning: {counted(n_points.count(0), 'sweep')} without a point", err=True)


def _rig(rig: Path | None, options: dict[str, Any]) -> Rig:
    if rig is None:
        height = HEIGHT if options["sensor_height"] is None else options["sensor_height"]
        return single_rig(parse_sensor(options["sensor"], options["set_sensor"], options["camera"]), height)
    if given := explicitly_set(click.get_current_context(), ("sensor", "set_sensor", "camera", "sensor_height")):
        raise click.UsageError(f"{given[0]} must go without --rig, whose file has the sensors. Leave one out.")
    return read_rig(rig)


def _motion(options: dict[str, Any]) -> Motion:
    velocity, turn, rows = options["velocity"], options["turn"], options["trajectory"]
    if rows is None:
        return Motion(SPEED if velocity is None else velocity, turn, deskew=options["deskew"])
    if velocity is not None or turn:
        raise OptionError("--trajectory must go without --velocity and --turn. Leave one out.")
    return Motion(trajectory=read_trajectory(rows), deskew=options["deskew"])


def _path(motion: Motion, duration: float) -> FloatArray:
    """Return positions (m, 3) of the rig, one each tenth of a second or less."""
    rotation_and_place = motion.start()
    _, positions = motion.poses(np.linspace(0.0, duration, 2 + int(10.0 * duration)))
    return np.asarray(positions @ rotation_and_place[:3, :3].T + rotation_and_place[:3, 3])


def _placed(scene: str, path: FloatArray, seed: int) -> list[Any]:
    if Path(scene).suffix.lower() == ".json":
        read = read_scene(Path(scene))
        if read["table"] is not None or not read["ground"]:
            raise OptionError(f"a drive's scene must be on a ground, without a table; {scene} is not. Leave them out.")
        return [*placed_of(read["objects"], 0.0), ground_about(path)]
    if scene != "street":
        raise OptionError(f"--scene must be street or a JSON file; got {scene!r}.")
    return road_along(path, seed_of(seed, "drive/road"))
