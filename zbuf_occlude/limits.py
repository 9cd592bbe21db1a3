"""Limits: what one mesh may take, in time and memory, before whoever works on it is killed."""

from dataclasses import dataclass
from typing import NamedTuple

from zbuf_occlude.errors import OptionError


@dataclass(frozen=True)
class Limits:
    """What one mesh may take before it is given up, and counted as failed.

    Parameters
    ----------
    seconds : float
        Wall-clock time for one mesh, all its views and variations.
    gigabytes : float
        Resident memory of the process while it is at the mesh.
    """

    seconds: float = 600.0
    gigabytes: float = 8.0

    def __post_init__(self) -> None:
        for what, value in (("seconds", self.seconds), ("gigabytes", self.gigabytes)):
            if not value > 0:
                raise OptionError(f"the {what} that a mesh may take must be positive; got {value}.")

    def excess(self, seconds: float, gigabytes: float) -> str:
        """Say which limit a mesh has exceeded that has taken so much; empty when none."""
        if seconds > self.seconds:
            return f"a mesh may take {self.seconds:g} seconds; this one took longer. Raise --mesh-seconds."
        if gigabytes > self.gigabytes:
            return f"a mesh may take {self.gigabytes:g} GB of memory; this one took more. Raise --mesh-gigabytes."
        return ""


class GivenUp(NamedTuple):
    """Why a mesh was given up, and within which limits: with others it may be tried again."""

    reason: str
    limits: Limits
