"""Before workers start: the method asked about one triangle, and one tiny mesh through the whole job to compile all."""

import tempfile
from contextlib import ExitStack
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np

from zbuf_occlude.dataset.batch import make_batch
from zbuf_occlude.dataset.plan import Plan, Recipe
from zbuf_occlude.errors import GlError
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.geometry.sampling import sample_surface
from zbuf_occlude.jit import compiler
from zbuf_occlude.meshes.collection import MeshCollection
from zbuf_occlude.meshes.load import load_mesh
from zbuf_occlude.sensors import make
from zbuf_occlude.sensors.setup import Setup
from zbuf_occlude.visibility import find_method, prepare
from zbuf_occlude.visibility.interface import Occluder

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
    return not (row.needs_gl or row.extra or recipe.method_options)


def is_compiled(recipe: Recipe) -> bool:
    """Whether a job of this kind was rehearsed here."""
    return compiler.compiled_before(_kind(recipe))


def compile_ahead(recipe: Recipe) -> None:
    """Run the job of a recipe on a pyramid, and note that all is compiled; nothing of it stays."""
    small = replace(recipe, views="ring:2@30", n_points=100, density=None, variations=1, sample_size=16)
    if recipe.setup is not None:
        small = replace(small, scanning=asdict(Setup(make("hdl-64e").document, size="file", method=recipe.method)))
    with tempfile.TemporaryDirectory() as place, ExitStack() as stack:
        gl = None
        if find_method(recipe.method).needs_gl:
            from zbuf_occlude.gl.context import GlContext  # late: only these methods touch GL

            gl = stack.enter_context(GlContext.open())
        path = Path(place, "pyramid.obj")
        path.write_text(_PYRAMID, encoding="utf-8")
        make_batch(Plan(MeshCollection.from_paths([path]), small), 0, Path(place), gl)
        if recipe.setup is not None:
            mesh = load_mesh(path)
            occluder = stack.enter_context(prepare(mesh, recipe.method, gl=gl, **dict(recipe.method_options or {})))
            _ask_all_ways(occluder, mesh)
    compiler.note_compiled(_kind(recipe))


def _ask_all_ways(occluder: Occluder, mesh: Mesh) -> None:
    """Ask as scans of large things in scenes do: many rays in no order, rays of several places, and what hides what."""
    eye = mesh.centre + np.array([0.0, 0.0, 4.0 * mesh.longest_side])
    points = sample_surface(mesh, n_points=10_000, seed=0)
    rays = np.random.default_rng(0).normal(size=(10_000, 3))
    occluder.first_hits([eye], rays)
    occluder.first_hits([eye, eye + mesh.longest_side], rays[:2])
    occluder.visible(points, [eye])


def _kind(recipe: Recipe) -> str:
    """The method's name; scans cast rays, which other functions do."""
    return recipe.method if recipe.setup is None else f"{recipe.method}-scans"
