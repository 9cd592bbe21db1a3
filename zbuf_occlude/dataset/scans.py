"""The flow for scans: mesh in metres -> places of the sensor -> scenes -> first hits -> what a dataset keeps."""

from functools import partial

import numpy as np

from zbuf_occlude.dataset.clouds import ScanPoints, point_columns
from zbuf_occlude.dataset.counts import BAD_VIEW, Counts, WorstView
from zbuf_occlude.dataset.pipeline import CHECKED_POINTS, Keep, Kept
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.errors import ArgumentError
from zbuf_occlude.mesh import Mesh
from zbuf_occlude.seeds import seed_of
from zbuf_occlude.sensors.capture import Capture, captures, sensor_places, stand
from zbuf_occlude.visibility import prepare
from zbuf_occlude.visibility.interface import CONTACT

ATTRIBUTES = {
    "range": "ranges", "incidence": "incidences", "intensity": "intensities", "ring": "rings", "column": "columns",
    "instance": "instances", "n_returns": "n_returns", "normal": "normals", "clean_range": "clean_ranges",
}  # fmt: skip
"""For each field of a record that has a row per point what it is of a `Scan`."""

CHECKED_VIEWS = 4
"""Of the scans of each variation at most this many are checked; of many meshes fewer of each (`Plan.n_checked`)."""


def scan_views(mesh: Mesh, label: str, plan: Plan, key: str, keep: Keep[Kept]) -> tuple[list[Kept], Counts, str]:
    """Make all scans of one mesh.

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
    keep : callable
        Called for each variation.

    Returns
    -------
    kept : list
        What `keep` returned, variation by variation.
    counts, renderer
        As `pipeline.occlude` returns; a checked pair is a ray, false visible: what it is said to meet lies behind what
        the oracle says, false hidden: before it.
    """
    recipe, setup = plan.recipe, plan.recipe.setup
    if setup is None:
        raise ArgumentError("a recipe of scans must say how; this has no `scanning`. Use pipeline.occlude.")
    standing, size = stand(mesh, label, setup)
    floor = float(standing.bounds[0, 2])
    kept: list[Kept] = []
    counts, renderer = Counts(faces_dropped=mesh.dropped), "none"
    for variation in range(recipe.variations):
        seeds = partial(_seed, recipe.seed, key, variation)
        places = sensor_places(plan.views_of(key), size, floor, setup, seeds)
        rng = np.random.default_rng(seed_of(recipe.seed, key + "/check", variation))
        n_checked = min(CHECKED_VIEWS, -(-plan.n_checked // CHECKED_POINTS), len(places))
        checked = set(rng.choice(len(places), n_checked, replace=False).tolist())
        found = []
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
                name: np.concatenate([getattr(scan, ATTRIBUTES[name]) for scan in scans])
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
        counts += Counts(
            n_clouds=int((lengths > 0).sum()),
            n_blind_views=int((lengths == 0).sum()),
            n_with_repeats=int(((lengths > 0) & (lengths < (recipe.sample_size or 0))).sum()),
        )
        kept.append(keep(points, mask, places, key, variation))
    return kept, counts, renderer


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
