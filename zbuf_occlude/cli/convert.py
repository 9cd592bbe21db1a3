"""`zbuf-occlude convert`: a dataset in another format."""

from pathlib import Path
from typing import Any

import click
from tqdm import tqdm

from zbuf_occlude.cli.echo import echo
from zbuf_occlude.cli.engine import ENGINE, engine_options
from zbuf_occlude.cli.options import OutFolder, given
from zbuf_occlude.dataset.export import convert
from zbuf_occlude.dataset.formats import FORMATS, find_format
from zbuf_occlude.dataset.source import open_dataset


@click.command()
@click.argument("folder", type=click.Path(path_type=Path), metavar="DIR")
@click.option(
    "--format",
    "format",
    required=True,
    type=click.Choice([row.name for row in FORMATS]),
    help="; ".join(f"{row.name}: {row.summary}" for row in FORMATS) + ".",
)
@click.option("--out", required=True, type=OutFolder(), help="Folder of the new dataset.")
@engine_options
@click.pass_context
def command(context: click.Context, /, folder: Path, format: str, out: Path, **options: Any) -> None:
    """Write the clouds of the complete dataset in DIR in another format: the same clouds in the same order.

    From `packed` they are drawn as `generate` would have drawn them, rounded to the packed step. Nothing converts to
    `packed`: it needs all points of the objects; make it with `generate --format packed`. The same command again goes
    on with what is missing.
    """
    if idle := given(context, ENGINE):
        echo(f"{idle[0]} is not needed: one process converts", err=True)
    source = open_dataset(folder)
    for remark in find_format(format).select(source.plan.meshes).remarks:
        echo(remark, err=True)
    total = sum(source.n_clouds.values())
    # shown with the first clouds, after all that may refuse
    with tqdm(total=total, unit=" clouds", desc="convert", smoothing=0.05, delay=1e-3, mininterval=0) as bar:
        document = convert(folder, out, format, progress=bar.update)
    clouds = ", ".join(f"{split}: {n}" for split, n in document["counts"]["clouds_by_split"].items())
    n_clouds = sum(document["counts"]["clouds_by_split"].values())
    echo(f"{n_clouds} clouds ({clouds}) from {folder} ({document['converted_from']['format']}) to {out} ({format})")
