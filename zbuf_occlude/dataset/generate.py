"""Generate a dataset in a folder: plan, shards, final files, picture, manifest. The same call again resumes."""

import logging
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from zbuf_occlude.dataset import atomic
from zbuf_occlude.dataset.claim import claim, own_names, remove, remove_shards
from zbuf_occlude.dataset.folder import CONTACT_SHEET, MANIFEST, MESH_KEYS, SHAPE_NAMES, checksums, read_manifest
from zbuf_occlude.dataset.formats import find_format, packed
from zbuf_occlude.dataset.manifest import summed_up
from zbuf_occlude.dataset.origins import check_finished, check_origins, origins_of_made, worth_another_try
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.dataset.shard import data_path, look_at, read_sidecar, run_shard, source_of_shards
from zbuf_occlude.dataset.sheet import write_contact_sheet
from zbuf_occlude.errors import DatasetError
from zbuf_occlude.limits import Limits
from zbuf_occlude.visibility import find_method

_LOG = logging.getLogger(__name__)

Run = Callable[[Plan, list[int], Path, Callable[[int], None]], None]
"""Makes shards of a plan in a folder, telling each that is done: `run_here`, or an engine of the farm."""


def generate(
    plan: Plan,
    out: Path,
    *,
    run: Run | None = None,
    overwrite: bool = False,
    part: tuple[int, int] = (0, 1),
    limits: Limits | None = None,
    progress: Callable[[int], None] = lambda clouds: None,
) -> dict[str, Any]:
    """Make the dataset of a plan in a folder.

    Parameters
    ----------
    plan : Plan
    out : Path
        Made when missing. A folder with the same plan is resumed: shards that are done are not made again.
    run : callable, optional
        The engine; `run_here`, in this process, by default.
    overwrite : bool
        Remove a dataset that is in the folder first; with anything else in it, nothing is removed and it is an error.
    part : (int, int)
        (i, n): make only the shards of the i-th (from 0) of n machines; `merge` then makes the dataset of them.
    limits : Limits, optional
        Those that the engine keeps: a mesh given up within narrower ones is tried again.
    progress : callable
        Told the number of clouds planned in a shard when the shard is done.

    Returns
    -------
    dict
        The manifest; of a part of the dataset, {}.

    Raises
    ------
    DatasetError
        The folder holds another plan's dataset, or files that are not a dataset; a mesh is another than what has been
        made of it; the dataset is finished, and a mesh that failed may be made now; no mesh could be used.
    GlError
        The method needs GL and there is none.
    OptionError, UnavailableError
        The format cannot hold such a plan, or not here.
    """
    find_format(plan.format).check(plan)
    began = time.perf_counter()
    own_names(plan)  # a format that cannot write them says so
    if overwrite:
        remove(out)
    claim(plan, out)
    if (finished := read_manifest(out)) is not None:
        check_finished(plan, finished, limits or Limits(), out)
        remove_shards(plan, out)  # left when the run ended between its last two steps
        progress(plan.n_clouds)
        return finished
    try:
        make_shards(plan, out, run or run_here, progress, part=part, limits=limits)
        if part != (0, 1):
            return {}
        return merge(plan, out, {"making": time.perf_counter() - began}, closely=False)
    except (DatasetError, OSError):
        # the same command may run twice at a time; whoever comes first takes the other's shards away
        if (finished := read_manifest(out)) is None or finished["fingerprint"] != plan.fingerprint:
            raise
        remove_shards(plan, out)
        return finished


def make_shards(
    plan: Plan,
    out: Path,
    run: Run,
    progress: Callable[[int], None],
    *,
    part: tuple[int, int] = (0, 1),
    limits: Limits | None = None,
) -> None:
    """Make the shards that are not done, by an engine; `part` (i, n) takes only every n-th, from the i-th on.

    Raises
    ------
    DatasetError
        A mesh is another than what a finished shard was made of.
    """

    def done(shard: int) -> None:
        progress(len(plan.shards[shard]) * plan.clouds_a_mesh)

    missing, made = [], []
    for shard in range(part[0], len(plan.shards), part[1]):
        sidecar, fault = look_at(plan, out, shard, closely=True)
        if sidecar is not None:
            check_origins(plan, origins_of_made(sidecar), out)
            again = worth_another_try(plan, sidecar, limits or Limits())
            fault = f"{again[0]}, which failed, may be made now" if again else ""
        if fault:
            _LOG.warning("shard %d is made again: %s", shard, fault)
        if sidecar is None or fault:
            missing.append(shard)
        else:
            made.append(shard)
    for shard in made:
        done(shard)
    if missing:
        run(plan, missing, out, done)


def shards_done(plan: Plan, out: Path) -> int:
    """Count the shards of a folder that are done."""
    return sum(read_sidecar(plan, out, shard) is not None for shard in range(len(plan.shards)))


def run_here(plan: Plan, shards: list[int], out: Path, done: Callable[[int], None]) -> None:
    """Make shards in this process, one after the other; opens, and closes, a GL context when the method needs one."""
    with ExitStack() as stack:
        gl = None
        if find_method(plan.recipe.method).needs_gl:
            from zbuf_occlude.gl.context import GlContext  # late: only these methods touch GL

            gl = stack.enter_context(GlContext.open())
        for shard in shards:
            run_shard(plan, shard, out, gl)
            done(shard)


def merge(plan: Plan, out: Path, seconds: dict[str, float], *, closely: bool = True) -> dict[str, Any]:
    """Write the final files, the picture and the manifest from finished shards; then remove the shards.

    Parameters
    ----------
    plan : Plan
    out : Path
    seconds : dict of str to float
        Wall-clock times of what was done before.
    closely : bool
        Check the shards' data first. Not needed where that, or they, were just made.

    Raises
    ------
    DatasetError
        A shard is missing or damaged, a mesh has changed since it was used, or no mesh has a cloud.
    """
    began = time.perf_counter()
    sidecars = []
    for shard in range(len(plan.shards)):
        sidecar, fault = look_at(plan, out, shard, closely=closely)
        if sidecar is None:
            raise DatasetError(
                f"{out}: all {len(plan.shards)} shards must be done; shard {shard} is not{fault and f': {fault}'}. "
                "Run it first: the `zbuf-occlude generate` that made the others."
            )
        sidecars.append(sidecar)
    check_origins(plan, {key: origin for sidecar in sidecars for key, origin in origins_of_made(sidecar).items()}, out)
    if not any(sidecar.counts.n_clouds for sidecar in sidecars):
        reasons = [reason for sidecar in sidecars for reason in sidecar.failures.values()]
        raise DatasetError(
            f"at least one mesh must give a cloud; none of {len(plan.meshes)} did. The first failed so: "
            f"{reasons[0] if reasons else 'its views see nothing'}"
        )
    row = find_format(plan.format)
    if row.all_points:
        files = packed.files_of(plan)
    else:
        shards = [data_path(plan, out, shard) for shard in range(len(plan.shards))]
        files = row.load().write(source_of_shards(plan, shards), out)
    source = row.load().read(out, plan, files)
    write_names(plan, out)
    write_contact_sheet(out / CONTACT_SHEET, source)
    document = summed_up(plan, sidecars, files, source.n_clouds, {**seconds, "writing": time.perf_counter() - began})
    document["sha256"] = checksums(out, files)
    atomic.write_json(out / MANIFEST, document)
    remove_shards(plan, out)  # all that matters is done
    return document


def write_names(plan: Plan, out: Path) -> None:
    """Write what labels and mesh ids stand for."""
    atomic.write_lines(out / SHAPE_NAMES, plan.classes)
    atomic.write_lines(out / MESH_KEYS, [entry.key for entry in plan.meshes])
