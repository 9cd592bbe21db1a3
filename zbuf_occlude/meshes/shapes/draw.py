"""The random choices of one member of a family."""

from collections.abc import Sequence
from typing import TypeVar

import numpy as np

Option = TypeVar("Option")


class Draw:
    """Random choices from one generator.

    Parameters
    ----------
    rng : Generator
        Generator of the member; the order of the calls determines the member.
    detail : float, optional
        Factor on the number of segments of round parts; by default drawn log-uniformly between 0.55 and 2.
    """

    def __init__(self, rng: np.random.Generator, detail: float | None = None) -> None:
        self.rng = rng
        drawn = float(np.exp(rng.uniform(np.log(0.55), np.log(2.0))))
        self.detail = drawn if detail is None else detail

    def between(self, low: float, high: float) -> float:
        """Return a uniform float."""
        return float(self.rng.uniform(low, high))

    def whole(self, low: int, high: int) -> int:
        """Return a uniform integer, both ends included."""
        return int(self.rng.integers(low, high + 1))

    def chance(self, probability: float) -> bool:
        """Return True with the given probability."""
        return bool(self.rng.random() < probability)

    def pick(self, options: Sequence[Option]) -> Option:
        """Return one of the options with equal probability."""
        return options[int(self.rng.integers(len(options)))]

    def round(self, ordinary: int) -> int:
        """Return the number of segments for a circle or curve, `ordinary` times the detail; at least 5."""
        return max(5, round(ordinary * self.detail))
