"""Where the clouds of a plan go, known before they exist: meshes to groups, batches and files, clouds to rows.

Meshes are dealt at random to groups. A *group* is a few final files, whose clouds are mixed at random; it is what
machines of a farm share. A *batch* is a few meshes of a group: what a worker makes at a time. A view that sees nothing,
or a mesh that fails, leaves its rows empty and moves no other cloud, so nothing here depends on what happens.
"""

from bisect import bisect_right
from collections.abc import Sequence
from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple, overload

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.meshes.collection import SPLITS
from zbuf_occlude.provenance import seed_of

MeshIds = NDArray[np.int32]
Indices = NDArray[np.intp]

CLOUDS_PER_FILE = 2048
"""Clouds of a full file."""


class File(NamedTuple):
    """A file of a dataset: file `number` of a split, with clouds of one group."""

    group: int
    split: str
    number: int


def deal(n_meshes: int, n_groups: int, seed: np.random.SeedSequence) -> list[MeshIds]:
    """Return the mesh indices of each group, ascending.

    Of each run of `n_groups` neighbouring meshes every group gets one, at random: so all groups have the same share of
    each class and split, whatever the order of the meshes.
    """
    hands = np.tile(np.arange(n_groups), (-(-n_meshes // n_groups), 1))
    group_of = np.random.default_rng(seed).permuted(hands, axis=1).ravel()[:n_meshes]
    ends = np.cumsum(np.bincount(group_of, minlength=n_groups))[:-1]
    return np.split(np.argsort(group_of, kind="stable").astype(np.int32), ends)


class Batches(Sequence[list[int]]):
    """The mesh indices of each batch, group by group.

    Parameters
    ----------
    groups : list of (n,) int
        Mesh indices of each group.
    size : int
        Meshes of a batch; the last batch of a group may have fewer.
    """

    def __init__(self, groups: list[MeshIds], size: int) -> None:
        self._groups, self._size = groups, size
        self._ends = np.cumsum([0, *(-(-len(group) // size) for group in groups)]).tolist()

    def __len__(self) -> int:
        return int(self._ends[-1])

    @overload
    def __getitem__(self, index: int) -> list[int]: ...
    @overload
    def __getitem__(self, index: slice) -> list[list[int]]: ...
    def __getitem__(self, index: int | slice) -> list[int] | list[list[int]]:
        """Return the meshes of a batch, or of a slice of them."""
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self)))]
        batch = range(len(self))[index]
        group = self.group_of(batch)
        begin = (batch - self._ends[group]) * self._size
        return self._groups[group][begin : begin + self._size].tolist()

    @property
    def of_groups(self) -> list[range]:
        """The batches of each group."""
        return [range(begin, end) for begin, end in pairwise(self._ends)]

    def group_of(self, batch: int) -> int:
        """Return the group that a batch belongs to."""
        return bisect_right(self._ends, batch) - 1


class Files(Sequence[File]):
    """All files of a dataset, group by group.

    Parameters
    ----------
    n_files : (g, s) int
        Files of each group and split of `SPLITS`.
    """

    def __init__(self, n_files: NDArray[np.intp]) -> None:
        self._ends = np.cumsum([0, *n_files.ravel()]).tolist()
        self._before = (np.cumsum(n_files, axis=0) - n_files).ravel().tolist()

    def __len__(self) -> int:
        return int(self._ends[-1])

    @overload
    def __getitem__(self, index: int) -> File: ...
    @overload
    def __getitem__(self, index: slice) -> list[File]: ...
    def __getitem__(self, index: int | slice) -> File | list[File]:
        """Return a file, or a slice of them."""
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self)))]
        file = range(len(self))[index]
        cell = bisect_right(self._ends, file) - 1
        group, split = divmod(cell, len(SPLITS))
        return File(group, SPLITS[split], self._before[cell] + file - self._ends[cell])

    def of_group(self, group: int) -> range:
        """Return the files of a group."""
        return range(self._ends[group * len(SPLITS)], self._ends[(group + 1) * len(SPLITS)])

    def first(self, group: int, split: int) -> int:
        """Return the first file of a group's split."""
        return int(self._ends[group * len(SPLITS) + split])


class Placement:
    """The file and row of every cloud of a plan.

    Parameters
    ----------
    groups : list of (n,) int
        Mesh indices of each group.
    split_of : (m,) int
        Of each mesh, an index into `SPLITS`.
    files : Files
    n_variations, n_views : int
    seed : int
    """

    def __init__(
        self,
        groups: list[MeshIds],
        split_of: NDArray[np.uint8],
        files: Files,
        n_variations: int,
        n_views: int,
        seed: int,
    ) -> None:
        self._split_of, self._files, self._seed = split_of, files, seed
        self._n_views, self._per_mesh = n_views, n_variations * n_views
        self._group_of, self._rank_of = np.empty(len(split_of), np.int32), np.empty(len(split_of), np.int32)
        self._n_meshes = np.zeros((len(groups), len(SPLITS)), int)
        for group, mesh_ids in enumerate(groups):
            self._group_of[mesh_ids] = group
            for split in range(len(SPLITS)):
                mine = mesh_ids[split_of[mesh_ids] == split]
                self._rank_of[mine] = np.arange(len(mine))
                self._n_meshes[group, split] = len(mine)

    def of(
        self, mesh_ids: NDArray[np.int_], variations: NDArray[np.int_], view_ids: NDArray[np.int_]
    ) -> tuple[Indices, Indices]:
        """Return the file of each of some clouds (n,), an index into `Files`, and the row there."""
        files: Indices = np.empty(len(mesh_ids), int)
        rows: Indices = np.empty(len(mesh_ids), int)
        samples = np.asarray(variations, int) * self._n_views + view_ids
        groups, splits = self._group_of[mesh_ids], self._split_of[mesh_ids]
        for group, split in np.unique(np.stack([groups, splits], axis=1), axis=0).tolist():
            mine = (groups == group) & (splits == split)
            n_clouds = int(self._n_meshes[group, split]) * self._per_mesh
            numbers = self._rank_of[mesh_ids[mine]].astype(int) * self._per_mesh + samples[mine]
            found = _shuffled(self._seed, SPLITS[split], group, n_clouds)[numbers]
            files[mine] = self._files.first(group, split) + found // CLOUDS_PER_FILE
            rows[mine] = found % CLOUDS_PER_FILE
        return files, rows


@lru_cache(maxsize=2 * len(SPLITS))
def _shuffled(seed: int, split: str, group: int, n_clouds: int) -> Indices:
    """Return the place of each cloud of a group's split: a random permutation."""
    in_order = np.random.default_rng(seed_of(seed, "order/" + split, group)).permutation(n_clouds)
    places = np.empty_like(in_order)
    places[in_order] = np.arange(n_clouds)
    return places
