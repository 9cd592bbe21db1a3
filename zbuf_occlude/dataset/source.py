"""Where the clouds of a dataset come from when files are written or looked at: records by number, in their order."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.dataset.atomic import reading
from zbuf_occlude.dataset.clouds import record_type
from zbuf_occlude.dataset.placement import CLOUDS_PER_FILE
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.meshes.collection import SPLITS

Numbers = NDArray[np.intp]
IDS = np.dtype([("mesh_id", "<i4"), ("variation", "<i4"), ("view_id", "<i4")])
"""What tells clouds apart."""


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
    sizes : mapping of split to list of int
        How many clouds each file has that is written of them; `CLOUDS_PER_FILE` where nothing is said.
    ids : callable
        Returns what each cloud is of, (n,) of `IDS`, by its number.
    """

    plan: Plan
    order: dict[str, Numbers]
    take: Callable[[Numbers], NDArray[Any]]
    blocks_of: Callable[[Numbers], NDArray[Any] | None] = lambda numbers: None
    complete: Callable[[int, int], Any] | None = None
    sizes: Mapping[str, list[int]] = field(default_factory=dict)
    ids: Callable[[], NDArray[Any]] = lambda: np.empty(0, IDS)

    @property
    def n_clouds(self) -> dict[str, int]:
        """Clouds of each split."""
        return {split: len(numbers) for split, numbers in self.order.items()}

    def files(self, split: str) -> Iterator[tuple[int, Numbers]]:
        """Yield the number and the clouds of each file that a split's are to fill; empty files are left out."""
        numbers = self.order[split]
        sizes = self.sizes.get(split) or [CLOUDS_PER_FILE] * -(-len(numbers) // CLOUDS_PER_FILE)
        for number, (end, size) in enumerate(zip(np.cumsum(sizes).tolist(), sizes, strict=True)):
            if size:
                yield number, numbers[end - size : end]

    def batches(self, split: str, size: int = CLOUDS_PER_FILE, *, in_any_order: bool = False) -> Iterator[NDArray[Any]]:
        """Yield the records of a split, `size` at a time; `in_any_order` in the one that is read fastest."""
        numbers = self.order[split]
        if in_any_order and (blocks := self.blocks_of(numbers)) is not None:
            numbers = numbers[np.argsort(blocks, kind="stable")]
        for start in range(0, len(numbers), size):
            yield self.take(numbers[start : start + size])


class Arranged(NamedTuple):
    """Clouds as they stand in files: numbers of each split in order, and how many of them each file has."""

    order: dict[str, Numbers]
    sizes: dict[str, list[int]]


def arranged(plan: Plan, files: Numbers, rows: Numbers) -> Arranged:
    """Arrange clouds by their files, indices into ``plan.files``, and their rows there."""
    numbers = np.lexsort((rows, files))
    n_clouds = np.bincount(files, minlength=len(plan.files))
    split_of_file = np.array([file.split for file in plan.files])
    split_of = split_of_file[files[numbers]]
    present = [split for split in SPLITS if (split_of == split).any()]
    return Arranged(
        {split: numbers[split_of == split] for split in present},
        {split: n_clouds[split_of_file == split].tolist() for split in present},
    )


def kept(whole: Callable[[Path], NDArray[Any]]) -> Callable[[Path, Numbers], NDArray[Any]]:
    """Return a `load` for `source_of_files` that reads files whole and keeps the last one in memory."""
    last = lru_cache(maxsize=1)(whole)
    return lambda path, rows: last(path)[rows]


def source_of_files(
    plan: Plan,
    files: dict[str, list[Path]],
    count: Callable[[Path], int],
    load: Callable[[Path, Numbers], NDArray[Any]],
    *,
    read_ids: Callable[[Path], NDArray[Any]] | None = None,
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
    read_ids : callable, optional
        Returns what the clouds of a file are of, (n,) of `IDS`; by default by loading them.

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

    def ids() -> NDArray[Any]:
        found: list[NDArray[Any]] = []
        for path, size in zip(paths, (size for split in files for size in sizes[split]), strict=True):
            with reading(path):
                whole = load(path, np.arange(size)) if read_ids is None else read_ids(path)
            found.append(np.empty(size, IDS))
            for name in IDS.names or ():
                found[-1][name] = whole[name]
        return np.concatenate(found)

    return Source(plan, order, take, sizes=sizes, ids=ids)


def check_indices(labels: NDArray[Any], mesh_ids: NDArray[Any], plan: Plan) -> None:
    """Raise ValueError for labels and mesh ids that the plan does not have; `atomic.reading` says of which file."""
    for name, found, n in (("label", labels, len(plan.classes)), ("mesh_id", mesh_ids, len(plan.meshes))):
        if (strange := found[(found < 0) | (found >= n)]).size:
            raise ValueError(f"{name} {strange.flat[0]}, where there are {n}")
