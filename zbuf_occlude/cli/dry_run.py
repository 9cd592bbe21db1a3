"""What `generate --dry-run` says: what a plan would make, and what that would take."""

import errno
import os
import shutil
from pathlib import Path

from zbuf_occlude.cli.options import nearest
from zbuf_occlude.cli.summary import counted
from zbuf_occlude.dataset.folder import MANIFEST, holds, removable
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.dataset.rehearsal import estimate

MEGABYTE, HOUR = 1e6, 3600.0


def check_place(plan: Plan, out: Path, *, overwrite: bool) -> None:
    """Check that a plan's dataset could be made in a folder, as far as that shows before it is.

    Raises
    ------
    DatasetError
        As of `generate`.
    PermissionError
        It may not be written in.
    """
    if overwrite:
        removable(out)
    elif holds(plan, out) and (out / MANIFEST).exists():
        return
    if out.is_dir() and not os.access(out, os.W_OK | os.X_OK):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(out))


def describe(plan: Plan, out: Path) -> str:
    """Say what a plan would make."""
    recipe = plan.recipe
    free = shutil.disk_usage(nearest(out)).free
    how = f"by {recipe.method}" + (f", because {recipe.reason}" if recipe.reason else "")
    how = "complete" if recipe.complete else how
    if recipe.setup is not None:
        how = f"scanned by {recipe.setup.made_sensor.name}, rays {how}, scene {recipe.setup.scene}"
    points = counted(recipe.sample_size, "point") if recipe.sample_size else "all visible points"
    return (
        f"{counted(len(plan.meshes), 'mesh', 'meshes')} x {counted(len(plan.views), 'view')} x "
        f"{counted(recipe.variations, 'variation')} = {counted(plan.n_clouds, 'cloud')} of "
        f"{points} in {counted(len(plan.groups), 'group')}, "
        f"{how}\n"
        f"into {out} ({free / MEGABYTE:.0f} MB free)\n"
        f"fingerprint {plan.fingerprint}"
    )


def costs(plan: Plan) -> str:
    """Say what a plan would take, as measured on a few of its meshes; those are made, and do not stay."""
    found = estimate(plan)
    seconds, more = found.processor_seconds, found.uncertainty
    failed = f", of which {found.n_failed} failed" if found.n_failed else ""
    return (
        f"about {found.n_bytes / MEGABYTE:.0f} MB; while working at most {found.peak_bytes / MEGABYTE:.0f} MB\n"
        f"about {seconds / HOUR:.2g} processor-hours, give or take {more / HOUR:.1g}: "
        f"{counted(found.n_meshes, 'mesh', 'meshes')} made here took {seconds / len(plan.meshes):.2g} s each{failed}"
    )
