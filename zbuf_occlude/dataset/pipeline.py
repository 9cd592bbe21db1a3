"""The flow, spelled out: mesh -> surface points -> views -> visibility mask -> occluded clouds, for one mesh."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.arrays import BoolArray
from zbuf_occlude.dataset.clouds import gather_clouds
from zbuf_occlude.dataset.plan import Recipe, seed_of
from zbuf_occlude.mesh import Mesh
from zbuf_occlude.sampling import SurfacePoints, sample_surface
from zbuf_occlude.views import Views
from zbuf_occlude.visibility import prepare

CHECKED_VIEWS, CHECKED_POINTS = 4, 64
"""Of each variation so many views and points are asked again of the oracle."""


def occlude(mesh: Mesh, recipe: Recipe, views: Views, key: str, gl: Any) -> tuple[NDArray[Any], dict[str, Any]]:
    """Make all clouds of one mesh.

    Parameters
    ----------
    mesh : Mesh
        In its own units; the cameras stand around its centre at multiples of its longest side.
    recipe : Recipe
    views : Views
        Distances in longest sides, about the origin.
    key : str
        The mesh's key; all randomness comes from it and the recipe's seed.
    gl : GlContext or None

    Returns
    -------
    records : as `gather_clouds` makes them, all variations
    facts : dict
        renderer; n_checked, false_visible, false_hidden (pairs of view and point, against the oracle).
    """
    views = views.around(mesh.centre, mesh.longest_side)
    clouds = []
    checked = {"n_checked": 0, "false_visible": 0, "false_hidden": 0}
    with prepare(mesh, recipe.method, gl=gl, **dict(recipe.method_options or {})) as occluder:
        for variation in range(recipe.variations):
            points = sample(mesh, recipe, seed_of(recipe.seed, key, variation))
            mask = occluder.visible(points, views.eyes)
            clouds.append(gather_clouds(points, mask, views, recipe, key, variation))
            rng = np.random.default_rng(seed_of(recipe.seed, key + "/check", variation))
            for name, count in check(mesh, points, views, mask, rng).items():
                checked[name] += count
        return np.concatenate(clouds), {"renderer": occluder.renderer, **checked}


def sample(mesh: Mesh, recipe: Recipe, seed: np.random.SeedSequence) -> SurfacePoints:
    """Sample the object once for a variation; `density` counts points per area with the longest side taken as 1."""
    if recipe.density is None:
        return sample_surface(mesh, n_points=recipe.n_points, seed=seed)
    points = sample_surface(mesh, density=recipe.density / mesh.longest_side**2, seed=seed)
    # a density so low that Algorithm 1 draws nothing still has to give a cloud
    return points if len(points) else sample_surface(mesh, n_points=1, seed=seed)


def check(mesh: Mesh, points: SurfacePoints, views: Views, mask: BoolArray, rng: np.random.Generator) -> dict[str, int]:
    """Ask the oracle about a random few of the answers and count where they differ."""
    some_views = rng.choice(len(views), min(CHECKED_VIEWS, len(views)), replace=False)
    some_points = rng.choice(len(points), min(CHECKED_POINTS, len(points)), replace=False)
    with prepare(mesh, "oracle") as oracle:
        truth = oracle.visible(points.select(some_points), views.eyes[some_views])
    answer = mask[np.ix_(some_views, some_points)]
    return {
        "n_checked": truth.size,
        "false_visible": int((answer & ~truth).sum()),
        "false_hidden": int((~answer & truth).sum()),
    }
