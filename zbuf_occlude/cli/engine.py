"""Options of the commands that share their work among processes and machines, and the engine that these choose."""

import os
from collections.abc import Callable
from functools import partial
from typing import Any

import click

from zbuf_occlude.cli.options import given
from zbuf_occlude.cli.panels import Name
from zbuf_occlude.limits import Limits
from zbuf_occlude.workers import Run, from_environment, parse_shard
from zbuf_occlude.workers.local import run_local
from zbuf_occlude.workers.ray import run_ray

ENGINE = ("engine", "workers", "ray_address", "ray_gpus")
"""Names of the parameters that `engine_options` adds, and `pop_engine` takes."""


def engine_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """--workers, --engine, --ray-address, --ray-gpus."""
    for option in reversed(
        (
            click.option("--workers", type=click.IntRange(1), help="Worker processes.  [default: one per core]"),
            click.option(
                "--engine",
                type=Name(["local", "ray"]),
                default="local",
                show_default=True,
                help="Processes here, or a Ray cluster.",
            ),
            click.option(
                "--ray-address", help="Address of a running cluster.  [default: RAY_ADDRESS, or a new one here]"
            ),
            click.option(
                "--ray-gpus",
                type=click.FloatRange(0),
                default=0.0,
                help="GPUs of each Ray worker; with 0.25 four share one.",
            ),
        )
    ):
        function = option(function)
    return function


def shard_option(what: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """--shard; `what` says whereof."""
    return click.option("--shard", metavar="I/N", help=what)


def pop_engine(context: click.Context, options: dict[str, Any], limits: Limits) -> Run:
    """Take the options of `engine_options` out of a command's, and return the engine that they choose.

    Raises
    ------
    UsageError
        An option of an engine that was not chosen.
    """
    engine, workers, address, gpus = (options.pop(name) for name in ENGINE)
    if engine != "ray" and (idle := given(context, ("ray_address", "ray_gpus"))):
        raise click.UsageError(f"{', '.join(idle)} must go with --engine ray.")
    if engine == "ray":
        return partial(run_ray, n_workers=workers, limits=limits, address=address, gpus_per_worker=gpus)
    return partial(run_local, n_workers=workers or os.cpu_count() or 1, limits=limits)


def share_of(shard: str | None) -> tuple[int, int]:
    """Return this machine's share, (i, n), as it was given, or as SLURM says."""
    return parse_shard(shard) if shard is not None else from_environment(os.environ)
