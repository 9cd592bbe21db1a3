"""Shards of records: the clouds of a few meshes, drawn already, as one .npy; the final files are made of them."""

from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.arrays import BoolArray
from zbuf_occlude.dataset import atomic, ragged
from zbuf_occlude.dataset.clouds import gather_clouds, record_type
from zbuf_occlude.dataset.damage import reading
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.dataset.source import Numbers, Source, check_indices, mixed_order
from zbuf_occlude.mesh import Mesh
from zbuf_occlude.sampling import SurfacePoints
from zbuf_occlude.views import Views


class RecordStore:
    """Collects the clouds of a shard."""

    def __init__(self, plan: Plan) -> None:
        self._plan = plan
        self._parts = [np.empty(0, record_type(plan.recipe))]

    suffix: ClassVar[str] = ".npy"

    def keep(self, points: SurfacePoints, mask: BoolArray, views: Views, key: str, variation: int) -> NDArray[Any]:
        """Draw the clouds of one sampling of a mesh."""
        return gather_clouds(points, mask, views, self._plan.recipe, key, variation)

    def add(self, mesh_id: int, mesh: Mesh, kept: list[NDArray[Any]]) -> None:
        """Take in what was kept of all samplings of a mesh."""
        label = self._plan.classes.index(self._plan.meshes[mesh_id].label)
        for records in kept:
            records["mesh_id"], records["label"] = mesh_id, label
            self._parts.append(records)

    def write(self, path: Path) -> None:
        """Write the file."""
        records = np.concatenate(self._parts)
        if self._plan.recipe.sample_size is None:
            atomic.write(path, lambda file: ragged.save(file, records, self._plan.recipe))
        else:
            atomic.write(path, lambda file: np.save(file, records))


def source_of_records(plan: Plan, paths: list[Path]) -> Source:
    """Return the clouds of finished shards, in the order in which their files are to hold them.

    Raises
    ------
    DatasetError
        A shard cannot be read.

    Notes
    -----
    The shards are mapped, not read: memory is needed for what is taken only.
    """
    shards = []
    for path in paths:
        with reading(path, "The same `zbuf-occlude generate` makes it again."):
            shards.append(_mapped(path, plan))
    owners = np.concatenate([np.full(len(shard), i) for i, shard in enumerate(shards)])
    rows = np.concatenate([np.arange(len(shard)) for shard in shards])
    mesh_ids = np.concatenate([shard["mesh_id"] for shard in shards])

    def take(numbers: Numbers) -> NDArray[Any]:
        records = np.empty(len(numbers), record_type(plan.recipe))
        mine_of = owners[numbers]
        for owner in np.unique(mine_of):
            mine = mine_of == owner
            records[mine] = shards[owner][rows[numbers[mine]]]
        return records

    return Source(plan, mixed_order(plan, mesh_ids), take)


def _mapped(path: Path, plan: Plan) -> NDArray[Any] | ragged.MappedShard:
    if plan.recipe.sample_size is None:
        mapped = ragged.MappedShard(path, plan.recipe)
        check_indices(mapped["label"], mapped["mesh_id"], plan)
        return mapped
    shard: NDArray[Any] = np.load(path, mmap_mode="r")
    if shard.dtype != record_type(plan.recipe) or shard.ndim != 1:
        raise ValueError(f"{shard.ndim} axes of {shard.dtype}")
    check_indices(shard["label"], shard["mesh_id"], plan)
    return shard
