"""CloudSet: labelled clouds of equal size in memory, what classifiers are trained and tested on."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zbuf_occlude.arrays import describe
from zbuf_occlude.errors import ArgumentError


@dataclass(frozen=True, eq=False)
class CloudSet:
    """Clouds with their labels, and where each came from.

    Parameters
    ----------
    positions : (m, n, 3) float32
        m clouds of n points; object space, each cloud centred, its longest side 1. The points of a cloud stand in
        random order.
    labels : (m,) int64
        Index into `classes`.
    classes : tuple of str
    object_ids : (m,) int64
        Which object a cloud shows: clouds of one object share it.
    elevations : (m,) float32
        Of the camera, radians; NaN for a cloud without a camera (a complete shape).

    Raises
    ------
    ArgumentError
        Shapes that do not fit together, labels outside `classes`, positions that are not finite.
    """

    positions: NDArray[np.float32]
    labels: NDArray[np.int64]
    classes: tuple[str, ...]
    object_ids: NDArray[np.int64]
    elevations: NDArray[np.float32]

    def __post_init__(self) -> None:
        positions = np.ascontiguousarray(self.positions, dtype=np.float32)
        if positions.ndim != 3 or positions.shape[2] != 3 or positions.shape[1] < 1:
            raise ArgumentError(f"positions must be (m, n, 3) float, n at least 1; got {describe(self.positions)}.")
        if not np.isfinite(positions).all():
            bad = int(np.flatnonzero(~np.isfinite(positions).all(axis=(1, 2)))[0])
            raise ArgumentError(f"positions must be finite; those of cloud {bad} are not. Leave it out.")
        labels = np.ascontiguousarray(self.labels, dtype=np.int64)
        object_ids = np.ascontiguousarray(self.object_ids, dtype=np.int64)
        elevations = np.ascontiguousarray(self.elevations, dtype=np.float32)
        columns: dict[str, NDArray[Any]] = {"labels": labels, "object_ids": object_ids, "elevations": elevations}
        for name, column in columns.items():
            if column.shape != (len(positions),):
                raise ArgumentError(f"{name} must be ({len(positions)},), one a cloud; got {describe(column)}.")
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

    def subset(self, which: ArrayLike) -> "CloudSet":
        """Return the clouds that a boolean mask or an index array picks, in its order."""
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

        Raises
        ------
        ArgumentError
            `n` is less than 1 or more than the clouds have.

        Notes
        -----
        The points of a cloud stand in random order, so one draw of places serves all clouds.
        """
        if not 1 <= n <= self.n_points:
            raise ArgumentError(f"n must lie in 1..{self.n_points}, the points of each cloud; got {n}.")
        places = np.random.default_rng(seed).permutation(self.n_points)[:n]
        return replace(self, positions=self.positions[:, places])

    @classmethod
    def joined(cls, first: "CloudSet", second: "CloudSet") -> "CloudSet":
        """Return the clouds of one set and then those of another; ids of objects keep their meaning.

        Raises
        ------
        ArgumentError
            Other classes, or clouds of another size.
        """
        if first.classes != second.classes or first.n_points != second.n_points:
            raise ArgumentError(
                f"sets to be joined must have the same classes and sizes of clouds; got {first!r} of "
                f"{', '.join(first.classes)} and {second!r} of {', '.join(second.classes)}."
            )
        return cls(
            np.concatenate([first.positions, second.positions]),
            np.concatenate([first.labels, second.labels]),
            first.classes,
            np.concatenate([first.object_ids, second.object_ids]),
            np.concatenate([first.elevations, second.elevations]),
        )
