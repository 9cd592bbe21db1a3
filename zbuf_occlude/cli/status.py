"""`zbuf-occlude status`: how far a dataset is."""

import json
from pathlib import Path
from typing import Any

import click

from zbuf_occlude.cli.echo import echo
from zbuf_occlude.dataset.folder import datasets_in, read_manifest, read_plan
from zbuf_occlude.dataset.jobs import look_at_shards, n_parts_written
from zbuf_occlude.dataset.parts import n_parts


@click.command()
@click.argument("folder", type=click.Path(path_type=Path), metavar="DIR")
@click.option("--json", "as_json", is_flag=True, help="As JSON, for programs.")
def command(folder: Path, as_json: bool) -> None:
    """Say how far the dataset in DIR is: shards done, clouds, failures, time left at the speed so far.

    Likewise of the complete clouds that a preset puts beside it.
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
    if report["parts"]:
        echo(f"files       {report['parts_written']} of {report['parts']} parts written")
    for shard, fault in report["shards_to_make_again"].items():
        echo(f"again       shard {shard}: {fault}")
    echo(f"clouds      {report['clouds']}")
    if report["worker_seconds_left"]:
        echo(f"left        about {report['worker_seconds_left']:.0f} seconds of one worker")
    for key, reason in report["failures"].items():
        echo(f"failed      {key}: {reason}")
    echo(f"state       {'complete' if report['complete'] else 'not complete; the same command resumes it'}")


def gather(folder: Path) -> dict[str, Any]:
    """Return the state of a dataset as plain data."""
    plan, manifest = read_plan(folder), read_manifest(folder)
    report: dict[str, Any] = {
        "fingerprint": plan.fingerprint,
        "method": "none, complete" if plan.recipe.complete else plan.recipe.method,
        "clouds_planned": plan.n_clouds,
        "shards": len(plan.shards),
        "parts": n_parts(plan),
        "complete": manifest is not None,
    }
    if manifest is not None:
        return report | {
            "shards_done": len(plan.shards),
            "parts_written": n_parts(plan),
            "clouds": manifest["counts"]["clouds"],
            "failures": manifest["failures"],
            "shards_to_make_again": {},
            "worker_seconds_left": 0.0,
        }
    n_done, n_clouds, seconds = 0, 0, 0.0
    failures: dict[str, str] = {}
    again: dict[int, str] = {}
    for shard, (sidecar, fault) in enumerate(look_at_shards(plan, folder)):  # none is kept: they name every mesh
        if sidecar is not None:
            n_done, n_clouds, seconds = n_done + 1, n_clouds + sidecar.counts.n_clouds, seconds + sidecar.seconds
            failures |= sidecar.failures
        elif fault:
            again[shard] = fault
    return report | {
        "shards_done": n_done,
        "parts_written": n_parts_written(plan, folder),
        "clouds": n_clouds,
        "failures": failures,
        "shards_to_make_again": again,
        "worker_seconds_left": (len(plan.shards) - n_done) * seconds / n_done if n_done else None,
    }
