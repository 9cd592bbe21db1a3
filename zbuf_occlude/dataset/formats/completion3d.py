"""Completion3D's layout: a partial and a complete cloud of 2,048 points per object, each an HDF5 file.

SPLIT/partial/TAXONOMY/OBJECT.h5    data (2048, 3) float32
SPLIT/gt/TAXONOMY/OBJECT.h5         data (2048, 3) float32
SPLIT.list                          TAXONOMY/OBJECT, one per line, as TopNet's loaders read it
Completion3D.json                   the same as PCN.json, as those of GRNet and PoinTr do
shapenet_synset_dict.json           what each taxonomy is called
synsetoffset2category.txt           the same, NAME TAXONOMY per line, one word each, as lynetcha/completion3d reads it
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.dataset import atomic
from zbuf_occlude.dataset.formats.pairs import Pairs, write_index
from zbuf_occlude.dataset.formats.published import (
    SYNSETS,
    Names,
    check_pairs,
    listed,
    mesh_ids_of,
    names_of,
    write_synsets,
)
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.dataset.source import Content, Source

INDEX, CATEGORIES = "Completion3D.json", "synsetoffset2category.txt"
SIZE = 2_048


def check(plan: Plan) -> None:
    """Raise OptionError unless the plan is as the loaders expect."""
    check_pairs(plan, "completion3d", n_complete=SIZE, n_views=1, size=SIZE)


def names(plan: Plan) -> Iterator[str]:
    """Yield the names of all files."""
    yield from (INDEX, CATEGORIES, SYNSETS, *(f"{split}.list" for split in plan.splits))
    yield from PAIRS.names(plan)


def write_part(content: Content, out: Path) -> list[str]:
    """Write pairs."""
    return PAIRS.write_part(content, out)


def finish(out: Path, plan: Plan, names: dict[str, list[str]], n_clouds: dict[str, int]) -> dict[str, list[str]]:
    """Write the lists and the index of objects."""
    mesh_ids = {split: mesh_ids_of(out, of_split) for split, of_split in names.items()}
    for split, of_split in mesh_ids.items():
        atomic.write_lines(out / f"{split}.list", [_place(names_of(plan), mesh_id) for mesh_id in of_split])
    write_index(out / INDEX, plan, mesh_ids)
    words = dict(zip(names_of(plan).taxonomies, names_of(plan).classes, strict=True))
    atomic.write_lines(out / CATEGORIES, [f"{words[taxonomy]}\t{taxonomy}" for taxonomy in sorted(words)])
    files = listed(out, names, INDEX, CATEGORIES, write_synsets(out, plan))
    return {split: [*of_split, f"{split}.list"] for split, of_split in files.items()}


def read(out: Path, plan: Plan, files: dict[str, list[str]]) -> Source:
    """Return the partial clouds."""
    return PAIRS.read(out, plan, files)


def _place(names: Names, mesh_id: int) -> str:
    return f"{names.taxonomies[mesh_id]}/{names.objects[mesh_id]}"


def _complete(split: str, names: Names, mesh_id: int) -> str:
    return f"{split}/gt/{_place(names, mesh_id)}.h5"


def _partial(split: str, names: Names, mesh_id: int, view: int) -> str:
    return f"{split}/partial/{_place(names, mesh_id)}.h5"


def _write_h5(path: Path, record: Any) -> None:
    def fill(file: Any) -> None:
        with h5py.File(file, "w") as h5:
            h5.create_dataset("data", data=record["data"].astype(np.float32), track_times=False)

    atomic.write(path, fill)


def _read_h5(path: Path) -> NDArray[Any]:
    with h5py.File(path) as h5:
        return np.asarray(h5["data"][:])


PAIRS = Pairs("completion3d", SIZE, _complete, _partial, _write_h5, _write_h5, _read_h5)
