"""ShapeNet-55's layout, as the loaders of PoinTr and Point-MAE read it: complete clouds, which they crop themselves.

shapenet_pc/TAXONOMY-OBJECT.npy      (8192, 3) float32
train.txt, test.txt (and val.txt)    names of these files, one per line
shapenet_synset_dict.json            what each taxonomy is called
"""

from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.dataset import atomic
from zbuf_occlude.dataset.formats.published import (
    SYNSETS,
    Names,
    check_pairs,
    check_version,
    from_theirs,
    listed,
    mesh_ids_of,
    names_of,
    read_cloud_files,
    record_as_theirs,
    rest_names,
    write_rest,
    write_synsets,
)
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.dataset.source import Content, Source

FOLDER = "shapenet_pc"
N_COMPLETE = 8_192


def check(plan: Plan) -> None:
    """Raise OptionError unless the plan is as the loaders expect."""
    check_pairs(plan, "shapenet55", n_complete=N_COMPLETE, size=N_COMPLETE)


def names(plan: Plan) -> Iterator[str]:
    """Yield the names of all files."""
    names = names_of(plan)
    yield SYNSETS
    yield from (f"{split}.txt" for split in plan.splits)
    yield from rest_names(plan)
    yield from (f"{FOLDER}/{complete_name(names, mesh_id)}" for mesh_id in range(len(plan.meshes)))


def write_part(content: Content, out: Path) -> list[str]:
    """Write one complete cloud per object."""
    names, written = names_of(content.plan), list[str]()
    (out / FOLDER).mkdir(exist_ok=True)
    for record in content.records:
        written.append(f"{FOLDER}/{complete_name(names, int(record['mesh_id']))}")
        write_npy(out / written[-1], record_as_theirs(record, content.plan, "shapenet55"))
    return [write_rest(out, content), *written]


def finish(out: Path, plan: Plan, names: dict[str, list[str]], n_clouds: dict[str, int]) -> dict[str, list[str]]:
    """Write the lists of objects."""
    return listed_complete(out, plan, names, below=FOLDER)


def listed_complete(out: Path, plan: Plan, names: dict[str, list[str]], below: str) -> dict[str, list[str]]:
    """Write for each split the places of its complete clouds below a folder, as loaders read them; the other lists."""
    folder = PurePosixPath(FOLDER).relative_to(below)
    for split, of_split in names.items():
        complete = [str(folder / complete_name(names_of(plan), mesh_id)) for mesh_id in mesh_ids_of(out, of_split)]
        atomic.write_lines(out / f"{split}.txt", complete)
    files = listed(out, names, write_synsets(out, plan))
    return {split: [*of_split, f"{split}.txt"] for split, of_split in files.items()}


def read(out: Path, plan: Plan, files: dict[str, list[str]]) -> Source:
    """Return the complete clouds."""
    check_version(plan, since=8)

    def name_of(split: str, names: Names, record: Any) -> str:
        return f"{FOLDER}/{complete_name(names, int(record['mesh_id']))}"

    def load(path: Path) -> NDArray[Any]:
        return from_theirs(np.load(path), plan.recipe, "shapenet55")

    return read_cloud_files(out, plan, files, load, name_of)


def complete_name(names: Names, mesh_id: int) -> str:
    """Return what an object's complete cloud is called; loaders split it at the hyphen and the dot."""
    return f"{names.taxonomies[mesh_id]}-{names.objects[mesh_id]}.npy"


def write_npy(path: Path, record: Any) -> None:
    """Write a record's points (n, 3) as float32."""
    atomic.write(path, lambda file: np.save(file, record["data"].astype(np.float32)))
