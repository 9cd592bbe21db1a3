"""Projected-ShapeNet's layout, as AdaPoinTr's loaders read it.

projected_partial_noise/TAXONOMY/OBJECT/models/0.pcd ... 15.pcd    partial clouds
shapenet_pc/TAXONOMY-OBJECT.npy                                    complete clouds, (8192, 3) float32
train.txt, test.txt (and val.txt)                                  shapenet_pc/TAXONOMY-OBJECT.npy, one per line
shapenet_synset_dict.json                                          what each taxonomy is called
"""

from pathlib import Path

from zbuf_occlude.dataset import atomic
from zbuf_occlude.dataset.export import Exported, check_pairs
from zbuf_occlude.dataset.export.names import write_synsets
from zbuf_occlude.dataset.export.pairs import Pairs
from zbuf_occlude.dataset.export.shapenet55 import FOLDER, N_COMPLETE, complete_name, write_npy
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.dataset.point_files import write_pcd
from zbuf_occlude.dataset.source import Source

PAIRS = Pairs(
    N_COMPLETE,
    lambda split, names, i: f"{FOLDER}/{complete_name(names, i)}",
    lambda split, names, i, view: f"projected_partial_noise/{names.taxonomies[i]}/{names.objects[i]}/models/{view}.pcd",
    write_npy,
    write_pcd,
)


def check(plan: Plan) -> None:
    """Raise OptionError unless the plan is as the loaders expect."""
    check_pairs(plan, "projected-shapenet", n_complete=N_COMPLETE, n_views=16)


def export(source: Source, out: Path) -> Exported:
    """Write pairs, the lists of objects, and the names of taxonomies."""
    exported, names, mesh_ids = PAIRS.export(source, out)
    for split, of_split in mesh_ids.items():
        atomic.write_lines(out / f"{split}.txt", [f"{FOLDER}/{complete_name(names, i)}" for i in of_split])
    write_synsets(out, source.plan, names)
    return exported
