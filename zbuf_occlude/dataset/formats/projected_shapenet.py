"""Projected-ShapeNet's layout, as AdaPoinTr's loaders read it.

projected_partial_noise/TAXONOMY/OBJECT/models/0.pcd ... 15.pcd    partial clouds
shapenet_pc/TAXONOMY-OBJECT.npy                                    complete clouds, (8192, 3) float32
train.txt, test.txt (and val.txt)                                  shapenet_pc/TAXONOMY-OBJECT.npy, one per line
shapenet_synset_dict.json                                          what each taxonomy is called
"""

from collections.abc import Iterator
from pathlib import Path

from zbuf_occlude.dataset.formats.pairs import Pairs
from zbuf_occlude.dataset.formats.published import SYNSETS, Names, check_pairs
from zbuf_occlude.dataset.formats.shapenet55 import FOLDER, N_COMPLETE, complete_name, listed_complete, write_npy
from zbuf_occlude.dataset.pcd import read_pcd, write_pcd
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.dataset.source import Content, Source

N_VIEWS = 16


def check(plan: Plan) -> None:
    """Raise OptionError unless the plan is as the loaders expect."""
    check_pairs(plan, "projected-shapenet", n_complete=N_COMPLETE, n_views=N_VIEWS)


def names(plan: Plan) -> Iterator[str]:
    """Yield the names of all files."""
    yield from (SYNSETS, *(f"{split}.txt" for split in plan.splits))
    yield from PAIRS.names(plan)


def write_part(content: Content, out: Path) -> list[str]:
    """Write pairs."""
    return PAIRS.write_part(content, out)


def finish(out: Path, plan: Plan, names: dict[str, list[str]], n_clouds: dict[str, int]) -> dict[str, list[str]]:
    """Write the lists of objects."""
    return listed_complete(out, plan, names, below=".")


def read(out: Path, plan: Plan, files: dict[str, list[str]]) -> Source:
    """Return the partial clouds."""
    return PAIRS.read(out, plan, files)


def _complete(split: str, names: Names, mesh_id: int) -> str:
    return f"{FOLDER}/{complete_name(names, mesh_id)}"


def _partial(split: str, names: Names, mesh_id: int, view: int) -> str:
    where = f"{names.taxonomies[mesh_id]}/{names.objects[mesh_id]}"
    return f"projected_partial_noise/{where}/models/{view}.pcd"


PAIRS = Pairs("projected-shapenet", N_COMPLETE, _complete, _partial, write_npy, write_pcd, read_pcd)
