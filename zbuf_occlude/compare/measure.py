"""Measure one method on one question, in a child process: preparation, seconds a view, memory, and the mask."""

import statistics
import time
import warnings
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from zbuf_occlude.arrays import BoolArray
from zbuf_occlude.compare.cases import Question
from zbuf_occlude.compare.child import Child, ChildFailed
from zbuf_occlude.errors import OccludeError
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.geometry.sampling import SurfacePoints, sample_surface
from zbuf_occlude.visibility import find_method, prepare
from zbuf_occlude.visibility.interface import Occluder

ENOUGH_SECONDS, ENOUGH_REPEATS, FEWEST_REPEATS = 0.5, 7, 3
"""The call is repeated until it has run so long or so often; the median counts."""
PROBE_POINTS = 1000
WARM_SECONDS = 900.0
"""What a method may take on a cube: mostly compiling, on a busy machine with nothing compiled."""


class MeasurementFailed(Exception):  # noqa: N818  (not an error of ours: a result, and a row)
    """The method raised, crashed or timed out; the message is the reason."""


class Bench:
    """Runs measurements in a child process, one at a time; a child that crashed or timed out is replaced.

    `limit` is the timeout of a measurement in seconds; compiling, which is done once, does not count.
    """

    def __init__(self, limit: float) -> None:
        self.limit = limit
        self._child: Child | None = None

    def close(self) -> None:
        """End the child."""
        if self._child is not None:
            self._child.close()

    def measure(self, question: Question, method: str, options: dict[str, Any], budget: float) -> "Measurement":
        """Measure a method on a question, as `measure`; raises MeasurementFailed."""
        self._call(WARM_SECONDS, warm, method, options)
        return self._call(self.limit, measure, question, method, options, budget)

    def _call(self, timeout: float, *call: Any) -> Any:
        self._child = self._child or Child()
        self._child.start(*call)
        try:
            return self._child.answer(timeout)
        except ChildFailed as failure:
            self._child.kill()
            self._child = None
            raise MeasurementFailed(f"{failure}{' while warming up' if call[0] is warm else ''}") from None
        except OccludeError as error:
            raise MeasurementFailed(str(error)) from None
        except Exception as error:  # a method may fail in any way; that is a row
            raise MeasurementFailed(f"{type(error).__name__}: {error}") from None


@dataclass(frozen=True, eq=False)
class Measurement:
    """What one method did with one question; times are wall clock, or processor time of all cores."""

    mask: BoolArray  # (k', n'): the answer to the views and points that the budget allowed
    view_ids: Any  # (k',): which eyes were asked; the points are the question's first n'
    build_seconds: float  # of `prepare`
    seconds_per_view: float  # of `visible`, divided by its views
    cpu_seconds_per_view: float
    repeats: int
    peak_memory: int | None  # growth of the process in bytes, from before `prepare` on
    renderer: str
    tests_per_view: float | None  # pairs of point and face, for methods that count them
    warnings: list[str] = field(default_factory=list)

    def describe(self) -> dict[str, Any]:
        """Return what a row says: everything but the mask."""
        facts = {name: value for name, value in asdict(self).items() if name not in ("mask", "view_ids")}
        n = self.mask.shape[1]
        return facts | {
            "n_views": self.mask.shape[0],
            "n_points": n,
            "points_per_second": n / self.seconds_per_view if self.seconds_per_view > 0 else None,
        }


def measure(question: Question, method: str, options: dict[str, Any], budget: float) -> Measurement:
    """Prepare a method, ask it, and take the time.

    `budget` is what all timed calls together should take, in seconds: where all views would take longer fewer are
    asked, where one view would, fewer points. The method has run on a cube before (`warm`), so that neither compiling
    nor importing is timed; it runs on a growing part of the question first, which says how much of it the budget
    allows.
    """
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        before = _process_memory("VmRSS")
        _reset_peak()
        start = time.perf_counter()
        with prepare(question.mesh, method, gl=_gl_for(method), **options) as occluder:
            build = time.perf_counter() - start
            view_ids, n = affordable(occluder, question, budget)
            points, eyes = question.points.select(np.arange(n)), question.views.eyes[view_ids]
            mask, wall, cpu = timed(occluder, points, eyes, budget)
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


def timed(
    occluder: Occluder, points: SurfacePoints, eyes: Any, budget: float
) -> tuple[BoolArray, list[float], list[float]]:
    """Ask repeatedly; return the answer and the wall and processor seconds of each call.

    The first call warms up memory and caches of this size: it counts only where the budget allows no other.
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
        if spent or n_counted >= ENOUGH_REPEATS or (n_counted >= FEWEST_REPEATS and seconds > ENOUGH_SECONDS):
            return mask, wall[1:] or wall, cpu[1:] or cpu


def affordable(occluder: Occluder, question: Question, budget: float) -> tuple[Any, int]:
    """Return which views and how many points may be asked, so that one call takes a third of the budget at most."""
    n_all, n_views = len(question.points), len(question.views)
    allowed = budget / FEWEST_REPEATS

    def one_view(n: int) -> float:
        points = question.points.select(np.arange(n))
        start = time.perf_counter()
        occluder.visible(points, question.views.eyes[:1])
        return time.perf_counter() - start

    n = min(PROBE_POINTS, n_all)
    fewer = max(1, n // 10)
    before = one_view(fewer)
    if before <= allowed:  # or else what the first call makes once is the least of it
        before = one_view(fewer)
    seconds = one_view(n)
    while n < n_all:
        larger = min(10 * n, n_all)
        growth = max(0.0, seconds - before) / max(1, n - fewer)  # seconds per point: none where faces alone cost
        if seconds + growth * (larger - n) > allowed:
            break
        fewer, before, n = n, seconds, larger
        seconds = one_view(n)
    if n < n_all:
        return np.array([n_views // 2]), max(n, min(n_all, int(n * allowed / seconds)))
    k = int(np.clip(allowed / seconds, 1, n_views))
    return np.unique(np.linspace(0, n_views - 1, k).round().astype(int)), n


def warm(method: str, options: dict[str, Any]) -> None:
    """Run the method on a cube, so that what happens only once has happened."""
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
    faces = [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]]
    faces += [[2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]
    cube = Mesh(corners, np.array(faces), name="cube")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with prepare(cube, method, gl=_gl_for(method), **options) as occluder:
            occluder.visible(sample_surface(cube, n_points=200), np.array([[4.0, 1.0, 2.0], [-1.0, 4.0, 3.0]]))


_gl: Any = None
"""The only GL context of the child."""


def _gl_for(method: str) -> Any:
    """Return the GL context where a method needs one, opened by the first."""
    global _gl
    if not find_method(method).needs_gl:
        return None
    if _gl is None:
        from zbuf_occlude.gl.context import GlContext  # late: only these methods touch GL

        _gl = GlContext.open()
    return _gl


def _process_memory(name: str) -> int:
    """Return a field of /proc/self/status in bytes; 0 where there is none."""
    try:
        with open("/proc/self/status", encoding="utf-8") as file:
            return next((int(line.split()[1]) * 1024 for line in file if line.startswith(name)), 0)
    except OSError:
        return 0


def _reset_peak() -> None:
    """Let the peak start again from what is resident now; where that is not allowed peaks only grow."""
    try:
        with open("/proc/self/clear_refs", "w", encoding="utf-8") as file:
            file.write("5")
    except OSError:
        pass
