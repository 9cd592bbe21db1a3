"""`zbuf-occlude merge`: the final files of a dataset whose shards were made by several machines."""

from pathlib import Path
from typing import Any

import click
from tqdm import tqdm
from tqdm.contrib.logging import logging_redirect_tqdm

from zbuf_occlude.cli.echo import echo
from zbuf_occlude.cli.engine import engine_options, pop_engine, shard_option, share_of
from zbuf_occlude.cli.summary import SOME_FAILED, summary
from zbuf_occlude.dataset.folder import datasets_in, read_manifest, read_plan
from zbuf_occlude.dataset.generate import merge
from zbuf_occlude.dataset.jobs import n_parts_written
from zbuf_occlude.dataset.parts import n_parts
from zbuf_occlude.limits import Limits


@click.command()
@click.argument("folder", type=click.Path(path_type=Path), metavar="DIR")
@engine_options
@shard_option("Write only this machine's share of the files, I from 0; whoever writes the last completes the dataset.")
@click.pass_context
def command(context: click.Context, /, folder: Path, shard: str | None, **options: Any) -> None:
    """Write the final files, the picture and the manifest of DIR, when all its shards are done.

    Likewise of the complete clouds that a preset puts beside them. What is in files is cut off the shards, so that
    the disk holds little more than the dataset. The same command again goes on with what is missing.

    `zbuf-occlude generate` without --shard does this itself.

    \b
    Example, on each of four machines:
      zbuf-occlude merge modelnet40-occluded --shard 0/4        (1/4, 2/4, 3/4)
    """
    run, share = pop_engine(context, options, Limits()), share_of(shard)
    failed = False
    for each in datasets_in(folder):
        document = read_manifest(each)
        if document is None:
            plan = read_plan(each)
            n_mine = (share[0] + 1) * n_parts(plan) // share[1] - share[0] * n_parts(plan) // share[1]
            bar = tqdm(total=n_mine, unit=" parts", desc="merge", disable=not n_mine)
            with bar, logging_redirect_tqdm():
                document = merge(plan, each, run=run, share=share, progress=bar.update)
            if not document:
                echo(f"{n_parts_written(plan, each)} of {n_parts(plan)} parts of {each} are written")
                continue
        echo(summary(document, each))
        failed |= bool(document["failures"])
    if failed:
        raise SystemExit(SOME_FAILED)
