"""PCN's layout, as the loaders of GRNet, PoinTr and SnowflakeNet read it.

SPLIT/complete/TAXONOMY/OBJECT.pcd           16,384 points
SPLIT/partial/TAXONOMY/OBJECT/00.pcd ...     one per view: eight in train, one in val and test
PCN.json                                     taxonomy_id, taxonomy_name, and the objects of train, val, test
shapenet_synset_dict.json                    what each taxonomy is called
"""

from collections.abc import Iterator
from pathlib import Path

from zbuf_occlude.dataset.formats.pairs import Pairs, write_index
from zbuf_occlude.dataset.formats.published import SYNSETS, Names, check_pairs, write_synsets
from zbuf_occlude.dataset.pcd import read_pcd, write_pcd
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.dataset.source import Source

INDEX = "PCN.json"
N_COMPLETE = 16_384
VIEWS = {"train": 8, "val": 1, "test": 1}


def check(plan: Plan) -> None:
    """Raise OptionError unless the plan is as the loaders expect."""
    check_pairs(plan, "pcn", n_complete=N_COMPLETE, n_views=VIEWS["train"])


def names(plan: Plan) -> Iterator[str]:
    """Yield the names of all files."""
    yield from (INDEX, SYNSETS)
    yield from PAIRS.names(plan)


def write(source: Source, out: Path) -> dict[str, list[str]]:
    """Write pairs, and the index of them."""
    files, mesh_ids = PAIRS.write(source, out)
    write_index(out / INDEX, source.plan, mesh_ids)
    synsets = write_synsets(out, source.plan)
    return {split: [*of_split, INDEX, synsets] for split, of_split in files.items()}


def read(out: Path, plan: Plan, files: dict[str, list[str]]) -> Source:
    """Return the partial clouds."""
    return PAIRS.read(out, plan, files)


def _complete(split: str, names: Names, mesh_id: int) -> str:
    return f"{split}/complete/{names.taxonomies[mesh_id]}/{names.objects[mesh_id]}.pcd"


def _partial(split: str, names: Names, mesh_id: int, view: int) -> str:
    return f"{split}/partial/{names.taxonomies[mesh_id]}/{names.objects[mesh_id]}/{view:02d}.pcd"


PAIRS = Pairs(N_COMPLETE, VIEWS, _complete, _partial, write_pcd, write_pcd, read_pcd)
