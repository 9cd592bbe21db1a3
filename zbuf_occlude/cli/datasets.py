"""Commands on a dataset that `generate` has made or begun: `status`, `merge`, `verify`, `convert`, `show`."""

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import click

from zbuf_occlude.base.limits import Limits
from zbuf_occlude.cli.messages import picture, what_was_made
from zbuf_occlude.cli.paper import derived, replaced
from zbuf_occlude.cli.shared_options import (
    ENGINE,
    MeshPlace,
    OutFolder,
    engine_options,
    explicitly_set,
    pop_engine,
    shard_option,
    share_of,
)
from zbuf_occlude.cli.shell import SOME_FAILED, Command, Name, echo, progress_bar
from zbuf_occlude.datasets.export import convert
from zbuf_occlude.datasets.folder import CONTACT_SHEET, GALLERY, datasets_in, read_finished, read_manifest, read_plan
from zbuf_occlude.datasets.formats import FORMATS, find_format
from zbuf_occlude.datasets.gallery import write_contact_sheet, write_gallery
from zbuf_occlude.datasets.generate import merge, progress_of
from zbuf_occlude.datasets.source import open_dataset
from zbuf_occlude.datasets.verify import verify
from zbuf_occlude.datasets.workers import Run
from zbuf_occlude.geometry.mesh import UNITS
from zbuf_occlude.meshes.collection import MeshCollection
from zbuf_occlude.meshes.shapes.built_in import collection_of
from zbuf_occlude.studies.paper.tables import table_2


@click.command(cls=Command)
@click.argument("folder", type=click.Path(path_type=Path), metavar="DIR")
@click.option("--json", "as_json", is_flag=True, help="As JSON, for programs.")
def status_command(folder: Path, as_json: bool) -> None:
    """Show the progress of the dataset in DIR: shards done, clouds, failures, time left at the speed so far.

    The complete clouds of a preset are reported too.
    """
    first, *others = reports = [{"folder": str(each)} | gather(each) for each in datasets_in(folder)]
    if as_json:
        echo(json.dumps(first | {"others": others}, indent=2))
        return
    for report in reports:
        tell(report)


def tell(report: dict[str, Any]) -> None:
    """Print one report."""
    echo(f"folder      {report['folder']}")
    echo(f"plan        {report['fingerprint']}: {report['clouds_planned']} clouds by {report['method']}")
    echo(f"shards      {report['shards_done']} of {report['shards']} done")
    for what, fault in report["to_make_again"].items():
        echo(f"again       {what}: {fault}")
    echo(f"clouds      {report['clouds']}")
    if report["worker_seconds_left"]:
        echo(f"left        about {report['worker_seconds_left']:.0f} seconds of one worker")
    for key, reason in report["failures"].items():
        echo(f"failed      {key}: {reason}")
    state = "complete" if report["complete"] else "not complete; the same command resumes it"
    if not report["complete"] and report["shards_done"] == report["shards"]:
        state = f"not complete; all shards are made: zbuf-occlude merge {report['folder']}"
    echo(f"state       {state}")


def gather(folder: Path) -> dict[str, Any]:
    """Return the state of a dataset as plain data."""
    plan, manifest = read_plan(folder), read_manifest(folder)
    report: dict[str, Any] = {
        "fingerprint": plan.fingerprint,
        "method": "none, complete" if plan.config.complete else plan.config.method,
        "clouds_planned": plan.n_clouds,
        "shards": len(plan.shards),
        "complete": manifest is not None,
    }
    if manifest is None:
        return report | progress_of(plan, folder)
    return report | {
        "shards_done": len(plan.shards),
        "clouds": manifest["counts"]["clouds"],
        "failures": manifest["failures"],
        "to_make_again": {},
        "worker_seconds_left": 0.0,
    }


@click.command(cls=Command)
@click.argument("folder", type=click.Path(path_type=Path), metavar="DIR")
@engine_options
@shard_option("Not needed: `generate --shard` has written the files.")
@click.pass_context
def merge_command(context: click.Context, /, folder: Path, **options: Any) -> None:
    """Finish DIR when all shares of it are made: lists of files, picture and manifest.

    `zbuf-occlude generate --shard I/N` writes the files of its shards itself; nothing is merged. The complete clouds
    that a preset makes too are finished as well. The files of a published layout (`--format pcn`) are exported.

    `zbuf-occlude generate` without --shard does this itself.

    \b
    Example:
      zbuf-occlude merge modelnet40-occluded
    """
    if idle := explicitly_set(context, (*ENGINE, "shard")):
        echo(f"{idle[0]} is not needed: generate --shard has written the files already", err=True)
    failed = False
    for each in datasets_in(folder):
        document = read_manifest(each) or merge(read_plan(each), each)
        echo(what_was_made(document, each))
        failed |= bool(document["failures"])
    if failed:
        raise SystemExit(SOME_FAILED)


@click.command(cls=Command)
@click.argument("folder", type=click.Path(path_type=Path), metavar="DIR")
@click.argument("meshes", nargs=-1, type=MeshPlace(), metavar="[MESH_OR_DIR]...")
@click.option("--up", type=Name(["z", "y"]), help="Up axis of the files.  [default: as the dataset was made]")
@click.option("--unit", type=Name(list(UNITS)), help="Unit of the files.  [default: as the dataset was made]")
@click.option("--samples", type=click.IntRange(1), default=50, help="Number of clouds compared with their meshes.")
@engine_options
@shard_option("Look only at this machine's share of the files, I from 0.")
@click.pass_context
def verify_command(
    context: click.Context,
    /,
    folder: Path,
    meshes: tuple[Path, ...],
    up: str | None,
    unit: str | None,
    samples: int,
    shard: tuple[int, int] | None,
    **options: Any,
) -> None:
    """Verify the finished dataset in DIR: checksums, counts, readability; and some clouds against their meshes.

    Give the meshes the dataset was made of; built-in shapes are known. Their classes and splits are those that it was
    made with. The oracle tests points of occluded clouds, scans are made again, complete clouds must cover the surface.
    Complete clouds that a preset made are verified too. Exit code 1 when a fault is found.

    \b
    Example:
      zbuf-occlude verify modelnet40-occluded ModelNet40
    """
    run, share = pop_engine(context, options, Limits()), share_of(shard)
    sound = [check(each, meshes, (up, unit), samples, run, share) for each in datasets_in(folder)]
    if not all(sound):
        raise SystemExit(1)


def check(
    folder: Path,
    meshes: tuple[Path, ...],
    frame: tuple[str | None, str | None],
    samples: int,
    run: Run,
    share: tuple[int, int],
) -> bool:
    """Verify one folder and print the findings; return True without faults. `frame` is the meshes' axis and unit."""
    plan, _ = read_finished(folder)
    collection = None
    if meshes:
        has_windows = plan.config.scan is not None and bool(plan.config.scan.transparent)
        up = frame[0] or _of_all(entry.up for entry in plan.meshes)
        unit = frame[1] or _of_all(entry.unit for entry in plan.meshes)
        collection = MeshCollection.from_paths(meshes, up=up, unit=unit, colors=has_windows)
    else:
        collection = collection_of(entry.key for entry in plan.meshes)
    echo(folder)
    with progress_bar(0, "files", "verify") as bar:

        def show(done: int, of: int) -> None:
            bar.total = of
            bar.update(done - bar.n)

        verdict = verify(folder, collection, n_samples=samples, run=run, share=share, progress=show)
    echo(f"{verdict.n_files} files, " + (f"{verdict.n_clouds} clouds read" if verdict.n_clouds else "checksums read"))
    if verdict.false_visible is not None:
        echo(f"{verdict.n_checked} points tested by the oracle: {verdict.false_visible:.3%} are hidden")
    elif plan.config.complete and verdict.n_checked:
        spread = "not all on the surface, or not all over it" if verdict.faults else "on the surface, and all over it"
        echo(f"{verdict.n_checked} points of complete clouds: {spread}")
    elif plan.config.scan is not None and verdict.n_checked:
        same = "not all the same" if verdict.faults else "the same"
        echo(f"{verdict.n_checked} points scanned again: {same}")
    elif collection is None:
        echo("not compared with the meshes: give those the dataset was made of")
    for fault in verdict.faults:
        echo(f"fault: {fault}", err=True)
    if verdict.is_of_other_meshes:
        echo("not compared with the meshes: those given are others")
    elif verdict.faults:
        echo("faults found. Copy those files from where they were made, or make the dataset again, with --overwrite")
    else:
        echo("the dataset is what its manifest says")
    return not verdict.faults


def _of_all(values: Iterable[str]) -> str | None:
    """Return the value that all have; None where they differ, or have none."""
    found = set(values)
    return found.pop() or None if len(found) == 1 else None


@click.command(cls=Command)
@click.argument("folder", type=click.Path(path_type=Path), metavar="DIR")
@click.option(
    "--format", "format", required=True, type=Name([row.name for row in FORMATS]), help="Files of the new dataset."
)
@click.option("--out", required=True, type=OutFolder(), help="Folder of the new dataset.")
@engine_options
@click.pass_context
def convert_command(context: click.Context, /, folder: Path, format: str, out: Path, **options: Any) -> None:
    """Write the clouds of the complete dataset in DIR in another format: the same clouds in the same order.

    From `packed` they are drawn as `generate` would have drawn them, rounded to the packed step. Nothing converts to
    `packed`: it needs all points of the objects; make it with `generate --format packed`. The same command again
    resumes.
    """
    if idle := explicitly_set(context, ENGINE):
        echo(f"{idle[0]} is not needed: one process converts", err=True)
    source = open_dataset(folder)
    for remark in find_format(format).choose_meshes(source.plan.meshes).remarks:
        echo(remark, err=True)
    total = sum(source.n_clouds.values())
    with progress_bar(total, "clouds", "convert") as bar:
        document = convert(folder, out, format, progress=bar.update)
    counts = document["counts"]
    clouds = ", ".join(f"{split}: {n}" for split, n in counts["clouds_by_split"].items())
    before = document["converted_from"]["format"]
    echo(f"{counts['clouds']} clouds ({clouds}) from {folder} ({before}) to {out} ({format})")


@click.command(cls=Command)
@click.argument("folder", type=click.Path(path_type=Path), metavar="DIR")
@click.option("--out", type=OutFolder(), help="Folder of the pictures.  [default: DIR]")
@click.option("--table2", is_flag=True, help="Now `zbuf-occlude paper table2 DIR`.")
def show_command(folder: Path, out: Path | None, table2: bool) -> None:
    """Draw the complete dataset in DIR.

    \b
    Writes into --out:
      gallery.html        classes x views, every cloud to be turned by hand; one file, needs nothing else
      contact_sheet.png   a cloud of each class, from a fixed viewpoint and from its camera's

    Of pairs (packed, pcn, completion3d, mvp, epn3d, projected-shapenet) both have the complete cloud too.
    """
    if table2:
        replaced("show DIR --table2", "paper table2 DIR")
        print_table_2("table2", folder)
        return
    out = folder if out is None else out
    _, manifest = read_finished(folder)
    out.mkdir(parents=True, exist_ok=True)
    source = open_dataset(folder, to_show=True)
    write_gallery(out / GALLERY, source, manifest, folder)
    write_contact_sheet(out / CONTACT_SHEET, source)
    echo(f"gallery  {out / GALLERY}\npicture  {picture(out / CONTACT_SHEET)}")


def table2_command(name: str) -> click.Command:
    """Return the command that prints Table 2."""
    return derived(
        show_command, name, {"folder"}, print_table_2, "Print the paper's Table 2 with the row of a dataset."
    )


def print_table_2(name: str, folder: Path) -> None:
    """Print Table 2 as Markdown that also reads as plain text."""
    echo(table_2(folder).as_markdown(aligned=True).rstrip("\n"))
