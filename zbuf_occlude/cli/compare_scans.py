"""Command `compare-scans`: real scans of a mesh against the scans that a sensor model predicts."""

from pathlib import Path
from typing import Any

import click

from zbuf_occlude.cli.scan_options import CASTING, parse_sensor, sensor_options, vector
from zbuf_occlude.cli.shared_options import MeshPlace, OutFolder, Settings
from zbuf_occlude.cli.shell import Command, Name, echo
from zbuf_occlude.sensors.poses import look_at
from zbuf_occlude.studies.compare.scan_comparison import compare_scans, format_number, write_scan_report


@click.command(cls=Command)
@click.argument("mesh", type=MeshPlace())
@click.argument("scans", nargs=-1, required=True, type=click.Path(path_type=Path, exists=True, dir_okay=False))
@sensor_options("vlp-32c")
@click.option(
    "--poses",
    type=click.Path(path_type=Path, exists=True, dir_okay=False),
    help="Poses, scan to mesh: .conf, BOP's scene_gt.json, 4 x 4.  [default: identity]",
)
@click.option("--eye", type=vector, metavar="X,Y,Z", help="Sensor position in the scans' frame.  [default: origin]")
@click.option(
    "--look-at",
    "target",
    type=vector,
    metavar="X,Y,Z",
    help="Target of the sensor in the scans' frame; needs --eye.",
)
@click.option("--up-axis", type=vector, metavar="X,Y,Z", help="Up direction of the sensor.  [default: 0,0,1]")
@click.option(
    "--tolerance",
    type=click.FloatRange(0, min_open=True),
    help="A vertex within this distance of a point counts as scanned.",
)
@click.option(
    "--slack",
    type=click.FloatRange(0, min_open=True),
    help="A point farther than this behind the mesh counts as hidden.",
)
@click.option(
    "--depth-unit",
    type=click.FloatRange(0, min_open=True),
    help="Metres of one step of a depth image.  [default: 0.001; for BOP, from scene_camera.json]",
)
@click.option("--refine", is_flag=True, help="Fit the poses to the mesh first (ICP by Open3D).")
@click.option("--method", type=Name(CASTING), default="exact", show_default=True, help="Method that casts the rays.")
@click.option("--seed", type=click.IntRange(0), default=0, help="Seed of the simulated scans.")
@click.option("--out", type=OutFolder(), required=True, help="Folder of the report.")
def compare_scans_command(
    mesh: Path,
    scans: tuple[Path, ...],
    sensor: str,
    set_sensor: Settings,
    camera: str | None,
    poses: Path | None,
    eye: tuple[float, float, float] | None,
    target: tuple[float, float, float] | None,
    up_axis: tuple[float, float, float] | None,
    out: Path,
    **options: Any,
) -> None:
    """Compare real SCANS of MESH with the scans that a sensor model predicts.

    Scans are PLY, PCD, KITTI's and nuScenes' .bin, .npy, .npz, or depth images (PNG, 16 bits). The report has the real
    points hidden by the mesh, the vertices scanned and predicted, the distances of real points from the mesh, and the
    densities of points. BOP's folders (millimetres) are read directly.

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
    model = parse_sensor(sensor, set_sensor, camera)
    sensor_pose = None if eye is None or target is None else look_at(eye, target, up_axis)
    found = compare_scans(mesh, scans, model, poses=poses, sensor_pose=sensor_pose, **options)
    for each in found:
        agree, hidden = format_number(each.agreement, ".1%"), format_number(each.false_hidden, ".2%")
        echo(f"{each.name}: {agree} of the vertices predicted or scanned are both, {hidden} of the real points hidden")
    written = write_scan_report(out, found, model)
    echo(f"report    {next(path for path in written if path.suffix == '.html')}")
