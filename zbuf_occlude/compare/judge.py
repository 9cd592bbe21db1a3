"""The judge's answers to a question: truth, boundary band, distance from the silhouette; computed once, then stored."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from zbuf_occlude.arrays import BoolArray, FloatArray
from zbuf_occlude.compare.metrics import FOOTPRINTS, SILHOUETTE_EDGES, incidence_degrees
from zbuf_occlude.compare.question import Question
from zbuf_occlude.dataset import atomic
from zbuf_occlude.visibility.oracle import prepare as prepare_oracle

FOLDER = "judge"
"""Of a comparison's folder: where its verdicts are kept."""
MOST_TESTS = 3e9
"""The judge may test this many pairs of line and face on a mesh: about half a minute on two cores."""
FEWEST_POINTS = 50
"""It judges this many points however long that takes: from 15 views on meshes of 80,000 faces and more."""
SHOWN_TESTS = 3e8
"""And this many pairs for the picture of a row's worst view."""
PASSES = 1 + 2 + 8 * (1 + len(SILHOUETTE_EDGES))
"""Lines of sight that a verdict asks about for each pair of view and point."""


@dataclass(frozen=True, eq=False)
class Verdict:
    """What the judge says about the first j points of a question, from all its k eyes.

    Parameters
    ----------
    truth : (k, j) bool
        True = visible.
    decided : (k, j) bool
        False in the boundary band.
    silhouette : (k, j) float
        Distance from the nearest silhouette in footprints, rounded up to one of `SILHOUETTE_EDGES`, inf beyond.
    incidence : (k, j) float
        Angle between line of sight and normal, degrees.
    """

    truth: BoolArray
    decided: BoolArray
    silhouette: FloatArray
    incidence: FloatArray


class Judge:
    """Puts questions to the oracle and keeps its answers in a folder.

    Parameters
    ----------
    folder : Path
        Made by the first verdict. One file for each question.
    n_points : int, optional
        How many points of a question are judged; by default as many as `MOST_TESTS` allows.
    """

    def __init__(self, folder: Path, n_points: int | None = None) -> None:
        self._folder = folder
        self._n_points = n_points

    def n_judged(self, question: Question) -> int:
        """How many of the question's points are judged, from every eye."""
        affordable = int(MOST_TESTS / (PASSES * len(question.views) * len(question.mesh.faces)))
        return min(len(question.points), self._n_points or max(FEWEST_POINTS, affordable))

    def n_tests(self, question: Question) -> float:
        """How many pairs of line and face a verdict on the question takes; none when it was answered before."""
        if self._path(question).exists():
            return 0.0
        return float(PASSES * len(question.views) * self.n_judged(question) * len(question.mesh.faces))

    def _path(self, question: Question) -> Path:
        return self._folder / f"{question.fingerprint}-{self.n_judged(question)}.npz"

    def judge(self, question: Question) -> Verdict:
        """Answer the question, from the folder when it was answered before."""
        n = self.n_judged(question)
        path = self._path(question)
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
