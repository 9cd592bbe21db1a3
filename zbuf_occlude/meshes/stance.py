"""Whether meshes stand on the axis that was assumed: z, or rather y, by where they touch the ground."""

import os
import time
from collections.abc import Sequence
from contextlib import suppress
from typing import NamedTuple

import numpy as np

from zbuf_occlude.errors import MeshError
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.meshes.collection import MeshEntry

NEAR = 0.005
"""Of the longest side: so near to the lowest vertex one touches the ground."""
STANDS, LIES = 0.3, 0.15
"""Share of the footprint that touches the ground, at least of what stands, at most of what does not. Of 175 pieces of
furniture with y up, 69 stand on y alone; turned z up, 5."""
LOOKED_AT, SECONDS, LARGE = 12, 0.5, 1 << 22
"""So many meshes are looked at, evenly chosen, for so long after the first; none whose file has more bytes."""
FEWEST = 0.25
"""Share of the meshes that stand on y alone, at least, where most seem to lie on their side."""


class Stances(NamedTuple):
    """How many meshes were looked at, and stand on an axis alone."""

    n: int
    on_z: int
    on_y: int

    @property
    def lie(self) -> bool:
        """Whether most seem to lie on their side; what stands on both axes, or on none, says nothing."""
        return self.on_y > 0 and self.on_y >= max(2 * self.on_z, FEWEST * self.n)


def contact(mesh: Mesh, axis: int) -> float:
    """Return the share of a mesh's footprint across an axis that the box about its lowest vertices has, in [0, 1]."""
    sides, across = np.ptp(mesh.bounds, axis=0), [other for other in range(3) if other != axis]
    used = mesh.vertices[np.unique(mesh.faces)]
    low = used[used[:, axis] <= mesh.bounds[0, axis] + NEAR * mesh.longest_side]
    footprint = float(sides[across].prod())
    return float(np.ptp(low[:, across], axis=0).prod()) / footprint if footprint > 0.0 else 0.0


def stands_on(mesh: Mesh) -> str:
    """Return the axis, "z" or "y", that a mesh stands on, and not on the other; "" where that is not clear."""
    on_z, on_y = contact(mesh, 2), contact(mesh, 1)
    if on_z >= STANDS and on_y <= LIES:
        return "z"
    return "y" if on_y >= STANDS and on_z <= LIES else ""


def stances(entries: Sequence[MeshEntry]) -> Stances:
    """Look at a few meshes of a collection; those that cannot be read are left out."""
    found, until = list[str](), np.inf
    chosen = np.unique(np.linspace(0, len(entries) - 1, min(LOOKED_AT, len(entries))).astype(int)).tolist()
    for number in chosen:
        path = entries[number].path
        if time.monotonic() > until or (path is not None and path.is_file() and os.path.getsize(path) > LARGE):
            continue
        with suppress(MeshError, OSError):
            found.append(stands_on(entries[number].load()))
        until = min(until, time.monotonic() + SECONDS)  # the first mesh may compile
    return Stances(len(found), found.count("z"), found.count("y"))
