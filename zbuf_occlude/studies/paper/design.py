"""Names and sizes of studies, and the numbers that the paper reports in Tables 3A and 3B; needs no PyTorch."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from math import nan
from types import MappingProxyType
from typing import Any

from zbuf_occlude.base.errors import OptionError
from zbuf_occlude.datasets.presets import MODELNET8, SHARES
from zbuf_occlude.studies.compare.cases import Subject
from zbuf_occlude.studies.learn.models import find_model

# ---- what the paper reports ---------------------------------------------------------------------------------------

CITATION = (
    "V. I. Sryamkin, M. Msallam, S. A. Klestov: A method to create real-like point clouds for 3D object classification "
    "(2023), sections 4.2 to 4.4"
)

TRAIN_ELEVATIONS = (-90, -70, -50, -20, 20, 50, 70, 90)
TEST_ELEVATIONS = (-80, -60, -40, -30, -10, 0, 10, 30, 40, 60, 80)
"""Test elevations of 4.2, degrees: those of Eq. 11 without the training elevations."""

TABLE_3A: dict[str, tuple[float, ...]] = {
    "voxnet": (69.7, 71.1, 71.6, 74.4, 69.0, 50.3, 60.4, 69.3, 69.0, 68.0, 63.9),
    "pointnet": (65.6, 64.9, 74.4, 76.9, 75.5, 60.6, 75.6, 78.3, 78.2, 74.8, 68.0),
    "threedmfv": (97.6, 97.3, 98.0, 98.6, 97.6, 86.8, 97.7, 99.1, 98.5, 97.0, 97.3),
}
"""Overall accuracy by model at each of `TEST_ELEVATIONS`."""

TRAINING_SETS = {1: "generated", 2: "original", 3: "both"}
"""Training clouds of the classifiers C1, C2 and C3 of 4.3."""

TABLE_3B: dict[tuple[str, int], dict[int, tuple[float, float, float, float]]] = {
    ("voxnet", 12_000): {1: (81.0, 76.3, 37.5, 66.7), 2: (82.0, 45.9, 0.0, 0.0), 3: (87.5, 79.7, 20.5, 38.1)},
    ("threedmfv", 12_000): {1: (87.0, 95.2, 77.3, 42.9), 2: (88.5, 81.3, 17.1, 19.1), 3: (89.5, 95.7, 63.6, 38.1)},
    ("threedmfv", 1_024): {1: (nan, nan, 88.6, 66.7), 2: (nan, nan, 36.4, 42.9), 3: (nan, nan, 76.1, 81.0)},
}
"""Accuracies by model and points per cloud, for each training set: Test 1, Test 2, and classes car and 4wd of Test 3.

NaN where the paper gives Test 3 alone.
"""
PUBLISHED_POINTS = 12_000
"""Points per cloud for which the paper gives all tests."""

MODELNET40_ACCURACY = {"voxnet": "69.0 / 83.0", "threedmfv": "91.6"}
"""Last row of Table 3B, Test 1, cited from others: training on all of ModelNet40 (VoxNet without and with rotation)."""

VEHICLES_F1 = ("threedmfv", 1_024, 79.3)
"""Model, points and average F1 over the six vehicle classes (4.4); the paper does not name the training set."""

# ---- names -----------------------------------------------------------------------------------------------------------

ELEVATION, AUGMENTATION, HSR, REALISM = "elevation", "augmentation", "methods", "realism"
"""Names of experiments: 4.2; 4.3 and 4.4; the comparison of methods of HSR; sensors and scenes."""

SPLIT_BY = MappingProxyType(
    {"elevations": "by elevation, as in the paper", "objects": "by elevation, objects held out"}
)
MAIN = Subject("exact")
METHODS = (MAIN, Subject("depth_buffer"), Subject("occupancy_grid", {"n": 64}))
"""Methods of HSR that are compared; the first is used in all experiments, the last is the paper's."""
CLOUDS, EPOCHS = "clouds", "epochs"
BUDGETS = MappingProxyType({CLOUDS: "equal clouds shown", EPOCHS: "equal epochs"})
"""Budgets of the trainings of 4.3: the same number of clouds shown to each classifier, or of epochs."""
ORIGINAL, GENERATED, SCANS = "original", "generated", "scans"
"""Names of Test 1, Test 2 (with suffix ``:METHOD`` for clouds by another method than `MAIN`) and Test 3."""

UNIFORM, ALONE, SCENES, TWO_EYES = KINDS = ("uniform", "scans", "scenes", "two-eyes")
"""Kinds of clouds of `REALISM`: uniform samples of the visible surface; LiDAR scans of single objects; LiDAR scans in
streets; scans of single objects by a depth camera with two eyes."""
OWN, MATCHED = COUNTS = ("own", "matched")
"""Numbers of points of these clouds: their own, or that of the smallest kind of the same object and view."""

REAL = "real"
"""Name of the experiment with real objects."""
COMPLETE, OCCLUDED, LIDAR = "complete", "occluded", "lidar"
COMPLETE_AND_OCCLUDED, COMPLETE_AND_SCANS = "complete+occluded", "complete+lidar"
"""Training sets of `REAL`: the paper's three, LiDAR scans in streets, and complete clouds with these."""
ALL_AROUND, DRIVE = "around", "drive"
"""Laws of the azimuth of scans: uniform, or that of traffic."""
RECIPES = (
    *((name, ALL_AROUND, "cloud") for name in (COMPLETE, OCCLUDED, COMPLETE_AND_OCCLUDED, LIDAR, COMPLETE_AND_SCANS)),
    (LIDAR, DRIVE, "cloud"),
    *((name, ALL_AROUND, "metres") for name in (COMPLETE, OCCLUDED, LIDAR)),
    (LIDAR, DRIVE, "metres"),
)
"""Training sets with the azimuths of the scans, and the scale of the clouds."""
REAL_OBJECTS, HELD_OUT, FITTED, SIMULATED = "real-objects", "held-out-objects", "fitted-objects", "simulated"
"""Tests of `REAL`: all real objects, those of sweeps on which nothing was fitted, the others, and simulated scans."""
FITTED_ON = ("000004", "000006", "000008", "000010")
"""KITTI's sweeps on which the windows of vehicles were fitted (docs/real_drives.md); all others are held out."""

MIN_OBJECTS = 5
"""Minimum objects per class where objects are held out: three to train, one to validate, one to test."""

_PRINTED = {"voxnet": "VoxNet", "pointnet": "PointNet", "threedmfv": "3DmFV"}
_VARIANTS = {"threedmfv5": "5³ Gaussians", "threedmfv5-small": "5³ Gaussians, a quarter of the filters"}


def name_of_test(method: Subject) -> str:
    """Return the name of Test 2 with clouds by a method."""
    return GENERATED if method.label == MAIN.label else f"{GENERATED}:{method.label}"


def paper_name(model: str) -> str:
    """Return the paper's model of a variant: ``threedmfv`` for ``threedmfv5``."""
    return next((name for name in _PRINTED if model.startswith(name)), model)


def printed(model: str) -> str:
    """Return the name of a model in tables, with the variant in brackets."""
    name = paper_name(model)
    return _PRINTED.get(name, name) + (f" ({model})" if model != name else "")


def described(model: str) -> str:
    """Return the name of a model in tables, with the differences of a variant from the paper's network."""
    return printed(model) + (f": {_VARIANTS[model]}" if model in _VARIANTS else "")


class Progress:
    """Receiver of the progress of a study; the base class ignores it."""

    def set_totals(self, n_clouds: int, n_trials: int) -> None:
        """Receive the totals: clouds to make, classifiers to train and test."""

    def add_clouds(self, n: int) -> None:
        """Receive the number of clouds made since the last call."""

    def update_trial(self, key: str, share: float) -> None:
        """Receive the key of a classifier and the fraction of its training that is done; 1: also tested."""


@dataclass(frozen=True)
class Size:
    """Everything that determines a study's results; stored in study.json, and resumed only with equal values.

    The defaults are `FULL`. Section 4.2 is elevation; 4.3 and 4.4 are augmentation and the methods of HSR.
    """

    name: str = "full"
    summary: str = "the paper's numbers of objects, views, clouds and points; meant for a GPU"
    models: tuple[str, ...] = ("voxnet", "pointnet", "threedmfv")  # models of 4.2, names in the table of models
    seeds: tuple[int, ...] = (0, 1, 2)  # seeds of 4.3 and 4.4, one classifier of each kind per seed
    passes: int = 480_000  # clouds shown to each classifier of 4.3 under the budget of clouds
    epochs: int = 60  # epochs of each classifier of 4.3 under the budget of epochs
    batch_size: int = 32
    patience: float = 0.25  # fraction of a training without a better validation after which it stops; 1: never
    n_validation: int = 2_000  # maximum clouds of a validation
    elevation_seeds: tuple[int, ...] = (0, 1, 2)  # seeds of 4.2
    elevation_epochs: int = 12  # epochs of 4.2 with objects held out; the paper's split shows as many clouds
    elevation_each: int | None = None  # objects per class of 4.2; None: 200 in all, evenly
    azimuths: int = 10  # maximum views per elevation; the paper has up to 10
    variations: int = 10  # samplings of each object of 4.2
    elevation_sampled: int = 8_000  # points sampled on each object of 4.2 before HSR
    elevation_points: int = 1_024  # points of each cloud of 4.2
    per_elevation: int = 100  # maximum test clouds per object and elevation, with the paper's split
    augmentation_models: tuple[str, ...] = ("voxnet", "pointnet", "threedmfv")  # models of 4.3 and 4.4
    shares: tuple[int, int, int] = (40, 10, 25)  # objects per class of 4.3 for training, validation and test
    sampled: int = 60_000  # points sampled on each object of 4.3 before HSR
    n_points: tuple[int, ...] = (12_000, 1_024)  # points per cloud of 4.3; methods are compared with the last number
    views: int = 25  # number of the 25 views of 4.3; 5: each elevation and azimuth once
    method_models: tuple[str, ...] = ("voxnet", "pointnet", "threedmfv")  # models for the comparison of methods of HSR
    real_passes: int = 240_000  # clouds shown to each classifier of the experiment with real objects

    def to_dict(self) -> dict[str, Any]:
        """All values as plain data for JSON."""
        return {name: list(value) if isinstance(value, tuple) else value for name, value in asdict(self).items()}


FULL = Size()
QUICK = Size(
    name="quick",
    summary="a quarter of an hour on two processor cores",
    models=("voxnet", "pointnet", "threedmfv5-small"),
    passes=5_760,
    epochs=30,
    batch_size=16,
    patience=1.0,
    n_validation=200,
    elevation_seeds=(0,),
    elevation_epochs=3,
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
    real_passes=2_880,
)


def changed(
    size: Size,
    *,
    models: Sequence[str] | None = None,
    seeds: int | None = None,
    objects: int | None = None,
    points: Sequence[int] | None = None,
    epochs: int | None = None,
) -> Size:
    """Return a size with some values changed, and a name that lists the changes.

    Parameters
    ----------
    size : Size
    models : sequence of str, optional
        Models of all experiments. Methods are compared with those that `size` compares, or else with all of them.
    seeds : int, optional
        Number of seeds, counted from 0.
    objects : int, optional
        Objects per class; in 4.3 those to train, with validation and test in the paper's proportion.
    points : sequence of int, optional
        Points per cloud; 4.2 uses the last number. The density of samples on the objects is kept.
    epochs : int, optional
        Epochs per classifier; under the budget of clouds, those of the one trained on complete clouds.

    Raises
    ------
    OptionError
        No model or an unknown one, too few or too many objects, or points below 1.
    """
    names = [size.name]
    if models is not None:
        size = _with_models(size, models)
        names.append(" ".join(size.models))
    if seeds is not None:
        size = replace(size, seeds=tuple(range(seeds)), elevation_seeds=tuple(range(seeds)))
        names.append(f"{seeds} seeds")
    if objects is not None:
        size = _with_objects(size, objects)
        names.append(f"{objects} objects of a class")
    if points is not None:
        size = _with_points(size, points)
        names.append(f"{' and '.join(f'{each:,}' for each in points)} points")
    if epochs is not None:
        passes = epochs * len(MODELNET8) * size.shares[0]
        size = replace(size, epochs=epochs, elevation_epochs=epochs, passes=passes)
        names.append(f"{epochs} epochs")
    summary = size.summary if len(names) == 1 else "otherwise of that size"
    return replace(size, name=", ".join(names), summary=summary)


def _with_models(size: Size, models: Sequence[str]) -> Size:
    found = tuple(dict.fromkeys(find_model(name).name for name in models))
    if not found:
        raise OptionError("models must name at least one; none is.")
    compared = tuple(model for model in size.method_models if model in found) or found
    return replace(size, models=found, augmentation_models=found, method_models=compared)


def _with_objects(size: Size, objects: int) -> Size:
    most = SHARES["train"]
    if not MIN_OBJECTS <= objects <= most:
        raise OptionError(
            f"objects must lie in {MIN_OBJECTS}..{most}: in 4.2 one of each class is held out for the test, and in "
            f"4.3 the paper trains on {most}; got {objects}."
        )
    train, val, test = (max(1, round(objects * share / most)) for share in SHARES.values())
    times_shown = max(1, round(size.passes / (len(MODELNET8) * size.shares[0])))  # each complete cloud
    passes = times_shown * len(MODELNET8) * train
    return replace(size, elevation_each=objects, shares=(train, val, test), passes=passes)


def _with_points(size: Size, points: Sequence[int]) -> Size:
    if not points or min(points) < 1:
        raise OptionError(f"points must be numbers of at least 1; got {', '.join(map(str, points)) or 'none'}.")
    return replace(
        size,
        n_points=tuple(points),
        sampled=-(-size.sampled * max(points) // max(size.n_points)),
        elevation_points=points[-1],
        elevation_sampled=-(-size.elevation_sampled * points[-1] // size.elevation_points),
    )
