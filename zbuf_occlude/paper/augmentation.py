"""Training on occluded clouds, complete ones, or both (paper 4.3, 4.4, Table 3B); and does the method of HSR matter?"""

from collections.abc import Callable, Iterable, Sequence
from functools import lru_cache, partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from zbuf_occlude.compare.cases import Subject
from zbuf_occlude.dataset.plan import Plan, Recipe
from zbuf_occlude.dataset.presets import plan_of_originals, seventy_five_each
from zbuf_occlude.errors import GlError, UnavailableError
from zbuf_occlude.learn.data import CloudSet
from zbuf_occlude.meshes.collection import MeshCollection
from zbuf_occlude.paper import sydney
from zbuf_occlude.paper.design import (
    AUGMENTATION,
    CLOUDS,
    GENERATED,
    HSR,
    MAIN,
    METHODS,
    ORIGINAL,
    SCANS,
    Size,
    name_of_test,
)
from zbuf_occlude.paper.objects import first_of_each, loaded, make_clouds
from zbuf_occlude.paper.reported import TRAINING_SETS
from zbuf_occlude.paper.trials import Trial, as_many_clouds, as_many_epochs
from zbuf_occlude.views import modelnet8
from zbuf_occlude.visibility import find_method


class Scans(NamedTuple):
    """Where real scans are, and which direction of their files is up."""

    root: Path
    up: str


class AugmentationClouds:
    """The datasets of 4.3 in a study's folder: complete clouds, occluded ones by each method, and real scans.

    `budgets` (of `BUDGETS`) say how long classifiers are trained: those of Table 3B under each, methods under the
    first. `make` fills `missing`: methods that cannot run here, and why.
    """

    def __init__(
        self,
        meshes: MeshCollection,
        size: Size,
        folder: Path,
        scans: Scans | None = None,
        budgets: Sequence[str] = (CLOUDS,),
    ) -> None:
        self.size, self.folder, self.real, self.budgets = size, folder, scans, tuple(budgets)
        self.meshes = first_of_each(seventy_five_each(meshes), size.shares)
        self.missing: dict[str, str] = {}

    def plan(self, method: Subject) -> Plan:
        """Return the plan of the occluded clouds by a method."""
        size, views = self.size, modelnet8()
        recipe = Recipe(
            method=method.method,
            method_options=method.options,
            views="modelnet8",
            n_points=size.sampled,
            sample_size=max(size.n_points),
        )
        # 5 elevations by 5 azimuths, row by row: every sixth goes down the diagonal, and in the end comes to all
        return Plan(self.meshes, recipe, "packed", views.select(np.sort(np.arange(size.views) * 6 % len(views))))

    @property
    def n_clouds(self) -> int:
        """Clouds that `make` makes, at most."""
        return len(METHODS) * self.plan(MAIN).n_clouds + len(self.meshes)

    def make(self, progress: Callable[[int], None]) -> dict[str, str]:
        """Make all datasets; a method that cannot run here is left out, with its reason in `missing`.

        Returns the meshes that could not be used, and why.
        """
        failures = make_clouds(plan_of_originals(self.plan(MAIN)), self._folder(ORIGINAL), progress)
        for method in METHODS:
            reason = find_method(method.method).missing()
            if not reason:
                try:
                    failures |= make_clouds(self.plan(method), self._folder(method.label), progress)
                    continue
                except (GlError, UnavailableError) as error:
                    reason = str(error)
            self.missing[method.label] = reason
            progress(self.plan(method).n_clouds)  # there will be none to wait for
        return failures

    @property
    def able(self) -> tuple[Subject, ...]:
        """The methods that can run here, `MAIN` first."""
        return tuple(method for method in METHODS if method.label not in self.missing)

    def _folder(self, name: str) -> Path:
        return self.folder / "clouds" / name.replace(":", "-").replace("=", "")

    def of(self, kind: str, split: str, n_points: int, method: Subject = MAIN) -> CloudSet:
        """Return the clouds of a split; `kind` is of `TRAINING_SETS`: generated (by a method), original, both."""
        names = [method.label] * (kind != ORIGINAL) + [ORIGINAL] * (kind != GENERATED)
        first, *second = (loaded(self._folder(name), split, n_points) for name in names)
        return CloudSet.joined(first, *second) if second else first

    def trials(self) -> list[Trial]:
        """Return the trials of Table 3B, then those that compare methods; seed after seed.

        Of Table 3B: each model on each training set, with each number of points, under each budget. Of the methods:
        trained on the generated clouds of one, tested on those of each; with `MAIN` that is training set 1 of Table 3B.
        """
        size, last = self.size, self.size.n_points[-1]
        table_3b = [
            Trial(
                AUGMENTATION,
                {"model": model, "set": training_set, "points": n_points, "budget": budget, "seed": seed},
                partial(self.of, kind, "train", n_points),
                partial(self.of, kind, "val", n_points),
                self._tests(n_points, self.able if n_points == last and model in size.method_models else (MAIN,)),
                self._epochs(budget),
            )
            for seed in size.seeds
            for budget in self.budgets
            for n_points in size.n_points
            for model in size.augmentation_models
            for training_set, kind in TRAINING_SETS.items()
        ]
        methods = [
            Trial(
                HSR,
                {"model": model, "method": method.label, "points": last, "budget": self.budgets[0], "seed": seed},
                partial(self.of, GENERATED, "train", last, method),
                partial(self.of, GENERATED, "val", last, method),
                self._tests(last, self.able),
                self._epochs(self.budgets[0]),
            )
            for seed in size.seeds
            for model in size.method_models
            for method in self.able[1:]
        ]
        return table_3b + methods

    def _epochs(self, budget: str) -> Callable[[int], int]:
        if budget == CLOUDS:
            return partial(as_many_clouds, self.size.passes)
        return partial(as_many_epochs, self.size.epochs)

    def _tests(self, n_points: int, methods: Iterable[Subject]) -> dict[str, Callable[[], CloudSet]]:
        tests: dict[str, Callable[[], CloudSet]] = {ORIGINAL: partial(self.of, ORIGINAL, "test", n_points)}
        tests |= {name_of_test(method): partial(self.of, GENERATED, "test", n_points, method) for method in methods}
        if self.real is not None:
            tests[SCANS] = partial(_read_scans, self.real, n_points)
        return tests


@lru_cache(2)
def _read_scans(scans: Scans, n_points: int) -> CloudSet:
    """Return the clouds of Test 3, all four folds; read once a process."""
    return sydney.read_clouds(scans.root, n_points, scans.up)
