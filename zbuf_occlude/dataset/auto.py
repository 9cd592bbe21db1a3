"""`--method auto`: the method that answered fastest where it was measured, for this machine and these sizes."""

import importlib.util
from dataclasses import dataclass, replace

import numpy as np

from zbuf_occlude.dataset.plan import Recipe
from zbuf_occlude.errors import GlError, MeshError, OptionError
from zbuf_occlude.meshes.collection import MeshCollection

AUTO = "auto"

LOOKED_AT = 8
"""Of a collection so many meshes are loaded to see how large they are."""

FEW_POINTS, MANY_FACES = 2_000, 1_000_000
"""With at most so many points on at least so many faces Embree answers before `exact` (docs/performance.md)."""


@dataclass(frozen=True)
class Choice:
    """A method and why it was taken."""

    method: str
    reason: str


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
    sizes = f"{n_points:,} points on meshes of about {n_faces:,} faces"
    if embree and n_points <= FEW_POINTS and n_faces >= MANY_FACES:
        return Choice("embree", f"no GPU, and for {sizes} Embree was measured to answer before `exact`")
    return Choice("exact", f"no GPU, and for {sizes} `exact` was measured to be the fastest, and is exact")


def resolve(recipe: Recipe, meshes: MeshCollection) -> Recipe:
    """Replace the method `auto` by a choice for these meshes and this machine; leave any other recipe as it is.

    Raises
    ------
    OptionError
        Options are given for a method that is not yet known.

    Notes
    -----
    Loads up to `LOOKED_AT` meshes, evenly spread, and opens a GL context if there is one. On machines that differ,
    as the nodes of a farm may, the choices may too: name the method there.
    """
    if recipe.method != AUTO:
        return recipe
    if recipe.method_options:
        raise OptionError(f"--set needs a named method; got --method {AUTO}. Name the one the option is of.")
    sizes = []
    for place in np.unique(np.linspace(0, len(meshes) - 1, min(LOOKED_AT, len(meshes))).astype(int)):
        try:
            mesh = meshes[int(place)].load()
        except MeshError:  # to be named when its turn comes
            continue
        area = recipe.density and recipe.density * float(mesh.areas.sum()) / mesh.longest_side**2
        sizes.append((len(mesh.faces), recipe.n_points or area or 1.0))
    n_faces, n_points = np.median(sizes, axis=0) if sizes else (0, recipe.n_points or 1)
    choice = choose(int(n_faces), int(n_points), gpu=_has_gpu(), embree=importlib.util.find_spec("embreex") is not None)
    return replace(recipe, method=choice.method, reason=choice.reason)


def _has_gpu() -> bool:
    """Whether OpenGL opens here, and not in software."""
    from zbuf_occlude.gl.context import GlContext  # late: only this choice touches GL

    try:
        with GlContext.open() as gl:
            return not gl.is_software
    except GlError:
        return False
