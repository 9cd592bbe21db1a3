"""Clouds that several trials want are read once a process."""

from functools import lru_cache
from pathlib import Path

from zbuf_occlude.dataset.folder import MANIFEST
from zbuf_occlude.learn.data import CloudSet, load_clouds
from zbuf_occlude.paper import sydney

KEPT = 16
"""Sets of clouds that stay in memory."""


def loaded(folder: Path, split: str, n_points: int) -> CloudSet:
    """Return a split of a finished dataset, with this many points of each cloud."""
    return _loaded(folder, (folder / MANIFEST).stat().st_mtime_ns, split, n_points)


@lru_cache(KEPT)
def _loaded(folder: Path, made: int, split: str, n_points: int) -> CloudSet:
    return load_clouds(folder, split, n_points)


@lru_cache(2)
def read_scans(root: Path, n_points: int, up: str) -> CloudSet:
    """Return the real scans of Test 3, all four folds."""
    return sydney.read_clouds(root, n_points, up)
