"""Experiment `augmentation`: training on occluded and complete clouds; sections 4.3 and 4.4 of the paper (Table 3B).

Methods of hidden-surface removal are compared, too.
"""

from collections.abc import Callable, Iterable, Sequence
from functools import partial, reduce
from pathlib import Path
from typing import Any

import numpy as np

from zbuf_occlude.base.errors import GlError, UnavailableError
from zbuf_occlude.datasets.plan import DatasetConfig, Plan
from zbuf_occlude.datasets.presets import plan_of_originals
from zbuf_occlude.meshes.collection import MeshCollection
from zbuf_occlude.studies.compare.cases import Subject
from zbuf_occlude.studies.learn.data import CloudSet
from zbuf_occlude.studies.paper.design import (
    AUGMENTATION,
    CLOUDS,
    GENERATED,
    HSR,
    MAIN,
    METHODS,
    ORIGINAL,
    SCANS,
    TRAINING_SETS,
    Size,
    name_of_test,
)
from zbuf_occlude.studies.paper.experiments import Experiment, MakeOptions, epochs_for, paper_objects
from zbuf_occlude.studies.paper.real_scans import read_scans
from zbuf_occlude.studies.paper.results import Trial
from zbuf_occlude.views import modelnet8


class Augmentation(Experiment):
    """Training on occluded clouds, on complete ones, on both, and on the clouds by each method of HSR.

    `scans` are the root of the real scans and their up direction. `budgets` are keys of `BUDGETS`: the classifiers of
    Table 3B are trained under each of them, the methods are compared under the first.
    """

    def __init__(
        self,
        meshes: MeshCollection,
        size: Size,
        folder: Path,
        scans: tuple[Path, str] | None = None,
        budgets: Sequence[str] = (CLOUDS,),
    ) -> None:
        super().__init__(size, folder)
        self.scans, self.budgets = scans, tuple(budgets)
        self.meshes = paper_objects(meshes, size.shares)
        self.missing: dict[str, str] = {}  # reasons why methods cannot run here, set by `make_datasets`

    def plan_of(self, method: Subject) -> Plan:
        """Return the plan of the occluded clouds by a method."""
        size, views = self.size, modelnet8()
        config = DatasetConfig(
            method=method.method,
            method_options=method.options,
            views="modelnet8",
            n_points=size.sampled,
            sample_size=max(size.n_points),
        )
        # of 5 x 5 views, every sixth is on the diagonal; multiples of 6 modulo 25 reach all of them
        return Plan(self.meshes, config, "packed", views.select(np.sort(np.arange(size.views) * 6 % len(views))))

    def plans(self) -> dict[str, Plan]:
        """Return the plans of the complete clouds, and of the occluded ones by each method."""
        return {ORIGINAL: plan_of_originals(self.plan_of(MAIN)), **{m.label: self.plan_of(m) for m in METHODS}}

    def _make_dataset(self, name: str, plan: Plan, options: MakeOptions) -> dict[str, str]:
        """Make a dataset; a method that cannot run here is left out."""
        try:
            return super()._make_dataset(name, plan, options)
        except (GlError, UnavailableError) as error:
            if name == ORIGINAL:
                raise
            self.missing[name] = str(error)
            options.progress(plan.n_clouds)  # the progress bar must reach its end
            return {}

    def notes(self) -> dict[str, Any]:
        """Return the methods that cannot run here, with reasons."""
        return {"missing_methods": self.missing}

    def clouds_of(self, kind: str, split: str, n_points: int, method: Subject = MAIN) -> CloudSet:
        """Return the clouds of a split; `kind` is generated (by a method), original or both, as in `TRAINING_SETS`."""
        names = [method.label] * (kind != ORIGINAL) + [ORIGINAL] * (kind != GENERATED)
        return reduce(CloudSet.concatenate, (self.load_split(name, split, n_points) for name in names))

    def trials(self) -> list[Trial]:
        """Return the trials of Table 3B, then those that compare methods.

        Table 3B: each model, training set, number of points and budget. Methods: training on the generated clouds by
        one, tests on those by each; for `MAIN` this is training set 1 of Table 3B.
        """
        size, last, first_budget = self.size, self.size.n_points[-1], self.budgets[0]
        able = [method for method in METHODS if method.label not in self.missing]
        table_3b = [
            Trial(
                AUGMENTATION,
                {"model": model, "set": training_set, "points": n_points, "budget": budget, "seed": seed},
                partial(self.clouds_of, kind, "train", n_points),
                partial(self.clouds_of, kind, "val", n_points),
                self._tests(n_points, able if n_points == last and model in size.method_models else [MAIN]),
                partial(self._epochs, budget),
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
                {"model": model, "method": method.label, "points": last, "budget": first_budget, "seed": seed},
                partial(self.clouds_of, GENERATED, "train", last, method),
                partial(self.clouds_of, GENERATED, "val", last, method),
                self._tests(last, able),
                partial(self._epochs, first_budget),
            )
            for seed in size.seeds
            for model in size.method_models
            for method in able[1:]
        ]
        return table_3b + methods

    def _epochs(self, budget: str, n_clouds: int) -> int:
        return epochs_for(self.size.passes, n_clouds) if budget == CLOUDS else self.size.epochs

    def _tests(self, n_points: int, methods: Iterable[Subject]) -> dict[str, Callable[[], CloudSet]]:
        tests: dict[str, Callable[[], CloudSet]] = {ORIGINAL: partial(self.clouds_of, ORIGINAL, "test", n_points)}
        tests |= {
            name_of_test(method): partial(self.clouds_of, GENERATED, "test", n_points, method) for method in methods
        }
        if self.scans is not None:
            tests[SCANS] = partial(read_scans, self.scans[0], n_points, self.scans[1])
        return tests
