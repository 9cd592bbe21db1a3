"""The flow, spelled out: mesh -> surface points -> views -> visibility mask -> what a dataset keeps, for one mesh."""

import logging
from collections.abc import Callable
from contextlib import ExitStack
from typing import Any, TypeVar

import numpy as np

from zbuf_occlude.arrays import BoolArray
from zbuf_occlude.dataset.counts import BAD_VIEW, Counts, WorstView
from zbuf_occlude.dataset.plan import Recipe
from zbuf_occlude.dataset.stacked import count_stacked
from zbuf_occlude.mesh import Mesh
from zbuf_occlude.sampling import SurfacePoints, curve_order, sample_surface
from zbuf_occlude.seeds import seed_of
from zbuf_occlude.views import Views
from zbuf_occlude.visibility import prepare

CHECKED_POINTS = 64
"""At least this many points of each view that is checked are asked again of the oracle, where there are as many."""

MOST_TESTS = 1_000_000_000
"""Pairs times faces that the oracle goes through for one sampling: a second. Huge meshes are checked at fewer pairs."""

_LOG = logging.getLogger(__name__)

Kept = TypeVar("Kept")
Keep = Callable[[SurfacePoints, BoolArray, Views, str, int], Kept]
"""What is kept of one sampling: of its points, the mask, the views in world units, the mesh's key, the variation."""


def occlude(
    mesh: Mesh, recipe: Recipe, views: Views, key: str, gl: Any, keep: Keep[Kept], n_checked: int
) -> tuple[list[Kept], Counts, str]:
    """Make all clouds of one mesh, of points on its surface; scans are made by `zbuf_occlude.dataset.scans`.

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
    keep : callable
        Called for each variation.
    n_checked : int
        About this many pairs of view and point of each variation are asked again of the oracle.

    Returns
    -------
    kept : list
        What `keep` returned, variation by variation.
    counts : Counts
        Of its clouds, of what cleaning took away, of what was asked again of the oracle, and of sheets too near.
    renderer : str
        "none" without OpenGL.
    """
    views = views.around(mesh.centre, mesh.longest_side)
    kept, renderer = [], "none"
    counts = Counts(faces_dropped=mesh.dropped, n_without_colors=lacks_colors(mesh, recipe))
    with ExitStack() as stack:
        occluder = None
        if not recipe.complete:
            options = dict(recipe.method_options or {})
            occluder = stack.enter_context(prepare(mesh, recipe.method, gl=gl, **options))
            occluder.warns_of_eyes_inside = False  # the manifest counts them
            counts += Counts(n_inside=int(mesh.in_box(views.eyes).sum()))
            renderer = occluder.renderer
        for variation in range(recipe.variations):
            points = sample(mesh, recipe, seed_of(recipe.seed, key, variation))
            if occluder is None:
                mask = np.ones((len(views), len(points)), dtype=bool)
            else:
                mask = occluder.visible(points, views.eyes)
                rng = np.random.default_rng(seed_of(recipe.seed, key + "/check", variation))
                counts += check(mesh, points, views, mask, rng, n_checked, WorstView(0.0, key, variation, 0))
                if variation == 0:
                    counts += count_stacked(mesh, points, occluder.tolerance, key)
            if views.windows is not None:
                mask = mask & views.shows(points.positions)
            n_visible = np.array([np.count_nonzero(seen) for seen in mask])  # fast, unlike along an axis
            counts += Counts(
                n_clouds=int((n_visible > 0).sum()),
                n_blind_views=int((n_visible == 0).sum()),
                n_with_repeats=int(((n_visible > 0) & (n_visible < (recipe.sample_size or 0))).sum()),
            )
            kept.append(keep(points, mask, views, key, variation))
    return kept, counts, renderer


def sample(mesh: Mesh, recipe: Recipe, seed: np.random.SeedSequence) -> SurfacePoints:
    """Sample the object once for a variation; `density` counts points per area with the longest side taken as 1.

    The points come face by face, and within a face in Morton order: neighbours in space are neighbours in memory,
    which every method likes and which makes packed datasets small. (The order within a cloud is random all the same.)
    """
    if recipe.density is None:
        points = sample_surface(mesh, n_points=recipe.n_points, seed=seed)
    else:
        points = sample_surface(mesh, density=recipe.density / mesh.longest_side**2, seed=seed)
        if not len(points):  # a density so low that Algorithm 1 draws nothing still has to give a cloud
            points = sample_surface(mesh, n_points=1, seed=seed)
    return points.select(curve_order(points, mesh.bounds[0], mesh.longest_side))


def lacks_colors(mesh: Mesh, recipe: Recipe) -> int:
    """Return 1 for a mesh of which colours are wanted and some are lacking, else 0; the log says which."""
    if "colors" not in recipe.attributes or (mesh.colors is not None and mesh.colors.is_whole):
        return 0
    for reason in () if mesh.colors is None else mesh.colors.lacking:
        _LOG.warning("%s: %s", mesh.name, reason)
    return 1


def check(
    mesh: Mesh,
    points: SurfacePoints,
    views: Views,
    mask: BoolArray,
    rng: np.random.Generator,
    n_checked: int,
    place: WorstView,
) -> Counts:
    """Ask the oracle about a random few of the answers and count where they differ, view by view.

    One view at least, and as many as have `CHECKED_POINTS` points each; `place` names mesh and variation.
    """
    n_pairs = min(n_checked, max(CHECKED_POINTS, MOST_TESTS // len(mesh.faces)))
    n_views = min(max(1, n_pairs // CHECKED_POINTS), len(views))
    some_views = rng.choice(len(views), n_views, replace=False)
    some_points = rng.choice(len(points), min(-(-n_pairs // n_views), len(points)), replace=False)
    with prepare(mesh, "oracle") as oracle:
        oracle.warns_of_eyes_inside = False
        truth = oracle.visible(points.select(some_points), views.eyes[some_views])
    answer = mask[np.ix_(some_views, some_points)]
    shares = (answer != truth).mean(axis=1)
    worst = int(shares.argmax())
    return Counts(
        n_checked=truth.size,
        false_visible=int((answer & ~truth).sum()),
        false_hidden=int((~answer & truth).sum()),
        n_views_checked=len(truth),
        n_bad_views=int((shares > BAD_VIEW).sum()),
        worst=place._replace(share=float(shares[worst]), view=int(some_views[worst])),
    )
