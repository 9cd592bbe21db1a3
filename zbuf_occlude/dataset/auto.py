"""Which method, where a person named none: `depth_buffer` if OpenGL opens; for `auto` the fastest as measured."""

import importlib.util
import os
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from zbuf_occlude.dataset.plan import Recipe
from zbuf_occlude.errors import GlError, MeshError, OptionError
from zbuf_occlude.limits import Limits
from zbuf_occlude.meshes.collection import MeshCollection, MeshEntry

AUTO = "auto"

LOOKED_AT = 8
"""Of a collection so many meshes are loaded to see how large they are."""

LARGE, BYTES_A_FACE = 1 << 24, 40.0
"""Of a larger file the number of faces is guessed from its size."""

PATIENCE = 10.0
"""Seconds after which a mesh that is only looked at is left to the workers, which have limits for it."""

FEW_POINTS, MANY_FACES = 2_000, 1_000_000
"""With at most so many points on at least so many faces Embree answers before `exact` (docs/performance.md)."""


@dataclass(frozen=True)
class Choice:
    """A method and why it was taken."""

    method: str
    reason: str


def by_default() -> Choice:
    """Choose where no method was named: `depth_buffer`, or `exact`, with the reason, where no OpenGL context opens."""
    from zbuf_occlude.gl.context import FIXES, GlContext  # late: nothing touches GL before it must

    try:
        GlContext.open().close()
    except GlError:
        return Choice("exact", f"no OpenGL context opens here; for depth_buffer on Debian: {FIXES['egl']}")
    return Choice("depth_buffer", "")


def choose(n_faces: int, n_points: int, *, gpu: bool, embree: bool) -> Choice:
    """Choose among the methods that answer exactly, or all but so, by what docs/performance.md says of their speed.

    Parameters
    ----------
    n_faces : int
        Of a typical mesh.
    n_points : int
        Asked about on it, before hidden-surface removal.
    gpu : bool
        Whether OpenGL has hardware to run on.
    embree : bool
        Whether the extra `embree` is installed.
    """
    if gpu:
        return Choice("exact_gl", "OpenGL runs on a GPU here: exact, and made for it")
    if not n_faces:
        return Choice("exact", "no GPU, and no mesh could be loaded to see how large it is")
    sizes = f"{n_points:,} points on meshes of about {n_faces:,} faces"
    if embree and n_points <= FEW_POINTS and n_faces >= MANY_FACES:
        return Choice("embree", f"no GPU, and for {sizes} Embree was measured to answer before `exact`")
    return Choice("exact", f"no GPU, and for {sizes} nothing exact was measured to be faster")


def resolve(recipe: Recipe, meshes: MeshCollection) -> Recipe:
    """Replace the method `auto` by a choice for these meshes and this machine; leave any other recipe as it is.

    Raises
    ------
    OptionError
        Options are given for a method that is not yet known.

    Notes
    -----
    Without a GPU it looks at up to `LOOKED_AT` meshes, evenly spread, and loads those of files that are not `LARGE`. On
    machines that differ, as the nodes of a farm may, the choices may too: name the method there.
    """
    if recipe.method != AUTO:
        return recipe
    if recipe.method_options:
        raise OptionError(f"--set needs a named method; got --method {AUTO}. Name the one the option is of.")
    gpu = _has_gpu()
    sizes = [] if gpu else [size for size in map(partial(_sizes, recipe=recipe), _some(meshes)) if size]
    n_faces, n_points = np.median(sizes, axis=0) if sizes else (0, recipe.n_points or 0)
    embree = importlib.util.find_spec("embreex") is not None
    choice = choose(int(n_faces), int(n_points), gpu=gpu, embree=embree)
    return replace(recipe, method=choice.method, reason=choice.reason)


def _some(meshes: MeshCollection) -> list[MeshEntry]:
    places = np.unique(np.linspace(0, len(meshes) - 1, min(LOOKED_AT, len(meshes))).astype(int))
    return [meshes[int(place)] for place in places]


def _sizes(entry: MeshEntry, recipe: Recipe) -> tuple[float, float] | None:
    """Faces of a mesh and points on it; None if it cannot be used, which is said when its turn comes."""
    try:
        n_bytes = os.path.getsize(entry.path) if entry.path else 0
        if n_bytes > LARGE:  # a worker loads it, within limits
            return n_bytes / BYTES_A_FACE, recipe.n_points or recipe.density or 0.0
        with Limits(seconds=PATIENCE).watch():
            mesh = entry.load()
    except (MeshError, OSError):
        return None
    by_area = (recipe.density or 0.0) * float(mesh.areas.sum()) / mesh.longest_side**2
    return len(mesh.faces), recipe.n_points or by_area


def _has_gpu() -> bool:
    """Whether OpenGL opens here, and not in software."""
    from zbuf_occlude.gl.context import GlContext  # late: only this choice touches GL

    try:
        with GlContext.open() as gl:
            return not gl.is_software
    except GlError:
        return False
