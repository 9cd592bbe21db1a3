"""A short trial: how many times as fast as another a method makes a mesh of a job, on this machine."""

import os
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

from zbuf_occlude.dataset.plan import Plan, Recipe
from zbuf_occlude.dataset.shard import make_mesh, new_store
from zbuf_occlude.errors import MeshError
from zbuf_occlude.limits import GivenUp, Limits
from zbuf_occlude.meshes.collection import MeshCollection
from zbuf_occlude.visibility import find_method

SECONDS = 0.05
"""For each of the two, at least one mesh: who waits for a trial has waited long enough."""

VIEWS = "modelnet8"

DENSE = 20_000
"""Points of a trial where the recipe gives a density."""

LARGE = 1 << 24
"""Bytes. A larger file is not loaded only to be looked at."""

PATIENCE = 10.0
"""Seconds after which a mesh that is only looked at is left to the workers, which have limits for it."""


@dataclass(frozen=True)
class Trial:
    """A task of one job: to make the mesh of middling size by both methods, from its file to its clouds.

    Its result is the other's seconds divided by the method's; 0 where no mesh can be loaded.

    Parameters
    ----------
    method, other : str
        Of the table of methods.
    recipe : Recipe
        Its points, and its options if it is the method's or the other's.
    meshes : MeshCollection
        Of the job; the larger it is, the less of each mesh is checked.
    chosen : tuple of int
        A few of them. On the smallest all is loaded or compiled before anything is timed.
    """

    method: str
    other: str
    recipe: Recipe
    meshes: MeshCollection
    chosen: tuple[int, ...]

    @property
    def needs_gl(self) -> bool:
        """Whether one of the methods renders."""
        return any(find_method(name).needs_gl for name in (self.method, self.other))

    def do(
        self,
        job: int,
        gl: Any,
        lost: Mapping[int, GivenUp] = MappingProxyType({}),
        on_mesh: Callable[[int | None], None] = lambda mesh_id: None,
    ) -> float:
        """Do it, as one mesh to those who watch; parameters as of `jobs.Task`. Where workers died of it, leave it."""
        if lost:
            return 0.0
        on_mesh(0)
        sizes: dict[int, int] = {}
        for mesh_id in self.chosen:
            entry = self.meshes[mesh_id]
            with suppress(MeshError, OSError, MemoryError), Limits(seconds=PATIENCE).watch():
                if not entry.path or os.path.getsize(entry.path) <= LARGE:
                    sizes[mesh_id] = len(entry.load().faces)
        if not sizes:
            return 0.0
        ordered = sorted(sizes, key=lambda mesh_id: sizes[mesh_id])
        smallest, middling = ordered[0], ordered[len(ordered) // 2]
        return self._seconds(self.other, gl, smallest, middling) / self._seconds(self.method, gl, smallest, middling)

    def _seconds(self, method: str, gl: Any, first: int, mesh_id: int) -> float:
        """Seconds of a mesh, after a little of another."""
        options = self.recipe.method_options if method == self.recipe.method else None
        n_points = self.recipe.n_points or DENSE
        recipe = Recipe(method=method, method_options=options, n_points=n_points, views=VIEWS)
        plan, little = Plan(self.meshes, recipe), Plan(self.meshes, replace(recipe, n_points=100, views="ring:2@30"))
        make_mesh(little, first, gl, new_store(little))
        began, n_meshes = time.perf_counter(), 0
        while n_meshes == 0 or time.perf_counter() - began < SECONDS:
            make_mesh(plan, mesh_id, gl, new_store(plan))
            n_meshes += 1
        return (time.perf_counter() - began) / n_meshes
