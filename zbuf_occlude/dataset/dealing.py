"""How the meshes of a plan are dealt to groups, and groups cut into shards and final files: numbers, no meshes."""

from bisect import bisect_right
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple, overload

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.meshes.collection import SPLITS

MeshIds = NDArray[np.int32]


class Part(NamedTuple):
    """What is written at once: of a split, the file of this number, with clouds of this group."""

    group: int
    split: str
    number: int


def dealt(n_meshes: int, n_groups: int, seed: np.random.SeedSequence) -> list[MeshIds]:
    """Return the mesh indices of each group, ascending.

    Of as many neighbouring meshes as there are groups, each group is dealt one, at random: all have the same share of
    each class and split, whatever the order of the meshes.
    """
    hands = np.tile(np.arange(n_groups), (-(-n_meshes // n_groups), 1))
    group_of = np.random.default_rng(seed).permuted(hands, axis=1).ravel()[:n_meshes]
    ends = np.cumsum(np.bincount(group_of, minlength=n_groups))[:-1]
    return np.split(np.argsort(group_of, kind="stable").astype(np.int32), ends)


class Shards(Sequence[list[int]]):
    """The mesh indices of each shard, group by group, read off the groups when they are asked for.

    Parameters
    ----------
    groups : list of (n,) int
    step : int
        Meshes of a shard; of the last of a group there may be fewer.
    """

    def __init__(self, groups: list[MeshIds], step: int) -> None:
        self._groups, self._step = groups, step
        self._ends = np.cumsum([0, *(-(-len(group) // step) for group in groups)]).tolist()

    def __len__(self) -> int:
        return int(self._ends[-1])

    @overload
    def __getitem__(self, index: int) -> list[int]: ...
    @overload
    def __getitem__(self, index: slice) -> list[list[int]]: ...
    def __getitem__(self, index: int | slice) -> list[int] | list[list[int]]:
        """Return the meshes of a shard, or for a slice a list of them."""
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self)))]
        shard = range(len(self))[index]
        group = self.group_of(shard)
        begin = (shard - self._ends[group]) * self._step
        return self._groups[group][begin : begin + self._step].tolist()

    @property
    def of_groups(self) -> list[range]:
        """The shards of each group."""
        return [range(begin, end) for begin, end in pairwise(self._ends)]

    def group_of(self, shard: int) -> int:
        """Return the group that a shard's meshes are of."""
        return bisect_right(self._ends, shard) - 1


class Parts(Sequence[Part]):
    """The files of formats that put many clouds into one, group by group.

    Parameters
    ----------
    n_files : (g, s) int
        Of each group and split of `SPLITS`.
    """

    def __init__(self, n_files: NDArray[np.intp]) -> None:
        self._ends = np.cumsum([0, *n_files.ravel()]).tolist()
        self._before = (np.cumsum(n_files, axis=0) - n_files).ravel().tolist()

    def __len__(self) -> int:
        return int(self._ends[-1])

    @overload
    def __getitem__(self, index: int) -> Part: ...
    @overload
    def __getitem__(self, index: slice) -> list[Part]: ...
    def __getitem__(self, index: int | slice) -> Part | list[Part]:
        """Return a part, or for a slice a list of them."""
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self)))]
        part = range(len(self))[index]
        cell = bisect_right(self._ends, part) - 1
        group, split = divmod(cell, len(SPLITS))
        return Part(group, SPLITS[split], self._before[cell] + part - self._ends[cell])

    def of_group(self, group: int) -> range:
        """Return the parts that the clouds of a group go into."""
        return range(self._ends[group * len(SPLITS)], self._ends[(group + 1) * len(SPLITS)])

    def first(self, group: int, split: int) -> int:
        """Return the first part of a group's split."""
        return int(self._ends[group * len(SPLITS) + split])
