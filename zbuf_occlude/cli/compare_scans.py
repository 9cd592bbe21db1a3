"""`zbuf-occlude compare-scans`: real scans of a mesh against what a sensor predicts of them."""

from pathlib import Path
from typing import Any

import click

from zbuf_occlude.cli.scan_options import CASTING, parse_sensor, sensor_options, vector
from zbuf_occlude.cli.shared_options import MeshPlace, OutFolder, Settings
from zbuf_occlude.cli.shell import Command, Name, echo
from zbuf_occlude.compare.scan_comparison import compare_scans, figure, write_scan_report
from zbuf_occlude.sensors.poses import look_at


@click.command(cls=Command)
@click.argument("mesh", type=MeshPlace())
@click.argument("scans", nargs=-1, required=True, type=click.Path(path_type=Path, exists=True, dir_okay=False))
@sensor_options("vlp-32c")
@click.option(
    "--poses",
    type=click.Path(path_type=Path, exists=True, dir_okay=False),
    help="Scans to the mesh: .conf, BOP's scene_gt.json, 4 x 4.  [default: one frame]",
)
@click.option(
    "--eye", type=vector, metavar="X,Y,Z", help="Where the sensor is, in the scans' frame.  [default: at its origin]"
)
@click.option(
    "--look-at",
    "target",
    type=vector,
    metavar="X,Y,Z",
    help="What the sensor looks at, in the scans' frame; goes with --eye.",
)
@click.option("--up-axis", type=vector, metavar="X,Y,Z", help="What is up for the sensor.  [default: 0,0,1]")
@click.option("--tolerance", type=click.FloatRange(0, min_open=True), help="A vertex this near a point is scanned.")
@click.option("--slack", type=click.FloatRange(0, min_open=True), help="A mesh this far before a point hides it.")
@click.option(
    "--depth-unit",
    type=click.FloatRange(0, min_open=True),
    help="Metres of one step of a depth image.  [default: 0.001, or what BOP's scene_camera.json says]",
)
@click.option("--refine", is_flag=True, help="Fit the poses to the mesh first, by Open3D's ICP.")
@click.option("--method", type=Name(CASTING), help="Who casts the rays. [default: the first that can here]")
@click.option("--seed", type=click.IntRange(0), default=0, help="Of the simulated scans.")
@click.option("--out", type=OutFolder(), required=True, help="Folder of the report.")
def compare_scans_command(
    mesh: Path,
    scans: tuple[Path, ...],
    sensor: str,
    set_sensor: Settings,
    poses: Path | None,
    eye: tuple[float, float, float] | None,
    target: tuple[float, float, float] | None,
    up_axis: tuple[float, float, float] | None,
    out: Path,
    **given: Any,
) -> None:
    """Compare real SCANS of MESH with what a sensor predicts of them.

    Scans are PLY, PCD, KITTI's and nuScenes' .bin, .npy, .npz, or depth images (PNG, 16 bits). The report says how many
    real points the mesh hides, which vertices were scanned and which the sensor should have returned, how far real
    points are from the mesh, and the density of both. Folders of BOP are read as they are, in millimetres.

    \b
    Examples:
      zbuf-occlude compare-scans bun_zipper.ply bun*.ply --sensor cyberware-3030 --poses bun.conf \\
          --eye 0,0.178,1.3 --look-at 0,0.178,0 --up-axis 0,1,0 --out bunny
      zbuf-occlude compare-scans room.ply depth.png --sensor kinect-v1 --poses pose.txt --out room
      zbuf-occlude compare-scans bop/models/obj_000001.ply bop/train/000000/depth/*.png --sensor pinhole \\
          --poses bop/train/000000/scene_gt.json --out bop_report
    """
    if (eye is None) != (target is None):
        raise click.UsageError("--eye and --look-at must go together. Give both.")
    if up_axis is not None and eye is None:
        raise click.UsageError("--up-axis must go with --eye and --look-at. Give them.")
    made = parse_sensor(sensor, set_sensor)
    mounted = None if eye is None or target is None else look_at(eye, target, up_axis)
    found = compare_scans(mesh, scans, made, poses=poses, sensor_pose=mounted, **given)
    for each in found:
        agree, hidden = figure(each.agreement, ".1%"), figure(each.false_hidden, ".2%")
        echo(f"{each.name}: {agree} of the vertices predicted or scanned are both, {hidden} of the real points hidden")
    written = write_scan_report(out, found, made)
    echo(f"report    {next(path for path in written if path.suffix == '.html')}")
