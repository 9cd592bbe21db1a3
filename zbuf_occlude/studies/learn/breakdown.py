"""Scores of a test with intervals by bootstrap: of all clouds, by the range of the sensor, and by the number of points.

Clouds of one object or of one sweep are alike, so whole objects or whole sweeps are drawn: the percentile interval of
Efron and Tibshirani, An Introduction to the Bootstrap, 1993, chapter 13, over clusters. Where all clouds are right, or
all wrong, no sample differs: the bound is then that of Clopper and Pearson, Biometrika 26, 1934, for n objects or
sweeps, 0.025^(1/n).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.base.arrays import BoolArray, FloatArray
from zbuf_occlude.studies.learn.data import CloudSet
from zbuf_occlude.studies.learn.evaluation import Confusion, predict

if TYPE_CHECKING:
    from zbuf_occlude.studies.learn.networks import Classifier

DRAWS = 1000
"""Bootstrap samples."""
LEVEL = 0.95
"""Share of the samples that an interval has."""
RANGES = (0.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 80.0, math.inf)
"""Bounds of the rows by range, metres."""
NUMBERS = (1.0, 32.0, 64.0, 128.0, 256.0, 512.0, 1024.0, math.inf)
"""Bounds of the rows by number of points."""


class Score(NamedTuple):
    """A score and its interval; NaN where it is undefined, the interval also where there is one group."""

    value: float
    low: float
    high: float

    def __str__(self) -> str:
        if math.isnan(self.value):
            return "-"
        interval = "" if math.isnan(self.low) else f" ({100 * self.low:.1f}-{100 * self.high:.1f})"
        return f"{self.value:.1%}{interval}"

    def to_list(self) -> list[float | None]:
        """Return value, low and high; None in place of NaN."""
        return [None if math.isnan(number) else float(number) for number in self]


class ScoreRow(NamedTuple):
    """Scores of the clouds from `low` to below `high`, metres or points."""

    low: float
    high: float
    n_clouds: int
    scores: dict[str, Score]


@dataclass(frozen=True, eq=False)
class Answers:
    """Class that a model answered for each cloud of a test set, beside the true one."""

    classes: tuple[str, ...]
    labels: NDArray[np.int64]  # (m,), true class, index into `classes`
    predicted: NDArray[np.int64]  # (m,), answered class
    group_ids: NDArray[np.int64]  # (m,), equal for clouds of one object or sweep
    ranges: FloatArray  # (m,), metres, NaN where it is unknown
    n_measured: NDArray[np.int64]  # (m,), points of the scan, 0 where it is unknown

    @classmethod
    def of_model(cls, model: "Classifier", test: CloudSet) -> "Answers":
        """Classify a test set, whose classes are those of the model."""
        predicted = predict(model, test).argmax(axis=1)
        ranges, n_measured = np.asarray(test.ranges, np.float64), np.asarray(test.n_measured)
        return cls(test.classes, test.labels, predicted, test.group_ids, ranges, n_measured)

    @property
    def confusion(self) -> Confusion:
        """The confusion matrix of all clouds."""
        counts = np.zeros((len(self.classes), len(self.classes)), dtype=np.int64)
        np.add.at(counts, (self.labels, self.predicted), 1)
        return Confusion(self.classes, self.classes, counts)

    @property
    def n_groups(self) -> int:
        """Number of objects or sweeps that the clouds are of."""
        return len(np.unique(self.group_ids))

    def scores(self, which: BoolArray | None = None) -> dict[str, Score]:
        """Return accuracy, mean recall and macro F1, with intervals, of all clouds or of those of a mask (m,).

        The mean of recall and of F1 is over the classes where it is defined: those with clouds, and for F1 also those
        that were answered.
        """
        chosen = np.ones(len(self.labels), dtype=bool) if which is None else which
        groups = np.unique(self.group_ids[chosen], return_inverse=True)[1]
        sums = np.zeros((3, groups.max(initial=-1) + 1, len(self.classes)))
        labels, predicted = self.labels[chosen], self.predicted[chosen]
        right = labels == predicted
        np.add.at(sums[0], (groups[right], labels[right]), 1)
        np.add.at(sums[1], (groups, labels), 1)
        np.add.at(sums[2], (groups, predicted), 1)
        values = _figures(*sums.sum(axis=1, keepdims=True))
        n = sums.shape[1]
        low, high = np.full((2, len(values)), np.nan)
        if n > 1:
            drawn_groups = np.random.default_rng(0).integers(n, size=(DRAWS, n)) + n * np.arange(DRAWS)[:, None]
            times = np.bincount(drawn_groups.ravel(), minlength=DRAWS * n).reshape(DRAWS, n).astype(np.float64)
            drawn = _figures(*(times @ each for each in sums))
            lacking = ((times @ sums[1]) == 0.0)[:, sums[1].any(axis=0)].any(axis=1)
            drawn[1:, lacking] = np.nan  # a mean over other classes is another score
            tail = (1.0 - LEVEL) / 2.0
            low, high = (np.array([_quantile(row, share) for row in drawn]) for share in (tail, 1.0 - tail))
            bound = tail ** (1.0 / n)
            low[values[:, 0] == 1.0], high[values[:, 0] == 0.0] = bound, 1.0 - bound
        named = zip(("accuracy", "recall", "f1"), values[:, 0], low, high, strict=True)
        return {name: Score(*map(float, numbers)) for name, *numbers in named}

    def scores_between(self, values: NDArray[Any], edges: Sequence[float]) -> list[ScoreRow]:
        """Return the scores of the clouds between each two edges of values (m,); rows without clouds are left out."""
        found = []
        for low, high in pairwise(edges):
            mask = (values >= low) & (values < high)
            if mask.any():
                found.append(ScoreRow(low, high, int(mask.sum()), self.scores(mask)))
        return found

    @property
    def by_range(self) -> list[ScoreRow]:
        """Scores by the range of the sensor; clouds whose range is unknown are in no row."""
        return self.scores_between(self.ranges, RANGES)

    @property
    def by_points(self) -> list[ScoreRow]:
        """Scores by the number of points of a scan; clouds for which it is unknown are in no row."""
        return self.scores_between(self.n_measured, NUMBERS)

    def write(self, folder: Path) -> None:
        """Write evaluation.json and evaluation.png into a folder, which is created."""

        def plain(scores: dict[str, Score]) -> dict[str, Any]:
            return {name: score.to_list() for name, score in scores.items()}

        tables = {
            name: [
                {"from": row.low, "to": row.high if math.isfinite(row.high) else None, "n_clouds": row.n_clouds}
                | plain(row.scores)
                for row in rows
            ]
            for name, rows in (("by_range", self.by_range), ("by_points", self.by_points))
        }
        more = {"scores": plain(self.scores()), "n_groups": self.n_groups, **tables}
        self.confusion.write(folder, more=more)


def _figures(right: FloatArray, of_class: FloatArray, answered: FloatArray) -> FloatArray:
    """Return accuracy, mean recall and macro F1, (3, k), from the clouds of each class (k, c) in k samples."""
    with np.errstate(invalid="ignore", divide="ignore"):
        accuracy = right.sum(axis=1) / of_class.sum(axis=1)
        recall, f1 = right / of_class, 2.0 * right / (of_class + answered)
        defined = [(~np.isnan(each)).sum(axis=1) for each in (recall, f1)]
        means = [np.nansum(each, axis=1) / n for each, n in zip((recall, f1), defined, strict=True)]
    return np.stack([accuracy, *means])


def _quantile(values: FloatArray, share: float) -> float:
    defined = values[~np.isnan(values)]
    return float(np.quantile(defined, share)) if len(defined) else math.nan
