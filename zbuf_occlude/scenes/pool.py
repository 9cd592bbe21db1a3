"""The objects that scenes are filled with: a few of a collection, loaded when they are wanted, in metres."""

from collections.abc import Sequence

import numpy as np

from zbuf_occlude.errors import MeshError, OptionError
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.meshes.collection import MeshEntry
from zbuf_occlude.scenes.files import standing
from zbuf_occlude.scenes.parts import box
from zbuf_occlude.scenes.sizes import Sizes, size_of

MOST_OBJECTS = 24
"""Of a collection this many are taken, so that a worker loads each once."""
MOST_FACES = 30_000
"""Of one of them."""
MOST_METRES = {"street": 7.0, "room": 2.2}
"""Longer ones do not go into these scenes."""


class Pool:
    """Some objects of a collection, by a number in [0, 1). The same collection and seed give the same.

    Parameters
    ----------
    entries : sequence of MeshEntry
        Those that cannot be loaded, have no size, or are too long or detailed are passed over; with none left there
        are crates.
    sizes : Sizes
    scene : str
        A name of `zbuf_occlude.scenes.kinds.KINDS`.
    seed : SeedSequence
    """

    def __init__(self, entries: Sequence[MeshEntry], sizes: Sizes, scene: str, seed: np.random.SeedSequence) -> None:
        order = np.random.default_rng(seed).permutation(len(entries))
        self._entries = [entries[int(i)] for i in order[:MOST_OBJECTS]]
        self._sizes, self._most = sizes, MOST_METRES.get(scene, np.inf)
        self._made: dict[int, tuple[Mesh, str] | None] = {}

    def __call__(self, number: float) -> tuple[Mesh, str]:
        """Return an object: a mesh that stands on z = 0, in metres, and its class."""
        n = len(self._entries)
        for i in range(n):
            if (found := self._object((int(number * n) + i) % n)) is not None:
                return found
        return box(1.2, 0.8, 1.0), "crate"

    def _object(self, i: int) -> tuple[Mesh, str] | None:
        if i not in self._made:
            self._made[i] = None
            entry = self._entries[i]
            try:
                mesh = entry.load()
                size = size_of(entry.label, self._sizes, mesh.longest_side)
            except (MeshError, OptionError):
                return None
            if mesh.longest_side > 0 and len(mesh.faces) <= MOST_FACES and size <= self._most:
                self._made[i] = standing(mesh, size), entry.label
        return self._made[i]
