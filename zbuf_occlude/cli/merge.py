"""`zbuf-occlude merge`: the final files of a dataset whose shards were made by several machines."""

from pathlib import Path

import click

from zbuf_occlude.cli.summary import SOME_FAILED, summary
from zbuf_occlude.dataset.folder import read_manifest, read_plan
from zbuf_occlude.dataset.generate import merge as merge_shards


@click.command()
@click.argument("folder", type=click.Path(path_type=Path), metavar="DIR")
def command(folder: Path) -> None:
    """Write the final files, the picture and the manifest of DIR, when all its shards are done.

    `zbuf-occlude generate` without --shard does this itself.
    """
    document = read_manifest(folder) or merge_shards(read_plan(folder), folder, {})
    click.echo(summary(document, folder))
    if document["failures"]:
        raise SystemExit(SOME_FAILED)
