"""What `generate --dry-run` says: what a plan would make, and what that would take."""

import errno
import os
import shutil
from collections.abc import Sequence
from pathlib import Path

from zbuf_occlude.cli.options import nearest
from zbuf_occlude.cli.summary import counted
from zbuf_occlude.dataset.estimate import estimate
from zbuf_occlude.dataset.folder import State, look_for, removable
from zbuf_occlude.dataset.plan import Plan

UNITS = ((1e12, "TB"), (1e9, "GB"), (1e6, "MB"), (1e3, "kB"), (1.0, "B"))
TIMES = ((86400.0, "days"), (3600.0, "hours"), (60.0, "minutes"), (1.0, "seconds"))


def human(amount: float, units: Sequence[tuple[float, str]]) -> str:
    """Return an amount in the largest unit that it is one of, of two digits: ``340 kB``, ``2.1 hours``."""
    size, unit = next((row for row in units if amount >= row[0]), units[-1])
    number = amount / size
    return f"{number:.2g} {unit}" if number < 99.5 else f"{number:.0f} {unit}"


def check_folder(plan: Plan, out: Path, *, overwrite: bool) -> None:
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
    elif look_for(plan, out) is State.FINISHED:
        return
    if out.is_dir() and not os.access(out, os.W_OK | os.X_OK):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(out))


def intended(plan: Plan, out: Path) -> str:
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
        f"into {out} ({human(free, UNITS)} free)\n"
        f"fingerprint {plan.fingerprint}"
    )


def costs(plan: Plan) -> str:
    """Say what a plan would take, as measured on a few of its meshes; those are made, and do not stay."""
    found = estimate(plan)
    seconds, more = found.processor_seconds, found.uncertainty
    failed = f", of which {found.n_failed} failed" if found.n_failed else ""
    return (
        f"about {human(found.n_bytes, UNITS)} on disk; at most {human(found.peak_bytes, UNITS)} while it works\n"
        f"about {human(seconds, TIMES)} on one processor core, give or take {human(more, TIMES)}: "
        f"{counted(found.n_meshes, 'mesh', 'meshes')} made here took {seconds / len(plan.meshes):.2g} s each{failed}"
    )
