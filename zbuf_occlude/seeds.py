"""Seeds of all random draws: from a mesh's key and what is drawn, never from a worker, a shard or an order."""

import hashlib

import numpy as np


def seed_of(seed: int, key: str, *path: int) -> np.random.SeedSequence:
    """Return the seed of a mesh's draws.

    `path` tells the draws of a mesh apart: (variation,) for its points, (variation, view) for a cloud's subset.
    """
    digest = hashlib.sha256(key.encode()).digest()
    return np.random.SeedSequence([seed, int.from_bytes(digest[:8], "little"), *path])
