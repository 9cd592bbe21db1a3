"""Before workers start: the method asked about one triangle, and one tiny mesh through the whole job to compile all."""

import tempfile
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import numpy as np

from zbuf_occlude import numba_cache
from zbuf_occlude.dataset.plan import Plan, Recipe
from zbuf_occlude.dataset.shard import run_shard
from zbuf_occlude.errors import GlError
from zbuf_occlude.mesh import Mesh
from zbuf_occlude.meshes.collection import MeshCollection
from zbuf_occlude.sampling import sample_surface
from zbuf_occlude.visibility import find_method, prepare

_PYRAMID = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv .5 .5 1\nf 1 4 3 2\nf 1 2 5\nf 2 3 5\nf 3 4 5\nf 4 1 5\n"


def rehearse(recipe: Recipe, require_gpu: bool) -> None:
    """Ask the method about one triangle, so that a wrong option or a missing driver shows before anything is written.

    Raises
    ------
    OptionError, UnavailableError, GlError
        What any mesh would have met; also a software renderer when a GPU is required.
    """
    triangle = Mesh(np.eye(3), np.array([[0, 1, 2]]), name="rehearsal")
    with ExitStack() as stack:
        gl = None
        if find_method(recipe.method).needs_gl:
            from zbuf_occlude.gl.context import GlContext  # late: only these methods touch GL

            gl = stack.enter_context(GlContext.open())
            if require_gpu and gl.is_software:
                raise GlError(
                    f"--require-gpu needs a hardware renderer; this is {gl.renderer!r}. "
                    "See `zbuf-occlude doctor`, or leave --require-gpu out."
                )
        occluder = stack.enter_context(prepare(triangle, recipe.method, gl=gl, **dict(recipe.method_options or {})))
        occluder.visible(sample_surface(triangle, n_points=1), [[0, 0, 4]])


def is_plain(recipe: Recipe) -> bool:
    """Whether nothing of the method can be wrong or missing here: no option, no OpenGL, no further package."""
    row = find_method(recipe.method)
    return not (row.needs_gl or row.extra or recipe.method_options or recipe.setup)


def is_compiled(recipe: Recipe) -> bool:
    """Whether a job of this method was rehearsed here."""
    return numba_cache.is_compiled(recipe.method)


def compile_ahead(recipe: Recipe) -> None:
    """Run the job of a plain recipe on a pyramid, and note that all is compiled; nothing of it stays."""
    with tempfile.TemporaryDirectory() as place:
        path = Path(place, "pyramid.obj")
        path.write_text(_PYRAMID, encoding="utf-8")
        small = replace(recipe, views="ring:2@30", n_points=100, density=None, variations=1, sample_size=16)
        run_shard(Plan(MeshCollection.from_paths([path]), small), 0, Path(place), None)
    numba_cache.note_compiled(recipe.method)
