"""A shard: the clouds of a few meshes in one file, and the sidecar, written last, that says it is done."""

import time
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, ClassVar, Protocol

from zbuf_occlude.arrays import BoolArray
from zbuf_occlude.dataset import atomic
from zbuf_occlude.dataset.damage import reading
from zbuf_occlude.dataset.folder import Kinds, read_object
from zbuf_occlude.dataset.formats import find_format
from zbuf_occlude.dataset.packed import Archives, PackedStore
from zbuf_occlude.dataset.pipeline import occlude
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.dataset.records import RecordStore, source_of_records
from zbuf_occlude.dataset.source import Source
from zbuf_occlude.errors import ArgumentError, DatasetError, MeshError
from zbuf_occlude.mesh import Mesh
from zbuf_occlude.sampling import SurfacePoints
from zbuf_occlude.views import Views

FOLDER = "shards"
_OF_SIDECAR: Kinds = {
    "failures": dict,
    "faces_dropped": dict,
    "fingerprint": str,
    "renderer": str,
    "seconds": (int, float),
    **dict.fromkeys(("n_clouds", "n_blind_views", "n_with_repeats", "n_checked", "false_visible", "false_hidden"), int),
}


class Store(Protocol):
    """Collects what is kept of the meshes of a shard, and writes it as one file."""

    suffix: ClassVar[str]

    def keep(self, points: SurfacePoints, mask: BoolArray, views: Views, key: str, variation: int) -> Any:
        """Take what is to be kept of one sampling of a mesh (`pipeline.Keep`)."""

    def add(self, mesh_id: int, mesh: Mesh, kept: list[Any]) -> None:
        """Take in what was kept of all samplings of a mesh; none of a mesh that failed half way."""

    def write(self, path: Path) -> None:
        """Write the file, whole or not at all."""


def new_store(plan: Plan) -> Store:
    """Return what collects the clouds of a plan's shards, by its format."""
    return PackedStore(plan) if find_format(plan.format).keeps_points else RecordStore(plan)


def source_of_shards(plan: Plan, paths: list[Path]) -> Source:
    """Return the clouds of finished shards, in the order in which their files are to hold them."""
    return Archives(plan, paths).source() if find_format(plan.format).keeps_points else source_of_records(plan, paths)


def data_path(plan: Plan, out: Path, shard: int) -> Path:
    """Where a shard's clouds are kept until the final files are made."""
    return out / FOLDER / f"{shard:06d}{new_store(plan).suffix}"


def sidecar_path(out: Path, shard: int) -> Path:
    """Where a shard's sidecar is; the shard is done if and only if this file exists."""
    return out / FOLDER / f"{shard:06d}.json"


def read_sidecar(out: Path, shard: int, fingerprint: str) -> dict[str, Any] | None:
    """Return the sidecar of a shard that is done, None for one that is not.

    Raises
    ------
    DatasetError
        The shard belongs to another plan, or its sidecar is damaged.
    """
    path = sidecar_path(out, shard)
    if not path.exists():
        return None
    with reading(path, "Delete it; `zbuf-occlude generate`, given the same, makes the shard again."):
        sidecar = read_object(path, _OF_SIDECAR)
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
    store = new_store(plan)
    failures: dict[str, str] = {}
    cleaning: dict[str, int] = {}
    total: dict[str, Any] = {"renderer": "none"}
    total |= dict.fromkeys(("n_clouds", "n_with_repeats", "n_checked", "false_visible", "false_hidden"), 0)
    for mesh_id in plan.shards[shard]:
        entry = plan.meshes[mesh_id]
        on_mesh(mesh_id)
        try:
            if mesh_id in lost:
                raise MeshError(lost[mesh_id])
            mesh = entry.load()
            kept, facts = occlude(mesh, plan.recipe, plan.views, entry.key, gl, store.keep)
        except (MeshError, ArgumentError) as error:  # the options have been tried: it is the mesh's numbers
            failures[entry.key] = str(error)
            continue
        except MemoryError:
            failures[entry.key] = f"the mesh must fit in memory; {entry.key} does not. Simplify it."
            continue
        store.add(mesh_id, mesh, kept)
        total["renderer"] = facts.pop("renderer")
        for name, count in facts.items():
            total[name] += count
        for reason, count in mesh.dropped.items():
            cleaning[reason] = cleaning.get(reason, 0) + count
    n_made = len(plan.shards[shard]) - len(failures)
    sidecar = {
        "fingerprint": plan.fingerprint,
        "shard": shard,
        "mesh_ids": [plan.shards[shard].start, plan.shards[shard].stop],
        "n_blind_views": n_made * plan.clouds_a_mesh - total["n_clouds"],
        "failures": failures,
        "faces_dropped": cleaning,
        "seconds": time.perf_counter() - began,
        **total,
    }
    (out / FOLDER).mkdir(exist_ok=True)
    store.write(data_path(plan, out, shard))
    atomic.write_json(sidecar_path(out, shard), sidecar)
    return sidecar
