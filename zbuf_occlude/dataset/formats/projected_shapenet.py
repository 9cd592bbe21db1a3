"""Projected-ShapeNet's layout, as AdaPoinTr's loaders read it.

projected_partial_noise/TAXONOMY/OBJECT/models/0.pcd ... 15.pcd    partial clouds
shapenet_pc/TAXONOMY-OBJECT.npy                                    complete clouds, (8192, 3) float32
train.txt, test.txt (and val.txt)                                  names of the latter, one per line
shapenet_synset_dict.json                                          what each taxonomy is called
"""

from collections.abc import Iterator
from pathlib import Path

from zbuf_occlude.dataset import atomic
from zbuf_occlude.dataset.formats.pairs import Pairs
from zbuf_occlude.dataset.formats.published import SYNSETS, Names, check_pairs, names_of, write_synsets
from zbuf_occlude.dataset.formats.shapenet55 import FOLDER, N_COMPLETE, complete_name, write_npy
from zbuf_occlude.dataset.pcd import read_pcd, write_pcd
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.dataset.source import Source
from zbuf_occlude.meshes.collection import SPLITS

N_VIEWS = 16


def check(plan: Plan) -> None:
    """Raise OptionError unless the plan is as the loaders expect."""
    check_pairs(plan, "projected-shapenet", n_complete=N_COMPLETE, n_views=N_VIEWS)


def names(plan: Plan) -> Iterator[str]:
    """Yield the names of all files."""
    yield from (SYNSETS, *(f"{split}.txt" for split in plan.splits))
    yield from PAIRS.names(plan)


def write(source: Source, out: Path) -> dict[str, list[str]]:
    """Write pairs, and the lists of them."""
    files, mesh_ids = PAIRS.write(source, out)
    names = names_of(source.plan)
    for split in files:
        atomic.write_lines(out / f"{split}.txt", [complete_name(names, mesh_id) for mesh_id in mesh_ids[split]])
    synsets = write_synsets(out, source.plan)
    return {split: [*of_split, f"{split}.txt", synsets] for split, of_split in files.items()}


def read(out: Path, plan: Plan, files: dict[str, list[str]]) -> Source:
    """Return the partial clouds."""
    return PAIRS.read(out, plan, files)


def _complete(split: str, names: Names, mesh_id: int) -> str:
    return f"{FOLDER}/{complete_name(names, mesh_id)}"


def _partial(split: str, names: Names, mesh_id: int, view: int) -> str:
    where = f"{names.taxonomies[mesh_id]}/{names.objects[mesh_id]}"
    return f"projected_partial_noise/{where}/models/{view}.pcd"


PAIRS = Pairs(N_COMPLETE, dict.fromkeys(SPLITS, N_VIEWS), _complete, _partial, write_npy, write_pcd, read_pcd)
