"""PCN's layout, as the loaders of GRNet, PoinTr and SnowflakeNet read it.

SPLIT/complete/TAXONOMY/OBJECT.pcd           16,384 points
SPLIT/partial/TAXONOMY/OBJECT/00.pcd ...     one per view: eight in train, one in val and test
PCN.json                                     taxonomy_id, taxonomy_name, and the objects of train, val, test
shapenet_synset_dict.json                    what each taxonomy is called
"""

from collections.abc import Iterator
from pathlib import Path

from zbuf_occlude.dataset.formats.pairs import Pairs, write_index
from zbuf_occlude.dataset.formats.published import SYNSETS, Names, check_pairs, listed, mesh_ids_of, write_synsets
from zbuf_occlude.dataset.pcd import read_pcd, write_pcd
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.dataset.source import Content, Source

INDEX = "PCN.json"
N_COMPLETE = 16_384
N_VIEWS = 8


def check(plan: Plan) -> None:
    """Raise OptionError unless the plan is as the loaders expect."""
    check_pairs(plan, "pcn", n_complete=N_COMPLETE, n_views=N_VIEWS)


def names(plan: Plan) -> Iterator[str]:
    """Yield the names of all files."""
    yield from (INDEX, SYNSETS)
    yield from PAIRS.names(plan)


def write_part(content: Content, out: Path) -> list[str]:
    """Write pairs."""
    return PAIRS.write_part(content, out)


def finish(out: Path, plan: Plan, names: dict[str, list[str]], n_clouds: dict[str, int]) -> dict[str, list[str]]:
    """Write the index of objects, and lists."""
    write_index(out / INDEX, plan, {split: mesh_ids_of(out, of_split) for split, of_split in names.items()})
    return listed(out, names, INDEX, write_synsets(out, plan))


def read(out: Path, plan: Plan, files: dict[str, list[str]]) -> Source:
    """Return the partial clouds."""
    return PAIRS.read(out, plan, files)


def _complete(split: str, names: Names, mesh_id: int) -> str:
    return f"{split}/complete/{names.taxonomies[mesh_id]}/{names.objects[mesh_id]}.pcd"


def _partial(split: str, names: Names, mesh_id: int, view: int) -> str:
    return f"{split}/partial/{names.taxonomies[mesh_id]}/{names.objects[mesh_id]}/{view:02d}.pcd"


PAIRS = Pairs("pcn", N_COMPLETE, _complete, _partial, write_pcd, write_pcd, read_pcd)
