"""ShapeNet-55's layout, as the loaders of PoinTr and Point-MAE read it: complete clouds, which they crop themselves.

shapenet_pc/TAXONOMY-OBJECT.npy      (8192, 3) float32
train.txt, test.txt (and val.txt)    names of these files, one per line
shapenet_synset_dict.json            what each taxonomy is called
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from zbuf_occlude.dataset import atomic
from zbuf_occlude.dataset.formats.published import (
    SYNSETS,
    Names,
    Records,
    by_object,
    check_pairs,
    names_of,
    read_cloud_files,
    rest_name,
    write_list,
    write_rest,
    write_synsets,
)
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.dataset.source import Source

FOLDER = "shapenet_pc"
N_COMPLETE = 8_192


def check(plan: Plan) -> None:
    """Raise OptionError unless the plan is as the loaders expect."""
    check_pairs(plan, "shapenet55", n_complete=N_COMPLETE, size=N_COMPLETE)


def names(plan: Plan) -> Iterator[str]:
    """Yield the names of all files."""
    names = names_of(plan)
    yield SYNSETS
    yield from (name for split in plan.splits for name in (rest_name(split), f"{split}.txt"))
    yield from (f"{FOLDER}/{complete_name(names, mesh_id)}" for mesh_id in range(len(plan.meshes)))


def write(source: Source, out: Path) -> dict[str, list[str]]:
    """Write one complete cloud per object."""
    names, files = names_of(source.plan), {}
    synsets = write_synsets(out, source.plan)
    for split in source.order:
        listed: list[str] = []

        def objects(split: str = split, listed: list[str] = listed) -> Iterator[Records]:
            for clouds in by_object(source, split):
                listed.append(complete_name(names, int(clouds["mesh_id"][0])))
                (out / FOLDER).mkdir(exist_ok=True)
                write_npy(out / FOLDER / listed[-1], clouds[0])
                yield clouds[:1]

        rest = write_rest(out, split, objects(), source.plan.recipe)
        atomic.write_lines(out / f"{split}.txt", listed)
        files[split] = [rest, write_list(out, split, [f"{FOLDER}/{name}" for name in listed]), f"{split}.txt", synsets]
    return files


def read(out: Path, plan: Plan, files: dict[str, list[str]]) -> Source:
    """Return the complete clouds."""

    def name_of(split: str, names: Names, record: Any) -> str:
        return f"{FOLDER}/{complete_name(names, int(record['mesh_id']))}"

    return read_cloud_files(out, plan, files, np.load, name_of)


def complete_name(names: Names, mesh_id: int) -> str:
    """Return what an object's complete cloud is called; loaders split it at the hyphen and the dot."""
    return f"{names.taxonomies[mesh_id]}-{names.objects[mesh_id]}.npy"


def write_npy(path: Path, record: Any) -> None:
    """Write a record's points (n, 3) as float32."""
    atomic.write(path, lambda file: np.save(file, record["data"].astype(np.float32)))
