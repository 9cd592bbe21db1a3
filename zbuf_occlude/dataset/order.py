"""Where each cloud stands in the files of a dataset: a random place, known before any cloud is made.

The meshes are dealt at random to groups (`Plan.groups`). In a group the clouds of a split are permuted, and cut into
files (`Plan.parts`). So a shard knows which file each of its clouds goes into, and keeps the clouds of a file together;
and a file is written as soon as the shards of its group are there, whatever other groups are at.

A view that sees nothing, or a mesh that cannot be used, leaves its places empty, and moves no other cloud.
"""

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.dataset import plan as plans
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.meshes.collection import SPLITS
from zbuf_occlude.seeds import seed_of

Indices = NDArray[np.intp]


class Order:
    """The places of all clouds of a plan.

    Parameters
    ----------
    plan : Plan
    """

    def __init__(self, plan: Plan) -> None:
        self._plan = plan
        n_meshes, n_groups = len(plan.meshes), len(plan.groups)
        self._group_of = np.empty(n_meshes, np.int32)
        self._rank_of = np.empty(n_meshes, np.int32)
        self._n_meshes = np.zeros((n_groups, len(SPLITS)), int)
        for group, mesh_ids in enumerate(plan.groups):
            self._group_of[mesh_ids] = group
            for split in range(len(SPLITS)):
                mine = mesh_ids[plan.split_of[mesh_ids] == split]
                self._rank_of[mine] = np.arange(len(mine))
                self._n_meshes[group, split] = len(mine)

    def places(
        self, mesh_ids: NDArray[Any], variations: NDArray[Any], view_ids: NDArray[Any]
    ) -> tuple[Indices, Indices]:
        """Return the part that each of some clouds (n,) is in, and its place there."""
        parts: Indices = np.empty(len(mesh_ids), int)
        places: Indices = np.empty(len(mesh_ids), int)
        recipe, n_views = self._plan.recipe, len(self._plan.views)
        samples = np.asarray(variations, int) * n_views + view_ids
        groups, splits = self._group_of[mesh_ids], self._plan.split_of[mesh_ids]
        for group, split in np.unique(np.stack([groups, splits], axis=1), axis=0).tolist():
            mine = (groups == group) & (splits == split)
            n_clouds = int(self._n_meshes[group, split]) * self._plan.clouds_per_mesh
            numbers = self._rank_of[mesh_ids[mine]].astype(int) * self._plan.clouds_per_mesh + samples[mine]
            found = _inverse(recipe.seed, SPLITS[split], group, n_clouds)[numbers]
            parts[mine] = self._plan.parts.first(group, split) + found // plans.CLOUDS_PER_FILE
            places[mine] = found % plans.CLOUDS_PER_FILE
        return parts, places


@lru_cache(maxsize=2 * len(SPLITS))
def _inverse(seed: int, split: str, group: int, n_clouds: int) -> Indices:
    """Return the place of each cloud of a group and split."""
    clouds_in_order = np.random.default_rng(seed_of(seed, "order/" + split, group)).permutation(n_clouds)
    places = np.empty_like(clouds_in_order)
    places[clouds_in_order] = np.arange(n_clouds)
    return places


@lru_cache(maxsize=2)
def order_of(plan: Plan) -> Order:
    """Return the order of a plan; the last ones are kept."""
    return Order(plan)
