"""The table of presets: meshes, options of `generate` and complete clouds of published datasets."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from zbuf_occlude.base.errors import OptionError, find_row
from zbuf_occlude.datasets.plan import Plan
from zbuf_occlude.meshes.collection import MeshCollection, MeshEntry

MODELNET8 = ("airplane", "bed", "bookshelf", "bottle", "car", "chair", "lamp", "table")
SHARES = {"train": 40, "val": 10, "test": 25}
"""Objects of each class in each split (paper 4.3)."""


def two_hundred(meshes: MeshCollection) -> MeshCollection:
    """Choose 200 meshes, as many of each class as can be: 5 of each of ModelNet40's, 25 of each built-in class."""
    return meshes.interleaved().limit(200)


def seventy_five_each(meshes: MeshCollection) -> MeshCollection:
    """Choose 40, 10 and 25 meshes of each of the eight classes to train, validate and test.

    A split is filled from its own meshes first. What it lacks (ModelNet has no "val", and 20 lamps to test) comes from
    those of "train" that are left, then from any. A class of fewer than 75 is an OptionError.
    """
    chosen: list[MeshEntry] = []
    for label in MODELNET8:
        left = [entry for entry in meshes if entry.label == label]
        if len(left) < sum(SHARES.values()):
            raise OptionError(
                f"paper-modelnet8 must find {sum(SHARES.values())} meshes of each of {', '.join(MODELNET8)}; "
                f"there are {len(left)} of {label}. Give ModelNet40, or no folder at all: the built-in shapes."
            )
        for split in ("train", "test", "val"):
            own = [e for e in left if e.split == split]
            others = sorted((e for e in left if e.split != split), key=lambda e: e.split != "train")
            taken = (own + others)[: SHARES[split]]
            left = [e for e in left if e not in taken]
            chosen += [replace(entry, split=split) for entry in taken]
    return MeshCollection(chosen).interleaved()


@dataclass(frozen=True)
class Preset:
    """One row of the table of presets."""

    name: str
    summary: str
    n_objects: int  # as many as in its paper
    options: Mapping[str, Any]  # defaults of `generate`, by the names of its command line's parameters
    choose: Callable[[MeshCollection], MeshCollection] = MeshCollection.interleaved  # picks from all there are
    original: bool = False  # a complete cloud of each object too, as a dataset in the folder `folder.ORIGINAL`


_OF_PAPER = {"format": "packed", "method": "exact"}
_OF_MODELNET40_C = {"format": "modelnet40-c", "splits": "test", "size": "2"}

PRESETS: tuple[Preset, ...] = (
    Preset(
        "paper-modelnet40",
        "section 4.1: 200 objects x 100 views x 10 variations, about 3,000 visible points each",
        200,
        {"views": "paper100", "variations": 10, "points": 8_000, **_OF_PAPER},
        two_hundred,
    ),
    Preset(
        "paper-modelnet8",
        "section 4.3: 8 classes x 75 objects x 25 views, 12,000 points each (the first 1,024 are the paper's smaller "
        "clouds), and a complete cloud of each object",
        600,
        {"views": "modelnet8", "points": 60_000, "sample_size": 12_000, **_OF_PAPER},
        seventy_five_each,
        original=True,
    ),
    Preset(
        "pcn",
        "PCN's layout: 8 random poses at distance 1, its camera, 16,384 complete points",
        30_974,
        {
            "views": "random-so3:8",
            "distance": "1",
            "format": "pcn",
            "sensor": "pcn",
            "size": "1",
            "sample_size": "all",
        },
    ),
    Preset(
        "mvp",
        "MVP's layout: 26 even poses, 2,048 points",
        4_000,
        {"views": "fibonacci:26", "format": "mvp", "method": "exact"},
    ),
    Preset(
        "modelnet40-c-occlusion",
        "ModelNet40-C's corruption by occlusion: the split test, 5 poses from above at 1.5 longest sides, its camera",
        2_468,
        {
            "views": "random:5@30..60",
            "distance": "1.5",
            "sensor": "modelnet40-c",
            "sample_size": "1024",
            **_OF_MODELNET40_C,
        },
    ),
    Preset(
        "modelnet40-c-lidar",
        "ModelNet40-C's corruption lidar: the split test, 5 poses at 2.5 longest sides, its bands of 1 degree",
        2_468,
        {
            "views": "random:5@22.5..22.5",
            "distance": "2.5",
            "sensor": "modelnet40-c-lidar",
            "sample_size": "768",
            "scale": "object",
            **_OF_MODELNET40_C,
        },
    ),
    Preset(
        "modelnet-o",
        "ModelNet-O's layout: 20 poses, farthest-point samples of 2,048",
        12_311,
        {"views": "fibonacci:20", "subset": "fps", "format": "modelnet-o", "method": "exact"},
    ),
)


def find_preset(name: str) -> Preset:
    """Return the row of a name; an unknown one is an OptionError."""
    return find_row("preset", name, PRESETS)


def plan_of_originals(plan: Plan) -> Plan:
    """Return the plan of the complete clouds: the same objects and points, one cloud each, nothing removed."""
    config = replace(plan.config, views="ring:1@0", variations=1, complete=True)
    return Plan(plan.meshes, config, plan.format)
