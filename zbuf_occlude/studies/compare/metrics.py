"""Errors of a method against the reference, and the ranking of methods over all meshes."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from zbuf_occlude.base.arrays import BoolArray, FloatArray
from zbuf_occlude.drawing.pages import NONE
from zbuf_occlude.meshes.sampling import SurfacePoints

Row = dict[str, Any]
"""Stored result of a subject on a case; see `run`."""
SILHOUETTE_EDGES = (0.125, 0.25, 0.5, 1.0, 2.0)
"""Upper ends of the bins of distance from the nearest silhouette, in footprints; the last bin is open."""
INCIDENCE_EDGES = (15.0, 30.0, 45.0, 60.0, 75.0, 85.0, 90.0)
"""Upper ends of the bins of the angle of incidence, in degrees."""
FOOTPRINTS = 512
"""Footprints per diagonal; a footprint is the size of a pixel of a 512 x 512 image around the mesh."""

TRUE_HIDDEN, TRUE_VISIBLE, FALSE_VISIBLE, FALSE_HIDDEN = range(4)
"""Outcomes of a pair of view and point, as stored for the worst views."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ReferenceAnswer:
    """The reference's answer for the first n points of a question, from k eyes."""

    truth: BoolArray  # (k, n), True = visible
    decided: BoolArray  # (k, n), False in the boundary band
    silhouette: FloatArray  # (k, n), footprints, rounded up to one of `SILHOUETTE_EDGES`, inf beyond
    incidence: FloatArray  # (k, n), angle between line of sight and normal, degrees


@dataclass(frozen=True, eq=False, kw_only=True)
class ComparedPairs(ReferenceAnswer):
    """Pairs of view and point that a method and the reference both answered."""

    answer: BoolArray  # (k, n), the method's answer, True = visible
    positions: FloatArray  # (n, 3), world space, in longest sides of the mesh

    def view(self, i: int) -> "ComparedPairs":
        """Return the pairs of the i-th view alone."""
        rows = ("answer", "truth", "decided", "silhouette", "incidence")
        return replace(self, **{name: getattr(self, name)[i : i + 1] for name in rows})


def outcomes(answer: BoolArray, truth: BoolArray) -> np.ndarray[Any, np.dtype[np.uint8]]:
    """Return the outcome of each pair, uint8 of the masks' shape."""
    codes = np.where(truth, np.where(answer, TRUE_VISIBLE, FALSE_HIDDEN), np.where(answer, FALSE_VISIBLE, TRUE_HIDDEN))
    return codes.astype(np.uint8)


def count_errors(answer: BoolArray, truth: BoolArray, where: BoolArray | None = None) -> dict[str, int]:
    """Count the pairs, or those of the mask `where`, and their errors: n, false_visible, false_hidden."""
    where = np.ones_like(truth) if where is None else where
    return {
        "n": int(where.sum()),
        "false_visible": int((answer & ~truth & where).sum()),
        "false_hidden": int((~answer & truth & where).sum()),
    }


def as_fractions(counts: dict[str, int]) -> dict[str, Any]:
    """Turn counts of `count_errors` into n and fractions: agreement, false_visible, false_hidden; None if n is 0."""
    n, wrong = counts["n"], counts["false_visible"] + counts["false_hidden"]
    if not n:
        return {"n": 0, "agreement": None, "false_visible": None, "false_hidden": None}
    return {
        "n": n,
        "agreement": 1.0 - wrong / n,
        "false_visible": counts["false_visible"] / n,
        "false_hidden": counts["false_hidden"] / n,
    }


def count_by_bin(
    answer: BoolArray, truth: BoolArray, values: FloatArray, edges: tuple[float, ...]
) -> list[dict[str, Any]]:
    """Count the errors in bins of a value (k, n) of each pair.

    `edges` are the upper ends, increasing; an open bin follows where any value is above the last. A bin holds the
    counts of `count_errors` and `upto`, its upper end, None for the open bin.
    """
    which = np.searchsorted(edges, values, side="left")
    bins: list[dict[str, Any]] = [
        {"upto": upto, **count_errors(answer, truth, which == i)} for i, upto in enumerate((*edges, None))
    ]
    return bins if bins[-1]["n"] else bins[:-1]


def incidence_degrees(points: SurfacePoints, eyes: FloatArray) -> FloatArray:
    """Return the angles (k, n) between lines of sight and normals of n points, degrees: 0 head on, 90 grazing.

    The sign of the unit normals does not count. Eyes (k, 3) are in world space.
    """
    towards = eyes[:, None] - points.positions[None]
    length = np.maximum(np.linalg.norm(towards, axis=2), np.finfo(np.float64).tiny)
    cosine = np.abs(np.einsum("knx,nx->kn", towards, points.normals)) / length
    return np.asarray(np.degrees(np.arccos(np.clip(cosine, 0.0, 1.0))))


def chamfer(positions: FloatArray, answer: BoolArray, truth: BoolArray) -> float | None:
    """Return the Chamfer distance between the clouds that two masks (n,) select from positions (n, 3).

    It is the mean distance from a cloud's points to the nearest of the other cloud, summed over both directions; None
    where exactly one of the clouds is empty. Points in both clouds have distance 0, so only wrong points are searched:
    O(wrong x n).
    """
    if not answer.any() or not truth.any():
        return 0.0 if answer.any() == truth.any() else None
    extra = _to_nearest(positions[answer & ~truth], positions[truth]).sum() / answer.sum()
    lost = _to_nearest(positions[truth & ~answer], positions[answer]).sum() / truth.sum()
    return float(extra + lost)


def mean_chamfer(pairs: ComparedPairs) -> float | None:
    """Return the mean of `chamfer` over views, in longest sides; None where it is undefined in all views."""
    distances = [chamfer(pairs.positions, a, t) for a, t in zip(pairs.answer, pairs.truth, strict=True)]
    known = [distance for distance in distances if distance is not None]
    return float(np.mean(known)) if known else None


def _to_nearest(positions: FloatArray, cloud: FloatArray) -> FloatArray:
    """Return the distance of each position to the nearest point of a cloud; blocks limit the memory."""
    nearest = np.empty(len(positions))
    for start in range(0, len(positions), 256):
        block = positions[start : start + 256]
        squared = ((block[:, None] - cloud[None]) ** 2).sum(axis=2)
        nearest[start : start + 256] = np.sqrt(squared.min(axis=1))
    return nearest


def measures_per_view(pairs: ComparedPairs) -> dict[str, Any]:
    """Return the measures of a view or of all views: fractions of the pairs, and errors outside the boundary band."""
    return {
        **as_fractions(count_errors(pairs.answer, pairs.truth)),
        "outside": as_fractions(count_errors(pairs.answer, pairs.truth, pairs.decided)),
        "band": float((~pairs.decided).mean()),
        "visible": float(pairs.answer.mean()),
        "visible_judge": float(pairs.truth.mean()),
    }


def measures(pairs: ComparedPairs) -> dict[str, Any]:
    """Return the measures of all views together as plain data."""
    return {
        **measures_per_view(pairs),
        "by_silhouette": count_by_bin(pairs.answer, pairs.truth, pairs.silhouette, SILHOUETTE_EDGES),
        "by_incidence": count_by_bin(pairs.answer, pairs.truth, pairs.incidence, INCIDENCE_EDGES),
        "chamfer": mean_chamfer(pairs),
    }


# ---- over all meshes -------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Ranking:
    """Errors and times of a subject over all meshes on which it ran.

    Errors are fractions of the compared pairs outside the boundary band, means over the meshes; times are geometric
    means.
    """

    subject: str
    method: str
    n_meshes: int
    pairs: int  # pairs of view and point outside the boundary band
    wrong: float
    false_visible: float
    false_hidden: float
    band: float  # fraction of pairs in the band
    chamfer: float | None  # in longest sides
    seconds: float  # seconds per view of all the question's points
    extrapolated: bool  # True if `seconds` was scaled up from fewer points on any mesh
    build: float  # seconds to prepare a mesh
    memory: float | None  # bytes, the largest over the meshes
    points_per_second: float


def rank_subjects(rows: Iterable[Row]) -> list[Ranking]:
    """Rank all subjects that were measured and compared: the least wrong first, then the fastest.

    Meshes without a pair outside the boundary band are left out.
    """
    groups: dict[str, list[Row]] = {}
    for row in rows:
        if row["status"] == "ok" and "judged" in row and row["judged"]["outside"]["n"]:
            groups.setdefault(row["subject"], []).append(row)
    return sorted((_summarise(group) for group in groups.values()), key=lambda s: (s.wrong, s.seconds))


def _summarise(rows: Sequence[Row]) -> Ranking:
    outside = [row["judged"]["outside"] for row in rows]
    chamfers = [row["judged"]["chamfer"] for row in rows if row["judged"]["chamfer"] is not None]
    memories = [row["timed"]["peak_memory"] for row in rows if row["timed"]["peak_memory"] is not None]
    seconds = [seconds_for_all_points(row) for row in rows]
    return Ranking(
        subject=rows[0]["subject"],
        method=rows[0]["method"],
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
    """Return the seconds per view of all the question's points, scaled up linearly where fewer were asked."""
    timed = row["timed"]
    return float(timed["seconds_per_view"] * row["n_points"] / timed["n_points"])


def best_rival(one: Ranking, ranking: Iterable[Ranking]) -> Ranking | None:
    """Return the least wrong subject that is better in error or time and worse in neither; None if there is none."""
    rivals = (a for a in ranking if a.wrong <= one.wrong and a.seconds <= one.seconds)
    better = (a for a in rivals if a.wrong < one.wrong or a.seconds < one.seconds)
    return min(better, key=lambda a: (a.wrong, a.seconds), default=None)


def pareto_front(ranking: Sequence[Ranking]) -> set[str]:
    """Return the subjects that no other subject dominates in error and time."""
    return {one.subject for one in ranking if best_rival(one, ranking) is None}


def format_percent(fraction: float) -> str:
    """Format a fraction as a percentage of two significant digits, e.g. ``0.13 %``."""
    return f"{_digits(100.0 * fraction, 2)} %"


def format_error(row: Row) -> str:
    """Format the fraction of a row's pairs outside the boundary band that are wrong; a dash without such pairs."""
    agreement = row["judged"]["outside"]["agreement"]
    return NONE if agreement is None else format_percent(1.0 - agreement)


def format_milliseconds(seconds: float) -> str:
    """Format seconds as milliseconds of three significant digits."""
    return _digits(1e3 * seconds, 3)


def _digits(value: float, n: int) -> str:
    """Format a number with n significant digits, or all digits before the point, without exponent."""
    rounded = float(f"{value:.{n}g}")
    if rounded == 0.0:
        return "0"
    decimals = n - 1 - int(np.floor(np.log10(abs(rounded)) + 1e-12))
    return f"{rounded if decimals >= 0 else value:,.{max(0, decimals)}f}"


def representatives(ranking: Sequence[Ranking]) -> list[Ranking]:
    """Return the subjects of the first screen: the Pareto front, and the least wrong setting of every other method."""
    best = pareto_front(ranking)
    shown, methods = [], {s.method for s in ranking if s.subject in best}
    for one in ranking:
        if one.subject in best or one.method not in methods:
            shown.append(one)
            methods.add(one.method)
    return shown


def fit_exponent(x: Sequence[float], y: Sequence[float]) -> float:
    """Return the exponent b of y = a x^b, fitted by least squares of the logarithms."""
    return float(np.polyfit(np.log(x), np.log(y), 1)[0])


def _mean(values: Iterable[float]) -> float:
    return float(np.mean(list(values)))


def _geometric_mean(values: Iterable[float]) -> float:
    return float(np.exp(np.mean(np.log(np.maximum(list(values), 1e-9)))))
