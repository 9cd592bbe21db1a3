"""Counts of what was made and checked, added up from mesh to dataset; the measured error and its interval."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.base.arrays import BoolArray
from zbuf_occlude.sensors.scan_config import LEAST_POINTS

BAD_VIEW = 0.01
"""Share of wrong answers among a view's checked points above which the view counts as bad."""
CONFIDENCE = 0.95
FEW = LEAST_POINTS
"""Number of distinct points below which clouds are counted as nearly empty."""


class Blank(NamedTuple):
    """The views of a mesh that give no cloud: their number, and the index and the reason of the first."""

    n_views: int
    variation: int
    view: int
    reason: str

    @property
    def said(self) -> str:
        """The first view and the reason, in words."""
        of = f" of variation {self.variation}" if self.variation else ""
        return f"view {self.view}{of}: {self.reason}"


class WorstView(NamedTuple):
    """The checked view with the largest share of wrong answers, and where it is."""

    share: float
    mesh: str
    variation: int
    view: int


@dataclass(frozen=True)
class QualityCounts:
    """Counts of what was made and what was checked.

    Those of the limits of range have the names that `zbuf_occlude.sensors.capture.Cut` gives them.
    """

    n_clouds: int = 0
    n_blind_views: int = 0  # views that see nothing, and give no cloud
    n_sparse: int = 0  # scans of fewer distinct points than `ScanConfig.least_points`, which give no cloud
    n_inside: int = 0  # cameras inside the bounding box of their mesh
    n_raised: int = 0  # cameras that would stand below the ground
    n_with_repeats: int = 0  # clouds with fewer visible points than they hold
    n_few: int = 0  # clouds of fewer than `FEW` distinct visible points
    n_returns: int = 0  # returns of the scanned objects, within the sensor's limits of range or not
    n_too_near: int = 0  # of these, returns nearer than the sensor measures
    n_too_far: int = 0
    clear_range: float = 0.0  # metres, from which on none would be too near
    n_checked: int = 0  # pairs of view and point checked by the oracle
    false_visible: int = 0  # of these, pairs that the method shows and the oracle hides
    false_hidden: int = 0
    n_views_checked: int = 0
    n_bad_views: int = 0  # of these, views with a larger share of wrong points than `BAD_VIEW`
    wrong_squared: int = 0  # sums over the checked views: number of wrong answers, squared
    wrong_checked: int = 0  # that number times the number of checked points
    checked_squared: int = 0  # the latter, squared
    worst: WorstView | None = None
    n_without_colors: int = 0  # meshes that lack some of the colours asked for
    n_with_far_faces: int = 0  # meshes with a few faces that make the contact tolerance large for all others
    n_without_windows: int = 0  # meshes that have none of the windows asked for
    faces_dropped: Mapping[str, int] = field(default_factory=dict)  # by cleaning, for each reason

    def __add__(self, other: "QualityCounts") -> "QualityCounts":
        """Return the sums of both counts; the first of equally bad views or meshes stays the worst."""
        added: dict[str, Any] = {}
        for name in (each.name for each in fields(self)):
            mine, theirs = getattr(self, name), getattr(other, name)
            if name == "worst":
                added[name] = max(filter(None, (mine, theirs)), key=lambda each: each.share, default=None)
            elif name == "clear_range":
                added[name] = max(mine, theirs)
            elif name == "faces_dropped":
                added[name] = {reason: mine.get(reason, 0) + theirs.get(reason, 0) for reason in {**mine, **theirs}}
            else:
                added[name] = mine + theirs
        return QualityCounts(**added)

    @classmethod
    def of_views(
        cls, behind: BoolArray, before: BoolArray, numbers: NDArray[np.integer[Any]], place: WorstView
    ) -> "QualityCounts":
        """Count wrong answers about v views of n points, (v, n): false visible, and false hidden.

        `numbers`, (v,), are the views' indices; `place` names mesh and variation.
        """
        wrong, n = (behind | before).sum(axis=1), behind.shape[1]
        worst = int(wrong.argmax())
        return cls(
            n_checked=behind.size,
            false_visible=int(behind.sum()),
            false_hidden=int(before.sum()),
            n_views_checked=len(wrong),
            n_bad_views=int((wrong > BAD_VIEW * n).sum()),
            wrong_squared=int((wrong * wrong).sum()),
            wrong_checked=n * int(wrong.sum()),
            checked_squared=n * behind.size,
            worst=place._replace(share=float(wrong[worst] / n), view=int(numbers[worst])),
        )

    @classmethod
    def from_dict(cls, document: Mapping[str, Any]) -> "QualityCounts":
        """Read back counts that `dataclasses.asdict` gave."""
        worst = document["worst"]
        return cls(**{**document, "worst": worst and WorstView(float(worst[0]), *worst[1:])})

    @property
    def error(self) -> dict[str, Any]:
        """The measured error; None where nothing was checked. ``interval`` bounds the share of all wrong answers."""
        n, n_views = self.n_checked, self.n_views_checked
        n_wrong = self.false_visible + self.false_hidden
        return {
            "false_visible": self.false_visible / n if n else None,
            "false_hidden": self.false_hidden / n if n else None,
            "interval": list(interval(n_wrong, n, self._design_effect)) if n else None,
            "n_checked": n,
            "n_views_checked": n_views,
            "bad_views": self.n_bad_views / n_views if n_views else None,
            "worst_view": None if self.worst is None else self.worst._asdict(),
        }

    @property
    def _design_effect(self) -> float:
        """Variance of the share of wrong answers as views vary, over that of independent answers; at least 1.

        Every mesh is checked, so meshes are no sample. Bad views of which none was drawn remain unknown.
        """
        n, n_views = self.n_checked, self.n_views_checked
        share = (self.false_visible + self.false_hidden) / n
        if n_views < 2 or share in (0.0, 1.0):
            return 1.0  # nothing is known of how views vary
        squares = self.wrong_squared - 2.0 * share * self.wrong_checked + share * share * self.checked_squared
        return max(1.0, n_views / (n_views - 1) * squares / (n * share * (1.0 - share)))

    @property
    def cut(self) -> dict[str, Any] | None:
        """Shares of the objects' returns beyond the sensor's limits of range; None without scans."""
        if not self.n_returns:
            return None
        shares = {name: getattr(self, f"n_{name}") / self.n_returns for name in ("too_near", "too_far")}
        return {"returns": self.n_returns, **shares, "clear_range": self.clear_range or None}


def interval(n_wrong: int, n: int, design_effect: float = 1.0) -> tuple[float, float]:
    """Return the interval that holds the true share with `CONFIDENCE`, where `n_wrong` of `n` random answers are wrong.

    Answers about one view may err together: with a design effect of d, n tell as much as n / d independent ones.

    References
    ----------
    C. J. Clopper, E. S. Pearson: The use of confidence or fiducial limits illustrated in the case of the binomial.
    Biometrika 26 (1934), doi:10.1093/biomet/26.4.404.
    E. L. Korn, B. I. Graubard: Confidence intervals for proportions with small expected number of positive counts
    estimated from survey data. Survey Methodology 24 (1998). Departure: counts are rounded outwards.
    """
    n = max(1, int(n / design_effect))
    fewest, most = math.floor(n_wrong / design_effect), min(math.ceil(n_wrong / design_effect), n)
    tail = (1.0 - CONFIDENCE) / 2.0
    low = 0.0 if fewest == 0 else _share_of_tail(fewest - 1, n, 1.0 - tail)
    high = 1.0 if most == n else _share_of_tail(most, n, tail)
    return low, high


def _share_of_tail(most: int, n: int, probability: float) -> float:
    """Return the share at which at most `most` of `n` are wrong with a given probability, by bisection."""
    i = np.arange(most)
    log_ways = np.concatenate([[0.0], np.cumsum(np.log(n - i) - np.log(i + 1.0))])  # of choosing 0, 1, ..., most
    wrong = np.arange(most + 1)
    low, high = 0.0, 1.0
    while high - low > 1e-12 * high:
        share = (low + high) / 2.0
        at_most = np.exp(log_ways + wrong * np.log(share) + (n - wrong) * np.log1p(-share)).sum()
        low, high = (share, high) if at_most > probability else (low, share)
    return high
