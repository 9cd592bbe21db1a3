"""`zbuf-occlude generate`: a dataset of occluded point clouds, from mesh files or from the built-in shapes."""

import os
import shutil
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any

import click
import numpy as np
from click.core import ParameterSource
from tqdm import tqdm
from tqdm.contrib.logging import logging_redirect_tqdm

from zbuf_occlude.cli.options import (
    OutFolder,
    choice_options,
    collect,
    given,
    method_options,
    parse_settings,
    up_option,
)
from zbuf_occlude.cli.overview import overview
from zbuf_occlude.cli.summary import SOME_FAILED, counted, summary
from zbuf_occlude.dataset.auto import AUTO, resolve
from zbuf_occlude.dataset.clouds import record_type
from zbuf_occlude.dataset.folder import ORIGINAL
from zbuf_occlude.dataset.formats import FORMATS, find_format
from zbuf_occlude.dataset.generate import generate, shards_done
from zbuf_occlude.dataset.plan import FRAMES, SCALES, Plan, Recipe
from zbuf_occlude.dataset.presets import PRESETS, find_preset, plan_of_originals
from zbuf_occlude.errors import GlError, UnavailableError
from zbuf_occlude.farm import local, ray
from zbuf_occlude.farm.slurm import from_environment, parse_shard
from zbuf_occlude.farm.supervisor import Limits
from zbuf_occlude.mesh import Mesh
from zbuf_occlude.meshes.collection import MeshCollection
from zbuf_occlude.sampling import sample_surface
from zbuf_occlude.views import SPECS
from zbuf_occlude.visibility import find_method, prepare

FORMULAS = "formulas"
LIMIT = "A mesh that takes more is a failure, not the end of the run."


def use_preset(context: click.Context, parameter: click.Parameter, name: str | None) -> str | None:
    """Make a preset's options the defaults of all others, which are looked at later."""
    if name is not None:
        context.default_map = {**(context.default_map or {}), **find_preset(name).options}
    return name


def use_format(context: click.Context, parameter: click.Parameter, name: str) -> str:
    """Make what a format's loaders expect the defaults of all other options, under those of a preset."""
    context.default_map = {**find_format(name).options, **(context.default_map or {})}
    return name


@click.command()
@click.argument("meshes", nargs=-1, type=click.Path(path_type=Path), metavar="[MESH_OR_DIR]...")
@click.option("--out", type=OutFolder(), default=Path("occluded"), show_default=True, help="Folder.")
@click.option(
    "--shapes",
    type=click.Choice(["classes", FORMULAS]),
    default="classes",
    show_default=True,
    help=f"Without MESH_OR_DIR: eight classes of 75 objects, or {FORMULAS}: surfaces given by formulas (paper 4.1).",
)
@click.option(
    "--preset",
    type=click.Choice([row.name for row in PRESETS]),
    is_eager=True,
    callback=use_preset,
    help="; ".join(f"{row.name}: {row.summary}" for row in PRESETS) + ". Options given beside it override it.",
)
@method_options(also=(AUTO,))
@click.option("--views", default="modelnet8", show_default=True, help=f"Camera positions: {SPECS}.")
@click.option("--points", type=click.IntRange(1), help="Points sampled on each object before HSR.  [default: 20000]")
@click.option("--density", type=float, help="Instead of --points: points per area, the longest side taken as 1.")
@click.option("--variations", type=click.IntRange(1), default=1, show_default=True, help="Samplings of each object.")
@click.option("--sample-size", type=click.IntRange(1), default=2048, show_default=True, help="Points of each cloud.")
@click.option(
    "--format",
    "format",
    type=click.Choice([row.name for row in FORMATS]),
    default="hdf5",
    show_default=True,
    is_eager=True,
    callback=use_format,
    help="; ".join(f"{row.name}: {row.summary}" for row in FORMATS) + ".",
)
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True)
@click.option("--limit", type=click.IntRange(1), metavar="N", help="Only the first N meshes (classes interleaved).")
@click.option(
    "--scale",
    type=click.Choice(SCALES),
    default="cloud",
    show_default=True,
    help="cloud: each cloud is centred, its longest side 1 (centre and factor are stored); object: the whole object "
    "is; mesh: as in the file.",
)
@click.option(
    "--frame",
    type=click.Choice(FRAMES),
    default="object",
    show_default=True,
    help="object: the mesh's axes; camera: x right, y up, looking along -z. The pose is stored always.",
)
@up_option
@choice_options
@click.option("--workers", type=click.IntRange(1), help="Worker processes.  [default: one a core]")
@click.option(
    "--engine", type=click.Choice(["local", "ray"]), default="local", show_default=True, help="Where to work."
)
@click.option("--ray-address", help="Of a running cluster, e.g. auto.  [default: RAY_ADDRESS, or a new one here]")
@click.option(
    "--ray-gpus", type=click.FloatRange(0), default=0.0, help="GPUs of each Ray worker; 0.25: four share one."
)
@click.option("--mesh-seconds", type=click.FloatRange(0, min_open=True), default=600.0, show_default=True, help=LIMIT)
@click.option("--mesh-gigabytes", type=click.FloatRange(0, min_open=True), default=8.0, show_default=True, help=LIMIT)
@click.option(
    "--shard",
    metavar="I/N",
    help="Make only this machine's part, I from 0; then `zbuf-occlude merge`. A SLURM array task knows its own.",
)
@click.option(
    "--require-gpu", is_flag=True, help="Refuse to render in software, and, with --method auto, not to render."
)
@click.option("--overwrite", is_flag=True, help="Replace a dataset that is in the folder.")
@click.option("--dry-run", is_flag=True, help="Say what would be made, and make nothing.")
@click.pass_context
def command(
    context: click.Context,
    /,
    meshes: tuple[Path, ...],
    out: Path,
    shapes: str,
    preset: str | None,
    method: str,
    settings: tuple[str, ...],
    format: str,
    limit: int | None,
    up: str | None,
    labels: Path | None,
    classes: list[str] | None,
    splits: list[str] | None,
    workers: int | None,
    engine: str,
    ray_address: str | None,
    ray_gpus: float,
    mesh_seconds: float,
    mesh_gigabytes: float,
    shard: str | None,
    require_gpu: bool,
    overwrite: bool,
    dry_run: bool,
    **recipe: Any,
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
      zbuf-occlude generate --preset paper-modelnet40 --method occupancy_grid --set n=32
      zbuf-occlude generate ModelNet40 --method auto --format packed --out exact
    """
    idle = given(context, ("shapes",) if meshes else ("up",))
    if idle:
        raise click.UsageError(f"{idle[0]} must go {'without' if meshes else 'with'} MESH_OR_DIR. Leave it out.")
    if engine != "ray" and (idle := given(context, ("ray_address", "ray_gpus"))):
        raise click.UsageError(f"{', '.join(idle)} must go with --engine ray.")
    points, density = recipe.pop("points"), recipe.pop("density")
    if density is not None and context.get_parameter_source("points") is ParameterSource.DEFAULT_MAP:
        points = None  # the preset's; the density was asked for
    if points is not None and density is not None:
        raise click.UsageError("--points and --density exclude each other; give one of them.")
    wanted = None if preset is None else find_preset(preset)
    choose = MeshCollection.interleaved if wanted is None else wanted.choose
    collection = collect(
        meshes,
        up,
        limit,
        out=out,
        choose=choose,
        labels=labels,
        classes=classes,
        splits=splits,
        formulas=shapes == FORMULAS,
    )
    click.echo(overview(collection, wanted), err=True)
    made = Recipe(
        method=method,
        method_options=parse_settings(method, settings) if method != AUTO else dict.fromkeys(settings),
        n_points=None if density is not None else points or 20_000,
        density=density,
        complete=find_format(format).complete,
        **recipe,
    )
    plan = Plan(collection, resolve(made, collection), format)
    find_format(format).check(plan)
    if require_gpu and not find_method(plan.recipe.method).needs_gl:
        if method != AUTO:
            raise click.UsageError(f"--require-gpu must go with a method that renders; {method} does not.")
