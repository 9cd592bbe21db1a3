"""Seeds of all random draws: from a mesh's key and what is drawn, never from a worker, a shard or an order."""

import hashlib
from typing import Any

import numpy as np

from zbuf_occlude.errors import OptionError


def generator(seed: Any) -> np.random.Generator:
    """Return a generator of a seed, a SeedSequence or a generator.

    Raises
    ------
    OptionError
        It is none of these, or below 0.
    """
    try:
        return np.random.default_rng(seed)
    except (TypeError, ValueError):
        raise OptionError(f"seed must be an int of at least 0, or a SeedSequence; got {seed!r:.60}.") from None


def seed_of(seed: int, key: str, *path: int) -> np.random.SeedSequence:
    """Return the seed of a mesh's draws.

    `path` tells the draws of a mesh apart: (variation,) for its points, (variation, view) for a cloud's subset.
    """
    digest = hashlib.sha256(key.encode()).digest()
    return np.random.SeedSequence([seed, int.from_bytes(digest[:8], "little"), *path])
