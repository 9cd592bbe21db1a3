"""`zbuf-occlude merge`: finish a dataset whose groups were made by several machines."""

from pathlib import Path
from typing import Any

import click

from zbuf_occlude.cli.echo import echo
from zbuf_occlude.cli.engine import ENGINE, engine_options, shard_option
from zbuf_occlude.cli.options import given
from zbuf_occlude.cli.panels import Command
from zbuf_occlude.cli.summary import SOME_FAILED, summary
from zbuf_occlude.dataset.folder import datasets_in, read_manifest, read_plan
from zbuf_occlude.dataset.generate import merge


@click.command(cls=Command)
@click.argument("folder", type=click.Path(path_type=Path), metavar="DIR")
@engine_options
@shard_option("Not needed: `generate --shard` has written the files.")
@click.pass_context
def command(context: click.Context, /, folder: Path, **options: Any) -> None:
    """Finish DIR when all shares of it are made: lists of files, picture and manifest.

    `zbuf-occlude generate --shard I/N` writes the files of its groups itself; nothing is merged. The complete clouds
    that a preset makes beside are finished too. Of a layout of others (`--format pcn`) this exports the files.

    `zbuf-occlude generate` without --shard does this itself.

    \b
    Example:
      zbuf-occlude merge modelnet40-occluded
    """
    if idle := given(context, (*ENGINE, "shard")):
        echo(f"{idle[0]} is not needed: generate --shard has written the files already", err=True)
    failed = False
    for each in datasets_in(folder):
        document = read_manifest(each) or merge(read_plan(each), each)
        echo(summary(document, each))
        failed |= bool(document["failures"])
    if failed:
        raise SystemExit(SOME_FAILED)
