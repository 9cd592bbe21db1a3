"""The reference's answers to a question: truth, boundary band, distance from the silhouette; computed once, stored."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from zbuf_occlude.arrays import BoolArray, FloatArray
from zbuf_occlude.compare.cases import Question
from zbuf_occlude.compare.metrics import FOOTPRINTS, SILHOUETTE_EDGES, incidence_degrees
from zbuf_occlude.dataset import atomic
from zbuf_occlude.visibility.oracle import prepare as prepare_oracle

FOLDER = "judge"
"""In a comparison's folder: the stored answers."""
MOST_TESTS = 3e9
"""Pairs of line and face tested on a mesh at most: about half a minute on two cores."""
FEWEST_POINTS = 50
"""Points judged however long that takes: from 15 views on meshes of 80,000 faces and more."""
SHOWN_TESTS = 3e8
"""Pairs tested for the picture of a row's worst view at most."""
PASSES = 1 + 2 + 8 * (1 + len(SILHOUETTE_EDGES))
"""Lines of sight that are tested for each pair of view and point."""


@dataclass(frozen=True, eq=False)
class Verdict:
    """The reference's answer for the first j points of a question, from all its k eyes."""

    truth: BoolArray  # (k, j), True = visible
    decided: BoolArray  # (k, j), False in the boundary band
    silhouette: FloatArray  # (k, j), in footprints, rounded up to one of `SILHOUETTE_EDGES`, inf beyond
    incidence: FloatArray  # (k, j), angle between line of sight and normal, degrees


class Reference:
    """Asks the oracle, and keeps its answers in a folder, one file for each question.

    `n_points` of a question are judged, by default as many as `MOST_TESTS` allows.
    """

    def __init__(self, folder: Path, n_points: int | None = None) -> None:
        self._folder = folder
        self._n_points = n_points

    def judge(self, question: Question) -> Verdict:
        """Answer the question, from the folder where it is stored."""
        affordable = int(MOST_TESTS / (PASSES * len(question.views) * len(question.mesh.faces)))
        n = min(len(question.points), self._n_points or max(FEWEST_POINTS, affordable))
        path = self._folder / f"{question.fingerprint}-{n}.npz"
        if path.exists():
            with np.load(path) as stored:
                return Verdict(**{name: stored[name] for name in stored.files})
        points, eyes = question.points.select(np.arange(n)), question.views.eyes
        with prepare_oracle(question.mesh) as oracle:
            oracle.warns_of_eyes_inside = False  # the method asked does
            verdict = Verdict(
                oracle.visible(points, eyes),
                oracle.decided(points, eyes),
                oracle.silhouette_distance(points, eyes, np.array(SILHOUETTE_EDGES) / FOOTPRINTS) * FOOTPRINTS,
                incidence_degrees(points, eyes),
            )
        self._folder.mkdir(parents=True, exist_ok=True)
        atomic.write(path, lambda file: np.savez_compressed(file, **vars(verdict)))
        return verdict

    def truth_of_view(self, question: Question, view: int) -> BoolArray:
        """Answer for the question's first points from one eye, as many as `SHOWN_TESTS` allows; (n,) bool."""
        n = min(len(question.points), max(FEWEST_POINTS, int(SHOWN_TESTS / len(question.mesh.faces))))
        with prepare_oracle(question.mesh) as oracle:
            oracle.warns_of_eyes_inside = False  # the method asked does
            return oracle.visible(question.points.select(np.arange(n)), question.views.eyes[view : view + 1])[0]
