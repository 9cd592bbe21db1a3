"""How large a study is: everything that decides its numbers, besides the objects and the scans."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

from zbuf_occlude.dataset.presets import MODELNET8, SHARES
from zbuf_occlude.errors import OptionError
from zbuf_occlude.learn.models import find_model

FEWEST_OBJECTS = 5
"""Of a class: three train, one validates and one is tested where objects are held out."""


@dataclass(frozen=True)
class Size:
    """Objects, clouds, points, classifiers and how long they are trained.

    Parameters
    ----------
    name : str
    summary : str
        One line.
    models : tuple of str
        Names in the table of models: those of 4.2.
    seeds : tuple of int
        One classifier of each kind is trained with each of them (4.3, 4.4 and the methods of HSR).
    passes : int
        Clouds shown to each classifier of 4.3 under the budget of clouds, however large its training set.
    epochs : int
        Epochs of each classifier of 4.3 under the budget of epochs.
    batch_size : int
    patience : float
        Training stops when validation has not become better for this share of it; 1: it never stops early.
    n_validation : int
        Clouds looked at after each epoch, at most.
    elevation_seeds : tuple of int
        Those of 4.2.
    elevation_epochs : int
        Epochs of a classifier of 4.2 with objects held out; with the paper's split as many clouds are shown.
    elevation_each : int, optional
        Objects of each class of 4.2; by default 200 in all, the same number of each as far as can be.
    azimuths : int
        Views at each elevation, at most; the paper has up to 10.
    variations : int
        Samplings of each object.
    elevation_sampled : int
        Points sampled on each object of 4.2 before HSR.
    elevation_points : int
        Points of each cloud of 4.2.
    per_elevation : int
        Clouds of each object at each elevation that are tested, at most, when objects are seen in training.
    augmentation_models : tuple of str
        Those of 4.3 and 4.4.
    shares : (int, int, int)
        Objects of each class of 4.3 to train, to validate and to test.
    sampled : int
        Points sampled on each object of 4.3 before HSR.
    n_points : tuple of int
        Points of each cloud of 4.3: a classifier of each kind for each number. The last is that of the comparison of
        methods.
    views : int
        Of the 25 of 4.3; 5: each elevation once, each azimuth once.
    method_models : tuple of str
        Classifiers that methods of HSR are compared by.
    """

    name: str
    summary: str
    models: tuple[str, ...]
    seeds: tuple[int, ...]
    passes: int
    epochs: int
    batch_size: int
    patience: float
    n_validation: int
    elevation_seeds: tuple[int, ...]
    elevation_epochs: int
    elevation_each: int | None
    azimuths: int
    variations: int
    elevation_sampled: int
    elevation_points: int
    per_elevation: int
    augmentation_models: tuple[str, ...]
    shares: tuple[int, int, int]
    sampled: int
    n_points: tuple[int, ...]
    views: int
    method_models: tuple[str, ...]

    @property
    def document(self) -> dict[str, Any]:
        """The values as JSON has them."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        return {name: list(value) if isinstance(value, tuple) else value for name, value in values.items()}

    def with_models(self, names: Sequence[str]) -> "Size":
        """Return the size with these models in all experiments; methods are compared by those of them that were,
        or by all.

        Raises
        ------
        OptionError
            There is no such model, or none is named.
        """
        models = tuple(dict.fromkeys(find_model(name).name for name in names))
        if not models:
            raise OptionError("models must name at least one; none is.")
        by = tuple(model for model in self.method_models if model in models) or models
        return self._changed(f"{' '.join(models)}", models=models, augmentation_models=models, method_models=by)

    def with_seeds(self, n: int) -> "Size":
        """Return the size with the seeds 0 to n - 1 in all experiments."""
        return self._changed(f"{n} seeds", seeds=tuple(range(n)), elevation_seeds=tuple(range(n)))

    def with_objects(self, n: int) -> "Size":
        """Return the size with n objects of each class: in 4.3 to train, with validation and test in the paper's share.

        Raises
        ------
        OptionError
            Fewer than `FEWEST_OBJECTS`, or more than the paper's 40.
        """
        most = SHARES["train"]
        if not FEWEST_OBJECTS <= n <= most:
            raise OptionError(
                f"objects must lie in {FEWEST_OBJECTS}..{most}: of each class one is held out to be tested in 4.2, and "
                f"the paper trains on {most} in 4.3; got {n}."
            )
        train, val, test = (max(1, round(n * share / most)) for share in SHARES.values())
        return self._changed(
            f"{n} objects of a class",
            elevation_each=n,
            shares=(train, val, test),
            passes=self._epochs_of_complete * len(MODELNET8) * train,
        )

    def _changed(self, what: str, **values: Any) -> "Size":
        return replace(self, name=f"{self.name}, {what}", summary="otherwise of that size", **values)

    @property
    def _epochs_of_complete(self) -> int:
        """How often each complete cloud is shown to C2 under the budget of clouds."""
        return max(1, round(self.passes / (len(MODELNET8) * self.shares[0])))

    def with_points(self, numbers: Sequence[int]) -> "Size":
        """Return the size with clouds of this many points; 4.2 takes the last; objects are sampled as densely.

        Raises
        ------
        OptionError
            No number, or less than 1.
        """
        if not numbers or min(numbers) < 1:
            raise OptionError(f"points must be numbers of at least 1; got {', '.join(map(str, numbers)) or 'none'}.")
        return self._changed(
            f"{' and '.join(f'{each:,}' for each in numbers)} points",
            n_points=tuple(numbers),
            sampled=-(-self.sampled * max(numbers) // max(self.n_points)),
            elevation_points=numbers[-1],
            elevation_sampled=-(-self.elevation_sampled * numbers[-1] // self.elevation_points),
        )

    def with_epochs(self, n: int) -> "Size":
        """Return the size with n epochs: of each classifier, under the budget of clouds of that on complete ones."""
        passes = n * len(MODELNET8) * self.shares[0]
        return self._changed(f"{n} epochs", epochs=n, elevation_epochs=n, passes=passes)


FULL = Size(
    name="full",
    summary="the paper's numbers of objects, views, clouds and points; meant for a GPU",
    models=("voxnet", "pointnet", "threedmfv"),
    seeds=(0, 1, 2),
    passes=480_000,
    epochs=60,
    batch_size=32,
    patience=0.25,
    n_validation=2_000,
    elevation_seeds=(0, 1, 2),
    elevation_epochs=12,
    elevation_each=None,
    azimuths=10,
    variations=10,
    elevation_sampled=8_000,
    elevation_points=1_024,
    per_elevation=100,
    augmentation_models=("voxnet", "pointnet", "threedmfv"),
    shares=(40, 10, 25),
    sampled=60_000,
    n_points=(12_000, 1_024),
    views=25,
    method_models=("voxnet", "pointnet", "threedmfv"),
)

QUICK = Size(
    name="quick",
    summary="a quarter of an hour on two processor cores",
    models=("voxnet", "pointnet", "threedmfv5-small"),
    seeds=(0, 1, 2),
    passes=5_760,
    epochs=30,
    batch_size=16,
    patience=1.0,
    n_validation=200,
    elevation_seeds=(0,),
    elevation_epochs=3,
    elevation_each=None,
    azimuths=2,
    variations=1,
    elevation_sampled=1_500,
    elevation_points=256,
    per_elevation=1,
    augmentation_models=("voxnet", "threedmfv5-small"),
    shares=(24, 10, 20),
    sampled=1_500,
    n_points=(256,),
    views=5,
    method_models=("voxnet",),
)
