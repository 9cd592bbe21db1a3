"""Evaluation of a classifier: confusion matrix, accuracy; precision, recall and F1 of each class; as JSON and PNG."""

import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from zbuf_occlude.base import atomic
from zbuf_occlude.base.arrays import FloatArray, shape_and_dtype
from zbuf_occlude.base.errors import ArgumentError
from zbuf_occlude.drawing.pictures import new_figure
from zbuf_occlude.studies.learn.data import CloudSet

if TYPE_CHECKING:
    from zbuf_occlude.studies.learn.networks import Classifier

BATCH = 64
"""Clouds in a batch."""


@dataclass(frozen=True, eq=False)
class Confusion:
    """Confusion matrix of a test set and the figures that follow from it.

    The figures of a class need the same classes, in the same order, in the rows and the columns. Raises ArgumentError
    where the shape of `counts` is not that of the names.
    """

    truth: tuple[str, ...]  # names of the rows: classes of the test set, which for real scans are not the classifier's
    predicted: tuple[str, ...]  # names of the columns: the classifier's classes
    counts: NDArray[np.int64]  # (t, p), clouds by true and by predicted class

    def __post_init__(self) -> None:
        shape = (len(self.truth), len(self.predicted))
        if self.counts.shape != shape or not all(shape) or (self.counts < 0).any():
            raise ArgumentError(f"counts must be {shape}, none negative; got {shape_and_dtype(self.counts)}.")

    @property
    def n_clouds(self) -> int:
        """Number of clouds in the test set."""
        return int(self.counts.sum())

    @property
    def accuracy(self) -> float:
        """Overall accuracy: the fraction of clouds classified correctly; NaN without clouds."""
        return float(_ratio(np.trace(self.counts), self.counts.sum()))

    @cached_property
    def precision(self) -> FloatArray:
        """(c,) fraction of the clouds predicted as a class that are of it; NaN where none was predicted."""
        return _ratio(np.diag(self.counts), self.counts.sum(axis=0))

    @cached_property
    def recall(self) -> FloatArray:
        """(c,) fraction of the clouds of a class that were classified correctly; NaN for a class without clouds.

        The paper calls it the accuracy of a class.
        """
        return _ratio(np.diag(self.counts), self.counts.sum(axis=1))

    @cached_property
    def f1(self) -> FloatArray:
        """(c,) harmonic mean of precision and recall; NaN for a class that has no clouds and was never predicted."""
        return _ratio(2 * np.diag(self.counts), self.counts.sum(axis=0) + self.counts.sum(axis=1))

    def to_dict(self) -> dict[str, Any]:
        """All figures as plain data; None where a figure is undefined.

        Mean precision counts a class with clouds that was never predicted as 0, as F1 does.
        """
        columns = {"precision": self.precision, "recall": self.recall, "f1": self.f1}
        averaged = columns | {"precision": np.where(np.isnan(self.f1), np.nan, np.nan_to_num(self.precision))}
        return {
            "n_clouds": self.n_clouds,
            "accuracy": _number(self.accuracy),
            "mean": {name: _number(_mean(values)) for name, values in averaged.items()},
            "classes": {
                label: {"n_clouds": int(self.counts[i].sum()), **{k: _number(v[i]) for k, v in columns.items()}}
                for i, label in enumerate(self.predicted)
            },
            "confusion": self.counts.tolist(),
        }

    def write(self, folder: Path, name: str = "evaluation", more: Mapping[str, Any] = MappingProxyType({})) -> None:
        """Write `name`.json, with `more` in it, and `name`.png into a folder, which is created."""
        folder.mkdir(parents=True, exist_ok=True)
        figure = self.plot()
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "Glyph .* missing from font")  # the JSON has the names
            atomic.write(folder / f"{name}.png", lambda file: figure.savefig(file, format="png", dpi=100))
        atomic.write_json(folder / f"{name}.json", {**self.to_dict(), **more})

    def plot(self) -> Figure:
        """Plot the confusion matrix: shades are fractions of the true class, numbers are clouds."""
        n = len(self.predicted)
        figure, panels = new_figure(1, 1, panel=max(4.0, 1.6 + 0.45 * n))
        axes = panels[0, 0]
        axes.set_axis_on()
        shares = self.counts / np.maximum(self.counts.sum(axis=1, keepdims=True), 1)
        axes.imshow(shares, cmap="Blues", vmin=0.0, vmax=1.0)
        for row, column in np.argwhere(self.counts > 0):
            colour = "white" if shares[row, column] > 0.6 else "black"
            count = str(self.counts[row, column])
            axes.text(column, row, count, ha="center", va="center", fontsize=8, color=colour)
        axes.set_xticks(range(n), self.predicted, rotation=90, parse_math=False)  # names may contain dollar signs
        axes.set_yticks(range(n), self.predicted, parse_math=False)
        axes.tick_params(length=0, labelsize=9)
        axes.set_xlabel("predicted class")
        axes.set_ylabel("true class")
        axes.set_title(f"{self.accuracy:.1%} of {self.n_clouds} clouds", fontsize=10)
        return figure


def evaluate(model: "Classifier", test: CloudSet, classes: tuple[str, ...] | None = None) -> Confusion:
    """Classify a test set and return the confusion matrix.

    `classes` are those of the model; by default they are those of the test set. The model may be on any device; its
    mode is restored. Raises ArgumentError where the model has another number of classes.
    """
    classes = test.classes if classes is None else classes
    if model.n_classes != len(classes):
        raise ArgumentError(
            f"the test set must have the model's {model.n_classes} classes; it has {len(classes)}. "
            "Give it the classes of the training set."
        )
    counts = np.zeros((len(test.classes), len(classes)), dtype=np.int64)
    np.add.at(counts, (test.labels, predict(model, test).argmax(axis=1)), 1)
    return Confusion(test.classes, classes, counts)


def predict(model: "Classifier", clouds: CloudSet) -> NDArray[np.float32]:
    """Return the logits of all clouds, (m, n_classes); the largest one is the predicted class.

    Raises ArgumentError where the model was trained on clouds in metres, and these are scaled.
    """
    import torch  # late: reports of stored results need no PyTorch

    if model.unit > 0.0 and not clouds.keeps_size:
        raise ArgumentError(
            f"clouds must be in metres, as those of the training; their scale is {clouds.scale}. Generate them with "
            "--scale metres."
        )
    device = next(model.parameters()).device
    was_training = model.training
    model.eval()
    logits = [np.empty((0, model.n_classes), dtype=np.float32)]
    with torch.inference_mode():
        for part in torch.from_numpy(clouds.positions).split(BATCH) if len(clouds) else ():
            logits.append(model(model.normalise(part.to(device))).float().cpu().numpy())
    model.train(was_training)
    return np.concatenate(logits)


def _ratio(part: Any, whole: Any) -> FloatArray:
    """Return part / whole; NaN where the whole is 0."""
    part, whole = np.asarray(part, float), np.asarray(whole, float)
    return np.divide(part, whole, out=np.full(whole.shape, np.nan), where=whole > 0)


def _mean(values: FloatArray) -> float:
    """Return the mean of the values that are not NaN."""
    defined = values[~np.isnan(values)]
    return float(defined.mean()) if len(defined) else float("nan")


def _number(value: float) -> float | None:
    return None if np.isnan(value) else float(value)
