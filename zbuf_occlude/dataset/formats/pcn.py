"""PCN's layout, as the loaders of GRNet, PoinTr and SnowflakeNet read it.

SPLIT/complete/TAXONOMY/OBJECT.pcd           16,384 points
SPLIT/partial/TAXONOMY/OBJECT/00.pcd ...     one per view: eight in train, one in val and test
PCN.json                                     taxonomy_id, taxonomy_name, and the objects of train, val, test
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
from zbuf_occlude.dataset.pcd import read_pcd, write_pcd
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.dataset.source import Source
from zbuf_occlude.meshes.collection import SPLITS

INDEX = "PCN.json"
N_COMPLETE = 16_384
VIEWS = {"train": 8, "val": 1, "test": 1}


def check(plan: Plan) -> None:
    """Raise OptionError unless the plan is as the loaders expect."""
    check_pairs(plan, "pcn", n_complete=N_COMPLETE, n_views=VIEWS["train"])


def names(plan: Plan) -> Iterator[str]:
    """Yield the names of all files."""
    names = names_of(plan)
    yield from (INDEX, *map(rest_name, plan.splits))
    for mesh_id, entry in enumerate(plan.meshes):
        yield _complete(entry.split, names, mesh_id)
        yield from (_partial(entry.split, names, mesh_id, view) for view in range(VIEWS[entry.split]))


def write(source: Source, out: Path) -> dict[str, list[str]]:
    """Write pairs; objects with a view that sees nothing are left out, for loaders count on every view."""
    names, files = names_of(source.plan), {}
    listed: dict[str, dict[str, Any]] = {}
    for split in source.order:
        written: list[str] = []

        def pairs(split: str = split, written: list[str] = written) -> Iterator[Records]:
            for clouds in by_object(source, split):
                if len(clouds) < VIEWS["train"]:
                    continue
                records = clouds[: VIEWS[split]]
                mesh_id = int(records["mesh_id"][0])
                taxonomy, name = names.taxonomies[mesh_id], names.objects[mesh_id]
                label = source.plan.meshes[mesh_id].label
                row = {"taxonomy_id": taxonomy, "taxonomy_name": label, **{other: [] for other in SPLITS}}
                listed.setdefault(taxonomy, row)[split].append(name)
                written.append(_complete(split, names, mesh_id))
                write_pcd(out / written[-1], complete_cloud(source, records, N_COMPLETE))
                for record in records:
                    written.append(_partial(split, names, mesh_id, int(record["view_id"])))
                    write_pcd(out / written[-1], record)
                yield records

        rest = write_rest(out, split, pairs(), source.plan.recipe)
        files[split] = [rest, write_list(out, split, written), INDEX]
    atomic.write_json(out / INDEX, [listed[taxonomy] for taxonomy in sorted(listed)])
    return files


def read(out: Path, plan: Plan, files: dict[str, list[str]]) -> Source:
    """Return the partial clouds."""

    def name_of(split: str, names: Names, record: Any) -> str:
        return _partial(split, names, int(record["mesh_id"]), int(record["view_id"]))

    return read_cloud_files(out, plan, files, read_pcd, name_of)


def _complete(split: str, names: Names, mesh_id: int) -> str:
    return f"{split}/complete/{names.taxonomies[mesh_id]}/{names.objects[mesh_id]}.pcd"


def _partial(split: str, names: Names, mesh_id: int, view: int) -> str:
    return f"{split}/partial/{names.taxonomies[mesh_id]}/{names.objects[mesh_id]}/{view:02d}.pcd"
