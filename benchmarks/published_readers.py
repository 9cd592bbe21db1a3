"""How each published loader of `published_loaders.py` is called, and what its items are.

A reader runs with the loader's checkout first on `sys.path`, in a folder whose `data` is as the loader's own
configuration has it. It changes nothing of the loader's and computes nothing: it opens every split and yields items.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray


class Item(NamedTuple):
    """What a loader gives: the split, the class's name, clouds (n, 3) or None, what it calls the object or None."""

    split: str
    label: str
    partial: NDArray[Any] | None
    complete: NDArray[Any] | None = None
    object: str | None = None


def _pointr(checkout: Path, config: str, splits: tuple[str, ...]) -> Iterator[tuple[str, Any]]:
    """Yield (split, item) of a dataset of PoinTr's registry by its own configuration."""
    from datasets import build_dataset_from_cfg
    from utils.config import cfg_from_yaml_file

    for split in splits:
        settings = cfg_from_yaml_file(str(checkout / "cfgs/dataset_configs" / config))
        settings.subset = split
        dataset = build_dataset_from_cfg(settings)
        yield from ((split, dataset[i]) for i in range(len(dataset)))


def _synsets(checkout: Path) -> dict[str, str]:
    """Return PoinTr's own names of the synsets."""
    import json

    names: dict[str, str] = json.loads((checkout / "data/shapenet_synset_dict.json").read_text())
    return names


def _pairs(checkout: Path, config: str, splits: tuple[str, ...]) -> Iterator[Item]:
    names = _synsets(checkout)
    for split, (taxonomy, model, (partial, complete)) in _pointr(checkout, config, splits):
        yield Item(split, names[taxonomy], _without_fill(partial), complete.numpy(), model)


def _without_fill(points: Any) -> NDArray[Any]:
    """Leave out the zeros with which loaders fill clouds of too few points."""
    cloud = np.asarray(points)
    return cloud[(cloud != 0).any(axis=1)]


def pointr_pcn(checkout: Path, data: Path) -> Iterator[Item]:
    """PoinTr's PCN."""
    return _pairs(checkout, "PCN.yaml", ("train", "val", "test"))
