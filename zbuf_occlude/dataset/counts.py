"""Counts: everything that is counted while clouds are made, added up from mesh to shard to dataset."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from typing import Any, NamedTuple, TypeVar

BAD_VIEW = 0.01
"""A view of whose checked points a larger share is wrong counts as a bad one."""


class WorstView(NamedTuple):
    """The checked view with the largest share of wrong answers, and where it is."""

    share: float
    mesh: str
    variation: int
    view: int


class WorstMesh(NamedTuple):
    """The mesh of whose surface the largest share has another sheet too near to be told from it."""

    share: float
    mesh: str


@dataclass(frozen=True)
class Counts:
    """What was made and what was checked.

    Parameters
    ----------
    n_clouds : int
    n_blind_views : int
        Views that see nothing, and give no cloud.
    n_inside : int
        Cameras inside the bounding box of their mesh.
    n_with_repeats : int
        Clouds with fewer visible points than they hold.
    n_checked : int
        Pairs of view and point asked again of the oracle.
    false_visible, false_hidden : int
        Of them the pairs that a method shows and the oracle hides, and the other way round.
    n_views_checked, n_bad_views : int
        Views of which points were checked; those of which more than `BAD_VIEW` were wrong.
    worst : WorstView, optional
        None where nothing was checked.
    n_looked_at, n_stacked : int
        Points that were looked at for another sheet, and those that have one nearer than the method's tolerance.
    most_stacked : WorstMesh, optional
        None where none was looked at.
    n_without_colors : int
        Meshes of which colours are wanted and some are lacking.
    faces_dropped : mapping of reason to number
        What cleaning took away.
    """

    n_clouds: int = 0
    n_blind_views: int = 0
    n_inside: int = 0
    n_with_repeats: int = 0
    n_checked: int = 0
    false_visible: int = 0
    false_hidden: int = 0
    n_views_checked: int = 0
    n_bad_views: int = 0
    worst: WorstView | None = None
    n_looked_at: int = 0
    n_stacked: int = 0
    most_stacked: WorstMesh | None = None
    n_without_colors: int = 0
    faces_dropped: Mapping[str, int] = field(default_factory=dict)

    def __add__(self, other: "Counts") -> "Counts":
        """Return the counts of both."""
        numbers = {
            each.name: getattr(self, each.name) + getattr(other, each.name)
            for each in fields(self)
            if each.name not in ("worst", "most_stacked", "faces_dropped")
        }
        dropped = Counter(self.faces_dropped)
        dropped.update(other.faces_dropped)
        return Counts(
            **numbers,
            worst=_larger(self.worst, other.worst),
            most_stacked=_larger(self.most_stacked, other.most_stacked),
            faces_dropped=dict(dropped),
        )

    @property
    def document(self) -> dict[str, Any]:
        """Plain data, for JSON."""
        return asdict(self)

    @classmethod
    def from_document(cls, document: Mapping[str, Any]) -> "Counts":
        """Read back what `document` gave."""
        worst, most = document["worst"], document["most_stacked"]
        read = {"worst": worst and WorstView(*worst), "most_stacked": most and WorstMesh(*most)}
        return cls(**{**document, **read})


Worst = TypeVar("Worst", WorstView, WorstMesh)


def _larger(one: Worst | None, other: Worst | None) -> Worst | None:
    """Return the one of the larger share, the first of equals."""
    known = [each for each in (one, other) if each is not None]
    return max(known, key=lambda each: each.share, default=None)
