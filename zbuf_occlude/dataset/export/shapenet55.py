"""ShapeNet-55's layout, as the loaders of PoinTr and Point-MAE read it: complete clouds, which they crop themselves.

shapenet_pc/TAXONOMY-OBJECT.npy      (8192, 3) float32
train.txt, test.txt (and val.txt)    names of these files, one per line
shapenet_synset_dict.json            what each taxonomy is called
"""

from pathlib import Path
from typing import Any

import numpy as np

from zbuf_occlude.dataset import atomic
from zbuf_occlude.dataset.export import Exported, Rest, check_pairs, in_order, whole_objects
from zbuf_occlude.dataset.export.names import Names, names_of, write_synsets
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.dataset.source import Source

FOLDER = "shapenet_pc"
N_COMPLETE = 8_192


def check(plan: Plan) -> None:
    """Raise OptionError unless the plan is as the loaders expect."""
    check_pairs(plan, "shapenet55", n_complete=N_COMPLETE, size=N_COMPLETE)


def export(source: Source, out: Path) -> Exported:
    """Write one complete cloud per object, the lists, and the names of taxonomies."""
    names, files, n_clouds = names_of(source.plan), dict[str, list[str]](), dict[str, int]()
    (out / FOLDER).mkdir()
    for split, numbers in whole_objects(source, n_kept=1).items():
        rest, row, listed = Rest(out, split, source.plan, numbers.size), 0, list[str]()
        for records in in_order(source, numbers):
            rest.write(slice(row, row := row + len(records)), records)
            for record in records:
                listed.append(complete_name(names, int(record["mesh_id"])))
                write_npy(out / FOLDER / listed[-1], record)
        atomic.write_lines(out / f"{split}.txt", listed)
        files[split], n_clouds[split] = [*(f"{FOLDER}/{name}" for name in listed), rest.name], len(listed)
    write_synsets(out, source.plan, names)
    return Exported(files, n_clouds)


def complete_name(names: Names, mesh_id: int) -> str:
    """Return what an object's complete cloud is called; loaders split it at the hyphen and the dot."""
    return f"{names.taxonomies[mesh_id]}-{names.objects[mesh_id]}.npy"


def write_npy(path: Path, record: Any) -> None:
    """Write a record's points (n, 3) as float32."""
    np.save(path, record["data"].astype(np.float32))
