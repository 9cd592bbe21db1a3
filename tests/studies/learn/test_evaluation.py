"""Evaluation: scores of a matrix computed by hand, JSON and PNG; the mode of the network is restored."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

torch = pytest.importorskip("torch", reason="torch is not installed: pip install 'zbuf-occlude[learn]'")

from zbuf_occlude.base.errors import ArgumentError  # noqa: E402
from zbuf_occlude.studies.learn.data import CloudSet  # noqa: E402
from zbuf_occlude.studies.learn.evaluation import BATCH, Confusion, evaluate, predict  # noqa: E402
from zbuf_occlude.studies.learn.networks import Classifier  # noqa: E402

CLASSES = ("bed", "car", "lamp", "sofa")
EVALUATION = Confusion(CLASSES, CLASSES, np.array([[3, 1, 0, 0], [2, 4, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0]]))
"""Matrix without lamps and without predicted lamps or sofas."""


class Highest(Classifier):
    """Classifier by the height of the highest point, with a layer that has a mode."""

    def __init__(self) -> None:
        super().__init__(4)
        self.layer = torch.nn.Dropout(0.9)
        self.weight = torch.nn.Parameter(torch.ones(()))

    def normalise(self, points: "torch.Tensor") -> "torch.Tensor":
        return points

    def forward(self, points: "torch.Tensor") -> "torch.Tensor":
        heights = self.layer(points[..., 2].amax(dim=1).round().long().clamp(0, 3) + 1.0) - 1.0
        return self.weight * torch.nn.functional.one_hot(heights.long(), 4)


def clouds(heights: np.ndarray, labels: np.ndarray) -> CloudSet:
    positions = np.zeros((len(heights), 5, 3))
    positions[:, 2, 2] = heights
    return CloudSet(positions, labels, CLASSES, np.arange(len(heights)), np.full(len(heights), np.nan))


def test_figures_by_hand() -> None:
    assert EVALUATION.n_clouds == 10
    assert EVALUATION.accuracy == 0.7
    nothing = math.nan
    assert np.allclose(EVALUATION.precision, [3 / 5, 4 / 5, nothing, nothing], equal_nan=True)
    assert np.allclose(EVALUATION.recall, [3 / 4, 4 / 6, nothing, nothing], equal_nan=True)
    assert np.allclose(EVALUATION.f1, [6 / 9, 8 / 11, nothing, nothing], equal_nan=True)


def test_json_and_png(tmp_path: Path) -> None:
    EVALUATION.write(tmp_path / "new", "real")
    document = json.loads((tmp_path / "new" / "real.json").read_text())
    assert document["confusion"] == EVALUATION.counts.tolist()
    assert document["accuracy"] == 0.7
    assert document["mean"]["recall"] == pytest.approx((3 / 4 + 4 / 6) / 2)
    assert document["classes"]["bed"] == {"n_clouds": 4, "precision": 0.6, "recall": 0.75, "f1": pytest.approx(2 / 3)}
    assert document["classes"]["sofa"] == {"n_clouds": 0, "precision": None, "recall": None, "f1": None}
    picture = np.asarray(Image.open(tmp_path / "new" / "real.png").convert("RGB")).astype(int)
    blue = picture[..., 2] - picture[..., 0]
    assert (blue > 60).mean() > 0.02, "cells of the classes that were found are blue"


def test_means_count_a_class_that_was_never_predicted() -> None:
    """Three beds, all right; two of three cars taken for beds, one for a sofa; no car and no lamp was predicted."""
    counts = np.array([[3, 0, 0, 0], [2, 0, 0, 1], [0, 0, 0, 0], [0, 0, 0, 0]])
    document = Confusion(CLASSES, CLASSES, counts).to_dict()
    assert document["classes"]["car"]["precision"] is None
    assert document["mean"] == pytest.approx({"precision": (3 / 5) / 3, "recall": 1 / 2, "f1": (6 / 8) / 3})


def test_a_picture_shows_each_count() -> None:
    axes = EVALUATION.plot().axes[0]
    texts = {(int(t.get_position()[0]), int(t.get_position()[1])): t.get_text() for t in axes.texts}
    assert texts == {(0, 0): "3", (1, 0): "1", (0, 1): "2", (1, 1): "4"}
    assert [label.get_text() for label in axes.get_yticklabels()] == list(CLASSES)
    assert axes.get_title() == "70.0% of 10 clouds"


@pytest.mark.filterwarnings("error")
def test_classes_of_any_name(tmp_path: Path) -> None:
    """Class names that matplotlib takes for formulas, or whose characters its font lacks."""
    names = ("$x^$", "a_b c", "\u6905\u5b50", "caf\u00e9")
    evaluation = Confusion(names, names, EVALUATION.counts)
    evaluation.write(tmp_path)
    assert list(json.loads((tmp_path / "evaluation.json").read_text())["classes"]) == sorted(names)
    assert [label.get_text() for label in evaluation.plot().axes[0].get_xticklabels()] == list(names)


def test_every_cloud_is_asked_about_once_and_in_evaluation_mode() -> None:
    rng = np.random.default_rng(0)
    labels = rng.integers(0, 4, 2 * BATCH + 3)
    heights = np.where(rng.random(len(labels)) < 0.25, (labels + 1) % 4, labels)
    model = Highest().train()
    evaluation = evaluate(model, clouds(heights, labels))
    assert model.training, "left as it was"
    expected = np.zeros((4, 4), int)
    for label, height in zip(labels, heights, strict=True):
        expected[label, height] += 1
    assert (evaluation.counts == expected).all()
    logits = predict(model, clouds(heights, labels))
    assert (logits.shape, logits.dtype) == ((len(labels), 4), np.float32)


def test_no_clouds_and_another_number_of_classes() -> None:
    assert evaluate(Highest(), clouds(np.empty(0), np.empty(0, int))).to_dict()["accuracy"] is None
    test = CloudSet(np.zeros((1, 1, 3)), np.array([0]), ("a",), np.array([0]), np.array([0.0]))
    with pytest.raises(ArgumentError, match="the test set must have the model's 4 classes; it has 1"):
        evaluate(Highest(), test)
