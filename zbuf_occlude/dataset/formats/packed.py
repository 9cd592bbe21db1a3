"""All points of the objects, a bit for each point and view: the shards (`dataset.packed`) are the files."""

import os
from pathlib import Path

from zbuf_occlude.dataset.packed import Archives
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.dataset.source import Source
from zbuf_occlude.errors import DatasetError


def write(source: Source, out: Path) -> dict[str, list[str]]:
    """Refuse: what a source gives has been drawn; the other points of the objects are gone.

    Raises
    ------
    DatasetError
    """
    raise DatasetError(
        "a packed dataset must be made of all points of its objects; other formats keep only those drawn for each "
        "cloud. Make it with `zbuf-occlude generate --format packed`."
    )


def adopt(plan: Plan, shards: list[Path], out: Path) -> dict[str, list[str]]:
    """Move finished shards to where they stay; those that were moved already are found there."""
    names = [f"packed-{path.stem}.zip" for path in shards]
    for path, name in zip(shards, names, strict=True):
        if path.exists():
            os.replace(path, out / name)
    files: dict[str, list[str]] = {}
    for shard, name in zip(plan.shards, names, strict=True):
        for split in sorted({plan.meshes[mesh_id].split for mesh_id in shard}):
            files.setdefault(split, []).append(name)
    return files


def read(out: Path, plan: Plan, files: dict[str, list[str]]) -> Source:
    """Return the clouds as `generate` would draw them, in the order in which it would write them."""
    names = sorted({name for names in files.values() for name in names})
    return Archives(plan, [out / name for name in names]).source()
