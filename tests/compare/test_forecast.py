"""What a comparison is said to cost before it begins."""

from pathlib import Path

import numpy as np
import pytest

from tests.scenes import box
from zbuf_occlude import Mesh, views
from zbuf_occlude.compare.forecast import forecast
from zbuf_occlude.compare.judge import FEWEST_POINTS, PASSES, Judge
from zbuf_occlude.compare.question import Question, ask
from zbuf_occlude.compare.run import Case
from zbuf_occlude.compare.subjects import Subject
from zbuf_occlude.errors import MeshError

ONE = views.ring(1, 0.5)


def large() -> Question:
    """A fan of 60,000 faces about as many vertices: 4e9 pairs."""
    turn = np.linspace(0, 2 * np.pi, 60_000, endpoint=False)
    vertices = np.vstack([[[0, 0, 1]], np.c_[np.cos(turn), np.sin(turn), 0 * turn]])
    around = np.arange(1, 60_001)
    return ask("fan", Mesh(vertices, np.c_[0 * around, around, np.roll(around, 1)]), ONE, n_points=500, seed=0)


def small() -> Question:
    return ask("box", box(), ONE, n_points=500, seed=0)


def broken() -> Question:
    raise MeshError("broken")


def test_rows_that_will_be_given_up_are_named(tmp_path: Path) -> None:
    subjects = [Subject("exact"), Subject("vertex_hsr")]
    cases = [Case("meshes", "fan", large, subjects), Case("meshes", "box", small, subjects)]
    expected = forecast([*cases, Case("meshes", "x", broken, subjects)], Judge(tmp_path), budget=3.0, limit=60.0)
    assert expected.n_rows == 6
    assert expected.given_up == ["fan · vertex_hsr"]
    assert 60.0 < expected.seconds < 300.0
    patient = forecast(cases, Judge(tmp_path), budget=3.0, limit=1e6)
    assert patient.given_up == []
    assert patient.seconds > expected.seconds


def test_the_judge_costs_what_it_tests_until_it_has_answered(tmp_path: Path) -> None:
    judge, question = Judge(tmp_path, 200), small()
    assert judge.n_tests(question) == PASSES * 1 * 200 * 12
    judge.judge(question)
    assert judge.n_tests(question) == 0


def test_the_judge_does_not_take_longer_the_larger_the_mesh(tmp_path: Path) -> None:
    question = large()
    assert Judge(tmp_path).n_judged(question) == 500
    many = Question(question.key, question.mesh, question.points, views.ring(15, 0.5))
    assert FEWEST_POINTS <= Judge(tmp_path).n_judged(many) < 100
    assert len(Judge(tmp_path).truth_of_view(question, 0)) == 500


@pytest.mark.parametrize("budget", [1.0, 10.0])
def test_a_row_costs_its_budget(tmp_path: Path, budget: float) -> None:
    one = forecast(
        [Case("scaling", "box", small, [Subject("exact")], judged=False)], Judge(tmp_path), budget=budget, limit=60
    )
    assert one.seconds == pytest.approx(1.0 + budget / 2)
