"""`zbuf-occlude status`: how far a dataset is."""

import json
from pathlib import Path
from typing import Any

import click

from zbuf_occlude.cli.echo import echo
from zbuf_occlude.cli.panels import Command
from zbuf_occlude.dataset.folder import datasets_in, read_manifest, read_plan
from zbuf_occlude.dataset.generate import progress_of


@click.command(cls=Command)
@click.argument("folder", type=click.Path(path_type=Path), metavar="DIR")
@click.option("--json", "as_json", is_flag=True, help="As JSON, for programs.")
def command(folder: Path, as_json: bool) -> None:
    """Say how far the dataset in DIR is: batches done, clouds, failures, time left at the speed so far.

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
    echo(f"batches     {report['batches_done']} of {report['batches']} done")
    echo(f"groups      {report['groups_done']} of {report['groups']} written")
    for what, fault in report["to_make_again"].items():
        echo(f"again       {what}: {fault}")
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
        "batches": len(plan.batches),
        "groups": len(plan.groups),
        "complete": manifest is not None,
    }
    if manifest is None:
        return report | progress_of(plan, folder)
    return report | {
        "batches_done": len(plan.batches),
        "groups_done": len(plan.groups),
        "clouds": manifest["counts"]["clouds"],
        "failures": manifest["failures"],
        "to_make_again": {},
        "worker_seconds_left": 0.0,
    }
