"""The flow for scans of one mesh: mesh in metres -> places of the sensor -> scenes -> first hits."""

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.dataset.clouds import ScanPoints, point_columns
from zbuf_occlude.dataset.counts import BAD_VIEW, Counts, WorstView
from zbuf_occlude.dataset.pipeline import CHECKED_POINTS, Sampling, count_clouds, sample
from zbuf_occlude.dataset.plan import Plan, Recipe
from zbuf_occlude.errors import ArgumentError
from zbuf_occlude.geometry.colors import GREY, Bytes, barycentric
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.provenance import seed_of
from zbuf_occlude.sensors.capture import Capture, captures, in_metres, sensor_places
from zbuf_occlude.sensors.scanning import Scan
from zbuf_occlude.visibility import prepare
from zbuf_occlude.visibility.interface import CONTACT

ATTRIBUTES = {
    "range": "ranges", "incidence": "incidences", "intensity": "intensities", "ring": "rings", "column": "columns",
    "instance": "instances", "n_returns": "n_returns", "normal": "normals", "clean_range": "clean_ranges",
}  # fmt: skip
"""For each field of a record that has a row per point, but colours, what it is of a `Scan`."""

CHECKED_VIEWS = 4
"""Of the scans of each variation at most this many are checked; of many meshes fewer of each (`Plan.n_checked`)."""


def scan(mesh: Mesh, label: str, plan: Plan, key: str) -> Iterator[Sampling]:
    """Yield the scans of one mesh, variation by variation; of complete clouds the whole object, nothing is scanned.

    Parameters
    ----------
    mesh : Mesh
        In its own units.
    label : str
        Its class, for its size.
    plan : Plan
        Its recipe has a setup.
    key : str
        The mesh's; all randomness comes from it and the recipe's seed.

    Notes
    -----
    A checked pair (`Counts`) is a ray; false visible: its hit lies behind the oracle's, false hidden: before it.
    """
    recipe, setup = plan.recipe, plan.recipe.setup
    if setup is None:
        raise ArgumentError("a recipe of scans must have `scanning`; this has none. Use pipeline.sampled_views.")
    standing, size = in_metres(mesh, label, setup)
    floor = float(standing.bounds[0, 2])
    for variation in range(recipe.variations):
        seeds = partial(_seed, recipe.seed, key, variation)
        places = sensor_places(plan.views_of(key), size, floor, setup, seeds)
        if recipe.complete:
            whole = standing_points(mesh, label, recipe, key, variation)
            mask = np.ones((len(places), len(whole)), dtype=bool)
            yield Sampling(whole, mask, places, count_clouds(mask.sum(axis=1), recipe), "none")
            continue
        rng = np.random.default_rng(seed_of(recipe.seed, key + "/check", variation))
        n_checked = min(CHECKED_VIEWS, -(-plan.n_checked // CHECKED_POINTS), len(places))
        checked = set(rng.choice(len(places), n_checked, replace=False).tolist())
        found, counts, renderer = [], Counts(), "none"
        for number, capture in enumerate(captures(standing, setup, places, floor, seeds, plan.pool)):
            renderer = capture.occluder.renderer
            if number in checked and len(capture.scan):
                counts += check_rays(capture, rng, key, variation, number)
            found.append((capture.scan, capture.hidden, capture.reached))
        scans = [scan for scan, _, _ in found]
        face_ids = np.concatenate([np.where(scan.instances == 0, scan.face_ids, -1) for scan in scans])
        points = ScanPoints(
            np.concatenate([scan.positions for scan in scans]),
            face_ids,
            np.concatenate([scan.normals for scan in scans]),
            columns={
                name: np.concatenate([_column(name, scan, mesh, standing) for scan in scans])
                for name in point_columns(recipe)
            },
            facts={
                "size": np.full(len(scans), size),
                "hidden": np.array([hidden for _, hidden, _ in found]),
                "hidden_reached": np.array([reached for _, _, reached in found]),
            },
        )
        lengths = np.array([len(scan) for scan in scans])
        mask = np.repeat(np.arange(len(scans)), lengths) == np.arange(len(scans))[:, None]
        counts += count_clouds(lengths, recipe) + Counts(n_inside=int(standing.in_box(places.eyes).sum()))
        yield Sampling(points, mask, places, counts, renderer)


def standing_points(mesh: Mesh, label: str, recipe: Recipe, key: str, variation: int) -> ScanPoints:
    """Sample the whole of a mesh, as `pipeline.sample` does, where and as large as it stands before the sensor."""
    assert recipe.setup is not None
    points = sample(mesh, recipe, seed_of(recipe.seed, key, variation))
    _, size = in_metres(mesh, label, recipe.setup)
    positions = (points.positions - mesh.centre) * (size / mesh.longest_side)
    return ScanPoints(positions, points.face_ids, points.normals, points.colors, facts={"size": np.array([size])})


def _column(name: str, scan: Scan, mesh: Mesh, standing: Mesh) -> NDArray[Any]:
    return colors_of(scan, mesh, standing) if name == "color" else np.asarray(getattr(scan, ATTRIBUTES[name]))


def colors_of(scan: Scan, mesh: Mesh, standing: Mesh) -> Bytes:
    """Return the colours (n, 3) of where a scan's rays met the target, without noise; all else is grey.

    Parameters
    ----------
    scan : Scan
    mesh, standing : Mesh
        The target in its own units, with its colours, and in its place.
    """
    colors = np.full((len(scan), 3), GREY, dtype=np.uint8)
    mine = np.flatnonzero(scan.instances == 0)
    if mesh.colors is not None and len(mine):
        face_ids = scan.face_ids[mine]
        met = scan.origin + scan.clean_ranges[mine, None] * scan.directions[mine]
        colors[mine] = mesh.colors.at(face_ids, barycentric(standing.corners[face_ids], met))
    return colors


def check_rays(capture: Capture, rng: np.random.Generator, key: str, variation: int, view: int) -> Counts:
    """Ask the oracle about a random few of a scan's rays and count where the method errs."""
    scan = capture.scan
    directions = scan.directions[rng.choice(len(scan), min(CHECKED_POINTS, len(scan)), replace=False)]
    found = capture.occluder.first_hits(scan.origin[None], directions).distances
    with prepare(capture.scene.mesh, "oracle") as oracle:
        truth = oracle.first_hits(scan.origin[None], directions).distances
    within = CONTACT * capture.scene.mesh.diagonal
    with np.errstate(invalid="ignore"):  # both miss
        behind, before = found - truth > within, truth - found > within
    share = float((behind | before).mean())
    return Counts(
        n_checked=len(truth),
        false_visible=int(behind.sum()),
        false_hidden=int(before.sum()),
        n_views_checked=1,
        n_bad_views=int(share > BAD_VIEW),
        worst=WorstView(share, key, variation, view),
    )


def _seed(seed: int, key: str, variation: int, what: str, view: int) -> np.random.SeedSequence:
    return seed_of(seed, f"{key}/{what}", variation, view)
