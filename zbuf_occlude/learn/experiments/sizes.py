"""How large a study is: everything that decides its numbers, beside the objects and the scans."""

from dataclasses import dataclass, fields
from typing import Any


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
        Clouds shown to a classifier of 4.3 in its training, however large its training set: else the one that is
        trained on few clouds would also be trained for a shorter time.
    batch_size : int
    patience : float
        Training stops when validation has not become better for this share of it; 1: it never stops early.
    n_validation : int
        Clouds looked at after each epoch, at most.
    elevation_seeds : tuple of int
        Those of 4.2.
    elevation_passes : int
        Clouds shown to a classifier of 4.2.
    elevation_objects : int
        Objects of 4.2, the same number of each class as far as can be.
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
    batch_size: int
    patience: float
    n_validation: int
    elevation_seeds: tuple[int, ...]
    elevation_passes: int
    elevation_objects: int
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


FULL = Size(
    name="full",
    summary="the paper's numbers of objects, views, clouds and points; meant for a GPU",
    models=("voxnet", "pointnet", "threedmfv"),
    seeds=(0, 1, 2),
    passes=480_000,
    batch_size=32,
    patience=0.25,
    n_validation=2_000,
    elevation_seeds=(0, 1, 2),
    elevation_passes=480_000,
    elevation_objects=200,
    azimuths=10,
    variations=10,
    elevation_sampled=8_000,
    elevation_points=1_024,
    per_elevation=100,
    augmentation_models=("voxnet", "pointnet", "threedmfv"),
    shares=(40, 10, 25),
    sampled=40_000,
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
    batch_size=16,
    patience=1.0,
    n_validation=200,
    elevation_seeds=(0,),
    elevation_passes=5_040,
    elevation_objects=200,
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
