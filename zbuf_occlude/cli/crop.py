"""Command `crop`: single-object clouds of labelled sweeps of real LiDARs."""

from pathlib import Path
from typing import Any

import click

from zbuf_occlude.base.errors import OptionError
from zbuf_occlude.cli.shared_options import MeshPlace, OutFolder
from zbuf_occlude.cli.shell import SOME_FAILED, Command, Name, counted, echo, progress_bar
from zbuf_occlude.datasets.cloud_folder import OBJECTS
from zbuf_occlude.datasets.real.crops import DISTINCT, FIT, FRAMES, Crops, Ground, crop_objects
from zbuf_occlude.sensors.scan_config import LEAST_POINTS, span_of


@click.command(cls=Command)
@click.argument("source", type=MeshPlace())
@click.option("--out", type=OutFolder(), required=True, help="Folder of the clouds; it must be empty or missing.")
@click.option(
    "--classes",
    metavar="CLASS=LABEL+LABEL,...",
    help="Classes of labels, * as a wildcard; other labels are left out.  [default: a class per label]",
)
@click.option(
    "--least-points", type=click.IntRange(1), default=LEAST_POINTS, help="Leave out crops of fewer points than this."
)
@click.option("--margin", type=float, default=0.0, help="Metres around each box in which points are taken too.")
@click.option(
    "--ground",
    default=FIT,
    metavar="fit|METRES|none",
    help="Remove the ground: what a fitted plane says; or so many metres above the bottom of the box; or nothing.",
)
@click.option("--range", "range_", metavar="A..B", help="Range of the boxes' centres along the ground, metres.")
@click.option(
    "--frame", type=Name(FRAMES), default=FRAMES[0], help="Axes and origin of the box (x ahead), or of the sensor."
)
@click.option(
    "--distinct",
    type=float,
    default=DISTINCT,
    help="Metres that the sensor must have moved, seen from an object, for another crop of it; 0 takes all.",
)
def crop_command(source: Path, out: Path, classes: str | None, ground: str, range_: str | None, **options: Any) -> None:
    """Crop the labelled objects of real LiDAR sweeps to a dataset of single-object clouds.

    SOURCE is the folder of KITTI's object benchmark, Argoverse 2, nuScenes, or Sydney Urban Objects; or a table of
    boxes, .csv or .json, of your own scans. A table has a row per box: file (PLY, PCD, .bin, .npy, .npz), label, x, y,
    z (the centre), length, width, height in metres, yaw in degrees.

    \b
    Writes into --out:
      CLASS/SWEEP-NUMBER.ply   the clouds: x, y, z in metres
      objects.csv              of each cloud: class, label, sweep, range, direction of the sensor, points, box

    `view`, `train`, `evaluate` and `zo.torch.CloudDataset` read the folder. Objects that were cropped before from
    nearly the same place (--distinct), such as a parked car while the sensor stands, are left out.

    \b
    Examples:
      zbuf-occlude crop KITTI --classes car=Car+Van,pedestrian=Pedestrian,cyclist=Cyclist --out crops
      zbuf-occlude crop nuScenes --classes car=vehicle.car,bus=vehicle.bus.* --range 5..50 --out near
      zbuf-occlude crop boxes.csv --ground 0.15 --frame sensor --out mine
    """
    from tqdm.contrib.logging import logging_redirect_tqdm  # late: help needs none

    with progress_bar(1, "sweeps", "crop") as bar, logging_redirect_tqdm():

        def progress(done: int, total: int) -> None:
            bar.total = total
            bar.update(done - bar.n)

        found = crop_objects(
            source,
            out,
            classes=None if classes is None else parse_classes(classes),
            ground=parse_ground(ground),
            range=None if range_ is None else span_of("--range", range_),
            progress=progress,
            **options,
        )
    for line in format_counts(found):
        echo(line)
    echo(f"crops    {out / OBJECTS}")
    if found.failures:
        reasons = "\n  ".join(found.failures)
        echo(f"{counted(len(found.failures), 'sweep')} could not be read:\n  {reasons}", err=True)
        raise click.exceptions.Exit(SOME_FAILED)


def parse_classes(text: str) -> dict[str, list[str]]:
    """Return the labels of each class from ``CLASS=LABEL+LABEL,...``; a word alone is a class and its label."""
    found: dict[str, list[str]] = {}
    for part in text.split(","):
        name, equals, labels = (word.strip() for word in part.partition("="))
        if name in found:
            raise OptionError(f"--classes must have each class once; {name!r} is there twice. Join its labels by +.")
        found[name] = [label.strip() for label in (labels if equals else name).split("+")]
    return found


def parse_ground(text: str) -> Ground:
    """Return the value of --ground."""
    if text == FIT:
        return FIT
    if text == "none":
        return None
    try:
        return float(text)
    except ValueError:
        raise OptionError(f"--ground must be fit, none or a number of metres; got {text!r}.") from None


def format_counts(crops: Crops) -> list[str]:
    """Return lines with the crops of each class and range, and with what was left out."""
    ranges, counts = crops.counts()
    sums = [sum(column) for column in zip(*counts.values(), strict=True)]
    rows = [(name, *row, sum(row)) for name, row in counts.items()]
    rows += [(counted(len(counts), "class", "classes"), *sums, sum(sums))] if len(counts) > 1 else []
    width = max(len("class"), *(len(str(row[0])) for row in rows))
    lines = [
        f"{name!s:{width}}" + "".join(f"{value:>10}" for value in values)
        for name, *values in [("class", *ranges, "all"), *rows]
    ]
    lines.append(f"{counted(len(crops), 'crop')} of {counted(crops.n_sweeps, 'sweep')} ({crops.layout})")
    return [*lines, f"left out: {crops.reasons}"] if crops.reasons else lines
