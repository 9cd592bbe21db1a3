"""Preparations of a run: a test of the method, compilation by a tiny mesh, and an estimate of the cost of a dataset."""

import math
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from zbuf_occlude.base.errors import ArgumentError, GlError, MeshError
from zbuf_occlude.base.jit import compiler
from zbuf_occlude.base.provenance import seed_of
from zbuf_occlude.datasets.formats import find_format
from zbuf_occlude.datasets.plan import BOXES, DatasetConfig, Plan
from zbuf_occlude.datasets.records import DRAWING, record_type
from zbuf_occlude.datasets.shard import make_mesh, make_shard, new_store
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.meshes.collection import MeshCollection
from zbuf_occlude.meshes.load import load_mesh
from zbuf_occlude.meshes.sampling import SAMPLING, sample_surface
from zbuf_occlude.sensors import make
from zbuf_occlude.sensors.scan_config import ScanConfig
from zbuf_occlude.visibility import find_method, precompile, prepare

MIN_MESHES, MAX_MESHES, SECONDS = 2, 64, 3.0
"""Minimum and maximum number of meshes made for an estimate, and the seconds that end it between these."""
N_FUNCTIONS = {"depth_buffer": 67, "exact": 83, "exact-scans": 163}
"""Approximate number of functions that `warm_up_jit` compiles for each kind of job, beside `precompile_job`."""
_PYRAMID = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv .5 .5 1\nf 1 4 3 2\nf 1 2 5\nf 2 3 5\nf 3 4 5\nf 4 1 5\n"


@contextmanager
def _context_for(config: DatasetConfig) -> Iterator[Any]:
    """Open the GL context that a method needs, or none."""
    if not find_method(config.method).needs_gl:
        yield None
        return
    from zbuf_occlude.engines.gl.context import GlContext  # late: only these methods touch GL

    with GlContext.open() as gl:
        yield gl


def smoke_test(config: DatasetConfig, require_gpu: bool) -> None:
    """Ask the method about one triangle, so that a wrong option or a missing driver shows before files are written.

    Raises the errors that any mesh would meet: OptionError, UnavailableError, GlError. With `require_gpu` a software
    renderer is a GlError.
    """
    triangle = Mesh(np.eye(3), np.array([[0, 1, 2]]), name="rehearsal")
    with _context_for(config) as gl:
        if require_gpu and gl is not None and gl.is_software:
            raise GlError(
                f"--require-gpu needs a hardware renderer; this is {gl.renderer!r}. "
                "See `zbuf-occlude doctor`, or leave --require-gpu out."
            )
        with prepare(triangle, config.method, gl=gl, **dict(config.method_options or {})) as occluder:
            occluder.visible(sample_surface(triangle, n_points=1), [[0, 0, 4]])


def needs_no_check(config: DatasetConfig) -> bool:
    """Return whether nothing of the method can be wrong or missing: no option, no OpenGL, no further package."""
    row = find_method(config.method)
    return not (row.needs_gl or row.extra or config.method_options)


def is_warm(config: DatasetConfig) -> bool:
    """Return whether all functions that a job of this kind calls are compiled."""
    return compiler.compiled_before(_kind(config))


def n_functions(config: DatasetConfig) -> int | None:
    """Return the approximate number of functions that `warm_up_jit` compiles; None where it is not known."""
    return N_FUNCTIONS.get(_kind(config))


def precompile_job(config: DatasetConfig) -> None:
    """Start to compile, in a second process, the functions that a job of this kind calls last: about half of all."""
    if config.complete:
        return
    if config.scan is not None:
        precompile(config.method, "rays", "points")
    else:
        from zbuf_occlude.visibility.methods.oracle import ORACLE  # late: it imports numba

        precompile(config.method, DRAWING, ORACLE, SAMPLING, "points")


def warm_up_jit(config: DatasetConfig) -> None:
    """Make a shard of a pyramid in a temporary folder to compile all functions, and note that they are compiled."""
    small = replace(config, views="ring:2@30", n_points=100, density=None, variations=1, sample_size=16)
    if config.scan is not None:
        whole: dict[str, Any] = {"scene": "ground", "keep": "all"} if BOXES in config.attributes else {}
        small = replace(small, scan=ScanConfig(make("hdl-64e"), size="file", method=config.method, **whole))
    with tempfile.TemporaryDirectory() as place, _context_for(config) as gl:
        path = Path(place, "pyramid.obj")
        path.write_text(_PYRAMID, encoding="utf-8")
        make_shard(Plan(MeshCollection.from_paths([path]), small), 0, Path(place), gl)
        if config.scan is not None and not config.complete:  # the calls of scans of large objects in scenes
            mesh = load_mesh(path)
            eye = mesh.centre + np.array([0.0, 0.0, 4.0 * mesh.longest_side])
            rays = np.random.default_rng(0).normal(size=(10_000, 3))
            with prepare(mesh, config.method, gl=gl, **dict(config.method_options or {})) as occluder:
                occluder.first_hits([eye], rays)
                occluder.first_hits([eye, eye + mesh.longest_side], rays[:2])
                occluder.visible(sample_surface(mesh, n_points=10_000, seed=0), [eye])
    compiler.note_compiled(_kind(config))


def _kind(config: DatasetConfig) -> str:
    """Return the kind of job, by which functions it calls: "complete", a method, or a method with scans or boxes."""
    if config.complete:
        return "complete"
    if config.scan is None:
        return config.method
    return f"{config.method}-{'boxes' if BOXES in config.attributes else 'scans'}"


class Estimate(NamedTuple):
    """The estimated cost of a dataset."""

    n_meshes: int  # made for the estimate
    n_failed: int  # of these
    processor_seconds: float  # of all meshes of the plan, from their files to final ones
    uncertainty: float  # two standard errors of that: meshes differ
    n_bytes: float  # of the dataset
    peak_bytes: float  # on the disk at any moment


def estimate(plan: Plan) -> Estimate:
    """Estimate the cost of a plan: make a few of its meshes, chosen at random by its seed, in a temporary folder.

    A method that cannot run here is a GlError or an UnavailableError.
    """
    chosen = np.random.default_rng(seed_of(plan.config.seed, "estimate")).permutation(len(plan.meshes)).tolist()
    made: list[tuple[float, int, bool]] = []
    with tempfile.TemporaryDirectory() as folder, _context_for(plan.config) as gl:
        began = time.perf_counter()
        first = _time_mesh(plan, chosen[0], gl, Path(folder))
        if first[0] > SECONDS:
            made.append(first)
        else:  # made again, as it loaded what was compiled, too
            began = time.perf_counter()
        for mesh_id in chosen[len(made) : MAX_MESHES]:
            if len(made) >= MIN_MESHES and time.perf_counter() - began > SECONDS:
                break
            made.append(_time_mesh(plan, mesh_id, gl, Path(folder)))
    n, (seconds, sizes, failed) = len(plan.meshes), zip(*made, strict=True)
    spread = float(np.std(seconds, ddof=1)) if len(made) > 1 else seconds[0]
    n_bytes, row = n * float(np.mean(sizes)), find_format(plan.format)
    files = n_bytes
    if plan.config.sample_size is not None and not row.whole_objects:
        files = float(plan.n_clouds * record_type(plan.config).itemsize)
    peak = files + (n_bytes if row.keeps_points else files) * bool(row.exported_from)
    uncertainty = 2 * n * spread / math.sqrt(len(made)) if len(made) < n else 0.0
    return Estimate(len(made), sum(failed), n * float(np.mean(seconds)), uncertainty, files, peak)


def _time_mesh(plan: Plan, mesh_id: int, gl: Any, folder: Path) -> tuple[float, int, bool]:
    """Make a mesh; return the processor's seconds, the bytes written, and whether it failed."""
    began, store, failed = time.process_time(), new_store(plan), False
    try:
        make_mesh(plan, mesh_id, gl, store)
    except (MeshError, ArgumentError):
        failed = True
    n_bytes = sum(file.n_bytes for file in store.write(folder, plan.shard_of(mesh_id)))
    return time.process_time() - began, n_bytes, failed
