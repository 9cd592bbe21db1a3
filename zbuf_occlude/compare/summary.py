"""From rows to the answer: error and time of each subject over all meshes, which matter, when to use which."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

Row = dict[str, Any]


@dataclass(frozen=True)
class Standing:
    """What one subject did over all meshes on which it ran.

    Errors are fractions of the judged pairs outside the boundary band, mean over the meshes; times are geometric
    means.
    """

    subject: str
    method: str
    exact: bool  # whether the method claims to equal the oracle outside the boundary band
    n_meshes: int
    pairs: int  # of view and point, judged outside the boundary band
    wrong: float
    false_visible: float
    false_hidden: float
    band: float  # fraction of pairs in the band
    chamfer: float | None  # in longest sides
    seconds: float  # of a view of all the question's points
    extrapolated: bool  # whether `seconds` was, somewhere, scaled up from fewer points
    build: float  # seconds to prepare a mesh
    memory: float | None  # bytes, the largest
    points_per_second: float


def standings(rows: Iterable[Row]) -> list[Standing]:
    """Return the standing of every subject that was measured and judged, the least wrong first, then the fastest."""
    groups: dict[str, list[Row]] = {}
    for row in rows:
        if row["status"] == "ok" and "judged" in row:
            groups.setdefault(row["subject"], []).append(row)
    return sorted((_standing(group) for group in groups.values()), key=lambda s: (s.wrong, s.seconds))


def _standing(rows: Sequence[Row]) -> Standing:
    outside = [row["judged"]["outside"] for row in rows]
    chamfers = [row["judged"]["chamfer"] for row in rows if row["judged"]["chamfer"] is not None]
    memories = [row["timed"]["peak_memory"] for row in rows if row["timed"]["peak_memory"] is not None]
    seconds = [seconds_for_all_points(row) for row in rows]
    return Standing(
        subject=rows[0]["subject"],
        method=rows[0]["method"],
        exact=rows[0]["exact"],
        n_meshes=len(rows),
        pairs=sum(o["n"] for o in outside),
        wrong=_mean(1.0 - o["agreement"] for o in outside),
        false_visible=_mean(o["false_visible"] for o in outside),
        false_hidden=_mean(o["false_hidden"] for o in outside),
        band=_mean(row["judged"]["band"] for row in rows),
        chamfer=_mean(chamfers) if chamfers else None,
        seconds=_geometric_mean(seconds),
        extrapolated=any(row["timed"]["n_points"] < row["n_points"] for row in rows),
        build=_geometric_mean(row["timed"]["build_seconds"] for row in rows),
        memory=max(memories) if memories else None,
        points_per_second=1.0 / _geometric_mean(s / row["n_points"] for s, row in zip(seconds, rows, strict=True)),
    )


def seconds_for_all_points(row: Row) -> float:
    """Seconds a view of all the question's points; scaled up linearly where fewer were asked."""
    timed = row["timed"]
    return float(timed["seconds_per_view"] * row["n_points"] / timed["n_points"])


def front(ranking: Sequence[Standing]) -> set[str]:
    """Return the subjects that nothing beats in both error and time: the Pareto front."""
    return {a.subject for a in ranking if not any(_beats(b, a) for b in ranking)}


def advice(ranking: Sequence[Standing]) -> dict[str, str]:
    """Say of every subject of a ranking (of `standings`) when to use it, from what was measured alone."""
    best = front(ranking)
    right = [s for s in ranking if s.wrong == 0.0]
    fastest_right = min(right, key=lambda s: s.seconds) if right else None
    words = {}
    for one in ranking:
        if one is fastest_right:
            others = [s for s in right if s.method != one.method]
            runner_up = min(others, key=lambda s: s.seconds) if others else None
            words[one.subject] = "whenever the answer must be right"
            if runner_up:
                longer = times(runner_up.seconds, one.seconds)
                words[one.subject] += f"; the next that is never wrong, `{runner_up.subject}`, takes {longer} as long"
        elif one.wrong == 0.0 and fastest_right is not None:
            words[one.subject] = (
                f"as a check of the others; `{fastest_right.subject}` answers the same "
                f"{times(one.seconds, fastest_right.seconds)} as fast"
            )
        elif one.subject in best:
            rival = fastest_right or ranking[0]
            gain = "nothing errs less" if rival is one else f"{times(rival.seconds, one.seconds)} as fast as"
            name = "" if rival is one else f" `{rival.subject}`"
            words[one.subject] = f"when {share(one.wrong)} wrong is good enough: {gain}{name}"
        else:
            rival = min((s for s in ranking if _beats(s, one)), key=lambda s: (s.wrong, s.seconds))
            errs = "is never wrong" if rival.wrong == 0.0 else f"errs {share(rival.wrong)}"
            words[one.subject] = (
                f"not here: `{rival.subject}` {errs} and is {times(one.seconds, rival.seconds)} as fast"
            )
    return words


def _beats(a: Standing, b: Standing) -> bool:
    return a.wrong <= b.wrong and a.seconds <= b.seconds and (a.wrong < b.wrong or a.seconds < b.seconds)


def times(slow: float, fast: float) -> str:
    """Say how many times longer, e.g. ``3.4 times``."""
    ratio = slow / fast
    return f"{ratio:.1f} times" if ratio < 10 else f"{ratio:,.0f} times"


def share(fraction: float) -> str:
    """Write a fraction as a percentage of two digits, e.g. ``0.13 %``; never 0 when it is not."""
    return f"{_digits(100.0 * fraction, 2)} %"


def milliseconds(seconds: float) -> str:
    """Write seconds as milliseconds of three digits."""
    return _digits(1e3 * seconds, 3)


def _digits(value: float, n: int) -> str:
    """Write a number with n significant digits, or all digits before the point, without exponent."""
    rounded = float(f"{value:.{n}g}")
    if rounded == 0.0:
        return "0"
    decimals = n - 1 - int(np.floor(np.log10(abs(rounded)) + 1e-12))
    return f"{rounded if decimals >= 0 else value:,.{max(0, decimals)}f}"


def representatives(ranking: Sequence[Standing]) -> list[Standing]:
    """Return what the first screen shows: the Pareto front, and of every other method its least wrong setting."""
    best = front(ranking)
    shown, methods = [], {s.method for s in ranking if s.subject in best}
    for one in ranking:
        if one.subject in best or one.method not in methods:
            shown.append(one)
            methods.add(one.method)
    return shown


def fit_power(x: Sequence[float], y: Sequence[float]) -> tuple[float, float]:
    """Fit y = a x^b by least squares of the logarithms; return (a, b)."""
    slope, offset = np.polyfit(np.log(np.asarray(x)), np.log(np.asarray(y)), 1)
    return float(np.exp(offset)), float(slope)


def _mean(values: Iterable[float]) -> float:
    return float(np.mean(list(values)))


def _geometric_mean(values: Iterable[float]) -> float:
    return float(np.exp(np.mean(np.log(np.maximum(list(values), 1e-9)))))
