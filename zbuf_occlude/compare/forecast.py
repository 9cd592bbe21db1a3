"""How long a comparison will take, said before it begins: its rows, its judge, and the rows that will be given up."""

from collections.abc import Sequence
from dataclasses import dataclass

from zbuf_occlude.compare.judge import Judge
from zbuf_occlude.compare.run import Case
from zbuf_occlude.errors import OccludeError

PAIRS_PER_SECOND = 2.5e7
"""Pairs of line and face that methods which test all of them get through on one core (2 to 4e7, measured)."""
JUDGED_PER_SECOND = 1e8
"""The same for the judge, whose lines run side by side."""
FEWEST_CALLS = 3
"""Of a method that is slow however few points it is given: two to see what it costs, one timed."""
OVERHEAD = 1.0
"""Seconds of a row that are not its own: warming up, preparing, comparing."""

BY_VERTICES = ("vertex_hsr", "vertex_hsr_culled")
"""Methods that test every vertex against every face, however few points are asked about."""


@dataclass(frozen=True)
class Forecast:
    """What a comparison is expected to cost.

    Parameters
    ----------
    n_rows : int
    seconds : float
        On the machine the rates were measured on, when nothing else runs and kernels are compiled: a rough guide.
    given_up : list of str
        ``case · subject`` of rows that are expected to take longer than a row may.
    """

    n_rows: int
    seconds: float
    given_up: list[str]


def forecast(cases: Sequence[Case], judge: Judge, *, budget: float, limit: float) -> Forecast:
    """Say how long `run` will take with the same arguments.

    Notes
    -----
    Every mesh is loaded once for it, one after the other; what cannot be loaded costs nothing here and is a row later.
    """
    n_rows, seconds = 0, 0.0
    given_up: list[str] = []
    for case in cases:
        n_rows += len(case.subjects)
        try:
            question = case.make()
        except OccludeError:
            continue
        timed = budget if case.budget is None else case.budget
        for subject in case.subjects:
            pairs = len(question.mesh.vertices) * len(question.mesh.faces) if subject.method in BY_VERTICES else 0
            needed = FEWEST_CALLS * pairs / PAIRS_PER_SECOND
            if needed > limit:
                given_up.append(f"{case.label} · {subject.label}")
            seconds += min(limit, OVERHEAD + max(0.5 * timed, needed))
        if case.judged:
            seconds += judge.n_tests(question) / JUDGED_PER_SECOND
    return Forecast(n_rows, seconds, given_up)
