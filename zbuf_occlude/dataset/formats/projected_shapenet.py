"""Projected-ShapeNet's layout, as AdaPoinTr's loaders read it.

projected_partial_noise/TAXONOMY/OBJECT/models/0.pcd ... 15.pcd    partial clouds
shapenet_pc/TAXONOMY-OBJECT.npy                                    complete clouds, (8192, 3) float32
train.txt, test.txt (and val.txt)                                  names of the latter, one per line
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from zbuf_occlude.dataset import atomic
from zbuf_occlude.dataset.formats.published import (
    Names,
    Records,
    by_object,
    check_pairs,
    complete_cloud,
    names_of,
    read_cloud_files,
    rest_name,
    write_list,
    write_rest,
)
from zbuf_occlude.dataset.formats.shapenet55 import FOLDER, N_COMPLETE, complete_name, write_npy
from zbuf_occlude.dataset.pcd import read_pcd, write_pcd
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.dataset.source import Source

N_VIEWS = 16


def check(plan: Plan) -> None:
    """Raise OptionError unless the plan is as the loaders expect."""
    check_pairs(plan, "projected-shapenet", n_complete=N_COMPLETE, n_views=N_VIEWS)


def names(plan: Plan) -> Iterator[str]:
    """Yield the names of all files."""
    names = names_of(plan)
    yield from (name for split in plan.splits for name in (rest_name(split), f"{split}.txt"))
    for mesh_id in range(len(plan.meshes)):
        yield f"{FOLDER}/{complete_name(names, mesh_id)}"
        yield from (_partial(names, mesh_id, view) for view in range(N_VIEWS))


def write(source: Source, out: Path) -> dict[str, list[str]]:
    """Write pairs; objects with a view that sees nothing are left out, for loaders count on every view."""
    names, files = names_of(source.plan), {}
    for split in source.order:
        listed: list[str] = []
        written: list[str] = []

        def pairs(split: str = split, listed: list[str] = listed, written: list[str] = written) -> Iterator[Records]:
            for records in by_object(source, split):
                if len(records) < N_VIEWS:
                    continue
                listed.append(complete_name(names, int(records["mesh_id"][0])))
                written.append(f"{FOLDER}/{listed[-1]}")
                write_npy(out / written[-1], complete_cloud(source, records, N_COMPLETE)["data"])
                for record in records:
                    written.append(_partial(names, int(record["mesh_id"]), int(record["view_id"])))
                    write_pcd(out / written[-1], record)
                yield records

        rest = write_rest(out, split, pairs(), source.plan.recipe)
        atomic.write_lines(out / f"{split}.txt", listed)
        files[split] = [rest, write_list(out, split, written), f"{split}.txt"]
    return files


def read(out: Path, plan: Plan, files: dict[str, list[str]]) -> Source:
    """Return the partial clouds."""

    def name_of(split: str, names: Names, record: Any) -> str:
        return _partial(names, int(record["mesh_id"]), int(record["view_id"]))

    return read_cloud_files(out, plan, files, read_pcd, name_of)


def _partial(names: Names, mesh_id: int, view: int) -> str:
    where = f"{names.taxonomies[mesh_id]}/{names.objects[mesh_id]}"
    return f"projected_partial_noise/{where}/models/{view}.pcd"
