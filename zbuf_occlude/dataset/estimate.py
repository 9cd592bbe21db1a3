"""What a dataset would take: a few of its meshes are made, and what they took is said of all."""

import math
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from zbuf_occlude.dataset.batch import make_mesh, new_store
from zbuf_occlude.dataset.clouds import record_type
from zbuf_occlude.dataset.formats import PACKED, find_format
from zbuf_occlude.dataset.formats.packed import Archive
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.errors import ArgumentError, MeshError
from zbuf_occlude.provenance import seed_of
from zbuf_occlude.visibility import find_method

OPEN_GROUPS = 2
"""Groups whose batches and files may both be on the disk."""
LEAST_MESHES, MOST_MESHES, SECONDS = 2, 64, 3.0
"""This many meshes are made at least and at most, where there are as many; between these, what the time allows."""


class Estimate(NamedTuple):
    """What a dataset would take.

    Parameters
    ----------
    n_meshes : int
        That were made for it.
    n_failed : int
        Of them.
    processor_seconds : float
        Of all meshes of the plan, from their files to final ones.
    uncertainty : float
        Two standard errors of that: meshes differ.
    n_bytes : float
        Of the dataset.
    peak_bytes : float
        On the disk at any moment.
    """

    n_meshes: int
    n_failed: int
    processor_seconds: float
    uncertainty: float
    n_bytes: float
    peak_bytes: float


def estimate(plan: Plan) -> Estimate:
    """Make a few meshes of a plan, chosen at random by its seed, in a folder that does not stay.

    Raises
    ------
    GlError, UnavailableError
        The method cannot run here.
    """
    chosen = np.random.default_rng(seed_of(plan.recipe.seed, "estimate")).permutation(len(plan.meshes)).tolist()
    with ExitStack() as stack:
        folder, gl = Path(stack.enter_context(tempfile.TemporaryDirectory())), None
        if find_method(plan.recipe.method).needs_gl:
            from zbuf_occlude.gl.context import GlContext  # late: only these methods touch GL

            gl = stack.enter_context(GlContext.open())
        _make(plan, chosen[0], gl, folder)  # loads what was compiled
        made: list[_Made] = []
        began = time.perf_counter()
        for mesh_id in chosen[:MOST_MESHES]:
            if len(made) >= LEAST_MESHES and time.perf_counter() - began > SECONDS:
                break
            made.append(_make(plan, mesh_id, gl, folder))
    n, seconds = len(plan.meshes), [each.seconds for each in made]
    spread = float(np.std(seconds, ddof=1)) if len(made) > 1 else seconds[0]
    n_bytes = n * float(np.mean([each.n_bytes for each in made]))
    return Estimate(
        len(made),
        sum(each.failed for each in made),
        n * float(np.mean(seconds)),
        2 * n * spread / math.sqrt(len(made)) if len(made) < n else 0.0,
        *_on_disk(plan, n_bytes),
    )


class _Made(NamedTuple):
    """What a mesh took."""

    seconds: float
    n_bytes: int
    failed: bool


def _make(plan: Plan, mesh_id: int, gl: Any, folder: Path) -> _Made:
    began, store, failed = time.process_time(), new_store(plan), False
    try:
        make_mesh(plan, mesh_id, gl, store)
    except (MeshError, ArgumentError):
        failed = True
    made = time.process_time()
    if isinstance(store, Archive):
        store.write(folder / "archive")
        return _Made(time.process_time() - began, (folder / "archive").stat().st_size, failed)
    pieces = [piece for of_file in store.pieces().values() for piece in of_file]
    with open(folder / "batch", "wb") as file:
        file.writelines(pieces)
    writing = time.process_time() - made
    return _Made(made - began + 2 * writing, sum(map(len, pieces)), failed)  # in a batch, then in files


def _on_disk(plan: Plan, n_bytes: float) -> tuple[float, float]:
    """Return the bytes of the dataset, and the most on the disk at any moment, from those of all batches."""
    row = find_format(plan.format)
    if plan.format == PACKED:
        return n_bytes, n_bytes
    size = plan.recipe.sample_size
    files = n_bytes if size is None else plan.n_clouds * record_type(plan.recipe).itemsize
    if row.exported_from:
        return files, files + n_bytes
    return files, files * (1 + min(1.0, OPEN_GROUPS / len(plan.groups)))
