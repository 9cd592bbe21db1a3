"""Where the clouds of a dataset come from when files are written or looked at: records by number, in their order."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.dataset.clouds import record_type
from zbuf_occlude.dataset.damage import reading
from zbuf_occlude.dataset.plan import CLOUDS_A_FILE, Plan
from zbuf_occlude.meshes.collection import SPLITS
from zbuf_occlude.seeds import seed_of

Numbers = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Source:
    """The clouds of a dataset, wherever they are kept.

    Parameters
    ----------
    plan : Plan
    order : dict of split to (n,) int
        The numbers of a split's clouds in the order of its files; splits without clouds are not there.
    take : callable
        Returns the records (`record_type`) of some numbers, in the order of the numbers.
    complete : callable, optional
        Returns a record of an object's whole surface, hidden points too, from its mesh's index and a number of points;
        only where all points of the objects are kept.
    blocks_of : callable
        Returns for each number the block that it is in, where the clouds of a block are quickly read together; None
        where neighbours in the order are.
    """

    plan: Plan
    order: dict[str, Numbers]
    take: Callable[[Numbers], NDArray[Any]]
    blocks_of: Callable[[Numbers], NDArray[Any] | None] = lambda numbers: None
    complete: Callable[[int, int], Any] | None = None

    @property
    def n_clouds(self) -> dict[str, int]:
        """Clouds of each split."""
        return {split: len(numbers) for split, numbers in self.order.items()}

    def batches(self, split: str, size: int = CLOUDS_A_FILE, *, in_any_order: bool = False) -> Iterator[NDArray[Any]]:
        """Yield the records of a split, `size` at a time; `in_any_order` in the one that is read fastest."""
        numbers = self.order[split]
        if in_any_order and (blocks := self.blocks_of(numbers)) is not None:
            numbers = numbers[np.argsort(blocks, kind="stable")]
        for start in range(0, len(numbers), size):
            yield self.take(numbers[start : start + size])


def mixed_order(plan: Plan, mesh_ids: NDArray[Any]) -> dict[str, Numbers]:
    """Return for each split the order in which clouds stand in its files: random, and decided by the plan's seed.

    Parameters
    ----------
    plan : Plan
    mesh_ids : (n,) int
        Of all clouds in the order of the plan: by mesh, variation, view.

    Notes
    -----
    Classes, objects and views are thereby mixed within every file.
    """
    split_of_mesh = np.array([SPLITS.index(entry.split) for entry in plan.meshes])
    order = {}
    for number, split in enumerate(SPLITS):
        chosen = np.flatnonzero(split_of_mesh[mesh_ids] == number)
        if len(chosen):
            order[split] = np.random.default_rng(seed_of(plan.recipe.seed, "order/" + split)).permutation(chosen)
    return order


def kept(whole: Callable[[Path], NDArray[Any]]) -> Callable[[Path, Numbers], NDArray[Any]]:
    """Return a `load` for `source_of_files` that reads files whole and keeps the last one in memory."""
    last = lru_cache(maxsize=1)(whole)
    return lambda path, rows: last(path)[rows]


def source_of_files(
    plan: Plan,
    files: dict[str, list[Path]],
    count: Callable[[Path], int],
    load: Callable[[Path, Numbers], NDArray[Any]],
) -> Source:
    """Return a source over files that hold records.

    Parameters
    ----------
    plan : Plan
    files : dict of split to paths
    count : callable
        Returns the number of clouds in a file.
    load : callable
        Returns the records of some rows of a file, in the order of the rows.

    Raises
    ------
    DatasetError
        A file cannot be read, here or when its clouds are taken.
    """
    paths = [path for split in files for path in files[split]]

    def counted(path: Path) -> int:
        with reading(path):
            return count(path)

    sizes = {split: [counted(path) for path in files[split]] for split in files}
    ends = np.cumsum([size for split in files for size in sizes[split]])

    def take(numbers: Numbers) -> NDArray[Any]:
        owners = np.searchsorted(ends, numbers, side="right")
        records = np.empty(len(numbers), record_type(plan.recipe))
        for owner in np.unique(owners):
            mine = owners == owner
            begin = ends[owner - 1] if owner else 0
            with reading(paths[owner]):
                records[mine] = load(paths[owner], numbers[mine] - begin)
                check_indices(records["label"][mine], records["mesh_id"][mine], plan)
        return records

    order, begin = {}, 0
    for split in files:
        order[split] = np.arange(begin, begin := begin + sum(sizes[split]))
    return Source(plan, order, take)


def check_indices(labels: NDArray[Any], mesh_ids: NDArray[Any], plan: Plan) -> None:
    """Raise ValueError for labels and mesh ids that the plan does not have; `damage.reading` says of which file."""
    for name, found, n in (("label", labels, len(plan.classes)), ("mesh_id", mesh_ids, len(plan.meshes))):
        if (strange := found[(found < 0) | (found >= n)]).size:
            raise ValueError(f"{name} {strange.flat[0]}, where there are {n}")
