"""Run a comparison: one row for each case and subject, stored in a folder; existing rows are not made again.

A method is measured on a question in a child process: time to prepare, seconds per view, memory and the mask. The mask
is then compared with the reference's answer.
"""

import json
import os
import platform
import statistics
import time
import warnings
from collections.abc import Callable, Sequence
from contextlib import closing, suppress
from dataclasses import asdict, dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from zbuf_occlude.base import atomic
from zbuf_occlude.base.arrays import BoolArray
from zbuf_occlude.base.child import Child, ChildFailed
from zbuf_occlude.base.cores import n_cores
from zbuf_occlude.base.errors import DatasetError, OccludeError
from zbuf_occlude.base.provenance import versions
from zbuf_occlude.meshes.sampling import SurfacePoints, sample_surface
from zbuf_occlude.meshes.shapes.solids import box
from zbuf_occlude.studies.compare import metrics
from zbuf_occlude.studies.compare.cases import Case, Question, Subject, row_key
from zbuf_occlude.studies.compare.metrics import ReferenceAnswer
from zbuf_occlude.visibility import find_method, prepare
from zbuf_occlude.visibility.interface import VisibilityQuery

ROWS, REFERENCE = "rows.jsonl", "reference"
"""File of the rows and folder of the reference's answers, in a comparison's folder."""
ROW_SECONDS = 120.0
"""Default timeout of a row, all of its calls together."""
ENOUGH_SECONDS, ENOUGH_REPEATS, MIN_REPEATS = 0.5, 7, 3
"""Limits of repeating a timed call: enough seconds, enough repeats, fewest repeats; the median counts."""
PROBE_POINTS = 1000
"""Points of the first probe of a method's speed."""
WARM_SECONDS = 900.0
"""Timeout of a method on a cube: mostly compiling, on a busy machine without a compile cache."""
MAX_TESTS = 3e9
"""Maximum pairs of line and face that the reference tests on a mesh: about half a minute on two cores."""
MIN_POINTS = 50
"""Minimum points compared with the reference, even where `MAX_TESTS` is exceeded."""
SHOWN_TESTS = 3e8
"""Maximum pairs tested for the picture of a row's worst view."""
PASSES = 1 + 2 + 8 * (1 + len(metrics.SILHOUETTE_EDGES))
"""Lines of sight that the reference tests for each pair of view and point."""


class ComparisonFolder:
    """Folder of a comparison; each row is appended as soon as it is made, so that a later crash does not lose it.

    ``rows.jsonl``: one JSON object a line; the last line of a suite, case and subject counts.
    ``questions/FINGERPRINT.npz``: positions (n, 3) float32, normals (n, 3) float32, eyes (k, 3), centre, longest.
    ``worst/KEY.npz``: outcomes (n',) uint8 of the question's first n' points in the row's worst view.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def rows(self) -> dict[tuple[str, str, str], dict[str, Any]]:
        """Read the rows by suite, case and subject; a last line that a crash cut off is left out.

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
                if number == len(lines):  # without a newline: a crash cut it off
                    continue
                raise DatasetError(f"{path}, line {number} is not a valid row ({error}). Remove the line.") from None
        return rows

    def append(self, row: dict[str, Any]) -> None:
        """Append a row; a last line that was cut off is removed."""
        self.folder.mkdir(parents=True, exist_ok=True)
        path = self.folder / ROWS
        with open(path, "a+b") as file:
            if file.tell():
                file.truncate(path.read_bytes().rfind(b"\n") + 1)
            file.write((json.dumps(row) + "\n").encode())
            file.flush()
            os.fsync(file.fileno())

    def save_question(self, question: Question) -> None:
        """Store a question's points and eyes for the report."""
        if not self._path("questions", question.fingerprint).exists():
            self.save_arrays(
                "questions",
                question.fingerprint,
                positions=question.points.positions.astype(np.float32),
                normals=question.points.normals.astype(np.float32),
                eyes=question.views.eyes,
                centre=question.mesh.centre,
                longest=np.float64(question.mesh.longest_side),
            )

    def save_arrays(self, kind: str, name: str, **arrays: Any) -> None:
        """Store arrays of a question or of a row's worst view."""
        path = self._path(kind, name)
        path.parent.mkdir(parents=True, exist_ok=True)
        atomic.write(path, lambda file: np.savez_compressed(file, **arrays))

    def load_arrays(self, kind: str, name: str) -> dict[str, Any]:
        """Read arrays that `save_arrays` stored."""
        path = self._path(kind, name)
        try:
            with np.load(path) as stored:
                return {name: stored[name] for name in stored.files}
        except (OSError, ValueError) as error:
            raise DatasetError(f"{path} cannot be read ({error}). Run compare again to make it.") from None

    def _path(self, kind: str, name: str) -> Path:
        return self.folder / kind / f"{name}.npz"


# ---- the reference ---------------------------------------------------------------------------------------------------


class Reference:
    """The oracle's answers, stored in a folder, one file for each question.

    `n_points` of a question are answered; by default as many as `MAX_TESTS` allows.
    """

    def __init__(self, folder: Path, n_points: int | None = None) -> None:
        self._folder = folder
        self._n_points = n_points

    def answer(self, question: Question) -> ReferenceAnswer:
        """Return the answer to a question, from its file where there is one."""
        from zbuf_occlude.visibility.methods.oracle import prepare as prepare_oracle  # late: imports Numba

        affordable = int(MAX_TESTS / (PASSES * len(question.views) * len(question.mesh.faces)))
        n = min(len(question.points), self._n_points or max(MIN_POINTS, affordable))
        path = self._folder / f"{question.fingerprint}-{n}.npz"
        if path.exists():
            with np.load(path) as stored:
                return ReferenceAnswer(**{name: stored[name] for name in stored.files})
        points, eyes = question.points.select(np.arange(n)), question.views.eyes
        with prepare_oracle(question.mesh) as oracle:
            widths = np.array(metrics.SILHOUETTE_EDGES) / metrics.FOOTPRINTS
            expected = ReferenceAnswer(
                truth=oracle.visible(points, eyes),
                decided=oracle.decided(points, eyes),
                silhouette=oracle.silhouette_distance(points, eyes, widths) * metrics.FOOTPRINTS,
                incidence=metrics.incidence_degrees(points, eyes),
            )
        self._folder.mkdir(parents=True, exist_ok=True)
        atomic.write(path, lambda file: np.savez_compressed(file, **vars(expected)))
        return expected

    def truth_of_view(self, question: Question, view: int) -> BoolArray:
        """Return the visibility (n,) of a question's first points from one eye, as many as `SHOWN_TESTS` allows."""
        from zbuf_occlude.visibility.methods.oracle import prepare as prepare_oracle  # late: imports Numba

        n = min(len(question.points), max(MIN_POINTS, int(SHOWN_TESTS / len(question.mesh.faces))))
        with prepare_oracle(question.mesh) as oracle:
            return oracle.visible(question.points.select(np.arange(n)), question.views.eyes[view : view + 1])[0]


# ---- measuring -------------------------------------------------------------------------------------------------------


class MeasurementFailed(Exception):  # noqa: N818  (internal: it becomes a row)
    """The method raised, crashed or timed out; the message is the reason."""


class MeasurementRunner:
    """Runner of measurements in a child process; a child that crashed or timed out is replaced.

    `limit` is the timeout of a measurement in seconds, compiling excluded.
    """

    def __init__(self, limit: float) -> None:
        self.limit = limit
        self._child: Child | None = None

    def close(self) -> None:
        """End the child."""
        if self._child is not None:
            self._child.close()

    def measure(self, question: Question, method: str, options: dict[str, Any], budget: float) -> "Measurement":
        """Measure a method on a question as `measure` does; raises MeasurementFailed."""
        self._call(WARM_SECONDS, warm_up, method, options)
        return self._call(self.limit, measure, question, method, options, budget)

    def _call(self, timeout: float, *call: Any) -> Any:
        self._child = self._child or Child()
        self._child.start(*call)
        try:
            return self._child.answer(timeout)
        except ChildFailed as failure:
            self._child = None
            raise MeasurementFailed(
                f"its process {failure}{' while warming up' if call[0] is warm_up else ''}"
            ) from None
        except OccludeError as error:
            raise MeasurementFailed(str(error)) from None
        except Exception as error:  # any failure of a method becomes a row
            raise MeasurementFailed(f"{type(error).__name__}: {error}") from None


@dataclass(frozen=True, eq=False)
class Measurement:
    """Result of a method on a question; times are wall clock, or processor time of all cores."""

    mask: BoolArray  # (k', n'), the answer for the views and points that the budget allowed
    view_ids: Any  # (k',), indices of the eyes; the points are the question's first n'
    build_seconds: float  # seconds of `prepare`
    seconds_per_view: float  # seconds of `visible` divided by the number of views
    cpu_seconds_per_view: float
    repeats: int
    peak_memory: int | None  # growth of the process since before `prepare`, bytes
    renderer: str
    tests_per_view: float | None  # pairs of point and face; None for methods that do not count them
    warnings: list[str] = field(default_factory=list)

    def describe(self) -> dict[str, Any]:
        """Return the fields of a row: everything except the mask."""
        facts = {name: value for name, value in asdict(self).items() if name not in ("mask", "view_ids")}
        n = self.mask.shape[1]
        return facts | {
            "n_views": self.mask.shape[0],
            "n_points": n,
            "points_per_second": n / self.seconds_per_view if self.seconds_per_view > 0 else None,
        }


def measure(question: Question, method: str, options: dict[str, Any], budget: float) -> Measurement:
    """Prepare a method, run it on a question and time it.

    `budget` is the total of all timed calls in seconds. Where all views would take longer, fewer views are asked; where
    one view would take longer, fewer points. The method must have run on a cube (`warm_up`), so that neither compiling
    nor importing is timed. Runs on a growing number of points determine how many the budget allows.
    """
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        before = _process_memory("VmRSS")
        _reset_peak()
        start = time.perf_counter()
        with prepare(question.mesh, method, **options) as occluder:
            build = time.perf_counter() - start
            view_ids, n = fit_to_budget(occluder, question, budget)
            points, eyes = question.points.select(np.arange(n)), question.views.eyes[view_ids]
            mask, wall, cpu = time_calls(occluder, points, eyes, budget)
            tests, peak = getattr(occluder, "n_tests", None), _process_memory("VmHWM")
            return Measurement(
                mask=mask,
                view_ids=view_ids,
                build_seconds=build,
                seconds_per_view=statistics.median(wall) / len(eyes),
                cpu_seconds_per_view=statistics.median(cpu) / len(eyes),
                repeats=len(wall),
                peak_memory=max(0, peak - before) if peak else None,
                renderer=occluder.renderer,
                tests_per_view=None if tests is None else float(np.mean(tests)),
                warnings=sorted({str(w.message) for w in caught if issubclass(w.category, UserWarning)}),
            )


def time_calls(
    occluder: VisibilityQuery, points: SurfacePoints, eyes: Any, budget: float
) -> tuple[BoolArray, list[float], list[float]]:
    """Repeat a call; return its answer, and wall and processor seconds of each call.

    The first call warms up memory and caches; it counts only where the budget allows no second one.
    """
    wall: list[float] = []
    cpu: list[float] = []
    while True:
        start, start_cpu = time.perf_counter(), time.process_time()
        mask = occluder.visible(points, eyes)
        wall.append(time.perf_counter() - start)
        cpu.append(time.process_time() - start_cpu)
        n_counted, seconds = len(wall) - 1, sum(wall)
        spent = seconds + wall[-1] > budget and (n_counted > 0 or seconds > budget)
        if spent or n_counted >= ENOUGH_REPEATS or (n_counted >= MIN_REPEATS and seconds > ENOUGH_SECONDS):
            return mask, wall[1:] or wall, cpu[1:] or cpu


def fit_to_budget(occluder: VisibilityQuery, question: Question, budget: float) -> tuple[Any, int]:
    """Return the views and the number of points for which one call takes at most a third of the budget."""
    n_all, n_views = len(question.points), len(question.views)
    allowed = budget / MIN_REPEATS

    def one_view(n: int) -> float:
        points = question.points.select(np.arange(n))
        start = time.perf_counter()
        occluder.visible(points, question.views.eyes[:1])
        return time.perf_counter() - start

    n = min(PROBE_POINTS, n_all)
    fewer = max(1, n // 10)
    before = one_view(fewer)
    if before <= allowed:  # repeat: the first call includes one-off setup
        before = one_view(fewer)
    seconds = one_view(n)
    while n < n_all:
        larger = min(10 * n, n_all)
        growth = max(0.0, seconds - before) / max(1, n - fewer)  # seconds per point; 0 where only faces cost time
        if seconds + growth * (larger - n) > allowed:
            break
        fewer, before, n = n, seconds, larger
        seconds = one_view(n)
    if n < n_all:
        return np.array([n_views // 2]), max(n, min(n_all, int(n * allowed / seconds)))
    k = int(np.clip(allowed / seconds, 1, n_views))
    return np.unique(np.linspace(0, n_views - 1, k).round().astype(int)), n


def warm_up(method: str, options: dict[str, Any]) -> None:
    """Run a method on a cube, so that one-off costs are paid: compiling, and opening this thread's GL context."""
    cube = box()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with prepare(cube, method, **options) as occluder:
            occluder.visible(sample_surface(cube, n_points=200), np.array([[4.0, 1.0, 2.0], [-1.0, 4.0, 3.0]]))


def _process_memory(name: str) -> int:
    """Return a field of /proc/self/status in bytes; 0 where it is missing."""
    with suppress(OSError), open("/proc/self/status", encoding="utf-8") as file:
        return next((int(line.split()[1]) * 1024 for line in file if line.startswith(name)), 0)
    return 0


def _reset_peak() -> None:
    """Reset the peak of resident memory; without permission the peak stays."""
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5", encoding="utf-8")


# ---- the comparison --------------------------------------------------------------------------------------------------


@dataclass
class RunCounts:
    """Numbers of rows that were made, were found, and failed."""

    made: int = 0
    found: int = 0
    failed: int = 0


def run(
    cases: Sequence[Case],
    out: Path,
    *,
    budget: float = 3.0,
    limit: float = ROW_SECONDS,
    reference_points: int | None = None,
    progress: Callable[[str], None] = lambda text: None,
) -> RunCounts:
    """Make the rows that are missing in a folder, which is created where it is missing.

    `budget` is the seconds of timed calls per row, `limit` the timeout of a row, `reference_points` the `n_points` of
    `Reference`. `progress` is called before each row with its case and subject. A row is made again where it failed, or
    where the question or the versions changed.
    """
    store, reference = ComparisonFolder(out), Reference(out / REFERENCE, reference_points)
    known = store.rows()
    counts = RunCounts()
    with closing(MeasurementRunner(limit)) as runner:
        for case in cases:
            try:
                question = case.make_question()
            except OccludeError as error:
                for subject in case.subjects:
                    store.append({"key": "", **_heading(case, subject), "status": "failed", "reason": str(error)})
                    counts.failed += 1
                    progress(case.label)
                continue
            for subject in case.subjects:
                progress(f"{case.label} · {subject.label}")
                key = row_key(question, subject.method, dict(subject.options), case.suite)
                before = known.get((case.suite, case.label, subject.label), {})
                if before.get("key") == key and before["status"] == "ok" and before["versions"] == versions():
                    counts.found += 1
                    continue
                row = {"key": key, **_heading(case, subject), **question.describe()}
                missing = find_method(subject.method).missing()
                try:
                    if missing:
                        row |= {"status": "unavailable", "reason": missing}
                    else:
                        seconds = budget if case.budget is None else case.budget
                        measured = runner.measure(question, subject.method, dict(subject.options), seconds)
                        row |= {"status": "ok", "timed": measured.describe()}
                        if case.compared:
                            row |= _compared(key, question, measured, reference, store)
                except MeasurementFailed as failure:
                    row |= {"status": "failed", "reason": str(failure)}
                store.append(row)
                counts.made += row["status"] == "ok"
                counts.failed += row["status"] != "ok"
    return counts


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


def _compared(
    key: str, question: Question, measured: Measurement, reference: Reference, store: ComparisonFolder
) -> dict[str, Any]:
    """Compare a measurement's mask with the reference; store its worst view for the report."""
    compared = compare_masks(measured, reference.answer(question), question)
    outside = [view["outside"] for view in compared["views"]]
    errors = [each["false_visible"] + each["false_hidden"] if each["n"] else 0.0 for each in outside]
    worst = int(np.argmax(errors))
    view_id = int(measured.view_ids[worst])
    truth = reference.truth_of_view(question, view_id)
    n = min(measured.mask.shape[1], len(truth))
    answer, truth = measured.mask[worst, :n], truth[:n]
    store.save_question(question)
    store.save_arrays("worst", key, outcomes=metrics.outcomes(answer, truth))
    shares = metrics.as_fractions(metrics.count_errors(answer, truth))
    return {"judged": compared, "worst": {"view": view_id, **shares}}


def compare_masks(measured: Measurement, expected: ReferenceAnswer, question: Question) -> dict[str, Any]:
    """Compare a measurement's mask with the reference, on the views and points that both have.

    The result has the numbers of views and points compared, the measures of `metrics.measures` over all pairs, and for
    each view its angles in degrees and its measures.
    """
    ids = measured.view_ids
    n = min(measured.mask.shape[1], expected.truth.shape[1])
    pairs = metrics.ComparedPairs(
        answer=measured.mask[:, :n],
        positions=question.points.positions[:n] / question.mesh.longest_side,
        **{name: values[ids, :n] for name, values in vars(expected).items()},
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
    """Return the processor's name and number of cores."""
    name = platform.processor() or platform.machine()
    with suppress(OSError), open("/proc/cpuinfo", encoding="utf-8") as file:
        name = next((line.split(":")[1].strip() for line in file if line.startswith("model name")), name)
    return f"{name}, {n_cores()} cores"
