"""All points of the objects, a bit for each point and view: the shards (`dataset.packed`) are the files."""

from collections.abc import Iterator
from pathlib import Path

from zbuf_occlude.dataset.packed_files import PackedFiles
from zbuf_occlude.dataset.packed_store import shard_name
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.dataset.source import Source


def names(plan: Plan) -> Iterator[str]:
    """Yield the names of the shards."""
    return map(shard_name, range(len(plan.shards)))


def files_of(plan: Plan) -> dict[str, list[str]]:
    """Return the shards that each split has meshes in."""
    files: dict[str, list[str]] = {}
    for shard, name in zip(plan.shards, names(plan), strict=True):
        for split in sorted({plan.meshes[mesh_id].split for mesh_id in shard}):
            files.setdefault(split, []).append(name)
    return files


def read(out: Path, plan: Plan, files: dict[str, list[str]]) -> Source:
    """Return the clouds as `generate` would draw them, in the order in which it would write them."""
    all_names = sorted({name for of_split in files.values() for name in of_split})
    return PackedFiles(plan, [out / name for name in all_names]).source()
