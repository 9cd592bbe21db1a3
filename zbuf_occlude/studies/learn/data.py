"""Labelled clouds of equal size in memory, to train and to test classifiers."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zbuf_occlude.base.arrays import shape_and_dtype
from zbuf_occlude.base.atomic import reading
from zbuf_occlude.base.errors import ArgumentError, DatasetError
from zbuf_occlude.datasets.records import pad_or_truncate
from zbuf_occlude.datasets.source import open_dataset

_CLOUDS_AT_ONCE = 2048


@dataclass(frozen=True, eq=False)
class CloudSet:
    """Clouds with the label, the object and the camera's elevation of each.

    Raises ArgumentError for arrays of unequal length, labels outside `classes`, or positions that are not finite.
    """

    positions: NDArray[np.float32]  # (m, n, 3), m clouds of n points in random order, centred, longest side 1
    labels: NDArray[np.int64]  # (m,), index into `classes`
    classes: tuple[str, ...]
    object_ids: NDArray[np.int64]  # (m,), equal for clouds of one object
    elevations: NDArray[np.float32]  # (m,), elevation of the camera, radians; NaN for a complete shape

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
        object_ids = np.ascontiguousarray(self.object_ids, dtype=np.int64)
        elevations = np.ascontiguousarray(self.elevations, dtype=np.float32)
        columns: dict[str, NDArray[Any]] = {"labels": labels, "object_ids": object_ids, "elevations": elevations}
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
    def labelled(self) -> list[str]:
        """The classes that have clouds, in the order of `classes`."""
        return [self.classes[label] for label in np.unique(self.labels)]

    def subset(self, which: ArrayLike) -> "CloudSet":
        """Return the clouds that a boolean mask or an index array selects, in its order."""
        chosen = np.asarray(which)
        if chosen.size == 0:
            chosen = chosen.astype(np.intp)
        return replace(
            self,
            positions=self.positions[chosen],
            labels=self.labels[chosen],
            object_ids=self.object_ids[chosen],
            elevations=self.elevations[chosen],
        )

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

    @classmethod
    def concatenate(cls, first: "CloudSet", second: "CloudSet") -> "CloudSet":
        """Return the clouds of two sets, those of `first` before those of `second`; object ids are kept.

        Raises ArgumentError where the classes or the sizes of the clouds differ.
        """
        if first.classes != second.classes or first.n_points != second.n_points:
            raise ArgumentError(
                f"both sets must have the same classes and the same size of clouds; got {first!r} of "
                f"{', '.join(first.classes)} and {second!r} of {', '.join(second.classes)}."
            )
        return cls(
            np.concatenate([first.positions, second.positions]),
            np.concatenate([first.labels, second.labels]),
            first.classes,
            np.concatenate([first.object_ids, second.object_ids]),
            np.concatenate([first.elevations, second.elevations]),
        )


def load_clouds(folder: Path, split: str, n_points: int | None = None) -> CloudSet:
    """Read one split of a dataset of any format into memory, in its order; ``object_ids`` are its mesh ids.

    The first `n_points` of each cloud are read (the order of points is random); all of them by default. Clouds of
    unequal size need `n_points`; those with fewer points repeat some. Complete clouds have no elevation.

    Raises DatasetError where the folder holds no complete dataset, where files are damaged, where the split is missing,
    or where the clouds have fewer points.
    """
    source = open_dataset(folder)
    size = source.plan.recipe.sample_size
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
    positions = np.empty((len(numbers), n_points or source.plan.recipe.equal_size, 3), dtype=np.float32)
    labels, object_ids = np.empty((2, len(numbers)), dtype=np.int64)
    elevations = np.full(len(numbers), np.nan, dtype=np.float32)
    for start in range(0, len(numbers), _CLOUDS_AT_ONCE):
        rows = slice(start, start + _CLOUDS_AT_ONCE)
        records = source.take(numbers[rows])
        if size is None:
            positions[rows] = [pad_or_truncate(points, positions.shape[1]) for points in records["data"]]
        else:
            positions[rows] = records["data"][:, : positions.shape[1]]
        labels[rows], object_ids[rows] = records["label"][:, 0], records["mesh_id"]
        if not source.plan.recipe.complete:
            elevations[rows] = records["view"][:, 1]
    with reading(folder):  # CloudSet refuses NaN
        return CloudSet(positions, labels, tuple(source.plan.classes), object_ids, elevations)
