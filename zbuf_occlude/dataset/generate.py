"""Generate a dataset in a folder: plan, shards, final files, picture, manifest. The same call again resumes."""

import json
import shutil
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from zbuf_occlude.dataset import atomic
from zbuf_occlude.dataset.folder import (
    CONTACT_SHEET,
    GALLERY,
    MANIFEST,
    MESH_KEYS,
    PLAN,
    SHAPE_NAMES,
    checksums,
    read_manifest,
)
from zbuf_occlude.dataset.formats import FORMATS, find_format, packed
from zbuf_occlude.dataset.manifest import summed_up
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.dataset.shard import FOLDER, data_path, read_sidecar, run_shard, source_of_shards
from zbuf_occlude.dataset.sheet import write_contact_sheet
from zbuf_occlude.errors import DatasetError
from zbuf_occlude.visibility import find_method

Run = Callable[[Plan, list[int], Path, Callable[[int], None]], None]
"""Makes shards of a plan in a folder, telling each that is done: `run_here`, or an engine of the farm."""


def generate(
    plan: Plan,
    out: Path,
    *,
    run: Run | None = None,
    overwrite: bool = False,
    part: tuple[int, int] = (0, 1),
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
        Remove a dataset that is in the folder first (nothing else in it is touched).
    part : (int, int)
        (i, n): make only the shards of the i-th (from 0) of n machines; `merge` then makes the dataset of them.
    progress : callable
        Told the number of clouds planned in a shard when the shard is done.

    Returns
    -------
    dict
        The manifest; of a part of the dataset, {}.

    Raises
    ------
    DatasetError
        The folder holds another plan's dataset, or files that are not a dataset; no mesh could be used.
    GlError
        The method needs GL and there is none.
    OptionError, UnavailableError
        The format cannot hold such a plan, or not here.
    """
    find_format(plan.format).check(plan)
    began = time.perf_counter()
    if overwrite:
        remove(out)
    claim(plan, out)
    if (finished := read_manifest(out)) is not None:
        shutil.rmtree(out / FOLDER, ignore_errors=True)  # left when the run ended between its last two steps
        progress(plan.n_clouds)
        return finished
    try:
        make_shards(plan, out, run or run_here, progress, part=part)
        if part != (0, 1):
            return {}
        return merge(plan, out, {"making": time.perf_counter() - began})
    except (DatasetError, OSError):
        # the same command may run twice at a time; whoever comes first takes the other's shards away
        if (finished := read_manifest(out)) is None or finished["fingerprint"] != plan.fingerprint:
            raise
        shutil.rmtree(out / FOLDER, ignore_errors=True)
        return finished


def make_shards(
    plan: Plan, out: Path, run: Run, progress: Callable[[int], None], *, part: tuple[int, int] = (0, 1)
) -> None:
    """Make the shards that are not done, by an engine; `part` (i, n) takes only every n-th, from the i-th on."""

    def done(shard: int) -> None:
        progress(len(plan.shards[shard]) * plan.clouds_a_mesh)

    missing = []
    for shard in range(part[0], len(plan.shards), part[1]):
        if read_sidecar(out, shard, plan.fingerprint) is None:
            missing.append(shard)
        else:
            done(shard)
    if missing:
        run(plan, missing, out, done)


def shards_done(plan: Plan, out: Path) -> int:
    """Count the shards of a folder that are done."""
    return sum(read_sidecar(out, shard, plan.fingerprint) is not None for shard in range(len(plan.shards)))


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


def merge(plan: Plan, out: Path, seconds: dict[str, float]) -> dict[str, Any]:
    """Write the final files, the picture and the manifest from finished shards; then remove the shards.

    Raises
    ------
    DatasetError
        A shard is missing, or none has a cloud.
    """
    began = time.perf_counter()
    sidecars = []
    for shard in range(len(plan.shards)):
        sidecar = read_sidecar(out, shard, plan.fingerprint)
        if sidecar is None:
            raise DatasetError(
                f"{out}: all {len(plan.shards)} shards must be done; shard {shard} is not. Run it first."
            )
        sidecars.append(sidecar)
    if not any(sidecar["n_clouds"] for sidecar in sidecars):
        reasons = [reason for sidecar in sidecars for reason in sidecar["failures"].values()]
        raise DatasetError(
            f"at least one mesh must give a cloud; none of {len(plan.meshes)} did. The first failed so: "
            f"{reasons[0] if reasons else 'its views see nothing'}"
        )
    shards = [data_path(plan, out, shard) for shard in range(len(plan.shards))]
    row = find_format(plan.format)
    files = packed.adopt(plan, shards, out) if row.all_points else row.load().write(source_of_shards(plan, shards), out)
    source = row.load().read(out, plan, files)
    write_names(plan, out)
    write_contact_sheet(out / CONTACT_SHEET, source)
    document = summed_up(plan, sidecars, files, source.n_clouds, {**seconds, "writing": time.perf_counter() - began})
    document["sha256"] = checksums(out, files)
    atomic.write_json(out / MANIFEST, document)
    shutil.rmtree(out / FOLDER, ignore_errors=True)  # all that matters is done
    for path in atomic.leftovers(out):
        path.unlink(missing_ok=True)
    return document


def write_names(plan: Plan, out: Path) -> None:
    """Write what labels and mesh ids stand for."""
    atomic.write_lines(out / SHAPE_NAMES, plan.classes)
    atomic.write_lines(out / MESH_KEYS, [entry.key for entry in plan.meshes])


def claim(plan: Plan, out: Path) -> None:
    """Make the folder this plan's, or find that it is already."""
    path = out / PLAN
    if path.exists():
        try:
            found = json.loads(path.read_text())["fingerprint"]
        except (ValueError, KeyError, TypeError):
            found = "unreadable"
        if found == plan.fingerprint:
            return
        if (out / MANIFEST).exists() or any((out / FOLDER).glob("*.json")):
            raise DatasetError(
                f"{out} must be empty or hold this same plan ({plan.fingerprint}); it holds plan {found}. "
                "Choose another folder, or generate with --overwrite."
            )
        remove(out)  # nothing of that plan was finished
    elif out.is_dir() and set(out.iterdir()) - set(atomic.leftovers(out)):
        raise DatasetError(f"{out} must be empty or hold a dataset; it has other files. Choose another folder.")
    out.mkdir(parents=True, exist_ok=True)
    atomic.write_json(path, {"fingerprint": plan.fingerprint, **plan.document})


def remove(out: Path) -> None:
    """Remove a dataset, and only what a dataset consists of, from a folder."""
    if not (out / PLAN).exists():
        return
    shutil.rmtree(out / FOLDER, ignore_errors=True)
    patterns = {pattern for row in FORMATS for pattern in row.patterns}
    patterns |= {MANIFEST, CONTACT_SHEET, GALLERY, SHAPE_NAMES, MESH_KEYS, PLAN}
    for path in [*(path for pattern in sorted(patterns) for path in out.glob(pattern)), *atomic.leftovers(out)]:
        path.unlink(missing_ok=True)
        folder = path.parent
        while folder != out and not any(folder.iterdir()):
            folder.rmdir()
            folder = folder.parent
