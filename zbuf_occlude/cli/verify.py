"""`zbuf-occlude verify`: is a finished dataset what its manifest says?"""

from pathlib import Path
from typing import Any

import click

from zbuf_occlude.cli.echo import echo, progress_bar
from zbuf_occlude.cli.engine import engine_options, pop_engine, shard_option, share_of
from zbuf_occlude.cli.options import MeshPlace, up_option
from zbuf_occlude.cli.panels import Command
from zbuf_occlude.dataset.folder import datasets_in, read_finished
from zbuf_occlude.dataset.verify import verify
from zbuf_occlude.limits import Limits
from zbuf_occlude.meshes.collection import MeshCollection
from zbuf_occlude.workers import Run


@click.command(cls=Command)
@click.argument("folder", type=click.Path(path_type=Path), metavar="DIR")
@click.argument("meshes", nargs=-1, type=MeshPlace(), metavar="[MESH_OR_DIR]...")
@up_option
@click.option("--samples", type=click.IntRange(1), default=50, show_default=True, help="Clouds to ask of the oracle.")
@engine_options
@shard_option("Look only at this machine's share of the files, I from 0.")
@click.pass_context
def command(
    context: click.Context,
    /,
    folder: Path,
    meshes: tuple[Path, ...],
    up: str | None,
    samples: int,
    shard: str | None,
    **options: Any,
) -> None:
    """Verify the finished dataset in DIR: checksums, counts, readability; and ask some clouds again of the oracle.

    For the oracle give the meshes the dataset was made of; built-in shapes are known. Complete clouds that
    a preset put beside it are verified too. Exit code 1 when something is not sound.

    \b
    Example:
      zbuf-occlude verify modelnet40-occluded ModelNet40
    """
    run, share = pop_engine(context, options, Limits()), share_of(shard)
    sound = [check(each, meshes, up, samples, run, share) for each in datasets_in(folder)]
    if not all(sound):
        raise SystemExit(1)


def check(
    folder: Path, meshes: tuple[Path, ...], up: str | None, samples: int, run: Run, share: tuple[int, int]
) -> bool:
    """Verify one folder and say what was found; True when it is sound."""
    plan, manifest = read_finished(folder)
    collection = None
    if plan.recipe.complete:
        echo("complete clouds: nothing to ask of the oracle")
    elif meshes:
        collection = MeshCollection.from_paths(meshes, up=up)
    elif all(entry.key.startswith("builtin/") for entry in plan.meshes):
        from zbuf_occlude import shapes  # late: only needed without files

        collection = shapes.collection()
    echo(folder)
    with progress_bar(sum(manifest["counts"]["clouds_by_split"].values()), "clouds", "verify") as bar:
        verdict = verify(folder, collection, n_samples=samples, run=run, share=share, progress=bar.update)
    echo(f"{verdict.n_files} files, {verdict.n_clouds} clouds read")
    if verdict.false_visible is not None:
        echo(f"{verdict.n_checked} points asked of the oracle: {verdict.false_visible:.3%} are hidden")
    elif plan.recipe.setup is not None and verdict.n_checked:
        same = "not all the same" if verdict.faults else "the same"
        echo(f"{verdict.n_checked} points scanned again: {same}")
    elif collection is None and not plan.recipe.complete:
        echo("not asked of the oracle: give the meshes the dataset was made of")
    for fault in verdict.faults:
        echo(f"fault: {fault}", err=True)
    if verdict.faults:
        echo("faults found. Copy those files from where they were made, or make the dataset again, with --overwrite")
    else:
        echo("the dataset is what its manifest says")
    return not verdict.faults
