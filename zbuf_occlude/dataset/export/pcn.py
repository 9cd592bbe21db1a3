"""PCN's layout, as the loaders of GRNet, PoinTr and SnowflakeNet read it.

SPLIT/complete/TAXONOMY/OBJECT.pcd           16,384 points
SPLIT/partial/TAXONOMY/OBJECT/00.pcd ...     one per view: eight in train, one in val and test
PCN.json                                     taxonomy_id, taxonomy_name, and the objects of train, val, test
shapenet_synset_dict.json                    what each taxonomy is called
"""

from pathlib import Path

from zbuf_occlude.dataset.export import Exported, check_pairs
from zbuf_occlude.dataset.export.names import write_index, write_synsets
from zbuf_occlude.dataset.export.pairs import Pairs
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.dataset.point_files import write_pcd
from zbuf_occlude.dataset.source import Source

N_COMPLETE, N_VIEWS = 16_384, 8
PAIRS = Pairs(
    N_COMPLETE,
    lambda split, names, i: f"{split}/complete/{names.taxonomies[i]}/{names.objects[i]}.pcd",
    lambda split, names, i, view: f"{split}/partial/{names.taxonomies[i]}/{names.objects[i]}/{view:02d}.pcd",
    write_pcd,
    write_pcd,
    n_tested=1,
)


def check(plan: Plan) -> None:
    """Raise OptionError unless the plan is as the loaders expect."""
    check_pairs(plan, "pcn", n_complete=N_COMPLETE, n_views=N_VIEWS)


def export(source: Source, out: Path) -> Exported:
    """Write pairs, the index of objects and the names of taxonomies."""
    exported, names, mesh_ids = PAIRS.export(source, out)
    write_index(out / "PCN.json", source.plan, names, mesh_ids)
    write_synsets(out, source.plan, names)
    return exported
