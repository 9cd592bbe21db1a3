"""`zbuf-occlude merge`: the final files of a dataset whose shards were made by several machines."""

from pathlib import Path

import click

from zbuf_occlude.cli.echo import echo
from zbuf_occlude.cli.summary import SOME_FAILED, summary
from zbuf_occlude.dataset.folder import datasets_in, read_manifest, read_plan
from zbuf_occlude.dataset.generate import merge as merge_shards


@click.command()
@click.argument("folder", type=click.Path(path_type=Path), metavar="DIR")
def command(folder: Path) -> None:
    """Write the final files, the picture and the manifest of DIR, when all its shards are done.

    Likewise of the complete clouds that a preset puts beside them.

    `zbuf-occlude generate` without --shard does this itself.
    """
    failed = False
    for each in datasets_in(folder):
        document = read_manifest(each) or merge_shards(read_plan(each), each, {})
        echo(summary(document, each))
        failed |= bool(document["failures"])
    if failed:
        raise SystemExit(SOME_FAILED)
