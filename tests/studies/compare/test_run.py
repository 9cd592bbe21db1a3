"""Rows are right and resume; subjects may fail, crash or hang."""

import os
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.scenes import box, two_plates
from zbuf_occlude import Mesh, views
from zbuf_occlude.base.errors import DatasetError, MeshError, OptionError
from zbuf_occlude.engines.gl.context import GlContext
from zbuf_occlude.meshes.sampling import SurfacePoints
from zbuf_occlude.studies.compare import run as run_module
from zbuf_occlude.studies.compare.cases import Case, Question, Subject, sample_question
from zbuf_occlude.studies.compare.run import (
    ENOUGH_REPEATS,
    ROWS,
    ComparisonFolder,
    MeasurementFailed,
    MeasurementRunner,
    Reference,
    compare_masks,
    fit_to_budget,
    measure,
    run,
    time_calls,
    warm_up,
)
from zbuf_occlude.visibility import METHODS
from zbuf_occlude.visibility.interface import VisibilityQuery

ABOVE = views.ring(2, elevation=89.4)


def plates(n_points: int = 400) -> Question:
    return sample_question("plates", two_plates(), ABOVE, n_points=n_points, seed=0)


def broken() -> Question:
    raise MeshError("broken.off is broken")


def test_rows_tell_the_truth_about_two_plates(tmp_path: Path) -> None:
    """From above, the upper plate hides the lower one: half the area is visible."""
    cases = [
        Case("meshes", "plates", plates, [Subject("oracle"), Subject("occupancy_grid", {"n": 8})]),
        Case("meshes", "broken", broken, [Subject("oracle")]),
        Case("meshes", "sampled badly", plates, [Subject("occupancy_grid", {"n": 1})]),
    ]
    seen: list[str] = []
    tally = run(cases, tmp_path, budget=0.6, progress=seen.append)
    assert (tally.made, tally.found, tally.failed) == (2, 0, 2)
    assert seen == ["plates · oracle", "plates · occupancy_grid:n=8", "broken", "sampled badly · occupancy_grid:n=1"]
    rows = list(ComparisonFolder(tmp_path).rows().values())
    oracle, grid, missing, refused = rows
    assert oracle["judged"]["agreement"] == 1.0
    assert oracle["judged"]["chamfer"] == 0.0
    assert abs(oracle["judged"]["visible"] - 0.5) < 0.08
    assert oracle["judged"]["n"] == 2 * 400
    assert oracle["timed"]["n_views"] == 2
    assert oracle["timed"]["points_per_second"] == pytest.approx(400 / oracle["timed"]["seconds_per_view"])
    assert len(oracle["judged"]["views"]) == 2
    assert oracle["judged"]["views"][0]["elevation"] == pytest.approx(89.4)
    assert {"renderer", "peak_memory", "build_seconds"} <= set(oracle["timed"])
    assert {"python", "numpy", "zbuf-occlude"} <= set(oracle["versions"])
    assert sum(b["n"] for b in grid["judged"]["by_silhouette"]) == 800
    assert sum(b["n"] for b in grid["judged"]["by_incidence"]) == 800
    assert (missing["status"], missing["reason"]) == ("failed", "broken.off is broken")
    assert refused["reason"].startswith("n must be an int in [2, ")

    again = run(cases, tmp_path, budget=0.6)
    assert (again.made, again.found, again.failed) == (0, 2, 2), "failures are tried again"


def test_another_version_makes_rows_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cases = [Case("meshes", "plates", plates, [Subject("occupancy_grid", {"n": 8})], compared=False)]
    assert run(cases, tmp_path, budget=0.6).made == 1
    monkeypatch.setattr(run_module, "versions", lambda: {"python": "4"})
    assert run(cases, tmp_path, budget=0.6).made == 1
    assert run(cases, tmp_path, budget=0.6).found == 1


def test_what_cannot_run_here_is_a_row(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(type(METHODS[0]), "missing", lambda self: "needs the moon")
    run([Case("meshes", "plates", plates, [Subject("oracle")])], tmp_path)
    (row,) = ComparisonFolder(tmp_path).rows().values()
    assert (row["status"], row["reason"]) == ("unavailable", "needs the moon")


class Killer:
    """Object that ends the process that unpickles it."""

    def __reduce__(self) -> Any:
        return os._exit, (3,)


def test_a_death_and_a_hang_cost_one_row_each() -> None:
    with closing(MeasurementRunner(limit=60.0)) as bench:
        with pytest.raises(MeasurementFailed, match="its process ended with exit code 3"):
            bench.measure(Killer(), "oracle", {}, 0.1)  # type: ignore[arg-type]
        assert bench.measure(plates(), "oracle", {}, 2.0).mask.shape == (2, 400), "a new process goes on"
        bench.limit = 0.0  # it warms up all the same, that is not the row's time
        with pytest.raises(MeasurementFailed, match="timed out after 0 s"):
            bench.measure(plates(), "oracle", {}, 600.0)


class Slow(VisibilityQuery):
    """Method with its own clock: a microsecond for each pair, and `first` seconds for the first call."""

    def __init__(self, mesh: Mesh, first: float = 0.0) -> None:
        super().__init__(mesh)
        self.now, self.first = 0.0, first

    def _visible(self, points: SurfacePoints, eyes: np.ndarray) -> np.ndarray:
        self.now += 1e-6 * len(eyes) * len(points) + self.first
        self.first = 0.0
        return np.ones((len(eyes), len(points)), dtype=bool)


@pytest.mark.parametrize(
    ("budget", "n_views", "n_points"),
    [(1.0, 15, 20_000), (0.33, 5, 20_000), (0.03, 1, 10_000), (1e-6, 1, 1_000)],
)
def test_a_slow_subject_gets_fewer_views_then_fewer_points(
    budget: float, n_views: int, n_points: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    question = sample_question("box", box(), views.paper100(), n_points=20_000, seed=0)
    slow = Slow(question.mesh)
    monkeypatch.setattr("time.perf_counter", lambda: slow.now)
    view_ids, n = fit_to_budget(slow, question, budget)
    assert (len(view_ids), n) == (n_views, n_points)


def test_a_mask_of_fewer_views_and_points_is_compared_on_those(tmp_path: Path) -> None:
    question = plates(300)
    expected = Reference(tmp_path, n_points=200).answer(question)
    measurement = measure(question, "oracle", {}, 0.01)
    cut = replace(measurement, mask=measurement.mask[:1, :150], view_ids=np.arange(1))
    one = compare_masks(cut, expected, question)
    assert (one["n_views"], one["n_points"], one["n"], one["agreement"]) == (1, 150, 150, 1.0)
    all_points = compare_masks(measurement, expected, question)
    assert all_points["n_points"] == 200, "no more than the reference has"


def test_the_reference_is_asked_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    question = plates(50)
    first = Reference(tmp_path).answer(question)
    monkeypatch.setattr("zbuf_occlude.visibility.methods.oracle.prepare", lambda mesh: pytest.fail("asked again"))
    second = Reference(tmp_path).answer(plates(50))
    assert all((getattr(first, name) == getattr(second, name)).all() for name in vars(first))


def test_a_subject_checks_its_options() -> None:
    assert Subject("occupancy_grid", {"n": 64}).label == "occupancy_grid:n=64"
    with pytest.raises(OptionError, match="got 'cells'"):
        Subject("occupancy_grid", {"cells": 64})
    with pytest.raises(OptionError, match="method must be one of"):
        Subject("crystal_ball")


def test_the_first_call_of_a_size_is_no_measurement(monkeypatch: pytest.MonkeyPatch) -> None:
    question = plates(100)
    slow = Slow(question.mesh, first=0.2)
    monkeypatch.setattr("time.perf_counter", lambda: slow.now)
    _, wall, cpu = time_calls(slow, question.points, question.views.eyes, budget=0.3)
    assert wall == pytest.approx([2e-4] * ENOUGH_REPEATS)
    assert len(cpu) == len(wall)


@pytest.mark.gl
def test_no_context_opens_while_a_method_is_timed(gl: GlContext, monkeypatch: pytest.MonkeyPatch) -> None:
    warm_up("depth_buffer", {})
    monkeypatch.setattr(GlContext, "open", lambda: pytest.fail("opened late"))
    assert measure(plates(50), "depth_buffer", {}, 0.01).renderer == gl.renderer


# ---- the folder -----------------------------------------------------------------------------------------------------


def row(subject: str, key: str = "k") -> dict[str, Any]:
    return {"key": key, "suite": "meshes", "case": "a", "subject": subject}


def test_a_torn_line_is_left_out_and_then_replaced(tmp_path: Path) -> None:
    store = ComparisonFolder(tmp_path)
    store.append(row("x"))
    with open(tmp_path / ROWS, "a") as file:
        file.write('{"key": "half')
    assert list(store.rows()) == [("meshes", "a", "x")]
    store.append(row("y"))
    assert [subject for _, _, subject in store.rows()] == ["x", "y"]


def test_a_damaged_line_is_named(tmp_path: Path) -> None:
    (tmp_path / ROWS).write_text('nonsense\n{"key": 1}\n')
    with pytest.raises(DatasetError, match="line 1 is not a valid row"):
        ComparisonFolder(tmp_path).rows()
