"""`zbuf-occlude generate`: a dataset of occluded point clouds, from mesh files or from the built-in shapes."""

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

import click
from click.core import ParameterSource

from zbuf_occlude.base.errors import GlError, OccludeError, UnavailableError
from zbuf_occlude.base.jit.compiler import announce
from zbuf_occlude.base.limits import Limits
from zbuf_occlude.cli.config_file import COMMAND, ConfigurableCommand, config_option
from zbuf_occlude.cli.file_frames import lengths_of, taken_as, warn_of_lying
from zbuf_occlude.cli.messages import check_folder, costs, format_plan, missing_splits, overview, what_was_made
from zbuf_occlude.cli.scan_options import (
    OF_SCANS,
    are_shapes_in_metres,
    check_sizes,
    overruled,
    pop_scan_options,
    scan_options,
)
from zbuf_occlude.cli.shared_options import (
    VIEWS,
    MeshPlace,
    OutFolder,
    Settings,
    choice_options,
    chosen_method,
    collect,
    distance_option,
    engine_options,
    explicitly_set,
    finite,
    frame_options,
    method_options,
    parse_settings,
    pop_engine,
    sample_size,
    shard_option,
    share_of,
    shares_of_splits,
    with_option,
)
from zbuf_occlude.cli.shell import COMPILING, SOME_FAILED, Name, echo, progress_bar
from zbuf_occlude.datasets.auto import AUTO, Choice, resolve
from zbuf_occlude.datasets.folder import ORIGINAL, claim_folder
from zbuf_occlude.datasets.formats import FORMATS, Format, find_format
from zbuf_occlude.datasets.generate import generate, progress_of
from zbuf_occlude.datasets.plan import FRAMES, SCALES, SUBSETS, DatasetConfig, Plan
from zbuf_occlude.datasets.presets import PRESETS, Preset, find_preset, plan_of_originals
from zbuf_occlude.datasets.rehearsal import (
    is_warm,
    n_functions,
    needs_no_check,
    precompile_job,
    smoke_test,
    warm_up_jit,
)
from zbuf_occlude.datasets.workers import Done, Run, Task
from zbuf_occlude.meshes.collection import MeshCollection
from zbuf_occlude.meshes.shapes.built_in import BUILT_IN
from zbuf_occlude.sensors.scan_config import LEAST_POINTS, SURFACE, ScanConfig, span_of
from zbuf_occlude.views.model import AXES
from zbuf_occlude.visibility import find_method

LIMIT = "Limit of a mesh; one that exceeds it is skipped and reported."
OF_MESHES = ("limit", "unit", "shapes", "labels", "classes", "splits")
"""Options that say which meshes are taken and how they are read: arguments of `collect`."""


def use_preset(context: click.Context, parameter: click.Parameter, name: str | None) -> str | None:
    """Make a preset's options the defaults of all others, which are parsed later."""
    if name is not None:
        context.default_map = {**(context.default_map or {}), **find_preset(name).options}
    return name


def use_format(context: click.Context, parameter: click.Parameter, name: str) -> str:
    """Make the defaults of a format those of all other options; a preset has precedence."""
    context.default_map = {**find_format(name).options, **(context.default_map or {})}
    return name


@click.command(cls=ConfigurableCommand)
@config_option
@click.argument("meshes", nargs=-1, type=MeshPlace(), metavar="[MESH_OR_DIR]...")
@click.option("--out", type=OutFolder(), default=Path("occluded"), help="Folder of the dataset.")
@click.option(
    "--shapes",
    type=Name([row.name for row in BUILT_IN]),
    default=BUILT_IN[0].name,
    help="Without MESH_OR_DIR: what `zbuf-occlude shapes` lists.",
)
@click.option(
    "--preset",
    type=Name([row.name for row in PRESETS]),
    is_eager=True,
    callback=use_preset,
    help="Defaults of a published dataset; other options override them.",
)
@method_options(also=(AUTO,))
@scan_options(SURFACE)
@click.option(
    "--least-points",
    type=click.IntRange(0),
    metavar="N",
    help=f"Scans of fewer distinct points are left out; 0: none.  [default: {LEAST_POINTS}]",
)
@click.option("--views", default="modelnet8", help=VIEWS)
@distance_option
@click.option("--points", type=click.IntRange(1), help="Points sampled on each object.  [default: 20000]")
@click.option("--density", type=float, help="Instead of --points: points per area, the longest side taken as 1.")
@click.option("--variations", type=click.IntRange(1), default=1, help="Samplings of each object.")
@click.option(
    "--sample-size",
    type=sample_size,
    metavar="N|all",
    default="2048",
    help="Points kept in each cloud; all: every visible one.",
)
@click.option("--complete", is_flag=True, help="Complete clouds: points of the whole surface, whatever the views see.")
@click.option(
    "--subset",
    type=Name(SUBSETS),
    default="random",
    help="Which visible points are kept; fps: farthest-point sampling.",
)
@click.option(
    "--format",
    "format",
    type=Name([row.name for row in FORMATS]),
    default="hdf5",
    is_eager=True,
    callback=use_format,
    help="Files of the dataset.",
)
@click.option(
    "--overlap", metavar="A..B", help="Range of the share of a view that the other sees too; for --format pairs."
)
@click.option(
    "--depth-unit",
    type=float,
    metavar="M",
    help="Metres per step of all depth images, such as 0.001; for --format frames and bop.  [default: the finest]",
)
@click.option("--seed", type=click.IntRange(0), default=0, help="Seed of all random draws.")
@click.option("--limit", type=click.IntRange(1), metavar="N", help="Only the first N meshes (classes interleaved).")
@click.option(
    "--scale",
    type=Name(SCALES),
    default="cloud",
    help="Longest side 1 of each cloud, or of the object; metres: clouds centred, of true size; mesh: as it is.",
)
@click.option(
    "--frame",
    type=Name(FRAMES),
    default="object",
    help="Frame: the object's, z up in published layouts too, or the camera's.",
)
@click.option(
    "--axes",
    type=Name(AXES),
    default="opengl",
    help="Axes of --frame camera: x right, y up, looking along -z; opencv: y down, along z.",
)
@with_option("Attributes of the points: normals towards the camera, base colours; boxes: of whole LiDAR scans.")
@frame_options
@choice_options
@click.option(
    "--split",
    type=shares_of_splits,
    metavar="TRAIN,VAL,TEST",
    help="Shares of splits, such as 0.8,0.1,0.1, for meshes without any; each mesh is drawn by its key and the seed, "
    "so shares are met roughly.",
)
@engine_options
@click.option("--mesh-seconds", type=click.FloatRange(0, min_open=True), default=600.0, callback=finite, help=LIMIT)
@click.option("--mesh-gigabytes", type=click.FloatRange(0, min_open=True), default=8.0, callback=finite, help=LIMIT)
@shard_option("Only this machine's share, I from 0; then `zbuf-occlude merge`.")
@click.option("--require-gpu", is_flag=True, help="Refuse to render in software.")
@click.option("--retry-failed", is_flag=True, help="Make meshes that failed in an earlier run again.")
@click.option("--overwrite", is_flag=True, help="Replace a dataset in the folder.")
@click.option("--dry-run", is_flag=True, help="Report what would be made, with the disk space and time it would take.")
@click.pass_context
def generate_command(
    context: click.Context,
    /,
    meshes: tuple[Path, ...],
    out: Path,
    preset: str | None,
    method: str,
    settings: Settings,
    format: str,
    up: str | None,
    mesh_seconds: float,
    mesh_gigabytes: float,
    shard: tuple[int, int] | None,
    require_gpu: bool,
    retry_failed: bool,
    overwrite: bool,
    dry_run: bool,
    complete: bool,
    **options: Any,
) -> None:
    """Make a dataset of occluded point clouds.

    MESH_OR_DIR: mesh files (OFF, OBJ, PLY, STL, glTF), class folders, or folders and ZIP archives as published of
    ModelNet, ShapeNetCore, Objaverse, 3D-FUTURE, ABC, Thingi10K. What was understood, classes and splits, is shown
    before it begins. Without any, the built-in shapes: eight classes of 75 objects (--shapes).

    \b
    Writes into --out:
      ply_data_{train,val,test}N.h5   clouds in the PointNet layout: data, label, and view, pose, scale, ids
                                      (or the files of another --format)
      manifest.json                   options, versions, counts, failures, and the measured error
      contact_sheet.png               some clouds, from a fixed viewpoint and from their camera's

    The same command again resumes. Exit code 3: done, but some meshes failed (named here and in the manifest).

    \b
    Examples:
      zbuf-occlude generate
      zbuf-occlude generate ModelNet40 --views paper100 --out modelnet40-occluded
      zbuf-occlude generate chair.off --views ring:8@30 --set resolution=1024
      zbuf-occlude generate --config mine/manifest.json --seed 1 --out other
      zbuf-occlude generate --preset paper-modelnet40 --method occupancy_grid --set n=32
      zbuf-occlude generate ModelNet40 --method auto --format packed --out exact
      zbuf-occlude generate objaverse/glbs --with normals,colors --out coloured
      zbuf-occlude generate --sensor hdl-64e --range 5..50 --scene street --hidden 0..0.5 --views ring:8@0 --out streets
      zbuf-occlude generate --shapes road-users --sensor hdl-64e --range 5..50@area --views drive:8 --scale metres
      zbuf-occlude generate --shapes road-users --complete --views drive:8 --scale metres --out complete
    """
    refuse_typed(context, ("shapes",) if meshes else ("up", "unit"), f"{'without' if meshes else 'with'} MESH_OR_DIR")
    run = pop_engine(context, options, Limits(mesh_seconds, mesh_gigabytes))
    row = find_format(format)
    if complete:
        refuse_typed(context, ("method", "settings"), "without --complete: nothing is hidden")
        refuse_typed(context, OF_SCANS, "without --complete: nothing is scanned")
    complete = complete or row.complete
    scan = pop_scan_options(context, options, sampled=row.keeps_points or complete)
    if scan is not None and complete:
        echo("complete clouds: whole objects as they stand before the sensor; nothing is scanned", err=True)
    fields = config_fields(context, options, row, scan)
    choice = choose_method(context, method, settings, scan, complete=complete, require_gpu=require_gpu)
    wanted = None if preset is None else find_preset(preset)
    collection, read_as = collect_meshes(context, row, wanted, scan)
    plan = make_plan(context, collection, row, choice, settings, complete=complete, scan=scan, **fields)
    if require_gpu:
        check_renders(plan, choice.method)
    plans = [(plan, out)]
    if wanted is not None and wanted.original and not complete:
        plans.append((plan_of_originals(plan), out / ORIGINAL))
    if dry_run:
        warn_of_lying(collection, up)
        report_plans(plans, overwrite, require_gpu)
        return
    if not needs_no_check(plan.config):
        smoke_test(plan.config, require_gpu)
    is_cold = not is_warm(plan.config)
    if is_cold:
        announce()
        COMPILING.total = n_functions(plan.config)
        precompile_job(plan.config)
    warn_of_lying(collection, up)  # loads meshes, while the second process compiles
    if is_cold:
        warm_up_jit(plan.config)
    share = share_of(shard)
    failed = [make_dataset(*each, run, share, read_as, overwrite, retry_failed, plans[1:]) for each in plans]
    if any(failed):
        raise SystemExit(SOME_FAILED)


def refuse_typed(context: click.Context, names: Collection[str], how: str) -> None:
    """Raise UsageError for options that were typed; `how` says with or without what they must go."""
    if idle := explicitly_set(context, names):
        raise click.UsageError(f"{idle[0]} must go {how}. Leave it out.")


def config_fields(
    context: click.Context, options: Mapping[str, Any], row: Format, scan: ScanConfig | None
) -> dict[str, Any]:
    """Return options as fields of a `DatasetConfig`; UsageError for those that exclude each other or need another."""
    fields = {name: value for name, value in options.items() if name not in OF_MESHES}
    if fields["scale"] == "metres" and scan is None and options["unit"] is None and not are_shapes_in_metres(context):
        raise click.UsageError("--scale metres needs lengths in metres: give --unit of the files, or --sensor.")
    fields["distance"], fields["farthest"] = fields["distance"]
    if fields["overlap"] is not None:
        if "overlap" not in row.options:
            raise click.UsageError(f"--overlap is for --format pairs; got --format {row.name}. Leave it out.")
        fields["overlap"] = span_of("--overlap", fields["overlap"])
    if fields["depth_unit"] is not None and row.name not in ("frames", "bop"):
        raise click.UsageError(f"--depth-unit is for --format frames and bop; got --format {row.name}. Leave it out.")
    points, density = fields.pop("points"), fields["density"]
    if density is not None and context.get_parameter_source("points") is ParameterSource.DEFAULT_MAP:
        points = None  # the preset's; the density was asked for
    if points is not None and density is not None:
        raise click.UsageError("--points and --density exclude each other; give one of them.")
    return {**fields, "n_points": None if density is not None else points or 20_000}


def choose_method(
    context: click.Context,
    method: str,
    settings: Settings,
    scan: ScanConfig | None,
    *,
    complete: bool,
    require_gpu: bool,
) -> Choice:
    """Return the method: that of a scan, the typed one, or the default on this machine."""
    if scan is not None:
        return Choice(scan.method, "")
    if complete:
        return Choice("exact", "")  # never asked: it needs no OpenGL
    return Choice(method, "") if require_gpu else chosen_method(context, method, settings)


def collect_meshes(
    context: click.Context, row: Format, wanted: Preset | None, scan: ScanConfig | None
) -> tuple[MeshCollection, str]:
    """Return the meshes, and a text on the frame of their files; print their overview and remarks on them.

    Raises OptionError as `check_sizes` does.
    """
    given = context.params
    up, unit, split, seed = (given[name] for name in ("up", "unit", "split", "seed"))
    choose = MeshCollection.interleaved if wanted is None else wanted.choose
    collection = collect(
        given["meshes"],
        up,
        out=given["out"],
        choose=lambda meshes: choose(row.choose_meshes(meshes)),
        colors="colors" in given["attributes"] or bool(scan and scan.transparent),
        divide=None if split is None else lambda meshes: meshes.divided(split, seed),
        **{name: given[name] for name in OF_MESHES},
    )
    read_as = taken_as(collection, up, unit, lengths_of(scan, unit))
    echo(overview(collection, row, wanted, limited=given["limit"] is not None, read_as=read_as), err=True)
    for remark in missing_splits(collection, split, given["splits"]):
        echo(remark, err=True)
    if scan is not None:
        check_sizes(scan, collection)
    return collection, read_as


def make_plan(
    context: click.Context,
    collection: MeshCollection,
    row: Format,
    choice: Choice,
    settings: Settings,
    *,
    scan: ScanConfig | None,
    **fields: Any,
) -> Plan:
    """Return the plan of a dataset with these `fields` of its `DatasetConfig`, checked for its format and cameras."""
    method = choice.method
    made = DatasetConfig(
        method=method,
        reason=choice.reason,
        method_options=parse_settings(method, settings) if method != AUTO else dict(settings),
        scan=scan,
        **fields,
    )
    plan = Plan(collection, resolve(made, collection), row.name)
    row.check(plan)
    if scan is not None:
        check_file_cameras(context, scan, plan)
    return plan


def check_renders(plan: Plan, method: str) -> None:
    """Raise an error for --require-gpu where the method does not render; `method` is as it was asked for, or `AUTO`."""
    if find_method(plan.config.method).needs_gl:
        return
    if method != AUTO:
        raise click.UsageError(f"--require-gpu must go with a method that renders; {method} does not.")
    raise GlError(f"--require-gpu needs a GPU for --method {AUTO} to choose; there is none. See `zbuf-occlude doctor`.")


def check_file_cameras(context: click.Context, scan: ScanConfig, plan: Plan) -> None:
    """Refuse ranges and intrinsics beside those of the cameras of a file; report options that do not count."""
    if plan.views.fov_bounds is not None and explicitly_set(context, ("camera",)):
        raise click.UsageError("--camera must go without --views of a file that has intrinsics. Leave one out.")
    if scan.range is not None and plan.views.rotations is not None:
        raise click.UsageError("--range must go without cameras of a file, which stand where they are. Leave it out.")
    for remark in overruled(scan, plan.views):
        echo(remark, err=True)
    if scan.range is not None and explicitly_set(context, ("distance",)):
        echo("--range says how far the sensor is: --distance does not count", err=True)


def report_plans(plans: Sequence[tuple[Plan, Path]], overwrite: bool, require_gpu: bool) -> None:
    """Report what plans would make in their folders, and what that would cost; nothing stays."""
    for each in plans:
        check_folder(*each, overwrite=overwrite)
    missing: OccludeError | None = None
    try:
        smoke_test(plans[0][0].config, require_gpu)
    except (GlError, UnavailableError) as error:  # where it is planned may not be where it is made
        missing = error
    for each in plans:
        echo(format_plan(*each))
    for plan, _ in plans if missing is None else ():
        echo(costs(plan))
    if missing is not None:
        echo(f"not on this machine: {missing}")


def make_dataset(
    plan: Plan,
    out: Path,
    run: Run,
    share: tuple[int, int],
    read_as: str,
    overwrite: bool,
    retry_failed: bool,
    beside: Sequence[tuple[Plan, Path]],
) -> bool:
    """Make one dataset, or a share of it, and report on it; return whether a mesh failed.

    Folders of datasets `beside` get their plans before the first shard is made, so that `merge` misses none of them.
    """
    from tqdm.contrib.logging import logging_redirect_tqdm  # late: help needs none

    command = click.get_current_context().meta[COMMAND]
    mine = plan.shards[share[0] :: share[1]]
    bar = progress_bar(sum(map(len, mine)) * plan.clouds_per_mesh, "clouds", "generate")

    def begun(task: Task, jobs: list[Any], done: Done) -> None:
        bar.delay = 0.0  # else what is shown now is not ended with its line
        bar.refresh()
        for each in beside:
            claim_folder(*each, command)
        run(task, jobs, done)

    with bar, logging_redirect_tqdm():
        document = generate(
            plan,
            out,
            run=begun,
            overwrite=overwrite,
            retry_failed=retry_failed,
            share=share,
            command=command,
            progress=bar.update,
        )
    if document:
        echo(what_was_made(document, out, read_as))
        return bool(document["failures"])
    done = progress_of(plan, out)["shards_done"]
    merged = out.parent if out.name == ORIGINAL else out
    echo(
        f"{len(mine)} of {len(plan.shards)} shards are this share; {done} of {out} are done. "
        f"When all are: zbuf-occlude merge {merged}"
    )
    return False
