"""Completion3D's layout: a partial and a complete cloud of 2,048 points per object, each an HDF5 file.

SPLIT/partial/TAXONOMY/OBJECT.h5    data (2048, 3) float32
SPLIT/gt/TAXONOMY/OBJECT.h5         data (2048, 3) float32
SPLIT.list                          TAXONOMY/OBJECT, one per line, as TopNet's loaders read it
Completion3D.json                   the same as PCN.json, as those of GRNet and PoinTr do
synsetoffset2category.txt           the same, NAME TAXONOMY per line, one word each, as lynetcha/completion3d reads it
shapenet_synset_dict.json           what each taxonomy is called
"""

from pathlib import Path
from typing import Any

import h5py
import numpy as np

from zbuf_occlude.dataset import atomic
from zbuf_occlude.dataset.export import Exported, check_pairs
from zbuf_occlude.dataset.export.names import write_index, write_synsets
from zbuf_occlude.dataset.export.pairs import Pairs
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.dataset.source import Source

SIZE = 2_048


def check(plan: Plan) -> None:
    """Raise OptionError unless the plan is as the loaders expect."""
    check_pairs(plan, "completion3d", n_complete=SIZE, n_views=1, size=SIZE)


def export(source: Source, out: Path) -> Exported:
    """Write pairs, the lists and the index of objects, and the names of taxonomies."""
    exported, names, mesh_ids = PAIRS.export(source, out)
    for split, of_split in mesh_ids.items():
        atomic.write_lines(out / f"{split}.list", [f"{names.taxonomies[i]}/{names.objects[i]}" for i in of_split])
    write_index(out / "Completion3D.json", source.plan, names, mesh_ids)
    words = dict(zip(names.taxonomies, names.classes, strict=True))
    lines = [f"{words[taxonomy]}\t{taxonomy}" for taxonomy in sorted(words)]
    atomic.write_lines(out / "synsetoffset2category.txt", lines)
    write_synsets(out, source.plan, names)
    return exported


def _write_h5(path: Path, record: Any) -> None:
    with h5py.File(path, "w") as h5:
        h5.create_dataset("data", data=record["data"].astype(np.float32), track_times=False)


PAIRS = Pairs(
    SIZE,
    lambda split, names, i: f"{split}/gt/{names.taxonomies[i]}/{names.objects[i]}.h5",
    lambda split, names, i, view: f"{split}/partial/{names.taxonomies[i]}/{names.objects[i]}.h5",
    _write_h5,
    _write_h5,
)
