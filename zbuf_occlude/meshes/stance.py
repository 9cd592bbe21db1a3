"""Detection of the up axis of meshes, z or y, from their contact with the ground."""

import os
import time
from collections.abc import Sequence
from contextlib import suppress
from typing import NamedTuple

import numpy as np

from zbuf_occlude.base.errors import MeshError
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.meshes.collection import MeshEntry

CONTACT_HEIGHT = 0.005
"""Height of a ground contact above the lowest vertex, over the longest side."""
STANDS, LIES = 0.3, 0.15
"""Minimum contact of a mesh that stands, and maximum contact of one that does not, over its footprint.

Of 175 pieces of furniture with y up, 69 stand on y alone; with z up, 5."""
N_TESTED, SECONDS, LARGE = 12, 0.5, 1 << 22
"""Meshes tested, seconds spent on them after the first, and bytes of a file above which a mesh is skipped."""
MIN_SHARE = 0.25
"""Minimum share of meshes that stand on y alone, for y to be the likely up axis."""


class Stances(NamedTuple):
    """Number of meshes tested, and of those that stand on one axis alone."""

    n: int
    on_z: int
    on_y: int

    @property
    def suggest_y_up(self) -> bool:
        """True where y is the likely up axis. Meshes that stand on both axes, or on none, do not count."""
        return self.on_y > 0 and self.on_y >= max(2 * self.on_z, MIN_SHARE * self.n)


def contact(mesh: Mesh, axis: int) -> float:
    """Return the area of the box about a mesh's lowest vertices along an axis, over its footprint, in [0, 1]."""
    sides, across = np.ptp(mesh.bounds, axis=0), [other for other in range(3) if other != axis]
    used = mesh.vertices[np.unique(mesh.faces)]
    low = used[used[:, axis] <= mesh.bounds[0, axis] + CONTACT_HEIGHT * mesh.longest_side]
    footprint = float(sides[across].prod())
    return float(np.ptp(low[:, across], axis=0).prod()) / footprint if footprint > 0.0 else 0.0


def stands_on(mesh: Mesh) -> str:
    """Return the only axis, "z" or "y", on which a mesh stands; "" where it stands on both or none."""
    on_z, on_y = contact(mesh, 2), contact(mesh, 1)
    if on_z >= STANDS and on_y <= LIES:
        return "z"
    return "y" if on_y >= STANDS and on_z <= LIES else ""


def stances(entries: Sequence[MeshEntry]) -> Stances:
    """Return the stances of a few meshes of a collection; meshes that cannot be read do not count."""
    found, until = list[str](), np.inf
    chosen = np.unique(np.linspace(0, len(entries) - 1, min(N_TESTED, len(entries))).astype(int)).tolist()
    for number in chosen:
        path = entries[number].path
        if time.monotonic() > until or (path is not None and path.is_file() and os.path.getsize(path) > LARGE):
            continue
        with suppress(MeshError, OSError):
            found.append(stands_on(entries[number].load()))
        until = min(until, time.monotonic() + SECONDS)  # the first mesh may compile
    return Stances(len(found), found.count("z"), found.count("y"))
