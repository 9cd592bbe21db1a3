"""Run a comparison: every case, every subject, one row each; what has a row is not run again."""

import platform
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from zbuf_occlude.compare import metrics
from zbuf_occlude.compare.bench import Bench, SubjectFailed
from zbuf_occlude.compare.judge import FOLDER, Judge, Verdict
from zbuf_occlude.compare.measure import Measurement
from zbuf_occlude.compare.question import Question, row_key
from zbuf_occlude.compare.store import Store
from zbuf_occlude.compare.subjects import Subject
from zbuf_occlude.errors import OccludeError
from zbuf_occlude.versions import n_cores, versions
from zbuf_occlude.visibility import find_method

ROW_SECONDS = 120.0
"""What a row may take by default, all of its calls together."""


@dataclass(frozen=True, eq=False)
class Case:
    """A question and the subjects it is put to.

    Parameters
    ----------
    suite : str
        "meshes", or the preset it belongs to; the report has a section for each.
    label : str
        What the report calls the case.
    make : function
        Makes the question when its turn comes; may raise OccludeError.
    subjects : sequence of Subject
    judged : bool
        Whether the answers are compared with the judge's, or only timed.
    facts : dict
        Copied into each row.
    budget : float, optional
        Seconds of timed calls for each row, where the case needs other than the comparison's.
    """

    suite: str
    label: str
    make: Callable[[], Question]
    subjects: Sequence[Subject]
    judged: bool = True
    facts: dict[str, Any] | None = None
    budget: float | None = None


@dataclass
class Tally:
    """How many rows were made, found, and failed."""

    made: int = 0
    found: int = 0
    failed: int = 0


def run(
    cases: Sequence[Case],
    out: Path,
    *,
    budget: float = 3.0,
    limit: float = ROW_SECONDS,
    judge_points: int | None = None,
    progress: Callable[[str], None] = lambda text: None,
) -> Tally:
    """Make the rows that a folder lacks.

    Parameters
    ----------
    cases : sequence of Case
    out : Path
        The comparison's folder; made when it is missing.
    budget : float
        Seconds of timed calls for each row.
    limit : float
        Seconds after which a subject is given up.
    judge_points : int, optional
        As in `Judge`.
    progress : function
        Called once for each row, with what comes next.

    Notes
    -----
    A row is made again when the question or the versions have changed, or when it failed: the cause may be gone.
    """
    store, judge = Store(out), Judge(out / FOLDER, judge_points)
    known = store.rows()
    tally = Tally()
    with Bench(limit) as bench:
        for case in cases:
            try:
                question = case.make()
            except OccludeError as error:
                for subject in case.subjects:
                    row = {"key": "", **_heading(case, subject)}
                    store.append(row | {"status": "failed", "reason": str(error)})
                    tally.failed += 1
                    progress(case.label)
                continue
            for subject in case.subjects:
                progress(f"{case.label} · {subject.label}")
                key = row_key(question, subject.method, dict(subject.options), case.suite)
                before = known.get((case.suite, case.label, subject.label), {})
                if before.get("key") == key and before["status"] == "ok" and before["versions"] == versions():
                    tally.found += 1
                    continue
                row = {"key": key, **_heading(case, subject), **question.describe()}
                seconds = budget if case.budget is None else case.budget
                row |= _measured(row, case, subject, question, seconds, bench, judge, store)
                store.append(row)
                tally.made += row["status"] == "ok"
                tally.failed += row["status"] != "ok"
    return tally


def _heading(case: Case, subject: Subject) -> dict[str, Any]:
    return {
        "suite": case.suite,
        "case": case.label,
        "subject": subject.label,
        "method": subject.method,
        "options": dict(subject.options),
        "exact": find_method(subject.method).exact,
        "facts": case.facts or {},
        "machine": machine(),
        "versions": versions(),
        "when": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
    }


def _measured(
    row: dict[str, Any],
    case: Case,
    subject: Subject,
    question: Question,
    budget: float,
    bench: Bench,
    judge: Judge,
    store: Store,
) -> dict[str, Any]:
    """What measuring and judging add to a row."""
    missing = find_method(subject.method).missing()
    if missing:
        return {"status": "unavailable", "reason": missing}
    try:
        measurement = bench.measure(question, subject.method, dict(subject.options), budget)
    except SubjectFailed as failure:
        return {"status": "failed", "reason": str(failure)}
    result: dict[str, Any] = {"status": "ok", "timed": measurement.describe()}
    if not case.judged:
        return result
    verdict = judge.judge(question)
    result["judged"] = compare_masks(measurement, verdict, question)
    worst = int(np.argmax([wrong_share(view) for view in result["judged"]["views"]]))
    view_id = int(measurement.view_ids[worst])
    truth = judge.truth_of_view(question, view_id)
    n = min(measurement.mask.shape[1], len(truth))
    answer, truth = measurement.mask[worst, :n], truth[:n]
    store.save_question(question)
    store.save_worst(row["key"], metrics.outcomes(answer, truth))
    result["worst"] = {"view": view_id, **metrics.as_fractions(metrics.count_errors(answer, truth))}
    return result


def wrong_share(view: dict[str, Any]) -> float:
    """Share of a view's judged points, outside the boundary band, on which a row errs."""
    outside = view["outside"]
    return float(outside["false_visible"] + outside["false_hidden"])


def compare_masks(measurement: Measurement, verdict: Verdict, question: Question) -> dict[str, Any]:
    """Hold an answer against the judge's, on the views and points that both have.

    Returns
    -------
    dict
        n_views, n_points: of the pairs judged. Every measure of `metrics.METRICS` over all of them. views: for each
        view its angles in degrees and the measures that are taken per view.
    """
    ids = measurement.view_ids
    n = min(measurement.mask.shape[1], verdict.truth.shape[1])
    pairs = metrics.Pairs(
        answer=measurement.mask[:, :n],
        truth=verdict.truth[ids, :n],
        decided=verdict.decided[ids, :n],
        silhouette=verdict.silhouette[ids, :n],
        incidence=verdict.incidence[ids, :n],
        positions=question.points.positions[:n] / question.mesh.longest_side,
    )
    per_view = [metric for metric in metrics.METRICS if metric.per_view]
    return {
        "n_views": len(ids),
        "n_points": n,
        **{metric.name: metric.measure(pairs) for metric in metrics.METRICS},
        "views": [
            {
                "azimuth": float(np.degrees(question.views.azimuth[view])),
                "elevation": float(np.degrees(question.views.elevation[view])),
                **{metric.name: metric.measure(pairs.view(i)) for metric in per_view},
            }
            for i, view in enumerate(ids)
        ],
    }


@cache
def machine() -> str:
    """Processor and cores, in words."""
    name = platform.processor() or platform.machine()
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as file:
            name = next((line.split(":")[1].strip() for line in file if line.startswith("model name")), name)
    except OSError:
        pass
    return f"{name}, {n_cores()} cores"
