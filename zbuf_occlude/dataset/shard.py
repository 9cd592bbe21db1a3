"""A shard: the clouds of a few meshes in one file, and the sidecar, written last, that says it is done."""

import json
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from zbuf_occlude.dataset import atomic
from zbuf_occlude.dataset.clouds import record_type
from zbuf_occlude.dataset.pipeline import occlude
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.errors import DatasetError, MeshError

FOLDER = "shards"


def records_path(out: Path, shard: int) -> Path:
    """Where a shard's clouds are kept until the final files are written."""
    return out / FOLDER / f"{shard:06d}.npy"


def sidecar_path(out: Path, shard: int) -> Path:
    """Where a shard's sidecar is; the shard is done if and only if this file exists."""
    return out / FOLDER / f"{shard:06d}.json"


def read_sidecar(out: Path, shard: int, fingerprint: str) -> dict[str, Any] | None:
    """Return the sidecar of a shard that is done, None for one that is not.

    Raises
    ------
    DatasetError
        The shard belongs to another plan.
    """
    path = sidecar_path(out, shard)
    if not path.exists():
        return None
    sidecar: dict[str, Any] = json.loads(path.read_text())
    if sidecar["fingerprint"] != fingerprint:
        raise DatasetError(f"{path} must belong to plan {fingerprint}; it is of plan {sidecar['fingerprint']}.")
    return sidecar


def run_shard(
    plan: Plan,
    shard: int,
    out: Path,
    gl: Any,
    *,
    lost: Mapping[int, str] = MappingProxyType({}),
    on_mesh: Callable[[int], None] = lambda mesh_id: None,
) -> dict[str, Any]:
    """Make one shard, write its clouds and then its sidecar; return the sidecar.

    Parameters
    ----------
    plan : Plan
    shard : int
        Index into ``plan.shards``.
    out : Path
        The dataset's folder.
    gl : GlContext or None
    lost : mapping of mesh index to reason
        Meshes that are given up: each is a failure with its reason, and not tried.
    on_mesh : callable
        Told the index of each mesh before it is begun.

    Notes
    -----
    A mesh that cannot be used is recorded under ``failures`` with its reason; the shard goes on.
    """
    began = time.perf_counter()
    parts = [np.empty(0, record_type(plan.recipe.sample_size))]
    failures: dict[str, str] = {}
    cleaning: dict[str, int] = {}
    total: dict[str, Any] = {"renderer": "none", "n_checked": 0, "false_visible": 0, "false_hidden": 0}
    classes = plan.classes
    for mesh_id in plan.shards[shard]:
        entry = plan.meshes[mesh_id]
        on_mesh(mesh_id)
        try:
            if mesh_id in lost:
                raise MeshError(lost[mesh_id])
            mesh = entry.load()
            records, facts = occlude(mesh, plan.recipe, plan.views, entry.key, gl)
        except MeshError as error:
            failures[entry.key] = str(error)
            continue
        except MemoryError:
            failures[entry.key] = f"the mesh must fit in memory; {entry.key} does not. Simplify it."
            continue
        records["mesh_id"] = mesh_id
        records["label"] = classes.index(entry.label)
        parts.append(records)
        total["renderer"] = facts.pop("renderer")
        for name, count in facts.items():
            total[name] += count
        for reason, count in mesh.dropped.items():
            cleaning[reason] = cleaning.get(reason, 0) + count
    records = np.concatenate(parts)
    sidecar = {
        "fingerprint": plan.fingerprint,
        "shard": shard,
        "mesh_ids": [plan.shards[shard].start, plan.shards[shard].stop],
        "n_clouds": len(records),
        "n_blind_views": (len(plan.shards[shard]) - len(failures)) * plan.clouds_a_mesh - len(records),
        "n_with_repeats": int((records["n_visible"] < plan.recipe.sample_size).sum()),
        "failures": failures,
        "faces_dropped": cleaning,
        "seconds": time.perf_counter() - began,
        **total,
    }
    (out / FOLDER).mkdir(exist_ok=True)
    atomic.write(records_path(out, shard), lambda file: np.save(file, records))
    atomic.write_json(sidecar_path(out, shard), sidecar)
    return sidecar
