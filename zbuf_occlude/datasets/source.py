"""Readers of the clouds of a dataset: records by number, in the order of the files."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.base.arrays import BoolArray
from zbuf_occlude.base.atomic import REMEDY, reading
from zbuf_occlude.base.errors import DatasetError
from zbuf_occlude.datasets.cloud_folder import CloudFolder, cloud_files
from zbuf_occlude.datasets.folder import PLAN, read_finished
from zbuf_occlude.datasets.formats import find_format
from zbuf_occlude.datasets.plan import Numbers, Plan
from zbuf_occlude.datasets.records import IDS, Records, record_type
from zbuf_occlude.meshes.sampling import SurfacePoints
from zbuf_occlude.views import Views


class StoredSampling(NamedTuple):
    """One stored sampling of a mesh, or its scans and a sampling.

    `points` (n) are those that the k `views` see by `mask` (k, n); `whole` is the sampling of the whole surface,
    rounded. Views and the object's `longest_side` are in world units, of scans in metres. Normals of `whole` that are
    not kept are zero.
    """

    points: SurfacePoints
    mask: BoolArray
    views: Views
    longest_side: float
    whole: SurfacePoints


@dataclass(frozen=True, eq=False)
class CloudReader:
    """Reader of the clouds of a dataset. Each cloud has a number."""

    plan: Plan
    order: dict[str, Numbers]
    """The numbers of each split's clouds in the order of its files; splits without clouds are not there."""
    take: Callable[[Numbers], Records]
    """Returns the records (`record_type`) of some numbers, in the order of the numbers."""
    blocks_of: Callable[[Numbers], Numbers | None] = lambda numbers: None
    """Returns the block of each number: clouds of a block are read quickly together. None: neighbours are."""
    complete: Callable[[Any, int], Any] | None = None
    """Returns a record of the whole surface of a record's object, in that record's frame, from the record and a number
    of points. None where only the points drawn are kept."""
    block: Callable[[int, int], StoredSampling] | None = None
    """Returns a sampling, from its mesh's index and variation; where `complete` is."""
    sizes: Mapping[str, list[int]] = field(default_factory=dict)
    """Number of clouds of each file that is written of them; `Plan.clouds_per_file` by default."""
    ids: Callable[[], NDArray[Any]] = lambda: np.empty(0, IDS)
    """Returns the ids, (n,) of `IDS`, of clouds by number."""
    sweeps: Sequence[str] | None = None
    """Names of the sweeps of real scans, by mesh id; None where clouds are simulated."""

    @property
    def origins(self) -> list[str]:
        """Name of the group of a mesh's clouds: the object, or the sweep of a real scan."""
        return [entry.key for entry in self.plan.meshes] if self.sweeps is None else list(self.sweeps)

    @property
    def has_ranges(self) -> bool:
        """True where the distances of views are ranges of a sensor, in metres; of some real scans they are NaN."""
        return self.sweeps is not None or self.plan.config.scan is not None

    @property
    def n_clouds(self) -> dict[str, int]:
        """Clouds of each split."""
        return {split: len(numbers) for split, numbers in self.order.items()}

    def files(self, split: str) -> Iterator[tuple[int, Numbers]]:
        """Yield the number and the clouds of each file of a split; empty files are left out."""
        numbers = self.order[split]
        full = self.plan.clouds_per_file
        sizes = self.sizes.get(split) or [full] * -(-len(numbers) // full)
        for number, (end, size) in enumerate(zip(np.cumsum(sizes).tolist(), sizes, strict=True)):
            if size:
                yield number, numbers[end - size : end]

    def batches(self, split: str, size: int | None = None, *, in_any_order: bool = False) -> Iterator[Records]:
        """Yield the records of a split, `size` or a full file's at a time; `in_any_order` in the fastest read one."""
        numbers, size = self.order[split], size or self.plan.clouds_per_file
        if in_any_order and (blocks := self.blocks_of(numbers)) is not None:
            numbers = numbers[np.argsort(blocks, kind="stable")]
        for start in range(0, len(numbers), size):
            yield self.take(numbers[start : start + size])


def open_dataset(folder: Path, redrawn: Plan | None = None, *, to_show: bool = False) -> CloudReader:
    """Return the clouds of a complete dataset, or of a folder of cloud files by class.

    `redrawn` is another plan of the same meshes, by which the clouds of a packed dataset are drawn and ordered. A
    damaged dataset is a DatasetError, and so is a published layout; `to_show` reads layouts of completion too, z up
    again.
    """
    if not (folder / PLAN).exists() and cloud_files(folder):
        clouds = CloudFolder(folder)
        return CloudReader(clouds.plan, clouds.order, clouds.take, ids=clouds.ids, sweeps=clouds.origins)
    plan, manifest = read_finished(folder)
    row = find_format(plan.format)
    assert redrawn is None or row.whole_objects  # no other has the points to draw from
    read = getattr(row.load(), "read", None) if to_show or not row.exported_from else None
    if read is None:
        cure = f"Make the {row.exported_from} dataset, and its export by `zbuf-occlude convert`."
        if row.from_meshes:
            cure = "Make the format that you need from the meshes, by `zbuf-occlude generate`."
        raise DatasetError(
            f"{folder} must be in a format that is read back; it is an export for the loaders of {plan.format}. {cure}"
        )
    source: CloudReader = read(folder, redrawn or plan, manifest["files"])
    if source.n_clouds != (expected := manifest["counts"]["clouds_by_split"]):
        raise DatasetError(
            f"{folder} must have the clouds that its manifest counts, {expected}; it has {source.n_clouds}. {REMEDY}"
        )
    return source


def kept(whole: Callable[[Path], Records]) -> Callable[[Path, Numbers], Records]:
    """Return a `load` for `source_of_files` that reads files whole and keeps the last one in memory."""
    last = lru_cache(maxsize=1)(whole)
    return lambda path, rows: last(path)[rows]


def source_of_files(
    plan: Plan,
    out: Path,
    files: Mapping[str, list[str]],
    count: Callable[[Path], int],
    load: Callable[[Path, Numbers], Records],
    *,
    read_ids: Callable[[Path], NDArray[Any]] | None = None,
) -> CloudReader:
    """Return a source over files of a folder, by split, that hold records; one that cannot be read is a DatasetError.

    `count` returns the number of clouds in a file, `load` the records of some rows of one, in the order of the rows;
    `read_ids` returns the ids of a file's clouds, (n,) of `IDS`; by default the file is loaded for them.
    """
    paths, sizes, order = list[Path](), list[int](), dict[str, Numbers]()
    for split, names in files.items():
        begin = sum(sizes)
        for name in names:
            paths.append(out / name)
            with reading(paths[-1]):
                sizes.append(count(paths[-1]))
        order[split] = np.arange(begin, sum(sizes))
    ends = np.cumsum(sizes)

    def take(numbers: Numbers) -> Records:
        owners = np.searchsorted(ends, numbers, side="right")
        records = np.empty(len(numbers), record_type(plan.config))
        for owner in np.unique(owners):
            mine = owners == owner
            with reading(paths[owner]):
                records[mine] = load(paths[owner], numbers[mine] - (ends[owner] - sizes[owner]))
                for name, n in (("label", len(plan.classes)), ("mesh_id", len(plan.meshes))):
                    found = records[name][mine]
                    if (strange := found[(found < 0) | (found >= n)]).size:
                        raise ValueError(f"{name} {strange.flat[0]}, where there are {n}")
        return records

    def ids() -> NDArray[Any]:
        found = np.empty(sum(sizes), IDS)
        for path, end, size in zip(paths, ends.tolist(), sizes, strict=True):
            with reading(path):
                whole = load(path, np.arange(size)) if read_ids is None else read_ids(path)
            for name in IDS.names or ():
                found[name][end - size : end] = whole[name]
        return found

    n_files = iter(sizes)
    return CloudReader(
        plan, order, take, sizes={split: [next(n_files) for _ in files[split]] for split in files}, ids=ids
    )
