"""What things of a study are called: experiments, tests, splits, methods; needs no PyTorch."""

from types import MappingProxyType

from zbuf_occlude.compare.subjects import Subject

ELEVATION, AUGMENTATION, HSR = "elevation", "augmentation", "methods"
"""The experiments of 4.2, of 4.3 and 4.4, and the comparison of methods of hidden-surface removal."""

REALISM = "realism"
"""What a sensor and a scene do to a classifier."""
UNIFORM, ALONE, SCENES = KINDS = ("uniform", "scans", "scenes")
"""Its clouds: points uniform over the visible surface, scans of single objects, scans of objects in streets."""
OWN, MATCHED = COUNTS = ("own", "matched")
"""How many points they have: as many as they have, or as the poorest of the three has of that object and view."""

SPLIT_BY = MappingProxyType(
    {"elevations": "by elevation, as in the paper", "objects": "by elevation, objects held out"}
)

MAIN = Subject("exact")
METHODS = (MAIN, Subject("depth_buffer"), Subject("occupancy_grid", {"n": 64}))
"""How hidden surfaces are removed: the first everywhere, all where they are compared; the last is the paper's."""

CLOUDS, EPOCHS = "clouds", "epochs"
"""Budgets of the trainings of 4.3: each classifier is shown as many clouds, or each cloud as often."""
BUDGETS = MappingProxyType({CLOUDS: "equal clouds shown", EPOCHS: "equal epochs"})

ORIGINAL, GENERATED, SCANS = "original", "generated", "scans"
"""Test 1; Test 2, with ``:METHOD`` after it where it is another's than `MAIN`; Test 3."""

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
    variant = model.removeprefix(name)
    return _PRINTED.get(name, name) + (f" ({model})" if variant else "")


def described(model: str) -> str:
    """Return the same, and in which way a variant is not the paper's network."""
    return printed(model) + (f": {_VARIANTS[model]}" if model in _VARIANTS else "")
