"""Run a comparison: every case, every subject, one row each, kept in a folder; what has a row is not run again."""

import json
import os
import platform
import time
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from zbuf_occlude.compare import metrics
from zbuf_occlude.compare.cases import Case, Question, Subject, row_key
from zbuf_occlude.compare.measure import Bench, Measurement, MeasurementFailed
from zbuf_occlude.compare.reference_answers import FOLDER, Reference, ReferenceAnswer
from zbuf_occlude.dataset import atomic
from zbuf_occlude.errors import DatasetError, OccludeError
from zbuf_occlude.provenance import n_cores, versions
from zbuf_occlude.visibility import find_method

ROWS = "rows.jsonl"
ROW_SECONDS = 120.0
"""Timeout of a row, all of its calls together, by default."""


class ComparisonFolder:
    """A comparison's folder; a row is appended as soon as it is made, so that a crash later does not lose it.

    Parameters
    ----------
    folder : Path
        ``rows.jsonl``: one JSON object a line; of several of one suite, case and subject the last counts.
        ``questions/FINGERPRINT.npz``: positions (n, 3) float32, normals (n, 3) float32, eyes (k, 3), centre, longest.
        ``worst/KEY.npz``: outcomes (n',) uint8 of the question's first n' points in the row's worst view.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def rows(self) -> dict[tuple[str, str, str], dict[str, Any]]:
        """Read the rows by suite, case and subject. A last line that was cut off by a crash is left out.

        Raises DatasetError for a line that is not a row.
        """
        path = self.folder / ROWS
        rows: dict[tuple[str, str, str], dict[str, Any]] = {}
        lines = path.read_text(encoding="utf-8").split("\n") if path.exists() else []
        for number, line in enumerate(lines, start=1):
            if not line:
                continue
            try:
                row = json.loads(line)
                rows[row["suite"], row["case"], row["subject"]] = row
            except (ValueError, KeyError, TypeError) as error:
                if number == len(lines):  # no newline after it: its writing was cut off
                    continue
                raise DatasetError(
                    f"every line of {path} must be a row; line {number} is not ({error}). Remove the line."
                ) from None
        return rows

    def append(self, row: dict[str, Any]) -> None:
        """Add a row, in place of a last line that was cut off."""
        self.folder.mkdir(parents=True, exist_ok=True)
        path = self.folder / ROWS
        with open(path, "a+b") as file:
            if file.tell():
                file.truncate(path.read_bytes().rfind(b"\n") + 1)
            file.write((json.dumps(row) + "\n").encode())
            file.flush()
            os.fsync(file.fileno())

    def save_question(self, question: Question) -> None:
        """Keep a question's points and eyes for the report."""
        if not self._path("questions", question.fingerprint).exists():
            self.save(
                "questions",
                question.fingerprint,
                positions=question.points.positions.astype(np.float32),
                normals=question.points.normals.astype(np.float32),
                eyes=question.views.eyes,
                centre=question.mesh.centre,
                longest=np.float64(question.mesh.longest_side),
            )

    def save(self, kind: str, name: str, **arrays: Any) -> None:
        """Keep arrays of a question, or of a row's worst view."""
        path = self._path(kind, name)
        path.parent.mkdir(parents=True, exist_ok=True)
        atomic.write(path, lambda file: np.savez_compressed(file, **arrays))

    def load(self, kind: str, name: str) -> dict[str, Any]:
        """Read what `save` kept."""
        path = self._path(kind, name)
        try:
            with np.load(path) as stored:
                return {name: stored[name] for name in stored.files}
        except (OSError, ValueError) as error:
            raise DatasetError(f"{path} must be readable; {error}. Run compare again to make it.") from None

    def _path(self, kind: str, name: str) -> Path:
        return self.folder / kind / f"{name}.npz"


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
    """Make the rows that a folder lacks; it is made when missing.

    `budget` are seconds of timed calls for each row, `limit` is the timeout of a row, `judge_points` as in
    `Reference`; `progress` is called once for each row, with what comes next. A row is made again when the question or
    the versions have changed, or when it failed: the cause may be gone.
    """
    store, reference = ComparisonFolder(out), Reference(out / FOLDER, judge_points)
    known = store.rows()
    tally = Tally()
    with closing(Bench(limit)) as bench:
        for case in cases:
            try:
                question = case.make()
            except OccludeError as error:
                for subject in case.subjects:
                    store.append({"key": "", **_heading(case, subject), "status": "failed", "reason": str(error)})
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
                missing = find_method(subject.method).missing()
                try:
                    if missing:
                        row |= {"status": "unavailable", "reason": missing}
                    else:
                        seconds = budget if case.budget is None else case.budget
                        measured = bench.measure(question, subject.method, dict(subject.options), seconds)
                        row |= {"status": "ok", "timed": measured.describe()}
                        if case.judged:
                            row |= _judged(key, question, measured, reference, store)
                except MeasurementFailed as failure:
                    row |= {"status": "failed", "reason": str(failure)}
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


def _judged(
    key: str, question: Question, measured: Measurement, reference: Reference, store: ComparisonFolder
) -> dict[str, Any]:
    """Compare a measurement's mask with the reference; keep its worst view for the report."""
    judged = compare_masks(measured, reference.judge(question), question)
    errors = [view["outside"]["false_visible"] + view["outside"]["false_hidden"] for view in judged["views"]]
    worst = int(np.argmax(errors))
    view_id = int(measured.view_ids[worst])
    truth = reference.truth_of_view(question, view_id)
    n = min(measured.mask.shape[1], len(truth))
    answer, truth = measured.mask[worst, :n], truth[:n]
    store.save_question(question)
    store.save("worst", key, outcomes=metrics.outcomes(answer, truth))
    shares = metrics.as_fractions(metrics.count_errors(answer, truth))
    return {"judged": judged, "worst": {"view": view_id, **shares}}


def compare_masks(measured: Measurement, verdict: ReferenceAnswer, question: Question) -> dict[str, Any]:
    """Compare an answer with the reference's, on the views and points that both have.

    The result has n_views and n_points of the pairs judged, every measure of `metrics.METRICS` over all of them, and
    for each of the views its angles in degrees and the measures that are taken per view.
    """
    ids = measured.view_ids
    n = min(measured.mask.shape[1], verdict.truth.shape[1])
    pairs = metrics.JudgedPairs(
        answer=measured.mask[:, :n],
        truth=verdict.truth[ids, :n],
        decided=verdict.decided[ids, :n],
        silhouette=verdict.silhouette[ids, :n],
        incidence=verdict.incidence[ids, :n],
        positions=question.points.positions[:n] / question.mesh.longest_side,
    )
    views = [
        {
            "azimuth": float(np.degrees(question.views.azimuth[view])),
            "elevation": float(np.degrees(question.views.elevation[view])),
            **metrics.measures_per_view(pairs.view(i)),
        }
        for i, view in enumerate(ids)
    ]
    return {"n_views": len(ids), "n_points": n, **metrics.measures(pairs), "views": views}


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
