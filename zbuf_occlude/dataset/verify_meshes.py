"""Clouds of a finished dataset against the meshes that they were made of: the oracle asked again, scans made again."""

from typing import Any

import numpy as np

from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.dataset.records import RecordStore
from zbuf_occlude.dataset.scans import scan_views
from zbuf_occlude.dataset.source import Source
from zbuf_occlude.errors import MeshError, OptionError
from zbuf_occlude.limits import Limits
from zbuf_occlude.meshes.collection import MeshCollection
from zbuf_occlude.sampling import SurfacePoints
from zbuf_occlude.visibility.oracle import BAND
from zbuf_occlude.visibility.oracle import prepare as prepare_oracle

POINTS_PER_CLOUD = 64
"""Of each cloud that is checked this many points are asked of the oracle."""
ROUNDING = 0.002
"""What rounding the positions may add to the fraction of false visible, besides what lies in the boundary band."""
DEVIATIONS = 5.0
"""A measured fraction may be this many standard deviations above the manifest's."""


def scan_again(source: Source, plan: Plan, meshes: MeshCollection, n_samples: int, faults: list[str]) -> int:
    """Scan the objects of some clouds again, and compare those clouds whole; return how many points were compared.

    The same plan gives the same bytes, so a cloud that differs was not made by it, or of other meshes.
    """
    by_key = {entry.key: entry for entry in meshes}
    missing = [entry.key for entry in plan.meshes if entry.key not in by_key]
    if missing:
        faults.append(f"the meshes given must have {missing[0]}; they have not. Give those that it was made of.")
        return 0
    remade = Plan(MeshCollection(by_key[entry.key] for entry in plan.meshes), plan.recipe, plan.format, plan.views)
    rng = np.random.default_rng(plan.recipe.seed)
    everything = np.concatenate(list(source.order.values()))
    records = source.take(np.sort(rng.choice(everything, min(n_samples, len(everything)), replace=False)))
    wanted = list(dict.fromkeys(records["mesh_id"].tolist()))[: max(1, n_samples // plan.clouds_per_mesh)]
    n_compared = 0
    for mesh_id in wanted:
        entry, store = remade.meshes[mesh_id], RecordStore(remade)
        try:
            kept, _, _ = scan_views(entry.load(), entry.label, remade, entry.key, store.keep)
        except (MeshError, OptionError) as error:
            faults.append(str(error))
            continue
        again = {(int(r["variation"]), int(r["view_id"])): r for part in kept for r in part}
        for record in records[records["mesh_id"] == mesh_id]:
            other = again.get((int(record["variation"]), int(record["view_id"])))
            n_compared += len(record["data"])
            if other is None or other["data"].tobytes() != record["data"].tobytes():
                faults.append(
                    f"view {int(record['view_id'])} of {entry.key} must be what the plan gives; it is another scan."
                )
    return n_compared


def ask_oracle(
    source: Source, plan: Plan, manifest: dict[str, Any], meshes: MeshCollection, n_samples: int, faults: list[str]
) -> tuple[int, float | None]:
    """Ask about some points of some clouds; return how many, and what fraction of them is hidden."""
    rng = np.random.default_rng(plan.recipe.seed)
    everything = np.concatenate(list(source.order.values()))
    records = source.take(np.sort(rng.choice(everything, min(n_samples, len(everything)), replace=False)))
    by_key = {entry.key: entry for entry in meshes}
    n_checked = n_hidden = 0
    for record in records:
        key = plan.meshes[int(record["mesh_id"])].key
        if key not in by_key:
            faults.append(f"the meshes given must have {key}; they have not. Give those that the dataset was made of.")
            break
        try:
            with Limits().watch():
                mesh = by_key[key].load()
        except MeshError as error:
            faults.append(str(error))
            continue
        rotation, translation = record["pose"][:3, :3], record["pose"][:3, 3]
        some = rng.choice(len(record["data"]), min(POINTS_PER_CLOUD, len(record["data"])), replace=False)
        positions = record["data"][some] / record["factor"] + record["centre"]
        if plan.recipe.frame == "camera":
            positions = (positions - translation) @ rotation
        points = SurfacePoints(positions, record["face_ids"][some], np.zeros_like(positions))
        eye = (-rotation.T @ translation)[None]
        with prepare_oracle(mesh) as oracle:
            oracle.warns_of_eyes_inside = False
            hidden = points.select(~oracle.visible(points, eye)[0])
            # where the line of sight grazes the surface, the answer for a point that was moved is by chance
            moved = np.sqrt(3.0) * manifest.get("rounding", 0.0) * mesh.longest_side / mesh.diagonal
            n_hidden += int(oracle.decided(hidden, eye, max(BAND, moved)).sum())
        n_checked += len(points)
    promised = manifest["error"]["false_visible"]
    if n_checked and promised is not None:
        # the manifest's fraction is of all pairs of view and point; a cloud has the visible ones alone
        promised = min(1.0, promised / float(records["visible_fraction"].mean()))
        allowed = promised + DEVIATIONS * np.sqrt(promised * (1 - promised) / n_checked) + ROUNDING
        if n_hidden / n_checked > allowed:
            faults.append(
                f"by the manifest at most {allowed:.2%} of the points may be hidden; the oracle says that "
                f"{n_hidden / n_checked:.2%} of {n_checked} are."
            )
    return n_checked, n_hidden / n_checked if n_checked else None
