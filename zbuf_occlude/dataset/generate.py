"""Generate a dataset in a folder: plan, shards, final files, picture, manifest. The same call again resumes."""

import json
import shutil
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from zbuf_occlude.dataset import atomic
from zbuf_occlude.dataset.hdf5 import write_dataset
from zbuf_occlude.dataset.manifest import summed_up
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.dataset.shard import FOLDER, read_sidecar, run_shard
from zbuf_occlude.dataset.sheet import write_contact_sheet
from zbuf_occlude.errors import DatasetError
from zbuf_occlude.visibility import find_method

PLAN, MANIFEST, CONTACT_SHEET = "plan.json", "manifest.json", "contact_sheet.png"

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
    """
    began = time.perf_counter()
    if overwrite:
        remove(out)
    claim(plan, out)
    if (finished := read_manifest(out)) is not None:
        shutil.rmtree(out / FOLDER, ignore_errors=True)  # left when the run ended between its last two steps
        progress(plan.n_clouds)
        return finished
    make_shards(plan, out, run or run_here, progress, part=part)
    if part != (0, 1):
        return {}
    return merge(plan, out, {"making": time.perf_counter() - began})


def read_plan(out: Path) -> Plan:
    """Read back the plan of a dataset's folder.

    Raises
    ------
    DatasetError
        There is none, or it is damaged.
    """
    path = out / PLAN
    if not path.exists():
        raise DatasetError(f"{out} must hold a dataset; it has no {PLAN}. Was it made by `zbuf-occlude generate`?")
    try:
        document = json.loads(path.read_text())
        plan = Plan.from_document(document)
    except (ValueError, KeyError, TypeError) as error:
        raise DatasetError(
            f"{path} must be a plan; it is damaged ({error}). Generate again with --overwrite."
        ) from None
    if plan.fingerprint != document["fingerprint"]:
        raise DatasetError(
            f"{path} must have the fingerprint {document['fingerprint']}; it has {plan.fingerprint}. "
            "It was changed, or made by another version; generate again with --overwrite."
        )
    return plan


def read_manifest(out: Path) -> dict[str, Any] | None:
    """Return the manifest of a folder whose dataset is complete, None for one that is not."""
    path = out / MANIFEST
    if not path.exists():
        return None
    try:
        document: dict[str, Any] = json.loads(path.read_text())
    except ValueError as error:
        raise DatasetError(f"{path} must be JSON; it is damaged ({error}). Generate again with --overwrite.") from None
    return document


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
            raise DatasetError(f"all {len(plan.shards)} shards must be done; shard {shard} is not. Run it first.")
        sidecars.append(sidecar)
    if not any(sidecar["n_clouds"] for sidecar in sidecars):
        reasons = [reason for sidecar in sidecars for reason in sidecar["failures"].values()]
        raise DatasetError(
            f"at least one mesh must give a cloud; none of {len(plan.meshes)} did. The first failed so: "
            f"{reasons[0] if reasons else 'its views see nothing'}"
        )
    files, n_clouds = write_dataset(plan, out)
    write_contact_sheet(out / CONTACT_SHEET, out, files, plan.classes)
    document = summed_up(plan, sidecars, files, n_clouds, {**seconds, "writing": time.perf_counter() - began})
    atomic.write_json(out / MANIFEST, document)
    shutil.rmtree(out / FOLDER)
    return document


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
                "Choose another folder, or --overwrite."
            )
        remove(out)  # nothing of that plan was finished
    elif out.is_dir() and any(out.iterdir()):
        raise DatasetError(f"{out} must be empty or hold a dataset; it has other files. Choose another folder.")
    out.mkdir(parents=True, exist_ok=True)
    atomic.write_json(path, {"fingerprint": plan.fingerprint, **plan.document})


def remove(out: Path) -> None:
    """Remove a dataset, and only what a dataset consists of, from a folder."""
    if not (out / PLAN).exists():
        return
    shutil.rmtree(out / FOLDER, ignore_errors=True)
    names = [MANIFEST, CONTACT_SHEET, "shape_names.txt", "mesh_keys.txt", PLAN]
    for path in [*out.glob("ply_data_*.h5"), *out.glob("*_files.txt"), *(out / name for name in names)]:
        path.unlink(missing_ok=True)
