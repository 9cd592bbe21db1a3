"""How good a classifier is: confusion matrix, accuracy, precision, recall and F1 of each class; as JSON and PNG."""

import warnings
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import torch
from matplotlib.figure import Figure
from numpy.typing import NDArray

from zbuf_occlude.arrays import FloatArray
from zbuf_occlude.dataset import atomic
from zbuf_occlude.drawing.pictures import new_figure
from zbuf_occlude.errors import ArgumentError
from zbuf_occlude.learn.data import CloudSet
from zbuf_occlude.learn.networks import Classifier

BATCH = 64
"""Clouds that are looked at together."""


@dataclass(frozen=True, eq=False)
class Evaluation:
    """What a classifier made of a test set."""

    confusion: NDArray[np.int64]  # (c, c), clouds of class i that were taken for class j
    classes: tuple[str, ...]

    @classmethod
    def of(cls, labels: NDArray[np.int64], predicted: NDArray[np.int64], classes: tuple[str, ...]) -> "Evaluation":
        """Count (m,) labels against (m,) predictions."""
        confusion = np.zeros((len(classes), len(classes)), dtype=np.int64)
        np.add.at(confusion, (labels, predicted), 1)
        return cls(confusion, classes)

    @property
    def n_clouds(self) -> int:
        """Clouds of the test set."""
        return int(self.confusion.sum())

    @property
    def accuracy(self) -> float:
        """Overall accuracy: the fraction of clouds whose class was found; NaN without clouds."""
        return float(_ratio(np.trace(self.confusion), self.confusion.sum()))

    @cached_property
    def precision(self) -> FloatArray:
        """(c,): of what was taken for a class, the fraction that is of it; NaN where nothing was."""
        return _ratio(np.diag(self.confusion), self.confusion.sum(axis=0))

    @cached_property
    def recall(self) -> FloatArray:
        """(c,): of a class, the fraction that was found, the paper's accuracy of a class; NaN without a cloud."""
        return _ratio(np.diag(self.confusion), self.confusion.sum(axis=1))

    @cached_property
    def f1(self) -> FloatArray:
        """(c,): harmonic mean of precision and recall; NaN for a class that neither is there nor was named."""
        return _ratio(2 * np.diag(self.confusion), self.confusion.sum(axis=0) + self.confusion.sum(axis=1))

    @property
    def document(self) -> dict[str, Any]:
        """Plain data of all figures; None where one is not defined."""
        columns = {"precision": self.precision, "recall": self.recall, "f1": self.f1}
        return {
            "n_clouds": self.n_clouds,
            "accuracy": _number(self.accuracy),
            "mean": {name: _number(_mean(values)) for name, values in columns.items()},
            "classes": {
                label: {"n_clouds": int(self.confusion[i].sum()), **{k: _number(v[i]) for k, v in columns.items()}}
                for i, label in enumerate(self.classes)
            },
            "confusion": self.confusion.tolist(),
        }

    def write(self, folder: Path, name: str = "evaluation") -> None:
        """Write `name`.json and `name`.png into a folder, which is made."""
        folder.mkdir(parents=True, exist_ok=True)
        figure = self.draw()
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "Glyph .* missing from font")  # boxes are drawn; the JSON has the names
            atomic.write(folder / f"{name}.png", lambda file: figure.savefig(file, format="png", dpi=100))
        atomic.write_json(folder / f"{name}.json", self.document)

    def draw(self) -> Figure:
        """Return a picture of the confusion matrix: shades are fractions of the true class, numbers are clouds."""
        n = len(self.classes)
        figure, panels = new_figure(1, 1, panel=max(4.0, 1.6 + 0.45 * n))
        axes = panels[0, 0]
        axes.set_axis_on()
        shares = self.confusion / np.maximum(self.confusion.sum(axis=1, keepdims=True), 1)
        axes.imshow(shares, cmap="Blues", vmin=0.0, vmax=1.0)
        for row, column in np.argwhere(self.confusion > 0):
            colour = "white" if shares[row, column] > 0.6 else "black"
            count = str(self.confusion[row, column])
            axes.text(column, row, count, ha="center", va="center", fontsize=8, color=colour)
        axes.set_xticks(range(n), self.classes, rotation=90, parse_math=False)  # a name may have dollar signs
        axes.set_yticks(range(n), self.classes, parse_math=False)
        axes.tick_params(length=0, labelsize=9)
        axes.set_xlabel("taken for")
        axes.set_ylabel("class")
        axes.set_title(f"{self.accuracy:.1%} of {self.n_clouds} clouds", fontsize=10)
        return figure


def evaluate(model: Classifier, test: CloudSet) -> Evaluation:
    """Classify a test set, whose classes are those the model was trained on, in the same order.

    The model may be on any device, and is left as it was. Raises ArgumentError where it has another number of classes.
    """
    if model.n_classes != len(test.classes):
        raise ArgumentError(
            f"the test set must have the model's {model.n_classes} classes; it has {len(test.classes)}. "
            "Give it the classes of the training set."
        )
    return Evaluation.of(test.labels, predict(model, test).argmax(axis=1), test.classes)


def predict(model: Classifier, clouds: CloudSet) -> NDArray[np.float32]:
    """Return the logits of all clouds, (m, n_classes); the largest names the class."""
    device = next(model.parameters()).device
    was_training = model.training
    model.eval()
    logits = [np.empty((0, model.n_classes), dtype=np.float32)]
    with torch.inference_mode():
        for part in torch.from_numpy(clouds.positions).split(BATCH):
            logits.append(model(model.normalise(part.to(device))).float().cpu().numpy())
    model.train(was_training)
    return np.concatenate(logits)


def _ratio(part: Any, whole: Any) -> FloatArray:
    """Return part / whole, NaN where there is nothing."""
    part, whole = np.asarray(part, float), np.asarray(whole, float)
    return np.divide(part, whole, out=np.full(whole.shape, np.nan), where=whole > 0)


def _mean(values: FloatArray) -> float:
    """Return the mean of what is defined."""
    defined = values[~np.isnan(values)]
    return float(defined.mean()) if len(defined) else float("nan")


def _number(value: float) -> float | None:
    return None if np.isnan(value) else float(value)
