"""From a visibility mask to clouds of equal size: random subset, scale, frame, and where it all came from."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zbuf_occlude.arrays import BoolArray, FloatArray
from zbuf_occlude.dataset.plan import Recipe
from zbuf_occlude.sampling import SurfacePoints
from zbuf_occlude.seeds import seed_of
from zbuf_occlude.views import Views


def record_type(recipe: Recipe) -> np.dtype[Any]:
    """Return what is kept of one cloud; the fields become the datasets of the HDF5 files.

    data : (sample_size, 3) float32, ``(p - centre) * factor`` for the visible points p in the chosen frame
    label : (1,) int64, index into the sorted class names
    face_ids : (sample_size,) int32, the face each point lies on
    mesh_id, variation, view_id : int32
    view : (3,) float32, azimuth and elevation in radians, distance in world units
    pose : (4, 4) float64, view matrix: world space to eye space
    centre : (3,) float64; factor : float64
    n_visible : int32, visible points before the subset was drawn
    visible_fraction : float32, of the object's points
    """
    sample_size = recipe.sample_size
    return np.dtype(
        [
            ("data", "<f4", (sample_size, 3)),
            ("label", "<i8", (1,)),
            ("face_ids", "<i4", (sample_size,)),
            ("mesh_id", "<i4"),
            ("variation", "<i4"),
            ("view_id", "<i4"),
            ("view", "<f4", (3,)),
            ("pose", "<f8", (4, 4)),
            ("centre", "<f8", (3,)),
            ("factor", "<f8"),
            ("n_visible", "<i4"),
            ("visible_fraction", "<f4"),
        ]
    )


def gather_clouds(
    points: SurfacePoints,
    mask: BoolArray,
    views: Views,
    recipe: Recipe,
    key: str,
    variation: int,
    *,
    which: ArrayLike | None = None,
) -> NDArray[Any]:
    """Make one record for every view that sees anything.

    Parameters
    ----------
    points : SurfacePoints
        n points of the object, world space.
    mask : (k, n) bool
        Visible points of each view.
    views : Views
        k views in world units.
    recipe : Recipe
    key : str
        The mesh's; decides the random subsets together with the seed, `variation` and the view.
    variation : int
    which : (m,) int, optional
        Indices of the views wanted, all of them seeing something; by default all that do.

    Returns
    -------
    (at most k,) records of `record_type`; label and mesh_id are left for the caller. Views that see no point give none.
    The order of the points within a cloud is random, as loaders that take the first n expect.
    """
    seeing = np.flatnonzero(mask.any(axis=1)) if which is None else np.asarray(which)
    records = np.zeros(len(seeing), dtype=record_type(recipe))
    whole = fit(points.positions) if recipe.scale == "object" else None
    poses = views.poses
    for record, view in zip(records, seeing, strict=True):
        rng = np.random.default_rng(seed_of(recipe.seed, key, variation, int(view)))
        visible = np.flatnonzero(mask[view])
        chosen = draw(visible, recipe.sample_size, rng)
        positions = points.positions[chosen]
        if recipe.frame == "camera":
            positions = positions @ poses[view, :3, :3].T + poses[view, :3, 3]
        centre, factor = fit(positions) if recipe.scale == "cloud" else (np.zeros(3), 1.0)
        if whole is not None:
            centre, factor = whole
            if recipe.frame == "camera":
                centre = poses[view, :3, :3] @ centre + poses[view, :3, 3]
        record["data"] = (positions - centre) * factor
        record["face_ids"] = points.face_ids[chosen]
        record["variation"], record["view_id"] = variation, view
        record["view"] = views.azimuth[view], views.elevation[view], views.distance[view]
        record["pose"], record["centre"], record["factor"] = poses[view], centre, factor
        record["n_visible"], record["visible_fraction"] = len(visible), len(visible) / len(points)
    return records


def draw(visible: NDArray[np.intp], size: int, rng: np.random.Generator) -> NDArray[np.intp]:
    """Draw `size` of the visible points in random order; points repeat only when there are fewer than `size`."""
    shuffled = rng.permutation(visible)
    if len(visible) >= size:
        return shuffled[:size]
    return rng.permutation(np.concatenate([shuffled, rng.choice(visible, size - len(visible))]))


def fit(positions: FloatArray) -> tuple[FloatArray, float]:
    """Return the centre of the bounding box and the factor that makes its longest side 1 (1 for a single place)."""
    columns = np.ascontiguousarray(positions.T)  # along which minima are found a dozen times as fast
    low, high = columns.min(axis=1), columns.max(axis=1)
    longest = float((high - low).max())
    return (low + high) / 2.0, 1.0 / longest if longest > 0 else 1.0
