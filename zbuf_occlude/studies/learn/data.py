"""Labelled clouds of equal size in memory, to train and to test classifiers."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import reduce
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zbuf_occlude.base.arrays import shape_and_dtype
from zbuf_occlude.base.atomic import reading
from zbuf_occlude.base.errors import ArgumentError, DatasetError
from zbuf_occlude.datasets.records import pad_or_truncate
from zbuf_occlude.datasets.source import CloudReader, open_dataset
from zbuf_occlude.meshes.collection import SPLITS

_CLOUDS_AT_ONCE = 2048
RAGGED = 1024
"""Default number of points of clouds that are all of unequal size."""


@dataclass(frozen=True, eq=False)
class CloudSet:
    """Clouds with the label, the origin and the sensor's place of each.

    Raises ArgumentError for arrays of unequal length, labels outside `classes`, or positions that are not finite.
    """

    positions: NDArray[np.float32]  # (m, n, 3), m clouds of n points in random order, centred, longest side 1
    labels: NDArray[np.int64]  # (m,), index into `classes`
    classes: tuple[str, ...]
    group_ids: NDArray[np.int64]  # (m,), equal for clouds of one origin: one object, or one sweep of a real LiDAR
    elevations: NDArray[np.float32]  # (m,), elevation of the camera, radians; NaN for a complete shape
    ranges: NDArray[np.float32] | None = None  # (m,), ranges of scans, metres; NaN, the default: unknown
    n_measured: NDArray[np.int64] | None = None  # (m,), points of scans before some were drawn; 0, the default: unknown
    scale: str = "cloud"  # as `DatasetConfig.scale`; with "metres" classifiers use the sizes

    def __post_init__(self) -> None:
        positions = np.ascontiguousarray(self.positions, dtype=np.float32)
        if positions.ndim != 3 or positions.shape[2] != 3 or positions.shape[1] < 1:
            raise ArgumentError(
                f"positions must be (m, n, 3) float, n at least 1; got {shape_and_dtype(self.positions)}."
            )
        if not np.isfinite(positions).all():
            bad = int(np.flatnonzero(~np.isfinite(positions).all(axis=(1, 2)))[0])
            raise ArgumentError(f"positions must be finite; those of cloud {bad} are not. Leave it out.")
        labels = np.ascontiguousarray(self.labels, dtype=np.int64)
        group_ids = np.ascontiguousarray(self.group_ids, dtype=np.int64)
        elevations = np.ascontiguousarray(self.elevations, dtype=np.float32)
        m = len(positions)
        ranges = np.full(m, np.nan, np.float32) if self.ranges is None else np.asarray(self.ranges, np.float32)
        n_measured = np.zeros(m, np.int64) if self.n_measured is None else np.asarray(self.n_measured, np.int64)
        columns: dict[str, NDArray[Any]] = {"labels": labels, "group_ids": group_ids, "elevations": elevations}
        columns |= {"ranges": ranges, "n_measured": n_measured}
        for name, column in columns.items():
            if column.shape != (len(positions),):
                raise ArgumentError(
                    f"{name} must be ({len(positions)},), one per cloud; got {shape_and_dtype(column)}."
                )
            object.__setattr__(self, name, column)
        if len(labels) and not 0 <= labels.min() <= labels.max() < len(self.classes):
            raise ArgumentError(
                f"labels must lie in [0, {len(self.classes)}), the classes; got {labels.min()} to {labels.max()}."
            )
        object.__setattr__(self, "positions", positions)
        object.__setattr__(self, "classes", tuple(self.classes))

    def __len__(self) -> int:
        return len(self.positions)

    def __repr__(self) -> str:
        return f"CloudSet({len(self)} clouds of {self.n_points} points, {len(self.classes)} classes)"

    @property
    def n_points(self) -> int:
        """Points of each cloud."""
        return int(self.positions.shape[1])

    @property
    def keeps_size(self) -> bool:
        """True where clouds have their true sizes: in metres, or as they are in files."""
        return self.scale in ("metres", "mesh")

    @property
    def labelled(self) -> list[str]:
        """The classes that have clouds, in the order of `classes`."""
        return [self.classes[label] for label in np.unique(self.labels)]

    def subset(self, which: ArrayLike) -> "CloudSet":
        """Return the clouds that a boolean mask or an index array selects, in its order."""
        chosen = np.asarray(which)
        if chosen.size == 0:
            chosen = chosen.astype(np.intp)
        return replace(self, **{name: getattr(self, name)[chosen] for name in _COLUMNS})

    def select_points(self, n: int, seed: int) -> "CloudSet":
        """Return the same clouds with `n` of their points each, drawn at random.

        The points of each cloud are in random order, so all clouds can share the same indices. Raises ArgumentError
        where `n` is less than 1 or more than the clouds have.
        """
        if not 1 <= n <= self.n_points:
            raise ArgumentError(f"n must lie in 1..{self.n_points}, the points of each cloud; got {n}.")
        indices = np.random.default_rng(seed).permutation(self.n_points)[:n]
        return replace(self, positions=self.positions[:, indices])

    def thinned(self, groups: ArrayLike, most: int, seed: int) -> "CloudSet":
        """Return at most `most` clouds of each group (groups: (m,) int), drawn at random; the order is kept."""
        groups = np.asarray(groups)
        order = np.lexsort((np.random.default_rng(seed).random(len(self)), groups))
        sorted_groups = groups[order]
        first = np.searchsorted(sorted_groups, sorted_groups)  # index at which each cloud's group begins
        return self.subset(np.sort(order[np.arange(len(self)) - first < most]))

    def with_classes(self, classes: Sequence[str]) -> "CloudSet":
        """Return the same clouds with labels that are indices into other classes, by name.

        Raises ArgumentError where a class that has clouds is not among them.
        """
        if unknown := [label for label in self.labelled if label not in classes]:
            raise ArgumentError(f"classes must have {', '.join(unknown)}; they are {', '.join(classes)}.")
        places = np.array([classes.index(label) if label in classes else -1 for label in self.classes], np.int64)
        return replace(self, labels=places[self.labels], classes=tuple(classes))

    @classmethod
    def concatenate(cls, first: "CloudSet", second: "CloudSet") -> "CloudSet":
        """Return the clouds of two sets, those of `first` before those of `second`; group ids are kept.

        Raises ArgumentError where the classes or the sizes of the clouds differ.
        """
        if ("metres" in (first.scale, second.scale)) and not (first.keeps_size and second.keeps_size):
            raise ArgumentError(
                f"both sets must be in metres; their scales are {first.scale} and {second.scale}. Generate both with "
                "--scale metres."
            )
        if first.classes != second.classes or first.n_points != second.n_points:
            raise ArgumentError(
                f"both sets must have the same classes and the same size of clouds; got {first!r} of "
                f"{', '.join(first.classes)} and {second!r} of {', '.join(second.classes)}."
            )
        pairs = ((getattr(first, name), getattr(second, name)) for name in _COLUMNS)
        columns = dict(zip(_COLUMNS, map(np.concatenate, pairs), strict=True))
        scale = "metres" if "metres" in (first.scale, second.scale) else first.scale
        return cls(**columns, classes=first.classes, scale=scale)


_COLUMNS = tuple(each.name for each in fields(CloudSet) if each.name not in ("classes", "scale"))
"""Fields with a row per cloud."""


def load_datasets(folders: Sequence[Path], split: str, ragged: int) -> CloudSet:
    """Read one split of several datasets, of any format, or folders of cloud files by class.

    The classes are the union by name. All clouds have the least size of them; where all are of unequal size, `ragged`
    points. Clouds of one object, or of one sweep, have one group id in all datasets.

    Raises DatasetError as `load_clouds` does, where a folder is given twice, and where a dataset shares no class with
    those before it.
    """
    for folder, times in Counter(folder.resolve() for folder in folders).items():
        if times > 1:
            raise DatasetError(f"datasets must be different folders; {folder} is given {times} times. Give it once.")
    readers = [open_dataset(folder) for folder in folders]
    sizes = [size for reader in readers if (size := reader.plan.config.sample_size) is not None]
    n_points = min(sizes, default=ragged)
    sets = [_read_split(reader, folder, split, n_points) for reader, folder in zip(readers, folders, strict=True)]
    classes = list(sets[0].classes)
    for folder, clouds in zip(folders[1:], sets[1:], strict=True):
        if not set(classes) & set(clouds.classes):
            raise DatasetError(
                f"datasets must share a class; {folder} has {', '.join(clouds.classes)}, the others have "
                f"{', '.join(classes)}. Name classes alike: rename the folders, or crop with --classes."
            )
        classes += [label for label in clouds.classes if label not in classes]
    if any(clouds.classes != sets[0].classes for clouds in sets):
        classes.sort()
    origins = [_origins(reader) for reader in readers]
    number_of = {name: number for number, name in enumerate(dict.fromkeys(name for each in origins for name in each))}
    joined = [
        replace(clouds.with_classes(classes), group_ids=np.array([number_of[name] for name in each])[clouds.group_ids])
        for clouds, each in zip(sets, origins, strict=True)
    ]
    return reduce(CloudSet.concatenate, joined)


def shared_objects(folders: Sequence[Path]) -> Iterator[tuple[str, int, int]]:
    """Yield each split with objects that another dataset has in train: its name, their number, and that of all."""
    plans = [reader.plan for reader in map(open_dataset, folders) if reader.sweeps is None]
    keys = [{split: {e.key for e in plan.meshes if e.split == split} for split in SPLITS} for plan in plans]
    for split in SPLITS[1:]:
        shared = {
            key for mine in keys for theirs in keys if theirs is not mine for key in mine[split] & theirs["train"]
        }
        if shared:
            yield split, len(shared), len(set().union(*(mine[split] for mine in keys)))


def _origins(reader: CloudReader) -> list[str]:
    """Return the names of the origins of clouds by group id: of simulated ones the keys of meshes, in their order."""
    return reader.origins if reader.sweeps is None else sorted(set(reader.origins))


def load_clouds(folder: Path, split: str, n_points: int | None = None) -> CloudSet:
    """Read one split of a dataset into memory, in its order: of any format, or a folder of cloud files by class.

    ``group_ids`` are mesh ids, and of real scans the numbers of their sweeps.

    The first `n_points` of each cloud are read (the order of points is random); all of them by default. Clouds of
    unequal size need `n_points`; those with fewer points repeat some. Complete clouds have no elevation.

    Raises DatasetError where the folder holds no complete dataset, where files are damaged, where the split is missing,
    or where the clouds have fewer points.
    """
    return _read_split(open_dataset(folder), folder, split, n_points)


def _read_split(source: CloudReader, folder: Path, split: str, n_points: int | None) -> CloudSet:
    """Read one split from a folder's reader, as `load_clouds`."""
    size = source.plan.config.sample_size
    if split not in source.order:
        raise DatasetError(f"{folder} must have clouds of the split {split}; it has {', '.join(source.order)}.")
    if size is None and n_points is None:
        raise DatasetError(
            f"clouds must be of one size here; those in {folder} are not (--sample-size all). Generate them with a "
            "number of points, or read them with n_points."
        )
    if n_points is not None and not 1 <= n_points <= (size or n_points):
        raise DatasetError(f"n_points must lie in 1..{size}, the size of the clouds in {folder}; got {n_points}.")
    numbers = np.sort(source.order[split])
    positions = np.empty((len(numbers), n_points or source.plan.config.equal_size, 3), dtype=np.float32)
    labels, mesh_ids, n_measured = np.zeros((3, len(numbers)), dtype=np.int64)
    elevations, ranges = np.full((2, len(numbers)), np.nan, dtype=np.float32)
    for start in range(0, len(numbers), _CLOUDS_AT_ONCE):
        rows = slice(start, start + _CLOUDS_AT_ONCE)
        records = source.take(numbers[rows])
        if size is None:
            positions[rows] = [pad_or_truncate(points, positions.shape[1]) for points in records["data"]]
        else:
            positions[rows] = records["data"][:, : positions.shape[1]]
        labels[rows], mesh_ids[rows] = records["label"][:, 0], records["mesh_id"]
        if not source.plan.config.complete:
            elevations[rows] = records["view"][:, 1]
            if source.has_ranges:
                ranges[rows], n_measured[rows] = records["view"][:, 2], records["n_visible"]
    number_of = {name: number for number, name in enumerate(_origins(source))}
    group_ids = np.array([number_of[name] for name in source.origins])[mesh_ids]
    with reading(folder):  # CloudSet refuses NaN
        return CloudSet(
            positions,
            labels,
            tuple(source.plan.classes),
            group_ids,
            elevations,
            ranges,
            n_measured,
            source.plan.config.scale,
        )
