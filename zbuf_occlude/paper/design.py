"""What a study is made of: names of experiments, tests, methods and models; sizes. Needs no PyTorch."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from types import MappingProxyType
from typing import Any

from zbuf_occlude.compare.cases import Subject
from zbuf_occlude.dataset.presets import MODELNET8, SHARES
from zbuf_occlude.errors import OptionError
from zbuf_occlude.learn.models import find_model

ELEVATION, AUGMENTATION, HSR, REALISM = "elevation", "augmentation", "methods", "realism"
"""The experiments: of 4.2; of 4.3 and 4.4; the comparison of methods of hidden-surface removal; sensors and scenes."""

SPLIT_BY = MappingProxyType(
    {"elevations": "by elevation, as in the paper", "objects": "by elevation, objects held out"}
)
MAIN = Subject("exact")
METHODS = (MAIN, Subject("depth_buffer"), Subject("occupancy_grid", {"n": 64}))
"""How hidden surfaces are removed: the first everywhere, all where they are compared; the last is the paper's."""
CLOUDS, EPOCHS = "clouds", "epochs"
BUDGETS = MappingProxyType({CLOUDS: "equal clouds shown", EPOCHS: "equal epochs"})
"""Budgets of the trainings of 4.3: each classifier is shown as many clouds, or each cloud as often."""
ORIGINAL, GENERATED, SCANS = "original", "generated", "scans"
"""Test 1; Test 2, with ``:METHOD`` after it where it is another's than `MAIN`; Test 3."""

UNIFORM, ALONE, SCENES = KINDS = ("uniform", "scans", "scenes")
"""Clouds of `REALISM`: points uniform over the visible surface, scans of single objects, scans in streets."""
OWN, MATCHED = COUNTS = ("own", "matched")
"""Points of these clouds: as many as they have, or as the poorest of the three has of that object and view."""

FEWEST_OBJECTS = 5
"""Of a class: three train, one validates and one is tested where objects are held out."""

_PRINTED = {"voxnet": "VoxNet", "pointnet": "PointNet", "threedmfv": "3DmFV"}
_VARIANTS = {"threedmfv5": "5³ Gaussians", "threedmfv5-small": "5³ Gaussians, a quarter of the filters"}


def name_of_test(method: Subject) -> str:
    """Return the name of Test 2 on the clouds of a method."""
    return GENERATED if method.label == MAIN.label else f"{GENERATED}:{method.label}"


def name_of_real(layout: str) -> str:
    """Return the name of the test on real objects of a layout."""
    return f"real:{layout}"


def paper_name(model: str) -> str:
    """Return the model of the paper that a model stands for: ``threedmfv`` for ``threedmfv5``."""
    return next((name for name in _PRINTED if model.startswith(name)), model)


def printed(model: str) -> str:
    """Return how a model is written in tables, its variant in brackets."""
    name = paper_name(model)
    return _PRINTED.get(name, name) + (f" ({model})" if model != name else "")


def described(model: str) -> str:
    """Return the same, and in which way a variant is not the paper's network."""
    return printed(model) + (f": {_VARIANTS[model]}" if model in _VARIANTS else "")


class Progress:
    """Receives the progress of a study; this one ignores it."""

    def plan(self, n_clouds: int, n_trials: int) -> None:
        """Receive the total: clouds to be made, classifiers to be trained and tested."""

    def clouds(self, n: int) -> None:
        """Receive the number of clouds that were made since the last call."""

    def trial(self, key: str, share: float) -> None:
        """Receive which classifier is being trained, and the share of its training that is done; 1: tested too."""


@dataclass(frozen=True)
class Size:
    """Objects, clouds, points, classifiers and how long they are trained; everything that decides a study's numbers.

    The fields are stored in study.json; a study is resumed only with equal ones.
    """

    name: str
    summary: str
    models: tuple[str, ...]  # of 4.2; names in the table of models
    seeds: tuple[int, ...]  # of 4.3, 4.4 and the methods of HSR: one classifier of each kind per seed
    passes: int  # clouds shown to each classifier of 4.3 under the budget of clouds
    epochs: int  # epochs of each classifier of 4.3 under the budget of epochs
    batch_size: int
    patience: float  # share of a training without a better validation after which it stops; 1: never
    n_validation: int  # clouds of a validation at most
    elevation_seeds: tuple[int, ...]  # of 4.2
    elevation_epochs: int  # of 4.2 with objects held out; with the paper's split as many clouds are shown
    elevation_each: int | None  # objects of each class of 4.2; None: 200 in all, evenly
    azimuths: int  # views at each elevation at most; the paper has up to 10
    variations: int  # samplings of each object of 4.2
    elevation_sampled: int  # points sampled on each object of 4.2 before HSR
    elevation_points: int  # points of each cloud of 4.2
    per_elevation: int  # clouds tested per object and elevation at most, when objects are seen in training
    augmentation_models: tuple[str, ...]  # of 4.3 and 4.4
    shares: tuple[int, int, int]  # objects of each class of 4.3 to train, to validate, to test
    sampled: int  # points sampled on each object of 4.3 before HSR
    n_points: tuple[int, ...]  # points of each cloud of 4.3; the last is that of the comparison of methods
    views: int  # of the 25 of 4.3; 5: each elevation once, each azimuth once
    method_models: tuple[str, ...]  # classifiers that methods of HSR are compared by

    @property
    def document(self) -> dict[str, Any]:
        """The values as JSON has them."""
        return {name: list(value) if isinstance(value, tuple) else value for name, value in asdict(self).items()}


def changed(
    size: Size,
    *,
    models: Sequence[str] | None = None,
    seeds: int | None = None,
    objects: int | None = None,
    points: Sequence[int] | None = None,
    epochs: int | None = None,
) -> Size:
    """Return a size with some things changed, named after what was.

    `models`: in all experiments; methods are compared by those of them that were, or by all. `seeds`: 0 to `seeds` -
    1. `objects`: of each class; in 4.3 to train, with validation and test in the paper's share. `points`: of each
    cloud, 4.2 takes the last; objects are sampled as densely. `epochs`: of each classifier; under the budget of clouds
    of the one trained on complete clouds.

    Raises OptionError for no model or an unknown one, too few or too many objects, points below 1.
    """
    names = [size.name]
    if models is not None:
        found = tuple(dict.fromkeys(find_model(name).name for name in models))
        if not found:
            raise OptionError("models must name at least one; none is.")
        by = tuple(model for model in size.method_models if model in found) or found
        size = replace(size, models=found, augmentation_models=found, method_models=by)
        names.append(" ".join(found))
    if seeds is not None:
        size = replace(size, seeds=tuple(range(seeds)), elevation_seeds=tuple(range(seeds)))
        names.append(f"{seeds} seeds")
    if objects is not None:
        most = SHARES["train"]
        if not FEWEST_OBJECTS <= objects <= most:
            raise OptionError(
                f"objects must lie in {FEWEST_OBJECTS}..{most}: of each class one is held out to be tested in 4.2, and "
                f"the paper trains on {most} in 4.3; got {objects}."
            )
        train, val, test = (max(1, round(objects * share / most)) for share in SHARES.values())
        times_shown = max(1, round(size.passes / (len(MODELNET8) * size.shares[0])))  # each complete cloud
        passes = times_shown * len(MODELNET8) * train
        size = replace(size, elevation_each=objects, shares=(train, val, test), passes=passes)
        names.append(f"{objects} objects of a class")
    if points is not None:
        if not points or min(points) < 1:
            raise OptionError(f"points must be numbers of at least 1; got {', '.join(map(str, points)) or 'none'}.")
        size = replace(
            size,
            n_points=tuple(points),
            sampled=-(-size.sampled * max(points) // max(size.n_points)),
            elevation_points=points[-1],
            elevation_sampled=-(-size.elevation_sampled * points[-1] // size.elevation_points),
        )
        names.append(f"{' and '.join(f'{each:,}' for each in points)} points")
    if epochs is not None:
        passes = epochs * len(MODELNET8) * size.shares[0]
        size = replace(size, epochs=epochs, elevation_epochs=epochs, passes=passes)
        names.append(f"{epochs} epochs")
    summary = size.summary if len(names) == 1 else "otherwise of that size"
    return replace(size, name=", ".join(names), summary=summary)


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
