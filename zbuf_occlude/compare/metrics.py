"""Errors of an answer: pure functions of a method's mask, the reference's, and where the pairs lie."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from zbuf_occlude.arrays import BoolArray, FloatArray
from zbuf_occlude.geometry.sampling import SurfacePoints

SILHOUETTE_EDGES = (0.125, 0.25, 0.5, 1.0, 2.0)
"""Upper ends of the bins of distance from the nearest silhouette, in footprints; a last bin has no upper end."""
INCIDENCE_EDGES = (15.0, 30.0, 45.0, 60.0, 75.0, 85.0, 90.0)
"""Upper ends of the bins of the angle of incidence, in degrees."""
FOOTPRINTS = 512
"""Footprints per diagonal: one is what a pixel of a 512 x 512 image around the mesh covers at the target."""

TRUE_HIDDEN, TRUE_VISIBLE, FALSE_VISIBLE, FALSE_HIDDEN = range(4)
"""The four outcomes of a pair of view and point, as stored for the worst views."""


@dataclass(frozen=True, eq=False)
class Pairs:
    """Pairs of view and point that a method and the reference both answered."""

    answer: BoolArray  # (k, n), True = visible
    truth: BoolArray  # (k, n), the reference's
    decided: BoolArray  # (k, n), False in the boundary band
    silhouette: FloatArray  # (k, n), distance from the nearest silhouette in footprints
    incidence: FloatArray  # (k, n), angle between line of sight and normal, degrees
    positions: FloatArray  # (n, 3), world space, in longest sides of the mesh

    def view(self, i: int) -> "Pairs":
        """Return the pairs of the i-th view alone."""
        rows = ("answer", "truth", "decided", "silhouette", "incidence")
        return replace(self, **{name: getattr(self, name)[i : i + 1] for name in rows})


def outcomes(answer: BoolArray, truth: BoolArray) -> np.ndarray[Any, np.dtype[np.uint8]]:
    """Return which of the four outcomes each pair is; uint8 of the masks' shape."""
    codes = np.where(truth, np.where(answer, TRUE_VISIBLE, FALSE_HIDDEN), np.where(answer, FALSE_VISIBLE, TRUE_HIDDEN))
    return codes.astype(np.uint8)


def count_errors(answer: BoolArray, truth: BoolArray, where: BoolArray | None = None) -> dict[str, int]:
    """Count pairs and errors, `where` given only among those pairs: n, false_visible, false_hidden."""
    where = np.ones_like(truth) if where is None else where
    return {
        "n": int(where.sum()),
        "false_visible": int((answer & ~truth & where).sum()),
        "false_hidden": int((~answer & truth & where).sum()),
    }


def as_fractions(counts: dict[str, int]) -> dict[str, float]:
    """Turn counts of `count_errors` into n, agreement, false_visible, false_hidden as fractions of n (0 of none)."""
    n = max(counts["n"], 1)
    wrong = counts["false_visible"] + counts["false_hidden"]
    return {
        "n": counts["n"],
        "agreement": 1.0 - wrong / n,
        "false_visible": counts["false_visible"] / n,
        "false_hidden": counts["false_hidden"] / n,
    }


def count_by_bin(
    answer: BoolArray, truth: BoolArray, values: FloatArray, edges: tuple[float, ...]
) -> list[dict[str, Any]]:
    """Count errors by the bin that each pair's value (k, n) falls in.

    `edges` are the upper ends, increasing; what lies above the last goes into one more bin if there is any. Each bin
    is the counts of `count_errors` and `upto`, None for the open one.
    """
    which = np.searchsorted(edges, values, side="left")
    bins: list[dict[str, Any]] = [
        {"upto": upto, **count_errors(answer, truth, which == i)} for i, upto in enumerate((*edges, None))
    ]
    return bins if bins[-1]["n"] else bins[:-1]


def incidence_degrees(points: SurfacePoints, eyes: FloatArray) -> FloatArray:
    """Return the angle between each line of sight and the point's normal, of either sign: 0 head on, 90 grazing.

    (k, n) degrees of n points with unit normals and (k, 3) eyes in world space.
    """
    towards = eyes[:, None] - points.positions[None]
    length = np.maximum(np.linalg.norm(towards, axis=2), np.finfo(np.float64).tiny)
    cosine = np.abs(np.einsum("knx,nx->kn", towards, points.normals)) / length
    return np.asarray(np.degrees(np.arccos(np.clip(cosine, 0.0, 1.0))))


def chamfer(positions: FloatArray, answer: BoolArray, truth: BoolArray) -> float | None:
    """Return the Chamfer distance between the clouds that two masks (n,) cut out of positions (n, 3).

    The mean distance from each cloud's points to the other's nearest, both directions added; None where one of the
    clouds is empty and the other is not. Points in both have distance 0, so only the disagreements are searched:
    O(wrong x n).
    """
    if not answer.any() or not truth.any():
        return 0.0 if answer.any() == truth.any() else None
    extra = _to_nearest(positions[answer & ~truth], positions[truth]).sum() / answer.sum()
    lost = _to_nearest(positions[truth & ~answer], positions[answer]).sum() / truth.sum()
    return float(extra + lost)


def mean_chamfer(pairs: Pairs) -> float | None:
    """Return the mean over views of `chamfer`, in longest sides; None where a cloud is empty in all of them."""
    distances = [chamfer(pairs.positions, a, t) for a, t in zip(pairs.answer, pairs.truth, strict=True)]
    known = [distance for distance in distances if distance is not None]
    return float(np.mean(known)) if known else None


def _to_nearest(positions: FloatArray, cloud: FloatArray) -> FloatArray:
    """Distance of each position to the nearest point of a cloud; blocks keep the memory small."""
    nearest = np.empty(len(positions))
    for start in range(0, len(positions), 256):
        block = positions[start : start + 256]
        squared = ((block[:, None] - cloud[None]) ** 2).sum(axis=2)
        nearest[start : start + 256] = np.sqrt(squared.min(axis=1))
    return nearest


def measures_per_view(pairs: Pairs) -> dict[str, Any]:
    """Return what is measured of each view and of all: shares of the pairs, and errors outside the boundary band."""
    return {
        **as_fractions(count_errors(pairs.answer, pairs.truth)),
        "outside": as_fractions(count_errors(pairs.answer, pairs.truth, pairs.decided)),
        "band": float((~pairs.decided).mean()),
        "visible": float(pairs.answer.mean()),
        "visible_judge": float(pairs.truth.mean()),
    }


def measures(pairs: Pairs) -> dict[str, Any]:
    """Return what is measured of all views together, as JSON has it; a new measure is one line."""
    return {
        **measures_per_view(pairs),
        "by_silhouette": count_by_bin(pairs.answer, pairs.truth, pairs.silhouette, SILHOUETTE_EDGES),
        "by_incidence": count_by_bin(pairs.answer, pairs.truth, pairs.incidence, INCIDENCE_EDGES),
        "chamfer": mean_chamfer(pairs),
    }
