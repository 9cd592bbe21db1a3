"""The flow, spelled out for one mesh: surface points -> views -> visibility mask."""

import logging
from collections.abc import Iterator
from contextlib import ExitStack
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.arrays import BoolArray
from zbuf_occlude.dataset.counts import BAD_VIEW, Counts, WorstView
from zbuf_occlude.dataset.plan import Recipe
from zbuf_occlude.dataset.stacked import count_stacked
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.geometry.sampling import SurfacePoints, curve_order, sample_surface
from zbuf_occlude.provenance import seed_of
from zbuf_occlude.views import Views
from zbuf_occlude.visibility import prepare

CHECKED_POINTS = 64
"""At least this many points of each view that is checked are asked again of the oracle, where there are as many."""

MOST_TESTS = 1_000_000_000
"""Pairs times faces that the oracle goes through for one sampling: a second. Huge meshes are checked at fewer pairs."""

_LOG = logging.getLogger(__name__)


class Sampling(NamedTuple):
    """One sampling of a mesh, and who sees what of it.

    Parameters
    ----------
    points : SurfacePoints
        n points; of scans those of all views, one after the other.
    mask : (k, n) bool
        Points that each view sees.
    views : Views
        World units.
    counts : Counts
        Of its clouds, and of what was asked again of the oracle.
    renderer : str
        "none" without OpenGL.
    """

    points: SurfacePoints
    mask: BoolArray
    views: Views
    counts: Counts
    renderer: str


def sampled_views(mesh: Mesh, recipe: Recipe, views: Views, key: str, gl: Any, n_checked: int) -> Iterator[Sampling]:
    """Yield the samplings of one mesh, variation by variation; `zbuf_occlude.dataset.scans` does it for sensors.

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
    n_checked : int
        About this many pairs of view and point of each variation are asked again of the oracle.
    """
    views = views.around(mesh.centre, mesh.longest_side)
    with ExitStack() as stack:
        occluder, renderer = None, "none"
        if not recipe.complete:
            options = dict(recipe.method_options or {})
            occluder = stack.enter_context(prepare(mesh, recipe.method, gl=gl, **options))
            occluder.warns_of_eyes_inside = False  # the manifest counts them
            renderer = occluder.renderer
        for variation in range(recipe.variations):
            points, counts = sample(mesh, recipe, seed_of(recipe.seed, key, variation)), Counts()
            if occluder is None:
                mask = np.ones((len(views), len(points)), dtype=bool)
            else:
                mask = occluder.visible(points, views.eyes)
                rng = np.random.default_rng(seed_of(recipe.seed, key + "/check", variation))
                counts += check(mesh, points, views, mask, rng, n_checked, WorstView(0.0, key, variation, 0))
                if variation == 0:
                    counts += count_stacked(mesh, points, occluder.tolerance, key)
                    counts += Counts(n_inside=int(mesh.in_box(views.eyes).sum()))
            if views.windows is not None:
                mask = mask & views.shows(points.positions)
            n_visible = np.array([np.count_nonzero(seen) for seen in mask])  # fast, unlike along an axis
            yield Sampling(points, mask, views, counts + count_clouds(n_visible, recipe), renderer)


def count_clouds(n_visible: NDArray[np.intp], recipe: Recipe) -> Counts:
    """Count the clouds of views that see `n_visible` (k,) points."""
    return Counts(
        n_clouds=int((n_visible > 0).sum()),
        n_blind_views=int((n_visible == 0).sum()),
        n_with_repeats=int(((n_visible > 0) & (n_visible < (recipe.sample_size or 0))).sum()),
    )


def sample(mesh: Mesh, recipe: Recipe, seed: np.random.SeedSequence) -> SurfacePoints:
    """Sample the object once for a variation; `density` counts points per area with the longest side taken as 1.

    The points come face by face, and within a face in Morton order: neighbours in space are neighbours in memory,
    which makes every method fast and packed datasets small. (The order within a cloud is random all the same.)
    """
    if recipe.density is None:
        points = sample_surface(mesh, n_points=recipe.n_points, seed=seed)
    else:
        points = sample_surface(mesh, density=recipe.density / mesh.longest_side**2, seed=seed)
        if not len(points):  # a density so low that Algorithm 1 draws nothing still has to give a cloud
            points = sample_surface(mesh, n_points=1, seed=seed)
    return points.select(curve_order(points, mesh.bounds[0], mesh.longest_side))


def count_mesh(mesh: Mesh, recipe: Recipe) -> Counts:
    """Count what cleaning dropped, and whether wanted colours are lacking; the log says which."""
    lacking = "colors" in recipe.attributes and (mesh.colors is None or not mesh.colors.is_whole)
    for reason in mesh.colors.lacking if lacking and mesh.colors is not None else ():
        _LOG.warning("%s: %s", mesh.name, reason)
    return Counts(faces_dropped=mesh.dropped, n_without_colors=int(lacking))


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
