"""Command `compare-drives`: returns in the labelled boxes of a real drive against simulated ones."""

from pathlib import Path

import click

from zbuf_occlude.base import atomic
from zbuf_occlude.cli.shared_options import MeshPlace, check_place
from zbuf_occlude.cli.shell import Command, echo, progress_bar
from zbuf_occlude.studies.compare.drive_comparison import compare_drive
from zbuf_occlude.studies.compare.drive_report import drive_report


@click.command(cls=Command)
@click.argument("log", type=MeshPlace())
@click.option("--sensor", help="Name of the LiDAR, or a YAML or CSV file.  [default: found from the points]")
@click.option("--out", type=click.Path(path_type=Path), help="File of the report as well, Markdown.")
def compare_drives_command(log: Path, sensor: str | None, out: Path | None) -> None:
    """Compare the returns in the labelled boxes of a real drive with those of built-in road users of the same size.

    LOG is a folder of KITTI's object benchmark, Argoverse 2 (its annotations alone are enough) or nuScenes, or a table
    of boxes as of `crop`. Labelled cars, trucks, buses, cyclists and pedestrians at 5 to 80 m are scanned among the
    other boxes of their sweep. Nothing is fitted: the sensor is found from the points, and its numbers are those of the
    table of sensors. Albedos, windows and lost returns are drawn 200 times.

    \b
    Columns of the report:
      ratio of medians     real returns over the usual simulated ones
      with other objects   the same when the objects are drawn anew, 5 to 95 %
      without dropout      real returns over all that geometry lets return
      KS                   Kolmogorov-Smirnov distance of both distributions
      within the draws     sightings between the 5th and the 95th percentile of their draws; of a perfect model 90 %

    \b
    Examples:
      zbuf-occlude compare-drives KITTI
      zbuf-occlude compare-drives av2/LOG --out report.md
    """
    if out is not None:
        check_place(out)
    with progress_bar(1, "sweeps", "scan") as bar:

        def progress(done: int, total: int) -> None:
            bar.total = total
            bar.update(done - bar.n)

        found = compare_drive(log, sensor, progress=progress)
    for reason in found.skipped:
        echo(f"skipped: {reason}", err=True)
    lines = drive_report(found)
    echo("\n".join(lines))
    if out is not None:
        atomic.write_lines(out, lines)
